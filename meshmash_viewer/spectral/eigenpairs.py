"""Eigenpairs: the eigenvalues and eigenvectors of a mesh computed so far."""

from __future__ import annotations

import math
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, wrong_type
from meshmash_viewer.features.filter_responses import count_zeros, hks_time_range
from meshmash_viewer.features.truncation import mean_shares
from meshmash_viewer.spectral.alignment import Alignment, ShownRows, multiplets
from meshmash_viewer.spectral.certificate import Certificate, verify_pairs
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.units import counted, format_quantity, format_share, named_vertex

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh, MeshLike

Rows: TypeAlias = npt.NDArray[np.floating[Any]]

#: Number of values (pairs times vertices) up to which a sum takes negligible time.
_SMALL = 3_000_000
#: Largest deviation of products of eigenvectors from the identity, above that of float32.
_ORTHONORMAL = 1e-4
#: Largest relative error of an eigenvalue that the mesh resolves.
RESOLVED = 0.05


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Immutable eigenpairs of L φ = λ M φ in ascending order.

    `solve` returns them; store, jobs, fields and window use them too. Rows mapped from a file are
    pickled as a reference to the file.

    Examples
    --------
    >>> pairs.eigenvalues[:4].round(1)
    array([0., 2., 2., 2.])
    >>> pairs.certificate.complete, bool(pairs.residuals.max() < 1e-9)
    (True, True)
    >>> pairs.eigenvalues.shape, pairs.eigenvectors.shape
    ((16,), (642, 16))
    """

    #: Shape (k,): In the inverse squared unit of the mesh.
    eigenvalues: npt.NDArray[np.float64]
    #: Shape (>= k, n): Row i is eigenvector i, M-orthonormal; NaN at vertices without mass. The
    #: entry of largest magnitude is positive.
    rows: Rows | ShownRows
    #: Shape (k,): ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``; for the null space, relative to Weyl's spacing 4π /
    #: area. NaN for approximate pairs.
    residuals: npt.NDArray[np.float64]
    #: Evidence that no pair is missing, with the worst residual and the orthonormality; its method
    #: is "none" until the computation has ended.
    certificate: Certificate = Certificate("none")  # noqa: RUF009 - frozen
    #: Seconds by stage.
    timings: Mapping[str, float] = field(default_factory=dict)
    #: Shape (n,): Diagonal of M; empty if unknown (see `vertex_areas`).
    mass: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0), repr=False)
    #: Number of pairs requested; 0 while unknown.
    total: int = 0
    #: What was asked for, as a count or the largest eigenvalue; None if unknown.
    target: Target | None = None
    #: Eigenvalue up to which the pairs are complete; 0 if no threshold was requested.
    known_to: float = 0.0
    #: Number of leading pairs that are exact, not approximations; None for all of them.
    n_exact: int | None = None
    #: Expected relative error of approximate eigenvalues.
    error: float = 0.0
    #: Shape (k,): Estimated relative error of each eigenvalue that is due to the mesh, signed, see
    #: `meshmash_viewer.spectral.resolution`; NaN for approximate pairs, empty if not estimated.
    mesh_errors: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0), repr=False)
    #: Number of leading pairs whose `mesh_errors` were measured on a finer mesh.
    n_measured: int = 0
    #: Parameters of the Laplacian.
    operator: OperatorOptions | None = None
    #: Signs and rotations of the rows as drawn.
    alignment: Alignment | None = None
    #: The surface, in its present unit.
    mesh: Mesh | None = field(default=None, repr=False)

    @classmethod
    def without_pairs(cls, mesh: Mesh) -> Eigenpairs:
        """Create the eigenpairs of a mesh that has not been decomposed."""
        none = np.empty(0)
        return cls(none, np.empty((0, mesh.n_vertices)), none, mesh=mesh)

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        if isinstance(self.rows, np.memmap) and self.rows.filename:
            state["rows"] = _MappedRows(self.rows.filename, self.rows.dtype, self.rows.shape)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        if isinstance(rows := state["rows"], _MappedRows):
            state["rows"] = np.memmap(rows.path, rows.dtype, "r", shape=rows.shape)
        self.__dict__.update(state)

    # -- quality ----------------------------------------------------------------------------------

    @property
    def n_components(self) -> int:
        """Number of pairs."""
        return len(self.eigenvalues)

    @property
    def eigenvectors(self) -> Rows:
        """The eigenvectors as columns, shape (n, k); a view of `rows`."""
        return self.rows[: self.n_components].T

    @property
    def complete(self) -> bool:
        """Whether the certificate proves that no pair is missing and all are within tolerance."""
        return self.certificate.complete

    @property
    def orthonormality(self) -> float:
        """Largest entry of ``|ΦᵀMΦ - I|``."""
        return self.certificate.orthonormality

    def proof(self, unit: str = "") -> str:
        """Describe in one line the number of pairs, their count and their errors.

        `unit` is the length unit of the mesh, "" for none.
        """
        certified = self.certificate.sentence(self.n_components, unit)
        return " · ".join(filter(None, [certified, self.resolution]))

    @property
    def resolved(self) -> npt.NDArray[np.bool_]:
        """Mask of the eigenvalues whose estimated error due to the mesh is at most 5 %, (k,)."""
        if not len(self.mesh_errors):
            return np.ones(self.n_components, dtype=np.bool_)
        return ~(np.abs(self.mesh_errors) > RESOLVED)

    @property
    def resolution(self) -> str:
        """Number of resolved pairs: "the mesh resolves 120 of 200 pairs to 5 %"; "" if unknown."""
        k, n = len(self.mesh_errors), self.n_measured
        if not k:
            return ""
        part = f" up to pair {n - 1}" if n < k else ""
        how = f" (measured on a finer mesh{part})" if n else ""
        pairs, zeros = f"{self.resolved.sum():,} of {counted(k, 'pair')}", first_nonzero(self)
        if self.resolved.sum() == zeros < k:
            pairs = f"none of the {k - zeros:,} nonzero pairs"
        return f"the mesh resolves {pairs} to {format_share(RESOLVED)}{how}"

    @cached_property
    def resolvable(self) -> tuple[float, int]:
        """Estimated largest eigenvalue that the mesh resolves, and the number of pairs up to it.

        Errors grow like eigenvalues; the last tenth of the known errors is continued.
        """
        errors = np.abs(self.mesh_errors[np.isfinite(self.mesh_errors)])
        k, area = len(errors), float(self.vertex_areas.sum())
        typical = float(np.median(errors[-max(k // 10, 1) :])) if k else 0.0
        if not typical > 0.0:
            return math.inf, self.n_vertices
        highest = float(self.eigenvalues[k - 1]) * RESOLVED / typical
        if highest <= self.eigenvalues[k - 1]:
            return highest, int(self.resolved[:k].sum())
        known = Translation(area, self.eigenvalues[:k], self.n_vertices)
        return highest, known.count(Target("max_eigenvalue", highest))[0]

    def within_resolution(self, target: Target) -> tuple[Target | None, str]:
        """Return the part of a target that the mesh resolves, and if it is limited, a sentence.

        None is returned if all resolved pairs are computed.
        """
        highest, count = self.resolvable
        known = Translation(float(self.vertex_areas.sum()), self.eigenvalues, self.n_vertices)
        if known.eigenvalue(target)[0] <= highest:
            return target, ""
        return Target("count", count) if count > self.n_components else None, self.mesh_limit

    @property
    def mesh_limit(self) -> str:
        """Sentence on the number of pairs that the mesh resolves."""
        pairs = counted(self.resolvable[1], "pair")
        return (
            f"The mesh resolves about {pairs} to {format_share(RESOLVED)}; further ones are those"
            " of its triangles rather than of the surface."
        )

    @property
    def exhausted(self) -> str:
        """Sentence that what is missing does not converge on this mesh; "" if more is resolved."""
        if not len(self.mesh_errors) or self.resolvable[1] > self.n_components:
            return ""
        return f"What is missing does not converge on this mesh. {self.mesh_limit}"

    def with_measured(self, errors: npt.NDArray[np.float64]) -> Self:
        """Replace the first `mesh_errors` by errors measured on a finer mesh."""
        rest = self.mesh_errors[len(errors) :]
        return replace(self, mesh_errors=np.append(errors, rest), n_measured=len(errors))

    def on_mask(self, mask: str) -> Self:
        """Add the description of a mask, "" for none, to the certificate of the pairs."""
        known, said = self.certificate, f"on the mask {mask} only"
        if not mask or said in known.remark or known.method == "none":
            return self
        remark = " · ".join(filter(None, [known.remark, said]))
        return replace(self, certificate=replace(known, remark=remark))

    def verify(self, stiffness: Any, mass: Any) -> Certificate:
        """Recompute the certificate independently of the solver.

        Residuals and all inner products are recomputed, and eigenvalues are counted from another
        factorization: up to the bound of the certificate or, if some pairs below this bound were
        left out, up to the highest gap between the pairs.

        `stiffness` and `mass` are the sparse L and M that were decomposed, shape (n, n), or the
        diagonal of M; `InputError` is raised if their size differs. `Certificate.complete` is the
        verdict.
        """
        assert isinstance(self.rows, np.ndarray)
        return verify_pairs(self.eigenvalues, self.rows, self.certificate, stiffness, mass)

    # -- parts ------------------------------------------------------------------------------------

    def first(self, count: int) -> Eigenpairs:
        """Return the lowest `count` pairs, with their certificate."""
        whole, values = count == len(self.eigenvalues), self.eigenvalues
        certificate = self.certificate.of_first(count, values, self.residuals)
        return replace(
            self,
            eigenvalues=values[:count],
            rows=self.rows[:count] if isinstance(self.rows, np.ndarray) else self.rows,
            residuals=self.residuals[:count],
            certificate=self.certificate if whole else certificate,
            mesh_errors=self.mesh_errors[:count],
            n_measured=min(self.n_measured, count),
            total=count,
            target=self.target if whole else Target("count", max(count, 1)),
            known_to=self.known_to if whole else 0.0,
            n_exact=None if self.n_exact is None else min(self.n_exact, count),
        )

    @property
    def preview(self) -> bool:
        """Whether some pairs are approximations."""
        return self.n_exact is not None and self.n_exact < len(self.eigenvalues)

    def is_exact(self, index: int) -> bool:
        """Whether a pair is exact, not an approximation."""
        return self.n_exact is None or index < self.n_exact

    @property
    def exact(self) -> Eigenpairs:
        """The exact pairs; all pairs if none is an approximation."""
        if self.n_exact is None:
            return self
        values, residuals = self.eigenvalues[: self.n_exact], self.residuals[: self.n_exact]
        return replace(self, eigenvalues=values, residuals=residuals, n_exact=None)

    def before(self, preview: Eigenpairs) -> Eigenpairs:
        """Append the pairs of a preview from the next index on."""
        assert not isinstance(self.rows, ShownRows)
        assert not isinstance(preview.rows, ShownRows)
        count, rest = len(self), preview.eigenvalues[len(self) :]
        return replace(
            self,
            eigenvalues=np.maximum.accumulate(np.concatenate([self.eigenvalues, rest])),
            rows=ShownRows(self.rows, count, preview.rows, self.alignment or Alignment()),
            residuals=np.concatenate([self.residuals, np.full(len(rest), np.nan)]),
            mesh_errors=np.concatenate([self.mesh_errors, np.full(len(rest), np.nan)]),
            n_exact=count,
            error=preview.error,
            alignment=None,
        )

    def on_file(self, mesh: Mesh) -> Eigenpairs:
        """Expand to all vertices of the file of the repaired `mesh`, see `Mesh.on_file`.

        Of several merged vertices one receives the mass, the others 0.
        """
        mass = np.zeros(mesh.n_file_vertices)
        mass[mesh.file_indices] = self.mass
        return replace(self, rows=mesh.on_file(self.eigenvectors).T, mass=mass)

    # -- display ----------------------------------------------------------------------------------

    @cached_property
    def shown_rows(self) -> Rows | ShownRows:
        """The rows as drawn and plotted, shape (>= k, n)."""
        if self.alignment is None:
            return self.rows
        assert not isinstance(self.rows, ShownRows)
        return ShownRows(self.rows, len(self), None, self.alignment)

    @property
    def small(self) -> bool:
        """Whether sums over the pairs are fast without a table."""
        return self.rows.size <= _SMALL

    @property
    def vertex_areas(self) -> npt.NDArray[np.float64]:
        """Area of each vertex, shape (n,): `mass`, or if unknown `Mesh.vertex_areas`.

        The masses of the robust Laplacian differ slightly from `Mesh.vertex_areas`.
        """
        if len(self.mass):
            return self.mass
        assert self.mesh is not None
        return self.mesh.vertex_areas

    @cached_property
    def n_vertices(self) -> int:
        """Number of vertices with mass, which is the total number of pairs."""
        return int(np.count_nonzero(~np.isnan(self.rows[0]))) if len(self) else 0

    @cached_property
    def time_range(self) -> tuple[float, float]:
        """Shortest and longest HKS time that the pairs resolve, in squared length units.

        (1, 10) if all eigenvalues are zero within rounding.
        """
        values = self.eigenvalues
        if not len(values) or not values[-1] > 1e-9 * max(abs(float(values[0])), 1e-300):
            return 1.0, 10.0
        t_min, t_max = hks_time_range(values)
        return float(t_min), float(t_max)

    def missing_shares(self, bank: FilterBank, area: float) -> npt.NDArray[np.float64]:
        """Estimate the share of each column due to pairs that were not computed, shape (f,)."""
        known_to = self.known_to or None
        return mean_shares(bank, self.eigenvalues, area, self.n_vertices, known_to)

    def multiplet(self, index: int) -> range | None:
        """Return the indices of equal eigenvalues to which an index belongs; None if it has none.

        Eigenvalues are equal up to a relative gap of `MULTIPLET_GAP`; their eigenfunctions can be
        combined arbitrarily.
        """
        for first, stop in multiplets(self.eigenvalues, 0, len(self.eigenvalues)):
            if first <= index < stop and stop - first > 1:
                return range(first, stop)
        return None

    def file_index(self, vertex: int) -> int:
        """Return the index of a vertex in the file of the mesh, see `Mesh.file_index`."""
        return vertex if self.mesh is None else self.mesh.file_index(vertex)

    def named_vertex(self, vertex: int) -> str:
        """Return the displayed name of a vertex: "vertex 22,351"."""
        return named_vertex(self.file_index(vertex))

    def vertex_script(self, vertex: int) -> str:
        """Return the Python expression for a vertex of its ``mesh``."""
        if self.mesh is None or self.mesh.numbering is None:
            return str(vertex)
        return f"mesh.vertex_of({self.file_index(vertex)})"


@dataclass(frozen=True)
class _MappedRows:
    """Reference to rows in a file."""

    path: Any
    dtype: np.dtype[Any]
    shape: tuple[int, ...]


#: Anything that `as_eigenpairs` accepts.
EigenpairsLike: TypeAlias = "Eigenpairs | tuple[npt.ArrayLike, npt.ArrayLike]"

#: Diagonal of M by the id of the array that owns eigenvectors which `as_pair` has returned.
_MASSES: dict[int, npt.NDArray[np.float64]] = {}


def as_pair(pairs: Eigenpairs) -> tuple[npt.NDArray[np.float64], Rows]:
    """Return ``(eigenvalues, eigenvectors)``, for which `as_eigenpairs` recalls the masses."""
    owner = _owner(pairs.eigenvectors)
    _MASSES[id(owner)] = pairs.mass
    weakref.finalize(owner, _MASSES.pop, id(owner), None)
    return pairs.eigenvalues, pairs.eigenvectors


def as_eigenpairs(call: str, given: EigenpairsLike, mesh: MeshLike | None = None) -> Eigenpairs:
    """Convert any accepted form of eigenpairs to `Eigenpairs`.

    Accepted are `Eigenpairs` (returned unchanged) and the pair ``(eigenvalues, eigenvectors)`` of
    the functions of `meshmash_viewer.decompose`. Their masses are recalled while the arrays, or
    views of them, exist; for other arrays they are the areas of `mesh`, if the eigenvectors are
    orthonormal with respect to these.

    `InputError` is raised for other objects, for arrays whose shapes do not agree, and if the
    masses are unknown. `call` is the correct call, for the message.
    """
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return _from_arrays(call, given, mesh)
    if not (hasattr(given, "eigenvalues") and hasattr(given, "rows")):
        raise wrong_type(f"Pairs of {call}", type(given), "the result of solve or decompose_mesh")
    if not len(given.mass) and (given.mesh is not None or mesh is not None):
        from meshmash_viewer.mesh import as_mesh

        surface = given.mesh if given.mesh is not None else as_mesh(mesh)
        given = replace(given, mass=surface.vertex_areas)
    if len(given.mass) != given.rows.shape[1]:
        raise InputError(
            "other-mesh",
            f"The eigenpairs have {given.rows.shape[1]} vertices, and areas of {len(given.mass)}",
            "give what solve returns, or Eigenpairs with the diagonal of M as its mass",
        )
    return given


def as_two_eigenpairs(
    call: str,
    first: EigenpairsLike,
    second: EigenpairsLike,
    meshes: tuple[MeshLike, MeshLike] | None = None,
) -> tuple[Eigenpairs, Eigenpairs]:
    """Convert the eigenpairs of two meshes, see `as_eigenpairs`."""
    here, there = meshes or (None, None)
    return as_eigenpairs(call, first, here), as_eigenpairs(call, second, there)


def _from_arrays(
    call: str, given: tuple[Any, Any] | list[Any], mesh: MeshLike | None
) -> Eigenpairs:
    values, vectors = (np.asarray(each) for each in given)
    if values.ndim != 1 or vectors.ndim != 2 or vectors.shape[1] != len(values):
        fault = f"Arrays of {call} have shapes {values.shape} and {vectors.shape}"
        remedy = "give eigenvalues of shape (k,) with eigenvectors of shape (n, k)"
        raise InputError("wrong-shape", fault, remedy)
    mass = _MASSES.get(id(_owner(vectors)), np.zeros(0))
    if len(mass) != len(vectors) and mesh is not None:
        mass = _areas(vectors, mesh)
    if len(mass) != len(vectors):
        raise InputError(
            "no-area",
            f"The areas of these eigenvectors are not known to {call}, as of a copy or a file",
            "give Eigenpairs(eigenvalues, eigenvectors.T, residuals, mass=M.diagonal())",
        )
    return Eigenpairs(values.astype(np.float64), vectors.T, np.full(len(values), np.nan), mass=mass)


def _areas(vectors: Rows, mesh: MeshLike) -> npt.NDArray[np.float64]:
    """Return the areas of a mesh for which eigenvectors are orthonormal; empty if none are."""
    from meshmash_viewer.laplacian import compute_vertex_areas

    for robust in (True, False):
        mass = compute_vertex_areas(mesh, robust=robust)
        used = mass > 0.0
        if len(mass) == len(vectors) and np.isfinite(vectors[used]).all():
            products = (vectors[used].T * mass[used]) @ vectors[used]
            if np.allclose(products, np.eye(len(products)), atol=_ORTHONORMAL):
                return mass
    return np.zeros(0)


def _owner(array: Rows) -> Rows:
    """Return the array that owns the memory of a view."""
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def format_eigenvalue(value: float, spectrum: Eigenpairs, unit: str, digits: int = 3) -> str:
    """Write an eigenvalue in the unit in which the largest eigenvalue is a short number."""
    like = float(spectrum.eigenvalues[-1])
    return format_quantity(float(value), unit, -2, digits, like=like)


def first_nonzero(spectrum: Eigenpairs) -> int:
    """Return the index of the first eigenvalue above rounding, or the number of eigenvalues."""
    return count_zeros(spectrum.eigenvalues)


def grew(old: Eigenpairs, new: Eigenpairs) -> bool:
    """Whether `new` eigenpairs equal the `old` ones or extend them by further pairs."""
    count = len(old)
    last = slice(max(count - 1, 0), count)
    return old is new or (
        count <= len(new)
        and old.preview == new.preview
        and old.operator == new.operator
        and old.rows.shape[1] == new.rows.shape[1]
        and bool(np.array_equal(old.eigenvalues, new.eigenvalues[:count]))
        and np.array_equal(old.rows[last], new.rows[last], equal_nan=True)
    )


def same_pairs(old: Eigenpairs, new: Eigenpairs) -> bool:
    """Whether `old` and `new` have the same pairs; their certificates may differ."""
    return len(old) == len(new) and grew(old, new)

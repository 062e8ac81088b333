"""Feature columns for learning classes, comparable between meshes."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, unknown
from meshmash_viewer.features.filter_responses import MOST_FILTERS, check_times, hks_time_range
from meshmash_viewer.features.filters import FilterBank, heat_kernel_bank, wave_kernel_bank
from meshmash_viewer.features.sums import Features, accumulate_features
from meshmash_viewer.health import median_edge_length
from meshmash_viewer.laplacian import OperatorOptions, SparseMatrix, cotangent_laplacian
from meshmash_viewer.learn import KINDS
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback, check_cancelled
from meshmash_viewer.spectral.cost import check_columns
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, EigenpairsLike, Rows, as_eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.surface.curvature import gaussian_curvature, mean_curvature
from meshmash_viewer.units import (
    LENGTH_UNITS,
    METRES,
    check_positive,
    format_quantity,
    whole_number,
)

#: Standard deviation of wave kernel bands, relative to the spacing of their energies.
_WIDTH = 2.0
#: Lower limit before the logarithm, relative to HKS on a plane, or to the mean WKS on the surface.
FLOOR = 1e-9
#: Squared length times largest eigenvalue above which heat flow is computed from eigenpairs: the
#: missing pairs have then decayed to less than 1 %.
_DECAYED = 5.0
#: Shortest length of curvature relative to √t_min, and longest relative to √t_max.
_LENGTHS = (0.4, 0.45)
#: Columns of curvature at each length.
_CURVATURES = ("offset", "distance", "tilt", "agreement", "mean", "gaussian")
#: By kind of columns: the time relative to the squared median edge below which decimation to this
#: edge shifts a column by more than its standard deviation over the surface (measured on a blob).
_RESOLVED = {"hks": 5.0, "wks": 15.0, "curvature": 0.0}
#: Residual of diffusion relative to the right-hand side, and maximum number of steps.
_TOLERANCE, _STEPS = 1e-5, 3000


class Column(NamedTuple):
    """Name and kind of a column, and its diffusion time in squared unit of the columns.

    The time is 1/λ for an energy of WKS, and l² for a length of curvature.
    """

    name: str
    kind: str
    time: float


@dataclass(frozen=True)
class ClassColumns:
    """Columns to learn classes from, at fixed times and lengths in a unit of length.

    They do not depend on the spectrum of a mesh, so that columns of several meshes are comparable.
    `chosen` selects times for a mesh. `InputError` is raised if a kind is unknown, or a number is
    not positive.

    Parameters
    ----------
    t_min, t_max : float
        Shortest and longest diffusion time, in squared `unit`.
    max_eigenvalue : float
        Eigenvalue up to which pairs are used, per squared `unit`.
    unit : str
        Unit of length, "" for none.
    kinds : tuple of str
        Some of "hks", "wks" and "curvature".
    n_times : int
        Number of times, evenly spaced in log t, and of energies.
    n_lengths : int
        Number of lengths over which the surface is smoothed for "curvature".
    drop_first : bool
        Whether the first eigenpair is left out.
    operator : OperatorOptions
        Parameters of the Laplacian.

    Examples
    --------
    >>> columns = mv.ClassColumns(t_min=0.1, t_max=1.0, max_eigenvalue=20.0, n_times=4)
    >>> columns.compute(ball, pairs).shape
    (642, 4)
    """

    t_min: float
    t_max: float
    max_eigenvalue: float
    unit: str = ""
    kinds: tuple[str, ...] = ("hks",)
    n_times: int = 32
    n_lengths: int = 8
    drop_first: bool = False
    operator: OperatorOptions = field(default_factory=OperatorOptions)

    def __post_init__(self) -> None:
        object.__setattr__(self, "kinds", tuple(self.kinds))
        wrong = [kind for kind in self.kinds if kind not in KINDS]
        if wrong or not self.kinds or len(set(self.kinds)) < len(self.kinds):
            given = ", ".join(map(str, wrong or self.kinds)) or "none"
            remedy = f"give different ones out of {', '.join(KINDS)}"
            raise InputError("unknown-name", f"Kinds of columns are {given}", remedy)
        check_times(self.t_min, self.t_max)
        if not self.t_min < self.t_max:
            raise InputError("bounds-swapped", f"t_min is t_max, {self.t_min:g}", "give a range")
        check_positive(self.max_eigenvalue, "max_eigenvalue")
        if self.unit not in LENGTH_UNITS:
            raise unknown("unit of length", self.unit, filter(None, LENGTH_UNITS))
        for name in ("n_times", "n_lengths"):
            whole_number(getattr(self, name), name, MOST_FILTERS)

    @classmethod
    def chosen(
        cls,
        mesh: MeshLike,
        pairs: EigenpairsLike,
        t_min: float | None = None,
        t_max: float | None = None,
        **others: Any,
    ) -> Self:
        """Choose columns, by default with the range of times that the eigenpairs resolve."""
        exact = as_eigenpairs("ClassColumns.chosen(mesh, pairs)", pairs, mesh).exact
        found = hks_time_range(exact.eigenvalues, as_mesh(mesh).area)
        low, high = t_min or found[0], t_max or found[1]
        last = exact.known_to or float(exact.eigenvalues[-1])
        return cls(low, high, last, as_mesh(mesh).unit, **others)

    @property
    def times(self) -> FloatArray:
        """Diffusion times, in squared `unit`."""
        return np.geomspace(self.t_min, self.t_max, self.n_times)

    @property
    def lengths(self) -> FloatArray:
        """Lengths over which the surface is smoothed, in `unit`."""
        low, high = math.sqrt(self.t_min), math.sqrt(self.t_max)
        return np.geomspace(_LENGTHS[0] * low, _LENGTHS[1] * high, self.n_lengths)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each column."""
        return tuple(each.name for each in self.columns)

    @property
    def columns(self) -> list[Column]:
        """The columns, in the order of `compute`."""
        found: list[Column] = []
        for kind in self.kinds:
            if kind == "curvature":
                found += [
                    Column(f"{name}_l={length:.3g}", kind, length**2)
                    for length in self.lengths.tolist()
                    for name in _CURVATURES
                ]
            else:
                names = self._bank(kind, np.array([0.0, self.max_eigenvalue])).columns
                times = self.times if kind == "hks" else np.exp(-self._energies)
                each = zip(names, times.tolist(), strict=True)
                found += [Column(f"log_{name}", kind, time) for name, time in each]
        return found

    def limit(self, mesh: Mesh) -> float:
        """Return the largest eigenvalue in the unit of a mesh."""
        return self.max_eigenvalue / self.scale(mesh) ** 2

    def scale(self, mesh: Mesh) -> float:
        """Return the length of `unit` in the unit of a mesh."""
        if not (self.unit and mesh.unit):
            return 1.0
        return float(10.0 ** (METRES[self.unit] - METRES[mesh.unit]))

    def edge(self, mesh: Mesh) -> float:
        """Return the median edge length of a mesh, in `unit`."""
        return median_edge_length(mesh) / self.scale(mesh)

    def unresolved(self, edge: float) -> npt.NDArray[np.bool_]:
        """Return which columns depend on triangles of an edge length in `unit`, shape (f,)."""
        return np.array([time < _RESOLVED[kind] * edge**2 for _, kind, time in self.columns])

    def check_unit(self, mesh: Mesh) -> None:
        """Raise `InputError` if these columns cannot be converted to the unit of a mesh."""
        if mesh.unit and self.unit:
            return
        if self.unit:
            of_columns = f"the times of the columns are in {self.unit}²"
            fault = f"{mesh.name or 'The mesh'} has no unit of length, and {of_columns}"
            raise InputError("no-unit", fault, "state the unit of its coordinates (--unit, unit=)")
        fault = f"The columns have no unit of length, so they cannot be compared with {mesh.name}"
        remedy = "train again with meshes whose unit is stated (--unit, unit=)"
        raise InputError("no-unit", fault, remedy)

    def compute(
        self,
        mesh: MeshLike,
        pairs: EigenpairsLike | None = None,
        *,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
    ) -> Features:
        """Compute the columns of a mesh, shape (n, f), in powers of `unit`.

        Values at unreferenced vertices are NaN. The eigenpairs `pairs` of the mesh are recomputed
        if they do not reach `max_eigenvalue`. For `progress` and `cancel` see
        `meshmash_viewer.progress`.
        """
        mesh = as_mesh(mesh)
        check_columns(mesh.n_vertices, len(self.names))
        if pairs is not None:
            pairs = as_eigenpairs("compute(mesh, pairs)", pairs, mesh)
        if pairs is None or not self._reached(mesh, pairs):
            callbacks: Any = {"progress": progress, "cancel": cancel}
            pairs = solve(*self.matrices(mesh), max_eigenvalue=self.limit(mesh), **callbacks)
        eigenvalues = pairs.exact.eigenvalues * self.scale(mesh) ** 2
        count = int(np.searchsorted(eigenvalues, self.max_eigenvalue * (1.0 + 1e-9), "right"))
        assert isinstance(pairs.rows, np.ndarray)
        known = eigenvalues[:count], pairs.rows[:count]
        parts = []
        for kind in self.kinds:
            check_cancelled(cancel)
            if kind == "curvature":
                parts.append(self._curvature(mesh, *known, progress, cancel))
            else:
                parts.append(self._logarithms(kind, mesh, *known))
        values = np.concatenate(parts, axis=1, dtype=np.float32)
        values[mesh.unreferenced] = np.nan
        return Features(values, self.names, kind="classes")

    def matrices(self, mesh: Mesh) -> tuple[SparseMatrix, FloatArray]:
        """Return the Laplacian of a mesh, and the mass of each vertex."""
        given = self.operator
        stiffness, mass = cotangent_laplacian(mesh, given.robust, given.mollify_factor)
        return stiffness, mass.diagonal()

    def _reached(self, mesh: Mesh, pairs: Eigenpairs) -> bool:
        """Whether pairs reach `max_eigenvalue`, or are all pairs of the mesh."""
        exact, limit = pairs.exact, self.limit(mesh) * (1.0 - 1e-9)
        n = mesh.n_vertices - len(mesh.unreferenced)
        reach = max(exact.known_to, float(exact.eigenvalues[-1])) if exact.n_components else 0.0
        return reach >= limit or exact.n_components >= n

    @property
    def _energies(self) -> FloatArray:
        """Logarithms of the eigenvalues at the middle of each band."""
        return np.linspace(-math.log(self.t_max), math.log(self.max_eigenvalue), self.n_times)

    def _bank(self, kind: str, eigenvalues: FloatArray) -> FilterBank:
        if kind == "hks":
            return heat_kernel_bank(self.times)
        energies = self._energies
        spacing = abs(energies[1] - energies[0]) if self.n_times > 1 else 1.0
        return wave_kernel_bank(eigenvalues, energies=energies, sigma=_WIDTH * spacing)

    def _logarithms(self, kind: str, mesh: Mesh, eigenvalues: FloatArray, rows: Rows) -> FloatArray:
        """Compute logarithms of HKS, or of WKS relative to its mean on the surface.

        HKS is at least a share of its value on a plane: without the first pair HKS vanishes on
        debris.
        """
        start = int(self.drop_first)
        bank = self._bank(kind, eigenvalues[start:])
        sums = accumulate_features(rows[start:], bank(eigenvalues[start:]))
        if kind == "hks":
            sums *= self.scale(mesh) ** 2
            floor = FLOOR / (4.0 * np.pi * self.times)
        else:
            sums *= mesh.area
            floor = np.full(self.n_times, FLOOR)
        return np.asarray(np.log(np.fmax(sums, floor)))

    def _curvature(
        self,
        mesh: Mesh,
        eigenvalues: FloatArray,
        rows: Rows,
        progress: ProgressCallback | None,
        cancel: CancelCallback | None,
    ) -> FloatArray:
        """Compute position and normal of vertices relative to the smoothed surface, and curvature.

        Smoothing over a short length is one implicit step, over a long length heat flow with
        eigenpairs. For a short length the offset along the normal is mean curvature times squared
        length.
        """
        scale = self.scale(mesh)
        places = mesh.vertices - np.average(mesh.vertices, axis=0, weights=mesh.vertex_areas)
        side = -1.0 if np.linalg.det(places[mesh.faces]).sum() < 0.0 else 1.0  # to point outwards
        places = mesh.on_surface(places) / scale
        normals = mesh.vertex_normals.astype(np.float64) * side
        bends = [mean_curvature(mesh) * side * scale, gaussian_curvature(mesh) * scale**2]
        known = np.isfinite(bends[0])[:, None]  # curvature is NaN on the boundary
        given = np.concatenate([places, normals, np.nan_to_num(np.stack(bends, 1)), known], axis=1)
        if len(mesh.unreferenced):
            rows = np.nan_to_num(rows)
        stiffness, mass = self.matrices(mesh)
        smooth, columns, spectrum = given, [], None
        for at, length in enumerate(self.lengths):
            if progress is not None:
                said = f"Smoothing over {format_quantity(length, self.unit)}"
                progress(Progress("columns", at / self.n_lengths, message=said))
            if length**2 * self.max_eigenvalue < _DECAYED:
                smooth = diffused(stiffness, mass / scale**2, given, length, smooth, cancel)
            else:
                check_cancelled(cancel)
                if spectrum is None:
                    spectrum = rows @ (mass[:, None] * given)
                smooth = rows.T @ (np.exp(-(length**2) * eigenvalues)[:, None] * spectrum)
            apart, around = places - smooth[:, :3], smooth[:, 3:6]
            share = np.maximum(smooth[:, 8], FLOOR)
            columns += [
                np.einsum("ij,ij->i", apart, normals),
                np.linalg.norm(apart, axis=1),
                np.einsum("ij,ij->i", around, normals),
                np.linalg.norm(around, axis=1),
                smooth[:, 6] / share,
                smooth[:, 7] / share,
            ]
        return np.stack(columns, axis=1)

    def plain(self) -> dict[str, Any]:
        """Return the parameters as JSON values."""
        return {**asdict(self), "kinds": list(self.kinds)}

    @classmethod
    def from_plain(cls, entries: dict[str, Any]) -> Self:
        """Create columns from the result of `plain`."""
        operator = OperatorOptions(**entries["operator"])
        return cls(**{**entries, "operator": operator})


def diffused(
    stiffness: SparseMatrix,
    mass: FloatArray,
    values: FloatArray,
    length: float,
    start: FloatArray | None = None,
    cancel: CancelCallback | None = None,
) -> FloatArray:
    """Smooth d functions f over a length l: solve ``(M + l² L) x = M f``, shape (n, d).

    All functions are solved together, by conjugate gradients with the diagonal as preconditioner,
    starting at `start`; longer lengths take more steps. Values at vertices without mass are
    unchanged. Results are within the range of f if L has no positive entry off its diagonal.
    """
    weights = np.where(mass > 0.0, mass, 1.0)[:, None]
    system = (sparse.diags_array(weights[:, 0]) + length**2 * stiffness).tocsr()
    size = np.linalg.norm(weights * values, axis=0)
    size[size == 0.0] = 1.0
    shape, n = values.shape, values.size

    def product(x: FloatArray) -> FloatArray:
        check_cancelled(cancel)
        return np.asarray(system @ x.reshape(shape)).ravel()

    found, failed = cg(
        LinearOperator((n, n), product, dtype=np.float64),
        (weights * values / size).ravel(),
        ((values if start is None else start) / size).ravel(),
        rtol=_TOLERANCE / math.sqrt(shape[1]),  # holds for each function, as all have one norm
        maxiter=_STEPS,
        M=sparse.diags_array(np.repeat(1.0 / system.diagonal(), shape[1])),
    )
    if failed:
        fault = f"Smoothing over {length:g} did not converge in {_STEPS:,} steps"
        remedy = (
            "take a shorter length, or repair the mesh (`meshmash-viewer info` counts its defects)"
        )
        raise InputError("not-solvable", fault, remedy)
    return np.asarray(found.reshape(shape) * size)

"""Spectrum: the eigenpairs computed so far, as displayed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.filter_parameters import count_zeros, hks_time_range
from meshmash_viewer.features.truncation import mean_shares
from meshmash_viewer.spectral.alignment import Alignment, ShownRows, close_neighbours
from meshmash_viewer.units import named_vertex

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.certificate import Certificate

#: Number of values (pairs times vertices) up to which a sum takes negligible time.
_SMALL = 3_000_000


@dataclass(frozen=True)
class Multiplet:
    """Eigenvalues equal to a relative gap: any orthogonal combination is an eigenfunction too."""

    first: int
    last: int
    gap: float


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """The eigenpairs computed so far; a longer spectrum replaces it as the computation continues.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        Ascending, in inverse squared length units.
    rows : ndarray or ShownRows, shape (>= k, n)
        Eigenvectors, one a row, for features; may be a read-only map of the store. NaN at
        unreferenced vertices.
    residuals : ndarray of float64, shape (k,)
        Relative residuals ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``.
    total : int
        Number of pairs requested; 0 while unknown.
    certificate : Certificate, optional
        Certificate of the exact pairs; None until the computation has ended.
    preview : bool
        Whether some pairs are approximations that will be replaced.
    operator : OperatorOptions, optional
        Parameters of the Laplacian.
    n_exact : int
        With `preview`: number of leading pairs that are exact.
    error : float
        Expected relative error of approximate eigenvalues.
    stored : StoredRows, optional
        File of the exact rows, with checksums that have not been verified yet.
    shown : ShownRows, optional
        The rows as drawn, if they differ from `rows` by signs and rotations.
    known_to : float
        Eigenvalue up to which these are complete; 0 if no threshold was requested.
    mass : ndarray of float64, shape (n,), optional
        Diagonal of the mass matrix; see `vertex_areas`.
    mesh : Mesh, optional
        The surface, in its present unit.
    """

    eigenvalues: npt.NDArray[np.float64]
    rows: npt.NDArray[np.floating] | ShownRows
    residuals: npt.NDArray[np.float64]
    total: int = 0
    certificate: Certificate | None = None
    preview: bool = False
    operator: OperatorOptions | None = None
    n_exact: int = 0
    error: float = 0.0
    shown: ShownRows | None = None
    known_to: float = 0.0
    stored: Any = None
    mass: npt.NDArray[np.float64] | None = field(default=None, repr=False)
    mesh: Mesh | None = field(default=None, repr=False)

    @classmethod
    def without_pairs(cls, mesh: Mesh) -> Eigenpairs:
        """Create the spectrum of a mesh that has not been decomposed."""
        none = np.empty(0)
        return cls(none, np.empty((0, mesh.n_vertices)), none, mesh=mesh)

    def __len__(self) -> int:
        return len(self.eigenvalues)

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

    @property
    def complete(self) -> bool:
        """Whether the computation has ended with a complete certificate."""
        return self.certificate is not None and self.certificate.complete

    @property
    def small(self) -> bool:
        """Whether sums over its pairs are fast without a table."""
        return self.rows.size <= _SMALL

    @property
    def shown_rows(self) -> npt.NDArray[np.floating] | ShownRows:
        """The rows as drawn and plotted, shape (>= k, n)."""
        return self.rows if self.shown is None else self.shown

    @property
    def vertex_areas(self) -> npt.NDArray[np.float64]:
        """Area of each vertex, shape (n,): `mass`, or until a computation has ended that of faces.

        The robust Laplacian distributes area slightly differently between neighbours.
        """
        if self.mass is not None and len(self.mass):
            return self.mass
        assert self.mesh is not None
        return self.mesh.vertex_areas

    @cached_property
    def n_vertices(self) -> int:
        """Number of vertices of the surface, which is its total number of pairs."""
        return int(np.count_nonzero(~np.isnan(self.rows[0]))) if len(self) else 0

    @cached_property
    def time_range(self) -> tuple[float, float]:
        """Shortest and longest HKS time resolved by these pairs.

        In squared length units; (1, 10) if all eigenvalues are zero within rounding.
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

    def first(self, count: int) -> Eigenpairs:
        """Return the spectrum of the lowest pairs alone."""
        return replace(
            self,
            eigenvalues=self.eigenvalues[:count],
            residuals=self.residuals[:count],
            total=count,
        )

    def is_exact(self, index: int) -> bool:
        """Whether a pair is exact, not an approximation."""
        return not self.preview or index < self.n_exact

    @property
    def exact(self) -> Eigenpairs:
        """The exact pairs; all of them without a preview."""
        if not self.preview:
            return self
        return replace(self.first(self.n_exact), total=self.total, preview=False, n_exact=0)

    def before(self, preview: Eigenpairs) -> Eigenpairs:
        """Append the pairs of a preview beyond these."""
        assert not isinstance(self.rows, ShownRows)
        assert not isinstance(preview.rows, ShownRows)
        count, rest = len(self), preview.eigenvalues[len(self) :]
        alignment = Alignment() if self.shown is None else self.shown.alignment
        return replace(
            self,
            eigenvalues=np.maximum.accumulate(np.concatenate([self.eigenvalues, rest])),
            rows=ShownRows(self.rows, count, preview.rows, alignment),
            residuals=np.concatenate([self.residuals, np.full(len(rest), np.nan)]),
            preview=True,
            n_exact=count,
            error=preview.error,
            shown=None,
        )

    def multiplet(self, index: int, gap: float = 1e-6) -> Multiplet | None:
        """Return the multiplet that contains an index, by relative gaps, or None."""
        values = self.eigenvalues
        if not 0 <= index < len(values):
            return None
        close = close_neighbours(values, gap)
        first = last = index
        while first > 0 and close[first - 1]:
            first -= 1
        while last < len(close) and close[last]:
            last += 1
        return None if first == last else Multiplet(first, last, gap)


def first_nonzero(spectrum: Eigenpairs) -> int:
    """Return the index of the first nonzero eigenvalue (within rounding), or their number.

    Without one, times and bands cannot be chosen.
    """
    return count_zeros(spectrum.eigenvalues)


def grew(old: Eigenpairs, new: Eigenpairs) -> bool:
    """Whether a spectrum is the same as another one, or an extension of it."""
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
    """Whether two spectra have the same pairs; their certificates may differ."""
    return len(old) == len(new) and grew(old, new)

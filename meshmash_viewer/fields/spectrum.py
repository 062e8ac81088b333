"""The eigenpairs known so far, as the views read them."""

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

#: Numbers read (pairs times vertices) by a sum that nobody feels.
_SMALL = 3_000_000


@dataclass(frozen=True)
class Multiplet:
    """Neighbouring eigenvalues that agree to a relative gap: any rotation of them is as good."""

    first: int
    last: int
    gap: float


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenpairs that have converged so far; a longer one replaces it as the solve goes on.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        Ascending, in inverse squared length units.
    rows : ndarray or ShownRows, shape (>= k, n)
        Eigenvectors, one a row; a read-only map of the store, for features. NaN at unreferenced
        vertices.
    residuals : ndarray of float64, shape (k,)
        Relative residuals ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``.
    total : int
        Number of pairs that the solve owes; 0 while unknown.
    certificate : Certificate, optional
        What proves them; None until the solve has ended. Approximate ones may go on from there.
    preview : bool
        Whether some are coarse approximations that exact ones will replace.
    operator : OperatorOptions, optional
        The Laplacian that these belong to.
    n_exact : int
        With `preview`: number of leading pairs that are exact already.
    error : float
        Expected relative error of approximate eigenvalues.
    stored : StoredRows, optional
        Where the exact rows are, with their checksums if they have not been compared with them:
        for whoever checks them, as fields know no files.
    shown : ShownRows, optional
        The rows as they are drawn, where that differs from `rows` by signs and rotations.
    known_to : float
        Eigenvalue up to which these are proven to be all; 0 where no threshold was asked for.
    mass : ndarray of float64, shape (n,), optional
        The areas that they are orthonormal with; see `vertex_areas`.
    mesh : Mesh, optional
        The surface that they belong to, in the unit that it is said to be in.
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
    def without_pairs(cls, mesh: Mesh) -> Spectrum:
        """What is known of a mesh before it has been decomposed."""
        none = np.empty(0)
        return cls(none, np.empty((0, mesh.n_vertices)), none, mesh=mesh)

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def file_index(self, vertex: int) -> int:
        """What a vertex is called: its index in the file of the mesh, see `Mesh.file_index`."""
        return vertex if self.mesh is None else self.mesh.file_index(vertex)

    def named_vertex(self, vertex: int) -> str:
        """Which vertex one is: "vertex 22,351"."""
        return named_vertex(self.file_index(vertex))

    def vertex_script(self, vertex: int) -> str:
        """The expression of a script for a vertex of its ``mesh``."""
        if self.mesh is None or self.mesh.numbering is None:
            return str(vertex)
        return f"mesh.vertex_of({self.file_index(vertex)})"

    @property
    def complete(self) -> bool:
        """Whether the solve has ended and its certificate proves the pairs."""
        return self.certificate is not None and self.certificate.complete

    @property
    def small(self) -> bool:
        """Whether a sum over its pairs is there at once, without a table."""
        return self.rows.size <= _SMALL

    @property
    def shown_rows(self) -> npt.NDArray[np.floating] | ShownRows:
        """The rows as they are drawn and plotted, shape (>= k, n)."""
        return self.rows if self.shown is None else self.shown

    @property
    def vertex_areas(self) -> npt.NDArray[np.float64]:
        """Area of each vertex, shape (n,): `mass`, or before a solve has ended that of the faces.

        The robust Laplacian shares it out a little differently between neighbours.
        """
        if self.mass is not None and len(self.mass):
            return self.mass
        assert self.mesh is not None
        return self.mesh.vertex_areas

    @cached_property
    def n_vertices(self) -> int:
        """Number of vertices of the surface, and of pairs that it has in all."""
        return int(np.count_nonzero(~np.isnan(self.rows[0]))) if len(self) else 0

    @cached_property
    def time_range(self) -> tuple[float, float]:
        """Shortest and longest HKS time that these pairs say something about.

        In squared length units; (1, 10) without an eigenvalue that is more than rounding.
        """
        values = self.eigenvalues
        if not len(values) or not values[-1] > 1e-9 * max(abs(float(values[0])), 1e-300):
            return 1.0, 10.0
        t_min, t_max = hks_time_range(values)
        return float(t_min), float(t_max)

    def missing_shares(self, bank: FilterBank, area: float) -> npt.NDArray[np.float64]:
        """Estimate what is missing of each column for want of eigenpairs, shape (f,)."""
        known_to = self.known_to or None
        return mean_shares(bank, self.eigenvalues, area, self.n_vertices, known_to)

    def first(self, count: int) -> Spectrum:
        """The lowest pairs of it alone."""
        return replace(
            self,
            eigenvalues=self.eigenvalues[:count],
            residuals=self.residuals[:count],
            total=count,
        )

    def is_exact(self, index: int) -> bool:
        """Whether a pair is final, not an approximation."""
        return not self.preview or index < self.n_exact

    @property
    def exact(self) -> Spectrum:
        """The pairs that are final; all of them without a preview."""
        if not self.preview:
            return self
        return replace(self.first(self.n_exact), total=self.total, preview=False, n_exact=0)

    def before(self, preview: Spectrum) -> Spectrum:
        """These pairs, then those of a preview that go on from them."""
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
        """The run of near-equal eigenvalues that an index belongs to, by relative gaps, or None."""
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


def first_nonzero(spectrum: Spectrum) -> int:
    """Index of the first eigenvalue that is more than rounding; their number if there is none.

    Without one there is no scale to take times or bands from.
    """
    return count_zeros(spectrum.eigenvalues)


def grew(old: Spectrum, new: Spectrum) -> bool:
    """Whether one spectrum is the other, be it before it grew."""
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


def same_pairs(old: Spectrum, new: Spectrum) -> bool:
    """Whether two spectra have the same pairs, be it that their proof has come since."""
    return len(old) == len(new) and grew(old, new)

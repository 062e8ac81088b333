"""Reduction of the pencil L φ = λ M φ to one symmetric matrix in natural units.

The reduced matrix is ``A = M^-1/2 L M^-1/2 / unit`` on the vertices with mass, where
``unit`` is the power of two next to Weyl's spacing 4π / area. Eigenvalue i of the reduced matrix is
then about i, for any unit of the mesh, so tolerances in the engine do not depend on that unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, wrong_shape, wrong_type

_EPSILON = float(np.finfo(np.float64).eps)
#: Allowed asymmetry relative to the diagonal entries of row and column.
_ASYMMETRY = 1e-9


@dataclass(frozen=True, eq=False)
class Pencil:
    """The reduced eigenproblem ``A y = θ y`` with ``λ = unit θ`` and ``φ = root_mass^-1 y``."""

    #: Shape (n, n): Symmetric positive semidefinite ``A``, sorted indices.
    matrix: Any
    #: Shape (n,): Square roots of the masses of the active vertices.
    root_mass: FloatArray
    #: Eigenvalue that is 1 in the reduced problem; a power of two.
    unit: float
    #: Shape (n,): Indices of the active vertices among all.
    active: npt.NDArray[np.int64]
    #: Number of rows of L, vertices without mass included.
    n_all: int
    #: Shape (n,): Component of each active vertex if its constant is a null vector, else -1.
    labels: npt.NDArray[np.int64]
    #: Shape (n_null,): ``‖Lφ‖ / ‖Mφ‖`` of the constants in the null space, in the reduced unit.
    null_residuals: FloatArray

    @property
    def n_null(self) -> int:
        """Dimension of the null space, which is known exactly."""
        return len(self.null_residuals)

    @property
    def n(self) -> int:
        """Number of active vertices."""
        return len(self.active)

    @cached_property
    def magnitudes(self) -> Any:
        """Absolute values of the entries of the reduced matrix, shape (n, n)."""
        return abs(self.matrix)

    @cached_property
    def norm(self) -> float:
        """Upper bound of the largest eigenvalue of the reduced matrix (Gershgorin)."""
        return float(self.magnitudes.sum(axis=0).max())

    @cached_property
    def noise(self) -> float:
        """Possible rounding error of an eigenvalue of the reduced matrix."""
        return 2.0 * _EPSILON * self.norm

    @cached_property
    def null_direction(self) -> FloatArray:
        """Entry of each vertex in the unit null vector of its component, 0 without one, (n,)."""
        used = self.labels >= 0
        labels, root_mass = self.labels[used], self.root_mass[used]
        direction = np.zeros(self.n)
        direction[used] = root_mass / np.sqrt(np.bincount(labels, root_mass**2))[labels]
        return direction

    def permuted(self, order: npt.NDArray[np.int64]) -> Pencil:
        """Return the problem with vertex `order[i]` at index i."""
        matrix: Any = self.matrix[order][:, order]
        matrix = sp.csc_array(matrix)
        matrix.sort_indices()
        return replace(
            self,
            matrix=matrix,
            root_mass=self.root_mass[order],
            active=self.active[order],
            labels=self.labels[order],
        )

    def null_rows(self, count: int) -> FloatArray:
        """Return orthonormal null vectors of the reduced matrix, at most `count`, (count, n)."""
        count = min(count, self.n_null)
        rows = np.zeros((count, self.n))
        used = np.flatnonzero((self.labels >= 0) & (self.labels < count))
        rows[self.labels[used], used] = self.null_direction[used]
        return rows

    def remove_null(self, column: FloatArray) -> None:
        """Project the null space out of a column, shape (n,), in place."""
        # Vertices outside of null components have direction 0 and label -1.
        labels, direction = self.labels + 1, self.null_direction
        column -= direction * np.bincount(labels, direction * column)[labels]


def reduce_pencil(stiffness: Any, mass: Any) -> Pencil:
    """Reduce (L, M) to the symmetric problem on the vertices with mass.

    M may be given as its diagonal. `InputError` is raised if the shapes differ, an entry is not
    finite, M is not diagonal or negative, L is not symmetric, or a vertex without mass has entries
    in L.
    """
    laplacian: Any = _real_matrix(stiffness)
    n_all = laplacian.shape[0]
    if laplacian.shape != (n_all, n_all):
        raise wrong_shape("Rows and columns of the Laplacian", laplacian.shape, "a square matrix")
    diagonal = mass_diagonal(mass, n_all)
    bad = np.flatnonzero(~np.isfinite(laplacian.data))
    if len(bad):
        row = int(np.searchsorted(laplacian.indptr, bad[0], side="right")) - 1
        fault = f"The Laplacian has an entry that is not finite at vertex {row}"
        raise InputError("not-finite", fault, "use robust=True, as for degenerate faces")
    laplacian.sum_duplicates()
    laplacian = _symmetric(laplacian)
    _refuse_negative_diagonal(laplacian)

    used = diagonal > 0.0
    tied = np.flatnonzero(~used & (np.diff(laplacian.indptr) > 0))
    if len(tied):
        fault = f"{len(tied)} vertices have faces but no area (first: {tied[:3].tolist()})"
        raise InputError("no-area", fault, "use robust=True, or drop degenerate faces")
    active = np.flatnonzero(used)
    if len(active) == 0:
        raise InputError("no-area", "The mass matrix is zero", "give a mesh with a face with area")
    if len(active) < n_all:
        laplacian = sp.csr_array(laplacian[active][:, active])
    laplacian = _with_whole_diagonal(laplacian)
    masses = diagonal[active]
    root_mass = np.sqrt(masses)
    # Scaling the mesh by a power of two leaves the reduced problem unchanged bit by bit.
    largest = float(masses.max())
    log_area = np.log2(largest) + np.log2((masses / largest).sum())
    # The entries are exactly symmetric, so that rows equal columns.
    with np.errstate(all="ignore"):
        unit = float(np.exp2(np.round(np.log2(4.0 * np.pi) - log_area)))
        inverse = 1.0 / root_mass
        both = np.repeat(inverse, np.diff(laplacian.indptr)) * inverse[laplacian.indices]
        entries = laplacian.data * both / unit
    if not (np.isfinite(entries).all() and 0.0 < unit < np.inf):
        raise InputError(
            "beyond-floating-point",
            f"Entries of the Laplacian up to {abs(laplacian.data).max():.3g} and masses from"
            f" {masses.min():.3g} to {masses.max():.3g} exceed the range of floating-point numbers",
            "scale the mesh, or drop the vertices without area",
        )
    matrix: Any = sp.csc_array((entries, laplacian.indices, laplacian.indptr), laplacian.shape)
    matrix.sort_indices()
    labels, null_residuals = _null_space(laplacian, masses, unit)
    return Pencil(matrix, root_mass, unit, active, n_all, labels, null_residuals)


def _symmetric(laplacian: Any) -> Any:
    """Return L exactly symmetric and without stored zeros, shape (n, n)."""
    strength = np.abs(laplacian.diagonal())
    across = sp.coo_array(abs(laplacian - laplacian.T))
    allowed = _ASYMMETRY * np.sqrt(strength[across.row]) * np.sqrt(strength[across.col])
    wrong = np.flatnonzero(across.data > allowed)
    if len(wrong):
        i, j = int(across.row[wrong[0]]), int(across.col[wrong[0]])
        difference = f"vertices {i} and {j} differ by {across.data[wrong[0]]:.3g}"
        raise InputError("not-symmetric", f"The Laplacian is not symmetric, {difference}")
    if across.nnz:
        laplacian = sp.csr_array((laplacian + laplacian.T) * 0.5)
    laplacian.eliminate_zeros()
    return laplacian


def _with_whole_diagonal(laplacian: Any) -> Any:
    """Return L with every diagonal entry stored, since every vertex needs a pivot."""
    n = laplacian.shape[0]
    stored = np.repeat(np.arange(n), np.diff(laplacian.indptr)) == laplacian.indices
    if np.count_nonzero(stored) == n:
        return laplacian
    entries, every = sp.coo_array(laplacian), np.arange(n)
    rows, columns = np.append(entries.row, every), np.append(entries.col, every)
    data = np.append(entries.data, np.zeros(n))
    return sp.csr_array((data, (rows, columns)), shape=(n, n))


def _refuse_negative_diagonal(laplacian: Any) -> None:
    diagonal = laplacian.diagonal()
    size = np.asarray(abs(laplacian).sum(axis=1)).ravel()
    negative = np.flatnonzero(diagonal < -_EPSILON * size)
    if len(negative):
        fault = f"The diagonal of the Laplacian is negative at vertex {negative[0]}"
        raise InputError("not-semidefinite", fault, "give -L, if it is of the other sign")


def indefinite(negative: str) -> InputError:
    """Return the fault of a Laplacian with some negative eigenvalues."""
    fault = f"The Laplacian has negative eigenvalues, {negative}"
    return InputError("not-semidefinite", fault, "give a positive semidefinite matrix")


def _null_space(
    laplacian: Any, masses: FloatArray, unit: float
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Find components whose constant is a null vector: labels, shape (n,), and residuals.

    Each row sum is compared with the rounding of that row, so that a stiff edge elsewhere does not
    hide a nonzero sum.
    """
    _, component = connected_components(laplacian, directed=False)
    # In extended precision if the platform has it: a sum of 0 in float64 may be due to rounding.
    sums = np.asarray(laplacian.astype(np.longdouble).sum(axis=1), dtype=np.float64).ravel()
    size = np.asarray(abs(laplacian).sum(axis=1)).ravel()
    rounding = 2.0 * _EPSILON * np.diff(laplacian.indptr) * size
    loose = np.bincount(component, weights=np.abs(sums) > rounding)
    # Scaled by the largest, so that squares neither overflow nor underflow.
    largest_sum, largest_mass = max(float(np.abs(sums).max()), 1e-300), float(masses.max())
    forces = np.bincount(component, weights=(sums / largest_sum) ** 2)
    weights = np.bincount(component, weights=(masses / largest_mass) ** 2)
    is_null = loose == 0
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        residuals = np.sqrt(forces / weights)[is_null] * (largest_sum / largest_mass / unit)
    numbers = np.where(is_null, np.cumsum(is_null) - 1, -1)
    return numbers[component].astype(np.int64), residuals


def _real_matrix(stiffness: Any) -> Any:
    """Return a float64 copy of L in csr format, shape (n, n)."""
    if not sp.issparse(stiffness) and np.ndim(stiffness) != 2:
        raise wrong_shape("Entries of the Laplacian", np.shape(stiffness), "a matrix, shape (n, n)")
    laplacian: Any = sp.csr_array(stiffness)
    if laplacian.dtype.kind not in "biuf":
        raise wrong_type("Entries of the Laplacian", laplacian.dtype, "real numbers")
    return laplacian.astype(np.float64)


def mass_diagonal(mass: Any, n: int) -> FloatArray:
    """Return the diagonal of a mass matrix given as matrix or as vector, shape (n,)."""
    if sp.issparse(mass) or np.ndim(mass) == 2:
        rest: Any = sp.coo_array(mass)
        diagonal = np.asarray(rest.diagonal(), dtype=np.float64)
        if rest.shape == (n, n) and np.any(rest.data[rest.row != rest.col] != 0.0):
            remedy = "give the lumped mass matrix (`area_matrix`)"
            raise InputError("not-diagonal", "The mass matrix is not diagonal", remedy)
    else:
        diagonal = np.asarray(mass, dtype=np.float64)
    if np.shape(mass) not in ((n, n), (n,)):
        wanted = f"({n}, {n}), or its diagonal"
        raise wrong_shape("Entries of the mass matrix", np.shape(mass), wanted)
    if not np.isfinite(diagonal).all() or diagonal.min(initial=0.0) < 0.0:
        raise InputError("not-finite", "An entry of the mass matrix is negative or not finite")
    return diagonal

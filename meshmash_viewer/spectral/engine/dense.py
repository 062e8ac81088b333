"""All eigenpairs of a small pencil, from dense matrices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.spectral.engine.pencil import Pencil


class DenseSpectrum:
    """All pairs of a small pencil; `values`, shape (n,), begin with the zeros of the null space.

    Components are solved one by one, since one may be a million times as stiff as another. `check`
    is called before each; `InputError` is raised if an eigenvalue is negative by more than
    rounding.
    """

    def __init__(self, pencil: Pencil, check: Callable[[], None]) -> None:
        self._pencil = pencil
        count, component = connected_components(pencil.matrix, directed=False)
        places = np.split(
            np.argsort(component, kind="stable"),
            np.cumsum(np.bincount(component, minlength=count))[:-1],
        )
        values, columns, rows, starts = [np.zeros(0)], [np.zeros(0)], [np.zeros(0, int)], [0]
        for place in places:
            is_null = pencil.labels[place[0]] >= 0
            if is_null and len(place) == 1:
                continue
            check()
            matrix = pencil.matrix[place][:, place].toarray()
            constant = pencil.null_direction[place] if is_null else None
            found, vectors = component_pairs(matrix, constant)
            kept = len(found)
            values.append(found)
            columns.append(vectors.T.ravel())
            rows.append(np.tile(place, kept))
            starts.extend(starts[-1] + len(place) * np.arange(1, kept + 1))
        every = np.concatenate(values)
        order = np.argsort(every, kind="stable")
        parts = (np.concatenate(columns), np.concatenate(rows), np.array(starts))
        self._columns = sparse.csc_array(parts, shape=(pencil.n, len(every)))[:, order]
        lowest = float(every.min(initial=0.0))
        if lowest < -max(1e-6, 1e-9 * pencil.norm):
            raise InputError(
                f"The Laplacian has a negative eigenvalue, {lowest * pencil.unit:.4g}: it must "
                "be positive semidefinite, as that of every mesh is."
            )
        self.values: FloatArray = np.concatenate([np.zeros(pencil.n_null), every[order]])

    def rows(self, chosen: npt.NDArray[np.intp]) -> FloatArray:
        """Return the eigenvectors of ascending indices, shape (k, n)."""
        n_null = self._pencil.n_null
        null, rest = chosen[chosen < n_null], chosen[chosen >= n_null]
        constants = self._pencil.null_rows(len(null) and int(null[-1]) + 1)[null]
        return np.concatenate([constants, self._columns[:, rest - n_null].toarray().T])


def component_pairs(
    matrix: FloatArray, constant: FloatArray | None, highest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Compute all pairs of a component's matrix, (c, c), or those up to `highest`, ascending.

    `constant` is its null vector if that is known; it is left out.
    """
    from scipy.linalg import eigh

    if constant is not None:
        # Shifted above all other eigenvalues, the constant does not mix with the lowest ones.
        lift = 1.1 * np.abs(matrix).sum(axis=0).max()
        matrix = matrix + lift * np.outer(constant, constant)
    if highest is not None:
        values, vectors = eigh(matrix, subset_by_value=(-np.inf, highest))
        kept = len(values) - int(constant is not None and len(values) == len(matrix))
        return values[:kept], vectors[:, :kept]
    values, vectors = eigh(matrix, driver="evd")
    kept = len(matrix) - int(constant is not None)
    return values[:kept], vectors[:, :kept]


def dense_residuals(pencil: Pencil, values: FloatArray, rows: FloatArray) -> FloatArray:
    """Compute residuals ``‖Lφ - λMφ‖ / ‖Mφ‖`` in the reduced unit, shape (p,)."""
    weight = pencil.root_mass
    # In extended precision, where the platform has it, to measure less rounding.
    image = (pencil.matrix.astype(np.longdouble) @ rows.T.astype(np.longdouble)).T
    defect = np.asarray(image - values[:, None] * rows, dtype=np.float64) * weight
    sizes = np.linalg.norm(rows * weight, axis=1)
    return np.asarray(np.linalg.norm(defect, axis=1) / sizes)

"""All eigenpairs of a small pencil, from dense matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.spectral.engine.pencil import Pencil

FloatArray = npt.NDArray[np.float64]


def dense_pairs(pencil: Pencil, check: Callable[[], None]) -> tuple[FloatArray, Any]:
    """Compute all pairs beyond the known null space: ascending values (r,) and sparse columns.

    Components are solved one by one, since one may be a million times as stiff as another.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components

    count, component = connected_components(pencil.matrix, directed=False)
    places = np.split(
        np.argsort(component, kind="stable"),
        np.cumsum(np.bincount(component, minlength=count))[:-1],
    )
    values, columns, rows, starts = [], [], [], [0]
    for place in places:
        is_null = pencil.labels[place[0]] >= 0
        if is_null and len(place) == 1:
            continue
        check()
        matrix = pencil.matrix[place][:, place].toarray()
        found, vectors = component_pairs(matrix, pencil.null_direction[place] if is_null else None)
        kept = len(found)
        values.append(found)
        columns.append(vectors.T.ravel())
        rows.append(np.tile(place, kept))
        starts.extend(starts[-1] + len(place) * np.arange(1, kept + 1))
    if not values:
        return np.zeros(0), sparse.csc_array((pencil.n, 0))
    every = np.concatenate(values)
    parts = (np.concatenate(columns), np.concatenate(rows), np.array(starts))
    matrix = sparse.csc_array(parts, shape=(pencil.n, len(every)))
    order = np.argsort(every, kind="stable")
    return every[order], matrix[:, order]


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

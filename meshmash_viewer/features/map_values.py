"""Checks of maps, functions on a surface, and treatment of their missing values."""

from __future__ import annotations

import warnings
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, MissingValuesWarning
from meshmash_viewer.vertex_map import VertexMap

FloatArray: TypeAlias = npt.NDArray[np.float64]


def as_map_values(given: Any, n: int, *, columns: bool = True) -> FloatArray:
    """Convert a map in any of the accepted forms to an array.

    Parameters
    ----------
    given : VertexMap or array_like, shape (n,) or (n, d)
    n : int
        Number of vertices.
    columns : bool
        Whether there may be more than one map.

    Raises
    ------
    InputError
        If the shape differs, or values are labels or not real numbers.
    """
    wanted = f"shape ({n},)" + (f" or ({n}, d)" if columns else "")
    if isinstance(given, VertexMap):
        if given.labels:
            raise InputError(
                f"Map {given.name!r} has labels, whose numbers are names: no function."
            )
        given = given.values
    if hasattr(given, "tocsr") or callable(given):
        raise InputError(
            f"A map is an array of one number a vertex, {wanted}, not of type "
            f"{type(given).__name__}: check the order of the arguments."
        )
    try:
        array = np.asarray(given)
        if array.dtype.kind not in "biufO":
            raise TypeError
        values = array.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(f"A map has one real number a vertex: {wanted}.") from None
    if values.ndim not in ((1, 2) if columns else (1,)) or len(values) != n:
        raise InputError(f"A map has one number a vertex: {wanted}, not {values.shape}.")
    return values


def check_decomposition(given: Any, call: str) -> None:
    """Raise `InputError` if `given` is not a decomposition; `call` is the correct call."""
    if not (hasattr(given, "eigenvalues") and hasattr(given, "rows")):
        raise InputError(
            f"The eigenpairs come first, as {call}: the first argument is of type "
            f"{type(given).__name__}, not what solve returns."
        )
    if len(given.mass) != given.rows.shape[1]:
        raise InputError(
            f"The eigenpairs have {given.rows.shape[1]} vertices, and areas of {len(given.mass)}: "
            "give what solve returns, or a Decomposition with the diagonal of M as its mass."
        )


def filled(values: FloatArray, mass: FloatArray) -> FloatArray:
    """Replace missing values by the mean of the others.

    Parameters
    ----------
    values : ndarray of float64, shape (n,) or (n, d)
        NaN or infinite where missing. Each column has its own area-weighted mean, 0 if all its
        values are missing.
    mass : ndarray of float64, shape (n,)
        Areas of the vertices; the result is 0 where they are 0.

    Returns
    -------
    ndarray of float64, shape (n,) or (n, d)
    """
    used = mass > 0.0
    known_at = np.isfinite(values) & (used if values.ndim == 1 else used[:, np.newaxis])
    known = np.where(known_at, values, 0.0)
    if known_at[used].all():
        return known
    weight = np.where(used, mass, 0.0) @ known_at
    total = np.where(used, mass, 0.0) @ known
    mean = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)
    result: FloatArray = np.where(known_at, known, mean)
    result[~used] = 0.0
    return result


def without_gaps(values: FloatArray, mass: FloatArray, stacklevel: int = 3) -> FloatArray:
    """Replace missing values as `filled`, with a warning.

    Raises
    ------
    InputError
        If a map has no finite value.
    """
    used = mass > 0.0
    finite = np.isfinite(values[used])
    if finite.all():
        return filled(values, mass)
    if not finite.any(axis=0).all():
        raise InputError("The map has no finite value at any vertex of the surface.")
    gaps = int((~(finite if finite.ndim == 1 else finite.all(axis=1))).sum())
    warnings.warn(
        f"{gaps:,} of {int(used.sum()):,} vertices of the surface have no finite value in the map: "
        "they have no weight, the mean of the others over the area stands for them.",
        MissingValuesWarning,
        stacklevel=stacklevel,
    )
    return filled(values, mass)

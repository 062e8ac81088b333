"""Spectral and geodesic distances from one vertex to all others.

Spectral distances are ``d(v, w)² = Σ_k h(λ_k) (φ_k(v) - φ_k(w))²`` over the eigenvalues above zero,
with a weight h for each kind. They grow with the distance along the surface, but also depend on its
width: across a thin neck they are large. Eigenfunctions of eigenvalue zero only distinguish
components, so they are left out, and the distance to vertices of other components is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, check_vertex
from meshmash_viewer.errors import InputError, other_mesh, unknown, wrong_shape
from meshmash_viewer.features.filter_responses import (
    ZERO_SHARE,
    as_spectrum,
    first_nonzero_eigenvalue,
)
from meshmash_viewer.features.sums import Features, sum_squares
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, EigenpairsLike, as_eigenpairs
from meshmash_viewer.surface.geodesics import geodesic_distance
from meshmash_viewer.units import check_positive, power_unit

#: Label, and unit as a power of length, of each kind of distance by name.
MEASURES: dict[str, tuple[str, int]] = {
    "geodesic": ("Geodesic", 1),
    "biharmonic": ("Biharmonic", 1),
    "commute": ("Commute time", 0),
    "diffusion": ("Diffusion", -1),
}


def diffusion_distance(
    eigenvalues: npt.ArrayLike, eigenvectors: npt.ArrayLike, vertex: int, time: float
) -> FloatArray:
    """Compute the diffusion distance: the difference of heat from two vertices after a time [1]_.

    `InputError` is raised if the vertex does not exist, the time is not positive, or shapes do not
    agree.

    Parameters
    ----------
    eigenvalues, eigenvectors : array_like, shapes (k,) and (n, k)
        Eigenvalues per squared unit, of which zeros are left out, and M-orthonormal columns.
    vertex : int
        Vertex from which distances are measured.
    time : float
        Diffusion time in squared unit; √time is about the length that is resolved.

    Returns
    -------
    ndarray of float64, shape (n,)
        ``(Σ exp(-2 λ t) (φ(v) - φ(w))²)^½``, per unit; NaN where the eigenvectors are NaN.

    References
    ----------
    .. [1] Coifman, R. R. and Lafon, S. (2006). "Diffusion Maps." Applied and Computational
       Harmonic Analysis 21(1).

    Examples
    --------
    >>> mv.diffusion_distance([0.0, 1.0], [[1.0, 1.0], [1.0, -1.0]], 0, time=0.5).round(3)
    array([0.   , 1.213])
    """
    check_positive(time, "time")
    return _distance("diffusion", eigenvalues, eigenvectors, vertex, time)


def biharmonic_distance(
    eigenvalues: npt.ArrayLike, eigenvectors: npt.ArrayLike, vertex: int
) -> FloatArray:
    """Compute the biharmonic distance: smooth near the vertex, global far from it [1]_.

    For parameters see `diffusion_distance`.

    Returns
    -------
    ndarray of float64, shape (n,)
        ``(Σ (φ(v) - φ(w))² / λ²)^½``, in the unit of the mesh.

    References
    ----------
    .. [1] Lipman, Y., Rustamov, R. M. and Funkhouser, T. A. (2010). "Biharmonic Distance." ACM
       Transactions on Graphics 29(3).

    Examples
    --------
    >>> mv.biharmonic_distance([0.0, 2.0], [[1.0, 1.0], [1.0, -1.0]], 0)
    array([0., 1.])
    """
    return _distance("biharmonic", eigenvalues, eigenvectors, vertex)


def commute_time_distance(
    eigenvalues: npt.ArrayLike, eigenvectors: npt.ArrayLike, vertex: int
) -> FloatArray:
    """Compute the square root of the time of a random walk to another vertex and back [1]_.

    On a surface the sum grows with the logarithm of the number of pairs: compare only distances
    computed from equal numbers of pairs. For parameters see `diffusion_distance`.

    Returns
    -------
    ndarray of float64, shape (n,)
        ``(Σ (φ(v) - φ(w))² / λ)^½``, dimensionless.

    References
    ----------
    .. [1] Qiu, H. and Hancock, E. R. (2007). "Clustering and Embedding Using Commute Times." IEEE
       TPAMI 29(11).

    Examples
    --------
    >>> mv.commute_time_distance([0.0, 4.0], [[1.0, 1.0], [1.0, -1.0]], 0)
    array([0., 1.])
    """
    return _distance("commute", eigenvalues, eigenvectors, vertex)


def spectral_weights(kind: str, eigenvalues: FloatArray, time: float = 1.0) -> FloatArray:
    """Compute the weight of each pair in a squared distance, 0 for zero eigenvalues, shape (k,).

    `kind` is "diffusion", "biharmonic" or "commute"; only "diffusion" uses `time`.
    """
    above = _above_zero(eigenvalues)
    if kind == "diffusion":
        return np.where(above, np.exp(-2.0 * time * eigenvalues), 0.0)
    power = {"biharmonic": -2.0, "commute": -1.0}[kind]
    return np.power(eigenvalues, power, out=np.zeros(len(eigenvalues)), where=above)


def _above_zero(eigenvalues: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray(eigenvalues > ZERO_SHARE * eigenvalues.max(initial=0.0))


def missing_square(kind: str, eigenvalues: FloatArray, area: float, n: int, time: float) -> float:
    """Estimate by Weyl's law the part of a squared distance due to pairs that were not computed.

    For two vertices that are not close, this part is ``Σ h φ(v)² + Σ h φ(w)²`` beyond the last
    eigenvalue Λ. By the local law, each sum is ``1/4π ∫ h dλ`` from Λ to the last of the n
    eigenvalues of the mesh. On average, a sum is at most h(Λ) / area for each missing pair.
    """
    last, end = float(eigenvalues[-1]), 4.0 * math.pi * n / area
    n_left = n - len(eigenvalues)
    if n_left <= 0 or not 0.0 < last < end:
        return 0.0
    integral = {
        "diffusion": (math.exp(-2.0 * last * time) - math.exp(-2.0 * end * time)) / (2.0 * time),
        "biharmonic": 1.0 / last - 1.0 / end,
        "commute": math.log(end / last),
    }[kind]
    highest = n_left * float(spectral_weights(kind, eigenvalues[-1:], time)[0]) / area
    return 2.0 * min(integral / (4.0 * math.pi), highest)


class RowsFrom:
    """Eigenvectors minus their values at one vertex, indexed like an array of shape (k, n)."""

    def __init__(self, rows: Any, vertex: int) -> None:
        self._rows = rows
        self._here = np.asarray(rows[:, vertex], dtype=np.float64)
        self.shape, self.dtype = rows.shape, np.dtype(np.float64)

    def __len__(self) -> int:
        return len(self._here)

    def __getitem__(self, key: Any) -> FloatArray:
        rows, columns = key if isinstance(key, tuple) else (key, slice(None))
        here = self._here[rows]
        read = np.asarray(self._rows[rows, columns], dtype=np.float64)
        below = here[:, np.newaxis] if np.ndim(here) and read.ndim == 2 else here
        return np.asarray(read - below)


def _distance(
    kind: str, eigenvalues: npt.ArrayLike, eigenvectors: Any, vertex: int, time: float = 1.0
) -> FloatArray:
    values = as_spectrum(eigenvalues)
    columns = np.asarray(eigenvectors)
    if columns.ndim != 2 or columns.shape[1] != len(values):
        raise wrong_shape("Eigenvectors", columns.shape, f"{len(values)} columns")
    check_vertex(vertex, len(columns))
    rows: Any = RowsFrom(columns.T, vertex)
    weights = spectral_weights(kind, values, time)
    squares = np.asarray(sum_squares(rows, weights[np.newaxis], np.float64)[0])
    # zero: eigenfunctions are constant on each component and different between components
    zero = ~_above_zero(values)
    elsewhere = np.square(rows[zero]).sum(axis=0) > 1e-6 * np.square(columns[:, zero]).sum(axis=1)
    squares[elsewhere] = np.nan
    return np.asarray(np.sqrt(squares, out=squares))


def check_vertices(mesh: Mesh, vertices: npt.ArrayLike) -> None:
    """Raise `InputError` for vertices that do not exist or belong to no face."""
    for vertex in np.atleast_1d(np.asarray(vertices)).tolist():
        check_vertex(vertex, mesh.n_vertices)
        if not mesh.referenced[vertex]:
            fault = f"Vertex {mesh.file_index(vertex)} belongs to no face, so it has no distance"
            raise InputError("vertex-unused", fault, "choose another")


def distance_columns(measure: str, vertices: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the columns of `distance_features`."""
    return tuple(f"{measure}_from_{vertex}" for vertex in vertices)


def distance_features(
    mesh: MeshLike,
    vertices: npt.ArrayLike,
    measure: str = "geodesic",
    decomposition: EigenpairsLike | None = None,
    time: float | None = None,
) -> Features:
    """Compute distances from some vertices, a column for each.

    `InputError` is raised if a vertex does not exist, belongs to no face or is given twice, or if
    the measure needs eigenpairs or a time that are not given.

    Parameters
    ----------
    vertices : int or array_like of int, shape (f,)
        Vertices from which distances are measured.
    measure : {"geodesic", "biharmonic", "commute", "diffusion"}
    decomposition : Eigenpairs, optional
        Eigenpairs of the mesh, required except for the geodesic distance.
    time : float, optional
        Diffusion time, in squared unit.

    Returns
    -------
    Features
        Values of shape (n, f), NaN in other components. Columns are named by the indices of the
        vertices in the file, see `Mesh.file_index`; ``meta["missing_shares"]`` is the share
        of a typical distance due to pairs that were not computed, estimated by Weyl's law.

    Examples
    --------
    >>> both = mv.distance_features(ball, [0, 1], "biharmonic", pairs)
    >>> both.values.shape, float(both.values[0, 0])
    ((642, 2), 0.0)
    """
    surface = as_mesh(mesh)
    chosen = [int(vertex) for vertex in np.atleast_1d(np.asarray(vertices))]
    if measure not in MEASURES:
        raise unknown("distance", measure, MEASURES)
    if not chosen or len(set(chosen)) < len(chosen):
        raise InputError("no-vertices", "Distances need vertices", "give one or more, each once")
    check_vertices(surface, chosen)
    named = [surface.file_index(vertex) for vertex in chosen]
    meta: dict[str, Any] = {"measure": measure, "vertices": named}
    if measure == "geodesic":
        values = geodesic_distance(surface, chosen)
    else:
        if decomposition is None:
            raise InputError("no-eigenpairs", f"The {measure} distance needs pairs", "give pairs")
        if measure == "diffusion":
            check_positive(time, "time")
            meta |= {"time": time, "time_unit": power_unit(surface.unit, 2)}
        call = "distance_features(mesh, vertices, measure, pairs)"
        decomposition = as_eigenpairs(call, decomposition, surface)
        values = _from_pairs(surface, chosen, measure, decomposition, time or 1.0)
        meta["n_eigenpairs"] = len(decomposition.eigenvalues)
        n, weights = np.count_nonzero(surface.referenced), decomposition.eigenvalues
        left = missing_square(measure, weights, surface.area, int(n), time or 1.0)
        typical = np.nanmedian(values, axis=0)
        shares = 1.0 - typical / np.sqrt(np.maximum(typical**2 + left, 1e-300))
        meta["missing_shares"] = shares.tolist()
    power = MEASURES[measure][1]
    unit = power_unit(surface.unit, power) if power else ""
    return Features(values, distance_columns(measure, named), unit, "distance", meta)


def _from_pairs(
    mesh: Mesh, vertices: list[int], measure: str, pairs: Eigenpairs, time: float
) -> FloatArray:
    if len(pairs.eigenvectors) != mesh.n_vertices:
        raise other_mesh("Eigenvectors", len(pairs.eigenvectors), mesh.n_vertices)
    first_nonzero_eigenvalue(pairs.eigenvalues)
    values = np.empty((mesh.n_vertices, len(vertices)), order="F")
    labels = mesh.component_labels
    for column, vertex in enumerate(vertices):
        found = _distance(measure, pairs.eigenvalues, pairs.eigenvectors, vertex, time)
        values[:, column] = np.where(labels == labels[vertex], found, np.nan)
    return values

"""Resolution: the error of eigenvalues that is due to the size of the triangles.

A `Certificate` compares eigenpairs with those of the matrices. The functions here compare the
eigenvalues with those of the surface itself: the same triangles, divided without end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError, other_mesh
from meshmash_viewer.features.filter_responses import count_zeros
from meshmash_viewer.laplacian import OperatorOptions, SparseMatrix, cotangent_laplacian
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, ProgressCallback, check_cancelled
from meshmash_viewer.spectral.cost import check_memory, free_memory
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.surface.edges import side_codes

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigenpairs import Eigenpairs, EigenpairsLike

#: Estimated error from which the mesh is divided a second time.
_LARGE = 0.25
#: Largest relative difference of Rayleigh quotients and eigenvalues of the same matrices.
_SAME = 1e-3
#: Number of pairs whose Rayleigh quotients are compared.
_COMPARED = 8
#: Values (pairs times vertices of the divided mesh) computed in about half a minute, and the
#: smallest number of nonzero pairs, for `affordable_pairs`.
_VALUES, _FEWEST = 4e7, 20
#: Number of pairs from which the number of resolved pairs is estimated.
_PROBED = 100
#: Values of eigenvectors in memory at a time, and number of rows transposed at a time.
_VALUES_AT_ONCE, _ROWS = 2**24, 16


def resolution_error(
    mesh: MeshLike,
    pairs: EigenpairsLike,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> FloatArray:
    """Estimate the relative error of each eigenvalue that is due to the size of the triangles.

    The error is that of the eigenvalue with the same index on the same polyhedral surface, meshed
    infinitely finely. The mesh is solved again with every face cut in four, with the same
    Laplacian, and the limit is extrapolated from both solutions [1]_; up to the last pair with an
    estimate above 25 %, the mesh is divided once more. `affordable_pairs` are computed in about
    half a minute.

    Parameters
    ----------
    mesh : MeshLike
        The mesh of the pairs.
    pairs : Eigenpairs
        Its lowest k pairs, see `meshmash_viewer.solve`.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ndarray of float64, shape (k,)
        Estimates of ``(λ_k - λ) / λ``, negative for eigenvalues that are too low; 0 for zeros.

    Raises
    ------
    InputError
        If the pairs are not those of the mesh, are not the lowest, or the divided mesh does not fit
        into memory.
    Cancelled
        If `cancel` returned True.

    References
    ----------
    .. [1] Richardson, L. F. (1911). "The Approximate Arithmetical Solution by Finite Differences of
       Physical Problems." Philosophical Transactions of the Royal Society A 210.

    Examples
    --------
    >>> mv.resolution_error(ball, pairs)[1:4].round(4)
    array([-0.0048, -0.0048, -0.0048])
    """
    from meshmash_viewer.spectral.eigenpairs import as_eigenpairs
    from meshmash_viewer.spectral.eigensolver import solve

    mesh = as_mesh(mesh)
    pairs = as_eigenpairs("resolution_error(mesh, pairs)", pairs, mesh)
    values = np.asarray(pairs.eigenvalues, dtype=np.float64)
    if pairs.certificate.low is not None:
        fault = "The mesh resolution is estimated for the lowest eigenpairs, not around a shift"
        raise InputError("not-lowest-pairs", fault, "omit sigma")
    operator, first = _operator_of(mesh, pairs), count_zeros(values)
    errors, coarse, stop = np.zeros(len(values)), values[first:], len(values)
    for _ in range(2):
        if stop <= first:
            break
        check_cancelled(cancel)
        mesh = _cut_in_four(mesh)
        stiffness, mass = _matrices(mesh, operator)
        check_memory(mesh.n_vertices, stiffness.nnz, stop, free_memory(), first)
        found = solve(stiffness, mass, stop, progress=progress, cancel=cancel).eigenvalues
        fine = found[count_zeros(found) :]
        count = min(len(fine), stop - first)
        fine, coarse = fine[:count], coarse[:count]
        # far from convergence the extrapolated limit may be too low, or negative
        limit = np.maximum((4.0 * fine - coarse) / 3.0, 0.5 * fine)
        errors[first : first + count] = values[first : first + count] / limit - 1.0
        large = np.flatnonzero(np.abs(errors[:stop]) > _LARGE)
        coarse, stop = fine, int(large[-1]) + 1 if len(large) else 0
    return errors


def affordable_pairs(n_vertices: int, eigenvalues: FloatArray) -> int:
    """Return the number of leading pairs for which `resolution_error` takes about half a minute."""
    most = max(int(_VALUES / (4 * n_vertices)), count_zeros(eigenvalues) + _FEWEST)
    return min(most, len(eigenvalues))


def resolved_pairs(
    target: Target, area: float, n_vertices: int, solve: Callable[[Target], Eigenpairs]
) -> tuple[Eigenpairs, str]:
    """Compute the pairs of a target that the mesh resolves, and if it is limited, a sentence.

    `solve` returns the pairs of a target with their `mesh_errors`. It is first called for a few
    pairs if the target has more.
    """
    few = Target("count", min(_PROBED, n_vertices))
    is_long = Translation(area, n_vertices=n_vertices).count(target)[0] > few.value
    pairs = solve(first := few if is_long else target)
    limited, limit = pairs.within_resolution(target)
    if limited is not None and limited != first:
        pairs = solve(limited)
        limit = limit and pairs.mesh_limit
    if limit and pairs.resolvable[1] < len(pairs):
        pairs = pairs.first(pairs.resolvable[1])
    return pairs, limit


def quick_error(mesh: Mesh, pairs: Eigenpairs) -> FloatArray:
    """Estimate the errors of `resolution_error` from the pairs alone, shape (k,).

    The Rayleigh quotient of each eigenvector with the consistent mass is an upper bound. What finer
    triangles take off it is estimated from the residuals of functions on the edges, solved for on
    each triangle alone [1]_. The eigenvalues of the surface are the estimates in ascending order,
    since modes change places.

    References
    ----------
    .. [1] Bank, R. and Weiser, A. (1985). "Some A Posteriori Error Estimators for Elliptic Partial
       Differential Equations." Mathematics of Computation 44(170).
    """
    from meshmash_viewer.spectral.cover import LANES, residuals, triangulate

    faces, used, area = mesh.proper_faces, mesh.referenced, mesh.area
    operator, whole = pairs.operator or OperatorOptions(), bool(used.all())
    vertices = np.ascontiguousarray(mesh.vertices[used] / np.sqrt(area))
    surface = triangulate(
        vertices,
        np.array(faces if whole else (np.cumsum(used) - 1)[faces], dtype=np.int64),
        operator.mollify_factor,
        operator.robust,
    )
    values = np.asarray(pairs.eigenvalues, dtype=np.float64) * area
    limits, first = values.copy(), count_zeros(values)
    size = max(_VALUES_AT_ONCE // len(vertices) // LANES, 1) * LANES
    for part in blocks(len(values), size, first):
        of_part = values[part]
        width = -(-len(of_part) // LANES) * LANES
        columns, rates = np.zeros((len(vertices), width), np.float32), np.zeros(width, np.float32)
        rates[: len(of_part)] = of_part
        for rows in blocks(len(of_part), _ROWS):  # which transposes faster than all at once
            chosen = pairs.rows[part][rows]
            columns[:, rows] = (chosen if whole else chosen[:, used]).T
        norms, energies = area * residuals(*surface, columns, rates)[:, : len(of_part)]
        # a quarter of the consistent mass is lumped: 1
        limits[part] = of_part / (0.25 + norms) / (1.0 + energies / of_part)
    errors = np.zeros(len(values))
    errors[first:] = values[first:] / np.sort(limits[first:]) - 1.0
    return errors


def _cut_in_four(mesh: Mesh) -> Mesh:
    """Return the same surface with every face cut in four at the midpoints of its edges.

    The faces keep their order, on which the robust Laplacian of non-manifold meshes depends.
    """
    n, old = mesh.n_vertices, mesh.proper_faces
    keys, numbers = np.unique(side_codes(old, n) >> 1, return_inverse=True)
    (a, b, c), (ab, bc, ca) = old.T, (numbers.reshape(-1, 3) + n).T
    faces = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
    middles = mesh.vertices[np.stack(np.divmod(keys, n))].mean(axis=0)
    return Mesh(np.concatenate([mesh.vertices, middles]), faces)


def _matrices(mesh: Mesh, operator: OperatorOptions) -> tuple[SparseMatrix, SparseMatrix]:
    return cotangent_laplacian(mesh, robust=operator.robust, mollify_factor=operator.mollify_factor)


def _operator_of(mesh: Mesh, pairs: Eigenpairs) -> OperatorOptions:
    """Return the options of the Laplacian whose Rayleigh quotients are the eigenvalues."""
    if pairs.rows.shape[1] != mesh.n_vertices:
        raise other_mesh("The eigenpairs", pairs.rows.shape[1], mesh.n_vertices)
    known = pairs.operator
    candidates = [known] if known else [OperatorOptions(), OperatorOptions(robust=False)]
    differences = [_difference(mesh, pairs, each) for each in candidates]
    best = int(np.argmin(differences))
    if not differences[best] < _SAME:
        fault = "The eigenpairs are not those of a Laplacian of this mesh"
        raise InputError("other-mesh", fault, "give the mesh that was decomposed")
    return candidates[best]


def _difference(mesh: Mesh, pairs: Eigenpairs, operator: OperatorOptions) -> float:
    """Return the largest relative difference of a few eigenvalues and Rayleigh quotients."""
    try:
        stiffness, mass = _matrices(mesh, operator)
    except InputError:  # faces without area have no cotangents
        return np.inf
    used, values = np.flatnonzero(mesh.referenced), np.asarray(pairs.eigenvalues)
    places = np.unique(np.linspace(0, len(values) - 1, _COMPARED).astype(np.intp))
    places = places[places >= count_zeros(values)]
    columns = np.zeros((mesh.n_vertices, len(places)))
    columns[used] = np.asarray(pairs.rows[places], dtype=np.float64)[:, used].T
    energy, size = ((columns * (each @ columns)).sum(axis=0) for each in (stiffness, mass))
    return float(np.abs(energy / size / values[places] - 1.0).max(initial=0.0))

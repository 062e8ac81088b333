"""Stiffness and mass matrices of a triangle mesh.

The eigenvalue problem of the surface is ``L φ = λ M φ``: `L` contains cotangent weights (no
unit), `M` the area of each vertex (squared unit of the mesh), so λ is per squared unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.units import check_number

SparseMatrix: TypeAlias = Any
#: Two ends and the weight of each edge, shape (m,) each.
Edges: TypeAlias = tuple[npt.NDArray[np.integer], npt.NDArray[np.integer], FloatArray]


@dataclass(frozen=True, slots=True)
class OperatorOptions:
    """Parameters of the Laplacian, stored with results."""

    #: True: the operator of Sharp and Crane, for any triangle soup; False: the cotangent Laplacian,
    #: for clean manifold meshes.
    robust: bool = True
    #: Length that the robust operator adds to edges, relative to their mean, so that no triangle is
    #: degenerate.
    mollify_factor: float = 1e-5

    def __post_init__(self) -> None:
        check_number(self.mollify_factor, "mollify_factor")


def cotangent_laplacian(
    mesh: MeshLike, robust: bool = False, mollify_factor: float = 1e-5
) -> tuple[SparseMatrix, SparseMatrix]:
    """Build the Laplacian and the mass matrix of a mesh.

    `InputError` is raised if the mesh is not valid, if a face has no area and `robust` is False, or
    if `mollify_factor` is negative or too small for the degenerate faces.

    Parameters
    ----------
    mesh : MeshLike
        The mesh, n vertices.
    robust : bool
        False: cotangent weights and a third of the adjacent areas of the triangles. True: the same
        on the intrinsic Delaunay triangulation of the mollified tufted cover, which allows
        non-manifold edges, slivers, zero-area and duplicate faces [1]_.
    mollify_factor : float
        See `OperatorOptions`; only with `robust`.

    Returns
    -------
    L : scipy.sparse.csc_array of float64, shape (n, n)
        Symmetric with zero row sums, and positive semi-definite for any triangles: ``fᵀ L f`` is
        the Dirichlet energy ``∫ |∇f|²`` of the piecewise linear function f, although edges that are
        not Delaunay have negative weights.
    M : scipy.sparse.dia_array of float64, shape (n, n)
        Diagonal, in squared unit of the mesh. Unreferenced vertices have empty rows in L and M.

    Notes
    -----
    With `robust`, L and M are those of ``robust_laplacian.mesh_laplacian(vertices, faces,
    mollify_factor)`` with faces in their given order, on which the operator depends if faces are
    duplicated (see `mesh_health`). Unlike in that package, unreferenced vertices have no diagonal
    entry, and faces with a repeated corner that use such a vertex are left out.

    References
    ----------
    .. [1] Sharp, N. and Crane, K. (2020). "A Laplacian for Nonmanifold Triangle Meshes."
       Computer Graphics Forum 39(5).

    Examples
    --------
    >>> height = ball.vertices[:, 2]
    >>> float((height @ L @ height / (height @ M @ height)).round(2))
    2.0
    """
    mesh = as_mesh(mesh)
    used = np.flatnonzero(mesh.referenced)
    vertices, scale = _scaled(mesh.vertices[used])
    if robust:
        faces = _renumbered(mesh, mesh.referenced[mesh.faces].all(axis=1))
        edges, areas = _robust_operator(vertices, faces, mollify_factor)
        masses = np.zeros(mesh.n_vertices)
        masses[used] = areas * scale**2
    else:
        _refuse_flat_faces(mesh)
        faces = _renumbered(mesh, mesh.distinct_corners)
        edges, masses = _cotangent_weights(vertices, faces), mesh.vertex_areas.copy()
    return _stiffness(edges, used, mesh.n_vertices), sparse.diags_array(masses)


def area_matrix(mesh: MeshLike) -> SparseMatrix:
    """Build the lumped mass matrix: a third of the area of the faces around each vertex.

    Parameters
    ----------
    mesh : MeshLike
        The mesh, n vertices.

    Returns
    -------
    M : scipy.sparse.dia_array of float64, shape (n, n)
        Diagonal, in squared unit of the mesh; its trace is the area of the mesh.

    Examples
    --------
    >>> M = mv.area_matrix(ball)
    >>> bool(np.isclose(M.trace(), ball.area))
    True
    """
    return sparse.diags_array(compute_vertex_areas(mesh))


def compute_vertex_areas(
    mesh: MeshLike, robust: bool = False, mollify_factor: float = 1e-5
) -> FloatArray:
    """Compute the area that belongs to each vertex.

    Parameters
    ----------
    mesh : MeshLike
        The mesh, n vertices.
    robust : bool
        False: a third of the area of the adjacent faces. True: the same on the triangulation of
        the robust Laplacian (see `cotangent_laplacian`).
    mollify_factor : float
        See `OperatorOptions`; only with `robust`.

    Returns
    -------
    ndarray of float64, shape (n,)
        In squared unit of the mesh; 0 for unreferenced vertices.

    Examples
    --------
    >>> bool(np.isclose(mv.compute_vertex_areas(ball).sum(), ball.area))
    True
    """
    if not robust:
        return as_mesh(mesh).vertex_areas.copy()
    _, mass = cotangent_laplacian(mesh, robust=True, mollify_factor=mollify_factor)
    return np.asarray(mass.diagonal(), dtype=np.float64)


def _renumbered(mesh: Mesh, kept: npt.NDArray[np.bool_]) -> IntArray:
    """Return the faces of a mask, with vertices numbered among the referenced ones."""
    number = np.cumsum(mesh.referenced) - 1
    return np.asarray(number[mesh.faces[kept]], dtype=np.int64)


def _scaled(vertices: FloatArray) -> tuple[FloatArray, float]:
    """Divide vertices by a scale, to an extent of 1 to 2; return them and the scale.

    Scaling by a power of two is exact, and keeps fourth powers of lengths in range. There is no
    translation, since only differences of coordinates are used.
    """
    extent = float(np.ptp(vertices, axis=0).max())
    scale = float(2.0 ** np.floor(np.log2(extent)))
    return vertices / scale, scale


def _refuse_flat_faces(mesh: Mesh) -> None:
    flat = np.flatnonzero(mesh.degenerate_faces & mesh.distinct_corners)
    if len(flat):
        raise InputError(
            "no-area",
            f"Faces without area, {len(flat)} of {mesh.n_faces}, have infinite cotangents (first"
            f" at vertices {mesh.faces[flat[0]].tolist()})",
            "use robust=True, or drop them",
        )


def _cotangent_weights(vertices: FloatArray, faces: IntArray) -> Edges:
    n = len(vertices)
    ends, weights = [], []
    for corner in range(3):
        # The cotangent of the angle at one corner is the weight of the opposite edge.
        here, first, second = (vertices[faces[:, (corner + step) % 3]] for step in range(3))
        u, v = first - here, second - here
        sine = np.linalg.norm(np.cross(u, v), axis=1)
        ends.append(np.sort(faces[:, [(corner + 1) % 3, (corner + 2) % 3]], axis=1))
        weights.append(0.5 * np.einsum("ij,ij->i", u, v) / sine)
    upper = sparse.coo_array((np.concatenate(weights), tuple(np.concatenate(ends).T)), shape=(n, n))
    upper.sum_duplicates()
    return np.asarray(upper.row), np.asarray(upper.col), np.asarray(upper.data)


def _robust_operator(
    vertices: FloatArray, faces: IntArray, mollify_factor: float
) -> tuple[Edges, FloatArray]:
    import robust_laplacian

    OperatorOptions(True, mollify_factor)  # checks the factor
    try:
        stiffness, mass = robust_laplacian.mesh_laplacian(
            vertices, faces, mollify_factor=float(mollify_factor)
        )
    except RuntimeError as error:
        fault = f"The robust Laplacian could not be built ({error})"
        remedy = "increase mollify_factor, or repair the mesh first"
        raise InputError("not-solvable", fault, remedy) from error
    areas = np.asarray(mass.diagonal(), dtype=np.float64)
    entries = stiffness.tocoo()
    if not (np.isfinite(entries.data).all() and areas.min() > 0):
        fault = f"mollify_factor {mollify_factor} is too small for the degenerate faces"
        raise InputError("not-solvable", fault, "increase it, or repair the mesh first")
    upper = entries.row < entries.col
    return (entries.row[upper], entries.col[upper], -entries.data[upper]), areas


def _stiffness(edges: Edges, used: IntArray, n: int) -> SparseMatrix:
    """Build L of all n vertices, with zero row sums, from edges between the vertices `used`."""
    used = used.astype(sparse.get_index_dtype(maxval=2 * len(edges[2]) + n))
    first, second, weights = used[edges[0]], used[edges[1]], edges[2]
    degree = np.bincount(first, weights, n) + np.bincount(second, weights, n)
    stiffness = sparse.csc_array(
        (
            np.concatenate([-weights, -weights, degree[used]]),
            (np.concatenate([first, second, used]), np.concatenate([second, first, used])),
        ),
        shape=(n, n),
    )
    stiffness.sort_indices()
    stiffness.eliminate_zeros()
    return stiffness

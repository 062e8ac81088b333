"""Shapes with spectra in closed form, and a mesh with the faults of real data."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from meshmash_viewer.mesh import Mesh

__all__ = [
    "flat_torus",
    "icosphere",
    "neuron",
    "rectangle",
    "rectangle_eigenvalues",
    "sphere_eigenvalues",
    "three_spheres",
    "tube",
]


def icosphere(subdivisions: int = 3, radius: float = 1.0, unit: str = "") -> Mesh:
    """Return an almost uniform sphere of ``10 * 4**subdivisions + 2`` vertices.

    Its icosahedral symmetry makes eigenvalues multiple up to rounding: solvers may lose copies.
    """
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [
        [sign_a * a, sign_b * golden, 0.0]
        for a in (1.0,)
        for sign_a in (-1, 1)
        for sign_b in (-1, 1)
    ]
    vertices = np.array(
        [np.roll(corner, shift) for shift in range(3) for corner in corners], dtype=np.float64
    )
    gaps = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = np.isclose(gaps, 2.0)
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    normals = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    inward = np.einsum("ij,ij->i", normals, vertices[faces[:, 0]]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    for _ in range(subdivisions):
        vertices, faces = _subdivided(vertices, faces)
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return Mesh(radius * vertices, faces, unit, "icosphere")


def _subdivided(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, inverse = np.unique(ends, axis=0, return_inverse=True)
    a, b, c = faces.T
    ab, bc, ca = (inverse.reshape(-1, 3) + len(vertices)).T
    faces = np.concatenate(
        [
            np.stack(corners, axis=1)
            for corners in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
        ]
    )
    return np.concatenate([vertices, vertices[edges].mean(axis=1)]), faces


def sphere_eigenvalues(count: int, radius: float = 1.0) -> np.ndarray:
    """Return the lowest of ``l (l + 1) / radius²``, each 2 l + 1 times."""
    degrees = np.arange(int(np.sqrt(count)) + 2)
    return np.repeat(degrees * (degrees + 1), 2 * degrees + 1)[:count] / radius**2


def together(*parts: Mesh | np.ndarray, unit: str = "") -> Mesh:
    """Return meshes and loose vertices (n, 3) as one mesh, in this order."""
    meshes = [part if isinstance(part, Mesh) else (part, np.zeros((0, 3), int)) for part in parts]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [each + start for (_, each), start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([each for each, _ in meshes]), np.concatenate(faces), unit)


def moved(mesh: Mesh, *shift: float, scale: float = 1.0) -> Mesh:
    """Return a mesh that is scaled, then shifted by one number or three."""
    return Mesh(scale * mesh.vertices + np.array(shift), mesh.faces, mesh.unit)


def signed_volume(mesh: Mesh) -> float:
    """Return the volume, negative if faces point inwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.sum(np.cross(a, b) * c)) / 6.0


def three_spheres(subdivisions: int = 2) -> Mesh:
    """Return three separate equal spheres, which triple the multiplicity of eigenvalues."""
    one = icosphere(subdivisions)
    vertices = np.concatenate([one.vertices + np.array([4.0 * i, 0.0, 0.0]) for i in range(3)])
    faces = np.concatenate([one.faces + i * one.n_vertices for i in range(3)])
    return Mesh(vertices, faces, name="three spheres")


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Return two triangles for each cell of a grid of rows × columns vertices."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def rectangle(nx: int = 40, ny: int = 30, a: float = 2.0, b: float = 1.5) -> Mesh:
    """Return a flat rectangle of a × b with nx × ny vertices and a free (Neumann) boundary."""
    x, y = np.meshgrid(np.linspace(0.0, a, nx), np.linspace(0.0, b, ny), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(nx * ny)], axis=1)
    return Mesh(vertices, _grid_faces(nx, ny), name="rectangle")


def rectangle_eigenvalues(count: int, a: float = 2.0, b: float = 1.5) -> np.ndarray:
    """Return the lowest of ``π² (p²/a² + q²/b²)``, p and q from 0."""
    orders = np.arange(count)
    both = np.pi**2 * ((orders / a)[:, None] ** 2 + (orders / b)[None] ** 2)
    return np.sort(both.ravel())[:count]


def flat_torus(n: int = 24, side: float = 1.0) -> tuple[sparse.csc_array, sparse.dia_array]:
    """Return (L, M) of the square with opposite sides glued, n × n vertices.

    The cotangent Laplacian of a grid of right triangles is the five-point stencil.
    """
    shift = sparse.csc_array((np.ones(n), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))
    one = sparse.eye_array(n)
    circle = 2.0 * one - shift - shift.T
    stiffness = sparse.csc_array(sparse.kron(circle, one) + sparse.kron(one, circle))
    return stiffness, sparse.diags_array(np.full(n * n, (side / n) ** 2))


def tube(path: np.ndarray, radius: np.ndarray, around: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices, (p * around + 2, 3), and faces of a closed tube along p points.

    `radius`, shape (p, around), is the distance of each vertex from the path.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.cross(tangent, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    angle = 2.0 * np.pi * np.arange(around) / around
    rings = (
        path[:, None]
        + radius[..., None] * np.cos(angle)[None, :, None] * first[:, None]
        + radius[..., None] * np.sin(angle)[None, :, None] * second[:, None]
    )
    points = len(path)
    index = np.arange(points * around).reshape(points, around)
    a, d = index[:-1], index[1:]
    b, c = np.roll(a, -1, axis=1), np.roll(d, -1, axis=1)
    sides = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    start, end = points * around, points * around + 1
    caps = [
        np.stack([np.roll(index[0], -1), index[0], np.full(around, start)], axis=1),
        np.stack([index[-1], np.roll(index[-1], -1), np.full(around, end)], axis=1),
    ]
    vertices = np.concatenate([rings.reshape(-1, 3), path[:1], path[-1:]])
    return vertices, np.concatenate(sides + caps)


def neuron(points: int = 60, around: int = 14, debris: int = 5, seed: int = 7) -> Mesh:
    """Return a dendrite in nm, far from the origin, with the faults of segmented meshes.

    It has a trunk with spines, a branch that meets the trunk at one edge (of four faces), debris, a
    hole, a duplicate face, a face without area, and a vertex used by no face.
    """
    random = np.random.default_rng(seed)
    trunk_line = np.linspace(0.0, 9000.0, points)
    wave = 600.0 * np.sin(trunk_line / 2000.0), 200.0 * np.cos(trunk_line / 1500.0)
    trunk = np.stack([trunk_line, *wave], axis=1)
    vertices, faces = tube(trunk, _spiny_radius(points, around, 300.0, random), around)

    branch_points = points // 2
    branch_line = np.linspace(0.0, 4000.0, branch_points)
    start = trunk[points // 3] + [0.0, 700.0, 0.0]
    branch = start + np.stack([0.3 * branch_line, branch_line, 0.1 * branch_line], axis=1)
    more, more_faces = tube(branch, _spiny_radius(branch_points, around, 180.0, random), around)
    more_faces = more_faces + len(vertices)
    # An edge of the trunk replaces an edge of the branch.
    edge = (points // 3) * around + np.array([0, 1])
    own = len(vertices) + np.array([0, 1])
    for old, new in zip(own, edge, strict=True):
        more_faces[more_faces == old] = new
    vertices, faces = np.concatenate([vertices, more]), np.concatenate([faces, more_faces])

    speck = icosphere(1, 60.0)
    for _ in range(debris):
        place = random.uniform((0.0, 1500.0, -2000.0), (9000.0, 3000.0, -1200.0))
        faces = np.concatenate([faces, speck.faces + len(vertices)])
        vertices = np.concatenate([vertices, speck.vertices + place])

    hole = np.flatnonzero((faces == 20 * around + 5).any(axis=1))[:2]
    faces = np.delete(faces, hole, axis=0)
    a, b, c = faces[100]
    flat = len(vertices)
    vertices = np.concatenate([vertices, 0.5 * (vertices[[a]] + vertices[[b]])])
    faces = np.concatenate([faces, [[c, a, b]], [[a, b, flat]]])
    unused = trunk.mean(axis=0, keepdims=True)
    vertices = np.concatenate([vertices[: flat // 2], unused, vertices[flat // 2 :]])
    faces = faces + (faces >= flat // 2)
    # The replaced vertices of the branch stay unused, as in real files.
    return Mesh(vertices + np.array([250_000.0, 180_000.0, 90_000.0]), faces, "nm", "neuron")


def _spiny_radius(
    points: int, around: int, radius: float, random: np.random.Generator
) -> np.ndarray:
    along = np.linspace(0.0, 1.0, points)
    profile = radius * (0.6 + 0.4 * np.cos(9.0 * along)) * np.minimum(1.0, 12.0 * along + 0.3)
    result = np.repeat(profile[:, None], around, axis=1)
    for _ in range(points // 5):
        ring, spoke = random.integers(3, points - 3), random.integers(around)
        result[ring, spoke] += random.uniform(1.0, 3.0) * radius
    return result


def blob(level: int = 4, *, symmetric: bool = False) -> Mesh:
    """Return a sphere with dents and bumps, without symmetry or with a mirror symmetry."""
    ball = icosphere(level)
    x, y, z = ball.vertices.T
    if symmetric:
        x, y = -z, np.abs(x)
        z = ball.vertices[:, 1]
    radius = 1.0 + 0.3 * x + 0.2 * y * z + 0.25 * np.exp(-8.0 * ((x - 0.6) ** 2 + (y - 0.7) ** 2))
    return Mesh(ball.vertices * radius[:, None] * [1.0, 1.3, 0.8], ball.faces)


def moved_copy(mesh: Mesh, scale: float = 2.5, seed: int = 4) -> tuple[Mesh, np.ndarray]:
    """Return a rotated, scaled, moved and permuted copy, and the new index of each vertex."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    return Mesh((scale * mesh.vertices @ turn.T + 9.0)[order], place[mesh.faces]), place

"""Icon of the application: an eigenfunction on a triangle mesh of the sphere.

    python assets/make_icon.py

writes ``meshmash_viewer/app/icon.png``, 256 pixels wide. The function is the real spherical
harmonic of degree 3 and order 2, x y z up to a rotation: eight equal lobes, which can be
distinguished at 32 pixels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyvista as pv
from PIL import Image

ICON = Path(__file__).resolve().parent.parent / "meshmash_viewer" / "app" / "icon.png"
SIZE = 256
#: Samples per pixel in each direction; their average smooths the edges.
SAMPLES = 6

TILE_TOP, TILE_BOTTOM = np.array([33, 46, 66]), np.array([15, 22, 34])
#: Blue – white – red, as in the window for fields with a sign.
STOPS = np.array([-1.0, -0.45, 0.0, 0.45, 1.0])
COLORS = np.array([[22, 84, 160], [84, 158, 211], [246, 244, 240], [240, 145, 104], [190, 32, 50]])


def turned(points: np.ndarray, about: str, degrees: float) -> np.ndarray:
    """Return coordinates rotated about an axis."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[about]
    angle = np.radians(degrees)
    result = points.copy()
    result[..., i] = np.cos(angle) * points[..., i] - np.sin(angle) * points[..., j]
    result[..., j] = np.sin(angle) * points[..., i] + np.cos(angle) * points[..., j]
    return result


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors of length 1 in the same directions."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def geodesic_sphere() -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of an icosahedron with faces cut in four, on the unit sphere."""
    ball = pv.Icosphere(nsub=1)
    faces = ball.faces.reshape(-1, 4)[:, 1:]
    return unit(np.asarray(ball.points, dtype=float)), faces


def draw() -> np.ndarray:
    """Return red, green, blue and opacity, shape (SIZE, SIZE, 4), 0 to 255."""
    n = SIZE * SAMPLES
    axis = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    x, y = np.meshgrid(axis, -axis)

    # A tile with round corners, as is usual for icons.
    corner = 0.44
    reach = 0.97
    outside = np.hypot(
        np.maximum(np.abs(x) - (reach - corner), 0.0), np.maximum(np.abs(y) - (reach - corner), 0.0)
    )
    tile = outside <= corner
    blend = ((1.0 - y) / 2.0)[..., None]
    image = (1.0 - blend) * TILE_TOP + blend * TILE_BOTTOM

    corners, faces = geodesic_sphere()
    corners = 0.80 * turned(turned(corners, "y", 20.0), "x", -14.0)
    a, b, c = (corners[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = (normals * a).sum(axis=1)
    # The visible point of a convex solid is on the lowest of the planes that face the viewer.
    depth, face = np.full((n, n), np.inf), np.zeros((n, n), dtype=int)
    second = np.full((n, n), np.inf)
    for i in np.flatnonzero(normals[:, 2] > 1e-6):
        plane = (offsets[i] - normals[i, 0] * x - normals[i, 1] * y) / normals[i, 2]
        nearer = plane < depth
        second = np.where(nearer, depth, np.minimum(second, plane))
        depth = np.where(nearer, plane, depth)
        face[nearer] = i
    back = np.full((n, n), -np.inf)
    for i in np.flatnonzero(normals[:, 2] < -1e-6):
        plane = (offsets[i] - normals[i, 0] * x - normals[i, 1] * y) / normals[i, 2]
        back = np.maximum(back, plane)
    ball = depth > back

    place = np.stack([x, y, depth], axis=-1)
    place /= np.linalg.norm(place, axis=-1, keepdims=True)
    p = turned(turned(turned(place, "y", 30.0), "x", 33.0), "z", 8.0)
    value = p.prod(axis=-1) * 3.0**1.5
    value = np.sign(value) * np.abs(value) ** 0.8
    color = np.stack([np.interp(value, STOPS, COLORS[:, k]) for k in range(3)], axis=-1)

    light = np.array([-0.42, 0.55, 0.72]) / np.linalg.norm([-0.42, 0.55, 0.72])
    diffuse = np.clip(normals @ light, 0.0, None)
    gloss = np.clip(normals @ unit(light + np.array([0.0, 0.0, 1.0])), 0.0, None) ** 30
    shaded = color * (0.46 + 0.60 * diffuse)[face][..., None] + (55.0 * gloss)[face][..., None]
    # Edges, where the two lowest planes nearly meet, are darkened.
    edge = (second - depth) * normals[face, 2] < 0.0042
    shaded[edge] *= 0.55
    image[ball] = shaded[ball]

    full = np.concatenate([np.clip(image, 0, 255), 255.0 * tile[..., None]], axis=-1)
    # Averaging colour weighted by opacity keeps the rim of the tile free of fringes.
    blocks = full.reshape(SIZE, SAMPLES, SIZE, SAMPLES, 4)
    opacity = blocks[..., 3].mean(axis=(1, 3))
    weight = blocks[..., 3:] / 255.0
    total = np.maximum(weight.sum(axis=(1, 3)), 1e-9)
    mean = (blocks[..., :3] * weight).sum(axis=(1, 3)) / total
    return np.concatenate([mean, opacity[..., None]], axis=-1).round().astype(np.uint8)


if __name__ == "__main__":
    Image.fromarray(draw()).save(ICON, optimize=True)
    print(f"{ICON.name}: {ICON.stat().st_size / 1e3:.0f} kB")

"""Sample meshes of the package, generated without downloads and equal in every run.

    python assets/make_samples.py

writes ``meshmash_viewer/samples/dendrite.npz``, a piece of spiny dendrite in nm,
``meshmash_viewer/samples/neuron.npz``, a small neuron with its soma,
``meshmash_viewer/samples/cow.npz``, a four-legged body in mm,
``meshmash_viewer/samples/sphere.npz``, the unit sphere, whose eigenvalues are known, and
``meshmash_viewer/samples/two_components.npz``, a small mesh with the faults of raw data.

``dendrite_labels.npz`` and ``neuron_labels.npz`` contain the parts of the two meshes: a vertex is
on a spine if it is outside the surface of the shafts without spines.

Dendrite, neuron and cow are zero levels of distance fields: round cones along centre lines,
joined by the polynomial smooth minimum, so that necks join the shaft smoothly. The field
is sampled on a grid, contoured, smoothed, and simplified by quadric decimation. Sizes follow
the electron microscopy of cortical pyramidal cells: shafts 0.5 to 1.1 µm across, spine necks
0.1 to 0.2 µm, heads 0.3 to 0.7 µm, two to three spines per µm (Harris & Stevens 1989; Arellano et
al. 2007).
"""

from __future__ import annotations

import json
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyvista as pv
from scipy.interpolate import make_interp_spline
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

SAMPLES = Path(__file__).resolve().parent.parent / "meshmash_viewer" / "samples"
SEED = 7
#: Strength of the random bending of branches.
WANDER = 0.009
#: Edge of a grid cell, nm: a third of the thinnest neck.
SPACING = 34.0
N_VERTICES = 44_000
#: Grid cell and number of vertices of the neuron, and factor by which it is enlarged.
NEURON_SPACING, N_NEURON, NEURON_SCALE = 46.0, 13_000, 1.6
#: Grid cell, mm, and number of vertices of the cow.
COW_SPACING, N_COW = 16.0, 9_000
#: Distance from the shafts, nm, beyond which a vertex is on a spine.
SPINE_FROM = 70.0
#: Names and colours of the labels.
PARTS = {"shaft": "#4477aa", "spine": "#ee6677", "soma": "#ccbb44", "axon": "#228833"}
#: Position of the mesh, nm, as in a data set of a cubic millimetre.
ORIGIN = np.array([612_400.0, 418_900.0, 287_300.0])
#: Rounding of coordinates, nm: far below microscope resolution, and better to compress.
RESOLUTION = 0.25

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]


# ------------------------------------------------------------------------------- centre lines


@dataclass
class Tube:
    """A centre line (s, 3) with its radius at each point (s,), both in nm."""

    points: Array
    radii: Array

    @property
    def tangents(self) -> Array:
        tangents = np.gradient(self.points, axis=0)
        return tangents / np.linalg.norm(tangents, axis=1, keepdims=True)


def unit_vector(vector: Array) -> Array:
    """Return the vector of length 1 in the same direction."""
    return vector / np.linalg.norm(vector)


def smooth_noise(rng: np.random.Generator, n: int, wavelength: float) -> Array:
    """Return random values of unit variance, smooth over `wavelength` samples."""
    reach = int(4 * wavelength)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / wavelength) ** 2)
    noise = np.convolve(rng.standard_normal(n + 2 * reach), kernel, mode="valid")
    return noise / np.sqrt((kernel**2).sum())


def wandering_tube(
    rng: np.random.Generator,
    start: Array,
    direction: Array,
    length: float,
    radii: tuple[float, float],
    wander: float,
    step: float = 40.0,
) -> Tube:
    """Return a tapering tube that bends gently, with swellings as from mitochondria."""
    n = int(length / step)
    heading = unit_vector(direction)
    bends = np.stack([smooth_noise(rng, n, 45.0) for _ in range(3)], axis=1)
    bends[:, 2] *= 0.6
    points = np.empty((n, 3))
    points[0] = start
    for i in range(1, n):
        sideways = bends[i] - (bends[i] @ heading) * heading
        # The tube bends, but keeps its general direction.
        heading = unit_vector(heading + wander * sideways + 0.02 * unit_vector(direction))
        points[i] = points[i - 1] + step * heading
    taper = np.linspace(0.0, 1.0, n)
    profile = radii[0] * (radii[1] / radii[0]) ** taper
    profile *= 1.0 + 0.10 * smooth_noise(rng, n, 16.0)
    return Tube(points, profile)


@dataclass
class Spine:
    """A neck, and the balls that form the head of the spine."""

    neck: Tube
    centres: Array
    radii: Array


def make_spine(
    rng: np.random.Generator, base: Array, outward: Array, tangent: Array, shaft_radius: float
) -> Spine:
    """Return a mushroom, thin or stubby spine that leaves the shaft at `base`."""
    kind = rng.choice(["mushroom", "thin", "stubby"], p=[0.62, 0.26, 0.12])
    if kind == "mushroom":
        neck, head, length = rng.uniform(60, 80), rng.uniform(175, 300), rng.uniform(350, 900)
    elif kind == "thin":
        neck, head, length = rng.uniform(54, 66), rng.uniform(115, 165), rng.uniform(600, 1300)
    else:
        neck, head, length = rng.uniform(120, 160), rng.uniform(180, 240), rng.uniform(120, 240)
    # The neck begins inside the shaft, so that a fillet joins the two.
    root = 0.6 * shaft_radius
    total = root + length + 0.6 * head
    along = np.linspace(0.0, total, max(int(total / 20.0), 10))
    lean = unit_vector(outward + rng.normal(0.0, 0.35) * tangent)
    side = unit_vector(np.cross(lean, rng.standard_normal(3)))
    phase = rng.uniform(0.5, 1.5)
    curl = rng.normal(0.0, 0.11) * total * np.sin(phase * np.pi * along / total)
    points = base - root * outward + along[:, None] * lean + curl[:, None] * side
    flare = 0.8 * neck * np.exp(-np.maximum(along - root, 0.0) / 80.0)
    tube = Tube(points, neck + flare)
    # Balls around the tip, spread across the neck, form an irregular cap, wider than high.
    tip = unit_vector(points[-1] - points[-3])
    n_balls = 1 if head < 150 else int(rng.integers(3, 6))
    spread = rng.standard_normal((n_balls, 3))
    spread -= 0.75 * (spread @ tip)[:, None] * tip
    spread *= 0.42 * head / np.linalg.norm(spread, axis=1, keepdims=True)
    radii = head * (rng.uniform(0.62, 0.8, n_balls) if n_balls > 1 else np.ones(1))
    centres = points[-1] + (spread if n_balls > 1 else 0.0 * spread)
    return Spine(tube, centres, radii)


# ------------------------------------------------------------------------------ distance field


class Field:
    """Signed distance, nm, on a regular grid; negative inside."""

    def __init__(self, low: Array, high: Array, spacing: float) -> None:
        self.low, self.spacing = low, spacing
        self.shape = np.ceil((high - low) / spacing).astype(int) + 1
        self.values = np.full(tuple(self.shape), 4000.0, dtype=np.float32)

    def _box(self, points: Array, reach: float) -> tuple[slice, slice, slice]:
        first = np.floor((points.min(axis=0) - reach - self.low) / self.spacing).astype(int)
        last = np.ceil((points.max(axis=0) + reach - self.low) / self.spacing).astype(int) + 1
        first, last = np.maximum(first, 0), np.minimum(last, self.shape)
        return tuple(slice(a, b) for a, b in zip(first, last, strict=True))  # type: ignore[return-value]

    def add(self, tube: Tube, blend: float) -> None:
        """Join a tube to the solid, with a fillet of about `blend` nm."""
        reach = 2.0 * blend + 4.0 * self.spacing
        whole = self._box(tube.points, tube.radii.max() + reach)
        origin = np.array([side.start for side in whole])
        part = np.full(self.values[whole].shape, 4000.0, dtype=np.float32)
        pieces = zip(
            tube.points[:-1], tube.points[1:], tube.radii[:-1], tube.radii[1:], strict=True
        )
        for a, b, radius_a, radius_b in pieces:
            box = self._box(np.stack([a, b]), max(radius_a, radius_b) + reach)
            grid = np.meshgrid(
                *(
                    self.low[i] + self.spacing * np.arange(box[i].start, box[i].stop)
                    for i in range(3)
                ),
                indexing="ij",
                sparse=True,
            )
            axis = b - a
            from_a = [grid[i] - a[i] for i in range(3)]
            t = np.clip(sum(from_a[i] * axis[i] for i in range(3)) / (axis @ axis), 0.0, 1.0)
            squared = sum((from_a[i] - t * axis[i]) ** 2 for i in range(3))
            distance = np.sqrt(squared) - (radius_a + t * (radius_b - radius_a))
            local = tuple(
                slice(side.start - o, side.stop - o) for side, o in zip(box, origin, strict=True)
            )
            np.minimum(part[local], distance, out=part[local])
        here, there = self.values[whole], part
        overlap = np.maximum(blend - np.abs(here - there), 0.0) / blend
        self.values[whole] = np.minimum(here, there) - 0.25 * blend * overlap**2

    def beyond(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return whether points, relative to the corner of the grid, are on spines."""
        distances = map_coordinates(self.values, points.T / self.spacing, order=1)
        return np.asarray(distances > SPINE_FROM)

    def at(self, points: Array) -> Array:
        index = np.round((points - self.low) / self.spacing).astype(int)
        index = np.clip(index, 0, self.shape - 1)
        return self.values[tuple(index.T)].astype(float)

    def roughen(self, rng: np.random.Generator, amplitude: float, wavelength: float) -> None:
        """Move the surface by smooth noise of `amplitude` nm, as a real membrane undulates."""
        coarse = np.maximum((self.shape * self.spacing / wavelength).astype(int) + 3, 4)
        noise = pv.ImageData(dimensions=tuple(int(c) for c in coarse))
        noise["noise"] = rng.standard_normal(int(np.prod(coarse)))
        from scipy.ndimage import zoom  # a cubic spline through the coarse values

        values = zoom(noise["noise"].reshape(coarse), self.shape / coarse, order=3)
        self.values += (amplitude * values).astype(np.float32)

    def surface(self) -> pv.PolyData:
        image = pv.ImageData(
            dimensions=tuple(int(s) for s in self.shape), spacing=(self.spacing,) * 3
        )
        image["distance"] = self.values.ravel(order="F")
        return image.contour([0.0], scalars="distance", method="flying_edges")


# --------------------------------------------------------------------------------- the meshes


def make_dendrite(seed: int = SEED, size: float = 1.0) -> tuple[Array, Faces, list[str]]:
    """Return a shaft that forks twice, with spines, and its parts.

    It is one closed surface of genus 0. A smaller `size` gives shorter branches with fewer spines.
    """
    rng = np.random.default_rng(seed)
    shaft = wandering_tube(
        rng, np.zeros(3), np.array([1.0, 0.0, 0.0]), 18_500 * size, (430, 260), WANDER
    )
    fork = int(0.36 * len(shaft.points))
    limb = wandering_tube(
        rng, shaft.points[fork], np.array([0.72, 0.66, 0.16]), 11_000 * size, (300, 190), WANDER
    )
    twig_at = int(0.62 * len(shaft.points))
    twig = wandering_tube(
        rng, shaft.points[twig_at], np.array([0.66, -0.72, -0.2]), 7_500 * size, (250, 170), WANDER
    )
    tubes = [shaft, limb, twig]
    corners = np.concatenate([tube.points for tube in tubes])
    field = Field(corners.min(axis=0) - 2600.0, corners.max(axis=0) + 2600.0, SPACING)
    for tube in tubes:
        field.add(tube, blend=260.0)
    shafts = copy(field)
    shafts.values = field.values.copy()
    # Branches have no spines near the fork.
    n_spines = grow_spines(rng, field, [(shaft, 0), (limb, 34), (twig, 34)], 5.0)
    field.roughen(rng, amplitude=11.0, wavelength=420.0)
    vertices, faces = thinned(field.surface(), round(N_VERTICES * size))
    parts = np.where(shafts.beyond(vertices), "spine", "shaft").tolist()
    vertices += ORIGIN - vertices.mean(axis=0)
    print(f"dendrite: {n_spines} spines, {len(vertices)} vertices, {len(faces)} faces")
    return vertices, faces, parts


def make_neuron() -> tuple[Array, Faces, list[str]]:
    """Return a soma with a forked apical dendrite, basal dendrites and an axon, and its parts."""
    rng = np.random.default_rng(SEED)

    def branch(start: Array, to: tuple[float, float, float], length: float, radii: tuple) -> Tube:
        return wandering_tube(rng, start, np.array(to), length, radii, WANDER)

    along = np.linspace(-1.0, 1.0, 25)
    soma = Tube(
        np.stack([1500.0 * along, 120.0 * along, 0.0 * along], axis=1),
        1750.0 - 650.0 * (along + 1.0) * 0.5 - 350.0 * along**2,
    )
    apical = branch(np.array([900.0, 80.0, 0.0]), (1.0, 0.1, 0.05), 12_500, (620, 250))
    dendrites = [apical]
    for share, to, length in ((0.42, (0.7, 0.75, 0.1), 7000), (0.66, (0.75, -0.7, -0.1), 5500)):
        dendrites.append(
            branch(apical.points[int(share * len(apical.points))], to, length, (290, 180))
        )
    for to, length in (
        ((-0.35, 1.0, 0.15), 7600), ((-1.0, 0.5, -0.2), 6600), ((0.3, -1.0, -0.1), 7000),
    ):  # fmt: skip
        start = np.array([-700.0, 0.0, 0.0]) + 700.0 * unit_vector(np.array(to))
        basal = branch(start, to, length, (430, 190))
        fork, aside = basal.points[len(basal.points) // 2], (to[0] - 0.75, 0.6 * to[1], to[2] + 0.2)
        dendrites += [basal, branch(fork, aside, 0.55 * length, (250, 165))]
    axon = branch(np.array([-2100.0, -500.0, 0.0]), (-0.85, -0.6, 0.1), 10_400, (260, 105))
    # The axon has a hillock, a smooth segment, then a bouton every two µm.
    places = 40.0 * np.arange(len(axon.points))
    boutons = np.cos(np.pi * places / 2000.0) ** 24 * (places > 3500.0)
    axon.radii = 105.0 + 330.0 * np.exp(-places / 500.0) + 190.0 * boutons
    tubes = [soma, *dendrites, axon]
    corners = np.concatenate([tube.points for tube in tubes])
    field = Field(corners.min(axis=0) - 2400.0, corners.max(axis=0) + 2400.0, NEURON_SPACING)
    for tube in tubes:
        field.add(tube, blend=420.0 if tube is not axon else 200.0)
    shafts = copy(field)
    shafts.values = field.values.copy()
    bare = [90, *[30] * 2, *[55, 24] * 3]
    n_spines = grow_spines(rng, field, list(zip(dendrites, bare, strict=True)), 3.3)
    field.roughen(rng, amplitude=11.0, wavelength=420.0)
    vertices, faces = thinned(field.surface(), N_NEURON)
    nearest = np.argmin([away(each, vertices + field.low) for each in tubes], axis=0)
    of_tube = np.array(["soma", *["shaft"] * len(dendrites), "axon"])
    parts = np.where(shafts.beyond(vertices), "spine", of_tube[nearest]).tolist()
    vertices = NEURON_SCALE * (vertices + field.low) + ORIGIN  # the soma is at ORIGIN
    print(f"neuron: {n_spines} spines, {len(vertices)} vertices, {len(faces)} faces")
    return vertices, faces, parts


def away(tube: Tube, points: Array) -> Array:
    """Return the distances of points from the surface of a tube."""
    distances, at = cKDTree(tube.points).query(points)
    return np.asarray(distances - tube.radii[at])


def make_cow() -> tuple[Array, npt.NDArray[np.int64]]:
    """Return a cow: trunk, neck, head, horns, ears, legs, udder and tail, mm, symmetric in y."""

    def limb(*points: tuple[float, float, float, float]) -> Tube:
        """Return a smooth tube through points with their radii, (x, y, z, radius)."""
        given = np.array(points)
        at, dense = np.arange(len(given)), np.linspace(0.0, len(given) - 1.0, 12 * len(given))
        smooth = make_interp_spline(at, given, k=min(3, len(given) - 1))(dense)
        return Tube(smooth[:, :3], smooth[:, 3])

    front = ((1330, 190, -60, 170), (1350, 190, -420, 90), (1330, 190, -760, 60),
             (1350, 190, -960, 80))  # fmt: skip
    hind = ((120, 190, -40, 210), (60, 200, -420, 110), (-20, 200, -700, 65), (10, 200, -960, 80))
    ear = ((1790, 130, 470, 55), (1760, 260, 480, 60), (1750, 360, 450, 30))
    horn = ((1850, 80, 540, 50), (1860, 170, 640, 40), (1900, 190, 760, 22))
    pairs = [
        limb(*((x, side * y, z, radius) for x, y, z, radius in points))
        for side in (-1.0, 1.0)
        for points in (front, hind, ear, horn)
    ]
    trunk = limb((0, 0, 40, 320), (450, 0, -20, 380), (950, 0, -30, 390), (1400, 0, 20, 300))
    neck = limb((1400, 0, 90, 270), (1680, 0, 270, 180), (1850, 0, 400, 160))
    head = limb((1850, 0, 410, 165), (2050, 0, 320, 135), (2270, 0, 180, 105))
    udder = limb((330, 0, -350, 150), (430, 0, -370, 150))
    tail = limb((-270, 0, 220, 50), (-420, 0, 60, 35), (-440, 0, -350, 32), (-430, 0, -600, 60))
    tubes = [trunk, neck, head, udder, tail, *pairs]
    corners = np.concatenate([tube.points for tube in tubes])
    field = Field(corners.min(axis=0) - 600.0, corners.max(axis=0) + 600.0, COW_SPACING)
    for tube in tubes:
        field.add(tube, blend=0.35 * tube.radii.max())
    vertices, faces = thinned(field.surface(), N_COW)
    print(f"cow: {len(vertices)} vertices, {len(faces)} faces")
    return vertices + field.low, faces


def make_sphere() -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the unit sphere, whose eigenvalues are l (l + 1), each 2 l + 1 times."""
    ball = pv.Icosphere(radius=1.0, nsub=5)
    return np.asarray(ball.points, dtype=float), ball.faces.reshape(-1, 4)[:, 1:].astype(np.int64)


def grow_spines(
    rng: np.random.Generator, field: Field, tubes: list[tuple[Tube, int]], density: float
) -> int:
    """Add at most `density` spines per µm to tubes after their `bare` points; return the number."""
    n_spines = 0
    for tube, bare in tubes:
        # Spines at random places are left out if they would touch others.
        length = 40.0 * (len(tube.points) - bare)
        for _ in range(round(length / 1000.0 * density)):
            at = int(rng.integers(bare + 12, len(tube.points) - 4))
            tangent = tube.tangents[at]
            outward = rng.standard_normal(3)
            outward = unit_vector(outward - (outward @ tangent) * tangent)
            base = tube.points[at] + tube.radii[at] * outward
            spine = make_spine(rng, base, outward, tangent, tube.radii[at])
            reach = np.linalg.norm(spine.neck.points - spine.neck.points[0], axis=1)
            beyond = reach - 0.6 * tube.radii[at] - 160.0
            # A neck starts at the shaft; farther out it keeps a distance from membranes.
            neck_free = field.at(spine.neck.points) - spine.neck.radii
            head_free = field.at(spine.centres) - spine.radii
            crowded = (neck_free < np.minimum(beyond, 170.0) - 60.0)[beyond > 0.0]
            if crowded.any() or (head_free < min(beyond[-1], 150.0) - 60.0).any():
                continue
            field.add(spine.neck, blend=110.0)
            for centre, radius in zip(spine.centres, spine.radii, strict=True):
                field.add(Tube(np.stack([centre, centre + 1.0]), np.full(2, radius)), blend=90.0)
            n_spines += 1
    return n_spines


def thinned(surface: pv.PolyData, n_vertices: int) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the largest part of a contour, smoothed, with about `n_vertices` vertices."""
    surface = surface.connectivity("largest").smooth_taubin(n_iter=12, pass_band=0.12)
    surface = surface.decimate(
        1.0 - n_vertices / surface.n_points, volume_preservation=True
    ).smooth_taubin(n_iter=6, pass_band=0.25)
    # The faces of the contour are reversed, so that normals point outwards.
    faces = surface.faces.reshape(-1, 4)[:, [1, 3, 2]].astype(np.int64)
    return np.asarray(surface.points, dtype=float), faces


def make_two_components() -> tuple[Array, npt.NDArray[np.int64]]:
    """Return a ball with a hole and an edge of three faces, and a separate small ball, nm."""
    ball = pv.Icosphere(radius=900.0, nsub=3)
    vertices = np.asarray(ball.points, dtype=float)
    faces = ball.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    top = vertices[faces].mean(axis=1)[:, 2].argsort()[-6:]
    faces = np.delete(faces, top, axis=0)
    # A third face on one edge, as segmentations have where two membranes touch.
    a, b = faces[0, :2]
    tip = vertices[[a, b]].mean(axis=0) * 1.4
    faces = np.concatenate([faces, [[a, b, len(vertices)]]])
    vertices = np.concatenate([vertices, tip[None]])
    small = pv.Icosphere(radius=250.0, nsub=1)
    faces = np.concatenate([faces, small.faces.reshape(-1, 4)[:, 1:] + len(vertices)])
    vertices = np.concatenate([vertices, np.asarray(small.points) + np.array([1800.0, 300.0, 0.0])])
    return vertices + ORIGIN, faces


def save(
    name: str,
    vertices: Array,
    faces: Faces,
    parts: list[str] | None = None,
    unit: str = "nm",
    resolution: float = RESOLUTION,
) -> None:
    """Write a mesh, compressed, and the labels of its parts to the package."""
    # Vertices close in space become close in the file, which halves the size of the faces.
    order = np.lexsort(np.floor(vertices.T / (1200.0 * resolution)))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[faces]
    # Every triangle starts at its lowest index, orientation kept, and triangles are sorted.
    turn = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turn, axis=1)
    faces = faces[np.lexsort(faces.T[::-1])]
    path = SAMPLES / f"{name}.npz"
    np.savez_compressed(
        path,
        vertices=(np.round(vertices[order] / resolution) * resolution).astype(np.float32),
        faces=faces.astype(np.int32),
        # The unit is stored as in exports of the package, so that reading needs no option.
        meta=np.array(json.dumps({"mesh": {"name": name, "unit": unit}})),
    )
    print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")
    if parts is not None:
        save_labels(name, np.array(parts)[order])


def save_labels(name: str, parts: npt.NDArray[np.str_]) -> None:
    """Write the labels of the vertices of a mesh to the package, as `write_labels` does."""
    names = [each for each in PARTS if each in parts]
    numbers = np.arange(1, len(names) + 1)
    np.savez_compressed(
        SAMPLES / f"{name}_labels.npz",
        labels=(np.array([names.index(part) for part in parts]) + 1).astype(np.int8),
        label_numbers=numbers,
        label_names=np.array(names),
        label_colors=np.array([PARTS[each] for each in names]),
    )


if __name__ == "__main__":
    SAMPLES.mkdir(exist_ok=True)
    save("dendrite", *make_dendrite())
    save("neuron", *make_neuron())
    save("cow", *make_cow(), unit="mm", resolution=0.25)
    save("sphere", *make_sphere(), unit="", resolution=2.0**-20)
    save("two_components", *make_two_components())

"""Camera with a parallel projection, default and standard views, and the arrays for VTK."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.structures import brain_side

#: Approximate number of vertices to which a view is fitted; 100,000 would take 7 ms.
SAMPLED = 50_000
#: Upward direction in brain coordinates.
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Margins:
    """Widths, in pixels, of the margins of a picture that a fitted mesh does not cover."""

    left: float = 0.0
    right: float = 0.0
    top: float = 0.0
    bottom: float = 0.0


@dataclass(frozen=True, eq=False)
class View:
    """Position, orientation and zoom of the camera, in mesh coordinates."""

    #: Point in the centre of the picture, about which the mesh rotates, shape (3,).
    focus: FloatArray
    #: Unit vectors to the right, up and towards the eye, as rows, shape (3, 3).
    axes: FloatArray
    #: Half of the smaller side of the picture, in the mesh's length unit.
    half_size: float

    def length_per_pixel(self, width: int, height: int) -> float:
        """Return the width of a pixel in the mesh's unit."""
        return 2.0 * self.half_size / max(min(width, height), 1)

    def to_pixels(self, points: FloatArray, width: int, height: int) -> FloatArray:
        """Return the pixels, from the lower left, to which points of shape (m, 3) are projected.

        The result has shape (m, 3): x and y in pixels, and the distance from the focal plane
        towards the eye in the mesh's unit.
        """
        # (3, 3) @ (3, m), because BLAS takes 40 times longer for (m, 3) @ (3, 3)
        seen = (self.axes @ (np.atleast_2d(points) - self.focus).T).T
        pixel = self.length_per_pixel(width, height)
        seen[:, 0] = seen[:, 0] / pixel + width / 2
        seen[:, 1] = seen[:, 1] / pixel + height / 2
        return seen

    def from_pixels(self, x: float, y: float, width: int, height: int) -> FloatArray:
        """Return the point of the focal plane at a pixel, counted from the lower left."""
        pixel = self.length_per_pixel(width, height)
        across, along = (x - width / 2) * pixel, (y - height / 2) * pixel
        return np.asarray(self.focus + across * self.axes[0] + along * self.axes[1])

    def turned(self, right: float, up: float, roll: float = 0.0) -> View:
        """Return the view of the mesh rotated right, up and counterclockwise; angles in radians."""
        axes = self.axes
        for axis, angle in ((1, -right), (0, up), (2, -roll)):
            turn, (i, j) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
            turn[i, i] = turn[j, j] = np.cos(angle)
            turn[i, j], turn[j, i] = np.sin(angle), -np.sin(angle)
            axes = turn @ axes
        u, _, vt = np.linalg.svd(axes)  # removes rounding errors, which accumulate over rotations
        return replace(self, axes=u @ vt)

    def towards(self, other: View, share: float) -> View:
        """Return the interpolation of this view (`share` 0) and another view (`share` 1)."""
        from scipy.spatial.transform import Rotation  # slow to import

        turn = Rotation.from_matrix(other.axes @ self.axes.T).as_rotvec()
        return View(
            (1.0 - share) * self.focus + share * other.focus,
            Rotation.from_rotvec(share * turn).as_matrix() @ self.axes,
            self.half_size ** (1.0 - share) * other.half_size**share,
        )

    def moved(self, dx: float, dy: float, width: int, height: int) -> View:
        """Return the view of the mesh shifted by `dx` pixels to the right and `dy` pixels up."""
        pixel = self.length_per_pixel(width, height)
        return replace(self, focus=self.focus - pixel * (dx * self.axes[0] + dy * self.axes[1]))

    def zoomed(self, factor: float, x: float, y: float, width: int, height: int) -> View:
        """Return the view magnified by a factor about the pixel (x, y)."""
        fixed = self.from_pixels(x, y, width, height)
        focus = fixed + (self.focus - fixed) / factor
        return replace(self, focus=focus, half_size=self.half_size / factor)

    def mirrored(self, centre: FloatArray) -> View:
        """Return the view of the mesh reflected in the plane through `centre` with constant x."""
        flip = np.array([-1.0, 1.0, 1.0])
        # also negate the first axis, so that the axes stay right-handed
        axes = self.axes * flip * flip[:, np.newaxis]
        return replace(self, focus=centre + flip * (self.focus - centre), axes=axes)

    def to_json(self) -> dict[str, Any]:
        """Return the view as lists and numbers."""
        return {
            "focus": self.focus.tolist(),
            "axes": self.axes.tolist(),
            "half_size": float(self.half_size),
        }

    @classmethod
    def from_json(cls, state: dict[str, Any]) -> View:
        """Return the view of a dictionary made by `to_json`; raise ValueError if it is invalid."""
        try:
            focus = np.array(state["focus"], dtype=np.float64)
            axes = np.array(state["axes"], dtype=np.float64)
            half_size = float(state["half_size"])
        except (KeyError, TypeError) as error:
            raise ValueError("a camera needs focus, axes and half_size") from error
        orthonormal = axes.shape == (3, 3) and np.allclose(axes @ axes.T, np.eye(3), atol=1e-6)
        finite = focus.shape == (3,) and bool(np.isfinite(focus).all())
        if not (orthonormal and finite and 0.0 < half_size < np.inf):
            raise ValueError("a camera's axes are orthonormal and its numbers finite")
        return cls(focus, axes, half_size)


def _sampled_triangles(mesh: Mesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners, shape (m, 3, 3), normals and areas of a sample of about 50,000 faces.

    The length of a normal is twice the area of its face.
    """
    corners = mesh.vertices[mesh.faces[:: max(1, mesh.n_faces // 50_000)]]
    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    return corners, normals, 0.5 * np.linalg.norm(normals, axis=1)


def _compactness(mesh: Mesh) -> float:
    """Return the isoperimetric quotient 36 pi V² / A³: 1 for a ball, near 0 for a neurite."""
    corners, normals, areas = _sampled_triangles(mesh)
    area = float(areas.sum())
    volume = float(np.einsum("ij,ij->", corners[:, 0] - corners[0, 0], normals)) / 6.0
    share = len(corners) / mesh.n_faces
    return 36.0 * np.pi * volume**2 / area**3 * share if area > 0.0 else 0.0


def _stands_on(mesh: Mesh, axis: int) -> bool:
    """Return whether the mesh has a flat base: over 2 % of the area at the low end of an axis."""
    corners, _, areas = _sampled_triangles(mesh)
    top = corners[:, :, axis].max(axis=1)
    low, high = float(corners[:, :, axis].min()), float(top.max())
    return bool(areas[top < low + 0.01 * (high - low)].sum() > 0.02 * areas.sum())


def sampled_points(mesh: Mesh) -> FloatArray:
    """Return a sample of at most 2 `SAMPLED` vertices used by faces, shape (m, 3)."""
    points = mesh.vertices[mesh.referenced]
    return np.asarray(points[:: max(1, len(points) // SAMPLED)])


def default_axes(mesh: Mesh, points: FloatArray | None = None) -> FloatArray:
    """Return right, up and eye directions of the default view of a mesh, as rows, shape (3, 3).

    - A hemisphere of a brain is seen from its outer side.
    - A neuron, which fills little of its box, has its longest principal axis along the width of
      the picture and its shortest towards the eye.
    - Other meshes have y up, or z up (see `upright_axis`), and are rotated by 30 degrees to show
      depth.

    `points` are the mesh's `sampled_points`.
    """
    if hemisphere := brain_side(mesh.structure, mesh.name):
        outside = np.array([1.0 if hemisphere == "right" else -1.0, 0.0, 0.0])
        return np.array([np.cross(_UP, outside), _UP, outside])
    points = sampled_points(mesh) if points is None else points
    if mesh.unit in ("nm", "µm") or _compactness(mesh) < 0.01:
        centred = points - points.mean(axis=0)
        scale = np.abs(centred).max() or 1.0
        _, _, principal = np.linalg.svd(np.cov((centred / scale).T))
        right, up = (_signed(axis) for axis in principal[:2])
        return np.array([right, up, np.cross(right, up)])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    up_axis = upright_axis(mesh, extent)
    flat = [axis for axis in range(3) if axis != up_axis]
    eye_axis = min(flat, key=lambda axis: extent[axis])
    if extent[eye_axis] > 0.6 * max(extent[axis] for axis in flat):
        eye_axis = flat[1]  # similar extents: seen from +z if y is up, from -y if z is up
    middle = (low[eye_axis] + high[eye_axis]) / 2
    front = -1.0 if (up_axis, eye_axis) == (2, 1) else 1.0
    # a mesh on one side of the origin is half of an object: its outer side is shown
    side = np.sign(middle) if abs(middle) > 0.2 * extent[eye_axis] else front
    up, eye = np.eye(3)[up_axis], side * np.eye(3)[eye_axis]
    view = View(np.zeros(3), np.array([np.cross(up, eye), up, eye]), 1.0)
    return view.turned(np.radians(30.0), 0.0).turned(0.0, np.radians(12.0)).axes


def upright_axis(mesh: Mesh, extent: FloatArray) -> int:
    """Return the upward axis: z (2) for a mesh in mm, or tall on a flat base; otherwise y (1)."""
    tall = extent[2] > 1.15 * max(extent[0], extent[1]) and _stands_on(mesh, 2)
    return 2 if mesh.unit == "mm" or tall else 1


def _signed(axis: FloatArray) -> FloatArray:
    """Return the vector, negated if its component of largest magnitude is negative."""
    return axis * (1.0 if axis[np.argmax(np.abs(axis))] > 0.0 else -1.0)


def fitted_view(
    points: FloatArray, axes: FloatArray, width: int, height: int, margins: Margins
) -> View:
    """Return the view with given axes in which points, shape (m, 3), fit between the margins."""
    centre = points[0]
    seen = axes @ (points - centre).T
    low, high = seen.min(axis=1), seen.max(axis=1)
    free_width = max(width - margins.left - margins.right, 0.3 * width)
    free_height = max(height - margins.top - margins.bottom, 0.3 * height)
    extent = np.maximum(high - low, 1e-12 * max(float(np.abs(points).max()), 1e-300))
    pixel = max(extent[0] / free_width, extent[1] / free_height)
    focus = centre + ((low + high) / 2) @ axes
    view = View(focus, axes, pixel * min(width, height) / 2)
    return view.moved(
        (margins.left - margins.right) / 2, (margins.bottom - margins.top) / 2, width, height
    )


#: Axis and sign of the direction from which a mesh, except a left hemisphere, is seen.
DIRECTIONS = {
    "lateral": (0, 1.0),
    "medial": (0, -1.0),
    "anterior": (1, 1.0),
    "posterior": (1, -1.0),
    "dorsal": (2, 1.0),
    "ventral": (2, -1.0),
}


def view_label(name: str, mesh: Mesh | None) -> str:
    """Return the label of a key of `DIRECTIONS`: "Lateral" for a hemisphere, else "From +x"."""
    side = None if mesh is None else brain_side(mesh.structure, mesh.name)
    axis, sign = DIRECTIONS[name]
    if side is None:
        return f"From {'+' if sign > 0.0 else '-'}{'xyz'[axis]}"
    if side == "" and axis == 0:
        return "From the right" if sign > 0.0 else "From the left"
    return name.capitalize()


def view_axes(name: str, mesh: Mesh) -> FloatArray:
    """Return right, up and eye directions for a key of `DIRECTIONS`, as rows, shape (3, 3)."""
    side = brain_side(mesh.structure, mesh.name)
    axis, sign = DIRECTIONS[name]
    if side == "left" and axis == 0:
        sign = -sign
    upright = 2 if side is not None else upright_axis(mesh, np.ptp(mesh.bounds, axis=0))
    eye = sign * np.eye(3)[axis]
    up = np.eye(3)[upright if axis != upright else 1]
    if axis == upright == 1:
        up = -sign * np.eye(3)[2]  # from above, the front is below
    return np.array([np.cross(up, eye), up, eye])


@dataclass(frozen=True, eq=False)
class Geometry:
    """Arrays for VTK, and the data of the default view."""

    #: Centre of the bounding box, in mesh coordinates.
    centre: FloatArray
    #: Vertices relative to `centre`, shape (n, 3), so that single precision is sufficient.
    points: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    #: Bounding box of `points`, shape (2, 3).
    bounds: FloatArray
    #: `sampled_points`.
    sample: FloatArray
    #: `default_axes`.
    axes: FloatArray


def geometry_of(mesh: Mesh) -> Geometry:
    """Return the geometry of a mesh, computed once.

    The first call takes tenths of a second for a million vertices; call it in a thread.
    """
    known = mesh.derived.get((Geometry, mesh.unit))
    if known is None:
        others = (each for each in list(mesh.derived.values()) if isinstance(each, Geometry))
        same = next(others, None)
        if same is None:
            known = _new_geometry(mesh)
        else:
            known = replace(same, axes=default_axes(mesh, same.sample))
        mesh.derived[Geometry, mesh.unit] = known
    return known


def drawn_points(
    mesh: Mesh, vertices: FloatArray, centre: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return the positions of the vertices relative to a centre, shape (n, 3).

    Unreferenced vertices are not drawn. They are moved into the bounds of the surface, because
    their positions may be outside the range of single precision.
    """
    if len(unused := mesh.unreferenced):
        vertices = vertices.copy()
        vertices[unused] = np.clip(vertices[unused], *mesh.bounds)
    return (vertices - centre).astype(np.float32)


def _new_geometry(mesh: Mesh) -> Geometry:
    sample = sampled_points(mesh)
    centre = (sample.min(axis=0) + sample.max(axis=0)) / 2
    points = drawn_points(mesh, mesh.vertices, centre)
    faces, bounds = mesh.faces.astype(np.int32), mesh.bounds - centre
    return Geometry(centre, points, faces, bounds, sample, default_axes(mesh, sample))

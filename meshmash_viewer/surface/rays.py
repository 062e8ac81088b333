"""Intersections of rays with a mesh, and clipping planes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.progress import CancelCallback, check_cancelled

#: Number of boxes whose faces are tested first; each time twice as many are tested next.
_OPENED = 4
#: Relative margins of boxes and of faces, so that no ray passes between neighbours.
_BOX_MARGIN, _FACE_MARGIN = 1e-6, 1e-9
#: Sine of the angle up to which rays count as parallel; the boxes' margins are larger.
_PARALLEL = 1e-9


@dataclass(frozen=True, eq=False)
class Plane:
    """Clipping plane ``normal @ x == level``; the unit normal points to the kept side."""

    normal: FloatArray
    level: float

    def seen_from(self, origin: FloatArray) -> Plane:
        """Return the plane in coordinates relative to an origin."""
        return Plane(self.normal, self.level - float(self.normal @ origin))

    def away(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
        """Return a mask of the points, shape (n, 3), that are cut away, shape (n,)."""
        return np.asarray(points @ self.normal.astype(points.dtype) < self.level)

    def kept(self, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the ends of the kept part of a line segment; None if nothing is kept."""
        first, last = (float(self.normal @ each) - self.level for each in (start, end))
        if first < 0.0 and last < 0.0:
            return None
        crossing = start + (first / (first - last) if first != last else 0.0) * (end - start)
        return (crossing if first < 0.0 else start), (crossing if last < 0.0 else end)


@dataclass(frozen=True, eq=False)
class Hit:
    """Intersection of a ray with a face; `point` has shape (3,)."""

    face: int
    point: FloatArray


class _Projected(NamedTuple):
    """Projection of bounding boxes to a plane: axes (2, 3), centres and half sizes (2, g).

    Centres are relative to the centre of the mesh, for which single precision is sufficient.
    """

    across: FloatArray
    middle: npt.NDArray[np.float32]
    half: npt.NDArray[np.float32]


class RayTarget:
    """Search structure for intersections of rays with a mesh.

    Faces are sorted along a space-filling curve and divided into groups of √m / 16. A ray is tested
    against the bounding boxes of all groups, projected along the ray, then against the faces in the
    boxes that it crosses, the nearest first: half a millisecond at a million vertices. The
    structure takes four bytes a face, and is built without the interpreter lock; VTK's static
    locator takes 60 bytes, and keeps the lock for half a second at a million vertices.

    Points, shape (n, 3), and faces, shape (m, 3), are not copied. `Cancelled` is raised if `cancel`
    returns True.
    """

    def __init__(
        self,
        points: npt.NDArray[np.floating],
        faces: npt.NDArray[np.integer],
        cancel: CancelCallback | None = None,
    ) -> None:
        self._points = points
        self._faces = faces
        self._group = max(16, int(np.sqrt(len(faces)) / 16.0))
        starts = np.arange(0, len(faces), self._group)
        self._low, self._high = np.empty((2, 3, len(starts)))
        #: Largest diagonal of the bounding box of a face, in each group.
        self._largest = np.zeros(len(starts))
        self._order = np.zeros(0, dtype=np.int32)
        self._size, self._centre = 1.0, np.zeros(3)
        self._projected: _Projected | None = None
        if len(faces) == 0:
            return
        # integers of 32 bits are sorted in half the time
        key = curve_order(points)[faces[:, 0]].astype(np.uint32)
        self._order = np.argsort(key).astype(np.int32)
        ordered = faces[self._order]
        diagonal = np.zeros(len(faces), dtype=np.float32)
        for axis in range(3):
            check_cancelled(cancel)
            corners = points[:, axis][ordered]
            low, high = corners.min(axis=1), corners.max(axis=1)
            self._low[axis] = np.minimum.reduceat(low, starts)
            self._high[axis] = np.maximum.reduceat(high, starts)
            diagonal = np.hypot(diagonal, high - low)  # squares could overflow
        self._largest = np.maximum.reduceat(diagonal, starts)
        lowest, highest = self._low.min(axis=1), self._high.max(axis=1)
        extent = highest - lowest
        self._centre = (lowest + highest) / 2.0
        self._size = float(np.linalg.norm(extent)) or 1.0
        margin = _BOX_MARGIN * float(extent.max())
        self._low -= margin
        self._high += margin

    def seen_vertex(
        self, through: FloatArray, towards_eye: FloatArray, cut: Plane | None = None
    ) -> int:
        """Return the vertex nearest to the first hit on a line of sight; -1 without a hit.

        The line passes through a point; `towards_eye` is the unit vector towards the eye. Parts
        that are cut away are ignored.
        """
        reach = (float(np.linalg.norm(through)) + self._size) * towards_eye
        hit = self.first_hit(through + reach, through - reach, cut)
        if hit is None:
            return -1
        corners = self._faces[hit.face]
        distance = ((self._points[corners] - hit.point) ** 2).sum(axis=1)
        if cut is not None:
            distance[cut.away(self._points[corners])] = np.inf
        return int(corners[np.argmin(distance)])

    def hidden(self, vertex: int, towards_eye: FloatArray, cut: Plane | None = None) -> bool:
        """Whether a part of the mesh is between a vertex and the eye."""
        # start in front of the vertex, so that adjacent faces are not hit
        start = self._points[vertex] + 2e-3 * self._size * towards_eye
        return self.first_hit(start, start + 2.0 * self._size * towards_eye, cut) is not None

    def corners_near(
        self, through: FloatArray, across: FloatArray, radius: float
    ) -> npt.NDArray[np.integer]:
        """Return the vertices of faces within a distance of a line, the nearest first.

        The line passes through a point, perpendicular to two unit vectors `across`, shape (2, 3).
        """
        middle, half = (self._high + self._low) / 2.0, (self._high - self._low) / 2.0
        away = np.abs(across @ (middle - through[:, None])) - np.abs(across) @ half
        groups = np.flatnonzero((away <= radius).all(axis=0))
        found = np.zeros(len(self._points), dtype=np.bool_)
        found[self._faces[self._faces_in(groups)]] = True
        corners = np.flatnonzero(found)  # several times as fast as np.unique
        squared = (((self._points[corners] - through) @ across.T) ** 2).sum(axis=1)
        order = np.argsort(squared, kind="stable")
        return corners[order[: np.count_nonzero(squared <= radius**2)]]

    def first_hit(self, start: FloatArray, end: FloatArray, cut: Plane | None = None) -> Hit | None:
        """Return the first intersection between two points, or None.

        Faces without area, and parts that are cut away, are ignored.
        """
        kept = (start, end) if cut is None else cut.kept(start, end)
        if kept is None:
            return None
        start, end = kept
        way = end - start
        near = self._near_line(start, way)
        enters = self._entries(near, start, way)
        order = np.argsort(enters, kind="stable")[: np.count_nonzero(np.isfinite(enters))]
        met, enters = near[order], enters[order]
        nearest, found = np.inf, -1
        first, opened = 0, _OPENED
        while first < len(met) and enters[first] <= nearest:
            faces = self._faces_in(met[first : first + opened])
            first, opened = first + opened, 2 * opened
            shares = _shares(self._points[self._faces[faces].T], start, way)
            best = int(np.argmin(shares))
            if shares[best] < nearest:
                nearest, found = float(shares[best]), int(faces[best])
        return Hit(found, start + nearest * way) if found >= 0 else None

    def larger_faces(self, length: float) -> IntArray:
        """Return the faces that may be longer than a length, shape (k, 3), with others near them.

        All other faces fit into a box with a diagonal of this length.
        """
        chosen = self._faces_in(np.flatnonzero(self._largest > length))
        faces = np.asarray(self._faces[chosen], dtype=np.int64)
        faces.setflags(write=False)  # like those of a mesh, for which loops are compiled
        return faces

    def _faces_in(self, groups: IntArray) -> npt.NDArray[np.int32]:
        """Return the indices of the faces in groups."""
        places = groups[:, None] * self._group + np.arange(self._group)
        return np.asarray(self._order[places[places < len(self._order)]])

    def _near_line(self, start: FloatArray, way: FloatArray) -> npt.NDArray[np.intp]:
        """Return the groups whose boxes, projected along `way`, contain the point of the ray.

        The projected boxes are kept for the next ray: rays through one picture are parallel.
        """
        length = float(np.linalg.norm(way))
        if length == 0.0:
            return np.arange(self._low.shape[1])
        projected = self._projected
        if projected is None or np.abs(projected.across @ way).max() > _PARALLEL * length:
            across = np.linalg.svd(way[None] / length)[2][1:]
            middle, half = (self._high + self._low) / 2.0, (self._high - self._low) / 2.0
            projected = _Projected(
                across,
                (across @ (middle - self._centre[:, None])).astype(np.float32),
                (np.abs(across) @ half).astype(np.float32),
            )
            self._projected = projected
        place = (projected.across @ (start - self._centre)).astype(np.float32)
        away = np.abs(projected.middle - place[:, None])
        return np.flatnonzero((away[0] <= projected.half[0]) & (away[1] <= projected.half[1]))

    def _entries(
        self, groups: npt.NDArray[np.intp], start: FloatArray, way: FloatArray
    ) -> FloatArray:
        """Compute the share of `way` at which the ray enters each box, (k,); inf if missed."""
        enter, leave = np.zeros(len(groups)), np.ones(len(groups))
        least = 1e-30 * float(np.abs(way).max())
        for axis in range(3):
            # avoids division by zero for rays parallel to an axis
            speed = way[axis] if abs(way[axis]) > least else least or 1.0
            to_low = (self._low[axis, groups] - start[axis]) / speed
            to_high = (self._high[axis, groups] - start[axis]) / speed
            np.maximum(enter, np.minimum(to_low, to_high), out=enter)
            np.minimum(leave, np.maximum(to_low, to_high), out=leave)
        enter[enter > leave] = np.inf
        return enter


def _shares(corners: FloatArray, start: FloatArray, way: FloatArray) -> FloatArray:
    """Compute the share of `way` at which the ray hits each triangle, (k,); inf if missed.

    Corners have shape (3, k, 3). The method is by Möller & Trumbore (1997).
    """
    a, b, c = np.ascontiguousarray(corners.transpose(0, 2, 1), dtype=np.float64)  # (3, k) each
    first, second, offset = b - a, c - a, start[:, None] - a
    across, lift = _cross(way, second), _cross(offset, first)
    volume = _dot(first, across)
    flat = volume == 0.0
    volume[flat] = 1.0
    u, v, share = _dot(offset, across) / volume, way @ lift / volume, _dot(second, lift) / volume
    inside = (u >= -_FACE_MARGIN) & (v >= -_FACE_MARGIN) & (u + v <= 1.0 + _FACE_MARGIN)
    share[flat | ~inside | (share < 0.0) | (share > 1.0)] = np.inf
    return share


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return cross products of vectors along the first axis; faster than `np.cross` if few."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ik,ik->k", a, b))


def curve_order(points: npt.NDArray[np.floating]) -> npt.NDArray[np.int64]:
    """Return the positions of points, shape (m, 3), along a space-filling curve (Morton 1966).

    Positions are below 2³⁰: ten bits of each coordinate in the bounding cube, interleaved.
    """
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    grid = ((points - low) * (1023.0 / extent)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        spread = grid[:, axis]
        # moves the ten bits apart, with two zeros between them
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            spread = (spread | (spread << shift)) & mask
        code |= spread << axis
    return code

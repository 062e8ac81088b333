"""Triangulation of polygons, fans and strips, for all readers and for `as_mesh`."""

from __future__ import annotations

import warnings
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, distinct_corners
from meshmash_viewer.errors import InputError, MeshWarning

#: Triangles of polygons (for each two fewer than its corners), and a mask of polygons that
#: intersect themselves.
_Cut: TypeAlias = tuple[IntArray, npt.NDArray[np.bool_]]
_NONE = np.zeros(0, dtype=np.bool_)
#: Maximum number of corners for VTK, whose time grows with their square: 0.3 s for this number.
_MOST_CORNERS = 10_000
#: Rounding error of an area, relative to the area of the polygon.
_ROUNDING = 1e-9
#: Distance, relative to its edges, by which a polygon whose outline touches itself is shrunk.
_SHRINKING = 1e-4
_TINY = 1e-300
#: Coordinates for VTK, from -1 to 1, are rounded to this fraction, so that the last digits in a
#: file do not change the triangles.
_STEPS = 2.0**24
#: Corners of the triangles of a quadrilateral, by its diagonal.
_ALONG_DIAGONAL = np.array([[0, 1, 2, 0, 2, 3], [0, 1, 3, 1, 2, 3]])
#: Two triangles face opposite sides if the cosine between their normals is below minus this value.
_FLAT = 0.9
#: Relative difference of squared lengths below which diagonals are equal in single precision.
_EQUAL = 1e-6


def triangulate(vertices: FloatArray, indices: IntArray, counts: IntArray) -> IntArray:
    """Cut polygons, also concave ones, into triangles without new vertices.

    The triangles do not depend on the corner at which a polygon starts. A quadrilateral is cut
    along its shorter inner diagonal or, if both are equal, the diagonal at the lowest index; VTK
    cuts polygons with more corners. The triangles of a polygon that intersects itself have at least
    its area. Consecutive equal corners are merged, and polygons with fewer than three corners are
    left out.

    `indices` are the corners of all polygons, one polygon after the other, and `counts` the numbers
    of corners. The triangles, shape (m, 3), are in the order of the polygons. Polygons are cut into
    fans if an index is out of range or a coordinate not finite; the caller reports this fault.
    `InputError` is raised if a polygon of more than 10,000 corners is not convex, and a
    `MeshWarning` issued if polygons intersect themselves.
    """
    if len(counts) and counts.min() == 3 and counts.max() == 3:
        return indices.reshape(-1, 3)
    if not len(indices):
        return np.empty((0, 3), dtype=np.int64)
    if indices.min() < 0 or indices.max() >= len(vertices):
        return fan_triangles(indices, counts)
    if not (np.isfinite(vertices).all() or np.isfinite(vertices[indices]).all()):
        return fan_triangles(indices, counts)
    indices, counts = _without_repeats(indices, counts)
    many = np.maximum(counts - 2, 0)
    triangles = np.empty((int(many.sum()), 3), dtype=np.int64)
    crossing = 0
    with np.errstate(over="ignore", invalid="ignore"):  # `Mesh` refuses such coordinates
        for least, most, cut in (
            (3, 3, _unchanged),
            (4, 4, _halves),
            (5, _MOST_CORNERS, _pieces),
            (_MOST_CORNERS + 1, len(indices), _convex_fans),
        ):
            chosen = (counts >= least) & (counts <= most)
            if chosen.any():
                corners = indices[np.repeat(chosen, counts)]
                triangles[np.repeat(chosen, many)], crosses = cut(vertices, corners, counts[chosen])
                crossing += int(np.count_nonzero(crosses))
    if crossing:
        cross = "polygon intersects itself" if crossing == 1 else "polygons intersect themselves"
        text = f"{crossing:,} {cross}: the triangles overlap there, and have too large an area"
        warnings.warn(text, MeshWarning, stacklevel=2)
    return np.asarray(triangles[distinct_corners(triangles) | np.repeat(counts == 3, many)])


def fan_triangles(indices: IntArray, counts: IntArray) -> IntArray:
    """Cut polygons into triangles at their first corner; for arguments see `triangulate`."""
    start, step = _runs_of_three(counts)
    places = np.column_stack([start, start + step + 1, start + step + 2])
    return indices[places].astype(np.int64)


def strip_triangles(indices: IntArray, counts: IntArray) -> IntArray:
    """Return the triangles of strips, each oriented as the first triangle of its strip.

    Triangles with a repeated vertex, which join parts of a strip, are left out. For arguments see
    `triangulate`.
    """
    start, step = _runs_of_three(counts)
    first, odd = start + step, step % 2
    triangles = indices[np.column_stack([first + odd, first + 1 - odd, first + 2])]
    return triangles[distinct_corners(triangles)].astype(np.int64)


def _runs_of_three(counts: IntArray) -> tuple[IntArray, IntArray]:
    """Return the place of the first corner of each triangle's polygon, and the triangle's index."""
    many = np.maximum(counts - 2, 0)
    start = np.repeat(np.cumsum(counts) - counts, many)
    step = np.arange(len(start)) - np.repeat(np.cumsum(many) - many, many)
    return start, step


def polydata_triangles(poly: Any) -> tuple[FloatArray, IntArray]:
    """Return the vertices of a ``vtkPolyData``, and the triangles of its polygons and strips.

    `InputError` is raised as by `triangulate`, and if the corners of its cells overlap.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    convert: Any = vtk_to_numpy
    points = poly.GetPoints()
    vertices = np.empty((0, 3)) if points is None else convert(points.GetData())
    vertices = vertices.astype(np.float64)
    triangles = [np.empty((0, 3), dtype=np.int64)]
    for cells, are_strips in ((poly.GetPolys(), False), (poly.GetStrips(), True)):
        if not cells.GetNumberOfCells():
            continue
        offsets = convert(cells.GetOffsetsArray()).astype(np.int64)
        corners = convert(cells.GetConnectivityArray()).astype(np.int64)
        counts = np.diff(offsets)
        if offsets[0] < 0 or offsets[-1] > len(corners) or counts.min() < 0:
            raise InputError("no-faces", "Corners of cells overlap or end beyond the last")
        corners = corners[offsets[0] : offsets[-1]]
        triangles.append(
            strip_triangles(corners, counts)
            if are_strips
            else triangulate(vertices, corners, counts)
        )
    return vertices, np.concatenate(triangles)


def _unchanged(_: FloatArray, indices: IntArray, __: IntArray) -> _Cut:
    return indices.reshape(-1, 3), _NONE


def _halves(vertices: FloatArray, indices: IntArray, _: IntArray) -> _Cut:
    corners = indices.reshape(-1, 4)
    order = (corners.argmin(axis=1)[:, None] + np.arange(4)) % 4
    corners = np.take_along_axis(corners, order, axis=1)
    first = vertices[corners[:, 0]]
    one, two, three = (vertices[corners[:, corner]] - first for corner in (1, 2, 3))
    other = three - one
    normal = np.cross(two, other)  # twice the area of the whole polygon
    lower, upper = _dot(np.cross(one, two), normal), _dot(np.cross(two, three), normal)
    left = _dot(np.cross(one, three), normal)
    flatter, flatter_other = np.minimum(lower, upper), np.minimum(left, lower + upper - left)
    rounding = _ROUNDING * np.abs(lower + upper)
    both_inside = (flatter > rounding) & (flatter_other > rounding)
    is_shorter = _dot(other, other) < (1.0 - _EQUAL) * _dot(two, two)
    takes_other = np.where(both_inside, is_shorter, flatter_other > flatter + rounding)
    cut = _ALONG_DIAGONAL[takes_other.astype(np.int64)]
    # if the outline crosses itself, the halves face opposite sides for both diagonals
    crosses = _opposite(np.cross(one, two), np.cross(two, three)) & _opposite(
        np.cross(one, three), np.cross(two - one, other)
    )
    return np.take_along_axis(corners, cut, axis=1).reshape(-1, 3), crosses


def _opposite(one: FloatArray, other: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether two vectors point in nearly opposite directions."""
    lengths = np.sqrt(_dot(one, one) * _dot(other, other))
    return np.asarray(_dot(one, other) < -_FLAT * lengths)


def _convex_fans(vertices: FloatArray, indices: IntArray, counts: IntArray) -> _Cut:
    """Cut convex polygons with too many corners for VTK into fans."""
    indices = _from_lowest(indices, counts)
    triangles = fan_triangles(np.arange(len(indices)), counts)
    _, overlap = _areas(_own_coordinates(vertices[indices], counts), triangles, counts)
    if overlap.any():
        raise InputError(
            "too-many",
            f"A polygon of {counts[overlap][0]:,} corners is not convex",
            f"cut polygons of more than {_MOST_CORNERS:,} in the program that wrote them",
        )
    return indices[triangles], _NONE


def _pieces(vertices: FloatArray, indices: IntArray, counts: IntArray) -> _Cut:
    """Cut polygons with more than four corners."""
    indices = _from_lowest(indices, counts)
    points = _own_coordinates(vertices[indices], counts)
    triangles, areas, overlap = _tried(points, counts, 0.0)
    crosses = overlap.copy()
    # Shrinking separates an outline that touches itself, as at the cut to a hole; growing separates
    # an outline that touches itself at a single corner.
    for shrinking in (_SHRINKING, -_SHRINKING):
        if overlap.any():
            corners = np.flatnonzero(np.repeat(overlap, counts))
            again, again_areas, still = _tried(points[corners], counts[overlap], shrinking)
            better = again_areas < areas[overlap]
            is_better = np.zeros(len(counts), dtype=np.bool_)
            is_better[overlap] = better
            of_better = np.repeat(better, counts[overlap] - 2)
            triangles[np.repeat(is_better, counts - 2)] = corners[again[of_better]]
            crosses[overlap] &= ~better | still
    return indices[triangles], crosses


def _tried(
    points: FloatArray, counts: IntArray, shrinking: float
) -> tuple[IntArray, FloatArray, npt.NDArray[np.bool_]]:
    """Cut shrunk outlines with VTK, or into fans if VTK fails; return triangles and `_areas`."""
    triangles = fan_triangles(np.arange(len(points)), counts)
    outline = np.round(_shrunk(points, counts, shrinking) * _STEPS) / _STEPS
    cut, is_whole = _cut_by_vtk(outline, counts)
    triangles[np.repeat(is_whole, counts - 2)] = cut
    return triangles, *_areas(points, triangles, counts)


def _own_coordinates(points: FloatArray, counts: IntArray) -> FloatArray:
    """Move and scale the corners of each polygon to between -1 and 1."""
    starts = np.cumsum(counts) - counts
    points = points - np.repeat(points[starts], counts, axis=0)
    size = np.maximum.reduceat(np.abs(points).max(axis=1), starts)
    points /= np.repeat(np.where(size > 0.0, size, 1.0), counts)[:, None]
    return np.where(np.isfinite(points), points, 0.0)


def _outline_normals(points: FloatArray, counts: IntArray) -> FloatArray:
    """Return the normal of each polygon, twice its area long, shape (p, 3)."""
    starts = np.cumsum(counts) - counts
    return np.add.reduceat(np.cross(points, points[_next_corners(counts)]), starts, axis=0)


def _areas(
    points: FloatArray, triangles: IntArray, counts: IntArray
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return twice the area of the triangles of each polygon, and whether they overlap, (p,)."""
    which = np.repeat(np.arange(len(counts)), counts - 2)
    outlines = _outline_normals(points, counts)
    a, b, c = (points[corners] for corners in triangles.T)
    normals = np.cross(b - a, c - a)
    areas = np.bincount(which, np.linalg.norm(normals, axis=1), len(counts)).astype(np.float64)
    along = np.bincount(which, np.abs(_dot(normals, outlines[which])), len(counts))
    whole = _dot(outlines, outlines)
    return areas, np.asarray(along > (1.0 + _ROUNDING) * whole + _ROUNDING * np.sqrt(whole))


def _shrunk(points: FloatArray, counts: IntArray, share: float) -> FloatArray:
    """Move each corner inwards by a share of its shorter edge."""
    if not share:
        return points
    following = _next_corners(counts)
    edges = points[following] - points
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    normals = _outline_normals(points, counts)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), _TINY)
    inwards = np.cross(np.repeat(normals, counts, axis=0), edges) / np.maximum(lengths, _TINY)
    before = np.empty_like(following)
    before[following] = np.arange(len(following))
    step = share * np.minimum(lengths, lengths[before])
    return np.asarray(points + step * (inwards + inwards[before]))


def _cut_by_vtk(points: FloatArray, counts: IntArray) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Cut polygons with VTK; return triangles of completely cut polygons, and their mask."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    vtk: Any = numpy_support
    # VTK does not copy these arrays: they have to exist until the filter has run.
    offsets, corners = np.append(0, np.cumsum(counts)), np.arange(len(points))
    number = np.arange(len(counts))
    places, cells, poly, cutter = vtkPoints(), vtkCellArray(), vtkPolyData(), vtkTriangleFilter()
    places.SetData(vtk.numpy_to_vtk(points))
    cells.SetData(vtk.numpy_to_vtk(offsets), vtk.numpy_to_vtk(corners))
    poly.SetPoints(places)
    poly.SetPolys(cells)
    poly.GetCellData().SetScalars(vtk.numpy_to_vtk(number))
    cutter.SetInputData(poly)
    cutter.Update()
    output = cutter.GetOutput()
    if not output.GetNumberOfPolys():
        return np.empty((0, 3), dtype=np.int64), np.zeros(len(counts), dtype=np.bool_)
    triangles = vtk.vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    which = vtk.vtk_to_numpy(output.GetCellData().GetScalars())
    is_whole = np.bincount(which, minlength=len(counts)) == counts - 2
    return triangles[is_whole[which]].astype(np.int64), is_whole


def _without_repeats(indices: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Merge consecutive equal corners of polygons with more than three corners."""
    repeats = (indices == indices[_next_corners(counts)]) & np.repeat(counts > 3, counts)
    if not repeats.any():
        return indices, counts
    polygon = np.repeat(np.arange(len(counts)), counts)
    return indices[~repeats], np.bincount(polygon[~repeats], minlength=len(counts))


def _from_lowest(indices: IntArray, counts: IntArray) -> IntArray:
    """Rotate each polygon to start at its lowest index; if repeated, before the lowest next one."""
    starts = np.cumsum(counts) - counts
    rank = indices * (int(indices.max()) + 1) + indices[_next_corners(counts)]
    is_lowest = rank == np.repeat(np.minimum.reduceat(rank, starts), counts)
    polygon = np.repeat(np.arange(len(counts)), counts)
    places = np.flatnonzero(is_lowest)
    _, first = np.unique(polygon[places], return_index=True)
    step = np.arange(len(indices)) + np.repeat(places[first] - 2 * starts, counts)
    turned: IntArray = indices[starts[polygon] + step % counts[polygon]]
    return turned


def _next_corners(counts: IntArray) -> IntArray:
    """Return the place of the next corner of the same polygon, for each corner."""
    following = np.arange(1, int(counts.sum()) + 1)
    some = counts[counts > 0]
    ends = np.cumsum(some)
    following[ends - 1] = ends - some
    return following


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))

"""Regions, the connected parts of labels, and their measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, exact_array
from meshmash_viewer.errors import InputError, other_mesh, unknown
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.surface.curvature import neck_widths
from meshmash_viewer.surface.edges import connected, edges_of, side_codes
from meshmash_viewer.units import counted, format_quantity, power_unit
from meshmash_viewer.vertex_map import LABEL_COLORS, Label, VertexMap, numbered_labels

if TYPE_CHECKING:
    from pandas import DataFrame

    from meshmash_viewer.features.points import ProjectedPoints

#: Power of the unit of length in the unit of a column.
POWERS = {"area": 2, "volume": 3}
POWERS |= dict.fromkeys(("extent", "neck_width", *"xyz"), 1)
#: Statistics of the values of a map in a region.
_OF_MAPS = ("mean", "min", "max")
#: Maximum number of labels named in a remark.
_NAMED = 4


@dataclass(frozen=True, eq=False)
class Regions:
    """A table with a row for each region; see `regions` for its columns.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (k,)
        Names for ``label``, numbers for other columns.
    rows : ndarray of int64, shape (n,)
        Row of the region of each vertex, -1 for no region.
    mesh : Mesh
    remarks : tuple of str
        Descriptions of what the table leaves out, such as vertices without a region.

    Examples
    --------
    >>> cap = mv.regions(ball, ball.vertices[:, 2] > 0.5)
    >>> cap["label"].tolist(), cap["area"].round(1), int(cap.mask(0).sum())
    (['1'], array([3.2]), 165)
    >>> cap.remarks
    ('477 vertices without a label.',)
    """

    columns: dict[str, npt.NDArray[Any]]
    rows: IntArray
    mesh: Mesh
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.columns["label"])

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Return the values of a column, shape (k,)."""
        if column not in self.columns:
            raise unknown("column", column, self.columns)
        return self.columns[column]

    def mask(self, row: int) -> npt.NDArray[np.bool_]:
        """Return whether each vertex is in the region of a row, shape (n,)."""
        return np.asarray(self.rows == row)

    def unit_of(self, column: str) -> str:
        """Return the unit of a column, such as "nm²"; "" for none."""
        named = {f"{what} {each.name}": each.unit for each in self.mesh.maps for what in _OF_MAPS}
        return named.get(column) or power_unit(self.mesh.unit, POWERS.get(column, 0))

    def with_points(self, found: ProjectedPoints) -> Regions:
        """Add columns of points on the mesh of the regions, see `ProjectedPoints.sums`.

        Points in no region, and points far from the mesh, are counted in the remarks.

        Examples
        --------
        >>> cap = mv.regions(ball, ball.vertices[:, 2] > 0.5, neck=False)
        >>> found = mv.project_points(ball, [[0, 0, 1.01], [0.1, 0, 1], [0, 0, -1]])
        >>> cap.with_points(found)["points"].tolist()
        [2]
        """
        if found.mesh.n_vertices != len(self.rows):
            remedy = "project them onto the mesh of the regions"
            raise other_mesh("The points", found.mesh.n_vertices, len(self.rows), remedy)
        more = found.sums(self.rows, len(self))
        said = list(self.remarks)
        if left := found.n_near - int(more["points"].sum()):
            said.append(f"{counted(left, 'point')} in no region.")
        if far := len(found) - found.n_near:
            within = format_quantity(found.max_distance, self.mesh.unit)
            said.append(f"{counted(far, 'point')} not within {within} of a vertex.")
        return replace(self, columns={**self.columns, **more}, remarks=tuple(said))

    def to_frame(self) -> DataFrame:
        """Return a pandas ``DataFrame``, with a row for each region."""
        import pandas

        return pandas.DataFrame(self.columns)


def regions(
    mesh: MeshLike,
    labels: VertexMap | npt.ArrayLike,
    maps: Sequence[VertexMap] = (),
    *,
    neck: bool = True,
    whole: bool = False,
) -> Regions:
    """Measure the connected parts of each label, or whole labels.

    A region is a connected set of faces whose three corners have the label; faces that share a
    vertex are connected. Labelled vertices in no such face are in no region; `Regions.remarks`
    counts them.

    `InputError` is raised if labels or maps are of another number of vertices, labels are neither
    whole numbers nor names, or no face has three corners with the same label.

    Parameters
    ----------
    mesh : MeshLike
    labels : VertexMap or array_like, shape (n,)
        Numbers or names; 0, False, NaN, None and "" mean no label. Labels without names are named
        by their numbers.
    maps : sequence of VertexMap
        Maps whose area-weighted mean, minimum and maximum are columns.
    neck : bool
        Whether to compute ``neck_width``.
    whole : bool
        Whether all vertices with a label are one region; ``neck_width``, which needs connected
        regions, is left out.

    Returns
    -------
    Regions
        Regions in the order of the labels, and for each label by descending area. Columns are

        ``label``, ``part``
            Name of the label, and number of its part, from 1.
        ``vertices``
            Number of vertices.
        ``area``
            A third of the area of each face for each of its corners in the region, so that faces
            between two labels are shared. In squared unit.
        ``volume``
            Volume of the region, each loop of its border closed by a fan of triangles around the
            mean of the loop's vertices; negative if faces point inwards. NaN if faces of the region
            disagree on which side is outside, or more than two faces share an edge. In cubed unit.
        ``loops``
            Number of loops that were closed for the volume; 0 for a closed surface.
        ``extent``
            The largest extent along a principal axis, in unit of the mesh.
        ``neck_width``
            Length of the shortest cut that separates the far half of the region from the rest of
            the surface, see `meshmash_viewer.surface.curvature`. NaN if there is no rest.
        ``x``, ``y``, ``z``
            Area-weighted mean position.
        ``mean NAME``, ``min NAME``, ``max NAME``
            Statistics of each map, ignoring NaN; the mean is weighted by area.

    Examples
    --------
    >>> parts = (mv.Label(1, "north", "#4477aa"), mv.Label(2, "south", "#ee6677"))
    >>> halves = mv.VertexMap("half", np.where(ball.vertices[:, 2] > 0, 1, 2), parts)
    >>> table = mv.regions(ball, halves)
    >>> table["label"].tolist(), table["loops"].tolist(), table["neck_width"].round(1)
    (['north', 'south'], [1, 1], array([5.6, 5.7]))
    """
    surface = as_mesh(mesh)
    surface = surface.with_only_maps(*maps, label_map(labels))
    *measured, known = surface.maps
    rows, numbers = _rows(surface, known, whole)
    k = len(numbers)
    inside = np.flatnonzero(rows >= 0)
    order = inside[np.argsort(rows[inside], kind="stable")]
    of_row = rows[order]
    points, areas = surface.vertices[order], surface.vertex_areas[order]
    area = np.bincount(of_row, areas, k)
    weights = np.where((area > 0.0)[of_row], areas, 1.0)  # equal weights in regions without area
    centroids = _means(points, weights, of_row, k)
    columns: dict[str, npt.NDArray[Any]] = {
        "label": np.array([known.labels[number].name for number in numbers]),
        "part": np.arange(k) - np.searchsorted(numbers, numbers) + 1,
        "vertices": np.bincount(of_row, minlength=k),
        "area": area,
    }
    volume, loops = _volumes(surface, rows, centroids)
    columns["volume"] = np.where(np.abs(volume) < 1e-12 * area**1.5, 0.0, volume)  # flat regions
    columns["loops"] = loops
    columns["extent"] = _extents(points - centroids[of_row], weights, of_row, k)
    if neck and not whole:
        columns["neck_width"] = neck_widths(surface, rows, k)
    columns |= zip("xyz", centroids.T, strict=True)
    starts = np.searchsorted(of_row, np.arange(k))
    for each in measured:
        values = each.values[order].astype(np.float64)
        has = np.isfinite(values)
        mean = _means(values[has, None], weights[has], of_row[has], k)[:, 0]
        found = mean, np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
        columns |= zip((f"{what} {each.name}" for what in _OF_MAPS), found, strict=True)
    remarks = _remarks(known, rows, columns["volume"])
    return Regions(columns, rows, replace(surface, maps=tuple(measured)), remarks)


_LABELS = "give one whole number or name per vertex"


def label_map(given: VertexMap | npt.ArrayLike) -> VertexMap:
    """Convert labels to a map with labels; numbers without names are named by themselves."""
    if isinstance(given, VertexMap) and given.labels:
        return given
    name = given.name if isinstance(given, VertexMap) else "labels"
    raw = exact_array(given.values if isinstance(given, VertexMap) else given)
    if raw.ndim == 1 and raw.dtype.kind in "UO":
        return _named_labels(name, raw)
    if raw.dtype.kind not in "biuf" or raw.ndim != 1:
        raise InputError("not-labels", f"Labels have type {raw.dtype}, shape {raw.shape}", _LABELS)
    numbers = np.nan_to_num(raw) if raw.dtype.kind == "f" else raw
    if not np.array_equal(numbers, np.rint(numbers)):
        raise InputError("not-labels", f"{name!r} has values that are no whole numbers", _LABELS)
    labels = numbered_labels(numbers)
    if not labels:
        raise InputError("no-labels", f"{name!r} has no vertex with a label, all numbers are 0")
    return VertexMap(name, numbers, labels)


def _named_labels(name: str, given: npt.NDArray[Any]) -> VertexMap:
    """Convert names, or whole numbers next to missing ones, to a map with labels."""
    known = np.array([each not in (None, "") for each in given], dtype=np.bool_)
    if all(isinstance(each, int) for each in given[known]):
        return label_map(np.where(known, given, 0).astype(np.int64))
    if not all(isinstance(each, str) for each in given[known]):
        kinds = sorted({type(each).__name__ for each in given[known]})
        raise InputError("not-labels", f"Labels have type {kinds[0]}", _LABELS)
    names, places = np.unique(given[known].astype(str), return_inverse=True)
    numbers = np.zeros(len(given), dtype=np.int64)
    numbers[known] = places + 1
    colored = zip(names.tolist(), cycle(LABEL_COLORS), strict=False)
    labels = (Label(at, text, color) for at, (text, color) in enumerate(colored, start=1))
    return VertexMap(name, numbers, tuple(labels))


def _rows(mesh: Mesh, known: VertexMap, whole: bool) -> tuple[IntArray, IntArray]:
    """Find the row of each vertex, shape (n,), and the index of the label of each row."""
    places = np.nan_to_num(known.shown, nan=-1.0).astype(np.int64)
    if whole:
        label, rows = np.unique(places, return_inverse=True)
        without = int(label[0] < 0)
        return rows - without, label[without:]
    faces = mesh.faces[_whole_faces(mesh, places)]
    if not len(faces):
        fault = f"Map {known.name!r} has no face whose three corners have the same label"
        raise InputError("no-labels", fault, "label whole faces")
    used = np.unique(faces)
    ends = np.append(faces[:, 0], faces[:, 1]), np.append(faces[:, 1], faces[:, 2])
    groups = np.unique(connected(*ends, mesh.n_vertices)[used], return_inverse=True)[1]
    area = np.bincount(groups, mesh.vertex_areas[used])
    label = np.zeros(len(area), dtype=np.int64)
    label[groups] = places[used]
    order = np.lexsort((-area, label))
    rows = np.full(mesh.n_vertices, -1, dtype=np.int64)
    rows[used] = np.argsort(order)[groups]
    return rows, label[order]


def _means(points: FloatArray, weights: FloatArray, of_row: IntArray, k: int) -> FloatArray:
    """Compute the weighted mean of the points of each row, shape (k, d); NaN without a point."""
    sums = [np.bincount(of_row, weights * axis, k) for axis in points.T]
    with np.errstate(invalid="ignore"):
        return np.stack(sums, axis=1) / np.bincount(of_row, weights, k)[:, None]


def _extents(offsets: FloatArray, weights: FloatArray, of_row: IntArray, k: int) -> FloatArray:
    """Compute the largest extent along the principal axes of each row; points are sorted by row."""
    starts = np.searchsorted(of_row, np.arange(k))
    products = (weights[:, None] * offsets)[:, :, None] * offsets[:, None]
    axes = np.linalg.eigh(np.add.reduceat(products, starts))[1]
    along = np.einsum("ni,nij->nj", offsets, axes[of_row])
    spans = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
    return np.asarray(spans.max(axis=1))


def _volumes(mesh: Mesh, rows: IntArray, centers: FloatArray) -> tuple[FloatArray, IntArray]:
    """Compute the volume of the region of each row, closed by fans, and its number of loops."""
    k, n = len(centers), mesh.n_vertices
    faces = mesh.faces[_whole_faces(mesh, rows)]
    of_face = rows[faces[:, 0]]

    def sixths(of: IntArray, corners: FloatArray) -> FloatArray:
        near = corners - centers[of][:, None]  # no cancellation far from the origin
        return np.bincount(of, np.linalg.det(near), k).astype(np.float64)

    volumes = sixths(of_face, mesh.vertices[faces])
    codes = side_codes(faces, n)
    edges = edges_of(codes)
    at = np.searchsorted(edges.keys, codes >> 1)
    balance = np.bincount(at, 1 - 2 * (codes & 1), len(edges.keys))
    # edges of faces on the border
    open_ = np.flatnonzero(edges.counts[at] == 1)
    tails, tips = faces.ravel()[open_], faces[:, [1, 2, 0]].ravel()[open_]
    _, first, loop = np.unique(
        connected(tails, tips, n)[tails], return_index=True, return_inverse=True
    )
    middles = _means(mesh.vertices[tails], np.ones(len(tails)), loop, len(first))
    fans = np.stack([mesh.vertices[tips], mesh.vertices[tails], middles[loop]], axis=1)
    volumes += sixths(rows[tails], fans)
    wrong = (edges.counts > 1) & (balance != 0)
    volumes[rows[edges.keys[wrong] // n]] = np.nan
    return volumes / 6.0, np.bincount(rows[tails[first]], minlength=k)


def _whole_faces(mesh: Mesh, numbers: IntArray) -> npt.NDArray[np.bool_]:
    """Return whether the corners of each face have the same number, from 0, shape (m,)."""
    corners = numbers[mesh.faces]
    same = (corners[:, 0] >= 0) & (corners == corners[:, :1]).all(axis=1)
    return np.asarray(same & mesh.distinct_corners)


def _remarks(known: VertexMap, rows: IntArray, volume: FloatArray) -> tuple[str, ...]:
    said = []
    labelled = ~np.isnan(known.shown)
    if without := int(np.count_nonzero(~labelled)):
        said.append(f"{counted(without, 'vertex')} without a label.")
    alone = np.bincount(known.shown[labelled & (rows < 0)].astype(np.int64))
    if (places := np.flatnonzero(alone)).size:
        names = ", ".join(known.labels[place].name for place in places[:_NAMED])
        rest = f" and {counted(len(places) - _NAMED, 'more label')}" if len(places) > _NAMED else ""
        said.append(
            f"{counted(int(alone.sum()), 'vertex')} of {names}{rest} in no region:"
            " no face around has three corners with the same label."
        )
    if wrong := int(np.count_nonzero(np.isnan(volume))):
        said.append(
            f"{counted(wrong, 'region')} without a volume: faces disagree on which side is outside,"
            " or more than two share an edge; the repairs orient_faces and drop_duplicate_faces"
            " correct most of them."
        )
    return tuple(said)

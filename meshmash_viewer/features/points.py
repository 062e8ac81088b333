"""Points near a mesh, such as synapses: nearest vertices, their features, counts and sums."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, exact_array
from meshmash_viewer.errors import InputError, other_units, wrong_shape, wrong_type
from meshmash_viewer.features.sums import Features
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.units import (
    METRES,
    NO_VOXEL,
    Voxel,
    counted,
    format_quantity,
    format_share,
    is_real,
    written_unit,
)
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from pandas import DataFrame
    from scipy.spatial import cKDTree

#: Default maximum distance from a vertex, relative to the diagonal of the mesh.
NEAR = 0.01
#: Names of columns of identifiers, which are not summed.
_IDENTIFIER = re.compile(
    "(.*[^a-z])?((pre|post)?(root|body|seg|segment|supervoxel|synapse|cell)_?)?ids?", re.IGNORECASE
)
#: Usual voxel sizes of electron microscopy, in nm.
_VOXELS = ((4, 4, 40), (8, 8, 40), (16, 16, 40), (32, 32, 40), (4, 4, 30), (8, 8, 8), (16, 16, 16))
#: Number of points used to find their likely unit.
_SAMPLE = 300


class FarPointsError(InputError):
    """Error for points that are all far from the mesh; in `unit`, if not "", most would be near."""

    def __init__(self, fault: str, remedy: str = "", unit: str = "") -> None:
        super().__init__("far-from-mesh", fault, remedy)
        self.unit = unit


@dataclass(frozen=True, eq=False)
class Points:
    """Points with the other columns of their table; see `read_points`.

    `InputError` is raised if there is no point, or a coordinate is not finite.

    Parameters
    ----------
    positions : array_like, shape (k, 3)
    columns : dict of str to ndarray, shape (k,)
        Numbers, or objects: text, or whole numbers with None for missing numbers.
    unit : str
        Unit of the positions, such as "µm", or "4 × 4 × 40 nm" for coordinates in voxels; "": unit
        of the mesh.
    id : str
        Name of the column of identifiers; "" for none.
    name, path : str
        Name and path of the file; "" for points from memory.
    remarks : tuple of str
        Sentences on rows that were left out.

    Examples
    --------
    >>> two = Points([[0, 0, 1.01], [0, 1, 0]], {"size": np.array([3, 4])})
    >>> len(two), two.summed
    (2, ('size',))
    """

    positions: FloatArray
    columns: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    unit: str = ""
    id: str = ""
    name: str = ""
    path: str = ""
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        given = np.array(self.positions, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != 3 or not len(given):
            raise wrong_shape("Points", given.shape, "x, y and z of each, shape (k, 3)")
        if bad := int(np.count_nonzero(~np.isfinite(given).all(axis=1))):
            raise InputError("not-finite", f"{counted(bad, 'point')} of {len(given):,} not finite")
        object.__setattr__(self, "positions", given)

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def summed(self) -> tuple[str, ...]:
        """Names of the columns that can be summed: numbers, except identifiers."""
        return tuple(
            name
            for name, values in self.columns.items()
            if name != self.id and not _IDENTIFIER.fullmatch(name) and _is_numeric(values)
        )

    def positions_in(self, mesh: Mesh, unit: str = "") -> FloatArray:
        """Return positions in the unit of a mesh, shape (k, 3); `unit` replaces `Points.unit`."""
        voxel, own = parse_unit(unit or self.unit) if unit or self.unit else (NO_VOXEL, mesh.unit)
        if own == mesh.unit:
            return self.positions * voxel
        if not (own and mesh.unit):
            raise other_units("The points and the mesh", own, mesh.unit, "state both units")
        return self.positions * voxel * 10.0 ** (METRES[own] - METRES[mesh.unit])


@dataclass(frozen=True, eq=False)
class ProjectedPoints:
    """Points with their nearest vertices on a mesh, the result of `project_points`.

    Parameters
    ----------
    positions : ndarray of float64, shape (k, 3)
        Positions in the unit of the mesh.
    vertices : ndarray of int64, shape (k,)
        Nearest vertex of the mesh, -1 for points that are farther than `max_distance`.
    distances : ndarray of float64, shape (k,)
        Distance from the nearest vertex; NaN without a vertex.
    remarks : tuple of str
        Sentences on rows that were left out, and on a more likely unit.

    Examples
    --------
    >>> found = mv.project_points(ball, ball.vertices[[5, 7]] * 1.01)
    >>> found.vertices.tolist(), found.at(ball.vertices)[:, 2].round(2).tolist()
    ([5, 7], [0.85, -0.85])
    """

    points: Points
    mesh: Mesh
    positions: FloatArray
    vertices: IntArray
    distances: FloatArray
    max_distance: float
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.vertices)

    @cached_property
    def near(self) -> npt.NDArray[np.bool_]:
        """Mask of the points that have a vertex, shape (k,)."""
        return np.asarray(self.vertices >= 0)

    @property
    def n_near(self) -> int:
        """Number of points that have a vertex."""
        return int(np.count_nonzero(self.near))

    @property
    def file_vertices(self) -> IntArray:
        """Indices of the vertices in the mesh file, before all repairs; -1 for none."""
        return np.where(self.near, self.mesh.file_indices[self.vertices], -1)

    def at(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values of shape (n, ...) at the vertices of points; NaN or None without one."""
        found = values[self.vertices]
        if not self.near.all():
            found = found.astype(found.dtype if found.dtype.kind in "fO" else np.float64)
            found[~self.near] = None if found.dtype.kind == "O" else np.nan
        return found

    def sums(self, groups: npt.NDArray[np.integer], n_groups: int) -> dict[str, npt.NDArray[Any]]:
        """Count the points of each group, and sum their columns exactly, without missing values.

        `groups`, shape (n,), is the group of each vertex from 0, -1 for none. The result contains
        ``points``, and ``sum NAME`` for each column of `Points.summed`, of shape (n_groups,).
        """
        of_point = np.where(self.near, groups[self.vertices], -1)
        order = np.argsort(of_point, kind="stable")[np.count_nonzero(of_point < 0) :]
        result = {"points": np.bincount(of_point[order], minlength=n_groups)}
        parts = np.split(order, np.cumsum(result["points"])[:-1])
        for name in self.points.summed:
            values = self.points.columns[name]
            result[f"sum {name}"] = np.array([_sum(values[part]) for part in parts])
        return result

    def per_label(self, labels: VertexMap | npt.ArrayLike) -> dict[str, npt.NDArray[Any]]:
        """Count the points of each label or domain, and sum their columns, as `sums` does.

        If `labels`, shape (n,), have no names, each number is a ``label``, including 0 and -1.

        Examples
        --------
        >>> found = mv.project_points(ball, ball.vertices[:10] * 1.01, 0.1)
        >>> found.per_label(ball.vertices[:, 2] > 0)["points"].tolist()
        [6, 4]
        """
        if isinstance(labels, VertexMap) and labels.labels:
            fitted = self.mesh.with_maps(labels).maps[-1]
            groups = np.nan_to_num(fitted.shown, nan=-1.0).astype(np.int64)
            names = np.array([each.name for each in fitted.labels])
        else:
            values = exact_array(labels.values if isinstance(labels, VertexMap) else labels)
            if values.shape != (self.mesh.n_vertices,):
                wanted = f"one for each of {self.mesh.n_vertices:,} vertices"
                raise wrong_shape("Labels", values.shape, wanted)
            known = np.array([each not in (None, "") for each in values], dtype=np.bool_)
            groups = np.full(len(values), -1)
            names, groups[known] = np.unique(_alike(values[known]), return_inverse=True)
            if names.dtype.kind == "f" and np.array_equal(names, np.rint(names)):
                names = names.astype(np.int64)
        return {"label": names, **self.sums(groups, len(names))}

    def table(self, *features: Features | VertexMap) -> dict[str, npt.NDArray[Any]]:
        """Return columns by name, with a row for each point, and features or maps at its vertex.

        The columns of `Points` are followed by ``x``, ``y``, ``z`` in the unit of the mesh,
        ``vertex``, the index in the mesh file, ``distance``, and the features: for a map with
        labels, their names. Without a vertex they are None or NaN. Repeated names get a number.
        """
        vertex = self.at(self.mesh.file_indices.astype(np.int64 if self.near.all() else object))
        found = dict(self.points.columns)
        more = [*zip("xyz", self.positions.T, strict=True)]
        more += [("vertex", vertex), ("distance", self.distances)]
        for each in features:
            if isinstance(each, Features):
                more += [*zip(each.columns, self.at(each.values).T, strict=True)]
            else:
                more.append((each.name, self.at(_named_values(self.mesh.with_maps(each).maps[-1]))))
        for name, values in more:
            free, number = name, 2
            while free in found:
                free, number = f"{name} {number}", number + 1
            found[free] = values
        return found

    def to_frame(self, *features: Features | VertexMap) -> DataFrame:
        """Return the columns of `table` as a pandas ``DataFrame``."""
        import pandas

        return pandas.DataFrame(self.table(*features))

    def id_to_mesh_map(self) -> IntArray:
        """Return identifier and file vertex of each point that has a vertex, shape (m, 2).

        `InputError` is raised if there is no column of identifiers, or they are not whole numbers.
        """
        ids = self.points.columns.get(self.points.id)
        if ids is None:
            fault = f"{self.points.name or 'The table'} has no column id"
            raise InputError("no-column", fault, "rename the column of identifiers to id")
        if ids.dtype.kind not in "iu":
            fault = f"The column {self.points.id} is not a whole number in each row"
            raise InputError("wrong-type", fault)
        if len(ids) and int(ids.max()) >= 2**63:
            raise InputError("not-exact", f"The {self.points.id} {ids.max()} is not below 2**63")
        # int64 and uint64 together would be converted to float64
        return np.column_stack([ids.astype(np.int64), self.file_vertices])[self.near]

    def describe(self, point: int) -> str:
        """Return the identifier or row of a point, and its distance from the vertex, as text."""
        ids = self.points.columns.get(self.points.id)
        named = f"point {point:,}" if ids is None else f"{self.points.id} {ids[point]}"
        return f"{named}, {format_quantity(float(self.distances[point]), self.mesh.unit)} away"


def project_points(
    mesh: MeshLike, points: Points | npt.ArrayLike, max_distance: float | None = None
) -> ProjectedPoints:
    """Find the nearest vertex of each point, among the vertices of faces.

    `InputError` is raised if no point is within the distance; the message names the likely unit.

    Parameters
    ----------
    points : Points or array_like, shape (k, 3)
        An array of positions is in the unit of the mesh.
    max_distance : float, optional
        Maximum distance of a point from its vertex, in the unit of the mesh. By default a hundredth
        of the diagonal of the mesh, but at least two edges of a typical triangle.

    Examples
    --------
    >>> found = mv.project_points(ball, [[0, 0, 1.01], [0, 0, 9]])
    >>> ball.vertices[found.vertices[0]].round(3).tolist(), found.near.tolist()
    ([0.0, 0.0, 1.0], [True, False])
    """
    from scipy.spatial import cKDTree

    surface = as_mesh(mesh)
    table = points if isinstance(points, Points) else Points(_as_positions(points))
    places = table.positions_in(surface)
    low, high = surface.bounds
    limit = max_distance
    if limit is None:
        typical = 3.0 * math.sqrt(surface.area / surface.n_faces)
        limit = max(NEAR * float(np.linalg.norm(high - low)), typical)
    if not (is_real(limit) and limit >= 0.0):
        raise InputError("out-of-range", f"max_distance is {limit}", "give a number from 0")
    used = np.flatnonzero(surface.referenced)
    tree = cKDTree(surface.vertices[used], compact_nodes=False, balanced_tree=False)
    far = np.nextafter(limit, np.inf)
    distances, found = map(np.asarray, tree.query(places, distance_upper_bound=far))
    near = np.isfinite(distances)
    vertices = np.full(len(places), -1, dtype=np.int64)
    vertices[near] = used[found[near]]
    distances[~near] = np.nan
    remark = unit = ""
    if near.mean() < 0.5:
        outside = ((places < low - limit) | (places > high + limit)).any(axis=1)
        remark, unit = _elsewhere(surface, table, tree, limit, int(outside.sum()), near.mean())
    if not near.any():
        within = format_quantity(limit, surface.unit)
        of = f" of {table.name}" if table.name else ""
        remedy = remark or "check the unit of the points, or allow a larger distance"
        raise FarPointsError(f"No point{of} is within {within} of the mesh", remedy, unit)
    said = (*table.remarks, f"{remark}.") if remark else table.remarks
    return ProjectedPoints(table, surface, places, vertices, distances, limit, said)


def _alike(labels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Convert objects, such as names, to an array of one type."""
    if labels.dtype != object:
        return labels
    kind = np.int64 if all(isinstance(each, int) for each in labels) else np.str_
    return labels.astype(kind)


def _as_positions(given: npt.ArrayLike) -> FloatArray:
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        wanted = "numbers of shape (k, 3), or read a table or a file with read_points"
        raise wrong_type("Positions", type(given), wanted) from None


def _elsewhere(
    mesh: Mesh, points: Points, tree: cKDTree, limit: float, outside: int, near: float
) -> tuple[str, str]:
    """Return a clause on points far from the mesh, and the unit in which most would be near.

    `near` is the share of points that are near in the given unit.
    """
    sample = Points(points.positions[:: max(1, len(points) // _SAMPLE)])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.rint(mesh.bounds.mean(axis=0) / np.median(points.positions, axis=0))
    sizes: list[Sequence[float]] = [ratio.tolist(), *_VOXELS] if mesh.unit == "nm" else [ratio]
    voxels: list[Voxel] = [mesh.voxel]
    voxels += [(x, y, z) for x, y, z in sizes if min(x, y, z) > 0.0 and math.isfinite(x + y + z)]
    units = [written_unit(mesh.unit, each) for each in voxels if mesh.unit and each != NO_VOXEL]
    units += [each for each in ("nm", "µm", "mm") if mesh.unit and each != mesh.unit]
    share, unit = 0.0, ""
    for each in units:
        places = sample.positions_in(mesh, each)
        distances, _ = tree.query(places, distance_upper_bound=limit)
        if (found := float(np.isfinite(distances).mean())) > share:
            share, unit = found, each
    where = f"{outside:,} of {counted(len(points), 'point')} lie outside the box of the mesh"
    if share > max(0.5, 2.0 * near):
        remedy = f"in {unit} {format_share(share, 2)} are near it:"
        remedy += " give this unit (--points-unit, unit=)"
        return (f"{where}, and {remedy}" if outside else remedy), unit
    return (f"{where}: check their unit, or allow a larger distance" if outside else ""), ""


def _is_numeric(values: npt.NDArray[Any]) -> bool:
    if values.dtype.kind != "O":
        return values.dtype.kind in "biuf"
    return all(each is None or isinstance(each, int) for each in values.tolist())


def _sum(values: npt.NDArray[Any]) -> float | int:
    """Return the sum without missing values: exact for whole numbers, else rounded once."""
    known = [each for each in values.tolist() if each is not None and each == each]
    return sum(known) if values.dtype.kind in "biuO" else math.fsum(known)


def _named_values(known: VertexMap) -> npt.NDArray[Any]:
    """Return the values of a map, or the names of its labels, None without a label."""
    if not known.labels:
        return known.values
    names = np.array([*(each.name for each in known.labels), None], dtype=object)
    return np.asarray(names[np.nan_to_num(known.shown, nan=-1.0).astype(np.int64)])

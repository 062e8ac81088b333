"""Means of features over domains, and the graph of domains.

Domains are numbered from 0; vertices in no domain have the label -1. Tables are pandas DataFrames.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer import errors
from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, wrong_shape
from meshmash_viewer.features.sums import Features
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.surface.edges import edges_of, side_codes

if TYPE_CHECKING:
    from pandas import DataFrame

#: Columns of the graph of domains.
NODE_COLUMNS = ("x", "y", "z", "area", "n_vertices", "component_area", "component_n_vertices")
EDGE_COLUMNS = ("source", "target", "boundary_length", "count", "edge_length")
#: Column of nodes: the distance from a given point.
NUCLEUS_COLUMN = "distance_to_nucleus"
#: Function that raises `InputError` if one of its modules is not installed.
require = functools.partial(errors.require, "Domains need", "neuro")


def checked_labels(labels: npt.ArrayLike, n_vertices: int) -> IntArray:
    """Return the domain of each vertex, shape (n,), and raise `InputError` for other arrays."""
    found = np.asarray(labels)
    if found.shape != (n_vertices,) or found.dtype.kind not in "iu" or found.min(initial=-1) < -1:
        fault = f"Labels of domains have shape {found.shape} and type {found.dtype}"
        remedy = f"give one whole number from -1 (none) for each of {n_vertices:,} vertices"
        raise InputError("not-labels", fault, remedy)
    return found.astype(np.int64)


def checked_point(point: npt.ArrayLike) -> FloatArray:
    """Return a position, shape (3,), and raise `InputError` for other arrays."""
    found = np.asarray(point, dtype=np.float64)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InputError("out-of-range", f"nuc_point is {point!r}", "give x, y and z of a point")
    return found


def aggregate_features(
    features: Features | DataFrame | npt.ArrayLike,
    labels: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
) -> DataFrame:
    """Compute the mean of features over each domain.

    The index of the result is the domain, from -1; row -1 is NaN. `InputError` is raised if the
    numbers of rows differ, or a weight is negative.

    Parameters
    ----------
    features : Features, DataFrame or array_like, shape (n, f) or (n,)
        A row for each vertex; NaN is ignored.
    labels : array_like of int, shape (n,)
        Domain of each vertex, -1 for none.
    weights : array_like, shape (n,), optional
        Such as `Mesh.vertex_areas`. Weights are equal by default, and in domains where all are 0.

    Examples
    --------
    >>> halves = (ball.vertices[:, 2] > 0).astype(int)
    >>> aggregate_features(ball.vertices[:, 2], halves)[0].round(2).tolist()
    [nan, -0.48, 0.53]
    """
    try:
        table = np.asarray(features, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("wrong-type", "Features of domains have text", "give numbers") from None
    table = table.reshape(len(table), -1)
    names = getattr(features, "columns", range(table.shape[1]))
    return frame_of_domains(domain_means(table, labels, weights), names, first=-1)


def frame_of_domains(values: npt.NDArray[Any], columns: Any, first: int = 0) -> DataFrame:
    """Return a table with a row for each domain from `first` on."""
    require("pandas")
    import pandas

    index = pandas.RangeIndex(first, first + len(values), name="label")
    return pandas.DataFrame(values, index=index, columns=list(columns))


def domain_means(
    table: FloatArray, labels: npt.ArrayLike, weights: npt.ArrayLike | None = None
) -> FloatArray:
    """Compute the rows of `aggregate_features` for k domains, shape (k + 1, f)."""
    known = checked_labels(labels, len(table))
    given = np.ones(len(table)) if weights is None else np.asarray(weights, dtype=np.float64)
    if given.shape != known.shape or not (given >= 0.0).all():
        raise wrong_shape("Weights", given.shape, f"numbers from 0 at {len(table):,} vertices")
    inside = np.flatnonzero(known >= 0)
    domain, k = known[inside], int(known.max(initial=-1)) + 1
    share = given[inside]
    empty = np.bincount(domain, share, k) == 0.0
    share = np.where(empty[domain], 1.0, share)
    result = np.full((k + 1, table.shape[1]), np.nan)
    for at, column in enumerate(table[inside].T):
        has = np.isfinite(column)
        total = np.bincount(domain[has], share[has], k)
        sums = np.bincount(domain[has], column[has] * share[has], k)
        result[1:, at] = np.divide(sums, total, out=np.full(k, np.nan), where=total > 0.0)
    return result


def expand_features(condensed: DataFrame | npt.ArrayLike, labels: npt.ArrayLike) -> Any:
    """Return the row of its domain for each vertex, the inverse of `aggregate_features`.

    `condensed` is a table whose index is the domain, or an array of shape (k, f) or (k,). The
    result is a table or an array accordingly, with NaN where `labels`, shape (n,), are -1.
    `InputError` is raised if a domain has no row.

    Examples
    --------
    >>> expand_features([10.0, 20.0], [0, 1, -1, 1])
    array([10., 20., nan, 20.])
    """
    require("pandas")
    import pandas

    known = checked_labels(labels, len(np.asarray(labels)))
    given: Any = condensed
    table = given if hasattr(given, "reindex") else pandas.DataFrame(np.asarray(given))
    if missing := sorted(set(known[known >= 0].tolist()) - set(table.index)):
        fault = f"Domain {missing[0]} is not among the {len(table)} rows"
        raise InputError("no-column", fault, "give the table of these labels")
    rows = table.drop(index=-1, errors="ignore").reindex(known).astype(np.float64)
    if table is given:
        return rows.reset_index(drop=True)
    return rows.to_numpy().reshape(len(known), *np.shape(given)[1:])


def condense_mesh_to_graph(
    mesh: MeshLike, labels: npt.ArrayLike, nuc_point: npt.ArrayLike | None = None
) -> tuple[DataFrame, DataFrame]:
    """Make the graph of domains: a node for each domain, an edge for each two adjacent domains.

    `InputError` is raised if labels do not match the mesh, or no vertex is in a domain.

    `labels`, shape (n,), are -1 for vertices in no domain. If `nuc_point`, shape (3,), is given,
    the distance of each node from it is a further column.

    Returns
    -------
    nodes : DataFrame
        Row i is domain i: its area-weighted mean position ``x, y, z``, its ``area`` and
        ``n_vertices``, ``component_area`` and ``component_n_vertices`` of its connected component,
        and ``distance_to_nucleus``. The area of a vertex is a third of the area of its faces.
    edges : DataFrame
        ``source`` < ``target``, ``boundary_length``, ``count`` (the number of mesh edges between
        the two domains) and ``edge_length`` (the distance of their positions). A mesh edge between
        two domains adds the sum of the incircle radii of its faces to the boundary length.

    Examples
    --------
    >>> nodes, edges = condense_mesh_to_graph(ball, (ball.vertices[:, 2] > 0).astype(int))
    >>> nodes["area"].round(1).tolist(), edges["source"].tolist(), edges["target"].tolist()
    ([6.6, 5.9], [0], [1])
    """
    require("pandas")
    import pandas

    surface = as_mesh(mesh)
    known = checked_labels(labels, surface.n_vertices)
    if not (known >= 0).any():
        raise InputError("no-labels", "No vertex is in a domain, all labels are -1")
    k = int(known.max()) + 1
    areas, component = surface.vertex_areas, surface.component_labels
    positions = domain_means(surface.vertices, known, areas)[1:]
    inside, used = np.flatnonzero(known >= 0), component >= 0
    of_domain = np.full(k, -1)
    of_domain[known[inside[::-1]]] = component[inside[::-1]]  # component of the lowest vertex
    values = [
        *positions.T,
        np.bincount(known[inside], areas[inside], k),
        np.bincount(known[inside], minlength=k),
        np.append(np.bincount(component[used], areas[used]), 0)[of_domain],
        np.append(np.bincount(component[used]), 0)[of_domain],
    ]
    nodes = pandas.DataFrame(dict(zip(NODE_COLUMNS, values, strict=True)))
    if nuc_point is not None:
        nodes[NUCLEUS_COLUMN] = np.linalg.norm(positions - checked_point(nuc_point), axis=1)
    pairs, length, count = _boundaries(surface, known, k)
    source, target = np.divmod(pairs, k)
    apart = np.linalg.norm(positions[source] - positions[target], axis=1)
    values = [source, target, length, count, apart]
    return nodes, pandas.DataFrame(dict(zip(EDGE_COLUMNS, values, strict=True)))


def _boundaries(mesh: Mesh, labels: IntArray, k: int) -> tuple[IntArray, FloatArray, IntArray]:
    """Return adjacent domains as ``low * k + high``, boundary lengths, and numbers of edges."""
    at = np.flatnonzero(mesh.distinct_corners)
    faces = mesh.faces[at]
    corners = mesh.vertices[faces]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).sum(axis=1)
    radius = np.divide(2.0 * mesh.face_areas[at], sides, out=np.zeros(len(at)), where=sides > 0.0)
    codes = side_codes(faces, mesh.n_vertices)
    edges = edges_of(codes).keys
    lengths = np.bincount(np.searchsorted(edges, codes >> 1), np.repeat(radius, 3), len(edges))
    ends = labels[np.stack(np.divmod(edges, mesh.n_vertices))]
    across = (ends[0] != ends[1]) & (ends >= 0).all(axis=0)
    low, high = ends[:, across].min(axis=0), ends[:, across].max(axis=0)
    pairs, place = np.unique(low * k + high, return_inverse=True)
    total = np.bincount(place, lengths[across], len(pairs)).astype(np.float64)
    return pairs, total, np.bincount(place, minlength=len(pairs))

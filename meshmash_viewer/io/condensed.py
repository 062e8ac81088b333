"""Files of condensed features, of graphs of domains, and of objects at vertices, as in meshmash.

A file of features has two arrays. ``labels``, int32, has the domain of each vertex of the raw mesh,
-1 for none. ``X``, float32, has the features of vertices without a domain in row 0, and those of
domain i in row i + 1. A file of a graph has the arrays ``nodes`` and ``edges``. Column names are in
text files in the same folder, separated by tabs; they apply to all files of the folder.
"""

from __future__ import annotations

import contextlib
import itertools
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.errors import InputError, printable, unknown_ending, wrong_format, wrong_shape
from meshmash_viewer.features.domains import (
    EDGE_COLUMNS,
    NODE_COLUMNS,
    NUCLEUS_COLUMN,
    checked_labels,
    frame_of_domains,
    require,
)
from meshmash_viewer.io.atomic import writing_errors, written_together
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.edges import side_codes
from meshmash_viewer.vertex_map import LABEL_COLORS, MOST_LABELS, Label, VertexMap

if TYPE_CHECKING:
    from pandas import DataFrame

#: Files of column names.
HEADER, NODES_HEADER, EDGES_HEADER = "header.txt", "nodes_header.txt", "edges_header.txt"
#: Columns of edges with the two nodes of each edge.
_ENDS = EDGE_COLUMNS[:2]
#: Name of the map with the domain of each vertex, which `labelled_domains` makes a label set.
DOMAINS = "domains"
#: Name of the array that maps objects to vertices.
ID_MAP = "id_to_mesh_map"


def write_condensed_features(path: str | Path, features: DataFrame, labels: npt.ArrayLike) -> None:
    """Write features of domains to ``NAME.npz``, and the names of their columns to ``header.txt``.

    Either both files are written or neither. `InputError` is raised if a label has no row in
    `features`, or the folder has a header with other columns.

    Parameters
    ----------
    features : DataFrame
        A row for each domain, with index 0, 1, 2, ...; row -1, which may be missing, is for
        vertices without a domain.
    labels : array_like of int, shape (n,)
        The domain of each vertex of the raw mesh, -1 for none.

    Examples
    --------
    >>> halves = (ball.vertices[:, 2] > 0).astype(int)
    >>> means = aggregate_features(ball.vertices, halves)
    >>> write_condensed_features(folder / "halves.npz", means, halves)
    >>> read_condensed_features(folder / "halves.npz")[0].shape
    (3, 3)
    """
    known = checked_labels(labels, len(np.asarray(labels)))
    rows = features if -1 in features.index else features.reindex([-1, *features.index])
    k = len(rows) - 1
    if rows.index.tolist() != list(range(-1, k)):
        fault = "The index of condensed features is not 0, 1, 2 and so on"
        raise InputError("not-sorted", fault, "sort them")
    if int(known.max(initial=-1)) >= k:
        fault = f"Labels are up to {known.max()}, but there are only {k} rows of domains"
        raise InputError("counts-differ", fault)
    arrays = {"X": np.asarray(rows, dtype=np.float32), "labels": known.astype(np.int32)}
    _write(path, arrays, {HEADER: features})


def read_condensed_features(path: str | Path) -> tuple[DataFrame, IntArray]:
    """Read features of domains and the domain of each vertex; see `write_condensed_features`.

    The index of the features is the number of the domain, from -1 on. `InputError` is raised if
    the file is invalid, or does not match ``header.txt`` in its folder.

    Examples
    --------
    >>> halves = (ball.vertices[:, 2] > 0).astype(int)
    >>> means = aggregate_features(ball.vertices, halves)
    >>> write_condensed_features(folder / "halves.npz", means, halves)
    >>> read_condensed_features(folder / "halves.npz")[0].index.tolist()
    [-1, 0, 1]
    """
    with _reading(path, "X", "labels") as (values, labels):
        names = condensed_columns(Path(path), values, labels)
        return frame_of_domains(values, names, first=-1), labels.astype(np.int64)


def condensed_columns(
    path: Path, values: npt.NDArray[Any], labels: npt.NDArray[Any]
) -> tuple[str, ...]:
    """Check the arrays of a file of features, and return the names of its columns.

    `InputError` is raised if they are invalid; its message is a clause without the file name.
    """
    if values.ndim != 2 or values.dtype.kind not in "fiu" or not len(values):
        raise wrong_shape("Values X", values.shape, "a row for each domain")
    if labels.ndim != 1 or labels.dtype.kind not in "iu" or not len(labels):
        raise wrong_shape("Labels", labels.shape, "a whole number per vertex")
    low, high = int(labels.min()), int(labels.max())
    if low < -1 or high > len(values) - 2:
        raise InputError(
            "counts-differ",
            f"has labels from {low} to {high}, and {len(values)} rows of X, which are of -1 and the"
            f" domains from 0 to {len(values) - 2}",
        )
    return _header(path, HEADER, values.shape[1])


def write_condensed_graph(path: str | Path, nodes: DataFrame, edges: DataFrame) -> None:
    """Write a graph of domains to ``NAME.npz``, see `condense_mesh_to_graph`.

    Column names are written to ``nodes_header.txt`` and ``edges_header.txt``. `InputError` is
    raised if columns are missing, an end of an edge is no node, or the folder has other headers.

    Examples
    --------
    >>> graph = condense_mesh_to_graph(ball, (ball.vertices[:, 2] > 0).astype(int))
    >>> write_condensed_graph(folder / "graph.npz", *graph)
    >>> nodes, edges = read_condensed_graph(folder / "graph.npz")
    >>> len(nodes), edges["source"].tolist(), edges["target"].tolist()
    (2, [0], [1])
    """
    _check_graph(nodes, edges, "The graph has")
    # numbers of nodes above 16,777,216 are not exact in float32
    exact = np.float32 if len(nodes) < 2**24 else np.float64
    arrays = {"nodes": np.asarray(nodes, dtype=np.float32), "edges": np.asarray(edges, dtype=exact)}
    _write(path, arrays, {NODES_HEADER: nodes, EDGES_HEADER: edges})


def read_condensed_graph(path: str | Path) -> tuple[DataFrame, DataFrame]:
    """Read the nodes and edges of a graph of domains; see `write_condensed_graph`.

    Row i of the nodes is domain i. `InputError` is raised if the file is invalid, or does not match
    the header files in its folder.

    Examples
    --------
    >>> graph = condense_mesh_to_graph(ball, (ball.vertices[:, 2] > 0).astype(int))
    >>> write_condensed_graph(folder / "graph.npz", *graph)
    >>> [len(each) for each in read_condensed_graph(folder / "graph.npz")]
    [2, 1]
    """
    with _reading(path, "nodes", "edges") as (nodes, edges):
        if nodes.ndim != 2 or edges.ndim != 2:
            shapes = f"{nodes.shape} and {edges.shape}"
            raise wrong_shape("Nodes and edges", shapes, "two tables")
        usual = (*NODE_COLUMNS, NUCLEUS_COLUMN)
        first = frame_of_domains(nodes, _header(Path(path), NODES_HEADER, nodes.shape[1], usual))
        names = _header(Path(path), EDGES_HEADER, edges.shape[1], EDGE_COLUMNS)
        ends = dict.fromkeys(set(names) & set(_ENDS), np.int64)
        second = frame_of_domains(edges, names).astype(ends)
        _check_graph(first, second, "has")
        return first, second


def write_id_map(path: str | Path, ids: npt.ArrayLike, vertices: npt.ArrayLike) -> None:
    """Write the ids of objects, such as synapses, and the raw-mesh vertex of each; -1 for none.

    `InputError` is raised unless both are arrays of integers of shape (k,).

    Examples
    --------
    >>> write_id_map(folder / "ids.npz", [7001, 7002], [12, 640])
    >>> ids, vertices = read_id_map(folder / "ids.npz")
    >>> ids.tolist(), vertices.tolist()
    ([7001, 7002], [12, 640])
    """
    one, other = np.asarray(ids), np.asarray(vertices)
    if one.shape != other.shape or one.ndim != 1 or {one.dtype.kind, other.dtype.kind} - {*"iu"}:
        said = f"{one.shape} and {other.shape}"
        raise wrong_shape("Ids and vertices", said, "one whole number of each")
    if int(one.max(initial=0)) >= 2**63:
        fault = f"The id {one.max()} is not below 2**63"
        raise InputError("not-exact", fault, "the file cannot hold it")
    _write(path, {ID_MAP: np.column_stack([one.astype(np.int64), other.astype(np.int64)])}, {})


def read_id_map(path: str | Path) -> tuple[IntArray, IntArray]:
    """Read ids of objects and the vertex of each, both of shape (k,); see `write_id_map`.

    `InputError` is raised if the file is invalid.

    Examples
    --------
    >>> write_id_map(folder / "ids.npz", [7001, 7002], [12, 640])
    >>> read_id_map(folder / "ids.npz")[1].tolist()
    [12, 640]
    """
    with _reading(path, ID_MAP) as (found,):
        if found.ndim != 2 or found.shape[1] != 2 or found.dtype.kind not in "iu":
            raise wrong_shape(f"Rows of {ID_MAP}", found.shape, "two whole numbers an object")
        ids, vertices = found.astype(np.int64).T
        return ids, vertices


def holds(path: str | Path, *names: str) -> bool:
    """Whether a file is an NPZ archive with the named arrays."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {f"{name}.npy" for name in names} <= set(archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return False


def labelled_domains(
    maps: Sequence[VertexMap], mesh: Mesh
) -> tuple[tuple[VertexMap, ...], tuple[str, ...]]:
    """Replace the map of domains by a label set; return all maps, and a remark if it has groups.

    Adjacent domains get different colours. If there are more than `MOST_LABELS` domains, each label
    is a group of domains that are not adjacent, and the map with the domain numbers is kept.
    """
    given = next((each for each in maps if each.name == DOMAINS), None)
    if given is None:
        return tuple(maps), ()
    numbers = np.nan_to_num(given.values, nan=-1.0).astype(np.int64)
    of_mesh = numbers if len(numbers) == mesh.n_vertices else numbers[mesh.file_indices]
    groups = _distinct(of_mesh[mesh.faces], int(numbers.max()) + 1)
    count, rest = len(groups), tuple(each for each in maps if each is not given)
    said: tuple[str, ...] = ()
    name, one, first, keys = DOMAINS, "domain", 0, numbers + 1
    if count > MOST_LABELS:
        said = (
            f"has {count:,} domains, and {MOST_LABELS} labels can be distinguished: a label is a"
            f" group of domains that do not touch, and the map {DOMAINS} has their numbers",
        )
        keys, rest = np.append(np.asarray(groups) + 1, 0)[numbers], tuple(maps)
        name, one, first, groups = "groups of domains", "group", 1, [*range(max(groups) + 1)]
    labels = (
        Label(at + 1, f"{one} {at + first}", LABEL_COLORS[group % len(LABEL_COLORS)])
        for at, group in enumerate(groups)
    )
    return (*rest, VertexMap(name, keys, tuple(labels), path=given.path)), said


def _distinct(corners: IntArray, count: int) -> list[int]:
    """Colour the domains greedily: return a number for each, different in adjacent domains."""
    keys = np.unique(side_codes(corners, count) >> 1)
    lower: list[set[int]] = [set() for _ in range(count)]
    for low, high in np.transpose(np.divmod(keys[keys >= 0], count)).tolist():
        if low != high:
            lower[high].add(low)
    found: list[int] = []
    for others in lower:
        taken = {found[other] for other in others}
        found.append(next(number for number in itertools.count() if number not in taken))
    return found


def _check_graph(nodes: DataFrame, edges: DataFrame, subject: str) -> None:
    """Raise `InputError` if a graph lacks columns, or an end of an edge is no node."""
    for table, needed in ((nodes, NODE_COLUMNS[:3]), (edges, _ENDS)):
        if missing := [name for name in needed if name not in table.columns]:
            raise InputError("no-column", f"{subject} no column {missing[0]}")
    ends = np.asarray(edges[list(_ENDS)], dtype=np.int64)
    if bad := set(ends.ravel().tolist()) - set(range(len(nodes))):
        fault = f"{subject} an edge from or to node {min(bad)}, and {len(nodes)} nodes"
        raise InputError("vertex-out-of-range", fault)


def _write(
    path: str | Path, arrays: dict[str, npt.NDArray[Any]], headers: Mapping[str, Iterable[Any]]
) -> None:
    """Write arrays, and files of the names of columns that do not exist yet."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise unknown_ending(path, [".npz"])
    with writing_errors(path):
        new = {}
        for name, table in headers.items():
            columns, header = list(map(str, table)), path.parent / name
            if any("\t" in each or "\n" in each for each in columns):
                raise InputError("wrong-name", f"{path} has a tab or line break in a column name")
            text = "\t".join(columns)
            if not header.exists():
                new[header] = text
            elif header.read_text(encoding="utf-8").rstrip("\r\n") != text:
                raise InputError(
                    "other-columns",
                    f"{path} has other columns than those in {header}, which is for all files of"
                    " the folder",
                    "choose another folder",
                )
        with written_together(*new, path) as (*parts, whole):
            for part, text in zip(parts, new.values(), strict=True):
                part.write_text(text, encoding="utf-8")
            with whole.open("wb") as file:
                np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def _header(
    path: Path, name: str, count: int, usual: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    """Return the column names in a header file; without the file, the first `count` of `usual`."""
    header = path.with_name(name)
    if not header.exists():
        if usual is not None and count <= len(usual):
            return usual[:count]
        fault = f"has no {name} next to it, which names its columns"
        raise InputError("file-not-found", fault, "copy it there")
    try:
        names = header.read_text(encoding="utf-8").rstrip("\r\n").split("\t")
    except UnicodeDecodeError:
        raise wrong_format(f"has a {name} next to it that is no text") from None
    if len(names) != count:
        fault = f"has {count} columns, and {name} next to it names {len(names)}"
        raise InputError("counts-differ", fault)
    return tuple(printable(each, 60) for each in names)


@contextlib.contextmanager
def _reading(path: str | Path, *names: str) -> Iterator[list[npt.NDArray[Any]]]:
    """Yield arrays of a file; the file name is put before messages of `InputError` in the body."""
    require("pandas")
    try:
        if not Path(path).exists():
            raise InputError("file-not-found", "does not exist", "check its spelling")
        if not zipfile.is_zipfile(path):
            raise wrong_format("is not an NPZ archive")
        try:
            with np.load(path) as archive:
                held = archive.files
                found = [np.asarray(archive[name]) for name in names if name in held]
        except Exception as fault:  # the parsers raise various types
            raise InputError("file-damaged", "is damaged or cut short") from fault
        if missing := [name for name in names if name not in held]:
            listed = printable(", ".join(held) or "nothing")
            raise InputError("missing-data", f"holds {listed}, and no array {missing[0]}")
        yield found
    except InputError as fault:
        raise fault.of(path) from fault

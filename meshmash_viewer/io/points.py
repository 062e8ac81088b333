"""Tables of points, such as synapses: CSV, Parquet and Feather."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, exact_array
from meshmash_viewer.errors import (
    InputError,
    not_readable,
    package_missing,
    printable,
    wrong_format,
    wrong_type,
)
from meshmash_viewer.features.points import Points, ProjectedPoints
from meshmash_viewer.io.formats.tables import counts_rows, plain_table, text_table
from meshmash_viewer.io.write import write_table
from meshmash_viewer.io.writers import FeatureTable
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.units import counted, written_unit

if TYPE_CHECKING:
    import pyarrow

    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.vertex_map import VertexMap

_TEXT_ENDINGS = (".csv", ".tsv", ".txt")
#: Endings of tables of points.
POINT_ENDINGS = (*_TEXT_ENDINGS, ".parquet", ".feather", ".arrow")
_AXES = ("x", "y", "z")
#: Name of a column with one coordinate: "x", "ctr_pt_x", "x_pre", "x_nm", "Center X [µm]".
_AXIS = re.compile(
    r"(?:(?P<before>.+)[_ .])?(?P<axis>[xyz])(?:[_ .\[(]+(?P<after>.+?)[\])]?)?", re.IGNORECASE
)
_NUMBER = r"(?:np\.\w+\()?([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\)?"
#: A field with three numbers: "[1 2 3]", "(1.5, 2, 3)".
_TRIPLE = re.compile(rf"\s*[\[(]\s*{_NUMBER}[\s,;]+{_NUMBER}[\s,;]+{_NUMBER}\s*[\])]\s*")
#: Names of columns of identifiers, in lower case, with underscores for other separators.
_IDS = ("id", "synapse_id", "point_id", "object_id")
#: Number of bytes of a text file that are read to recognize its columns.
_BEGINNING = 20_000

Columns = dict[str, npt.NDArray[Any]]


class SeveralPositionsError(InputError):
    """A table has several positions per row; the caller must choose one of `stems`."""

    def __init__(self, name: str, stems: Iterable[str]) -> None:
        self.stems = tuple(stem or "x" for stem in stems)
        named = ", ".join(self.stems)
        fault = f"{name} has several positions in a row"
        super().__init__("several-positions", fault, f"name one of {named}")


def read_points(
    table: str | Path | Mapping[str, Any], unit: str = "", position: str = ""
) -> Points:
    """Read a table of points with all its columns.

    Positions are three columns such as ``x``, ``y``, ``z`` or ``ctr_pt_x``, ``ctr_pt_y``,
    ``ctr_pt_z``, or one column of three numbers such as ``ctr_pt_position``, in text as "[1 2 3]".
    A unit in the names of three columns, such as ``x_nm`` or ``X [µm]``, is used without `unit`.
    Other columns keep their types; a column ``id`` or ``synapse_id`` identifies the points. Rows
    without a position are left out, with a remark. `InputError` is raised if the table cannot be
    read, has no rows or no positions, or has several positions and `position` is empty.

    Parameters
    ----------
    table : str, Path or table
        CSV, Parquet or Feather file, or a table in memory: a pandas ``DataFrame``, whose named
        index is a column, too, an Arrow or polars table, or a mapping of names to arrays.
    unit : str
        Unit of the positions: "nm", or "4 x 4 x 40 nm" for voxel indices; "" for the unit of the
        mesh onto which the points are projected.
    position : str
        Name of a position, needed if the table has several: "pre_pt_position".

    Examples
    --------
    >>> synapses = mv.read_points({"ctr_pt_position": [[0, 0, 1], [0, 1, 0]], "size": [310, 25]})
    >>> synapses.positions.tolist(), synapses.columns["size"].tolist()
    ([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], [310, 25])
    """
    path = Path(table) if isinstance(table, (str, Path)) else None
    name = "The table" if path is None else path.name
    if path is None:
        columns = _in_memory(table)
    else:
        columns = _read(path)
    columns = {each: values for each, values in columns.items() if not counts_rows(each, values)}
    if not any(map(len, columns.values())):
        raise InputError("no-points", f"{name} has no rows", "export it again")
    found = _positions(columns)
    if position:
        found = {stem: names for stem, names in found.items() if position in (stem, *names)}
    if not found:
        named = ", ".join(printable(each, 30) for each in columns) or "none"
        wanted = f"no position {position!r}" if position else "no position"
        raise InputError(
            "no-column",
            f"{name} has {wanted}",
            "a position is three columns such as x, y, z or pre_x, pre_y, pre_z, or one column of"
            f" three numbers: rename its columns, which are {named}",
        )
    if len(found) > 1:
        raise SeveralPositionsError(name, found)
    names = next(iter(found.values()))
    places = _coordinates(name, columns, names)
    given = np.isfinite(places).all(axis=1)
    if not given.any():
        fault = f"{name} has no position in any of its rows"
        raise InputError("no-points", fault, "export it again")
    left_out = int(np.count_nonzero(~given))
    others = {each: values for each, values in columns.items() if each not in names}
    lower = {re.sub(r"[\W_]+", "_", each.lower()): each for each in others}
    return Points(
        places[given],
        {each: values[given] for each, values in others.items()} if left_out else others,
        unit or _named_unit(names[0]),
        next((lower[each] for each in _IDS if each in lower), ""),
        "" if path is None else path.name,
        "" if path is None else str(path.absolute()),
        (f"{counted(left_out, 'row')} without a position left out.",) if left_out else (),
    )


def has_positions(path: Path) -> bool:
    """Whether a file is a table with positions and without a column ``vertex``."""
    try:
        columns = _read(path, beginning=True)
    except InputError:
        return False
    return "vertex" not in columns and bool(_positions(columns))


def write_points(
    path: str | Path,
    found: ProjectedPoints,
    *features: Features | VertexMap,
    meta: dict[str, Any] | None = None,
) -> None:
    """Write points with their vertex, distance, and features at the vertex.

    CSV and Parquet files have the columns of `ProjectedPoints.table`. NPZ files have only the array
    ``id_to_mesh_map``, shape (m, 2), with identifiers and vertices. `meta` are JSON-able options of
    the computation, or a result of `provenance`. `InputError` is raised if the ending is unknown,
    the file cannot be written, or points for NPZ have no identifiers.

    Examples
    --------
    >>> synapses = mv.read_points({"id": [7, 9], "x": [0, 0], "y": [0, 1], "z": [1, 0]})
    >>> mv.write_points(folder / "synapses.npz", mv.project_points(ball, synapses))
    >>> np.load(folder / "synapses.npz")["id_to_mesh_map"][:, 0].tolist()
    [7, 9]
    """
    if Path(path).suffix.lower() == ".npz":
        columns: Columns = {"id_to_mesh_map": found.id_to_mesh_map()}
    else:
        columns = found.table(*features)
    table = FeatureTable(found.mesh, columns, archive_is_table=True)
    said = {
        "kind": "points",
        "points": found.points.path or found.points.name,
        "points_unit": found.points.unit or found.mesh.unit,
        "unit": found.mesh.unit,
        "max_distance": found.max_distance,
        "remarks": list(found.remarks),
    }
    write_table(path, "points", table, said, meta)


# -- files -------------------------------------------------------------------------------------


def _read(path: Path, *, beginning: bool = False) -> Columns:
    """Read the columns of a file; with `beginning`, only the first rows."""
    ending = path.suffix.lower()
    if ending not in POINT_ENDINGS:
        remedy = f"give a file that ends in one of {' '.join(POINT_ENDINGS)}"
        raise InputError("unknown-ending", f"{path.name} is no table of points", remedy)
    try:
        if ending in _TEXT_ENDINGS:
            table = text_table(path, _BEGINNING if beginning else None)
        else:
            table = plain_table(_arrow_table(path, ending, beginning))
    except ModuleNotFoundError as fault:
        raise package_missing(f"{path.name} is read by", "pyarrow") from fault
    except OSError as fault:
        raise not_readable(path, fault) from fault
    except InputError as fault:
        raise fault.of(path.name, "export it again") from fault
    return _from_arrow_table(path.name, table)


def _from_arrow_table(name: str, table: pyarrow.Table) -> Columns:
    names = [each.strip() for each in table.column_names]
    _check_different(name, names)
    return {each: _from_arrow(column) for each, column in zip(names, table.columns, strict=True)}


def _check_different(name: str, columns: Sequence[str]) -> None:
    """Raise `InputError` if two columns have the same name."""
    if repeated := next((each for each in columns if columns.count(each) > 1), None):
        raise InputError("given-twice", f"{name} has two columns called {repeated!r}", "rename one")


def _in_memory(table: Any) -> Columns:
    """Return the columns of a table in memory, such as a ``DataFrame`` with its named index."""
    if hasattr(table, "__arrow_c_stream__") and not hasattr(table, "keys"):
        import pyarrow

        try:
            return _from_arrow_table("The table", pyarrow.table(table))
        except pyarrow.ArrowInvalid:
            pass  # a column, not a table
    if not (isinstance(table, Mapping) or (hasattr(table, "keys") and hasattr(table, "columns"))):
        wanted = "a file or a table with named columns; positions alone to project_points"
        raise wrong_type("Points", type(table), wanted)
    keys = list(table.keys())
    levels = enumerate(getattr(getattr(table, "index", None), "names", ()))
    if named := [level for level, name in levels if name is not None and name not in keys]:
        table = table.reset_index(named, allow_duplicates=True)
        keys = list(table.keys())
    names = [
        "_".join(part for each in key if (part := str(each)))
        if isinstance(key, tuple)
        else str(key)
        for key in keys
    ]
    _check_different("The table", names)
    return {name: _held(table[key]) for name, key in zip(names, keys, strict=True)}


def _held(given: Any) -> npt.NDArray[Any]:
    """Return a column of a table in memory; text and lists become dtype object."""
    made = exact_array(given)
    if made.ndim == 1 and made.dtype.kind not in "US":
        return made
    made = np.empty(len(given), dtype=object)
    made[:] = list(given)
    return made


def _arrow_table(path: Path, ending: str, beginning: bool) -> pyarrow.Table:
    import pyarrow.feather
    import pyarrow.parquet

    try:
        if ending != ".parquet":
            return pyarrow.feather.read_table(path, memory_map=False)
        with pyarrow.parquet.ParquetFile(path) as file:
            if not beginning:
                return file.read()
            batches = list(islice(file.iter_batches(100), 1))
            return pyarrow.Table.from_batches(batches, file.schema_arrow)
    except pyarrow.ArrowException as fault:
        raise wrong_format(f"is no table ({printable(fault)})") from fault


def _from_arrow(column: pyarrow.ChunkedArray) -> npt.NDArray[Any]:
    from pyarrow import types

    kind = column.type
    if types.is_floating(kind) or types.is_temporal(kind):
        return np.asarray(column.to_numpy())
    if (types.is_integer(kind) or types.is_boolean(kind)) and not column.null_count:
        return np.asarray(column.to_numpy())
    made = np.empty(len(column), dtype=object)
    made[:] = column.to_pylist()
    return made


# -- positions ---------------------------------------------------------------------------------


def _positions(columns: Columns) -> dict[str, tuple[str, ...]]:
    """Return the column names of each position, one or three, by the stem of the names.

    Names such as ``x_pre`` or ``x_nm`` are read only if there are no others: a table of ``x``,
    ``y``, ``z`` may also have ``x_err``, ``y_err``, ``z_err``.
    """
    triples = {name: (name,) for name, each in columns.items() if _is_triple(each)}
    matches = [match for name in columns if (match := _AXIS.fullmatch(name))]
    for plain in (True, False):
        stems: dict[str, dict[str, str]] = {}
        for match in matches:
            if plain != bool(match["after"]):
                stem = " ".join(filter(None, match.group("before", "after")))
                stems.setdefault(stem, {})[match["axis"].lower()] = match[0]
        threes = {
            stem: tuple(map(axes.__getitem__, _AXES))
            for stem, axes in stems.items()
            if len(axes) == 3
        }
        if found := threes | triples:
            return found
    return {}


def _named_unit(name: str) -> str:
    """Return the unit in the name of a column with one coordinate, "" if there is none."""
    match = _AXIS.fullmatch(name)
    try:
        voxel, unit = parse_unit((match and match["after"]) or "")
    except InputError:
        return ""
    return written_unit(unit, voxel) if unit else ""


def _is_triple(values: npt.NDArray[Any]) -> bool:
    """Whether the first value of a column is three numbers."""
    if values.dtype.kind != "O":
        return False
    first = next((each for each in values if each is not None), None)
    if isinstance(first, str):
        return bool(_TRIPLE.fullmatch(first))
    return first is not None and np.shape(first) == (3,) and np.asarray(first).dtype.kind in "iuf"


def _coordinates(name: str, columns: Columns, names: tuple[str, ...]) -> FloatArray:
    """Return the positions in columns, shape (k, 3); missing positions are NaN."""
    axes = len(names) == 3
    parse, wanted = (_number, "a number") if axes else (_three_numbers, "three numbers")
    found = []
    for column in names:
        if columns[column].dtype.kind in "iuf":
            found.append(columns[column].astype(np.float64))
            continue
        made = []
        for row, given in enumerate(columns[column].tolist(), 1):
            try:
                made.append(parse(given))
            except (TypeError, ValueError) as fault:
                said = f"{printable(given, 30)!r} as {column} in row {row}"
                what = f"{name} has {said}, which is not {wanted}"
                raise InputError("not-a-number", what, "correct that row") from fault
        found.append(np.array(made, dtype=np.float64))
    return np.column_stack(found)


def _number(given: Any) -> float:
    return math.nan if given is None else float(given)


def _three_numbers(given: Any) -> tuple[float, float, float]:
    if given is None:
        return math.nan, math.nan, math.nan
    match = _TRIPLE.fullmatch(given) if isinstance(given, str) else None
    x, y, z = match.groups() if match else () if isinstance(given, str) else given
    return _number(x), _number(y), _number(z)

"""Tables of pins as CSV: index or position, name and colour, and other columns."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, not_readable, printable
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.formats.tables import is_label_set, text_rows
from meshmash_viewer.units import LENGTH_UNITS

__all__ = ["MOST_PINS", "PinTable", "is_pin_table", "pin_table", "read_pins", "write_pins"]

#: Largest number of rows of a table.
MOST_PINS = 500
#: Largest size of a file in bytes.
_LARGEST = 4_000_000
#: Alternative names of columns, with the names used here.
_ALIASES = {"vertex": "index", "vertex_index": "index", "colour": "color", "label": "name"}
_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class PinTable:
    """Vertices or positions to pin, one per row."""

    #: Shape (n,): Vertex index in the mesh file, -1 for pins with only a position.
    indices: IntArray
    #: Shape (n, 3): NaN for pins with only an index.
    positions: FloatArray
    #: Name and colour of each pin, "" for none.
    names: Sequence[str]
    colors: Sequence[str]
    #: Length unit of the positions; "" if not stated.
    unit: str = ""


def pin_table(at: npt.ArrayLike, names: Sequence[str] = (), colors: Sequence[str] = ()) -> PinTable:
    """Return a table of indices, shape (n,), or positions, shape (n, 3), with names and colours.

    `InputError` is raised if the shape is different, or there are neither n nor 0 names or colours.
    """
    given = np.asarray(at)
    whole = given.ndim == 1 and np.issubdtype(given.dtype, np.integer)
    if not given.size or not (whole or (given.ndim == 2 and given.shape[1] == 3)):
        wrong = f"Pins of shape {given.shape} and type {given.dtype} are not known"
        remedy = "give indices of shape (n,), or positions of shape (n, 3)"
        raise InputError("wrong-shape", wrong, remedy)
    n = len(given)
    for what, texts in (("names", names), ("colours", colors)):
        if len(texts) not in (0, n):
            fault = f"There are {n} pins and {len(texts)} {what}"
            raise InputError("counts-differ", fault, "give one for each")
    indices = given.astype(np.int64) if whole else np.full(n, -1)
    positions = np.full((n, 3), np.nan) if whole else given.astype(np.float64)
    return PinTable(indices, positions, tuple(names) or ("",) * n, tuple(colors) or ("",) * n)


def read_pins(path: str | Path) -> PinTable:
    """Read a table of pins from a CSV file.

    The file needs a column ``index`` (or ``vertex``), or columns ``x``, ``y`` and ``z``, whose
    names may have a prefix, such as ``pt_x``, ``pt_y``, ``pt_z``; it may have both. ``name``,
    ``color`` (or ``colour``) and ``unit`` are optional; other columns are ignored. `InputError` is
    raised if the file cannot be read, has no index or position, has too many rows, or has text in
    place of a number.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _LARGEST:
            what = f"{path.name} is too large for a table of pins"
            raise InputError("too-large", what, "select some rows")
        rows, decimal = text_rows(path)
    except OSError as fault:
        raise not_readable(path, fault) from fault
    except csv.Error as fault:
        what = f"{path.name} is no table ({fault})"
        raise InputError("wrong-format", what, "choose another file") from fault
    columns, found = _columns(rows[0] if rows else []), rows[1:]
    if "index" not in columns and not columns.keys() >= set(_AXES):
        named = ", ".join(printable(name, 30) for name in columns) or "none"
        raise InputError(
            "no-column",
            f"{path.name} is no table of pins",
            "it needs a column index, or x, y and z, in its first line, and its columns are"
            f" {named}",
        )
    if len(found) > MOST_PINS:
        what = f"{path.name} has {len(found):,} rows, and at most {MOST_PINS:,} can be pins"
        raise InputError("too-large", what, "select some of them")

    def entries(name: str) -> list[str]:
        at = columns.get(name, -1)
        return [row[at].strip() if 0 <= at < len(row) else "" for row in found]

    def numbers(name: str, missing: float) -> FloatArray:
        return np.array(
            [
                _number(path, at, name, text.replace(decimal, "."), missing)
                for at, text in enumerate(entries(name), 1)
            ]
        )

    units = set(entries("unit")) & set(LENGTH_UNITS)
    return PinTable(
        numbers("index", -1.0).astype(np.int64),
        np.stack([numbers(axis, np.nan) for axis in _AXES], axis=-1),
        entries("name"),
        entries("color"),
        units.pop() if len(units) == 1 else "",
    )


def is_pin_table(path: str | Path) -> bool:
    """Whether a CSV file has a position or index, and a name or colour, unlike tables of maps."""
    path = Path(path)
    try:
        if path.suffix.lower() not in (".csv", ".tsv") or path.stat().st_size > _LARGEST:
            return False
        names = next(iter(text_rows(path)[0]), [])
        columns = _columns(names)
    except (OSError, csv.Error):
        return False
    placed = "index" in columns or columns.keys() >= set(_AXES)
    labels = is_label_set(names) and not columns.keys() >= set(_AXES) and "index" not in names
    return not labels and placed and ("name" in columns or "color" in columns)


def _columns(names: Sequence[str]) -> dict[str, int]:
    """Return the index of each column by its name in lower case."""
    plain = [name.strip().lower() for name in names]
    columns = {_ALIASES.get(name, name): at for at, name in reversed(list(enumerate(plain)))}
    for stem in [name.removesuffix("_x") for name in plain if name.endswith("_x")]:
        if all(f"{stem}_{axis}" in columns for axis in _AXES):
            columns = {axis: columns[f"{stem}_{axis}"] for axis in _AXES} | columns
    return columns


def _number(path: Path, row: int, name: str, text: str, missing: float) -> float:
    try:
        value = float(text) if text else missing
        whole = name != "index" or value == int(value)
    except (ValueError, OverflowError):
        whole = False
    if not whole:
        fault = f"{path.name} has {printable(text, 30)!r} as {name} in row {row}"
        raise InputError("not-a-number", fault, "correct that row")
    return value


def write_pins(path: str | Path, columns: Mapping[str, Sequence[object]]) -> None:
    """Write columns of equal lengths as a table; floating-point numbers keep all digits.

    `InputError` is raised if the file cannot be written.
    """
    path = Path(path)
    with (
        writing_errors(path),
        written_whole(path) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(zip(*columns.values(), strict=True))

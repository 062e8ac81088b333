"""Tables of values per vertex: CSV and Parquet, by pyarrow."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.provenance import second_file
from meshmash_viewer.io.raw import (
    MOST_MAPS,
    RawMap,
    RawMesh,
    are_ascending_indices,
    maps_alone,
)

if TYPE_CHECKING:
    import pyarrow

#: What stands where a number is missing, besides those that pyarrow knows.
_MISSING = ("None", "none", "NONE", "Null", "<NA>", "Nan", "nAn", "-", ".", "?", "NaT", "missing")
#: Columns that only count the rows, as pandas calls them.
_ROW_NUMBERS = ("", "Unnamed: 0", "__index_level_0__")
#: Bytes from which the kind of a table is known.
_BEGINNING = 1_000_000
_LARGEST_BLOCK = 2**31 - 1


def csv_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a table, with or without a first line of names.

    Columns are separated by a comma, semicolon, tab or space. Lines in front that begin with "#"
    are comments, the last of which may hold the names. Where a number is missing, a field is empty
    or holds "None", "NA", "NaN", "null" or the like.
    """
    import pyarrow
    import pyarrow.csv

    layout, separator, decimal = text_layout(path)
    # in one block: the type of a column is that of all its rows, not of the first thousands
    block = min(path.stat().st_size * 4 + 1000, _LARGEST_BLOCK)
    read = pyarrow.csv.ReadOptions(use_threads=False, block_size=block, **layout)
    convert = pyarrow.csv.ConvertOptions(decimal_point=decimal, strings_can_be_null=True)
    missing = [*convert.null_values, *_MISSING]
    convert.null_values = [*missing, *(f" {each}" for each in missing)]
    parse = pyarrow.csv.ParseOptions(delimiter=separator)
    try:
        table = pyarrow.csv.read_csv(path, read, parse, convert)
    except pyarrow.ArrowInvalid as fault:
        raise InputError(f"is no table ({printable(fault)})") from fault
    if read.autogenerate_column_names and len(table.column_names) == 1:
        table = table.rename_columns([""])
    return replace(_maps(table), meta=second_file(path))


def parquet_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a Parquet table."""
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path, use_threads=False)
    said = (table.schema.metadata or {}).get(b"meshmash-viewer", b"")
    return replace(_maps(table), meta=said.decode("utf-8", "replace"))


def text_layout(path: Path) -> tuple[dict[str, Any], str, str]:
    """Return how a text is divided: its lines, and the signs between and within numbers."""
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    encoding = _encoding(beginning)
    lines = beginning.decode(encoding, "replace").removeprefix("\ufeff").splitlines()
    skipped = next((at for at, line in enumerate(lines) if not line.startswith("#")), 0)
    first = lines[skipped] if lines else ""
    separator = next((sign for sign in "\t;," if sign in first), ",")
    if separator == "," and len(first.split()) > 1 and all(map(_is_number, first.split())):
        separator = " "
    decimal = "," if separator == ";" and re.search(r"\d,\d", "\n".join(lines[:100])) else "."
    words = _words(first, separator)
    named = not all(_is_number(word.replace(decimal, ".")) for word in words)
    names = None
    if skipped and not named:
        above = _words(lines[skipped - 1].lstrip("# "), separator)
        names = above if len(above) == len(words) else None
    layout = {
        "encoding": encoding,
        "skip_rows": skipped,
        "column_names": names,
        "autogenerate_column_names": names is None and not named,
    }
    return layout, separator, decimal


def _encoding(beginning: bytes) -> str:
    """UTF-16 or UTF-8 by their marks, UTF-8 without, and else that of Windows."""
    if beginning.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        beginning[: beginning.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _words(line: str, separator: str) -> list[str]:
    return [word.strip(' "') for word in line.strip().split(separator)]


def _is_number(word: str) -> bool:
    """Whether a field holds a number, or says that it is missing."""
    try:
        float(word)
    except ValueError:
        return word in _MISSING or word.lower() in ("", "na", "n/a", "#n/a", "null")
    return "_" not in word


def _maps(table: pyarrow.Table) -> RawMesh:
    """The columns of numbers; one called "vertex" says which vertex a row is for."""
    columns: list[tuple[str, npt.NDArray[Any]]] = []
    left_out: list[str] = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        try:
            values = _numbers(column)
        except InputError as fault:
            left_out.append(f"{printable(name, 60)!r} ({fault})")
            continue
        if name not in _ROW_NUMBERS or not np.array_equal(values, np.arange(len(values))):
            columns.append((name, values))
    order, rows = _rows([values for name, values in columns if name == "vertex"])
    found = [
        RawMap(name, np.ascontiguousarray(values if order is None else values[order]), rows=rows)
        for name, values in columns
        if name != "vertex"
    ]
    if not found:
        raise InputError("has no column of numbers")
    if len(found) > MOST_MAPS:
        raise InputError(f"has {len(found):,} columns, of which {MOST_MAPS} can be taken at most")
    said = f"has columns that are left out: {', '.join(left_out)}"
    return maps_alone(found, (said,) if left_out else ())


def _numbers(column: pyarrow.ChunkedArray) -> npt.NDArray[Any]:
    """The numbers of a column, NaN where one is missing."""
    import pyarrow
    from pyarrow import types

    kind = column.type
    if types.is_null(kind) or column.null_count == len(column):
        raise InputError("it is empty")
    if types.is_boolean(kind):
        column = column.cast(pyarrow.uint8())
    elif types.is_decimal(kind) or types.is_float16(kind):
        column = column.cast(pyarrow.float64())
    elif not (types.is_integer(kind) or types.is_floating(kind)):
        example = next(each for each in column.to_pylist() if each is not None)
        raise InputError(f"not numbers, such as {printable(example, 30)!r}")
    values: npt.NDArray[Any] = column.to_numpy()
    return values


def _rows(
    named: list[npt.NDArray[Any]],
) -> tuple[npt.NDArray[np.int64] | None, npt.NDArray[np.int64] | None]:
    """An order of rows in which their vertices ascend, and these if they are not all of them."""
    if not named:
        return None, None
    if len(named) > 1:
        raise InputError(f"has {len(named)} columns called vertex")
    order = np.argsort(named[0], kind="stable").astype(np.int64)
    rows = named[0][order]
    if not are_ascending_indices(rows):
        raise InputError("has a column vertex that is not an index from 0 in each row, once")
    all_of_them = not len(rows) or rows[-1] < len(rows)
    return order, None if all_of_them else rows.astype(np.int64)

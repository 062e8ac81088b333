"""Readers of tables of values per vertex, CSV and Parquet, by pyarrow."""

from __future__ import annotations

import colorsys
import contextlib
import csv
import io
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable, wrong_format
from meshmash_viewer.io.provenance import second_file
from meshmash_viewer.io.raw import (
    MOST_MAPS,
    RawMap,
    RawMesh,
    are_ascending_indices,
    maps_alone,
    too_many_maps,
)
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import COLOR, Label

if TYPE_CHECKING:
    import pyarrow

#: Texts that stand for a missing number, in addition to those of pyarrow.
_MISSING = (
    "None", "none", "NONE", "Null", "<NA>", "Nan", "nAn", "-", ".", "?", "NaT", "missing",
    "#DIV/0!", "#NUM!", "#VALUE!", "#REF!",
)  # fmt: skip
#: Names of columns of row numbers in files of pandas.
_ROW_NUMBERS = ("", "Unnamed: 0", "__index_level_0__")
#: Columns with the names and colours of labels in the column "label".
_TEXTS = ("name", "color", "colour")
#: Number of bytes that are read to find the separator of columns.
_BEGINNING = 1_000_000
#: Line of Excel that states the separator of columns.
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?\s*$', re.IGNORECASE)
#: Line with a number with a decimal comma, or with two integers separated by a comma.
_ONE_DECIMAL = re.compile(r"\s*[-+]?\d+,\d+\s*")
_LARGEST_BLOCK = 2**31 - 1


def csv_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a text table, with or without a first line of names.

    Columns are separated by a comma, semicolon, tab or spaces. The decimal sign is a point, or a
    comma if commas do not separate columns. The first lines may be comments that begin with "#",
    and column names may be in the last comment. A missing number is an empty field or a text such
    as "None", "NA", "NaN" or "null".
    """
    table = text_table(path)
    if table.column_names == ["f0", "f1"]:
        _check_integers(path, *table.columns)
    return replace(_maps(table), meta=second_file(path))


def _check_integers(path: Path, first: pyarrow.ChunkedArray, second: pyarrow.ChunkedArray) -> None:
    """Raise `InputError` for lines such as "0,501" that may as well be decimal numbers.

    All have the same number of digits after the comma, at least two, as decimals have, and the
    numbers before the comma do not ascend, as indices of vertices do.
    """
    with path.open("rb") as file:
        line = file.readline().decode("latin-1").strip()
    if _ONE_DECIMAL.fullmatch(line) is None or first.null_count or second.null_count:
        return
    widths = {len(str(end)) for end in (second.to_numpy().min(), second.to_numpy().max())}
    if len(widths) == 1 and min(widths) > 1 and not (np.diff(first.to_numpy()) > 0).all():
        fault = "has lines of one number with a decimal comma, or of two whole numbers"
        remedy = "write decimals with a point, or separate columns by a semicolon"
        raise InputError("wrong-format", fault, remedy)


def text_table(path: Path, most: int | None = None) -> pyarrow.Table:
    """Read a text table; with `most`, only the complete lines in the first `most` bytes."""
    import pyarrow
    import pyarrow.csv

    layout, separator, decimal = text_layout(path)
    # a single block, as pyarrow infers the types of columns from the first block
    block = min(path.stat().st_size * 4 + 1000, _LARGEST_BLOCK)
    read = pyarrow.csv.ReadOptions(use_threads=False, block_size=block, **layout)
    convert = pyarrow.csv.ConvertOptions(decimal_point=decimal, strings_can_be_null=True)
    missing = [*convert.null_values, *_MISSING]
    convert.null_values = [*missing, *(f" {each}" for each in missing)]
    parse = pyarrow.csv.ParseOptions(delimiter=separator)
    with path.open("rb") as file:
        content = file.read(-1 if most is None else most)
        if file.read(1):
            content = content.rpartition(b"\n")[0]
    if separator == " ":
        content = re.sub(rb"(?m)^ +| +\r?$|(?<= ) +", b"", content)

    def table() -> pyarrow.Table:
        return pyarrow.csv.read_csv(io.BytesIO(content), read, parse, convert)

    try:
        found = table()
        if is_label_set(found.column_names):  # a label may be called "none", or 007
            convert.quoted_strings_can_be_null = False
            convert.column_types = dict.fromkeys(_TEXTS, pyarrow.string())
            found = table()
    except pyarrow.ArrowInvalid as fault:
        raise wrong_format(f"is no table ({printable(fault)})") from fault
    named = zip(found.column_names, found.columns, strict=True)
    if wide := [name for name, column in named if _is_wide(column)]:
        convert.column_types = {**convert.column_types, **dict.fromkeys(wide, pyarrow.uint64())}
        with contextlib.suppress(pyarrow.ArrowInvalid):  # not integers
            found = table()
    if read.autogenerate_column_names and len(found.column_names) == 1:
        found = found.rename_columns([""])
    return found


def parquet_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a Parquet table."""
    import pyarrow.parquet

    table = plain_table(pyarrow.parquet.read_table(path, use_threads=False))
    if {"mesh", "output", "proof"} <= set(table.column_names):
        raise wrong_format("is the manifest of a command, with a row for each mesh")
    said = (table.schema.metadata or {}).get(b"meshmash-viewer", b"")
    return replace(_maps(table), meta=said.decode("utf-8", "replace"))


def plain_table(table: pyarrow.Table) -> pyarrow.Table:
    """Return a table of pandas with categories as values, and its named index as a column.

    pandas stores an index of evenly spaced numbers, such as reversed vertices, in the metadata.
    """
    import pyarrow

    try:
        index = (table.schema.pandas_metadata or {}).get("index_columns", [])
    except ValueError:  # metadata of another program
        index = []
    for level in index:
        if (
            isinstance(level, dict)
            and level.get("name")
            and level["name"] not in table.column_names
        ):
            numbers = np.arange(table.num_rows) * level["step"] + level["start"]
            table = table.append_column(level["name"], pyarrow.array(numbers))
    for at, field in enumerate(table.schema):
        if pyarrow.types.is_dictionary(field.type):
            table = table.set_column(at, field.name, table[at].cast(field.type.value_type))
    return table


def text_layout(path: Path) -> tuple[dict[str, Any], str, str]:
    """Return reading options of pyarrow, the column separator, and the decimal sign."""
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    encoding = _encoding(beginning)
    lines = beginning.decode(encoding, "replace").removeprefix("\ufeff").splitlines()
    stated = _SEPARATOR_LINE.match(lines[0]) if lines else None
    skipped = next((at for at, line in enumerate(lines) if not line.startswith("#")), 0)
    skipped = 1 if stated else skipped
    first, *rows = lines[skipped : skipped + 100] or [""]
    separator, decimal = _signs(first, rows, stated[1] if stated else "")
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


def _signs(first: str, rows: list[str], separator: str) -> tuple[str, str]:
    """Return the column separator, which is guessed if `separator` is "", and the decimal sign.

    `first` is the first line, which may have names; `rows` are some lines after it.
    """
    separator = separator or next((sign for sign in "\t;," if sign in first), "")
    words = (rows or [first])[0].split()
    if separator in ("", ",") and len(first.split()) == len(words) > 1:
        separator = " " if all(map(_is_number, words)) else separator
    text = "\n".join([first, *rows])
    if separator not in ("", ","):
        return separator, "," if re.search(r"\d,\d", text) else "."
    if all(map(_ONE_DECIMAL.fullmatch, [first, *rows])) and re.search(r",0\d", text):
        return ";", ","  # digits after the comma are decimals, as integers do not begin with 0
    # three digits after a comma may be decimals or thousands
    quote = '"' if separator else ""
    found = re.search(rf"{quote}[-+]?(0,\d|\d+,(?!\d{{3}}\b)\d)", text)
    return separator or (";" if found else ","), "," if found else "."


def _is_wide(column: pyarrow.ChunkedArray) -> bool:
    """Whether a floating-point column may hold unsigned 64-bit integers."""
    import pyarrow.compute

    if not pyarrow.types.is_floating(column.type):
        return False
    return bool((pyarrow.compute.max(column).as_py() or 0.0) >= 2.0**63)


def text_rows(path: Path) -> tuple[list[list[str]], str]:
    """Return the rows that are not empty, column names first if any, and the decimal sign."""
    layout, separator, decimal = text_layout(path)
    lines = path.read_text(encoding=layout["encoding"], errors="replace").removeprefix("\ufeff")
    reader = csv.reader(
        lines.splitlines()[layout["skip_rows"] :],
        delimiter=separator,
        skipinitialspace=separator == " ",
    )
    rows = [row for row in reader if any(map(str.strip, row))]
    return ([layout["column_names"]] if layout["column_names"] else []) + rows, decimal


def _encoding(beginning: bytes) -> str:
    """Return "utf-16" for text with a mark of UTF-16, "utf-8" if valid, else "cp1252"."""
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
    """Whether a field is a number or a text for a missing number."""
    try:
        float(word)
    except ValueError:
        return word in _MISSING or word.lower() in ("", "na", "n/a", "#n/a", "null")
    return "_" not in word


def _maps(table: pyarrow.Table) -> RawMesh:
    """Return a map per column of numbers; a column "vertex" has the vertex index of each row.

    A column "label" becomes a label set if it is text, or there is a column "name" or "color".
    """
    numbers, labels = _label_set(table)
    columns: list[tuple[str, npt.NDArray[Any]]] = [("label", numbers)] if labels else []
    left_out: list[str] = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if labels and name in ("label", *_TEXTS):
            continue
        try:
            values = _numbers(column)
        except InputError as fault:
            left_out.append(f"{printable(name, 60)!r} ({fault.clause})")
            continue
        if not counts_rows(name, values) or table.num_columns == 1:
            columns.append((name, values))
    order, rows = _rows([values for name, values in columns if name == "vertex"])
    found = [
        RawMap(
            "" if values is numbers else name,
            np.ascontiguousarray(values if order is None else values[order]),
            labels if values is numbers else (),
            rows,
        )
        for name, values in columns
        if name != "vertex"
    ]
    if not found:
        columns_said = printable(", ".join(left_out), 200) if left_out else "it has no columns"
        raise InputError("no-values", "has no column of numbers", f"{columns_said}")
    if len(found) > MOST_MAPS >= table.num_rows:
        raise InputError(
            "counts-differ",
            f"has {counted(table.num_rows, 'row')} of {len(found):,} numbers and needs a row for"
            " each vertex, so transpose it",
        )
    if len(found) > MOST_MAPS:
        raise too_many_maps(len(found))
    said = f"has columns that are left out: {', '.join(left_out)}"
    return maps_alone(found, (said,) if left_out else ())


def counts_rows(name: str, values: npt.NDArray[Any]) -> bool:
    """Whether a column holds row numbers, as pandas writes them."""
    numbered = name in _ROW_NUMBERS and values.dtype.kind in "iuf"
    return numbered and np.array_equal(values, np.arange(len(values)))


def is_label_set(names: Iterable[str]) -> bool:
    """Whether a table with these columns has names or colours of labels."""
    return "label" in names and any(name in names for name in _TEXTS)


def _label_set(table: pyarrow.Table) -> tuple[npt.NDArray[Any], tuple[Label, ...]]:
    """Return the label number of each row, and the labels; empty if the table has no label set.

    A number with neither name nor colour, and a missing number, is not a label.
    """
    from pyarrow import types

    none: tuple[npt.NDArray[Any], tuple[Label, ...]] = np.zeros(0), ()
    if table.column_names.count("label") != 1 or table["label"].null_count == table.num_rows:
        return none
    column = table["label"].combine_chunks()
    defaults: list[str] = []
    if types.is_string(column.type) or types.is_large_string(column.type):
        coded = column.dictionary_encode()
        numbers = coded.indices.fill_null(-1).to_numpy() + np.int64(1)
        defaults = ["", *coded.dictionary.to_pylist()]
    elif is_label_set(table.column_names):
        numbers = np.nan_to_num(_numbers(table["label"]))
    else:
        return none
    keys, first = np.unique(numbers, return_index=True)
    said = {
        part: _one_of_each(table[part], part, numbers, first)
        for part in _TEXTS
        if table.column_names.count(part) == 1
    }
    labels = []
    for at, key in enumerate(map(int, keys)):
        name, color = (said[part][at] if part in said else None for part in ("name", "color"))
        color = color or (said["colour"][at] if "colour" in said else None)
        if (defaults and key) or (not defaults and (name or color)):
            name = name or (defaults[key] if defaults else str(key))
            labels.append(Label(key, name, color or _spread_color(at)))
    return numbers, tuple(labels)


def _one_of_each(
    column: pyarrow.ChunkedArray, part: str, numbers: npt.NDArray[Any], first: npt.NDArray[Any]
) -> list[str | None]:
    """Return the text of each label number; `InputError` is raised if rows of a label differ."""
    coded = column.combine_chunks().dictionary_encode()
    codes = coded.indices.fill_null(-1).to_numpy()
    places = np.searchsorted(numbers[first], numbers)
    other = np.flatnonzero(codes != codes[first][places])
    if len(other):
        what = f"Map 'label' has two texts in the column {part} for the label {numbers[other[0]]:g}"
        raise InputError("given-twice", what, "give each label one")
    texts = [None if text is None else str(text) for text in coded.dictionary.to_pylist()]
    wrong = [text for text in texts if text and part != "name" and not COLOR.fullmatch(text)]
    if wrong:
        fault = f"Map 'label' has the colour {printable(wrong[0], 30)!r}"
        raise InputError("wrong-color", fault, "write it as #rrggbb")
    return [texts[code] if code >= 0 else None for code in codes[first].tolist()]


def _spread_color(place: int) -> str:
    """Return a colour for the label with index `place`; consecutive labels get distant hues."""
    shares = colorsys.hls_to_rgb(place * 0.618034 % 1.0, 0.55, 0.6)
    return "#" + "".join(f"{round(255 * share):02x}" for share in shares)


def _numbers(column: pyarrow.ChunkedArray) -> npt.NDArray[Any]:
    """Return the numbers of a column, NaN if missing; `InputError` is raised if it has none."""
    import pyarrow.compute
    from pyarrow import types

    kind = column.type
    if types.is_null(kind) or column.null_count == len(column):
        raise InputError("no-values", "it is empty")
    if types.is_boolean(kind):
        column = column.cast(pyarrow.uint8())
    elif types.is_decimal(kind) or types.is_float16(kind):
        column = column.cast(pyarrow.float64())
    elif not (types.is_integer(kind) or types.is_floating(kind)):
        texts = [str(each) for each in column.to_pylist() if each is not None]
        example = next((each for each in texts if not _is_number(each)), texts[0])
        raise InputError("not-a-number", f"not numbers, such as {printable(example, 30)!r}")
    if types.is_integer(kind) and column.null_count:
        largest = max(map(abs, pyarrow.compute.min_max(column).as_py().values()))
        if largest > 2**53:  # NumPy has no missing integers
            raise InputError("not-exact", f"{largest} would be rounded, as numbers are missing")
    values: npt.NDArray[Any] = column.to_numpy()
    return values


def _rows(
    named: list[npt.NDArray[Any]],
) -> tuple[npt.NDArray[np.int64] | None, npt.NDArray[np.int64] | None]:
    """Return the row order by the column "vertex", if any, and the indices if some are missing."""
    if not named:
        return None, None
    if len(named) > 1:
        raise InputError("given-twice", f"has {len(named)} columns called vertex")
    order = np.argsort(named[0], kind="stable").astype(np.int64)
    rows = named[0][order]
    if not are_ascending_indices(rows):
        fault = "has a column vertex that is not an index from 0 in each row, once"
        raise InputError("vertex-out-of-range", fault)
    all_of_them = not len(rows) or rows[-1] < len(rows)
    return order, None if all_of_them else rows.astype(np.int64)

"""Reader of surface datasets of AFNI and SUMA: ``.niml.dset`` in text or binary, ``.1D.dset``.

A NIML dataset consists of elements ``<NAME attribute="value" …>data</NAME>``: ``SPARSE_DATA`` has
one row for each vertex, ``INDEX_LIST`` the vertices of the rows, and an ``AFNI_atr`` the names of
the columns. ``AFNI_labeltable`` contains a ``SPARSE_DATA`` of colours, numbers and names of labels.
A 1D dataset is a text of columns of numbers, with the attributes in comments.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.raw import RawMap, RawMesh, maps_alone
from meshmash_viewer.vertex_map import Label

_ELEMENT = re.compile(
    rb"<(?P<name>SPARSE_DATA|INDEX_LIST|AFNI_atr|/?AFNI_labeltable)\b(?P<attributes>[^>]*)>"
)
_ATTRIBUTE = re.compile(r"""([\w.]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
#: Text in quotes, or a word.
_WORD = re.compile(r""""([^"]*)"|'([^']*)'|(\S+)""")
#: Types of NIML as NumPy types.
_TYPES = {"byte": "u1", "short": "i2", "int": "i4", "float": "f4", "double": "f8", "String": "O"}
#: Largest number of columns of one type.
_MOST_COLUMNS = 10_000
_REMEDY = "write it with ConvertDset -o_1D or -o_gii, and read that file"

_Columns = list[npt.NDArray[Any]]


def afni_maps(path: Path) -> RawMesh:
    """Read the columns of a dataset, with their names, vertices and labels."""
    content = path.read_bytes()
    try:
        found = _niml(content) if content.lstrip().startswith(b"<") else _numbers(content)
    except (ValueError, IndexError, KeyError, TypeError) as fault:
        if isinstance(fault, InputError):
            raise
        said = f"is no surface dataset of AFNI ({printable(fault, 60)}): {_REMEDY}"
        raise InputError(said) from fault
    return maps_alone(found)


def _niml(content: bytes) -> list[RawMap]:
    columns, labels, rows = _Columns(), tuple[Label, ...](), None
    names, at, in_table = list[str](), 0, False
    while element := _ELEMENT.search(content, at):
        at, name = element.end(), element["name"].decode()
        text = element["attributes"].decode("utf-8", "replace")
        if name.endswith("AFNI_labeltable"):
            in_table = not name.startswith("/")
        elif not text.endswith("/"):
            about = _attributes(text)
            if name == "AFNI_atr" and (about.get("atr_name") != "COLMS_LABS" or in_table):
                continue
            data, at = _data(content, at, about)
            if name == "AFNI_atr":
                names = str(data[0][0]).split(";")
            elif name == "INDEX_LIST":
                rows = data[0].astype(np.int64)
            elif in_table:
                labels = _labels(data)
            else:
                columns = data
    return _maps(columns, names, rows, labels)


def _attributes(text: str) -> dict[str, str]:
    return {name: one or other for name, one, other in _ATTRIBUTE.findall(text)}


def _data(content: bytes, start: int, about: dict[str, str]) -> tuple[_Columns, int]:
    """Return the columns of an element whose data begin at `start`, and where they end."""
    types = list[str]()
    for each in about["ni_type"].split(","):
        count, _, kind = each.rpartition("*")
        if int(count or 1) > _MOST_COLUMNS:
            raise InputError(f"has more than {_MOST_COLUMNS:,} columns: {_REMEDY}")
        types += [_TYPES[kind.strip()]] * int(count or 1)
    n_rows, form = int(about.get("ni_dimen", "1").split(",")[0]), about.get("ni_form", "text")
    if form.startswith("binary") and "O" not in types:
        order = ">" if form.endswith("msbfirst") else "<"
        row = np.dtype([(str(place), order + each) for place, each in enumerate(types)])
        table = np.frombuffer(content, row, n_rows, start)
        return [table[name] for name in row.names or ()], start + table.nbytes
    if form != "text":
        raise InputError(
            f"is an AFNI dataset with data in the form {printable(form, 30)}: {_REMEDY}"
        )
    end = content.index(b"</", start)
    if types == ["O"] and n_rows == 1:  # may contain spaces without quotes
        whole = content[start:end].decode("utf-8", "replace").strip().strip("\"'")
        return [np.array([whole], object)], end
    words = ["".join(each) for each in _WORD.findall(content[start:end].decode("utf-8", "replace"))]
    if len(words) != n_rows * len(types):
        raise ValueError(f"{n_rows * len(types)} values expected, {len(words)} found")
    return [
        np.array(words[place :: len(types)], object if each == "O" else np.float64).astype(each)
        for place, each in enumerate(types)
    ], end


def _labels(columns: _Columns) -> tuple[Label, ...]:
    """Return the labels of a table with red, green, blue, opacity, number and name."""
    red, green, blue, _, keys, names = columns
    shares = np.clip(np.stack([red, green, blue], axis=1).astype(np.float64), 0.0, 1.0)
    return tuple(
        Label(int(key), str(name), "#" + bytes(np.rint(255.0 * color).astype(np.uint8)).hex())
        for key, name, color in zip(keys, names, shares, strict=True)
    )


def _numbers(content: bytes) -> list[RawMap]:
    """Read a 1D dataset; a first column of ascending whole numbers is the vertices of the rows."""
    text = content.decode("utf-8")
    comments = "\n".join(re.findall(r"(?m)^\s*#(.*)$", text))
    table = np.array(
        [line.split() for each in text.splitlines() if (line := each.partition("#")[0]).strip()],
        dtype=np.float64,
    )
    names = [each.strip() for each in _attributes(comments).get("ColumnLabels", "").split(";")]
    first, rows = table[:, 0], None
    if table.shape[1] > 1 and np.array_equal(first, np.rint(first)) and (np.diff(first) > 0).all():
        rows, table = first.astype(np.int64), table[:, 1:]
    return _maps(list(table.T), names[-table.shape[1] :], rows, ())


def _maps(
    columns: _Columns, names: list[str], rows: npt.NDArray[np.int64] | None,
    labels: tuple[Label, ...],
) -> list[RawMap]:  # fmt: skip
    if rows is not None and len(rows) and rows.min() < 0:
        raise ValueError("a negative vertex")
    if rows is not None and any(len(rows) != len(each) for each in columns):
        raise ValueError("another number of vertices than of rows")
    names = names if len(names) == len(columns) else [""] * len(columns)
    return [
        RawMap(name.strip(), np.array(each), labels if each.dtype.kind in "iu" else (), rows)
        for name, each in zip(names, columns, strict=True)
    ]

"""Text files: byte order marks, line ends, and rows of numbers under a header."""

from __future__ import annotations

import codecs
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.mesh import FloatArray, IntArray

#: What text may begin with, longer ones first: those of UTF-32 begin with those of UTF-16.
_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}

#: A list property: its values one after the other, and how many each row has.
Lists: TypeAlias = tuple[npt.NDArray[Any], IntArray]
#: The values of each property by its name.
Columns: TypeAlias = dict[str, npt.NDArray[Any] | Lists]


def read_text(path: Path) -> bytes:
    r"""Read a text file as UTF-8 without byte order marks, its lines ended by ``\n``.

    Raises
    ------
    InputError
        If it begins as UTF-16 or UTF-32 and is not.
    """
    data = with_newlines(unmarked(path.read_bytes()))
    # of files that were copied one after the other
    return data.replace(b"\n" + codecs.BOM_UTF8, b"\n") if codecs.BOM_UTF8 in data else data


def unmarked(data: bytes) -> bytes:
    """The same without a byte order mark at its beginning, as UTF-8.

    Raises
    ------
    InputError
        If it begins as UTF-16 or UTF-32 and is not.
    """
    while data.startswith(codecs.BOM_UTF8):
        data = data[len(codecs.BOM_UTF8) :]
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            try:
                return data[len(mark) :].decode(encoding).encode()
            except UnicodeError:
                name = encoding[:-3].upper()
                raise InputError(f"begins as text in {name} and has something else") from None
    return data


def with_newlines(data: bytes) -> bytes:
    r"""The same with lines ended by ``\n``."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data


@dataclass(frozen=True)
class Property:
    """A number in a row, or a list of them after their number, of types in NumPy's words."""

    name: str
    value_type: str = "f8"
    count_type: str | None = None


@dataclass
class Element:
    """Rows of the same properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class CutShort(InputError):
    """What a file lacks of an element, of which it has but some rows."""

    def __init__(self, element: Element, available: int) -> None:
        super().__init__(
            f"promises {printable(element.count, 24)} of its element"
            f" {printable(element.name, 40)!r} but ends after {available}, so it was cut short"
        )


class _ShortLine(InputError):
    """A line with fewer numbers than its row needs."""


def rows_of_text(
    elements: list[Element], numbers: FloatArray, counts: IntArray, *, ragged: bool = False
) -> list[Columns]:
    """Take the elements of a text one after the other, each row a line if it can be so.

    Lines may have more numbers than their rows, the same number more in each of an element. Where
    there are more or fewer lines than rows, line ends have no meaning, and all numbers are used.

    Parameters
    ----------
    elements : list of Element
    numbers, counts : ndarray
        See `meshmash_viewer.io.polygons.parse_rows`.
    ragged : bool
        Whether lines with lists may differ in what they have more.

    Raises
    ------
    CutShort
        If there are too few numbers.
    InputError
        If there are too many, or a list has no length.
    """
    filled = [element for element in elements if element.properties]
    starts = np.cumsum(counts) - counts
    if len(counts) == sum(element.count for element in filled):
        try:
            return _by_lines(elements, numbers, starts, counts, ragged)
        except _ShortLine:
            pass
    columns: list[Columns] = []
    place = 0
    for element in elements:
        if not element.properties:
            columns.append({})
            continue
        rows, place = _places_of_rows(element, numbers, place)
        columns.append(_columns(element, numbers, rows)[0])
    if place < len(numbers):
        more = len(numbers) - place
        raise InputError(
            f"holds {more:,} {'numbers' if more > 1 else 'number'} more than its header describes"
        )
    return columns


def _by_lines(
    elements: list[Element], numbers: FloatArray, starts: IntArray, counts: IntArray, ragged: bool
) -> list[Columns]:
    columns: list[Columns] = []
    line = 0
    for element in elements:
        lines = slice(line, line + (element.count if element.properties else 0))
        taken, more = _columns(element, numbers, starts[lines], counts[lines])
        columns.append(taken)
        line = lines.stop
        has_list = any(prop.count_type for prop in element.properties)
        if len(more) and not (ragged and has_list) and more.min() != more.max():
            raise InputError(
                f"has rows of its element {printable(element.name, 40)!r} with differently many"
                " numbers more than its header describes"
            )
    return columns


def _columns(
    element: Element, numbers: FloatArray, rows: IntArray, counts: IntArray | None = None
) -> tuple[Columns, IntArray]:
    """The values of rows that begin at some places, and how many numbers each has more."""
    columns: Columns = {}
    place = rows.copy()
    ends = np.full(len(rows), len(numbers)) if counts is None else rows + counts
    for prop in element.properties:
        if (place >= ends).any():
            raise _ShortLine
        if prop.count_type is None:
            columns[prop.name] = numbers[place]
            place += 1
            continue
        stated = numbers[place]
        place += 1
        sound = (stated >= 0) & (stated < 2.0**40) & (stated == np.floor(stated))
        if not sound.all():
            raise InputError(f"has a list of {stated[~sound][0]:g} entries")
        lengths = stated.astype(np.int64)
        if (place + lengths > ends).any():
            raise _ShortLine
        first = np.cumsum(lengths) - lengths
        within = np.arange(int(lengths.sum())) + np.repeat(place - first, lengths)
        columns[prop.name] = numbers[within], lengths
        place += lengths
    return columns, ends - place


def _places_of_rows(element: Element, numbers: FloatArray, place: int) -> tuple[IntArray, int]:
    """Where each row begins if line ends have no meaning, and where the last one ends."""
    lists = [at for at, prop in enumerate(element.properties) if prop.count_type is not None]
    if not lists:
        width = len(element.properties)
        available = (len(numbers) - place) // width
        if available < element.count:
            raise CutShort(element, available)
        return place + width * np.arange(element.count), place + width * element.count
    rows = []
    for done in range(element.count):
        rows.append(place)
        for prop in element.properties:
            if place >= len(numbers):
                raise CutShort(element, done)
            if prop.count_type is not None:
                length = float(numbers[place])
                if not (0 <= length < 2**40 and length == int(length)):
                    raise InputError(f"has a list of {length:g} entries")
                place += int(length)
            place += 1
        if place > len(numbers):
            raise CutShort(element, done)
    return np.array(rows, dtype=np.int64), place

"""Rows of numbers and lists under a header, as PLY and OFF files have them, in text or in bytes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, printable

#: A list property: its values one after the other, and how many each row has.
Lists: TypeAlias = tuple[npt.NDArray[Any], IntArray]
#: The values of each property by its name.
Columns: TypeAlias = dict[str, npt.NDArray[Any] | Lists]
Bytes: TypeAlias = npt.NDArray[np.uint8]

_NUMBER: np.dtype[Any] = np.dtype("f8")


@dataclass(frozen=True)
class Property:
    """A number in a row, or where `count_type` is given a list of numbers after their count."""

    name: str
    value_type: np.dtype[Any] = _NUMBER
    count_type: np.dtype[Any] | None = None


@dataclass
class Element:
    """Rows of the same properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class CutShort(InputError):
    """A file has fewer rows of an element than its header says."""

    def __init__(self, element: Element, available: int) -> None:
        super().__init__(
            f"promises {printable(element.count, 24)} of its element"
            f" {printable(element.name, 40)!r} but ends after {available}, so it was cut short"
        )


class _ShortRow(InputError):
    """A row ends beyond its limit."""


def rows_of_text(
    elements: list[Element], numbers: FloatArray, counts: IntArray, *, ragged: bool = False
) -> list[Columns]:
    """Take the elements of a text one after the other, each row a line if possible.

    Lines without a number are left out. Lines may have more numbers than their rows, the same
    number more in each of an element. Where there are more or fewer lines than rows, line ends have
    no meaning, and all numbers are used.

    All properties are 64-bit floating-point numbers; `numbers` and `counts` are those of
    `meshmash_viewer.io.text.parse_rows`. Where `ragged`, lines with lists may differ in what they
    have more.

    `CutShort` is raised if there are too few numbers; `InputError` if there are too many, or a list
    has no length.
    """
    data, counts = numbers.view(np.uint8), counts[counts > 0]
    if len(counts) == sum(element.count for element in elements if element.properties):
        try:
            return _rows_by_lines(elements, data, counts, ragged)
        except _ShortRow:
            pass
    columns, end = take_rows(elements, data)
    if more := (len(data) - end) // _NUMBER.itemsize:
        raise InputError(
            f"holds {more:,} {'numbers' if more > 1 else 'number'} more than its header describes"
        )
    return columns


def take_rows(elements: list[Element], data: Bytes) -> tuple[list[Columns], int]:
    """Take the elements from the front of bytes; return their columns and the end of the last.

    `CutShort` is raised if there are too few bytes, and `InputError` if a list has no length.
    """
    columns: list[Columns] = []
    place = 0
    for element in elements:
        if not element.properties:
            columns.append({})
            continue
        starts = _row_starts(element, data, place)
        layout, ends = _layout(element, data, starts, np.full(len(starts), len(data)))
        columns.append(_columns(layout, data))
        place = int(ends.max(initial=place))
    return columns, place


def _rows_by_lines(
    elements: list[Element], data: Bytes, counts: IntArray, ragged: bool
) -> list[Columns]:
    columns: list[Columns] = []
    line_ends = np.cumsum(counts) * _NUMBER.itemsize
    line_starts = line_ends - counts * _NUMBER.itemsize
    line = 0
    for element in elements:
        lines = slice(line, line + (element.count if element.properties else 0))
        layout, ends = _layout(element, data, line_starts[lines], line_ends[lines])
        columns.append(_columns(layout, data))
        line = lines.stop
        more = line_ends[lines] - ends
        has_list = any(prop.count_type for prop in element.properties)
        if len(more) and not (ragged and has_list) and more.min() != more.max():
            raise InputError(
                f"has rows of its element {printable(element.name, 40)!r} with differently many"
                " numbers more than its header describes"
            )
    return columns


def _row_starts(element: Element, data: Bytes, place: int) -> IntArray:
    """Return where each row begins; lists are first assumed to be as long as in the first row."""
    if not element.count:
        return np.zeros(0, dtype=np.int64)
    width = _counted_starts(element, data, place, 1)[1] - place
    if place + width * element.count <= len(data):
        starts = place + width * np.arange(element.count)
        try:
            _, ends = _layout(element, data, starts, np.full(len(starts), len(data)))
        except InputError:
            ends = starts
        if np.array_equal(ends, starts + width):
            return starts
    return np.array(_counted_starts(element, data, place, element.count)[0], dtype=np.int64)


def _counted_starts(element: Element, data: Bytes, place: int, count: int) -> tuple[list[int], int]:
    """Return where some rows begin, one after the other, and where the last one ends."""
    steps = [
        (prop.value_type.itemsize, prop.count_type and _at_each_byte(data, prop.count_type))
        for prop in element.properties
    ]
    starts: list[int] = []
    for done in range(count):
        starts.append(place)
        for size, lengths in steps:
            length = 1
            if lengths is not None:
                if place >= len(lengths):
                    raise CutShort(element, done)
                stated = lengths.item(place)
                if not (0 <= stated < 2**40 and stated == int(stated)):
                    raise _no_length(stated)
                length = int(stated)
                place += lengths.itemsize
            place += length * size
        if place > len(data):
            raise CutShort(element, done)
    return starts, place


def _layout(
    element: Element, data: Bytes, starts: IntArray, limits: IntArray
) -> tuple[list[tuple[Property, IntArray, IntArray | None]], IntArray]:
    """Return where the values of each property are in each row, the lengths of lists, and row ends.

    `_ShortRow` is raised if a row ends beyond its limit, and `InputError` if a list has no length.
    """
    place, layout = starts, []
    for prop in element.properties:
        lengths = None
        if prop.count_type is not None:
            if (place + prop.count_type.itemsize > limits).any():
                raise _ShortRow
            stated = _at_each_byte(data, prop.count_type)[place]
            sound = (stated >= 0) & (stated < 2.0**40) & (stated == np.floor(stated))
            if not sound.all():
                raise _no_length(stated[~sound][0])
            lengths = stated.astype(np.int64)
            place = place + prop.count_type.itemsize
        layout.append((prop, place, lengths))
        place = place + prop.value_type.itemsize * (1 if lengths is None else lengths)
        if (place > limits).any():
            raise _ShortRow
    return layout, place


def _columns(layout: list[tuple[Property, IntArray, IntArray | None]], data: Bytes) -> Columns:
    columns: Columns = {}
    for prop, place, lengths in layout:
        values = _at_each_byte(data, prop.value_type)
        if lengths is None:
            columns[prop.name] = values[place]
            continue
        first = np.cumsum(lengths) - lengths
        within = np.arange(int(lengths.sum())) - np.repeat(first, lengths)
        columns[prop.name] = values[np.repeat(place, lengths) + values.itemsize * within], lengths
    return columns


def _at_each_byte(data: Bytes, kind: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return the number that begins at each byte, without a copy."""
    return np.ndarray(max(len(data) - kind.itemsize + 1, 0), kind, data, strides=(1,))


def _no_length(stated: float) -> InputError:
    return InputError(f"has a list of {stated:g} entries")

"""Parsers for text in mesh files: encodings, lines selected by their first word, and numbers.

Rows of numbers and lists, which follow the header in PLY and OFF files, may also be binary.
"""

from __future__ import annotations

import codecs
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, printable, wrong_format

#: Byte order marks and their encodings; UTF-32 is first, as its marks begin like those of UTF-16.
_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def read_text(path: Path) -> bytes:
    r"""Read a text file as UTF-8 without byte order marks, with lines ended by ``\n``.

    `InputError` is raised if the file begins with a mark of UTF-16 or UTF-32 and cannot be decoded.
    """
    data = with_newlines(unmarked(path.read_bytes()))
    # concatenated files have a mark before each part
    return data.replace(b"\n" + codecs.BOM_UTF8, b"\n") if codecs.BOM_UTF8 in data else data


def unmarked(data: bytes) -> bytes:
    """Return text as UTF-8 without byte order mark.

    `InputError` is raised if the text begins with a mark of UTF-16 or UTF-32 and cannot be decoded.
    """
    while data.startswith(codecs.BOM_UTF8):
        data = data[len(codecs.BOM_UTF8) :]
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            try:
                return data[len(mark) :].decode(encoding).encode()
            except UnicodeError:
                name = encoding[:-3].upper()
                raise wrong_format(f"begins as text in {name} and has something else") from None
    return data


def with_newlines(data: bytes) -> bytes:
    r"""Return text with all line ends replaced by ``\n``."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data


class NotANumber(InputError):
    """A word is no number; `line` is its line in the text, counted from 0."""

    def __init__(self, token: str, text: bytes, place: int, kind: str = "number") -> None:
        self.line = text.count(b"\n", 0, place)
        comma = re.fullmatch(r"[-+]?\d*,\d+(e[-+]?\d+)?", token)
        said = f"{token!r} with a decimal comma" if comma else repr(token)
        fault = f"holds {said} where a {kind} should be"
        super().__init__("not-a-number", fault, "write decimals with a point" if comma else "")

    def in_line(self, number: int) -> InputError:
        """Return an error with the number of the line in the file, counted from 1."""
        return InputError("not-a-number", f"{self.fault}, in line {number}", self.remedy)


def parse_rows(text: bytes, dtype: type[np.generic]) -> tuple[npt.NDArray[Any], IntArray]:
    """Read lines of numbers separated by white space, all lines at once for speed.

    Returned are the numbers of all lines in one array of type `dtype`, `numpy.float64` or
    `numpy.int64`, and the count in each line. `NotANumber` is raised if a word is no number.
    """
    characters = np.frombuffer(text, dtype=np.uint8)
    is_space = characters <= 32
    begins = ~is_space
    begins[1:] &= is_space[:-1]
    token_starts = np.flatnonzero(begins)
    line_ends = np.append(np.flatnonzero(characters == ord("\n")), len(characters))
    counts = np.diff(np.searchsorted(token_starts, line_ends), prepend=0).astype(np.int64)
    numbers: npt.NDArray[Any]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # old NumPy warns and stops early
            numbers = np.fromstring(text, dtype=dtype, sep=" ")
    except ValueError:
        numbers = np.empty(0, dtype=dtype)
    if len(numbers) != len(token_starts):
        raise _first_fault(text, dtype)
    return numbers, counts


def _first_fault(text: bytes, dtype: type[np.generic]) -> NotANumber:
    convert, kind = (float, "number") if dtype is np.float64 else (int, "whole number")
    for token in re.finditer(rb"[^\x00-\x20]+", text):
        try:
            convert(token[0].replace(b"_", b"?"))  # Python accepts 1_000
        except ValueError:
            word = printable(token[0].decode("latin-1"), 20)
            return NotANumber(word, text, token.start(), kind)
    odd = re.search(rb"[\x00-\x08\x0e-\x1f]", text)  # neither a number nor white space
    return NotANumber("\ufffd", text, odd.start() if odd else 0)


class Lines:
    r"""Lines of a text, selected by their first word with array operations, for millions of lines.

    Lines end with ``\n``; ``\v`` is white space, but counts as a line end in line numbers.
    """

    def __init__(self, text: bytes) -> None:
        # padded, so that words can be compared beyond the end of the text
        self._characters = np.frombuffer(text + 16 * b"\n", dtype=np.uint8)
        self._ends = np.flatnonzero(self._characters[: len(text) + 1] == ord("\n"))
        self._starts = self._without_spaces(np.append(0, self._ends[:-1] + 1))

    def drop_until(self, line: int) -> None:
        """Remove all lines before `line`."""
        self._starts, self._ends = self._starts[line:], self._ends[line:]

    def number(self, line: int) -> int:
        """Return the number of a line in the file, counted from 1."""
        before = self._characters[: self._starts[line]]
        return 1 + int(np.count_nonzero((before == ord("\n")) | (before == ord("\v"))))

    def fault(self, what: str, line: int) -> str:
        """Return a clause that names a line."""
        return f"{what}, in line {self.number(line)}"

    def last(self) -> int:
        """Return the index of the last line that is not empty; -1 if there is none."""
        return int(np.flatnonzero(self._starts < self._ends)[-1:].max(initial=-1))

    def beginning_with(self, *parts: bytes) -> IntArray:
        """Return the lines that begin with a word in any case; spaces may separate its parts."""
        chosen = np.arange(len(self._starts))
        places = self._starts
        for part in parts:
            for letter in part:
                found = self._characters[places] | 32 == letter
                chosen, places = chosen[found], places[found] + 1
            places = self._without_spaces(places) if part is not parts[-1] else places
        return chosen[self._characters[places] <= 32]

    def rows(
        self, lines: IntArray, word: bytes, dtype: type[np.generic]
    ) -> tuple[npt.NDArray[Any], IntArray]:
        """Read the numbers in lines that begin with `word`, see `parse_rows`.

        `InputError` is raised if a later word is no number; the message names the line.
        """
        edges = np.zeros(len(self._characters) + 1, dtype=np.int8)
        edges[self._starts[lines] + len(word)] = 1
        edges[self._ends[lines] + 1] -= 1
        text = self._characters[np.cumsum(edges[:-1], dtype=np.int8) > 0].tobytes()
        try:
            numbers, counts = parse_rows(text, dtype)
        except NotANumber as fault:
            raise fault.in_line(self.number(lines[fault.line])) from None
        return numbers, counts[: len(lines)]

    def _without_spaces(self, places: IntArray) -> IntArray:
        places = places.copy()
        while True:
            is_space = (self._characters[places] == ord(" ")) | (self._characters[places] == 9)
            if not is_space.any():
                return places
            places[is_space] += 1


# -- rows after a header --------------------------------------------------------------------------

#: Values of a list property: the concatenated lists of all rows, and the length of each list.
Lists: TypeAlias = tuple[npt.NDArray[Any], IntArray]
#: Values of each property by its name.
Columns: TypeAlias = dict[str, npt.NDArray[Any] | Lists]
Bytes: TypeAlias = npt.NDArray[np.uint8]

_NUMBER: np.dtype[Any] = np.dtype("f8")


@dataclass(frozen=True)
class Property:
    """A number in each row; with `count_type`, a list of numbers after its length."""

    name: str
    value_type: np.dtype[Any] = _NUMBER
    count_type: np.dtype[Any] | None = None


@dataclass
class Element:
    """Consecutive rows with the same properties, such as the vertices of a PLY file."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class CutShort(InputError):
    """A file has fewer rows of an element than its header states."""

    def __init__(self, element: Element, available: int) -> None:
        super().__init__(
            "file-cut-short",
            f"promises {printable(element.count, 24)} of its element"
            f" {printable(element.name, 40)!r} but ends after {available}, so it was cut short",
            "copy or export it again",
        )


class _ShortRow(ValueError):
    """A row needs more data than its line has."""


def rows_of_text(
    elements: list[Element], numbers: FloatArray, counts: IntArray, *, ragged: bool = False
) -> list[Columns]:
    """Return the columns of the elements in a text.

    If there are as many lines with numbers as rows, each line is a row. It may have extra numbers,
    equally many in all rows of an element; if `ragged`, rows with lists may differ in this number.
    Otherwise line ends are ignored. Types of all properties must be float64; `numbers` and `counts`
    are the results of `parse_rows`.

    `CutShort` is raised if there are too few numbers; `InputError` if there are too many, or the
    length of a list is invalid.
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
            "counts-differ",
            f"holds {more:,} {'numbers' if more > 1 else 'number'} more than its header describes",
        )
    return columns


def take_rows(elements: list[Element], data: Bytes) -> tuple[list[Columns], int]:
    """Return the columns of the elements in binary data, and the end of the last row in bytes.

    `CutShort` is raised if there are too few bytes, `InputError` if a list has an invalid length.
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
                "counts-differ",
                f"has rows of its element {printable(element.name, 40)!r} with differently many"
                " numbers more than its header describes",
            )
    return columns


def _row_starts(element: Element, data: Bytes, place: int) -> IntArray:
    """Return the position of each row; all rows are first tried with the width of the first."""
    if not element.count:
        return np.zeros(0, dtype=np.int64)
    width = _counted_starts(element, data, place, 1)[1] - place
    if place + width * element.count <= len(data):
        starts = place + width * np.arange(element.count)
        try:
            _, ends = _layout(element, data, starts, np.full(len(starts), len(data)))
        except ValueError:
            ends = starts
        if np.array_equal(ends, starts + width):
            return starts
    return np.array(_counted_starts(element, data, place, element.count)[0], dtype=np.int64)


def _counted_starts(element: Element, data: Bytes, place: int, count: int) -> tuple[list[int], int]:
    """Return the positions of `count` rows from `place` on, and the end of the last row."""
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
    """Return the position of each property in each row with the lengths of lists, and row ends.

    `_ShortRow` is raised if a row ends after its limit, and `InputError` if the length of a list is
    invalid.
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
    """Return a view of the data whose element i is the number that begins at byte i."""
    return np.ndarray(max(len(data) - kind.itemsize + 1, 0), kind, data, strides=(1,))


def _no_length(stated: float) -> InputError:
    return InputError("out-of-range", f"has a list of {stated:g} entries")

"""Text files: byte order marks, line ends, lines by their first word, and numbers in them."""

from __future__ import annotations

import codecs
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.errors import InputError, printable

#: What text may begin with, longer ones first: those of UTF-32 begin with those of UTF-16.
_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def read_text(path: Path) -> bytes:
    r"""Read a text file as UTF-8 without byte order marks, its lines ended by ``\n``.

    `InputError` is raised if it begins as UTF-16 or UTF-32 and is not.
    """
    data = with_newlines(unmarked(path.read_bytes()))
    # of files that were copied one after the other
    return data.replace(b"\n" + codecs.BOM_UTF8, b"\n") if codecs.BOM_UTF8 in data else data


def unmarked(data: bytes) -> bytes:
    """The same without a byte order mark at its beginning, as UTF-8.

    `InputError` is raised if it begins as UTF-16 or UTF-32 and is not.
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


class NotANumber(InputError):
    """What stands where a number should, and the line of the text, counted from 0."""

    def __init__(self, token: str, text: bytes, place: int) -> None:
        self.token = token
        self.line = text.count(b"\n", 0, place)
        super().__init__(f"holds {token!r} where a number should be")

    def in_line(self, number: int) -> InputError:
        """The same with the number of the line in the file, counted from 1."""
        return InputError(f"{self}, in line {number}")


def parse_rows(text: bytes, dtype: type[np.generic]) -> tuple[npt.NDArray[Any], IntArray]:
    """Read lines of numbers separated by white space, far faster than line by line.

    Returns the numbers of all lines, one after the other, in the given type, `numpy.float64` or
    `numpy.int64`; and how many numbers each line holds.

    `NotANumber` is raised if something is no number.
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
            warnings.simplefilter("ignore", DeprecationWarning)  # older NumPy stops early instead
            numbers = np.fromstring(text, dtype=dtype, sep=" ")
    except ValueError:
        numbers = np.empty(0, dtype=dtype)
    if len(numbers) != len(token_starts):
        raise _first_fault(text, dtype)
    return numbers, counts


def _first_fault(text: bytes, dtype: type[np.generic]) -> NotANumber:
    convert = float if np.issubdtype(dtype, np.floating) else int
    for token in re.finditer(rb"[^\x00-\x20]+", text):
        try:
            convert(token[0].replace(b"_", b"?"))  # Python would take 1_000
        except ValueError:
            return NotANumber(printable(token[0].decode("latin-1"), 20), text, token.start())
    odd = re.search(rb"[\x00-\x08\x0e-\x1f]", text)  # as little a number as it is white space
    return NotANumber("\ufffd", text, odd.start() if odd else 0)


class Lines:
    r"""Lines of text by the words that they begin with, as arrays: there may be millions.

    Lines end with ``\n``; ``\v`` is white space that counts as the end of a line in messages.
    """

    def __init__(self, text: bytes) -> None:
        # a word at the end of the text can be looked at beyond it
        self._characters = np.frombuffer(text + 16 * b"\n", dtype=np.uint8)
        self._ends = np.flatnonzero(self._characters[: len(text) + 1] == ord("\n"))
        self._starts = self._without_spaces(np.append(0, self._ends[:-1] + 1))

    def drop_until(self, line: int) -> None:
        """Leave out the lines before one."""
        self._starts, self._ends = self._starts[line:], self._ends[line:]

    def number(self, line: int) -> int:
        """Number of a line in the file, counted from 1."""
        before = self._characters[: self._starts[line]]
        return 1 + int(np.count_nonzero((before == ord("\n")) | (before == ord("\v"))))

    def fault(self, what: str, line: int) -> InputError:
        """Return an error that names a line."""
        return InputError(f"{what}, in line {self.number(line)}")

    def last(self) -> int:
        """The last line that is not empty; -1 if there is none."""
        return int(np.flatnonzero(self._starts < self._ends)[-1:].max(initial=-1))

    def beginning_with(self, *parts: bytes) -> IntArray:
        """Lines that begin with a word, in lower case or capitals, its parts apart or not."""
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
        """Read the numbers after the word that some lines begin with, see `parse_rows`.

        `InputError` is raised if something is no number; the message names the line.
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

"""FreeSurfer parcellations (``.annot``): an annotation a vertex, and a table of names and colours.

The annotation of a vertex is the packed colour of its label. nibabel drops the index of each
vertex, gives annotations without a label that of another one, and cannot place the names of a
table with gaps, such as FreeSurfer's own of 1,266 labels with numbers up to 14,175.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import RawMap, RawMesh, maps_alone
from meshmash_viewer.vertex_map import Label

#: Before a table whose entries have numbers of their own; a number of entries before one without.
_NUMBERED = -2


@dataclass
class _Cursor:
    """Big-endian numbers and names, one after the other."""

    content: bytes
    place: int = 0

    def numbers(self, count: int) -> list[int]:
        """The next `count` whole numbers of 32 bits."""
        taken: list[int] = np.frombuffer(self._take(4 * count), ">i4").tolist()
        return taken

    def number(self) -> int:
        return self.numbers(1)[0]

    def name(self) -> str:
        """The next text, after its length."""
        return self._take(self.number()).split(b"\0")[0].decode("utf-8", "replace")

    def _take(self, size: int) -> bytes:
        taken = self.content[self.place : self.place + size] if size >= 0 else b""
        if size < 0 or len(taken) < size:
            raise InputError("is not readable, as it ends within its labels")
        self.place += size
        return taken


def freesurfer_annotation(path: Path) -> RawMesh:
    """Read a parcellation with its names and colours (``.annot``).

    Raises
    ------
    InputError
        If the file has no table of names and colours, is cut short, or has a vertex twice.
    """
    cursor = _Cursor(path.read_bytes())
    pairs = np.array(cursor.numbers(2 * cursor.number()), dtype=np.int64).reshape(-1, 2)
    order = np.argsort(pairs[:, 0], kind="stable")
    if not len(pairs) or not np.array_equal(pairs[order, 0], np.arange(len(pairs))):
        raise InputError("has an annotation not once for each vertex from 0")
    if cursor.place == len(cursor.content) or not cursor.number():
        raise InputError("has annotations without a table of names and colours")
    labels = _labels(cursor)
    annotations = {int(label.color[5:7] + label.color[3:5] + label.color[1:3], 16): label.key
                   for label in reversed(labels)}  # fmt: skip
    known, places = np.unique(pairs[order, 1], return_inverse=True)
    keys = np.array([annotations.get(each, -1) for each in known.tolist()], dtype=np.int64)
    return maps_alone([RawMap("", keys[places], labels)])


def _labels(cursor: _Cursor) -> tuple[Label, ...]:
    """Labels in their order in the file, by their numbers where they have some."""
    kind = cursor.number()
    if kind < 0 and kind != _NUMBERED:
        raise InputError(f"has a table of names and colours of the unknown version {-kind}")
    if kind == _NUMBERED:
        cursor.number()  # the largest number
    cursor.name()  # of the table's own file
    count = cursor.number() if kind == _NUMBERED else kind
    labels = []
    for place in range(count):
        key = cursor.number() if kind == _NUMBERED else place
        name, rgb = cursor.name(), cursor.numbers(4)[:3]
        labels.append(Label(key, name, "#" + "".join(f"{share & 255:02x}" for share in rgb)))
    return tuple(labels)

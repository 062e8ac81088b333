"""Pinned vertices, and their mapping to a repaired mesh."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh

#: Colours of the pins in the order of their numbers: Okabe & Ito 2008, distinct for every kind of
#: colour vision, then those farthest from them in CIELAB, with and without colour blindness.
PIN_COLORS = (
    "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#D55E00", "#0072B2", "#F0E442",
    "#6611FF", "#BB0033", "#CCCC88", "#6677FF", "#006666",
)  # fmt: skip


@dataclass(frozen=True)
class Pin:
    """A vertex whose profile is compared; its number, from 1, determines its colour."""

    vertex: int
    number: int

    @property
    def color(self) -> str:
        """Colour of the pin; the colours repeat after the last one."""
        return PIN_COLORS[(self.number - 1) % len(PIN_COLORS)]


def free_number(pins: Sequence[Pin], wanted: int = 0) -> int:
    """Return the wanted number of a pin if it is free, else the lowest free one."""
    taken = {pin.number for pin in pins}
    if wanted >= 1 and wanted not in taken:
        return wanted
    return next(number for number in count(1) if number not in taken)


def same_vertex(before: Mesh, now: Mesh, vertex: int) -> int | None:
    """Return the vertex of `now` that has the same index in the file; None if it was removed."""
    with contextlib.suppress(InputError):
        return now.vertex_of(before.file_index(vertex))
    return None


def followed_pins(pins: Sequence[Pin], before: Mesh, now: Mesh) -> tuple[Pin, ...]:
    """Map the pins of one mesh to another repair of the same file, each vertex once."""
    moved: dict[int, Pin] = {}
    for pin in pins:
        vertex = same_vertex(before, now, pin.vertex)
        if vertex is not None:
            moved.setdefault(vertex, replace(pin, vertex=vertex))
    return tuple(moved.values())

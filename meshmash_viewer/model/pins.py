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


def followed_pins(
    pins: Sequence[Pin], before: Mesh, now: Mesh, earlier: Sequence[Pin] = ()
) -> tuple[Pin, ...]:
    """Map the pins of one mesh to another repair of the same file.

    Parameters
    ----------
    pins : sequence of Pin
        On the vertices of `before`.
    before, now : Mesh
    earlier : sequence of Pin
        Pins on the vertices of `now` before a repair that is undone. Those whose vertices the
        repair removed or joined are restored; those that were removed since are not.

    Returns
    -------
    tuple of Pin
        On the vertices of `now`, each vertex once and the newest last.
    """
    there, known = {pin.vertex for pin in pins}, set[int]()
    moved: list[Pin] = []
    for pin in earlier:
        at = same_vertex(now, before, pin.vertex)
        if at is None or at in there:
            moved.append(pin)
        if at is not None:
            known.add(at)
    for pin in pins:
        vertex = None if pin.vertex in known else same_vertex(before, now, pin.vertex)
        if vertex is not None and all(other.vertex != vertex for other in moved):
            moved.append(replace(pin, vertex=vertex))
    result: list[Pin] = []
    for pin in moved:
        result.append(replace(pin, number=free_number(result, pin.number)))
    return tuple(result)

"""Pinned vertices, and which vertices they are after a repair."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh

__all__ = ["PIN_COLORS", "Pin", "followed_pins", "free_number", "same_vertex"]

#: Colours of the pins in the order of their numbers: Okabe & Ito 2008, told apart by every kind of
#: colour vision, then those farthest from them in CIELAB, seen with and without all cones.
PIN_COLORS = (
    "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#D55E00", "#0072B2", "#F0E442",
    "#6611FF", "#BB0033", "#CCCC88", "#6677FF", "#006666",
)  # fmt: skip


@dataclass(frozen=True)
class Pin:
    """A vertex whose profile is compared; its number, from 1, decides its colour."""

    vertex: int
    number: int

    @property
    def color(self) -> str:
        """Its colour; after the last one they come round again."""
        return PIN_COLORS[(self.number - 1) % len(PIN_COLORS)]


def free_number(pins: Sequence[Pin], wanted: int = 0) -> int:
    """The number wanted for a pin, or else the lowest one, that no other has."""
    taken = {pin.number for pin in pins}
    if wanted >= 1 and wanted not in taken:
        return wanted
    return next(number for number in count(1) if number not in taken)


def same_vertex(before: Mesh, now: Mesh, vertex: int) -> int | None:
    """The vertex of the same index in the file on another repair of it; None if it was left out."""
    with contextlib.suppress(InputError):
        return now.vertex_of(before.file_index(vertex))
    return None


def followed_pins(
    pins: Sequence[Pin], before: Mesh, now: Mesh, earlier: Sequence[Pin] = ()
) -> tuple[Pin, ...]:
    """Pins of one mesh on another repair of the same file.

    Parameters
    ----------
    pins : sequence of Pin
        By the vertices of `before`.
    before, now : Mesh
    earlier : sequence of Pin
        Those that there were on `now` before a repair that is taken back, by its vertices. The
        ones that the repair left out or joined come back; those taken away since do not.

    Returns
    -------
    tuple of Pin
        By the vertices of `now`, each vertex once and the newest last.
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

"""Pinned vertices with their names and colours, and their mapping to a repaired mesh."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

from psygnal import Signal

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.history import History
from meshmash_viewer.model.open_mesh import OpenMesh

#: Colours of the pins by number: the palette of Okabe & Ito 2008, distinct for every kind of colour
#: vision, then the most distant colours in CIELAB, with and without colour blindness.
PIN_COLORS = (
    "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#D55E00", "#0072B2", "#F0E442",
    "#6611FF", "#BB0033", "#CCCC88", "#6677FF", "#006666",
)  # fmt: skip


LONGEST_NAME = 60
_COLOR = re.compile("#[0-9A-Fa-f]{6}")


@dataclass(frozen=True)
class Pin:
    """A vertex that the user marked, with its name and colour."""

    vertex: int
    #: Number of the pin, from 1.
    number: int
    #: Name given by the user; "" for none.
    name: str = ""
    #: Colour chosen by the user, "#RRGGBB"; "" for the colour of the number.
    own_color: str = ""

    @property
    def color(self) -> str:
        """Colour of the pin; the colours of the numbers repeat."""
        return self.own_color or PIN_COLORS[(self.number - 1) % len(PIN_COLORS)]

    @property
    def label(self) -> str:
        """The name, or the number of a pin without a name."""
        return self.name or str(self.number)

    @property
    def title(self) -> str:
        """The name for sentences: "soma", or "pin 3" without a name."""
        return self.name or f"pin {self.number}"


class Pins:
    """The pins of the open mesh; the history records changes by the user."""

    changed = Signal()

    def __init__(self, opened: OpenMesh, history: History) -> None:
        self._opened, self._history = opened, history
        #: The pins in the order in which they were placed.
        self.placed: tuple[Pin, ...] = ()
        #: The pins of the mesh that this one is compared with; equal numbers correspond.
        self.partner: Pins | None = None
        #: Whether a pin is being moved.
        self.dragging = False
        history.keep("pins", lambda: self.placed, self.put)

    def put(self, pins: tuple[Pin, ...]) -> None:
        """Replace the pins without a step of the history."""
        self.placed = pins
        self.changed.emit()

    def set(self, label: str, pins: Iterable[Pin]) -> None:
        """Replace the pins as one change; `label` completes "Undo …"."""
        self._history.record(label, "pins")
        self.put(tuple(pins))

    def change(self, label: str, vertex: int, /, **attributes: Any) -> None:
        """Change name or colour of the pin of a vertex, if there is a pin, as one change.

        The pin of this number on the other mesh of a comparison changes with it.
        """
        pin = pin_at(self.placed, vertex)
        if pin is None:
            return
        with self._history.together(label):
            for pins in filter(None, (self, self.partner)):
                same = [replace(each, **attributes) if each.number == pin.number else each
                        for each in pins.placed]  # fmt: skip
                if same != list(pins.placed):
                    pins.set(label, same)

    def drag(self, vertex: int, to: int) -> None:
        """Move a pin to another vertex; all moves until `drop` are one change."""
        if pin_at(self.placed, vertex) is not None:
            if not self.dragging:
                self.dragging = True
                self._history.record("move of a pin", "pins")
            self.put(tuple(replace(p, vertex=to) if p.vertex == vertex else p for p in self.placed))

    def drop(self) -> None:
        """End the change that `drag` began."""
        if self.dragging:
            self.dragging = False
            self.changed.emit()
            self._history.changed.emit()

    def toggle(self, vertex: int, number: int = 0) -> None:
        """Pin a vertex under a number, by default the lowest free one, or remove its pin.

        With a `partner`, the pin gets number, name and colour of its first pin that this mesh
        lacks. `IndexError` is raised if the mesh has no vertex of that index.
        """
        mesh = self._opened.mesh
        if mesh is None or not 0 <= vertex < mesh.n_vertices:
            raise IndexError(f"vertex {vertex} is not in the mesh")
        left = tuple(pin for pin in self.placed if pin.vertex != vertex)
        if len(left) < len(self.placed):
            self.set("removal of a pin", left)
        else:
            taken = {pin.number for pin in left}
            others = () if self.partner is None or number else self.partner.placed
            new = Pin(int(vertex), free_number(left, number))
            found = next((pin for pin in others if pin.number not in taken), new)
            self.set("pin", (*left, replace(found, vertex=int(vertex))))

    def clear(self) -> None:
        """Remove all pins."""
        if self.placed:
            self.set("removal of all pins", ())


def pin_at(pins: Iterable[Pin], vertex: int | None) -> Pin | None:
    """Return the pin of a vertex, or None."""
    return next((pin for pin in pins if pin.vertex == vertex), None)


def checked_color(text: str) -> str:
    """Return a colour "#rrggbb" in capitals, or "" for none.

    `InputError` is raised for another text.
    """
    if text and not _COLOR.fullmatch(text):
        fault = f"{printable(text, 30)!r} is not a colour"
        raise InputError("wrong-color", fault, "write it as #E69F00")
    return text.upper()


def distinct_name(name: str, taken: Collection[str]) -> str:
    """Return a name cut to `LONGEST_NAME` characters, with a number if it is taken."""
    name = " ".join(name.split())[:LONGEST_NAME]
    if not name or name not in taken:
        return name
    return next(each for at in count(2) if (each := f"{name} {at}") not in taken)


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
    """Map pins to the mesh of the same file after other repairs, with one pin per vertex."""
    moved: dict[int, Pin] = {}
    for pin in pins:
        vertex = same_vertex(before, now, pin.vertex)
        if vertex is not None:
            moved.setdefault(vertex, replace(pin, vertex=vertex))
    return tuple(moved.values())

"""Undo and redo of changes by the user."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

from psygnal import Signal

if TYPE_CHECKING:
    from collections.abc import Iterator

_MAX_STEPS = 500
#: Seconds within which changes with the same label are one step, as while the wheel is turned.
_ONE_GESTURE = 0.7


@dataclass(frozen=True, eq=False)
class Step:
    """One change: its label, and the values that undo or redo restores."""

    #: Completes "Undo …".
    label: str
    #: By name of a part: its value before the change, or after it once the change is undone.
    state: Mapping[str, Any]
    #: Time of the change, from `time.monotonic`; infinite during a gesture that `hold` began.
    when: float = 0.0


@dataclass(frozen=True)
class _Part:
    """Functions that read and restore a part of the state, see `History.keep`."""

    read: Callable[[], Any]
    restore: Callable[[Any], None]
    is_ready: Callable[[Any], bool]
    alongside: str


@dataclass(eq=False)
class _Window:
    """Parts of the state of a window, by "mesh/part", and the steps that changed them."""

    changed: ClassVar[Signal] = Signal()

    parts: dict[str, _Part] = field(default_factory=dict)
    past: tuple[Step, ...] = ()
    future: tuple[Step, ...] = ()
    #: The steps that could be redone before the last change, for `revoke`.
    future_before: tuple[Step, ...] = ()
    paused: bool = False
    held: bool = False
    #: Label of the step that `together` makes, and whether the step has begun.
    joined: str = ""
    begun: bool = False


class History:
    """Changes in a window that can be undone and redone, seen from one of its meshes.

    The state consists of named parts, which `keep` declares. The steps of all meshes of the window
    are in one order: `undo` reverts the last one, of whichever mesh.
    """

    #: Emitted after all changes of this mesh were removed because another mesh was opened.
    started = Signal()

    def __init__(self, mesh: str = "first", *, of: History | None = None) -> None:
        self._mesh = mesh
        self._window: _Window = _Window() if of is None else of._window
        self.changed = self._window.changed

    def of(self, mesh: str) -> History:
        """Return the history of the same window for another mesh, such as "second"."""
        return History(mesh, of=self)

    def keep(
        self,
        part: str,
        read: Callable[[], Any],
        restore: Callable[[Any], None],
        is_ready: Callable[[Any], bool] = lambda _: True,
        *,
        alongside: str = "",
    ) -> None:
        """Declare a part of the state, whose values are immutable.

        `read` returns its value and `restore` sets it. `is_ready` returns False for a value that
        must be computed first, starts the computation, and arranges another call of `undo`. With
        `alongside`, the part is recorded with the part of that name, and restored after it.
        """
        also = alongside and self._named(alongside)
        self._window.parts[self._named(part)] = _Part(read, restore, is_ready, also)

    def _named(self, part: str) -> str:
        return f"{self._mesh}/{part}"

    def _state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        return {self._named(part): value for part, value in state.items()}

    def label(self, change: str) -> str:
        """Return the label of a change of this mesh."""
        return change if self._mesh == "first" else f"{change} of the {self._mesh} mesh"

    def close(self) -> None:
        """Remove all parts of this mesh, and the steps that changed no others."""
        window, mine = self._window, self._named("")
        window.parts = {at: window.parts[at] for at in window.parts if not at.startswith(mine)}
        self._forget()
        self.changed.emit()

    def _forget(self) -> None:
        mine = self._named("")
        self._change_states(
            lambda state: {at: state[at] for at in state if not at.startswith(mine)}
        )

    def read(self, parts: Iterable[str] | None = None) -> dict[str, Any]:
        """Return the values of some parts of this mesh, by default of all."""
        mine, known = self._named(""), self._window.parts
        if parts is None:
            parts = [at.removeprefix(mine) for at in known if at.startswith(mine)]
        return {part: known[self._named(part)].read() for part in parts}

    @property
    def past(self) -> tuple[Step, ...]:
        """The steps that can be undone, the last one first to be undone."""
        return self._window.past

    @property
    def future(self) -> tuple[Step, ...]:
        """The steps that can be redone, the last one first to be redone."""
        return self._window.future

    @property
    def undo_label(self) -> str:
        """The change that `undo` reverts; "" for none."""
        return self.past[-1].label if self.past else ""

    @property
    def redo_label(self) -> str:
        """The change that `redo` makes again; "" for none."""
        return self.future[-1].label if self.future else ""

    def record(self, label: str, *parts: str, before: Mapping[str, Any] | None = None) -> None:
        """Record a change of some parts; call before the change, or pass the values `before` it."""
        window = self._window
        if window.paused:
            return
        names = [self._named(part) for part in parts]
        names += [at for at, each in window.parts.items() if each.alongside in names]
        state = self._state(before or {}) | {at: window.parts[at].read() for at in names}
        last, now = window.past[-1] if window.past else None, time.monotonic()
        if window.joined and window.begun and last is not None:
            window.past = (*window.past[:-1], replace(last, state=state | dict(last.state)))
            self.changed.emit()
            return
        label, window.begun = window.joined or self.label(label), True
        when = math.inf if window.held and before is not None else now
        if (
            last is not None
            and before is not None
            and (last.label, last.state.keys()) == (label, state.keys())
            and now - last.when < _ONE_GESTURE
        ):
            window.past = (*window.past[:-1], replace(last, when=when))
            if not window.future:  # at every tick of a slider
                return
        else:
            window.past = (*window.past, Step(label, state, when))[-_MAX_STEPS:]
        window.future_before, window.future = window.future, ()
        self.changed.emit()

    @contextmanager
    def together(self, label: str) -> Iterator[None]:
        """Record all changes within the context, of any mesh, as one step."""
        window = self._window
        if window.joined:
            yield
            return
        window.joined, window.begun = self.label(label), False
        try:
            yield
        finally:
            window.joined = ""

    def hold(self) -> None:
        """Make equal changes one step, however slowly they follow, until `end_gesture`."""
        self._window.held = True

    def end_gesture(self) -> None:
        """Make the next change a separate step, however soon it follows."""
        window, past = self._window, self.past
        window.held = False
        if past:
            window.past = (*past[:-1], replace(past[-1], when=-math.inf))

    def start(self, *steps: tuple[str, Mapping[str, Any]]) -> None:
        """Remove all changes of this mesh, and add labels and states of changes to undo."""
        self._forget()
        made = (Step(self.label(label), self._state(state)) for label, state in steps)
        self._window.past = (*self.past, *made)
        self.started.emit()
        self.changed.emit()

    def complete(self, step: Step, state: Mapping[str, Any]) -> bool:
        """Set the state that undoing a step restores; return whether the step is the last one."""
        last = self.past[-1:] == (step,)
        done = replace(step, state=self._state(state))
        self._window.past = tuple(done if each is step else each for each in self.past)
        return last

    def amend(self, part: str, changed: Callable[[Any], Any]) -> None:
        """Replace the value of a part by ``changed(value)`` in all steps."""
        name = self._named(part)
        self._change_states(
            lambda state: {at: changed(state[at]) if at == name else state[at] for at in state}
        )

    def _change_states(self, changed: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
        """Change the values that steps restore; steps that are left without values are removed."""
        window = self._window
        for name in ("past", "future", "future_before"):
            steps = (replace(step, state=changed(step.state)) for step in getattr(window, name))
            setattr(window, name, tuple(step for step in steps if step.state))

    @property
    def is_paused(self) -> bool:
        """Whether nothing is recorded."""
        return self._window.paused

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Record nothing within the context."""
        window = self._window
        before, window.paused = window.paused, True
        try:
            yield
        finally:
            window.paused = before

    def undo(self) -> None:
        """Revert the last change, or request the values missing for it (`is_ready` of `keep`)."""
        window = self._window
        if window.past:
            step = window.past[-1]
            if not all(window.parts[at].is_ready(value) for at, value in step.state.items()):
                return
            window.past, window.future = window.past[:-1], (*window.future, self._cross(step))
            self.changed.emit()

    def redo(self) -> None:
        """Repeat the change that was undone last."""
        window = self._window
        if window.future:
            step = window.future[-1]
            window.past, window.future = (*window.past, self._cross(step)), window.future[:-1]
            self.changed.emit()

    def revoke(self) -> None:
        """Revert the last change and remove it, so that it cannot be redone."""
        self.undo()
        self._window.future = self._window.future_before
        self.changed.emit()

    def _cross(self, step: Step) -> Step:
        """Restore the values of a step, and return the opposite step."""
        parts = self._window.parts
        here = {at: parts[at].read() for at in step.state}
        with self.paused():
            # in the order of declaration: the mesh before what is on it
            for at in sorted(step.state, key=list(parts).index):
                parts[at].restore(step.state[at])
        return Step(step.label, here)

"""Undo and redo of changes by the user."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from psygnal import Signal

if TYPE_CHECKING:
    from collections.abc import Iterator

_MAX_STEPS = 500
#: Seconds within which changes with the same label are one step, as while a slider is dragged.
_ONE_GESTURE = 0.7


@dataclass(frozen=True, eq=False)
class Step:
    """One change: its label, and the values that undo or redo restores."""

    #: Completes "Undo …".
    label: str
    #: By name of a part: its value before the change, or after it once the change is undone.
    state: Mapping[str, Any]
    #: Time of the change, from `time.monotonic`.
    when: float = 0.0


@dataclass(frozen=True)
class _Part:
    """Functions that read and restore a part of the state, see `History.keep`."""

    read: Callable[[], Any]
    restore: Callable[[Any], None]
    is_ready: Callable[[Any], bool]
    alongside: str


class History:
    """Changes that can be undone and redone.

    The state consists of named parts, which `keep` declares.
    """

    changed = Signal()
    #: Emitted after all changes were removed because another mesh was opened.
    started = Signal()

    def __init__(self) -> None:
        self._parts: dict[str, _Part] = {}
        self.past: tuple[Step, ...] = ()
        self.future: tuple[Step, ...] = ()
        #: The steps that could be redone before the last change, for `revoke`.
        self._future_before: tuple[Step, ...] = ()
        self._paused = False

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
        self._parts[part] = _Part(read, restore, is_ready, alongside)

    def forget(self, *parts: str) -> None:
        """Remove parts of the state, and steps that changed no other parts."""
        self._parts = {name: part for name, part in self._parts.items() if name not in parts}
        self._change_states(lambda state: {at: state[at] for at in state if at not in parts})
        self.changed.emit()

    def read(self, parts: Iterable[str] | None = None) -> dict[str, Any]:
        """Return the values of some parts of the state, by default of all parts."""
        names = self._parts if parts is None else parts
        return {part: self._parts[part].read() for part in names}

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
        if self._paused:
            return
        alongside = (name for name, each in self._parts.items() if each.alongside in parts)
        state = dict(before or {}) | self.read((*parts, *alongside))
        now = time.monotonic()
        last = self.past[-1] if self.past else None
        if (
            last is not None
            and before is not None
            and (last.label, last.state.keys()) == (label, state.keys())
            and now - last.when < _ONE_GESTURE
        ):
            self.past = (*self.past[:-1], replace(last, when=now))
        else:
            self.past = (*self.past, Step(label, state, now))[-_MAX_STEPS:]
        self._future_before, self.future = self.future, ()
        self.changed.emit()

    def end_gesture(self) -> None:
        """Make the next change a separate step, however soon it follows."""
        if self.past:
            self.past = (*self.past[:-1], replace(self.past[-1], when=-math.inf))

    def start(self, *steps: Step) -> None:
        """Remove all changes; `steps` become the changes that can be undone."""
        self.past, self.future, self._future_before = steps, (), ()
        self.started.emit()
        self.changed.emit()

    def complete(self, step: Step, state: Mapping[str, Any]) -> bool:
        """Set the state that undoing a step restores; return whether the step is the last one."""
        last = self.past[-1:] == (step,)
        done = replace(step, state=state)
        self.past = tuple(done if each is step else each for each in self.past)
        return last

    def amend(self, part: str, changed: Callable[[Any], Any]) -> None:
        """Replace the value of a part by ``changed(value)`` in all steps."""
        self._change_states(
            lambda state: {at: changed(state[at]) if at == part else state[at] for at in state}
        )

    def _change_states(self, changed: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
        """Change the values that steps restore; steps that are left without values are removed."""
        for name in ("past", "future", "_future_before"):
            steps = (replace(step, state=changed(step.state)) for step in getattr(self, name))
            setattr(self, name, tuple(step for step in steps if step.state))

    @property
    def is_paused(self) -> bool:
        """Whether nothing is recorded."""
        return self._paused

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Record nothing within the context."""
        before, self._paused = self._paused, True
        try:
            yield
        finally:
            self._paused = before

    def undo(self) -> None:
        """Revert the last change, or request the values missing for it (`is_ready` of `keep`)."""
        if self.past:
            step = self.past[-1]
            if not all(self._parts[part].is_ready(value) for part, value in step.state.items()):
                return
            self.past, self.future = self.past[:-1], (*self.future, self._cross(step))
            self.changed.emit()

    def redo(self) -> None:
        """Repeat the change that was undone last."""
        if self.future:
            step = self.future[-1]
            self.past, self.future = (*self.past, self._cross(step)), self.future[:-1]
            self.changed.emit()

    def revoke(self) -> None:
        """Revert the last change and remove it, so that it cannot be redone."""
        self.undo()
        self.future = self._future_before
        self.changed.emit()

    def _cross(self, step: Step) -> Step:
        """Restore the values of a step, and return the opposite step."""
        here = self.read(step.state)
        with self.paused():
            for part, value in step.state.items():
                self._parts[part].restore(value)
        return Step(step.label, here)

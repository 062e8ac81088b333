"""How widgets follow the model: at once where they act on it, in turns where they only show it.

To show something takes milliseconds, and one change of the model concerns many. So what has to be
shown is only noted, once however often it is said, and done in turns of the event loop between
which input and frames come through. While a field is on its way to the render, the turns wait for
its frame: first the picture, then the words about it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any, TypeAlias

import shiboken6
from PySide6.QtCore import QObject, QTimer

__all__ = [
    "catch_up",
    "first_a_frame",
    "follow",
    "frame_drawn",
    "later",
    "listen",
    "stop_listening",
]

#: Seconds after which a turn is over; what is left comes in the next one.
_TURN = 0.003
#: Milliseconds between turns. At 0, Qt would serve them only when nothing else waits at all, which
#: may be never while slow frames are drawn.
_PAUSE = 1
#: Milliseconds that turns wait for a frame, which may not come at all.
_PATIENCE = 40


def listen(signals: Any, slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object at once, without arguments, when the model says something.

    Parameters
    ----------
    signals : psygnal signal or signal group, or a tuple of them
        For instance ``document.spectrum_changed`` or ``display.events``.
    slot : bound method
        Held weakly; skipped once Qt has deleted its object, though Python may still know it.
    """
    _connect(signals, slot, _call)


def follow(signals: Any, slot: Callable[[], None]) -> None:
    """Like `listen`, but in one of the next turns of the event loop: for what is only shown."""
    _connect(signals, slot, lambda held: _turns().note(held))


def stop_listening(owner: QObject) -> None:
    """Let an object, such as a window that closes, hear nothing more, nor what it is still due."""
    for disconnect in _heard.pop(owner, ()):
        disconnect()
    _turns().forget(owner)


def later(slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object in one of the next turns, once however often it is due."""
    _turns().note(weakref.WeakMethod(slot))


def first_a_frame() -> None:
    """Let the turns wait until `frame_drawn`, though not for long."""
    _turns().wait()


def frame_drawn() -> None:
    """Let the turns go on."""
    _turns().go_on()


def catch_up() -> None:
    """Do now what is due, for whoever looks at the widgets before the event loop gets to it."""
    _turns().finish()


_Held: TypeAlias = "weakref.WeakMethod[Callable[[], None]]"
#: By whom signals are heard, and what ends it.
_heard: weakref.WeakKeyDictionary[object, list[Callable[[], None]]] = weakref.WeakKeyDictionary()


def _connect(signals: Any, slot: Any, act: Callable[[_Held], None]) -> None:
    held = weakref.WeakMethod(slot)

    def heard() -> None:
        act(held)

    for each in signals if isinstance(signals, tuple) else (signals,):
        each.connect(heard)
        _heard.setdefault(slot.__self__, []).append(partial(each.disconnect, heard))


def _call(held: _Held) -> None:
    method: Any = held()
    if method is not None and shiboken6.isValid(method.__self__):
        method()


class _Turns(QObject):
    """What is due, in the order in which it was said first."""

    def __init__(self) -> None:
        super().__init__()
        self._due: dict[_Held, None] = {}
        self._timer = QTimer(self, singleShot=True)
        self._timer.timeout.connect(self._take_turn)
        self._waiting = self._waited = False

    def note(self, held: _Held) -> None:
        self._due.setdefault(held)
        if not self._timer.isActive():
            self._timer.start(_PATIENCE if self._waiting else _PAUSE)

    def wait(self) -> None:
        if self._waited:
            return  # once between two turns: words would never come if all pictures were in a hurry
        self._waiting = self._waited = True
        if self._timer.isActive():
            self._timer.start(_PATIENCE)  # what was said already about this picture waits, too

    def go_on(self) -> None:
        self._waiting = False
        self._waited = bool(self._due)
        if self._due:
            self._timer.start(_PAUSE)

    def forget(self, owner: QObject) -> None:
        for held in list(self._due):
            method: Any = held()
            if method is not None and method.__self__ is owner:
                del self._due[held]

    def finish(self) -> None:
        self._waited = False
        while self._due:
            self._call_first()

    def _take_turn(self) -> None:
        self._waiting = self._waited = False
        end = perf_counter() + _TURN
        while self._due and perf_counter() < end:
            if len(self._due) > 1:
                self._timer.start(_PAUSE)  # before the call, which may fail
            self._call_first()

    def _call_first(self) -> None:
        first = next(iter(self._due))
        del self._due[first]
        _call(first)


_known: _Turns | None = None


def _turns() -> _Turns:
    """Made when the first one follows: there is an application then."""
    global _known
    if _known is None or not shiboken6.isValid(_known):
        _known = _Turns()
    return _known

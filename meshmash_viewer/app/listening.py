"""Connections of widgets to signals of the model, called at once or deferred.

An update of a widget takes milliseconds, and one change of the model concerns many widgets. Updates
of what is only displayed are therefore queued, each once. They begin when the frame of a tick has
been drawn, or after a while without one, and run in short turns of the event loop, between which
input and frames are handled.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any, TypeAlias

import shiboken6
from PySide6.QtCore import QObject, QTimer

#: Milliseconds until deferred calls begin without a frame, and between one beginning at a frame and
#: the next; seconds after which a turn ends. What a turn has changed is painted after it, which
#: takes milliseconds however small it is, so that turns are few.
_DELAY, _TURN = 48, 0.008
#: Milliseconds between turns. A timer of 0 fires only when no other event is pending, which may be
#: never while slow frames are drawn.
_PAUSE = 1


def listen(signals: Any, slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object at once, without arguments, when a signal is emitted.

    `signals` are one or a tuple, of psygnal: ``document.spectrum_changed`` or ``display.events``.
    The slot is held weakly, and not called once Qt has deleted its object.
    """
    _connect(signals, slot, _call)


def follow(signals: Any, slot: Callable[[], None]) -> None:
    """Like `listen`, but call it in one of the next turns: for what is only displayed."""
    _connect(signals, slot, lambda held: _turns().note(held))


def stop_listening(owner: QObject) -> None:
    """Disconnect all slots of an object, such as a closing window, and drop its pending calls."""
    for disconnect in _disconnects.pop(owner, ()):
        disconnect()
    _turns().forget(owner)


def later(slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object in one of the next turns, once for several requests."""
    _turns().note(weakref.WeakMethod(slot))


def hasten() -> None:
    """Begin with the pending calls, since a frame has been drawn; later if some were just made."""
    _turns().hasten()


def catch_up() -> None:
    """Make all pending calls now, as tests and screenshots need."""
    _turns().finish()


_Held: TypeAlias = "weakref.WeakMethod[Callable[[], None]]"
#: By owner of the slots: functions that disconnect them.
_disconnects: weakref.WeakKeyDictionary[object, list[Callable[[], None]]] = (
    weakref.WeakKeyDictionary()
)


def _connect(signals: Any, slot: Any, act: Callable[[_Held], None]) -> None:
    held = weakref.WeakMethod(slot)

    def received() -> None:
        act(held)

    for each in signals if isinstance(signals, tuple) else (signals,):
        each.connect(received)
        _disconnects.setdefault(slot.__self__, []).append(partial(each.disconnect, received))


def _call(held: _Held) -> None:
    method: Any = held()
    if method is not None and shiboken6.isValid(method.__self__):
        method()


class _Turns(QObject):
    """Pending calls, in the order of their first request."""

    def __init__(self) -> None:
        super().__init__()
        self._due: dict[_Held, None] = {}
        self._ended = -math.inf
        self._timer = QTimer(self, singleShot=True)
        self._timer.timeout.connect(self._take_turn)

    def note(self, held: _Held) -> None:
        self._due.setdefault(held)
        if not self._timer.isActive():
            self._timer.start(_DELAY)

    def hasten(self) -> None:
        if self._timer.remainingTime() > _PAUSE:  # else never while frames are drawn
            long_ago = perf_counter() - self._ended > _DELAY / 1000.0
            self._timer.start(_PAUSE if long_ago else _DELAY)  # rather after the next frame

    def forget(self, owner: QObject) -> None:
        for held in list(self._due):
            method: Any = held()
            if method is not None and method.__self__ is owner:
                del self._due[held]

    def finish(self) -> None:
        while self._due:
            self._call_first()

    def _take_turn(self) -> None:
        begun = perf_counter()
        while self._due:  # one call at least, however busy the machine
            if len(self._due) > 1:
                self._timer.start(_PAUSE)  # before the call, which may fail
            self._call_first()
            self._ended = perf_counter()
            if self._ended - begun > _TURN:
                break

    def _call_first(self) -> None:
        first = next(iter(self._due))
        del self._due[first]
        _call(first)


_known: _Turns | None = None


def _turns() -> _Turns:
    """Return the queue, made at the first use, when there is an application."""
    global _known
    if _known is None or not shiboken6.isValid(_known):
        _known = _Turns()
    return _known

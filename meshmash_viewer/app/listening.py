"""Connections of widgets to signals of the model, called at once or deferred.

An update of a widget takes milliseconds, and one change of the model affects many widgets. Updates
that only affect the display are therefore queued, each at most once. The queue is processed after
the next frame is drawn, or after 48 ms without a frame, in short turns of the event loop, so that
input and frames are handled between the turns.
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

#: `_DELAY`: milliseconds until the queue is processed if no frame is drawn, and minimum time
#: between two turns started by frames. `_TURN`: seconds after which a turn ends. Qt paints for
#: milliseconds after each turn, however little has changed, so there should be few turns.
_DELAY, _TURN = 48, 0.008
#: Milliseconds between turns. A timer of 0 ms would fire only when no other event is pending,
#: possibly never while slow frames are drawn.
_PAUSE = 1


def listen(signals: Any, slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object at once, without arguments, when a signal is emitted.

    `signals` is a psygnal signal or group, such as ``document.spectrum_changed`` or
    ``display.events``, or a tuple of signals and groups. The slot is referenced weakly, and is not
    called after Qt has deleted its object.
    """
    _connect(signals, slot, lambda held, *_: _call(held))


def receive(signal: Any, slot: Callable[..., None]) -> None:
    """Connect like `listen`, with the arguments of the signal."""
    _connect(signal, slot, _call)


def follow(signals: Any, slot: Callable[[], None]) -> None:
    """Connect like `listen`, but queue the call: for updates that only affect the display."""
    _connect(signals, slot, lambda held, *_: _turns().note(held))


def stop_listening(owner: QObject) -> None:
    """Disconnect all slots of an object and its children, and drop their pending calls."""
    for each in [each for each in _disconnects if belongs_to(each, owner)]:
        for disconnect in _disconnects.pop(each):
            disconnect()
    _turns().forget(owner)


def belongs_to(each: QObject | None, owner: QObject) -> bool:
    """Return whether an object is `owner`, or a child of it at any depth."""
    while each is not None and each is not owner and shiboken6.isValid(each):
        each = each.parent()
    return each is owner


def later(slot: Callable[[], None]) -> None:
    """Queue the call of a bound method of a Qt object; several requests make one call."""
    _turns().note(weakref.WeakMethod(slot))


def hasten() -> None:
    """Process the queue soon because a frame was drawn; wait if the last turn was recent."""
    _turns().hasten()


def catch_up() -> None:
    """Make all queued calls now, for tests and screenshots."""
    _turns().finish()


_Held: TypeAlias = "weakref.WeakMethod[Callable[[], None]]"
#: Functions that disconnect slots, by the owner of the slots.
_disconnects: weakref.WeakKeyDictionary[QObject, list[Callable[[], None]]] = (
    weakref.WeakKeyDictionary()
)


def _connect(signals: Any, slot: Any, act: Callable[..., None]) -> None:
    held = weakref.WeakMethod(slot)

    def received(*content: Any) -> None:
        act(held, *content)

    for each in signals if isinstance(signals, tuple) else (signals,):
        each.connect(received)
        _disconnects.setdefault(slot.__self__, []).append(partial(each.disconnect, received))


def _call(held: _Held, *content: Any) -> None:
    method: Any = held()
    if method is not None and shiboken6.isValid(method.__self__):
        method(*content)


class _Turns(QObject):
    """Queue of deferred calls, in the order of their first request."""

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
        if self._timer.remainingTime() > _PAUSE:  # do not postpone a turn that is about to begin
            long_ago = perf_counter() - self._ended > _DELAY / 1000.0
            self._timer.start(_PAUSE if long_ago else _DELAY)

    def forget(self, owner: QObject) -> None:
        for held in list(self._due):
            method: Any = held()
            if method is not None and belongs_to(method.__self__, owner):
                del self._due[held]

    def finish(self) -> None:
        while self._due:
            self._call_first()

    def _take_turn(self) -> None:
        begun = perf_counter()
        while self._due:  # at least one call in each turn
            if len(self._due) > 1:
                self._timer.start(_PAUSE)  # before the call, because the call may raise
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
    """Return the queue, made at the first use because a timer requires an application."""
    global _known
    if _known is None or not shiboken6.isValid(_known):
        _known = _Turns()
    return _known

"""Handler of uncaught exceptions: a sentence in the message bar, with details to copy."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of, versions

#: Seconds in which the same fault, as at every frame, is shown once.
_ONCE = 2.0


def notice_of(failure: Failure) -> Notice:
    """Return the notice of a failure; its details include versions for a bug report."""
    details = f"{failure.details}\n{versions()}" if failure.details else ""
    return Notice(failure.text, Severity.ERROR, details)


class FaultBoundary(QObject):
    """Replaces Python's hooks for uncaught exceptions while it is entered.

    An exception in a slot, an event handler or a thread has no caller that catches it. It is
    received here from any thread, and `notify` is called with a `Notice` in a later turn of the
    event loop, as it may be raised while a widget is painted.
    """

    _caught = Signal(object)

    def __init__(self, notify: Callable[[Notice], None]) -> None:
        super().__init__()
        self._notify = notify
        self._said: dict[str, float] = {}
        self._before: tuple[Any, ...] = ()
        self._caught.connect(self._say, Qt.ConnectionType.QueuedConnection)

    def __enter__(self) -> FaultBoundary:
        self._before = sys.excepthook, sys.unraisablehook, threading.excepthook
        sys.excepthook = self._take
        sys.unraisablehook = lambda args: self._take(type(args.exc_value), args.exc_value, None)
        threading.excepthook = lambda args: self._take(args.exc_type, args.exc_value, None)
        return self

    def __exit__(self, *_: object) -> None:
        sys.excepthook, sys.unraisablehook, threading.excepthook = self._before

    def _take(self, kind: object, fault: BaseException | None, trace: TracebackType | None) -> None:
        if fault is None or isinstance(fault, SystemExit):
            return
        if isinstance(fault, KeyboardInterrupt):
            self._before[0](type(fault), fault, trace)
            return
        # Python keeps the last exception for a debugger, with all objects in its frames
        sys.last_value = sys.last_traceback = None
        self._caught.emit(failure_of(fault))

    def _say(self, failure: Failure) -> None:
        now = time.monotonic()
        if now - self._said.get(failure.text, -_ONCE) < _ONCE:
            return
        self._said = {text: at for text, at in self._said.items() if now - at < _ONCE}
        self._said[failure.text] = now
        self._notify(notice_of(failure))

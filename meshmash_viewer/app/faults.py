"""Where exceptions end that nobody has caught: in a sentence, with details to copy."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from meshmash_viewer.defects import versions
from meshmash_viewer.model.document import Notice, Severity
from meshmash_viewer.model.failure import Failure, failure_of

__all__ = ["FaultBoundary", "notice_of"]

#: Seconds in which a fault that comes again, as at every frame, is said once.
_ONCE = 2.0


def notice_of(failure: Failure) -> Notice:
    """A failure for the message bar; its details name the versions that a report needs."""
    details = f"{failure.details}\n{versions()}" if failure.details else ""
    return Notice(failure.text, Severity.ERROR, details)


class FaultBoundary(QObject):
    """Takes the place of Python's own hooks while it is entered.

    Qt calls Python in slots, events and threads, where an exception has no caller to go to. It
    comes here from any thread and is told in a later turn of the event loop: it may come from the
    middle of painting what would have to tell it.

    Parameters
    ----------
    tell : callable
        Takes a `Notice`.
    """

    _caught = Signal(object)

    def __init__(self, tell: Callable[[Notice], None]) -> None:
        super().__init__()
        self._tell = tell
        self._said: dict[str, float] = {}
        self._before: tuple[Any, ...] = ()
        self._caught.connect(self._say, Qt.ConnectionType.QueuedConnection)

    def __enter__(self) -> FaultBoundary:
        self._before = sys.excepthook, sys.unraisablehook, threading.excepthook
        sys.excepthook = self._take
        sys.unraisablehook = lambda told: self._take(type(told.exc_value), told.exc_value, None)
        threading.excepthook = lambda told: self._take(told.exc_type, told.exc_value, None)
        return self

    def __exit__(self, *_: object) -> None:
        sys.excepthook, sys.unraisablehook, threading.excepthook = self._before

    def _take(
        self,
        kind: object,
        fault: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if fault is None or isinstance(fault, SystemExit):
            return
        if isinstance(fault, KeyboardInterrupt):
            self._before[0](type(fault), fault, trace)
            return
        # Python keeps the last exception for a debugger, and with it whatever its frames hold.
        sys.last_value = sys.last_traceback = None
        self._caught.emit(failure_of(fault))

    def _say(self, failure: Failure) -> None:
        now = time.monotonic()
        if now - self._said.get(failure.text, -_ONCE) < _ONCE:
            return
        self._said = {text: at for text, at in self._said.items() if now - at < _ONCE}
        self._said[failure.text] = now
        self._tell(notice_of(failure))

"""A thread for which only the latest request counts."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from PySide6.QtCore import QObject, QThread

from meshmash_viewer.progress import CancelCallback

__all__ = ["LatestThread"]

Request = TypeVar("Request")


class LatestThread(QThread, Generic[Request]):
    """Works on one request at a time; a newer one takes the place of the one that waits.

    Parameters
    ----------
    work : callable
        Called with a request, and with a function that says whether to give up.
    rest : float
        Seconds that a request has to stay the latest before it is worked on.
    """

    def __init__(
        self,
        work: Callable[[Request, CancelCallback], None],
        rest: float = 0.0,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        if parent is not None:
            # a thread that runs must not be destroyed; by name it would keep whose work it does
            held = weakref.ref(self)
            parent.destroyed.connect(lambda: _close(held))
        self._work = work
        self._rest = rest
        self._condition = threading.Condition()
        self._next: Request | None = None
        self._dropped = False
        self._closing = False
        self._working = False

    @property
    def working(self) -> bool:
        """Whether there is a request that has not been worked on."""
        return self._working

    def ask(self, request: Request) -> None:
        """Take a request in the place of the one that waits; none once it is closed."""
        with self._condition:
            if not self._closing:
                self._next = request
                self._working = True
                self._condition.notify()

    def drop(self) -> None:
        """Forget the request that waits, and give up the one that is worked on."""
        with self._condition:
            self._next = None
            self._dropped = True

    def close(self) -> None:
        """Give up, and wait until the thread has ended."""
        with self._condition:
            self._closing = True
            self._condition.notify()
        self.wait()

    def run(self) -> None:
        """Wait for requests and work on them."""
        while (request := self._take()) is not None:
            self._work(request, self._given_up)
            del request  # before waiting: it may hold a file open

    def _take(self) -> Request | None:
        with self._condition:
            while not self._closing:
                if self._next is None:
                    self._working = False
                    self._condition.wait()
                    continue
                latest = self._next
                if self._rest and self._condition.wait(self._rest):
                    continue  # a newer one, or the end
                if self._next is latest:
                    self._next, self._dropped = None, False
                    return latest
            return None

    def _given_up(self) -> bool:
        return self._dropped or self._closing


def _close(held: weakref.ref[LatestThread[Any]]) -> None:
    thread = held()
    if thread is not None:
        thread.close()

"""A thread for which only the latest request counts."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from PySide6.QtCore import QObject, Qt, QThread, Signal

from meshmash_viewer.progress import CancelCallback, Cancelled

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["LatestThread"]

Request = TypeVar("Request")


class LatestThread(QThread, Generic[Request]):
    """Works on one request at a time; a newer one takes the place of the one that waits.

    Parameters
    ----------
    work : callable
        Called in the thread with a request, and with a function that says whether to give up; it
        may raise `Cancelled` then. What it returns is the answer.
    take : bound method of a QObject, optional
        Called in the thread of that object, with a request and its answer, or the exception that
        was raised instead. `answered` can be emitted with more answers on the way.
    rest : float
        Seconds that a request has to stay the latest before it is worked on.
    parent : QObject, optional
    one_core : bool
        Whether linear algebra is to use no more than this thread: more would compete with the
        interface's, and beside the solver's processes they make products several times slower. The
        limit is the whole process's, which may be somebody else's: no longer than the work takes.
    priority : QThread.Priority
    """

    answered = Signal(object, object)

    def __init__(
        self,
        work: Callable[[Request, CancelCallback], Any],
        take: Callable[[Request, Any], None] | None = None,
        rest: float = 0.0,
        parent: QObject | None = None,
        *,
        one_core: bool = False,
        priority: QThread.Priority = QThread.Priority.InheritPriority,
    ) -> None:
        super().__init__(parent)
        if parent is not None:
            # a thread that runs must not be destroyed; by name it would keep whose work it does
            held = weakref.ref(self)
            parent.destroyed.connect(lambda: _close(held))
        if take is not None:
            self.answered.connect(take, Qt.ConnectionType.QueuedConnection)
        self._work = work
        self._rest = rest
        self._one_core = one_core
        self._condition = threading.Condition()
        self._next: Request | None = None
        self._dropped = False
        self._closing = False
        self._working = False
        self.start(priority)

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
            self._condition.notify()

    def close(self) -> None:
        """Give up, and wait until the thread has ended."""
        with self._condition:
            self._closing = True
            self._condition.notify()
        self.wait()

    # -- in the thread ------------------------------------------------------------------------

    def stays(self, seconds: float) -> bool:
        """Whether the request that is worked on is still the latest one some seconds later."""
        with self._condition:
            return not self._condition.wait_for(
                lambda: self._next is not None or self._given_up(), seconds
            )

    def run(self) -> None:
        """Wait for requests and work on them."""
        while self._serve():
            pass

    def _serve(self) -> bool:
        """Work on the next request; False at the end.

        What it knows goes with it, however it ends: a request may hold a mesh, or a file open.
        """
        request = self._take()
        if request is None:
            return False
        answer: Any
        try:
            with self._limits():
                answer = self._work(request, self._given_up)
        except Cancelled:
            return True
        except Exception as fault:  # noqa: BLE001  whoever takes the answer says it
            answer = fault
        self.answered.emit(request, answer)
        return True

    def _take(self) -> Request | None:
        latest: Request | None
        with self._condition:
            while not self._closing:
                if self._next is None:
                    latest = None  # or it would be held while nothing is asked for
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

    def _limits(self) -> AbstractContextManager[Any]:
        return _libraries().limit(limits=1, user_api="blas") if self._one_core else nullcontext()

    def _given_up(self) -> bool:
        return self._dropped or self._closing


@cache
def _libraries() -> ThreadpoolController:
    """Those of linear algebra, which it takes a while to look for."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _close(held: weakref.ref[LatestThread[Any]]) -> None:
    thread = held()
    if thread is not None:
        thread.close()

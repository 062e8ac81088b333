"""Background work of windows: named slots of one executor, whose threads all windows share.

A slot runs one call at a time; a new call replaces the waiting one. Results are passed on in the
interface thread. `shutdown` ends all slots of a window at once.
"""

from __future__ import annotations

import threading
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import nullcontext
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

import shiboken6
from PySide6.QtCore import QObject, Qt, QTimer, Signal

from meshmash_viewer.app.listening import belongs_to, stop_listening
from meshmash_viewer.progress import Cancelled

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Result = TypeVar("Result")

#: Number of threads, more than a window has slots: no slot waits for another.
_THREADS = 64


class Call:
    """A call of a function in a slot, which receives this object."""

    def __init__(
        self,
        slot: Slot,
        function: Callable[[Call], Any],
        then: Callable[[Any], object],
        failed: Callable[[Exception], object] | None,
        queued: bool,
    ) -> None:
        self.slot, self._period = slot, slot.period
        self.function, self.then, self.failed, self.queued = function, then, failed, queued

    def cancelled(self) -> bool:
        """Return whether the result is not needed; the function may then raise `Cancelled`."""
        return self._period != self.slot.period

    def superseded(self) -> bool:
        """Return whether a newer call is waiting, or this one is cancelled."""
        return self.slot.has_waiting or self.cancelled()

    def stays(self, seconds: float) -> bool:
        """Return, after some seconds or earlier, whether this call is not superseded."""
        with self.slot.condition:
            return not self.slot.condition.wait_for(self.superseded, seconds)

    def send(self, result: object) -> None:
        """Pass an intermediate result to `then`."""
        _executor().delivered.emit(self, result, "sent")


class Held:
    """Something that ends with the Qt object that it belongs to, see `shutdown`."""

    def __init__(
        self, owner: QObject, close: Callable[[], object], wait: Callable[[], object] = lambda: None
    ) -> None:
        self.owner, self.close, self.wait = weakref.ref(owner), close, wait
        _executor().held.add(self)


class Slot(Held):
    """Slot `name` of a Qt object, for `is_idle` and `shutdown` a slot of the object's window too.

    With `one_core`, linear algebra uses the calling thread only: more threads would compete with
    the interface thread, and make products several times slower while the solver runs. The limit
    applies to the whole process, while a call runs.
    """

    def __init__(self, owner: QObject, name: str, *, one_core: bool = False) -> None:
        super().__init__(owner, self._close, self._wait)
        self.name = name
        #: Guards the attributes that `Call` reads, and announces new calls.
        self.condition = threading.Condition()
        #: Number of times that the calls have been dropped.
        self.period = 0
        self._one_core = one_core
        self._waiting: deque[Call] = deque()
        self._served: Future[None] | None = None
        self._closed = False
        #: The newest call, until its result has been passed on; used by the interface thread.
        self._newest: Call | None = None

    @property
    def working(self) -> bool:
        """Whether the newest call waits, runs, or has a result to pass on."""
        return self._newest is not None

    @property
    def has_waiting(self) -> bool:
        return bool(self._waiting)

    def submit(
        self,
        function: Callable[[Call], Result],
        then: Callable[[Result], object],
        failed: Callable[[Exception], object] | None = None,
        *,
        queued: bool = False,
    ) -> None:
        """Call a function in a thread, then `then` with its result in the interface thread.

        An exception is passed to `failed`, by default raised in the interface thread. The call
        replaces the waiting call; with `queued`, it runs after all waiting calls, at `shutdown`
        too. Calls are ignored after `shutdown`.
        """
        call = Call(self, function, then, failed, queued)
        with self.condition:
            if self._closed:
                return
            if self._waiting and not queued:
                self._waiting.pop()
            self._newest = call
            self._waiting.append(call)
            self.condition.notify_all()
            if self._served is None:
                self._served = _executor().threads.submit(self._serve)

    def drop(self) -> None:
        """Drop the waiting call, and cancel the running one; their results are not passed on."""
        self._newest = None
        with self.condition:
            self.period += 1
            self._waiting = deque(call for call in self._waiting if call.queued)
            self.condition.notify_all()

    def _close(self) -> None:
        """Drop the calls, and ignore new calls."""
        self._closed = True
        self.drop()

    def _wait(self) -> None:
        """Wait until no call runs or waits."""
        served = self._served
        if served is not None:
            wait([served])

    def take(self, call: Call, result: Any, kind: str) -> None:
        """Pass on a result, see `_Executor.delivered`; called in the interface thread."""
        owner, then, failed = self.owner(), call.then, call.failed
        if kind != "sent":
            del call.then, call.failed  # a thread may hold the call longer
            if call is self._newest:
                self._newest = None
        if owner is None or not shiboken6.isValid(owner) or call.cancelled():
            return
        if kind != "raised":
            then(result)
        elif isinstance(result, Cancelled):
            pass
        elif failed is None:
            raise result
        else:
            failed(result)

    # -- in a thread --------------------------------------------------------------------------

    def _serve(self) -> None:
        """Run the waiting calls, and keep no reference to them."""
        threading.current_thread().name = self.name
        while (call := self._next()) is not None:
            result: Any
            kind = "returned"
            try:
                with _libraries().limit(limits=1, user_api="blas") if self._one_core else _FREE:
                    result = call.function(call)
            except Exception as fault:  # noqa: BLE001  passed on
                result, kind = fault, "raised"
            del call.function  # here, because the objects of `then` are deleted in their thread
            _executor().delivered.emit(call, result, kind)
            del call, result

    def _next(self) -> Call | None:
        with self.condition:
            if not self._waiting:
                self._served = None
                return None
            return self._waiting.popleft()


class _Executor(QObject):
    """The threads of all slots, and the way of the results into the interface thread."""

    #: A call, a result, and "returned" or "sent"; or a call, an exception, and "raised".
    delivered = Signal(object, object, str)

    def __init__(self) -> None:
        super().__init__()
        self.threads = ThreadPoolExecutor(_THREADS, "slot")
        self.held: weakref.WeakSet[Held] = weakref.WeakSet()
        self.delivered.connect(self._take, Qt.ConnectionType.QueuedConnection)

    def held_by(self, owner: QObject) -> list[Held]:
        return [each for each in self.held if belongs_to(each.owner(), owner)]

    def _take(self, call: Call, result: Any, kind: str) -> None:
        call.slot.take(call, result, kind)


def is_idle(owner: QObject) -> bool:
    """Return whether no slot of a Qt object and of its children is working."""
    held = _executor().held_by(owner)
    return not any(isinstance(each, Slot) and each.working for each in held)


def shutdown(owner: QObject) -> None:
    """End all that belongs to a Qt object and its children, such as a closing window.

    These are signals, timers, calls and processes, then what was drawn. Queued calls are completed;
    no results are passed on.
    """
    stop_listening(owner)
    for timer in owner.findChildren(QTimer):
        timer.stop()
    held = _executor().held_by(owner)
    for each in held:
        each.close()
    for each in sorted(held, key=lambda each: not isinstance(each, Slot)):
        each.wait()


_FREE = nullcontext()
_known: _Executor | None = None


def _executor() -> _Executor:
    """Return the executor, made at the first use because signals require an application."""
    global _known
    if _known is None or not shiboken6.isValid(_known):
        _known = _Executor()
    return _known


@cache
def _libraries() -> ThreadpoolController:
    """Return the controller of the linear algebra libraries, cached because it is slow to make."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()

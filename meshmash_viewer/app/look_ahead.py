"""The field that is likely to be asked for next, computed while nothing else is."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QThread

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.model.field import Field, FieldRequest
from meshmash_viewer.progress import CancelCallback

__all__ = ["LookAhead"]

#: Seconds until it begins: the frame of the field that has just come goes first.
_AFTER = 0.012


class LookAhead:
    """Goes one step farther in the direction of the last one.

    Whoever scrolls through eigenfunctions then waits neither for the disk nor for the conversion,
    but for the frame alone. It holds one field.

    Parameters
    ----------
    compute : callable
        Of a request, its field; called in a thread of its own.
    expected : callable
        Of the request before and the one that has just been answered, the one after it; None where
        that would not take long.
    parent : QObject
        Of the thread.
    """

    def __init__(
        self,
        compute: Callable[[FieldRequest], Field | None],
        expected: Callable[[FieldRequest | None, FieldRequest], FieldRequest | None],
        parent: QObject,
    ) -> None:
        self._compute = compute
        self._expected = expected
        self._last: FieldRequest | None = None
        self._field: Field | None = None
        self._thread = LatestThread(self._work, rest=_AFTER, parent=parent)
        self._thread.start(QThread.Priority.LowPriority)

    def follow(self, request: FieldRequest) -> None:
        """Take note of a request that has been answered, and prepare for the one after it."""
        before, self._last = self._last, request
        following = self._expected(before, request)
        if following is not None:
            self._thread.ask(following)
        elif before is None or before.family.name != request.family.name:
            self.forget()

    def answer(self, request: FieldRequest) -> Field | None:
        """The field of a request, if it is the one that was prepared for."""
        field = self._field
        return field if field is not None and field.request == request else None

    def forget(self) -> None:
        """Let go of the field, as when another mesh is opened."""
        self._thread.drop()
        self._last = self._field = None

    def close(self) -> None:
        """Stop the thread and wait for it."""
        self._thread.close()

    def _work(self, request: FieldRequest, cancel: CancelCallback) -> None:
        self._field = None  # before the new one takes room
        try:
            field = self._compute(request)
        except Exception:  # noqa: BLE001  it is said to whoever asks for this field
            return
        self._field = field
        if cancel():
            self._field = None  # forgotten meanwhile

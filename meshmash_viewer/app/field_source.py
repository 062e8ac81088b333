"""Computes the field on the render off the interface thread; only the latest request counts."""

from __future__ import annotations

import threading

from PySide6.QtCore import QObject, Qt, QThread, Signal, Slot

from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, FieldRequest, compute_field, request_of
from meshmash_viewer.model.live import LiveFeatures

__all__ = ["FieldSource"]

#: Attributes of the display that can change the values of a field.
_WATCHED = (
    "kind",
    "index",
    "flipped",
    "time",
    "hks_automatic",
    "hks_t_min",
    "hks_t_max",
    "hks_scales",
    "band",
    "band_count",
    "band_automatic",
    "band_min",
    "band_max",
    "similarity_vertex",
    "similarity_basis",
)


class FieldSource(QObject):
    """Listens to a document and answers with fields.

    `field_ready` carries each new `Field`, or None when there is nothing to show; `failed` one
    sentence if a field cannot be computed.
    """

    field_ready = Signal(object)
    failed = Signal(str)
    _computed = Signal(object, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._live = LiveFeatures()
        self._field: Field | None = None
        self._wanted: FieldRequest | None = None
        self._thread = _FieldThread(self, self._live)
        self._computed.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self._signals = [getattr(document.display.events, name) for name in _WATCHED]
        self._signals += [document.spectrum_changed, document.mesh_changed]
        for signal in self._signals:
            signal.connect(self.refresh)
        self._thread.start()

    @property
    def field(self) -> Field | None:
        """The last field that was computed."""
        return self._field

    @property
    def live(self) -> LiveFeatures:
        """The tables behind cheap features."""
        return self._live

    @property
    def idle(self) -> bool:
        """Whether the field is the one wanted, and final."""
        field = self._field
        if self._wanted is None:
            return field is None
        return field is not None and field.request == self._wanted and not self._thread.working

    def refresh(self) -> None:
        """Ask for the field that the document wants now; nothing happens if it is there."""
        request = request_of(self._document)
        if request == self._wanted:
            return
        self._wanted = request
        if request is None:
            self._thread.ask(None)
            self._field = None
            self.field_ready.emit(None)
        else:
            self._thread.ask(request)

    def close(self) -> None:
        """Stop the thread and wait for it."""
        for signal in self._signals:
            signal.disconnect(self.refresh)
        self._thread.close()
        self._thread.wait()

    @Slot(object, object)
    def _take(self, request: FieldRequest, answer: Field | Exception) -> None:
        if request.spectrum.rows.shape[1:] != self._shape():
            return  # of a mesh that is gone
        if isinstance(answer, Exception):
            self.failed.emit(f"The field cannot be computed: {answer}")
            return
        self._field = answer
        self.field_ready.emit(answer)

    def _shape(self) -> tuple[int, ...]:
        wanted = self._wanted
        return wanted.spectrum.rows.shape[1:] if wanted is not None else ()


class _FieldThread(QThread):
    """One request at a time; a newer one takes the place of the one that waits."""

    def __init__(self, source: FieldSource, live: LiveFeatures) -> None:
        super().__init__(source)
        self._source = source
        self._live = live
        self._condition = threading.Condition()
        self._next: FieldRequest | None = None
        self._closing = False
        self.working = False

    def ask(self, request: FieldRequest | None) -> None:
        with self._condition:
            self._next = request
            self.working = self.working or request is not None
            self._condition.notify()

    def close(self) -> None:
        with self._condition:
            self._closing = True
            self._condition.notify()

    def run(self) -> None:
        while True:
            with self._condition:
                while self._next is None and not self._closing:
                    self.working = False
                    self._condition.wait()
                if self._closing:
                    return
                request, self._next = self._next, None
            assert request is not None
            answer: Field | Exception
            try:
                answer = compute_field(request, self._live)
            except Exception as error:  # noqa: BLE001  the window says it
                answer = error
            self._source._computed.emit(request, answer)

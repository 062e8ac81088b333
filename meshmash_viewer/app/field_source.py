"""Computation of the displayed field in a background thread; only the latest request counts."""

from __future__ import annotations

from PySide6.QtCore import QObject, QThread, QTimer, Signal

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import wait_for_frame
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, FieldRequest, LiveFeatures, compute_field, request_of
from meshmash_viewer.model.limits import LimitPolicy
from meshmash_viewer.progress import CancelCallback

#: Seconds without a newer request after which the table for the last one is built.
_REST = 0.15
#: Milliseconds after which a field that is being computed is announced.
_LATE = 200


class FieldSource(QObject):
    """Computes the field that a document displays.

    `field_ready` carries each new `Field`, or None when there is nothing to show; `failed` one
    sentence if a field cannot be computed; `awaited` the title of a field that takes long, and ""
    when it is ready. One thread computes fields; another builds the tables that make the next ones
    fast, after which a draft is computed again.
    """

    field_ready = Signal(object)
    failed = Signal(str)
    awaited = Signal(str)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._live = LiveFeatures()
        self._field: Field | None = None
        self._wanted: FieldRequest | None = None
        self._policy: LimitPolicy | None = None
        self._late = QTimer(self, singleShot=True, interval=_LATE)
        self._late.timeout.connect(self._say_awaited)
        self._answers = LatestThread(self._answer, self._take, parent=self, one_core=True)
        low = QThread.Priority.LowPriority
        self._tables = LatestThread(self._build, self._improve, _REST, self, priority=low)
        events = document.display.events
        self._signals = [
            events.kind, events.fields, document.spectrum_changed, document.mesh_changed
        ]  # fmt: skip
        for signal in self._signals:
            signal.connect(self.refresh)

    @property
    def field(self) -> Field | None:
        """The last field that was computed."""
        return self._field

    @property
    def live(self) -> LiveFeatures:
        """The precomputed tables of the features."""
        return self._live

    @property
    def comes(self) -> bool:
        """Whether the requested field is not ready yet."""
        field = self._field
        return self._wanted is not None and (field is None or field.request != self._wanted)

    @property
    def idle(self) -> bool:
        """Whether the requested field is ready, and nothing is being computed."""
        if self._answers.working or self._tables.working or self.comes:
            return False
        return self._wanted is not None or self._field is None

    def refresh(self) -> None:
        """Request the field that the document displays now, unless it is requested already."""
        request = request_of(self._document)
        self._policy = self._document.display.limits
        if request == self._wanted:
            return
        before, self._wanted = self._wanted, request
        if request is None or (before is not None and not before.same_mesh(request)):
            self._answers.drop()
            self._tables.drop()
            self._live.forget()
            self._field = None
            self._come()
            self.field_ready.emit(None)
        if request is not None:
            if not self._late.isActive():
                self._late.start()
            wait_for_frame()
            self._answers.ask(request)

    def close(self) -> None:
        """Stop both threads and wait for them."""
        for signal in self._signals:
            signal.disconnect(self.refresh)
        self._late.stop()
        self._answers.close()
        self._tables.close()

    # -- in the threads -----------------------------------------------------------------------

    def _answer(self, request: FieldRequest, _cancel: CancelCallback) -> Field | None:
        answer = compute_field(request, self._live)
        if answer is not None:
            answer.limits(self._policy)  # cached here, off the interface thread
        return answer

    def _build(self, request: FieldRequest, cancel: CancelCallback) -> None:
        self._live.prepare(request, cancel)

    # -- in the interface thread --------------------------------------------------------------

    def _take(self, request: FieldRequest, answer: Field | Exception | None) -> None:
        if self._wanted is None or not self._wanted.same_mesh(request):
            return
        if isinstance(answer, Exception):
            self._come()
            named = "" if isinstance(answer, InputError) else f" ({type(answer).__name__})"
            self.failed.emit(f"The field cannot be computed{named}: {answer}")
            return
        wanted, shown = self._wanted, self._field
        if not self._live.prepared(wanted):
            self._tables.ask(wanted)
        if request != wanted and shown is not None and shown.request == wanted:
            return  # the wanted field is still displayed
        # an earlier position of a slider is shown meanwhile, a field of another family is not
        if answer is not None and request.family.name == wanted.family.name:
            self._field = answer
            self._come()
            if request != wanted:
                self._late.start()
            self.field_ready.emit(answer)

    def _say_awaited(self) -> None:
        if self._wanted is not None:
            self.awaited.emit(self._wanted.family.title())

    def _come(self) -> None:
        """Stop announcing a field."""
        self._late.stop()
        self.awaited.emit("")

    def _improve(self, request: FieldRequest, fault: Exception | None) -> None:
        """Compute the field again if it was computed without the new table."""
        if fault is not None:
            self._take(request, fault)
            return
        wanted, field = self._wanted, self._field
        if wanted is None or not wanted.same_mesh(request):
            return
        if wanted.family.name != request.family.name:
            return
        if field is None or field.draft or field.request != wanted:
            self._answers.ask(wanted)

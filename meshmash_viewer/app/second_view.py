"""The second mesh of a comparison: its render, and its background tasks."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtCore import QSize, Qt, Signal, Slot
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QLabel, QToolButton, QVBoxLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.background_io import BackgroundIO
from meshmash_viewer.app.controls import icons
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.app.field_source import FieldSource
from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import follow, listen, stop_listening
from meshmash_viewer.app.row_check import RowCheck
from meshmash_viewer.app.tasks import Tasks
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.features.comparison import Comparison
from meshmash_viewer.model.document import Document, Notice, Severity
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pair import ComparisonRequest, Pair
from meshmash_viewer.progress import CancelCallback


class SecondView(QWidget):
    """A second mesh that follows the first.

    Parameters
    ----------
    first : Document
    scene : MeshView
        The render of the first.
    source : FieldSource
        The fields of the first.

    Attributes
    ----------
    pair : Pair
        The links, and the comparison.
    """

    #: The user has pressed the close button.
    close_requested = Signal()
    #: The mesh could not be read.
    unread = Signal()
    #: It has been drawn, possibly with other common limits.
    shown = Signal()

    def __init__(self, first: Document, scene: MeshView, source: FieldSource) -> None:
        super().__init__()
        theme.named(self, "second_view", "Second mesh")
        self.document = Document()
        self.document.seconds_rate = first.seconds_rate
        self._first_scene, self._first_source = scene, source
        self.scene = MeshView(self.document)
        theme.named(self.scene, "second_scene", "Render of the second mesh")
        self.tasks = Tasks(self.document, self)
        self.background_io = BackgroundIO(self.document, self)
        self.field_source = FieldSource(self.document, self)
        self.row_check = RowCheck(self.document, self)
        self.pair = Pair(first, self.document)
        self._turning = self._waiting = False
        #: The field that was drawn last, and the limits that it shared with the first.
        self._drawn: tuple[Field | None, tuple[float, float] | None] = None, None
        self._build()
        self._thread = LatestThread(self._compare, self._accept, parent=self)
        self.pair.comparison_requested.connect(self._thread.ask)
        self._connect()
        self.scene.set_theme(theme.is_dark())

    def _build(self) -> None:
        self.status_label = theme.named(QLabel(), "second_label", "Second mesh, and its state")
        close = theme.named(
            QToolButton(), "second_close_button", "Close the second mesh",
            tip="Close the second mesh",
        )  # fmt: skip
        close.setIcon(QIcon(icons.pixmap("close", theme.palette().muted, 12)))
        close.setIconSize(QSize(12, 12))
        close.clicked.connect(self.close_requested)
        head = theme.named(QWidget(), "dock_title")
        head.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        head.setLayout(row((self.status_label,), close, margins=(theme.MARGIN, 4, 6, 4)))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(head)
        layout.addWidget(self.scene, 1)

    def _connect(self) -> None:
        document = self.document
        listen(document.mesh_changed, self._on_mesh_changed)
        listen(document.pins_changed, self._on_pins_changed)
        for signal in (document.job_changed, document.spectrum_changed, self.pair.changed):
            follow(signal, self._say_status)
        listen(self.pair.changed, self.show_field)
        for event in ("policies", "diverging_colormap", "sequential_colormap", "nodal_lines"):
            listen(getattr(document.display.events, event), self.show_field)
        document.noticed.connect(self._on_notice)
        follow(document.job_changed, self._on_job_changed)  # its notice goes first
        self.field_source.field_ready.connect(self._on_field)
        for source in (self.field_source, self._first_source):
            source.awaited.connect(self._wait_no_longer)
            source.failed.connect(self._wait_no_longer)
        self.field_source.awaited.connect(self.scene.set_awaited)
        self.field_source.failed.connect(lambda text: document.notify(Notice(text, Severity.ERROR)))
        self._first_source.field_ready.connect(self._first_shown)
        self.scene.vertex_clicked.connect(self.pair.pin_second)
        self.scene.stepped.connect(self._step)
        self.scene.camera_changed.connect(self._turned)
        self._first_scene.camera_changed.connect(self._turn_second)

    @property
    def idle(self) -> bool:
        """Whether nothing is being computed for it."""
        return (
            self.document.job is None
            and self.background_io.idle
            and self.field_source.idle
            and not self._thread.working
            and not self.pair.comparing
        )

    def shut(self) -> None:
        """Stop all its tasks; it cannot be shown again."""
        self.pair.close()
        self.pair.comparison_requested.disconnect(self._thread.ask)
        stop_listening(self)
        self.document.noticed.disconnect(self._on_notice)
        self._first_source.field_ready.disconnect(self._first_shown)
        self._first_source.awaited.disconnect(self._wait_no_longer)
        self._first_source.failed.disconnect(self._wait_no_longer)
        self._first_scene.camera_changed.disconnect(self._turn_second)
        self._thread.close()
        self.tasks.close()
        self.background_io.close()
        self.row_check.close()
        self.field_source.close()
        self.scene.close()

    # -- comparing ----------------------------------------------------------------------------

    def _compare(self, request: ComparisonRequest, cancel: CancelCallback) -> Comparison:
        return request.answered(cancel)

    @Slot(object, object)
    def _accept(self, request: ComparisonRequest, answer: Comparison | Exception) -> None:
        if isinstance(answer, Exception):
            self.pair.give_up(request)
            self._on_notice(notice_of(failure_of(answer, "Comparing")))
        else:
            self.pair.accept(request, answer)

    # -- from the documents -------------------------------------------------------------------

    def _on_mesh_changed(self) -> None:
        ready = self.document.ready
        if ready is not None:
            self.scene.set_mesh(ready.mesh, ready.normals)
            self._turn_second()
            self.show_field()

    def _on_pins_changed(self) -> None:
        self.scene.set_pins(self.document.pins)

    def _on_job_changed(self) -> None:
        if self.document.job is None and self.document.ready is None:
            self.unread.emit()

    def _on_notice(self, notice: Notice) -> None:
        """Show a notice in the message bar of the window."""
        self.pair.first.notify(replace(notice, text=f"Second mesh: {notice.text}", undo=None))

    def _say_status(self) -> None:
        job, spectrum = self.document.job, self.document.spectrum
        first = self.pair.first.spectrum
        ready = self.document.ready
        name = (ready.mesh.name if ready is not None else "") or "Second mesh"
        text = ""
        if job is not None:
            share = job.progress.fraction
            text = job.job.label + ("" if share is None else f" · {share:.0%}")
        elif self.pair.comparing:
            text = "comparing …"
        elif first is None or not first.complete:
            text = "waits for the eigenpairs of the first: press Compute"
        elif spectrum is not None:
            text = f"{len(spectrum):,} pairs" + (" · complete" if spectrum.complete else "")
        self.status_label.setText(f"{name}  ·  {text}" if text else name)

    def first_waits(self) -> bool:
        """Whether the new field of the first is drawn later, together with that of the second."""
        return self._waits_for(self.field_source)

    def _waits_for(self, other: FieldSource) -> bool:
        """Whether a new field waits for that of the other mesh, with which it shares its limits.

        It waits once only, so that two fields never wait for each other forever.
        """
        self._waiting = not self._waiting and other.comes and self._with_shared_limits() is not None
        return self._waiting

    def _wait_no_longer(self, why: str) -> None:
        """Draw the field without waiting: the other one takes long, or cannot be computed."""
        if why and self._waiting:
            self._waiting = False
            self.show_field()

    def _on_field(self, _field: Field | None) -> None:
        if not self._waits_for(self._first_source):
            self.show_field()

    def _first_shown(self, _field: Field | None) -> None:
        now = self.field_source.field, self.common_limits
        if not self._waiting and (self.pair.carries or now != self._drawn):
            self.show_field()

    @property
    def common_limits(self) -> tuple[float, float] | None:
        """Limits that the colours of both meshes share; None where each has its own."""
        shared = self._with_shared_limits()
        return None if shared is None else shared[1]

    def _with_shared_limits(self) -> tuple[Field, tuple[float, float]] | None:
        first, second = self._first_source.field, self.field_source.field
        carried = self.pair.carries and self.pair.comparison is not None
        if first is None or second is None or carried:
            return None
        return self.pair.with_shared_limits(first, second)

    def show_field(self, _field: Field | None = None) -> None:
        """Draw the field: its own, or that of the first transferred by the match."""
        mesh, display = self.document.mesh, self.document.display
        field, found = self.field_source.field, self.pair.comparison
        shared = self._with_shared_limits()
        first = self._first_source.field
        self._drawn = field, None if shared is None else shared[1]
        self.shown.emit()
        if self.pair.carries and found is not None and first is not None:
            limits, colormap = first.colors(self.pair.first.display)
            field = first.carried(found.back.indices)
        elif field is not None and mesh is not None and len(field.values) == mesh.n_vertices:
            limits, colormap = field.colors(display)
            field, limits = shared or (field, limits)
        else:
            self.scene.set_field(None, (0.0, 1.0), display.sequential_colormap)
            return
        self.scene.set_field(field, limits, colormap)

    # -- from the user ------------------------------------------------------------------------

    def _turned(self) -> None:
        """Copy the camera to the first mesh if the user moved it, else copy that of the first."""
        if self.scene.turned_by_hand:
            self._turn(self._first_scene, self.scene)
        else:
            self._turn_second()

    def _turn_second(self) -> None:
        self._turn(self.scene, self._first_scene)

    def _turn(self, mine: MeshView, other: MeshView) -> None:
        """Copy the camera of one mesh to the other, if cameras are linked."""
        if not self._turning and "camera" in self.pair.links:
            self._turning = True
            mine.look_like(other)
            self._turning = False

    def _step(self, steps: int) -> None:
        """Step the first mesh, which this one follows, or this one if positions are not linked."""
        linked = "position" in self.pair.links
        document = self.pair.first if linked else self.document
        spectrum, shown = document.spectrum, document.display.family
        if spectrum is not None and len(spectrum):
            document.display.put(shown.step(spectrum, steps))

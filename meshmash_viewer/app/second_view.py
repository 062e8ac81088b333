"""The second mesh of a comparison: its render, its tasks, and its links with the first mesh."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from PySide6.QtCore import Signal
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.background import SHOW_IN_FOLDER, BackgroundIO, Jobs
from meshmash_viewer.app.controller import Controller
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column
from meshmash_viewer.app.executor import Slot, is_idle, shutdown
from meshmash_viewer.app.listening import follow, listen, receive
from meshmash_viewer.app.stage import HeadLabel, render_head
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, step
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.model.matching import ComparisonRequest
from meshmash_viewer.model.notices import Notice, failure_of, notice_of
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.units import counted, format_share

if TYPE_CHECKING:
    from meshmash_viewer.app.view.style import ColorMap

#: The field of the second mesh as displayed in the comparison, and the common limits.
_Linked: TypeAlias = tuple[Field, Limits] | None


class SecondView(QWidget):
    """Render of a second mesh, linked with document, render and controller of the first mesh."""

    #: The user has pressed the close button, or the mesh could not be read.
    close_requested = Signal()

    def __init__(self, document: Document, scene: MeshView, controller: Controller) -> None:
        super().__init__()
        theme.named(self, "second_view", "Second mesh")
        self.document = Document(document.history.of("second"))
        self.document.solve.seconds_rate = document.solve.seconds_rate
        self.scene = MeshView(self.document)
        theme.named(self.scene, "second_scene", "Render of the second mesh")
        self.jobs = Jobs(self.document, self)
        self.background_io = BackgroundIO(self.document, self)
        self.controller = Controller(self.document, self.scene, self)
        self.pair = Pair(document, self.document)
        self._first_scene, self._first = scene, controller
        self._turning = False
        #: Value of `Pair.cameras` when a camera was last copied.
        self._cameras = self.pair.cameras
        #: Controller whose field is drawn later, with the field of the other mesh.
        self._waiting: Controller | None = None
        #: Inputs and result of the last computation in `_linked`.
        self._known: tuple[tuple[Any, ...], _Linked] = (), None
        self._comparing = Slot(self, "comparison")
        self._build()
        self._connect()
        self.dress()

    def _build(self) -> None:
        self.status_label = theme.named(HeadLabel(), "second_label", "Second mesh, and its state")
        text = "Close the second mesh"
        self._close = make.icon_button("second_close_button", text, self.close_requested, tip=text)
        self.setLayout(
            column(render_head(self.status_label, self._close), (self.scene,), spacing=0)
        )

    def dress(self) -> None:
        """Use the colours of the current theme."""
        self._close.setIcon(QIcon(theme.pixmap("close", theme.palette().muted, 12)))
        self.scene.set_theme(theme.is_dark())

    def _connect(self) -> None:
        document, pair = self.document, self.pair
        receive(pair.comparison_requested, self._compare)
        self._first.link = self.controller.link = self
        listen(document.mesh_changed, self._turn_second)
        follow((document.work.changed, document.spectrum_changed, pair.changed), self._say_status)
        listen(pair.changed, self._draw)
        listen(pair.changed, self._follow_cameras)
        receive(document.notices.shown, self._on_notice)
        follow(document.work.changed, self._on_job_changed)  # deferred, after the notice is shown
        self.scene.vertex_clicked.connect(document.pins.toggle)
        self.scene.click_revoked.connect(document.history.revoke)
        self.scene.cut_handle.moved = pair.cut_second
        self.scene.stepped.connect(self._step)
        self.scene.camera_changed.connect(self._turned)
        self._first_scene.camera_changed.connect(self._turn_second)

    @property
    def idle(self) -> bool:
        """Whether nothing is being read or computed for the second mesh."""
        return (
            self.document.work.job is None
            and self.controller.idle
            and not self.pair.comparing
            and is_idle(self)
        )

    def shut(self) -> None:
        """Stop all tasks, and remove the links; the view cannot be used again."""
        self._first.link = None
        self._first.draw()
        self.pair.close()
        self._first_scene.camera_changed.disconnect(self._turn_second)
        shutdown(self)

    # -- changes of the documents -------------------------------------------------------------

    def _compare(self, request: ComparisonRequest) -> None:
        def fail(fault: Exception) -> None:
            self.pair.give_up(request)
            self._on_notice(notice_of(failure_of(fault, "Comparing")))

        self._comparing.submit(
            lambda call: request.answered(call.cancelled), partial(self.pair.accept, request), fail
        )

    def _on_job_changed(self) -> None:
        if self.document.work.job is None and self.document.ready is None:
            self.close_requested.emit()

    def _on_notice(self, notice: Notice | None) -> None:
        """Show a notice of the second document; for None, review the displayed notice."""
        if notice is None:
            self.pair.first.notices.review()
        else:
            text = f"Second mesh: {notice.text}"
            action = notice.action if notice.button == SHOW_IN_FOLDER else None
            self.pair.first.notices.show(replace(notice, text=text, action=action))

    def _say_status(self) -> None:
        job, spectrum = self.document.work.job, self.document.spectrum
        first = self.pair.first.spectrum
        ready = self.document.ready
        name = (ready.mesh.name if ready is not None else "") or "Second mesh"
        text = ""
        if job is not None:
            share = job.progress.fraction
            text = job.label + ("" if share is None else f" · {format_share(round(share, 2))}")
        elif self.pair.comparing:
            text = "comparing …"
        elif first is None or not first.complete:
            text = "waits for the eigenpairs of the first: press Compute"
        elif spectrum is not None:
            text = counted(len(spectrum), "pair") + (" · complete" if spectrum.complete else "")
        self.status_label.setText(f"{name}  ·  {text}" if text else name)

    # -- drawing ------------------------------------------------------------------------------

    def draw(self, source: Controller) -> None:
        """Draw the fields of both meshes after the field of `source` has changed.

        Fields with common limits are drawn together, once both are computed. A field is drawn alone
        if the other field takes long.
        """
        other = self.controller if source is self._first else self._first
        waits = self._waiting is None and other.comes and not other.late
        self._waiting = source if waits and self._linked() is not None else None
        if self._waiting is None:
            self._draw()

    def _draw(self) -> None:
        self._first.draw()
        self.controller.draw()

    def adapted(
        self, source: Controller, field: Field, limits: Limits, colormap: ColorMap
    ) -> tuple[Field, Limits, ColorMap]:
        """Return field, limits and colour map of `source` as displayed in the comparison."""
        linked, first = self._linked(), self._first.field
        if linked is None:
            return field, limits, colormap
        if source is self._first:
            return field, linked[1], colormap
        if self.pair.carries and first is not None:
            colormap = first.colors(self.pair.first.display)[1]
        return linked[0], linked[1], colormap

    def _linked(self) -> _Linked:
        """Return `Pair.shown_field` of the last fields, computed again if an input has changed."""
        first, second = self._first.field, self.controller.field
        if first is None or second is None:
            return None
        pair = self.pair
        display = pair.first.display
        scales = display.policies, display.log_scales
        state = first, second, pair.links, *scales, pair.carries, pair.comparison
        if state != self._known[0]:
            self._known = state, pair.shown_field(first, second)
        return self._known[1]

    # -- actions of the user ------------------------------------------------------------------

    def _turned(self) -> None:
        """Copy this camera to the first mesh if the user moved it, else the first mesh's camera."""
        if self.scene.turned_by_hand:
            self._turn(self._first_scene, self.scene)
        else:
            self._turn_second()

    def _turn_second(self) -> None:
        self._turn(self.scene, self._first_scene)

    def _follow_cameras(self) -> None:
        """Copy the camera of the first mesh if `Pair.cameras` has changed."""
        if self.pair.cameras != self._cameras:
            self._turn_second()

    def _turn(self, mine: MeshView, other: MeshView) -> None:
        """Copy the camera of `other` to `mine`, if cameras are linked."""
        self._cameras = self.pair.cameras
        if not self._turning and self._cameras != "free":
            self._turning = True
            mine.look_like(other, mirrored=self._cameras == "mirror")
            self._turning = False

    def _step(self, steps: int) -> None:
        """Step through fields of the first mesh, or of the second if positions are not linked."""
        linked = "position" in self.pair.links
        step(self.pair.first if linked else self.document, steps)

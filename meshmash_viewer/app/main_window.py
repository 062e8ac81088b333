"""The main window: its docks, and the connections between its parts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QChildEvent, QEvent, QPoint, Qt, Signal
from PySide6.QtGui import (
    QCloseEvent,
    QDragEnterEvent,
    QDragLeaveEvent,
    QDragMoveEvent,
    QDropEvent,
    QGuiApplication,
    QKeyEvent,
    QResizeEvent,
)
from PySide6.QtWidgets import (
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QMenu,
    QTabBar,
    QToolBar,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import Actions
from meshmash_viewer.app.arrangement import Arrangement, HoverLabel, StatusProgress
from meshmash_viewer.app.background import BackgroundIO, Jobs
from meshmash_viewer.app.commands import Commands
from meshmash_viewer.app.controls.field_events import FieldWheel, FocusKeys
from meshmash_viewer.app.executor import shutdown
from meshmash_viewer.app.listening import follow, later, listen, receive
from meshmash_viewer.app.opening import Opening
from meshmash_viewer.app.panels.label_table import given_to_label
from meshmash_viewer.app.panels.mesh_panel import MeshPanel
from meshmash_viewer.app.pin_commands import close_menus
from meshmash_viewer.app.scripted_window import ScriptedWindow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.app.stage import DropAreas, Stage
from meshmash_viewer.io.links import is_link, link_file, name_and_place, parse_link, shown_path
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, step
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pins import pin_at
from meshmash_viewer.plug_ins import known_plug_ins

if TYPE_CHECKING:
    from meshmash_viewer.app.shape_source import DrawnShape
    from meshmash_viewer.model.pair import Pair

#: Widgets that lose the focus on Return, so that keys trigger commands again.
_FIELDS = (QLineEdit, QAbstractSpinBox, QComboBox, QAbstractSlider, QTabBar)


class MainWindow(ScriptedWindow):
    """Main window, which displays one document.

    With `fresh`, stored settings are ignored. With `deferred`, render and plots are made by a later
    call of `load`, so that the window can be shown before VTK and the plot library are imported.
    """

    #: The window has been closed, and its tasks have ended. It cannot be shown again.
    closed = Signal()
    #: Whether render and panels exist. A class attribute because Qt sends events during `__init__`.
    loaded = False

    def __init__(
        self, document: Document | None = None, fresh: bool = False, *, deferred: bool = False
    ) -> None:
        super().__init__()
        self.setObjectName("main_window")
        self.setWindowTitle("MeshMash Viewer")
        self.setWindowIcon(theme.application_icon())
        self.setAcceptDrops(True)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
        self.document = document or Document()
        self.settings = Settings(fresh)
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        theme.set_mode(self.settings.theme)
        theme.style_window(self)
        self._focus_keys = FocusKeys(application, self)
        self._field_wheel = FieldWheel(self)
        self._refusal = ""

        self._opened: Path | None = None
        self._closed = False
        #: Whether the last drawn field is signed; None without a field.
        self._signed: bool | None = None
        self.stage = Stage()
        self.setCentralWidget(self.stage)
        self.drop_areas = DropAreas(self)
        self.mesh_panel = MeshPanel(self.document)
        self.document.solve.seconds_rate = self.settings.seconds_rate
        self.actions_ = Actions(self)
        self.menus = self.actions_.fill_menus(self)
        self._recent_menu = QMenu("Recent meshes", self)
        self.menus["File"].insertMenu(self.actions_["open_session"], self._recent_menu)
        self._build_toolbar()
        self.arrangement = Arrangement(self)
        self.arrangement.put("mesh", self.mesh_panel)
        for dock in self.arrangement.docks.values():
            self.menus["View"].insertAction(self.actions_["reset_camera"], dock.toggleViewAction())
        self._build_status_bar()
        self.jobs = Jobs(self.document, self)
        self.background_io = BackgroundIO(self.document, self)
        self.opening = Opening(self, self.document, self.settings, self.stage)
        self.opening.pair_changed.connect(self._on_pair_changed)
        self.commands = Commands(self.opening, self.actions_, self.arrangement, self.background_io)
        welcome = self.stage.welcome
        welcome.open_requested.connect(self.opening.open_mesh)
        welcome.sample_requested.connect(self.opening.open_sample)
        welcome.recent_requested.connect(self.opening.open_path)
        self._listen_to_document()
        theme.notifier().changed.connect(self._on_theme_changed)
        theme.pad_fields(self)
        self._field_wheel.watch(self)
        self._place()
        self._on_mesh_changed()
        self._show_stage()
        self.commands.refresh()
        # focus the stage, not a button, so that keys trigger commands from the start
        self.stage.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self.stage.setFocus()
        if not deferred:
            self.load()

    # -- building -----------------------------------------------------------------------------

    def _build_toolbar(self) -> None:
        self.toolbar = theme.named(QToolBar("Toolbar", self), "toolbar")
        self.toolbar.setMovable(False)
        self.toolbar.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.toolbar.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.actions_.fill_toolbar(self.toolbar)
        self.addToolBar(self.toolbar)

    def _build_status_bar(self) -> None:
        self.hover_label = HoverLabel(self.document)
        self.statusBar().setSizeGripEnabled(False)
        self.statusBar().addPermanentWidget(self.hover_label, 1)
        self.status_progress = StatusProgress(self.document, self.arrangement.docks["mesh"])
        self.statusBar().addPermanentWidget(self.status_progress, 1)

    def _place(self) -> None:
        """Restore the stored size and layout, or set the default size and layout."""
        screen = QGuiApplication.primaryScreen().availableGeometry()
        self.resize(min(1440, screen.width() - 40), min(900, screen.height() - 60))
        self.arrangement.share_room()
        layout = self.settings.layout
        if layout is not None:
            self.arrangement.restore(layout)

    def load(self) -> None:
        """Make the render and the panels, after importing their libraries."""
        if self.loaded or self._closed:
            return
        from meshmash_viewer.app.controller import Controller
        from meshmash_viewer.app.cutting import Cutting
        from meshmash_viewer.app.label_marks import LabelMarks
        from meshmash_viewer.app.panels.field_panel import FieldPanel
        from meshmash_viewer.app.panels.label_panel import LabelPanel
        from meshmash_viewer.app.panels.pair_panel import PairPanel
        from meshmash_viewer.app.panels.profile_panel import ProfilePanel
        from meshmash_viewer.app.panels.select_bar import SelectBar
        from meshmash_viewer.app.panels.shape_panel import ShapePanel
        from meshmash_viewer.app.panels.spectrum_panel import SpectrumPanel
        from meshmash_viewer.app.point_tool import PointTool
        from meshmash_viewer.app.select_tool import SelectTool
        from meshmash_viewer.app.shape_source import ShapeSource
        from meshmash_viewer.app.view.mesh_view import MeshView

        self.scene = MeshView(self.document, self.stage)
        self.stage.set_scene(self.scene)
        self.opening.scene = self.scene
        self.field_panel = FieldPanel(self.document)
        self.spectrum_panel = SpectrumPanel(self.document)
        self.profile_panel = ProfilePanel(self.document)
        self.shape_panel = ShapePanel(self.document)
        self.pair_panel = PairPanel(self.document)
        self.label_panel = LabelPanel(self.document)
        for name in ("field", "spectrum", "profile", "shape", "pair", "label"):
            self.arrangement.put(name, getattr(self, f"{name}_panel"))
        self.controller = self.opening.controller = Controller(self.document, self.scene, self)
        self.controller.drawn.connect(self._on_drawn)
        self.label_marks = LabelMarks(self.document, self.scene, self)
        self.label_marks.measured.connect(self.label_panel.table.show_sizes)
        self.select_tool = SelectTool(self.document, self.scene, self.controller, self)
        self.commands.select_tool = self.select_tool
        self.commands.cutting = Cutting(self.document, self.scene)
        self.point_tool = PointTool(self.opening, self.scene, self.background_io)
        self.commands.point_tool = self.point_tool
        self.opening.points_requested.connect(self.point_tool.open_dropped)
        self.scene.point_hovered.connect(self.hover_label.show_point)
        points = self.label_panel.points
        points.open_requested.connect(self.point_tool.open_points)
        points.remove_requested.connect(self.point_tool.remove_points)
        self.select_tool.changed.connect(self._refresh_actions)
        self.select_tool.changed.connect(
            lambda: setattr(self.hover_label, "clicks_pin", not self.select_tool.strokes)
        )
        self.select_bar = SelectBar(self.document, self.select_tool, self.actions_)
        self.addToolBarBreak()
        self.addToolBar(self.select_bar)
        theme.pad_fields(self)
        self._field_wheel.watch(self)
        self.shape_source = ShapeSource(self.document, self)
        self.shape_source.shape_ready.connect(self._show_shape)
        self.shape_panel.save_requested.connect(self.commands.save_shape)
        self.mesh_panel.health.scene = self.label_panel.scene = self.scene
        for panel in (self.label_panel, self.pair_panel):
            panel.write_requested.connect(self.commands.write)
        self.pair_panel.open_requested.connect(self.opening.compare_with)
        self.pair_panel.close_requested.connect(self.opening.end_comparison)
        self.pair_panel.save_requested.connect(self.commands.save_match)
        self.pair_panel.keep_requested.connect(self.commands.keep_match)
        self.pair_panel.maps_requested.connect(self.opening.add_map_to_second)
        self.pair_panel.export_requested.connect(self.commands.export_second)
        self.scene.camera_changed.connect(self.opening.last_session.changed)
        self.scene.vertex_clicked.connect(self.document.pins.toggle)
        self.scene.click_revoked.connect(self.document.history.revoke)
        self.scene.vertex_hovered.connect(self.hover_label.show_vertex)
        self.scene.vertex_hovered.connect(self._point_at_pin)
        self.commands.pins.connect(self.scene, self.profile_panel)
        self.scene.stepped.connect(partial(step, self.document))
        self.loaded = True
        self.stage.welcome.set_loading("")
        if self.settings.layout is None:
            self.arrangement.share_room()
        self.scene.set_theme(theme.is_dark())
        self.controller.show_mesh()
        self.shape_source.refresh()
        self._show_stage()
        self.commands.refresh()
        self.controller.refresh()
        self.opening.look()
        for each in known_plug_ins():
            if each.fault:
                self.document.notices.say(str(each.fault), Severity.WARNING)

    # -- wiring -------------------------------------------------------------------------------

    def _listen_to_document(self) -> None:
        document = self.document
        listen(document.mesh_changed, self._on_mesh_changed)
        listen(document.work.changed, self._on_job_changed)
        receive(document.notices.shown, self.stage.message_bar.show_notice)
        events = document.display.events
        needs = (
            document.mesh_changed, document.spectrum_changed, document.solve.changed,
            document.history.changed, document.pins.changed, document.work.changed,
            events.nodal_lines, events.label_borders, events.label_graph, events.cut,
            events.playing, events.kind,
            document.selection.changed, document.hiding.changed,
        )  # fmt: skip
        follow(needs, self._refresh_actions)
        follow(document.mesh_changed, self._show_stage)

    def open_mesh(self, path: str | Path, unit: str = "", maps: Sequence[Path] = ()) -> None:
        """Read a mesh file, or a link with a segment, restore its session, and add maps from files.

        An empty `unit` stands for the unit of the session. If reading fails, the previous mesh
        stays open.
        """
        path = link_file(parse_link(path)) if is_link(path) else Path(path)
        self.opening.read(path, unit, maps)

    def _on_mesh_changed(self) -> None:
        close_menus()
        ready = self.document.ready
        name = f"{ready.mesh.name or 'Mesh in memory'} – " if ready else ""
        self.setWindowTitle(f"{name}MeshMash Viewer")
        if ready is not None and not ready.derived:
            if ready.path != self._opened:  # a change of the unit does not raise the panel
                self.arrangement.docks["mesh"].raise_()
            self._opened = ready.path
            if ready.path is not None:
                self.settings.add_recent(ready.path)
        self.hover_label.show_vertex(-1)

    def _show_stage(self) -> None:
        """Show the render or the welcome page, and update the recent meshes."""
        self.stage.show_scene(self.loaded and self.document.ready is not None)
        recent = self.settings.recent
        self.stage.welcome.set_recent(recent)
        self._recent_menu.clear()
        self._recent_menu.setEnabled(bool(recent))
        for path in recent:
            action = self._recent_menu.addAction(name_and_place(path)[0])
            action.setToolTip(shown_path(path))
            action.triggered.connect(lambda _checked=False, path=path: self.opening.open_path(path))

    def _on_drawn(self, field: Field | None, limits: Limits) -> None:
        """Pass the drawn field to the panels and to the source of vibrating shapes."""
        self.hover_label.field = field
        self.field_panel.set_field(field, limits)
        self.profile_panel.table.set_field(field)
        self.shape_source.set_field(field)
        self.shape_panel.set_field(field)
        self.label_panel.field = field
        if field is not None:
            self.spectrum_panel.follow_field()
        signed = None if field is None else field.signed
        if signed is not self._signed:
            self._signed = signed
            later(self._refresh_actions)
        later(self._clear_title)

    def _show_shape(self, drawn: DrawnShape) -> None:
        document = self.document
        if document.is_shown(self.scene.mesh) and document.is_solved(drawn.spectrum.mesh):
            self.scene.set_shape(drawn.points, drawn.normals, rests=drawn.rests, text=drawn.text)
            self.shape_panel.show_shape(drawn)

    def _on_pair_changed(self, pair: Pair | None) -> None:
        close_menus()
        self.pair_panel.set_pair(pair)
        self._field_wheel.watch(self.pair_panel)
        if self.pair_panel.health is not None and self.opening.second_view is not None:
            self.pair_panel.health.scene = self.opening.second_view.scene
        self.commands.refresh()
        second = self.opening.second_view
        self.select_tool.set_second(None if second is None else second.scene)
        if second is not None:
            second.document.mesh_changed.connect(close_menus)
            second.scene.menu_requested.connect(
                partial(self.commands.pins.show_second_menu, second)
            )
        self.arrangement.set_comparing(pair is not None)

    def _clear_title(self) -> None:
        self.stage.message_bar.keep_clear(self.scene.title_size, self.scene.bar_width)

    def _point_at_pin(self, vertex: int) -> None:
        """Highlight the profile of the pin under the pointer, if any."""
        pinned = pin_at(self.document.pins.placed, vertex) is not None
        self.profile_panel.point_at(vertex if pinned else -1)

    def _on_job_changed(self) -> None:
        """Store the speed of the solver, and update the welcome page."""
        state = self.document.work.job
        if state is None and self.document.solve.seconds_rate is not None:
            self.settings.seconds_rate = self.document.solve.seconds_rate
        if self.document.mesh is None:  # otherwise the render replaces the welcome page soon
            self.stage.welcome.set_reading("" if state is None else f"{state.label} …")

    def _refresh_actions(self) -> None:
        self.commands.refresh()

    def _on_theme_changed(self) -> None:
        self.actions_.refresh_icons()
        if self.loaded:
            self.scene.set_theme(theme.is_dark())
            if self.opening.second_view is not None:
                self.opening.second_view.dress()

    def say_refusal(self, sentence: str) -> None:
        """Show why an input field rejects its text, or remove the message for ""."""
        notice = self.stage.message_bar.notice
        if sentence:
            self._refusal = sentence
            self.document.notices.say(sentence, Severity.WARNING)
        elif notice is not None and notice.text == self._refusal:
            self.stage.message_bar.dismiss()

    # -- events -------------------------------------------------------------------------------

    def event(self, event: QEvent) -> bool:
        """Assign the selection to a label if a digit key is pressed while the Select tool is on."""
        labels = self.document.labels if self.loaded and self.select_tool.on else None
        taken = labels is not None and labels.current is not None and given_to_label(event, labels)
        return taken or super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move the focus from an input field to the render on Return; leave full screen on Escape.

        The window receives Return only if the field has accepted its text, and Escape only if
        there is nothing to cancel.
        """
        field = QApplication.focusWidget()
        if isinstance(field, _FIELDS) and event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.activateWindow()  # the field may be in a floating dock
            self.stage.setFocus()
        elif event.key() == Qt.Key.Key_Escape and self.isFullScreen():
            self.showNormal()
        else:
            super().keyPressEvent(event)

    def childEvent(self, event: QChildEvent) -> None:
        """Install the wheel filter on the tab bars that Qt makes for tabbed docks."""
        super().childEvent(event)
        if event.polished() and isinstance(child := event.child(), QTabBar):
            self._field_wheel.watch(child)

    def changeEvent(self, event: QEvent) -> None:
        """Update the *Full screen* action: on macOS, a button of the window has the same effect."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.WindowStateChange:
            self.actions_["full_screen"].setChecked(self.isFullScreen())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Adapt docks and toolbar to the width of the window."""
        super().resizeEvent(event)
        self.arrangement.fit()
        self.actions_.fit_toolbar(self.toolbar, self.width())

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if self._show_drop(event):
            event.acceptProposedAction()

    def dragMoveEvent(self, event: QDragMoveEvent) -> None:
        self.drop_areas.point_at(event.position().toPoint())
        event.acceptProposedAction()

    def dragLeaveEvent(self, event: QDragLeaveEvent) -> None:
        self.drop_areas.hide()

    def dropEvent(self, event: QDropEvent) -> None:
        """Open the dropped files, see `Opening.open_paths`."""
        if paths := self._show_drop(event):
            event.acceptProposedAction()
            second = self.drop_areas.point_at(event.position().toPoint()) == 1
            self.opening.open_paths(paths, as_second=second)
        self.drop_areas.hide()

    def _show_drop(self, event: QDropEvent) -> list[Path]:
        """Show the drop areas for the files of an event; return the files."""
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        if paths:
            second = self.opening.second_view
            half = QPoint(self.stage.width() // 2, 0)
            middle = (
                self.stage.mapTo(self, half) if second is None else second.mapTo(self, QPoint())
            )
            self.drop_areas.show_texts(self.opening.drop_texts(paths), middle.x())
            self.drop_areas.point_at(event.position().toPoint())
        return paths

    def closeEvent(self, event: QCloseEvent) -> None:
        """Store the settings, stop all tasks, and delete temporary files."""
        if not self._closed:
            self._closed = True
            self.settings.layout = self.arrangement.save()
            self.opening.last_session.save()
            self.settings.close()
            self.document.display.playing = False
            self.document.display.vibrating = False
            self.opening.end_comparison()
            theme.notifier().changed.disconnect(self._on_theme_changed)
            self._focus_keys.stop()
            shutdown(self)
            self.closed.emit()
        super().closeEvent(event)

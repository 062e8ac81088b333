"""Docks of the panels, and contents of the status bar."""

from __future__ import annotations

import math

from PySide6.QtCore import QByteArray, Qt
from PySide6.QtGui import QIcon, QKeyEvent, QMouseEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QLabel,
    QMainWindow,
    QProgressBar,
    QSizePolicy,
    QTabWidget,
    QToolBar,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import row
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.pins import pin_at
from meshmash_viewer.spectral.cost import written_duration
from meshmash_viewer.units import NO_BREAK, counted, format_number

_VERSION = 4
#: Minimum width of the Field panel, which has four tabs, in logical pixels.
_FIELD_WIDTH = 316
#: Minimum width of a plot.
_PLOT_WIDTH = 130
#: Width of the window below which the two plots are tabs of one dock area.
_NARROW = 1240
#: Window widths below which Field is a tab of the left area, for one render and for two.
_NARROW_ONE, _NARROW_PAIR = 1000, 1100
#: Panels that are tabs of the left area.
_LEFT = ("mesh", "shape", "pair", "label")
_BOTTOM = Qt.DockWidgetArea.BottomDockWidgetArea


class _Title(QWidget):
    """Title bar that ignores double clicks, which would make the dock float without a frame."""

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        event.accept()


class Dock(QDockWidget):
    """Dock of a panel, named ``<name>_dock``, that can be moved, floated and closed."""

    def __init__(self, name: str, title: str, window: QMainWindow) -> None:
        super().__init__(title, window)
        theme.named(self, f"{name}_dock", title)
        self.setWidget(QWidget())
        bar = theme.named(_Title(), "dock_title")
        bar.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        hide = f"Hide {title}"
        self._close = make.icon_button(f"{name}_dock_close", hide, self.close, tip=hide)
        self._close.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # like the buttons of Qt's own docks
        bar.setLayout(row((QLabel(title),), self._close, margins=(theme.MARGIN, 4, 6, 4)))
        self.setTitleBarWidget(bar)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass unhandled keys to the window; Qt does not do so for a floating dock."""
        super().keyPressEvent(event)
        window = self.parentWidget()
        if self.isFloating() and window is not None:
            QApplication.sendEvent(window, event)

    def _refresh(self) -> None:
        self._close.setIcon(QIcon(theme.pixmap("close", theme.palette().muted, 12)))


class Arrangement:
    """The docks: Mesh, Shape, Compare and Labels at the left, Field at the right, plots below."""

    def __init__(self, window: QMainWindow) -> None:
        self._window = window
        #: Whether the plots are tabs, two meshes are compared, and Field is a tab at the left.
        self._narrow = self._comparing = self._field_aside = False
        window.setDockNestingEnabled(True)
        areas = Qt.DockWidgetArea
        for area in (_BOTTOM, areas.LeftDockWidgetArea):
            window.setTabPosition(area, QTabWidget.TabPosition.North)
        window.setCorner(Qt.Corner.BottomLeftCorner, areas.LeftDockWidgetArea)
        window.setCorner(Qt.Corner.BottomRightCorner, areas.RightDockWidgetArea)
        self.docks: dict[str, Dock] = {}
        for name, title, area in (
            ("mesh", "Mesh", areas.LeftDockWidgetArea),
            ("shape", "Shape", areas.LeftDockWidgetArea),
            ("pair", "Compare", areas.LeftDockWidgetArea),
            ("label", "Labels", areas.LeftDockWidgetArea),
            ("field", "Field", areas.RightDockWidgetArea),
            ("spectrum", "Spectrum", _BOTTOM),
            ("profile", "Profiles", _BOTTOM),
        ):
            self.docks[name] = Dock(name, title, window)
            window.addDockWidget(area, self.docks[name])
        window.splitDockWidget(
            self.docks["spectrum"], self.docks["profile"], Qt.Orientation.Horizontal
        )
        for name in _LEFT[1:]:
            window.tabifyDockWidget(self.docks[_LEFT[0]], self.docks[name])
        for name in _LEFT:  # disable panels of hidden tabs, so that the Tab key skips them
            self.docks[name].visibilityChanged.connect(
                lambda shown, dock=self.docks[name]: dock.widget().setEnabled(shown)
            )
        self.docks["mesh"].raise_()
        self._first = window.saveState(_VERSION)

    def put(self, name: str, panel: QWidget) -> None:
        panel.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        if name == "field":
            panel.setMinimumWidth(_FIELD_WIDTH)
        elif name not in _LEFT:
            panel.setMinimumWidth(_PLOT_WIDTH)
        placeholder = self.docks[name].widget()
        self.docks[name].setWidget(panel)
        panel.setEnabled(placeholder.isEnabled())
        placeholder.deleteLater()

    def reset(self) -> None:
        self._window.restoreState(self._first, _VERSION)
        # toolbars added after the state was saved would share the line of the first toolbar
        directly = Qt.FindChildOption.FindDirectChildrenOnly
        for bar in self._window.findChildren(QToolBar, options=directly)[1:]:
            self._window.insertToolBarBreak(bar)
        self._narrow = self._field_aside = False
        self.share_room()

    def share_room(self) -> None:
        """Resize the docks to their default sizes.

        Unlike `reset`, this method does not call `restoreState`, which makes new tab bars.
        """
        self.fit()
        sides = [self.docks["mesh"], self.docks["field"]]
        self._window.resizeDocks(sides, [290, 330], Qt.Orientation.Horizontal)
        below = [self.docks["spectrum"], self.docks["profile"]]
        self._window.resizeDocks(below, [230, 230], Qt.Orientation.Vertical)
        self._window.resizeDocks(below, [400, 400], Qt.Orientation.Horizontal)

    def fit(self, *, narrow: bool = True) -> None:
        """Arrange the docks for the width of the window; unless `narrow`, as for a wide one."""
        self._fit_field(narrow=narrow)
        window = self._window
        narrow = narrow and window.width() < _NARROW
        spectrum, profile = self.docks["spectrum"], self.docks["profile"]
        if narrow == self._narrow or any(
            dock.isFloating() or dock.isHidden() or window.dockWidgetArea(dock) != _BOTTOM
            for dock in (spectrum, profile)
        ):
            return
        self._narrow = narrow
        if narrow:
            window.tabifyDockWidget(spectrum, profile)
            spectrum.raise_()
        else:
            # Qt cannot split a tab off: remove the dock, and add it again
            window.removeDockWidget(profile)
            window.addDockWidget(_BOTTOM, profile)
            window.splitDockWidget(spectrum, profile, Qt.Orientation.Horizontal)
            profile.show()
            window.resizeDocks([spectrum, profile], [400, 400], Qt.Orientation.Horizontal)

    def set_comparing(self, comparing: bool) -> None:
        """Adapt the docks to two renders, or to a single render."""
        self._comparing = comparing
        self._fit_field()
        if comparing:
            self.docks["pair"].show()
            self.docks["pair"].raise_()

    def show_field(self) -> None:
        """Raise Field if it is a tab of the left area."""
        if self._field_aside:
            self.docks["field"].raise_()

    def _fit_field(self, *, narrow: bool = True) -> None:
        """Move Field to the left area in a narrow window, and back to the right in a wide one."""
        window, field = self._window, self.docks["field"]
        aside = narrow and window.width() < (_NARROW_PAIR if self._comparing else _NARROW_ONE)
        if aside == self._field_aside or field.isFloating() or field.isHidden():
            return
        left = [self.docks[name] for name in _LEFT]
        left = [dock for dock in left if not (dock.isHidden() or dock.isFloating())]
        there = left[-1] if left else None
        front = next((dock for dock in left if dock.widget().isEnabled()), None)
        if aside and there is None:
            return
        self._field_aside = aside
        if aside and there is not None:
            window.tabifyDockWidget(there, field)
        else:
            window.removeDockWidget(field)
            window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, field)
            field.show()
            window.resizeDocks([field], [330], Qt.Orientation.Horizontal)
        (front or self.docks["pair" if self._comparing else "mesh"]).raise_()

    def save(self) -> tuple[QByteArray, QByteArray]:
        """Return geometry and state of the docks, without what a narrow window has changed."""
        geometry = self._window.saveGeometry()
        self.fit(narrow=False)
        return geometry, self._window.saveState(_VERSION)

    def restore(self, layout: tuple[QByteArray, QByteArray]) -> None:
        self._window.restoreGeometry(layout[0])
        self._window.restoreState(layout[1], _VERSION)
        self._narrow = self._field_aside = False
        self.fit()


class HoverLabel(QLabel):
    """Label with index, value and position of the vertex under the pointer, or the mesh size."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "hover_label", "Vertex under the pointer")
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._document = document
        self._vertex = self._point = -1
        #: The drawn field.
        self.field: Field | None = None
        #: Whether a click pins the vertex.
        self.clicks_pin = True
        follow(document.pins.changed, self._refresh)

    def show_vertex(self, vertex: int) -> None:
        """Describe a vertex, or the mesh for -1."""
        self._vertex = vertex
        self._refresh()

    def show_point(self, point: int) -> None:
        """Describe a point of the table before the vertex, or no point for -1."""
        self._point = point
        self._refresh()

    def _of_point(self) -> list[str]:
        """Return the description of the point under the pointer, and its value in the column."""
        points = self._document.points
        if points.projected is None or points.shown is None or self._point < 0:
            return []
        values = points.shown.table.columns.get(points.shown.column)
        parts = [points.projected.describe(self._point)]
        if values is not None:
            value = values[self._point]
            written = format_number(float(value)) if isinstance(value, float) else str(value)
            parts.append(f"{points.shown.column} {written}")
        return parts

    def _refresh(self) -> None:
        ready, field, vertex = self._document.ready, self.field, self._vertex
        if ready is None:
            parts = []
        elif not 0 <= vertex < ready.mesh.n_vertices:  # none, or a vertex of the previous mesh
            health, unit = ready.health, ready.mesh.unit or "no unit"
            parts = [counted(health.n_vertices, "vertex"), counted(health.n_faces, "face"), unit]
        else:
            mesh, pin = ready.mesh, pin_at(self._document.pins.placed, vertex)
            parts = [*self._of_point(), mesh.named_vertex(vertex).capitalize()]
            if field is not None and vertex < len(field.values):
                named = field.labels or not math.isfinite(field.values[vertex])
                value = field.value_text(vertex)
                parts.append(value if named else f"value {value}")
            # in the unit of the file, as *Go to vertex or position* expects
            place = ", ".join(format_number(x, 6) for x in mesh.vertices[vertex])
            parts.append(f"at ({place}){NO_BREAK}{mesh.unit}".rstrip())
            if self.clicks_pin:
                text = f"click to unpin {pin.title}; a drag moves it" if pin else "click to pin"
                parts.append(text)
        self.setText("  ·  ".join(parts))


_STEPS = 1000


def progress_text(state: Job) -> str:
    """Return the stage of a job and its remaining time."""
    progress = state.progress
    what = "Stopping" if state.cancelling else progress.message or progress.stage
    parts = [what[:1].upper() + what[1:] if what else state.label]
    if progress.remaining is not None and not state.cancelling:
        parts.append(f"{written_duration(progress.remaining)} left")
    return " · ".join(parts)


def show_progress(bar: QProgressBar, state: Job) -> None:
    """Show the completed fraction of a job; the bar's maximum is 0 if the fraction is unknown."""
    fraction = state.progress.fraction
    bar.setMaximum(0 if fraction is None else _STEPS)
    if fraction is not None:
        bar.setValue(round(_STEPS * min(max(fraction, 0.0), 1.0)))


class StatusProgress(QWidget):
    """Progress of the running job in the status bar, shown while the panel in `dock` is hidden."""

    def __init__(self, document: Document, dock: QDockWidget) -> None:
        super().__init__()
        theme.named(self, "status_progress", "Progress of the running task")
        self._document = document
        self._panel_shown = not dock.isHidden()
        self.label = QLabel()
        self.label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.bar = QProgressBar(textVisible=False, minimum=0, maximum=_STEPS)
        theme.named(self.bar, "status_progress_bar", "Progress").setFixedWidth(96)
        self.cancel_button = make.button(
            "Cancel",
            "status_cancel_button",
            "Cancel the running task",
            document.work.cancel,
            role="link",
        )
        margins = theme.MARGIN, 0, theme.GAP, 0
        self.setLayout(row((self.label,), self.bar, self.cancel_button, margins=margins))
        dock.visibilityChanged.connect(self._follow_panel)
        follow(document.work.changed, self._refresh)
        self._refresh()

    def _follow_panel(self, shown: bool) -> None:
        self._panel_shown = shown
        self._refresh()

    def _refresh(self) -> None:
        state = self._document.work.job
        self.setVisible(state is not None and not self._panel_shown)
        if state is not None:
            text = progress_text(state)
            self.label.setText(text)
            self.label.setToolTip(text)
            show_progress(self.bar, state)
            self.cancel_button.setEnabled(not state.cancelling)

"""Layout of the panels of the window."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QByteArray, Qt
from PySide6.QtGui import QIcon, QKeyEvent, QMouseEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QLabel,
    QMainWindow,
    QTabWidget,
    QToolBar,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.make import row

_VERSION = 4
#: Width of the four tabs of the Field panel, in logical pixels.
_FIELD_WIDTH = 316
#: Least width of two plots side by side; below it they are tabs. Less than that of the render.
_PLOT_WIDTH = 130
#: Below this width of the window the two plots share one place, as tabs.
_NARROW = 1240
#: Below these widths Field shares the place of the left panels, which leaves room for a render,
#: and for two where meshes are compared.
_NARROW_ONE, _NARROW_PAIR = 1000, 1100
#: Panels that share one place, as tabs.
_LEFT = ("mesh", "shape", "pair", "label")
_BOTTOM = Qt.DockWidgetArea.BottomDockWidgetArea


class _Title(QWidget):
    """A title bar that ignores double clicks, which would let the panel float without a frame."""

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        event.accept()


class Dock(QDockWidget):
    """A panel ``<name>_dock`` that can be moved, dragged out by its title, and closed."""

    def __init__(self, name: str, title: str, window: QMainWindow) -> None:
        super().__init__(title, window)
        theme.named(self, f"{name}_dock", title)
        self.setWidget(QWidget())
        bar = theme.named(_Title(), "dock_title")
        bar.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        hide = f"Hide {title}"
        self._close = make.icon_button(f"{name}_dock_close", hide, self.close, tip=hide)
        self._close.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # as Qt's own; keys go by the View menu
        bar.setLayout(row((QLabel(title),), self._close, margins=(theme.MARGIN, 4, 6, 4)))
        self.setTitleBarWidget(bar)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass on what its panel has no use for, to the window it floats over, too."""
        super().keyPressEvent(event)
        window = self.parentWidget()
        if self.isFloating() and window is not None:
            QApplication.sendEvent(window, event)

    def _refresh(self) -> None:
        self._close.setIcon(QIcon(icons.pixmap("close", theme.palette().muted, 12)))


class Arrangement:
    """The docks: Mesh, Shape, Compare and Labels at the left, Field at the right, plots below."""

    def __init__(self, window: QMainWindow) -> None:
        self._window = window
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
        for name in _LEFT:
            self.docks[name].visibilityChanged.connect(partial(self._show, self.docks[name]))
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
        # toolbars that were added after that state would be on the line of the first one
        directly = Qt.FindChildOption.FindDirectChildrenOnly
        for bar in self._window.findChildren(QToolBar, options=directly)[1:]:
            self._window.insertToolBarBreak(bar)
        self._narrow = self._field_aside = False
        self.share_room()

    def share_room(self) -> None:
        """Give the docks their default sizes.

        Unlike `reset`, it leaves no tab bar behind, which Qt makes anew with a restored state.
        """
        self.fit()
        sides = [self.docks["mesh"], self.docks["field"]]
        self._window.resizeDocks(sides, [290, 330], Qt.Orientation.Horizontal)
        below = [self.docks["spectrum"], self.docks["profile"]]
        self._window.resizeDocks(below, [230, 230], Qt.Orientation.Vertical)
        self._window.resizeDocks(below, [400, 400], Qt.Orientation.Horizontal)

    def fit(self) -> None:
        """Show the plots side by side, or as tabs if the window is narrow."""
        self._fit_field()
        window, narrow = self._window, self._window.width() < _NARROW
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
            # a tab cannot be split off: it has to be removed and added again
            window.removeDockWidget(profile)
            window.addDockWidget(_BOTTOM, profile)
            window.splitDockWidget(spectrum, profile, Qt.Orientation.Horizontal)
            profile.show()
            window.resizeDocks([spectrum, profile], [400, 400], Qt.Orientation.Horizontal)

    def set_comparing(self, comparing: bool) -> None:
        """Leave room for two renders, or for one."""
        self._comparing = comparing
        self._fit_field()
        if comparing:
            self.docks["pair"].show()
            self.docks["pair"].raise_()

    def show_field(self) -> None:
        """Bring Field to the front where it shares a place."""
        if self._field_aside:
            self.docks["field"].raise_()

    @property
    def _is_field_aside(self) -> bool:
        return self._window.width() < (_NARROW_PAIR if self._comparing else _NARROW_ONE)

    def _fit_field(self) -> None:
        """Put Field with the panels at the left while renders would be narrower than it."""
        window, field, aside = self._window, self.docks["field"], self._is_field_aside
        if aside == self._field_aside or field.isFloating() or field.isHidden():
            return
        left = (self.docks[name] for name in reversed(_LEFT))
        there = next((dock for dock in left if not (dock.isHidden() or dock.isFloating())), None)
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
        self.docks["pair" if self._comparing else "mesh"].raise_()

    @staticmethod
    def _show(dock: Dock, shown: bool) -> None:
        """Exclude hidden tabs from the Tab key, as Qt considers them visible."""
        dock.widget().setEnabled(shown)

    def save(self) -> tuple[QByteArray, QByteArray]:
        return self._window.saveGeometry(), self._window.saveState(_VERSION)

    def restore(self, layout: tuple[QByteArray, QByteArray]) -> None:
        self._window.restoreGeometry(layout[0])
        self._window.restoreState(layout[1], _VERSION)
        aside = self._window.tabifiedDockWidgets(self.docks["field"])
        self._field_aside = self._is_field_aside and self.docks["mesh"] in aside
        plots = self._window.tabifiedDockWidgets(self.docks["spectrum"])
        # tabs for want of width end when the window is shown wider than it was stored
        self._narrow = self._window.width() < _NARROW and self.docks["profile"] in plots

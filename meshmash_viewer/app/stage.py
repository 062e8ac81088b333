"""Centre of the window: the welcome page or the render, the message bar, and drop areas."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QPoint, QRect, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QResizeEvent
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from PySide6.QtWidgets import (
    QBoxLayout,
    QFrame,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSplitter,
    QStackedLayout,
    QStylePainter,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, row
from meshmash_viewer.app.controls.message_bar import MessageBar
from meshmash_viewer.app.screen import has_opengl
from meshmash_viewer.io.links import name_and_place, shown_path

_RECENT_SHOWN = 5
#: Side margin of the card, and minimum width for two buttons in a row, in logical pixels.
_MARGIN, _SIDE_BY_SIDE = 32, 300
#: Height of the title row above each render of a comparison.
_HEAD = 27
#: Radius of the corners of drop areas.
_RADIUS = 12


class HeadLabel(QLabel):
    """A label that truncates long text with an ellipsis, and shows the full text as its tooltip."""

    def paintEvent(self, _event: QPaintEvent) -> None:
        end = Qt.TextElideMode.ElideRight
        written = self.fontMetrics().elidedText(self.text(), end, self.width())
        self.setToolTip(self.text() if written != self.text() else "")
        QStylePainter(self).drawItemText(
            self.rect(), self.alignment(), self.palette(), True, written, self.foregroundRole()
        )


def render_head(label: QLabel, *buttons: QWidget) -> QWidget:
    """Return a title row above a render, styled like the title of a dock."""
    head = theme.named(QWidget(), "dock_title")
    head.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
    head.setFixedHeight(_HEAD)
    label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    head.setLayout(row((label,), *buttons, margins=(theme.MARGIN, 0, 6, 0)))
    return head


class Stage(QWidget):
    """Central widget: the welcome page or the render, under the message bar."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("stage")
        self.setMinimumSize(280, 240)
        # Qt recreates a window, which flickers, when its first OpenGL widget is added. Without
        # OpenGL, a window that contains an OpenGL widget stays black.
        if has_opengl():
            QOpenGLWidget(self).hide()
        self._pages = QStackedLayout(self)
        self.welcome = Welcome()
        self._pages.addWidget(self.welcome)
        self._scene: QSplitter | None = None
        self.first_label = theme.named(HeadLabel(), "first_label", "First mesh, and its state")
        self.message_bar = MessageBar(self)

    def set_scene(self, scene: QWidget) -> None:
        """Add the render as the second page."""
        self._scene = QSplitter(Qt.Orientation.Horizontal)
        self._scene.setChildrenCollapsible(False)
        self._first_head = render_head(self.first_label)
        self._first_head.hide()
        first = QWidget()
        first.setLayout(column(self._first_head, (scene,), spacing=0))
        self._scene.addWidget(first)
        self._pages.addWidget(self._scene)
        self.message_bar.raise_()

    def add_second(self, other: QWidget) -> None:
        """Add a widget of the same width to the right of the render."""
        assert self._scene is not None
        self._scene.addWidget(other)
        self._scene.setSizes([1000, 1000])
        self._first_head.show()
        self.message_bar.keep_below(_HEAD)

    def remove_second(self, other: QWidget) -> None:
        """Remove a widget added by `add_second`."""
        self._first_head.hide()
        self.message_bar.keep_below(0)
        other.setParent(None)
        other.deleteLater()

    def show_scene(self, shown: bool) -> None:
        page = self._scene if shown and self._scene is not None else self.welcome
        if self._pages.currentWidget() is not page:
            self._pages.setCurrentWidget(page)
        if self.message_bar.isVisible():
            self.message_bar.raise_()


class Welcome(QScrollArea):
    """Page shown without a mesh: buttons to open a file or the sample, recent files, progress."""

    open_requested = Signal()
    sample_requested = Signal()
    recent_requested = Signal(Path)

    def __init__(self) -> None:
        super().__init__()
        theme.named(self, "welcome", "Welcome")
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        middle = Qt.AlignmentFlag.AlignCenter
        self._icon = QLabel(alignment=middle)
        self.title = theme.with_role(HeadLabel(alignment=middle), "title")
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        endings = make.muted(
            "PLY, OBJ, STL, OFF, GLB, VTP, VTK, NPZ, GIFTI or FreeSurfer surface",
            alignment=middle,
            wordWrap=True,
        )
        self.open_button = make.button(
            "Open a file…",
            "welcome_open_button",
            "Open a mesh file",
            self.open_requested,
            role="primary",
        )
        sample = "Open the sample neuron"
        self.sample_button = make.button(
            sample, "welcome_sample_button", sample, self.sample_requested
        )
        self._recent = column(spacing=0)
        self._links: list[tuple[QPushButton, str]] = []
        self.loading_label = make.label(
            "loading_label", "Loading step", role="muted", alignment=middle
        )
        self._buttons = row(
            (self.open_button,), (self.sample_button,), margins=(0, theme.GAP, 0, 0)
        )
        parts = self._icon, self.title, endings, self._buttons, self._recent, self.loading_label
        self._card = theme.named(QFrame(), "welcome_card")
        self._card.setMaximumWidth(440)
        self._card.setLayout(column(*parts, margins=(_MARGIN, 28, _MARGIN, 24)))
        around = theme.named(QWidget(), "welcome_around")
        middle_row = row(None, self._card, None)
        middle_row.setStretchFactor(self._card, 1000)  # reaches its maximum width before the sides
        around.setLayout(column(None, middle_row, None, margins=(theme.GAP,) * 4))
        self.setWidget(around)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()
        self.set_loading("")
        self.set_reading("")

    def set_recent(self, paths: Sequence[Path]) -> None:
        """List recent files, newest first."""
        while (item := self._recent.takeAt(0)) is not None:
            if (widget := item.widget()) is not None:
                widget.deleteLater()
        self._links.clear()
        if not paths:
            return
        heading = make.muted("Recent")
        heading.setContentsMargins(4, theme.GAP, 0, 2)
        self._recent.addWidget(heading)
        for path in paths[:_RECENT_SHOWN]:
            name, place = name_and_place(path)
            button = make.button(
                "",
                "",
                f"Open {name}",
                lambda _checked=False, path=path: self.recent_requested.emit(path),
                role="link",
                tip=shown_path(path),
            )
            self._recent.addWidget(button)
            self._links.append((button, f"{name}  ·  {place}"))
        self._fit()

    def set_loading(self, text: str) -> None:
        """Show the state of the libraries; "" once they are loaded."""
        self.loading_label.setText(text)
        self.loading_label.setVisible(bool(text))

    def set_reading(self, text: str) -> None:
        """Show which mesh is being read; "" for none."""
        self.title.setText(text or "Drop a mesh here")

    def _refresh(self) -> None:
        self._icon.setPixmap(theme.pixmap("mesh", theme.palette().accent, 44))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Arrange the buttons, and shorten the paths, to fit the width."""
        width = min(self.width() - 2 * theme.GAP, self._card.maximumWidth()) - 2 * _MARGIN
        boxes, narrow = QBoxLayout.Direction, width < _SIDE_BY_SIDE
        self._buttons.setDirection(boxes.TopToBottom if narrow else boxes.LeftToRight)
        for button, text in self._links:
            elided = self.fontMetrics().elidedText(text, Qt.TextElideMode.ElideMiddle, width - 16)
            button.setText(elided)


class DropAreas(QWidget):
    """One or two drop areas side by side; the area under the pointer is highlighted."""

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        theme.named(self, "drop_areas")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._texts: tuple[str, ...] = ()
        self._middle, self._chosen = 0, 0
        self.hide()

    def show_texts(self, texts: tuple[str, ...], middle: int) -> None:
        """Cover the window with an area per text; `middle` is the x of their boundary in pixels."""
        self._texts, self._middle = texts, middle
        self.setAccessibleName(", ".join(texts))
        self.setGeometry(self._window.rect())
        self.show()
        self.raise_()

    def point_at(self, place: QPoint) -> int:
        """Highlight the area at a position of the window, and return its index."""
        self._chosen = int(len(self._texts) > 1 and place.x() > self._middle)
        self.update()
        return self._chosen

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter, colors = QPainter(self), theme.palette()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = self.font()
        font.setPointSizeF(1.3 * font.pointSizeF())
        font.setBold(True)
        painter.setFont(font)
        room = self.rect().adjusted(theme.MARGIN, theme.MARGIN, -theme.MARGIN, -theme.MARGIN)
        areas = [room]
        if len(self._texts) > 1:
            areas = [QRect(room), QRect(room)]
            areas[0].setRight(self._middle - theme.GAP // 2)
            areas[1].setLeft(self._middle + theme.GAP // 2)
        for at, (area, text) in enumerate(zip(areas, self._texts, strict=True)):
            chosen = at == self._chosen
            ground = QColor(colors.selection if chosen else colors.surface)
            ground.setAlphaF(0.92)
            painter.setBrush(ground)
            style = Qt.PenStyle.SolidLine if chosen else Qt.PenStyle.DashLine
            painter.setPen(QPen(QColor(colors.accent if chosen else colors.muted), 2.0, style))
            painter.drawRoundedRect(area, _RADIUS, _RADIUS)
            painter.setPen(QColor(colors.text))
            within = area.adjusted(theme.MARGIN, 0, -theme.MARGIN, 0)
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWrapAnywhere
            painter.drawText(within, flags, text)
        painter.end()

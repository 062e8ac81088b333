"""Areas over the window, shown while files are dragged over it, that say what a drop does."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme

_RADIUS = 12


class DropAreas(QWidget):
    """One area, or two side by side, of which that under the pointer is highlighted."""

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        theme.named(self, "drop_areas")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._texts: tuple[str, ...] = ()
        self._middle, self._chosen = 0, 0
        self.hide()

    def show_texts(self, texts: tuple[str, ...], middle: int) -> None:
        """Cover the window; `middle` is where the second area begins, in pixels."""
        self._texts, self._middle = texts, middle
        self.setAccessibleName(", ".join(texts))
        self.setGeometry(self._window.rect())
        self.show()
        self.raise_()

    def point_at(self, place: QPoint) -> int:
        """Highlight the area under a position of the window, and return its number."""
        self._chosen = int(len(self._texts) > 1 and place.x() > self._middle)
        self.update()
        return self._chosen

    def paintEvent(self, _event: QPaintEvent) -> None:
        """Paint the areas, which the window shows through."""
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

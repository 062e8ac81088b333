"""Panels with a plot; export of plots, in light colours, to the clipboard and to files."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path

import numpy as np
from pyqtgraph.exporters import Exporter
from PySide6.QtCore import QMarginsF, QObject, QPoint, QPointF, QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import (
    QColor,
    QFontMetricsF,
    QGuiApplication,
    QImage,
    QPageSize,
    QPainter,
    QPdfWriter,
    QResizeEvent,
)
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsItem, QLabel, QMenu, QSizePolicy, QStackedLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.background import say_saved
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, row
from meshmash_viewer.app.dialogs.files import FormatDialog, suggested_path
from meshmash_viewer.app.plots.plot import Plot, Series, scaled_pens
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.write import check_output
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Severity


class PanelHead(QWidget):
    """A row of controls and labels; the last label is at the right end.

    Labels are ordered by importance: if the row is too narrow, the last labels are hidden.
    """

    def __init__(self, controls: tuple[QWidget, ...], labels: tuple[QLabel, ...]) -> None:
        super().__init__()
        self._controls = controls
        self._labels = labels
        self.setLayout(row(*controls, *labels[:-1], None, labels[-1]))
        # the minimum width depends on the controls only, not on the labels
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setMinimumWidth(self._needed())

    def _needed(self) -> int:
        widths = [control.sizeHint().width() for control in self._controls]
        return sum(widths) + theme.GAP * (len(widths) - 1)

    def show_controls(self, shown: bool) -> None:
        """Show or hide all controls and labels."""
        for control in self._controls:
            control.setVisible(shown)
        self.setMinimumWidth(self._needed() if shown else 0)
        self.fit()

    def fit(self) -> None:
        """Show the labels that have a text and fit in the row."""
        shown = not self._controls[0].isHidden()
        room = self.width() - self._needed()
        for label in self._labels:
            wanted = label.sizeHint().width() + 2 * theme.GAP
            fits = shown and bool(label.text()) and wanted <= room
            label.setVisible(fits)
            room = room - wanted if fits or not label.text() else 0

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.fit()


class PlotPanel(QWidget):
    """A panel named ``<name>_panel`` that shows its `plot`, or the label `empty`.

    Subclasses call `_arrange` for the layout.
    """

    plot: Plot

    def __init__(self, document: Document, name: str, title: str) -> None:
        super().__init__()
        theme.named(self, f"{name}_panel", title)
        self._document = document
        middle = Qt.AlignmentFlag.AlignCenter
        self.empty = make.label(
            f"{name}_empty_label", wordWrap=True, alignment=middle, role="muted"
        )

    def _arrange(
        self, controls: tuple[QWidget, ...], labels: tuple[QLabel, ...], shown: QWidget
    ) -> None:
        """Place a row of controls and labels above the widget `shown`, which contains the plot."""
        self.head = PanelHead(controls, labels)
        self._stack = QStackedLayout()
        self._stack.addWidget(shown)
        self._stack.addWidget(self.empty)
        half = theme.GAP // 2
        margins = theme.MARGIN, half, theme.GAP, half
        self.setLayout(column(self.head, self._stack, spacing=half, margins=margins))

    def _show_plot(self, there: bool) -> None:
        self.plot.paint_later()
        self._stack.setCurrentIndex(0 if there else 1)
        self.head.show_controls(there)


_FORMATS = {
    ".svg": "SVG, with text and lines as vectors",
    ".pdf": "PDF, with text and lines as vectors",
    ".png": "PNG picture, 300 dpi",
    ".csv": "CSV, the numbers that are drawn",
}
_DPI, _INCH = 300, 25.4
#: Lengths of a line in the legend, and of the gap after the line, in text heights.
_STROKE, _GAP = 1.2, 0.5


class PlotSaver(QObject):
    """Menu of a plot, opened by a right click or the menu key, to save or copy the plot.

    `numbers` returns the drawn series, and `dress` sets their colours to those of the theme.
    """

    def __init__(
        self,
        plot: Plot,
        document: Document,
        numbers: Callable[[], Sequence[Series]],
        dress: Callable[[], None],
    ) -> None:
        super().__init__(plot)
        self._plot, self._document = plot, document
        self._numbers, self._dress = numbers, dress
        plot.menu_requested.connect(self._show_menu)

    def _show_menu(self, place: QPoint) -> None:
        menu = theme.named(QMenu(self._plot), "plot_menu", "Menu of the plot")
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for name, text, act in (
            ("save_plot", "Save this plot…", self.ask), ("copy_plot", "Copy", self.copy)
        ):  # fmt: skip
            menu.addAction(text, act).setObjectName(name)
        menu.popup(place)

    def copy(self) -> None:
        QGuiApplication.clipboard().setImage(self._pixels())
        self._document.notices.say("Plot copied.")

    def ask(self) -> None:
        name = self._plot.objectName().removesuffix("_plot")
        path = suggested_path(self._document, name)
        dialog = FormatDialog("plot", "Save this plot", path, _FORMATS, self._plot.window())
        dialog.lay_out()
        dialog.accepted.connect(lambda: self._save(dialog.path))
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()

    def _save(self, path: Path) -> None:
        try:
            self.save(path)
        except InputError as fault:
            self._document.notices.say(f"The plot was not saved: {fault}", Severity.ERROR)
        else:
            say_saved(self._document, f"Plot saved to {path}.", path)

    def save(self, path: Path) -> None:
        """Write the plot in the format of the file's ending.

        Raises
        ------
        InputError
            If the ending is unknown, or the file cannot be written.
        """
        check_output(path, "plot")
        ending = path.suffix.lower()
        with writing_errors(path), written_whole(path) as part:
            if ending == ".csv":
                self._write_numbers(part)
            elif ending == ".png":
                if not self._pixels().save(str(part), "PNG"):  # type: ignore[call-overload]
                    raise OSError(f"{path.name} could not be written.")
            else:
                self._write_vectors(part, ending == ".pdf")

    def _write_numbers(self, path: Path) -> None:
        """Write a CSV table with a row per point: series, x and y, with the names of the axes.

        If errors of a series are known, they are a fourth column.
        """
        drawn = self._numbers()
        with_errors = any(np.size(each.errors) for each in drawn)
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow(["series", *self._plot.labels, "mesh_error"][: 3 + with_errors])
            for each in drawn:
                points = [np.asarray(part).tolist() for part in (each.x, each.y, each.errors)]
                for x, y, error in zip_longest(*points, fillvalue=""):
                    table.writerow([each.name, x, y, error][: 3 + with_errors])

    def _write_vectors(self, path: Path, as_pdf: bool) -> None:
        with self._on_paper() as (size, draw):
            resolution = self._plot.logicalDpiX()
            device: QPdfWriter | QSvgGenerator
            if as_pdf:
                device = QPdfWriter(str(path))
                points = QSizeF(size) * 72.0 / resolution
                device.setPageSize(QPageSize(points, QPageSize.Unit.Point))
                device.setPageMargins(QMarginsF())
            else:
                device = QSvgGenerator()
                device.setFileName(str(path))
                device.setSize(size)
                device.setViewBox(QRectF(QPointF(), QSizeF(size)))
            device.setResolution(resolution)
            with QPainter(device) as painter:
                draw(painter)

    def _pixels(self) -> QImage:
        scale = _DPI / self._plot.logicalDpiX()
        with self._on_paper(scale) as (size, draw):
            image = QImage(size * scale, QImage.Format.Format_RGB32)
            image.setDevicePixelRatio(scale)
            image.fill(QColor("#ffffff"))
            with QPainter(image) as painter:
                painter.setRenderHint(QPainter.RenderHint.Antialiasing)
                draw(painter)
            image.setDevicePixelRatio(1.0)
            # after painting, because font sizes depend on the dots per meter
            image.setDotsPerMeterX(round(_DPI / _INCH * 1000.0))
            image.setDotsPerMeterY(round(_DPI / _INCH * 1000.0))
        return image

    @contextmanager
    def _on_paper(self, scale: float = 1.0) -> Iterator[tuple[QSize, Callable[[QPainter], None]]]:
        """Use light colours; yield the size of plot and legend, and a function that draws both."""
        plot, box = self._plot, self._plot.plotItem.vb
        automatic = box.autoRangeEnabled()
        box.disableAutoRange()  # because automatic ranges depend on the widths of pens
        try:
            with theme.light(), scaled_pens(scale):
                self._dress_all()
                rows = self._rows([each for each in self._numbers() if each.color])
                line = 1.4 * QFontMetricsF(plot.font()).height()
                head = round(line * len(rows))
                size = QSize(plot.width(), plot.height() + head)
                yield size, lambda painter: self._draw(painter, rows, line, head)
        finally:
            self._dress_all()
            box.enableAutoRange(x=automatic[0], y=automatic[1])

    def _draw(
        self, painter: QPainter, rows: Sequence[Sequence[Series]], line: float, head: int
    ) -> None:
        plot, exporter = self._plot, Exporter(self._plot.plotItem)
        painter.setFont(plot.font())
        for at, names in enumerate(rows):
            self._draw_names(painter, names, line * at, line / 1.4)
        source = QRectF(plot.mapToScene(plot.rect()).boundingRect())
        target = QRectF(0.0, head, plot.width(), plot.height())
        none = QGraphicsItem.CacheMode.NoCache
        cached = [item for item in plot.scene().items() if item.cacheMode() != none]
        modes = [item.cacheMode() for item in cached]
        for item in cached:  # disable caches, which have the resolution of the screen
            item.setCacheMode(none)
        exporter.setExportMode(True, {"antialias": True, "painter": painter})
        try:
            plot.scene().render(painter, target, source)
        finally:
            exporter.setExportMode(False)
            for item, mode in zip(cached, modes, strict=True):
                item.setCacheMode(mode)

    def _dress_all(self) -> None:
        self._plot.dress()
        self._dress()

    def _rows(self, named: Sequence[Series]) -> list[list[Series]]:
        """Break the legend into rows at most as wide as the plot."""
        metrics, rows, used = QFontMetricsF(self._plot.font()), list[list[Series]](), 0.0
        for each in named:
            wide = (_STROKE + 2.0 * _GAP) * metrics.height() + metrics.horizontalAdvance(each.name)
            if not rows or used + wide > self._plot.width():
                rows, used = [*rows, []], 0.0
            rows[-1].append(each)
            used += wide
        return rows

    def _draw_names(
        self, painter: QPainter, row: Sequence[Series], top: float, high: float
    ) -> None:
        metrics, x, middle = QFontMetricsF(self._plot.font()), _GAP * high, top + 0.7 * high
        for each in row:
            painter.fillRect(
                QRectF(x, middle - 0.08 * high, _STROKE * high, 0.16 * high), QColor(each.color)
            )
            x += (_STROKE + _GAP) * high
            painter.setPen(QColor(theme.palette().text))
            painter.drawText(QPointF(x, middle + 0.35 * high), each.name)
            x += metrics.horizontalAdvance(each.name) + _GAP * high

"""What the panels of the plots have in common: a head, and a plot or what to do to have one."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QStackedLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.layout import column, row
from meshmash_viewer.app.plots.plot import Plot
from meshmash_viewer.model.document import Document


class PanelHead(QWidget):
    """Controls on the left, then labels; the last label is at the right end.

    Labels, most important first, are hidden from the last on where they do not fit.
    """

    def __init__(self, controls: tuple[QWidget, ...], labels: tuple[QLabel, ...]) -> None:
        super().__init__()
        self._controls = controls
        self._labels = labels
        self.setLayout(row(*controls, *labels[:-1], None, labels[-1]))
        # hidden labels must not be what makes the panel wide
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setMinimumWidth(self._needed())

    def _needed(self) -> int:
        widths = [control.sizeHint().width() for control in self._controls]
        return sum(widths) + theme.GAP * (len(widths) - 1)

    def show_controls(self, shown: bool) -> None:
        """Show the controls, or hide the whole row's contents."""
        for control in self._controls:
            control.setVisible(shown)
        self.setMinimumWidth(self._needed() if shown else 0)
        self.fit()

    def fit(self) -> None:
        """Show the labels that have something to say and fit."""
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
    """A panel at the bottom, named ``<name>_panel``, with its `plot` or a sentence in its place.

    Subclasses lay themselves out by `_arrange`.
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
        """Put a head with these controls and labels over what is shown, which has the plot."""
        self.head = PanelHead(controls, labels)
        self._stack = QStackedLayout()
        self._stack.addWidget(shown)
        self._stack.addWidget(self.empty)
        half = theme.GAP // 2
        margins = theme.MARGIN, half, theme.GAP, half
        self.setLayout(column(self.head, self._stack, spacing=half, margins=margins))

    def _show_plot(self, there: bool) -> None:
        """Show the plot, or what to do to have one."""
        self.plot.paint_later()
        self._stack.setCurrentIndex(0 if there else 1)
        self.head.show_controls(there)

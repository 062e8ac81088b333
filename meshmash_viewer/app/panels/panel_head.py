"""The row above a plot: its controls always, and words as far as there is room."""

from __future__ import annotations

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSizePolicy, QWidget

from meshmash_viewer.app import theme

__all__ = ["PanelHead"]


class PanelHead(QWidget):
    """Controls on the left, then labels; the last label is at the right end.

    Labels that do not fit are left out from the last on, whole: half a sentence is no use.

    Parameters
    ----------
    controls : tuple of QWidget
    labels : tuple of QLabel
        Most important first.
    """

    def __init__(
        self,
        controls: tuple[QWidget, ...],
        labels: tuple[QLabel, ...],
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._controls = controls
        self._labels = labels
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GAP)
        for control in controls:
            row.addWidget(control)
        for label in labels[:-1]:
            row.addWidget(label)
        row.addStretch(1)
        row.addWidget(labels[-1])
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
        """Make the most of the room there is."""
        super().resizeEvent(event)
        self.fit()

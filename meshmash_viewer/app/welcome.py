"""What the middle of the window shows while no mesh is open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QLabel, QPushButton, QScrollArea, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.layout import column, row

__all__ = ["Welcome"]

_RECENT_SHOWN = 5
#: Of the card, to its sides; and what two buttons beside each other take, in logical pixels.
_MARGIN, _SIDE_BY_SIDE = 32, 300


class Welcome(QScrollArea):
    """The empty state: drop, open, sample, recent files; or what is being loaded."""

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
        title = theme.with_role(QLabel("Drop a mesh here", alignment=middle), "title")
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
            "loading_label", "What is being loaded", role="muted", alignment=middle
        )
        self._buttons = row(
            (self.open_button,), (self.sample_button,), margins=(0, theme.GAP, 0, 0)
        )
        parts = self._icon, title, endings, self._buttons, self._recent, self.loading_label
        self._card = theme.named(QFrame(), "welcome_card")
        self._card.setMaximumWidth(440)
        self._card.setLayout(column(*parts, margins=(_MARGIN, 28, _MARGIN, 24)))
        around = theme.named(QWidget(), "welcome_around")
        middle_row = row(None, self._card, None)
        middle_row.setStretchFactor(self._card, 1000)  # as wide as it may be, where there is room
        around.setLayout(column(None, middle_row, None, margins=(theme.GAP,) * 4))
        self.setWidget(around)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()
        self.set_loading("")

    def set_recent(self, paths: Sequence[Path]) -> None:
        """List the files opened before, newest first."""
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
            button = make.button(
                "",
                "",
                f"Open {path.name}",
                lambda _checked=False, path=path: self.recent_requested.emit(path),
                role="link",
                tip=str(path),
            )
            self._recent.addWidget(button)
            self._links.append((button, f"{path.name}  ·  {path.parent}"))
        self._fit()

    def set_loading(self, text: str) -> None:
        """Say what is being loaded; empty when nothing is."""
        self.loading_label.setText(text)
        self.loading_label.setVisible(bool(text))

    def set_dropping(self, dropping: bool) -> None:
        """Show that a file held over the window would be taken."""
        self._card.setProperty("dropping", dropping)
        theme.restyle(self._card)

    def _refresh(self) -> None:
        self._icon.setPixmap(icons.pixmap("mesh", theme.palette().accent, 44))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Make do with the room there is."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Put the buttons side by side, and as much of each path, as there is room for."""
        room = min(self.width() - 2 * theme.GAP, self._card.maximumWidth()) - 2 * _MARGIN
        boxes, narrow = QBoxLayout.Direction, room < _SIDE_BY_SIDE
        self._buttons.setDirection(boxes.TopToBottom if narrow else boxes.LeftToRight)
        for button, text in self._links:
            elided = self.fontMetrics().elidedText(text, Qt.TextElideMode.ElideMiddle, room - 16)
            button.setText(elided)

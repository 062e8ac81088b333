"""What the middle of the window shows while no mesh is open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons

__all__ = ["Welcome"]

_RECENT_SHOWN = 5


class Welcome(QWidget):
    """The empty state: drop, open, sample, recent files; or what is being loaded."""

    open_requested = Signal()
    sample_requested = Signal()
    recent_requested = Signal(Path)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        theme.named(self, "welcome", "Welcome")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)

        self._card = theme.named(QFrame(), "welcome_card")
        self._card.setFixedWidth(440)
        self._card.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Maximum)
        column = QVBoxLayout(self._card)
        column.setContentsMargins(32, 28, 32, 24)
        column.setSpacing(theme.GAP)

        self._icon = QLabel(alignment=Qt.AlignmentFlag.AlignCenter)
        title = theme.with_role(QLabel("Drop a mesh here"), "title")
        title.setAlignment(Qt.AlignmentFlag.AlignCenter)
        endings = theme.with_role(
            QLabel("PLY, OBJ, STL, OFF, GLB, VTP, VTK, NPZ, GIFTI or FreeSurfer surface"), "muted"
        )
        endings.setAlignment(Qt.AlignmentFlag.AlignCenter)
        endings.setWordWrap(True)

        self.open_button = theme.named(
            QPushButton("Open a file…"), "welcome_open_button", "Open a mesh file", role="primary"
        )
        self.open_button.clicked.connect(self.open_requested)
        self.sample_button = theme.named(
            QPushButton("Open the sample neuron"), "welcome_sample_button", "Open the sample neuron"
        )
        self.sample_button.clicked.connect(self.sample_requested)
        buttons = QHBoxLayout()
        buttons.setSpacing(theme.GAP)
        buttons.addWidget(self.open_button, 1)
        buttons.addWidget(self.sample_button, 1)

        self._recent = QVBoxLayout()
        self._recent.setSpacing(0)
        self.loading_label = theme.named(
            QLabel(), "loading_label", "What is being loaded", role="muted"
        )
        self.loading_label.setAlignment(Qt.AlignmentFlag.AlignCenter)

        column.addWidget(self._icon)
        column.addWidget(title)
        column.addWidget(endings)
        column.addSpacing(theme.GAP)
        column.addLayout(buttons)
        column.addLayout(self._recent)
        column.addWidget(self.loading_label)

        around = QVBoxLayout(self)
        around.addWidget(self._card, 0, Qt.AlignmentFlag.AlignCenter)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()
        self.set_loading("")

    def set_recent(self, paths: Sequence[Path]) -> None:
        """List the files opened before, newest first."""
        while (item := self._recent.takeAt(0)) is not None:
            if (widget := item.widget()) is not None:
                widget.deleteLater()
        if not paths:
            return
        heading = theme.with_role(QLabel("Recent"), "muted")
        heading.setContentsMargins(4, theme.GAP, 0, 2)
        self._recent.addWidget(heading)
        for path in paths[:_RECENT_SHOWN]:
            button = theme.with_role(QPushButton(), "link")
            room = self._card.width() - 80
            button.setText(
                button.fontMetrics().elidedText(
                    f"{path.name}  ·  {path.parent}", Qt.TextElideMode.ElideMiddle, room
                )
            )
            button.setToolTip(str(path))
            button.setAccessibleName(f"Open {path.name}")
            button.clicked.connect(lambda _checked=False, path=path: self._choose(path))
            self._recent.addWidget(button)

    def _choose(self, path: Path) -> None:
        self.recent_requested.emit(path)

    def set_loading(self, text: str) -> None:
        """Say what is being loaded; empty when nothing is."""
        self.loading_label.setText(text)
        self.loading_label.setVisible(bool(text))

    def set_dropping(self, dropping: bool) -> None:
        """Show that a file held over the window would be taken."""
        self._card.setProperty("dropping", dropping)
        self._card.style().unpolish(self._card)
        self._card.style().polish(self._card)

    def _refresh(self) -> None:
        self._icon.setPixmap(icons.pixmap("mesh", theme.palette().accent, 44))

    def minimumSizeHint(self) -> QSize:
        """Small enough for the smallest window."""
        return QSize(320, 240)

"""What the middle of the window shows while no mesh is open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtWidgets import QFrame, QLabel, QVBoxLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.layout import column, row

__all__ = ["Welcome"]

_RECENT_SHOWN = 5


class Welcome(QWidget):
    """The empty state: drop, open, sample, recent files; or what is being loaded."""

    open_requested = Signal()
    sample_requested = Signal()
    recent_requested = Signal(Path)

    def __init__(self) -> None:
        super().__init__()
        theme.named(self, "welcome", "Welcome")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
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
        self.loading_label = make.label(
            "loading_label", "What is being loaded", role="muted", alignment=middle
        )
        buttons = row((self.open_button,), (self.sample_button,), margins=(0, theme.GAP, 0, 0))
        parts = self._icon, title, endings, buttons, self._recent, self.loading_label
        self._card = theme.named(QFrame(), "welcome_card")
        self._card.setFixedWidth(440)
        self._card.setLayout(column(*parts, margins=(32, 28, 32, 24)))
        around = QVBoxLayout(self)
        around.addWidget(self._card, 0, middle)
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
        heading = make.muted("Recent")
        heading.setContentsMargins(4, theme.GAP, 0, 2)
        self._recent.addWidget(heading)
        metrics, room = self.fontMetrics(), self._card.width() - 80
        for path in paths[:_RECENT_SHOWN]:
            whole, elided = f"{path.name}  ·  {path.parent}", Qt.TextElideMode.ElideMiddle
            button = make.button(
                metrics.elidedText(whole, elided, room),
                "",
                f"Open {path.name}",
                lambda _checked=False, path=path: self.recent_requested.emit(path),
                role="link",
                tip=str(path),
            )
            self._recent.addWidget(button)

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

    def minimumSizeHint(self) -> QSize:
        """Small enough for the smallest window."""
        return QSize(320, 240)

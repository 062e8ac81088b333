"""Progress of the job of a document: its text and its bar, also in the status bar."""

from __future__ import annotations

from PySide6.QtWidgets import QDockWidget, QLabel, QProgressBar, QSizePolicy, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import JobState
from meshmash_viewer.spectral.cost import written_duration

_STEPS = 1000


def progress_text(state: JobState) -> str:
    """Describe what is being done, and how long it still takes."""
    progress = state.progress
    what = "Stopping" if state.cancelling else progress.message or progress.stage
    parts = [what[:1].upper() + what[1:] if what else state.job.label]
    if progress.remaining is not None and not state.cancelling:
        parts.append(f"{written_duration(progress.remaining)} left")
    return " · ".join(parts)


def show_progress(bar: QProgressBar, state: JobState) -> None:
    """Show how much is done; of a job whose end is not known the maximum is 0."""
    fraction = state.progress.fraction
    bar.setMaximum(0 if fraction is None else _STEPS)
    if fraction is not None:
        bar.setValue(round(_STEPS * min(max(fraction, 0.0), 1.0)))


class StatusProgress(QWidget):
    """Progress in the status bar, while the panel that shows it is hidden, closed or behind others.

    Parameters
    ----------
    document : Document
    dock : QDockWidget
        Dock of that panel.
    """

    def __init__(self, document: Document, dock: QDockWidget) -> None:
        super().__init__()
        theme.named(self, "status_progress", "Progress of what is being done")
        self._document = document
        self._panel_shown = not dock.isHidden()
        self.label = QLabel()
        self.label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.bar = QProgressBar(textVisible=False, minimum=0, maximum=_STEPS)
        theme.named(self.bar, "status_progress_bar", "Progress").setFixedWidth(96)
        self.cancel_button = make.button(
            "Cancel", "status_cancel_button", "Cancel what runs", document.work.cancel, role="link"
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

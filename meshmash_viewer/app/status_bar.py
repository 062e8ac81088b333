"""The status bar: the vertex under the pointer, and the progress of the job."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDockWidget, QLabel, QProgressBar, QSizePolicy, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import row
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.jobs import JobState
from meshmash_viewer.model.pins import pin_at
from meshmash_viewer.spectral.cost import written_duration
from meshmash_viewer.units import NO_BREAK, counted, format_number


class HoverLabel(QLabel):
    """Index, value and place of the vertex under the pointer, or the size of the mesh."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "hover_label", "Vertex under the pointer")
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._document = document
        self._vertex = self._point = -1
        #: The field that is drawn.
        self.field: Field | None = None
        #: Whether a click pins, and does not select.
        self.clicks_pin = True
        follow(document.pins.changed, self._refresh)

    def show_vertex(self, vertex: int) -> None:
        """Describe a vertex; -1 for none."""
        self._vertex = vertex
        self._refresh()

    def show_point(self, point: int) -> None:
        """Describe a point of the table as well; -1 for none."""
        self._point = point
        self._refresh()

    def _of_point(self) -> list[str]:
        """What the point under the pointer is, and its value in the column that colours it."""
        points = self._document.points
        if points.projected is None or points.shown is None or self._point < 0:
            return []
        values = points.shown.table.columns.get(points.shown.column)
        parts = [points.projected.describe(self._point)]
        if values is not None:
            value = values[self._point]
            written = format_number(float(value)) if isinstance(value, float) else str(value)
            parts.append(f"{points.shown.column} {written}")
        return parts

    def _refresh(self) -> None:
        ready, field, vertex = self._document.ready, self.field, self._vertex
        if ready is None:
            parts = []
        elif not 0 <= vertex < ready.mesh.n_vertices:  # or of the previous mesh
            health, unit = ready.health, ready.mesh.unit or "no unit"
            parts = [counted(health.n_vertices, "vertex"), counted(health.n_faces, "face"), unit]
        else:
            mesh, pin = ready.mesh, pin_at(self._document.pins.placed, vertex)
            parts = [*self._of_point(), mesh.named_vertex(vertex).capitalize()]
            if field is not None and vertex < len(field.values):
                named = field.labels or not math.isfinite(field.values[vertex])
                value = field.value_text(vertex)
                parts.append(value if named else f"value {value}")
            # as a position is asked for, in the unit of the file
            place = ", ".join(format_number(x, 6) for x in mesh.vertices[vertex])
            parts.append(f"at ({place}){NO_BREAK}{mesh.unit}".rstrip())
            if self.clicks_pin:
                text = f"click to unpin {pin.title}; a drag moves it" if pin else "click to pin"
                parts.append(text)
        self.setText("  ·  ".join(parts))


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

"""The line of text at the foot of the window."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pins import pin_at
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

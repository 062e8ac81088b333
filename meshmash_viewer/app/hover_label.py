"""The line of text at the foot of the window."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.units import counted, format_quantity


class HoverLabel(QLabel):
    """Index, value and place of the vertex under the pointer, or the size of the mesh."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "hover_label", "Vertex under the pointer")
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._document = document
        #: The field that is drawn.
        self.field: Field | None = None

    def show_vertex(self, vertex: int) -> None:
        """Describe a vertex; -1 for none."""
        ready, field = self._document.ready, self.field
        if ready is None:
            parts = []
        elif not 0 <= vertex < ready.mesh.n_vertices:  # or of the previous mesh
            health, unit = ready.health, ready.mesh.unit or "no unit"
            parts = [counted(health.n_vertices, "vertex"), counted(health.n_faces, "face"), unit]
        else:
            mesh = ready.mesh
            parts = [mesh.named_vertex(vertex).capitalize()]
            if field is not None and vertex < len(field.values):
                value = float(field.values[vertex])
                if field.labels and value == value:
                    parts.append(field.labels[int(value)].name)
                else:
                    number = format_quantity(value, "", digits=5)
                    parts.append(f"value {number} {field.unit}".rstrip())
            place = ", ".join(f"{x:.6g}" for x in mesh.vertices[vertex])
            parts += [f"at ({place}) {mesh.unit}".rstrip(), "click to pin"]
        self.setText("  ·  ".join(parts))

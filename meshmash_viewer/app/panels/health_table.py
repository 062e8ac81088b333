"""What is wrong with the mesh, each with the one click that mends it."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons
from meshmash_viewer.app.listening import follow
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.model.document import Document

__all__ = ["HealthTable"]


@dataclass(frozen=True)
class _Row:
    attribute: str
    text: str
    verb: str = ""
    repair: str = ""
    fault: bool = True
    tooltip: str = ""


_ROWS = (
    _Row(
        "n_components", "Components", "Keep largest", "keep_largest_component", False,
        "Connected parts; each has a zero eigenvalue and a constant eigenfunction of its own",
    ),
    _Row(
        "boundary_edges", "Boundary edges", fault=False,
        tooltip="Edges of one face only; the field leaves them at a right angle "
        "(Neumann condition)",
    ),
    _Row(
        "nonmanifold_edges", "Non-manifold edges",
        tooltip="Edges of more than two faces; the robust Laplacian takes them as they are",
    ),
    _Row(
        "degenerate_faces", "Degenerate faces", "Drop", "drop_degenerate_faces",
        tooltip="Faces without area; the robust Laplacian takes them as they are",
    ),
    _Row(
        "duplicate_faces", "Duplicate faces", "Drop", "drop_duplicate_faces",
        tooltip="Faces with the same three vertices as another",
    ),
    _Row(
        "unreferenced_vertices", "Unreferenced vertices", "Drop", "drop_unreferenced_vertices",
        tooltip="Vertices of no face: they are left out, and have no value in any field",
    ),
    _Row(
        "coincident_vertices", "Coincident vertices", "Merge", "merge_coincident_vertices",
        tooltip="Vertices at exactly the place of another: seams where nothing flows across",
    ),
)  # fmt: skip


class HealthTable(QWidget):
    """One row a count: a mark, what it is, how many, and its repair."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("health_table")
        self._document = document
        self._marks: dict[str, QLabel] = {}
        self._counts: dict[str, QLabel] = {}
        self._buttons: dict[str, QPushButton] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(theme.GAP)
        grid.setVerticalSpacing(1)
        grid.setColumnStretch(1, 1)
        for at, row in enumerate(_ROWS):
            mark = QLabel()
            mark.setFixedSize(14, 18)
            text = QLabel(row.text)
            count = theme.named(QLabel("–"), f"health_{row.attribute}", row.text)
            count.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            for label in (mark, text, count):
                label.setToolTip(row.tooltip)
            self._marks[row.attribute] = mark
            self._counts[row.attribute] = count
            # text and button share a cell, so that the longest of each need not stand side by side
            cell = QHBoxLayout()
            cell.setContentsMargins(0, 0, 0, 0)
            cell.setSpacing(theme.GAP)
            cell.addWidget(text)
            cell.addStretch(1)
            grid.addWidget(mark, at, 0)
            grid.addLayout(cell, at, 1)
            grid.addWidget(count, at, 2)
            if row.repair:
                button = theme.named(
                    QPushButton(row.verb), row.repair, REPAIRS[row.repair].label, role="link"
                )
                button.setToolTip(f"{REPAIRS[row.repair].label} (can be undone)")
                button.clicked.connect(
                    lambda _checked=False, name=row.repair: document.repair(name)
                )
                button.hide()
                self._buttons[row.attribute] = button
                cell.addWidget(button)
        follow(document.mesh_changed, self.refresh)
        follow(document.job_changed, self._refresh_buttons)
        theme.notifier().changed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show the open mesh's counts."""
        ready, colors = self._document.ready, theme.palette()
        for row in _ROWS:
            mark, count = self._marks[row.attribute], self._counts[row.attribute]
            if ready is None:
                mark.clear()
                count.setText("–")
                continue
            number = getattr(ready.health, row.attribute)
            count.setText(f"{number:,}")
            if row.attribute == "n_components":
                share = ready.health.largest_component / max(ready.health.n_vertices, 1)
                count.setToolTip(f"{row.tooltip}. The largest has {share:.1%} of the vertices")
            if row.fault:
                name, color = ("warning", colors.warning) if number else ("good", colors.good)
                mark.setPixmap(icons.pixmap(name, color, 14))
        self._refresh_buttons()

    def _refresh_buttons(self) -> None:
        ready = self._document.ready
        idle = self._document.job is None
        for row in _ROWS:
            if row.repair:
                todo = REPAIRS[row.repair].count(ready.health) if ready else 0
                self._buttons[row.attribute].setVisible(todo > 0)
                self._buttons[row.attribute].setEnabled(idle)

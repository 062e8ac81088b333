"""Table of the faults of a mesh, each with a button that repairs it."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.app.listening import follow
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.model.document import Document
from meshmash_viewer.units import format_share


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
        "ambiguous_edges", "Ambiguous edges",
        tooltip="Non-manifold edges where two faces lie in one direction, as duplicates do: the "
        "robust Laplacian depends on the order of faces there. Dropping duplicates removes most",
    ),
    _Row(
        "degenerate_faces", "Degenerate faces", "Drop", "drop_degenerate_faces",
        tooltip="Faces without area; the robust Laplacian takes them as they are",
    ),
    _Row(
        "duplicate_faces", "Duplicate faces", "Drop", "drop_duplicate_faces",
        tooltip="Faces with the same three vertices as another; the robust Laplacian depends on "
        "their order",
    ),
    _Row(
        "disagreeing_edges", "Disagreeing edges", "Turn faces", "orient_faces",
        tooltip="Edges of two faces that do not agree on which side is outside: mean curvature and "
        "shading are wrong there. On a surface with one side only they always are",
    ),
    _Row(
        "unreferenced_vertices", "Unreferenced vertices", "Drop", "drop_unreferenced_vertices",
        tooltip="Vertices of no face: they are left out, and have no value in any field",
    ),
    _Row(
        "seam_vertices", "Vertices on seams", "Merge", "merge_seams",
        tooltip="Where two open edges lie on one another, as between the chunks of a surface: "
        "nothing flows across until they are merged",
    ),
    _Row(
        "coincident_vertices", "Coincident vertices", "Merge all", "merge_coincident_vertices",
        tooltip="Vertices at exactly the place of another, on seams and where sheets touch; "
        "merging all of them joins such sheets",
    ),
)  # fmt: skip


class HealthTable(QWidget):
    """One row per count: a mark, its name, the number, and its repair.

    `second` says that it is that of the second mesh, and is named so.
    """

    def __init__(self, document: Document, *, second: bool = False) -> None:
        super().__init__()
        self._prefix, self._whose = ("second_", " of the second mesh") if second else ("", "")
        self.setObjectName(f"{self._prefix}health_table")
        self._document = document
        #: Mark, count, and button if there is a repair, of each row.
        self._rows = [(each, QLabel(), *self._controls(each)) for each in _ROWS]
        rows = []
        for each, mark, count, button in self._rows:
            text = QLabel(each.text)
            mark.setFixedSize(14, 18)
            for label in (mark, text, count):
                label.setToolTip(each.tooltip)
            # text and button share a cell, so that the longest of each need not stand side by side
            rows.append((mark, row(text, None, *([] if button is None else [button])), count))
        self.setLayout(grid(*rows, spacing=(theme.GAP, 1)))
        follow(document.mesh_changed, self.refresh)
        follow(document.work.changed, self._refresh_buttons)
        theme.notifier().changed.connect(self.refresh)
        self.refresh()

    def _controls(self, each: _Row) -> tuple[QLabel, QPushButton | None]:
        """The number of a row, and the button that repairs it."""
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        name = f"{self._prefix}health_{each.attribute}"
        count = make.label(name, f"{each.text}{self._whose}", "–", alignment=right)
        if not each.repair:
            return count, None
        label = REPAIRS[each.repair].label
        button = make.button(
            each.verb,
            f"{self._prefix}{each.repair}",
            f"{label}{self._whose}",
            lambda: self._document.repair(each.repair),
            role="link",
            tip=f"{label} (can be undone)",
        )
        button.hide()
        return count, button

    def refresh(self) -> None:
        """Show the counts of the open mesh."""
        ready, colors = self._document.ready, theme.palette()
        for each, mark, count, _ in self._rows:
            if ready is None:
                mark.clear()
                count.setText("–")
                continue
            number = getattr(ready.health, each.attribute)
            count.setText(f"{number:,}")
            if each.attribute == "n_components":
                share = ready.health.largest_component / max(ready.health.n_vertices, 1)
                count.setToolTip(
                    f"{each.tooltip}. The largest has {format_share(share)} of the vertices"
                )
            if each.fault:
                name, color = ("warning", colors.warning) if number else ("good", colors.good)
                mark.setPixmap(icons.pixmap(name, color, 14))
        self._refresh_buttons()

    def _refresh_buttons(self) -> None:
        ready, idle = self._document.ready, self._document.work.job is None
        for each, _, _, button in self._rows:
            if button is not None:
                todo = REPAIRS[each.repair].count(ready.health) if ready else 0
                button.setVisible(todo > 0)
                button.setEnabled(idle)

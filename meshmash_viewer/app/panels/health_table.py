"""Table of the faults of a mesh, with buttons that repair them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QLabel, QLayout, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.field_events import bring_into_view
from meshmash_viewer.app.controls.make import column, grid, note, row, show_note
from meshmash_viewer.app.executor import Call, Slot
from meshmash_viewer.app.listening import follow, later, listen
from meshmash_viewer.fault_places import FaultPlaces, fault_places, repair_effect
from meshmash_viewer.health import REPAIRS, described_components, first_repair
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.units import counted

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView
    from meshmash_viewer.app.view.surface import Marks

#: Places of faults, their marks, and a description of the repair.
_Found: TypeAlias = "tuple[FaultPlaces, Marks | None, str]"


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
        tooltip="Edges of more than two faces; the robust Laplacian is defined on them",
    ),
    _Row(
        "ambiguous_edges", "Ambiguous edges",
        tooltip="Non-manifold edges where two faces lie in one direction, as duplicates do: the "
        "robust Laplacian depends on the order of faces there. Dropping duplicates removes most",
    ),
    _Row(
        "degenerate_faces", "Degenerate faces", "Drop", "drop_degenerate_faces",
        tooltip="Faces without area; the robust Laplacian is defined on them",
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
        tooltip="Vertices of no face, which have no value in any field",
    ),
    _Row(
        "seam_vertices", "Vertices on seams", "Merge", "merge_seams",
        tooltip="Where two open edges lie on one another, as between the chunks of a surface: "
        "nothing flows across until they are merged",
    ),
    _Row(
        "coincident_vertices", "Coincident vertices", "Merge all", "merge_coincident_vertices",
        tooltip="Vertices at the place of another, on seams and where sheets touch; "
        "merging all of them joins such sheets",
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Question:
    """Request for the places of the faults in a row, and a description of their repair."""

    row: _Row
    mesh: Mesh
    repair: str


class HealthTable(QWidget):
    """Table with a row for each kind of fault: state, name, number, and a repair button.

    A click on a name marks the faults on the render, and describes their repair; another click or
    Escape removes the marks. If `second`, the table is for the second mesh, and its controls have
    other object names.
    """

    def __init__(self, document: Document, *, second: bool = False) -> None:
        super().__init__()
        self._prefix, self._whose = ("second_", " of the second mesh") if second else ("", "")
        self.setObjectName(f"{self._prefix}health_table")
        self._document = document
        #: The render on which faults are marked; None until it is loaded.
        self.scene: MeshView | None = None
        #: The row of the marked faults, their places once found, and index of the visible place.
        self._chosen: _Row | None = None
        self._places: FaultPlaces | None = None
        self._at = -1
        self._slot = Slot(self, "faults")
        #: For each row: description, mark, name, count, and repair button or None.
        self._rows = [(each, QLabel(), self._name(each), *self._controls(each)) for each in _ROWS]
        rows: list[tuple[QWidget | QLayout, ...]] = []
        for each, mark, name, count, button in self._rows:
            mark.setFixedSize(14, 18)
            for label in (mark, name, count):
                label.setToolTip(each.tooltip)
            # name and button share a cell: separate columns would be wider
            rows.append((mark, row(name, None, *([] if button is None else [button])), count))
        self.setLayout(grid(*rows, (self._build_steps(),), spacing=(theme.GAP, 1)))
        self._escape = QShortcut(QKeySequence("Esc"), self, self.end, enabled=False)
        listen(document.mesh_changed, self.end)
        follow(document.mesh_changed, self.refresh)
        follow(document.work.changed, self._refresh_buttons)
        theme.notifier().changed.connect(self.refresh)
        self.refresh()

    def _name(self, each: _Row) -> QPushButton:
        return make.button(
            each.text,
            f"{self._prefix}show_{each.attribute}",
            f"Show on the render: {each.text.lower()}{self._whose}",
            lambda: self._choose(each),
            role="name",
            checkable=True,
        )

    def _controls(self, each: _Row) -> tuple[QLabel, QPushButton | None]:
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        name = f"{self._prefix}health_{each.attribute}"
        count = make.label(name, f"{each.text}{self._whose}", "–", alignment=right)
        if not each.repair:
            return count, None
        button = make.button(
            each.verb,
            f"{self._prefix}{each.repair}",
            f"{REPAIRS[each.repair].label}{self._whose}",
            lambda: self._document.repair(self._repair(each)),
            role="link",
        )
        button.hide()
        button.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # hiding moves the focus of a click
        button.installEventFilter(self)
        return count, button

    def _build_steps(self) -> QWidget:
        prefix = self._prefix
        self._previous, self._next = (
            make.button(
                text, f"{prefix}health_{name}", f"The {name} place{self._whose}",
                lambda _=False, steps=steps: self._step(steps), role="segment",
                tip=f"Look at the {name} place",
            )
            for text, name, steps in (("‹", "previous", -1), ("›", "next", 1))
        )  # fmt: skip
        self._place_label = make.label(
            f"{prefix}health_place_label", "Which place is shown", role="muted"
        )
        self._effect_note = note(f"{prefix}health_effect_label")
        buttons = row(self._previous, self._next, (self._place_label,), spacing=6)
        self._steps = make.holder(column(buttons, self._effect_note, margins=(22, 4, 0, 4)))
        self._steps.hide()
        return self._steps

    # -- the marked row -------------------------------------------------------------------------

    def _choose(self, each: _Row) -> None:
        ready, ends = self._document.ready, self._chosen is each
        self.end()
        if ends or ready is None:
            return
        self._chosen = each
        self._place_label.setText("Searching …")
        self._steps.show()
        self._ask(each, ready)
        self._refresh_buttons()

    def _ask(self, each: _Row, ready: MeshReady) -> None:
        asked = _Question(each, ready.mesh, self._repair(each))
        self._slot.submit(partial(_found, asked), partial(self._take, asked), self._fail)

    def _repair(self, each: _Row) -> str:
        """Return the repair of the button in a row: a merge, if the components touch."""
        ready = self._document.ready
        return first_repair(each.repair, ready.health) if ready else each.repair

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Request the tooltip of a repair once the pointer or the focus enters its button."""
        ready, waits = self._document.ready, self._chosen is not None and self._places is None
        enters = event.type() in (QEvent.Type.Enter, QEvent.Type.FocusIn)
        if enters and ready is not None and not waits:
            for each, *_, button in self._rows:
                if button is watched:
                    self._ask(each, ready)
        return super().eventFilter(watched, event)

    def end(self) -> None:
        """Remove the marks."""
        if self._chosen is None:
            return
        self._chosen, self._places, self._at = None, None, -1
        self._slot.drop()
        if self.scene is not None:
            self.scene.set_marks(None)
        self._steps.hide()
        show_note(self._effect_note, "")
        self._refresh_buttons()

    def _fail(self, fault: Exception) -> None:
        self.end()
        raise fault

    def _take(self, question: _Question, found: _Found) -> None:
        ready, each = self._document.ready, question.row
        if ready is None or question.mesh is not ready.mesh:
            return
        places, marks, effect = found
        for other, *_, button in self._rows:
            if other is each and button is not None and effect:
                label = REPAIRS[question.repair].label
                button.setToolTip(f"{label}: {effect} (can be undone)")
        if each is not self._chosen:
            return
        self._places = places
        if self.scene is not None:
            self.scene.set_marks(marks)
        if effect:
            show_note(self._effect_note, f"{_verb(question.row, question.repair)}: {effect}.")
        self._show_place()
        later(self._bring_into_view)
        self._refresh_buttons()

    def _bring_into_view(self) -> None:
        bring_into_view(self._steps)

    def _step(self, steps: int) -> None:
        """Move the camera to a following or preceding place, cyclically."""
        places = self._places
        if places is None or self.scene is None or not places.n_groups:
            return
        first = self._at < 0 and steps < 0
        self._at = (self._at + steps + first) % places.n_groups
        self.scene.look_at(np.unique(places.group(self._at)))
        self._show_place()

    def _show_place(self) -> None:
        places = self._places
        if places is None or not places.n_groups:
            text = "None"
        elif self._at < 0:
            text = counted(places.n_groups, "place")
        else:
            text = f"{self._at + 1:,} of {places.n_groups:,}: {places.describe(self._at)}"
        self._place_label.setText(text)

    # -- the counts ---------------------------------------------------------------------------

    def refresh(self) -> None:
        ready, colors = self._document.ready, theme.palette()
        for each, mark, _, count, _ in self._rows:
            if ready is None:
                mark.clear()
                count.setText("–")
                continue
            number = getattr(ready.health, each.attribute)
            count.setText(f"{number:,}")
            if each.attribute == "n_components":
                count.setToolTip(f"{each.tooltip}. {described_components(ready.health)}")
            if each.fault:
                name, color = ("warning", colors.warning) if number else ("good", colors.good)
                mark.setPixmap(theme.pixmap(name, color, 14))
        self._refresh_buttons()

    def _refresh_buttons(self) -> None:
        ready, idle = self._document.ready, self._document.work.job is None
        for each, _, name, _, button in self._rows:
            least = 1 if each.attribute == "n_components" else 0
            name.setEnabled(ready is not None and getattr(ready.health, each.attribute) > least)
            name.setChecked(each is self._chosen)
            if button is not None:
                todo = REPAIRS[each.repair].count(ready.health) if ready else 0
                repair = self._repair(each)
                button.setText(_verb(each, repair))
                button.setToolTip(f"{REPAIRS[repair].label} (can be undone)")
                button.setVisible(todo > 0)
                button.setEnabled(idle)
        for step in (self._previous, self._next):
            step.setEnabled(self._places is not None and self._places.n_groups > 0)
        # while a job runs, Escape cancels the job
        self._escape.setEnabled(self._chosen is not None and idle)


def _verb(each: _Row, repair: str) -> str:
    """Return the text of the button that makes a repair in a row."""
    return next(row.verb for row in (each, *_ROWS) if row.repair == repair)


def _found(question: _Question, call: Call) -> _Found:
    from meshmash_viewer.app.view.surface import Marks

    row, mesh = question.row, question.mesh
    places = fault_places(mesh, row.attribute)
    marks = Marks(places.parts) if len(places.parts) else None
    if call.superseded():
        raise Cancelled
    effect = repair_effect(mesh, question.repair) if question.repair else ""
    return places, marks, effect

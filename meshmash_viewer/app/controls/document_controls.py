"""Combo box for the unit of a mesh, and a button that computes missing eigenpairs."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QFocusEvent
from PySide6.QtWidgets import QComboBox, QLineEdit, QPushButton, QSlider

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import follow
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.spectral import cost
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import LENGTH_UNITS, counted

#: Smallest and largest width of a `UnitCombo` in pixels.
_NARROWEST, _WIDEST = 144, 216


class UnitCombo(QComboBox):
    """Editable combo box for the unit of a document; `second` for the second mesh."""

    def __init__(self, document: Document, *, second: bool = False) -> None:
        super().__init__(editable=True, insertPolicy=QComboBox.InsertPolicy.NoInsert)
        # PySide6 may mistake Qt's own line edit for a deleted object of the same address
        self._edit = edit = QLineEdit()
        self.setLineEdit(edit)
        prefix, whose = ("second_", " of the second mesh") if second else ("", "")
        theme.named(
            self,
            f"{prefix}unit_combo",
            f"Unit of the coordinates{whose}",
            tip="Unit of the coordinates in the file; or the size of a voxel, such as “8 nm” or "
            "“4 × 4 × 40 nm”, by which coordinates counted in voxels are multiplied",
        )
        self._document, self._refused, self._clicked_in = document, False, False
        # the last two entries are examples: any voxel size can be typed
        self.addItems([*(unit or "none" for unit in LENGTH_UNITS), "8 nm", "4 × 4 × 40 nm"])
        # a completer would turn "m" into "mm"
        self.setCompleter(None)  # type: ignore[arg-type]  # None is documented
        edit.installEventFilter(self)
        edit.editingFinished.connect(self._choose)
        edit.textEdited.connect(self._begin)
        self.activated.connect(self._choose)
        follow(document.mesh_changed, self.refresh)
        self.refresh()

    def focusInEvent(self, event: QFocusEvent) -> None:
        self._clicked_in = event.reason() == Qt.FocusReason.MouseFocusReason
        super().focusInEvent(event)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Select the text after the click that gave the focus, so that typing replaces it."""
        if event.type() == QEvent.Type.MouseButtonRelease and self._clicked_in:
            self._clicked_in = False
            if not self._edit.hasSelectedText():
                QTimer.singleShot(0, self._edit, self._edit.selectAll)
        return super().eventFilter(watched, event)

    def _choose(self, _row: int = 0) -> None:
        text, ready = self.currentText().strip(), self._document.ready
        if ready is None or text == self._document.unit_text:
            return
        try:
            self._document.set_unit(text)
        except InputError as fault:
            self._refused = True
            self._document.notices.show(
                Notice(
                    str(fault),
                    Severity.ERROR,
                    holds=lambda: self._refused and self._document.ready is ready,
                )
            )
        self.refresh()

    def _begin(self) -> None:
        """Withdraw the notice of an invalid unit when another text is typed."""
        self._refused = False
        self._document.notices.review()

    def refresh(self) -> None:
        self.setEnabled(self._document.ready is not None)
        text = "none" if self._document.ready is None else self._document.unit_text
        self.setCurrentText(text)
        self._edit.setCursorPosition(0)
        wide = self.fontMetrics().horizontalAdvance(text) + 58
        self.setFixedWidth(min(max(wide, _NARROWEST), _WIDEST))


def written_cost(document: Document, target: Target) -> str:
    """Return the expected memory and time of a solve: "about 1.2 GB of memory and 12 s"."""
    assert document.solved is not None
    pairs, _ = document.solve.translation().count(target)
    n_bytes = cost.decomposition_bytes(document.solved.health.n_vertices, pairs)
    time = cost.written_duration(document.solve.expected_seconds(target))
    return f"about {cost.written_bytes(n_bytes)} of memory and {time}"


def undone_as_one(slider: QSlider, document: Document) -> None:
    """Make all changes during a drag of a slider one step of the history."""
    slider.sliderPressed.connect(document.history.hold)
    slider.sliderReleased.connect(document.history.end_gesture)


class ComputeButton(QPushButton):
    """Button that computes the eigenpairs missing for a field; hidden without a target."""

    def __init__(self, document: Document, name: str) -> None:
        super().__init__()
        theme.named(self, name, "Compute these pairs", role="link")
        self._document = document
        self._target: Target | None = None
        self.hide()
        self.clicked.connect(self._compute)
        follow(document.work.changed, self._refresh)

    def show_target(self, target: Target | None) -> None:
        self._target = target
        self._refresh()

    def _refresh(self) -> None:
        target, document = self._target, self._document
        offered = target is not None and document.ready is not None
        if target is not None and offered:
            count, exact = document.solve.translation().count(target)
            which = "all" if count >= document.solve.translation().n_vertices else "these"
            about = "" if exact or which == "all" else "≈ "
            self.setText(f"Compute {which} {about}{counted(count, 'pair')}")
            self.setAccessibleName(self.text())
            self.setToolTip(f"Takes {written_cost(document, target)}")
            self.setEnabled(document.work.job is None)
        self.setVisible(offered)

    def _compute(self) -> None:
        if self._target is not None:
            self._document.solve.target = self._target
            self._document.solve.compute()

"""The unit of the coordinates of a mesh, chosen or typed."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QFocusEvent
from PySide6.QtWidgets import QComboBox, QLineEdit

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import follow
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.units import LENGTH_UNITS

#: Width in pixels, from that of "nm" to that of "4 × 4 × 40 nm" and longer ones.
_NARROWEST, _WIDEST = 144, 216


class UnitCombo(QComboBox):
    """Shows and sets the unit of a document; `second` says that it is that of the second mesh."""

    def __init__(self, document: Document, *, second: bool = False) -> None:
        super().__init__(editable=True, insertPolicy=QComboBox.InsertPolicy.NoInsert)
        # PySide6 may know that of Qt as an object of the same address that is gone
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
        # the last ones show that a voxel size can be said too, whichever it is
        self.addItems([*(unit or "none" for unit in LENGTH_UNITS), "8 nm", "4 × 4 × 40 nm"])
        # of "m" it would make "mm"
        self.setCompleter(None)  # type: ignore[arg-type]  # as documented
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
        """Select all at the end of the click that gave the focus, to be typed over."""
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
        """Withdraw a refusal when another text is typed."""
        self._refused = False
        self._document.notices.review()

    def refresh(self) -> None:
        """Write the unit, from its beginning and in the width that it takes."""
        self.setEnabled(self._document.ready is not None)
        text = "none" if self._document.ready is None else self._document.unit_text
        self.setCurrentText(text)
        self._edit.setCursorPosition(0)
        wide = self.fontMetrics().horizontalAdvance(text) + 58
        self.setFixedWidth(min(max(wide, _NARROWEST), _WIDEST))

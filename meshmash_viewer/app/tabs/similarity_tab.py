"""Controls of "similar to this": from which pinned vertex, and in which features."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QComboBox, QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.segments import Segments
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.tabs.field_stepper import FamilyTab
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.document import Document, Pin
from meshmash_viewer.units import counted, named_vertex

__all__ = ["SimilarityTab"]


class SimilarityTab(FamilyTab):
    """Paint how far every vertex is from a pinned one in feature space; follows the last pin."""

    family = Similarity
    icon = (
        '<circle cx="12" cy="12" r="8.5"/><circle cx="12" cy="12" r="4.5"/><path d="M12 11.8v.4"/>'
    )

    def __init__(self, document: Document) -> None:
        self._pins: tuple[Pin, ...] = ()
        super().__init__(document)
        listen(document.pins_changed, self._follow_pins)
        self._follow_pins()

    def _build(self) -> None:
        self.hint = note("similarity_hint")
        self.combo = theme.named(
            QComboBox(), "similarity_vertex_combo", "Pinned vertex to measure from"
        )
        self.combo.activated.connect(self._choose)
        above = theme.with_role(QLabel("From pinned vertex"), "muted")
        above.setBuddy(self.combo)
        self.basis = Segments(
            "similarity_basis",
            "Features to measure in",
            {name: family.short for name, family in FEATURES.items()},
        )
        self.basis.chosen.connect(self._choose_basis)
        self.explanation = note("similarity_explanation")
        self._fill(
            "similarity_label",
            "",
            above,
            self.combo,
            theme.with_role(QLabel("Distance measured in"), "muted"),
            self.basis,
            self.explanation,
            self.hint,
        )

    # -- from the person --------------------------------------------------------------------

    def _choose(self, row: int) -> None:
        self._change(vertex=self._document.pins[row].vertex)

    def _choose_basis(self, key: str) -> None:
        self._change(basis=key)

    # -- from the model ---------------------------------------------------------------------

    def _follow_pins(self) -> None:
        """Measure from the newest pin; from the last one left where its pin was taken away."""
        pins, vertex = self._document.pins, self._document.display[Similarity].vertex
        before = {pin.vertex for pin in self._pins}
        self._pins = pins
        vertices = [pin.vertex for pin in pins]
        if vertices and (vertices[-1] not in before or vertex not in vertices):
            self._change(vertex=vertices[-1])
        elif not vertices:
            self._change(vertex=None)
        with QSignalBlocker(self.combo):
            self.combo.clear()
            for pin in pins:
                swatch = QPixmap(12, 12)
                swatch.fill(QColor(pin.color))
                text = f"{pin.number} · {named_vertex(pin.vertex).capitalize()}"
                self.combo.addItem(QIcon(swatch), text)
        self.refresh()

    def refresh(self) -> None:
        """Show what the model holds."""
        display, pins = self._document.display, self._document.pins
        chosen = display[Similarity]
        vertex = chosen.vertex
        row = next((row for row, pin in enumerate(pins) if pin.vertex == vertex), -1)
        self.combo.setCurrentIndex(row)
        self.combo.setEnabled(bool(pins))
        which = "a vertex" if vertex is None or row < 0 else named_vertex(vertex)
        self.title.setText(f"Similar to {which}")
        show_note(self.hint, "" if pins else "Click a vertex on the render to pin it.")
        self.basis.show_key(chosen.basis)
        features = display.fields[chosen.basis]
        count = getattr(features, features.counted)
        show_note(
            self.explanation,
            f"Over the {counted(count, 'column')} of the {features.short} tab, each in units of its"
            " spread; 0 is alike, larger is less so.",
        )

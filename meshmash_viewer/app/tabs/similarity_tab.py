"""Controls of "similar to this": from which pinned vertex, and in which features."""

from __future__ import annotations

from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QComboBox, QLabel, QVBoxLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.segments import Segments
from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.model.display import FieldKind, SimilarityBasis
from meshmash_viewer.model.document import Document, Pin

__all__ = ["SimilarityTab"]


class SimilarityTab(QWidget):
    """Paint how far every vertex is from a pinned one in feature space; follows the last pin."""

    kind = FieldKind.SIMILARITY

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._pins: tuple[Pin, ...] = ()
        self._build()
        follow(document.spectrum_changed, self.refresh)
        listen(document.pins_changed, self._follow_pins)
        follow(document.display.events, self.refresh)
        self._follow_pins()

    def _build(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(theme.MARGIN, theme.MARGIN, theme.MARGIN, theme.GAP)
        column.setSpacing(theme.GAP)
        self.title = theme.with_role(QLabel(self), "title")
        self.title.setObjectName("similarity_label")
        column.addWidget(self.title)
        self.hint = note("similarity_hint", "muted", self)
        column.addWidget(self.hint)
        self.vertex_label = theme.with_role(QLabel("From pinned vertex", self), "muted")
        self.combo = QComboBox(self)
        self.combo.setObjectName("similarity_vertex_combo")
        self.combo.setAccessibleName("Pinned vertex to measure from")
        self.combo.activated.connect(self._choose)
        self.vertex_label.setBuddy(self.combo)
        column.addWidget(self.vertex_label)
        column.addWidget(self.combo)
        column.addWidget(theme.with_role(QLabel("Distance measured in", self), "muted"))
        self.basis = Segments(
            "similarity_basis",
            "Features to measure in",
            {SimilarityBasis.HKS: "HKS", SimilarityBasis.BANDS: "Geometry vectors"},
            self,
        )
        self.basis.chosen.connect(self._choose_basis)
        column.addWidget(self.basis)
        self.explanation = note("similarity_explanation", "muted", self)
        column.addWidget(self.explanation)
        column.addStretch(1)

    # -- from the person --------------------------------------------------------------------

    def _choose(self, row: int) -> None:
        self._document.display.similarity_vertex = self._document.pins[row].vertex

    def _choose_basis(self, key: str) -> None:
        self._document.display.similarity_basis = SimilarityBasis(key)

    # -- from the model ---------------------------------------------------------------------

    def _follow_pins(self) -> None:
        """Measure from the newest pin; from the last one left where its pin was taken away."""
        pins, display = self._document.pins, self._document.display
        before = {pin.vertex for pin in self._pins}
        self._pins = pins
        vertices = [pin.vertex for pin in pins]
        if vertices and (vertices[-1] not in before or display.similarity_vertex not in vertices):
            display.similarity_vertex = vertices[-1]
        elif not vertices:
            display.similarity_vertex = None
        blocked = self.combo.blockSignals(True)
        self.combo.clear()
        for pin in pins:
            swatch = QPixmap(12, 12)
            swatch.fill(QColor(pin.color))
            self.combo.addItem(QIcon(swatch), f"Vertex {pin.vertex:,}")
        self.combo.blockSignals(blocked)
        self.refresh()

    def refresh(self) -> None:
        """Show what the model holds."""
        display, pins = self._document.display, self._document.pins
        vertex = display.similarity_vertex
        row = next((row for row, pin in enumerate(pins) if pin.vertex == vertex), -1)
        self.combo.setCurrentIndex(row)
        self.combo.setEnabled(bool(pins))
        self.title.setText("Similar to a vertex" if row < 0 else f"Similar to vertex {vertex:,}")
        show_note(self.hint, "" if pins else "Click a vertex on the render to pin it.")
        self.basis.show_key(display.similarity_basis)
        what = (
            f"{display.hks_scales} times of the HKS tab"
            if display.similarity_basis is SimilarityBasis.HKS
            else f"{display.band_count} bands of the Geometry vectors tab"
        )
        show_note(
            self.explanation,
            f"Over the {what}, each in units of its spread; 0 is alike, larger is less so.",
        )

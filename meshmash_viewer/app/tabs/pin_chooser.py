"""What the tabs of families have in common that measure from a pinned vertex."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QComboBox, QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.layout import Part
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.model.document import Document, Pin
from meshmash_viewer.units import named_vertex

__all__ = ["PinChooser"]


class PinChooser(FieldStepper):
    """A tab of a family with a `vertex`, which follows the newest pin."""

    def __init__(self, document: Document) -> None:
        self._pins: tuple[Pin, ...] = ()
        super().__init__(document)
        listen(document.pins_changed, self._follow_pins)
        self._follow_pins()

    def _make_pin_choice(self) -> tuple[Part, ...]:
        name = self.family.name
        self.hint = note(f"{name}_hint")
        self.combo = theme.named(
            QComboBox(), f"{name}_vertex_combo", "Pinned vertex to measure from"
        )
        self.combo.activated.connect(self._choose_pin)
        above = theme.with_role(QLabel("From pinned vertex"), "muted")
        above.setBuddy(self.combo)
        return above, self.combo

    def _choose_pin(self, row: int) -> None:
        self._change(vertex=self._document.pins[row].vertex)

    def _follow_pins(self) -> None:
        """Measure from the newest pin; from the last one left where its pin was taken away."""
        pins = self._document.pins
        vertex: int | None = getattr(self._document.display[self.family], "vertex")  # noqa: B009
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

    def _show_pin(self, vertex: int | None) -> str:
        """Show from which pin is measured, and say which vertex that is."""
        pins = self._document.pins
        row = next((row for row, pin in enumerate(pins) if pin.vertex == vertex), -1)
        self.combo.setCurrentIndex(row)
        self.combo.setEnabled(bool(pins))
        show_note(self.hint, "" if pins else "Click a vertex on the render to pin it.")
        return "a vertex" if vertex is None or row < 0 else named_vertex(vertex)

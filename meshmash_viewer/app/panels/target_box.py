"""How much of the spectrum to compute: by count, eigenvalue, wavelength, or time of the HKS."""

from __future__ import annotations

from typing import Any, NamedTuple

from PySide6.QtWidgets import (
    QButtonGroup,
    QRadioButton,
    QScrollArea,
    QSizePolicy,
    QStackedLayout,
    QWidget,
)

from meshmash_viewer import units
from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.layout import grid
from meshmash_viewer.app.controls.number_box import CountBox, QuantityBox, dress
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.weyl import Target, Translation, resolved_time, wavelength
from meshmash_viewer.units import format_range, power_unit

__all__ = ["TargetBox"]

#: Most eigenpairs while no mesh says how many it has.
_MOST = 100_000


class _Way(NamedTuple):
    """One way to say it: what is before its field, what that is called, its unit, what it means."""

    text: str
    name: str
    accessible: str
    power: int
    tip: str


_WAYS = {
    "count": _Way(
        "Eigenpairs", "count", "Number of eigenpairs", 0, "That many of the lowest eigenpairs"
    ),
    "max_eigenvalue": _Way(
        "Largest λ", "eigenvalue", "Largest eigenvalue", -2,
        "Every eigenpair up to this eigenvalue; the count is then exact",
    ),
    "wavelength": _Way(
        "Shortest wave", "wavelength", "Shortest wavelength", 1,
        "Every eigenfunction with at least this wavelength 2π/√λ: "
        "the smallest detail that is told apart",
    ),
    "time": _Way(
        "Shortest time", "time", "Shortest time of the heat kernel signature", 2,
        "As many eigenpairs as heat kernel signatures from this time on take, "
        "so that less than 1 % of them is missing",
    ),
}  # fmt: skip


class TargetBox(QWidget):
    """Four ways to say one thing; what is typed in one is translated live into the others.

    The way that was edited last is the target, the others are estimates by Weyl's law.
    """

    def __init__(self, document: Document) -> None:
        super().__init__()
        self.setObjectName("target_box")
        self._document = document
        self._refused = "", ""
        self.count_spin = CountBox()
        self._limit_count(_MOST)
        self.count_spin.setSingleStep(10)
        self._boxes: dict[str, QuantityBox] = {}
        self._radios: dict[str, QRadioButton] = {}
        group = QButtonGroup(self)
        for kind, way in _WAYS.items():
            radio, box = QRadioButton(way.text), self.count_spin if not way.power else QuantityBox()
            by = f"Compute by {way.text.lower()}"
            theme.named(radio, f"target_{kind}_radio", by, tip=way.tip)
            theme.named(box, f"target_{way.name}_spin", way.accessible, tip=way.tip)
            # as wide as the panel, not as the longest number there is
            box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            box.setMinimumWidth(132)
            group.addButton(radio)
            self._radios[kind], self._boxes[kind] = radio, box
            radio.clicked.connect(lambda _checked=False, kind=kind: self._choose(kind))
            box.valueChanged.connect(lambda _value, kind=kind: self._choose(kind))
            box.refused.connect(lambda number, kind=kind: self._refuse(kind, number))
        _, self.eigenvalue_spin, self.wavelength_spin, self.time_spin = self._boxes.values()
        self.note = reserved_note("weyl_note", 3, "muted", "About the estimates")
        self.fault = reserved_note("target_fault", 3)
        self._told = QStackedLayout()  # one or the other: nothing moves
        self._told.addWidget(self.note)
        self._told.addWidget(self.fault)
        rows = zip(self._radios.values(), self._boxes.values(), strict=True)
        self.setLayout(grid(*rows, (self._told,), spacing=(theme.GAP, 6)))
        follow(document.mesh_changed, self._forgive)
        follow(document.mesh_changed, self.refresh)
        follow(document.settings_changed, self.refresh)
        follow(document.spectrum_changed, self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show the document's target, and its translations where there is a mesh."""
        target, ready = self._document.target, self._document.ready
        self._radios[target.kind].setChecked(True)
        self.setEnabled(ready is not None)
        for kind, way in _WAYS.items():
            written = power_unit(self._document.unit, way.power) if way.power else ""
            box = self._boxes[kind]
            dress(box, box.prefix(), f" {written}" if written else "")
        if ready is None or not ready.health.area > 0.0:
            for box in self._boxes.values():
                box.show_nothing()
            self.count_spin.show_quantity(max(1, int(Translation(1.0).count(target)[0])))
            self.note.setText("All four say the same thing: each is translated into the others.")
            return
        translation = self._document.translation()
        low, high = translation.bounds
        self._limit_count(self._most)
        self.eigenvalue_spin.bounds = low, high
        self.wavelength_spin.bounds = wavelength(high), wavelength(low)
        self.time_spin.bounds = resolved_time(high), resolved_time(low)
        count, counted = translation.count(target)
        shown = {
            "count": (float(max(int(count), 1)), counted),
            "max_eigenvalue": translation.eigenvalue(target),
            "wavelength": translation.wavelength(target),
            "time": translation.time(target),
        }
        for kind, (value, exact) in shown.items():
            box = self._boxes[kind]
            dress(box, "" if exact else "≈ ", box.suffix())
            # the box being typed in is left alone, so that the text under the cursor stays
            if target.kind != kind or not box.hasFocus():
                box.show_quantity(value)
        zeros = ready.health.n_components
        parts = [f"{zeros:,} of them are zero, one a component."] if zeros > 1 else []
        if count >= translation.n_vertices:
            parts.append("The mesh has no more eigenpairs.")
        if not all(exact for _, exact in shown.values()):
            parts.append(
                "≈ by Weyl's law, onwards from the last known eigenvalue."
                if len(translation.eigenvalues)
                else "≈ by Weyl's law, within a factor of two; of ten for the first hundred pairs "
                "of thin branches."
            )
        self.note.setText(" ".join(parts))
        self._show_note()

    @property
    def _most(self) -> int:
        """Number of eigenpairs that there are."""
        ready = self._document.ready
        if ready is None:
            return _MOST
        return max(ready.health.n_vertices - ready.health.unreferenced_vertices, 1)

    def _limit_count(self, most: int) -> None:
        self.count_spin.setRange(1, most)
        self.count_spin.bounds = (1, most)

    def _refuse(self, kind: str, number: float) -> None:
        """Say at the field why this mesh cannot have what was typed."""
        most = self._most
        if kind == "count" and number > most:
            all_pairs = units.counted(most, "eigenpair")
            text = f"This mesh has {units.counted(most, 'vertex')}, and so at most {all_pairs}."
        elif kind == "count":
            text = "The number of eigenpairs is a whole number from 1."
        else:
            box = self._boxes[kind]
            name = {"max_eigenvalue": "Eigenvalues", "wavelength": "Waves", "time": "Times"}[kind]
            between = format_range(*box.bounds, box.suffix().strip(), word="and", digits=1)
            text = f"{name} of this mesh lie between about {between}."
        self._refused = kind, text
        later(self._show_reason)  # Qt tells the number that it takes instead, which is no mending

    def _show_reason(self) -> None:
        kind, text = self._refused
        self.fault.setText(text)
        self._show_note()
        self._boxes[kind].selectAll()
        parent = self.parentWidget()
        while parent is not None and not isinstance(parent, QScrollArea):
            parent = parent.parentWidget()
        if parent is not None:
            if (layout := self.window().layout()) is not None:
                layout.activate()
            parent.ensureWidgetVisible(self.fault, 0, theme.GAP)

    def _forgive(self) -> None:
        self.fault.setText("")
        self._show_note()

    def _show_note(self) -> None:
        self._told.setCurrentIndex(1 if self.fault.text() else 0)

    def _choose(self, kind: Any) -> None:
        self._forgive()
        box = self._boxes[kind]
        try:
            self._document.target = Target(kind, float(box.value()))
        except InputError:
            # half-typed; the next digit mends it
            return

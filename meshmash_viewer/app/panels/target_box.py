"""Target of the decomposition: number of pairs, eigenvalue, wavelength, or time of the HKS."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QButtonGroup,
    QRadioButton,
    QSizePolicy,
    QStackedLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.field_events import bring_into_view
from meshmash_viewer.app.controls.make import grid, reserved_note
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.errors import InputError
from meshmash_viewer.health import first_repair
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.weyl import Target, Translation, resolved_time, wavelength
from meshmash_viewer.units import counted, format_range, format_share, power_unit

#: Share of zero eigenvalues from which the removal of small components is offered.
_MANY_ZEROS = 0.1
#: Largest number of eigenpairs while no mesh is open.
_MOST = 100_000


def quarter_steps(value: float, steps: int) -> float:
    """Multiply a number by 2^(steps / 4), for spin boxes with numbers of any size."""
    return value * float(2.0 ** (steps / 4.0))


class _Way(NamedTuple):
    """A quantity: text before its field, object name, accessible name, power of length, tooltip."""

    text: str
    name: str
    spoken: str
    power: int
    tip: str
    #: Plural noun for the message on its bounds.
    values: str = ""


_WAYS = {
    "count": _Way(
        "Eigenpairs", "count", "Number of eigenpairs", 0, "This number of the lowest eigenpairs"
    ),
    "max_eigenvalue": _Way(
        "Largest λ", "eigenvalue", "Largest eigenvalue", -2,
        "Every eigenpair up to this eigenvalue; the count is then exact",
        "Eigenvalues",
    ),
    "wavelength": _Way(
        "Shortest wave", "wavelength", "Shortest wavelength", 1,
        "Every eigenfunction with at least this wavelength 2π/√λ: "
        "the smallest detail that is resolved",
        "Waves",
    ),
    "time": _Way(
        "Shortest time", "time", "Shortest time of the heat kernel signature", 2,
        "As many eigenpairs as heat kernel signatures from this time on take, "
        "so that less than 1 % of them is missing",
        "Times",
    ),
}  # fmt: skip


class TargetBox(QWidget):
    """Controls of the target in four quantities; an edit of one updates the other three.

    The quantity that was edited last is the target; the other three are estimated by Weyl's law.
    """

    def __init__(self, document: Document) -> None:
        super().__init__()
        self.setObjectName("target_box")
        self._document = document
        self._kept = document.solve.target
        self._fields: dict[str, NumberField] = {}
        self._radios: dict[str, QRadioButton] = {}
        group = QButtonGroup(self)
        for kind, way in _WAYS.items():
            whole = not way.power
            field = NumberField(
                f"target_{way.name}_spin",
                way.spoken,
                step=(lambda value, steps: value + 10 * steps) if whole else quarter_steps,
                live=True,
                whole=whole,
                tip=way.tip,
            )
            # the width of the panel, not of the longest possible number
            field.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            field.setMinimumWidth(132)
            field.bounds = 1.0, _MOST if whole else 1e150
            field.fault = partial(self._fault, kind)
            field.edited.connect(partial(self._choose, kind))
            field.refused.connect(self._say)
            field.begun.connect(self._keep)
            field.withdrawn.connect(self._restore)
            radio = QRadioButton(way.text)
            by = f"Compute by {way.text.lower()}"
            theme.named(radio, f"target_{kind}_radio", by, tip=way.tip)
            radio.clicked.connect(partial(self._choose, kind))
            group.addButton(radio)
            self._radios[kind], self._fields[kind] = radio, field
        self.count_spin, self.eigenvalue_spin, self.wavelength_spin, self.time_spin = (
            self._fields.values()
        )
        self.note = reserved_note("weyl_note", 3, "muted", "About the estimates")
        self.fault = reserved_note("target_fault", 3)
        self.keep_button = make.button(
            "Keep largest and compute",  # no wider than the panel at its narrowest
            "keep_largest_and_compute",
            "Keep the largest component and compute",
            lambda: document.repair(self._first_repair(), then_compute=True),
            role="link",
        )
        self.keep_button.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click hides the button
        self.keep_button.hide()
        self._note_stack = QStackedLayout()  # note and fault share one place, so that nothing moves
        self._note_stack.addWidget(self.note)
        self._note_stack.addWidget(self.fault)
        rows = zip(self._radios.values(), self._fields.values(), strict=True)
        below = (self._note_stack,), (self.keep_button,)
        self.setLayout(grid(*rows, *below, spacing=(theme.GAP, 6)))
        follow(document.mesh_changed, self._clear_fault)
        signals = document.mesh_changed, document.solve.changed, document.spectrum_changed
        follow((*signals, document.work.changed), self.refresh)
        self.refresh()

    def refresh(self) -> None:
        target, ready = self._document.solve.target, self._document.solved
        self._radios[target.kind].setChecked(True)
        self.setEnabled(ready is not None)
        self.keep_button.setVisible(False)
        if ready is None or not ready.health.area > 0.0:
            self._show(dict.fromkeys(_WAYS, (None, True)))
            self.count_spin.show_value(max(1, int(Translation(1.0).count(target)[0])))
            self.note.setText("Each of the four numbers is computed from the others.")
            return
        translation = self._document.solve.translation()
        low, high = translation.bounds
        self.count_spin.bounds = 1, self._most
        self.eigenvalue_spin.bounds = low, high
        self.wavelength_spin.bounds = wavelength(high), wavelength(low)
        self.time_spin.bounds = resolved_time(high), resolved_time(low)
        count, exact_count = translation.count(target)
        shown = {
            "count": (float(max(int(count), 1)), exact_count),
            "max_eigenvalue": translation.eigenvalue(target),
            "wavelength": translation.wavelength(target),
            "time": translation.time(target),
        }
        self._show(shown)
        zeros = ready.health.n_components
        parts = [f"{zeros:,} of them are zero, one per component."] if zeros > 1 else []
        self._offer_largest(ready, count)
        if count >= translation.n_vertices:
            parts.append("The mesh has no more eigenpairs.")
        if not all(exact for _, exact in shown.values()):
            parts.append(
                "≈: extrapolated by Weyl's law from the last known eigenvalue."
                if len(translation.eigenvalues)
                else "≈: estimated by Weyl's law, within a factor of 2, or of 10 for the first "
                "hundred pairs of thin branches."
            )
        self.note.setText(" ".join(parts))
        self._show_note()

    def _offer_largest(self, ready: MeshReady, count: float) -> None:
        """Offer to keep the largest component if the others account for many of the pairs."""
        others, health = ready.health.n_components - 1, ready.health
        left = health.n_vertices - health.unreferenced_vertices - health.largest_component
        share = format_share(1.0 - health.largest_area / health.area)
        what = f"{counted(others, 'component')} with {counted(left, 'vertex')}, {share} of the area"
        merges = self._first_repair() != "keep_largest_component"
        if merges:
            what = f"components that touch: {health.untouching_components:,} are left"
        text, verb = ("Merge", "Merges") if merges else ("Keep largest", "Drops")
        self.keep_button.setText(f"{text} and compute")
        self.keep_button.setToolTip(f"{verb} {what}; then computes; can be undone")
        offered = self._document.part_mesh is None and others > 0 and others >= _MANY_ZEROS * count
        self.keep_button.setVisible(offered and (merges or left < health.largest_component))
        self.keep_button.setEnabled(self._document.work.job is None)

    def _first_repair(self) -> str:
        ready = self._document.solved
        name = "keep_largest_component"
        return name if ready is None else first_repair(name, ready.health)

    def _show(self, shown: Mapping[str, tuple[float | None, bool]]) -> None:
        """Show numbers, with "≈" before estimates."""
        for kind, (value, exact) in shown.items():
            power = _WAYS[kind].power
            unit = power_unit(self._document.unit, power) if power else ""
            prefix = "" if exact else "≈ "
            self._fields[kind].show_value(value, unit, prefix, with_unit=True)

    @property
    def _most(self) -> int:
        return _MOST if self._document.ready is None else max(self._document.solve.n_vertices, 1)

    def _fault(self, kind: str, number: float) -> str:
        most, (low, high) = self._most, self._fields[kind].bounds
        if kind != "count":
            unit = power_unit(self._document.unit, _WAYS[kind].power)
            between = format_range(low, high, unit, word="and", digits=1)
            text = f"{_WAYS[kind].values} of this mesh lie between about {between}."
            return "" if low <= number <= high else text
        if number > most:
            all_pairs = counted(most, "eigenpair")
            return f"This mesh has {counted(most, 'vertex')}, and so at most {all_pairs}."
        whole = number >= 1 and number == int(number)
        return "" if whole else "The number of eigenpairs is a whole number from 1."

    def _say(self, sentence: str) -> None:
        """Show a fault in place of the note, or the note for ""."""
        self.fault.setText(sentence)
        self._show_note()
        if sentence:
            later(self._bring_into_view)

    def _bring_into_view(self) -> None:
        bring_into_view(self.fault)

    def _keep(self) -> None:
        self._kept = self._document.solve.target

    def _restore(self) -> None:
        self._document.solve.target = self._kept

    def _clear_fault(self) -> None:
        self._say("")

    def _show_note(self) -> None:
        self._note_stack.setCurrentIndex(1 if self.fault.text() else 0)

    def _choose(self, kind: Any, _given: object = None) -> None:
        self._say("")
        value = self._fields[kind].value
        if value is None:
            return
        try:
            self._document.solve.target = Target(kind, value)
        except InputError:
            # the number is incomplete; the next digit may correct it
            return

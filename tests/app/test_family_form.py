"""Form of a family: each declared parameter has a control, an option and a session entry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
from closed_form import give, rectangle_document
from faults import raises
from msgspec import Meta
from PySide6.QtWidgets import QCheckBox, QComboBox, QSpinBox
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.tabs import make_tab
from meshmash_viewer.features.filters import wave_kernel_bank
from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.fields.parameter import Index, Parameter, checked_entry, parameter, record


@dataclass(frozen=True)
class Example(BankColumns):
    """Family with a parameter of each kind."""

    name = "example"
    label = short = tip = "Example"
    export = "example"

    width: float = parameter(
        7.0,
        Annotated[float, Meta(ge=0.5, le=50.0)],
        power=2,
        text="Width",
        option="width",
        help="width (unit²)",
    )
    order: int = parameter(3, Annotated[int, Meta(ge=1, le=9)], text="Order")
    edge: str = parameter("soft", str, labels={"soft": "Soft", "hard": "Hard"}, text="Edge")
    scaled: bool = parameter(False, bool, text="Scaled")
    hidden: int = parameter(0, Index)

    def bank(self, eigenvalues, area=None, bound=None):
        return wave_kernel_bank(eigenvalues, self.count)

    def axes(self, unit: str) -> tuple[str, str]:
        return "Column", "Example"


def test_every_parameter_with_a_text_has_a_control(qtbot: QtBot) -> None:
    document = rectangle_document()
    document.display.show(Example())
    tab = make_tab(document, Example)
    qtbot.addWidget(tab)
    tab.show()
    width, order = (
        tab.findChild(NumberField, "example_width_field"),
        tab.findChild(QSpinBox, "example_order_spin"),
    )
    edge, scaled = (
        tab.findChild(QComboBox, "example_edge_combo"),
        tab.findChild(QCheckBox, "example_scaled_check"),
    )
    assert (width.value, order.value(), scaled.isChecked()) == (7.0, 3, False)
    assert (edge.currentText(), order.maximum()) == ("Soft", 9)
    give(width, "12.5")
    order.setValue(5)
    edge.setCurrentIndex(1)
    edge.activated.emit(1)
    scaled.setChecked(True)
    chosen = document.display[Example]
    assert (chosen.width, chosen.order, chosen.edge, chosen.scaled) == (12.5, 5, "hard", True)
    give(width, "51")
    assert document.display[Example].width == 12.5
    document.display.change(Example, width=2.0, edge="soft")
    qtbot.waitUntil(lambda: width.value == 2.0)
    assert edge.currentText() == "Soft"
    assert not any("hidden" in name for name in tab.rows)


def test_a_declaration_is_option_and_session_entry_too() -> None:
    declared = Example.declared()
    assert declared["width"].flag == "--width"
    assert declared["width"].parse("3 µm²").in_unit("nm") == pytest.approx(3e6)
    plain = Parameter(Annotated[float, Meta(ge=0.0, le=50.0)], option="sharpness")
    assert plain.parse("12.5") == 12.5
    with raises("out-of-range", "a number from 0 to 50, not 51"):
        plain.parse("51")
    saved = Example(width=9.0, edge="hard").plain()
    kind, path = record(Example.entries()), Path("a.meshmash.json")
    assert Example(**checked_entry(kind, saved, path)) == Example(width=9.0, edge="hard")
    wrong_ones = {"width": 51.0, "order": 0, "edge": 3}
    for place, wrong in wrong_ones.items():
        with raises("invalid-entry", place):
            checked_entry(kind, saved | {place: wrong}, path)

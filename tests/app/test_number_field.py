from __future__ import annotations

import pytest
from closed_form import give
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from meshmash_viewer.app.controls.number_field import NumberField


@pytest.fixture
def field(qtbot) -> NumberField:
    field = NumberField("t_min_field", "Shortest time")
    field.bounds = 0.0, 1e15
    qtbot.addWidget(field)
    field.show()
    field.show_value(2.5e-8, "nm²")
    field.setFocus()
    return field


def test_the_number_is_in_view_at_the_right(qapp, field: NumberField) -> None:
    edit = field.lineEdit()
    assert edit.width() > edit.fontMetrics().horizontalAdvance("2.5e-08") + 10
    assert field.width() - edit.geometry().right() < 12, "no room is left for arrows"


@pytest.mark.parametrize("text", ["3.1e5", "0,31um^2"])
def test_any_notation_with_or_without_unit(field: NumberField, qtbot, text: str) -> None:
    with qtbot.waitSignal(field.edited) as heard:
        give(field, text)
    assert heard.args == [3.1e5]
    assert field.value == 3.1e5


def test_a_refusal_is_withdrawn_when_other_numbers_are_shown(field: NumberField) -> None:
    sentences: list[str] = []
    field.refused.connect(sentences.append)
    give(field, "1e16")
    field.show_value(2.5e-8, "nm²")
    assert sentences[-1], "the same is shown again"
    field.bounds = 0.0, 1e20
    field.show_value(3e4, "nm²")
    assert not sentences[-1]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("-1", "Shortest time: between about 0 and 1000\N{NO-BREAK SPACE}mm² on this mesh."),
        ("nan", "nan is not a number"),
        ("20 µm", "20 µm is in another unit: write it in µm²."),
    ],
)
def test_what_is_refused_is_said_and_forgotten(field: NumberField, text: str, says: str) -> None:
    sentences: list[str] = []
    field.refused.connect(sentences.append)
    give(field, text)
    assert says in sentences[-1]
    assert field.value == 2.5e-8
    assert field.text() == "2.5e-08", "what was refused does not stay"
    QTest.keyClick(field, Qt.Key.Key_Escape)
    assert field.text() == "2.5e-08"
    assert sentences[-1] == ""


def test_the_model_does_not_overwrite_someone_typing(field: NumberField) -> None:
    field.selectAll()
    QTest.keyClicks(field, "7")
    field.setFocus()
    if field.hasFocus():
        field.show_value(1.0, "nm²")
        assert field.text() == "7"


def test_limits_may_be_negative(qtbot) -> None:
    field = NumberField("limit_low_field", "Low limit")
    qtbot.addWidget(field)
    field.show_value(0.0)
    assert field.text() == "0"
    with qtbot.waitSignal(field.edited) as heard:
        give(field, "-2e-3")
    assert heard.args == [-2e-3]
    give(field, "1e300")
    assert field.value == -2e-3, "no size of a mesh"

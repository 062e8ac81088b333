"""Spin boxes for whole numbers, which parse a finished text or refuse it with a message."""

from __future__ import annotations

import pytest
from closed_form import give
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLineEdit, QPushButton, QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.controls.number_field import WholeField, has_refused

NAME = "The number of times"


class Form(QWidget):
    """A form with a spin box, which stores the last refusal."""

    def __init__(self) -> None:
        super().__init__()
        self.said = ""
        self.whole = WholeField(
            minimum=1, maximum=2929, value=7, suffix=" of 2929",
            accessibleName=NAME,
        )  # fmt: skip
        self.other, self.button = QLineEdit(), QPushButton()
        box = QVBoxLayout(self)
        for each in (self.whole, self.other, self.button):
            box.addWidget(each)

    def say_refusal(self, sentence: str) -> None:
        self.said = sentence


@pytest.fixture
def form(qtbot: QtBot) -> Form:
    form = Form()
    qtbot.addWidget(form)
    form.show()
    form.activateWindow()
    qtbot.waitUntil(form.isActiveWindow)
    return form


@pytest.mark.parametrize("text", ["99999", "1.234", "5 nm"])
@pytest.mark.parametrize("by_return", [True, False])
def test_what_is_refused_is_said_with_the_range(form: Form, text: str, by_return: bool) -> None:
    field = form.whole
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)
    if by_return:
        QTest.keyClick(field, Qt.Key.Key_Return)
        assert field.hasFocus(), "to be typed over"
    else:
        form.other.setFocus()
    assert field.value() == 7
    assert field.text() == "7 of 2929"
    QTest.qWait(1)
    assert form.said.startswith(f"{NAME} is a whole number from 1 to 2,929")
    assert text in form.said
    field.setFocus()
    QTest.keyClicks(field, "1")
    assert form.said == "", "once it is typed over"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2929", 2929),
        ("1,234", 1234),
        ("12 of 2929", 12),
        ("1e3", 1000),
        ("50.0", 50),
    ],
)
def test_what_is_taken(form: Form, text: str, value: int) -> None:
    give(form.whole, text)
    assert form.whole.value() == value
    assert form.whole.text() == f"{value} of 2929"


def test_it_goes_back_to_what_the_arrows_have_made_of_it(form: Form) -> None:
    give(form.whole, "20")
    QTest.keyClick(form.whole, Qt.Key.Key_Up)
    give(form.whole, "99999")
    assert form.whole.value() == 21


def test_a_button_can_know_that_its_press_has_refused_something(form: Form) -> None:
    known: list[bool] = []
    form.button.pressed.connect(lambda: known.append(has_refused(form)))
    form.button.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    for text in ("99999", "12"):
        form.whole.setFocus()
        form.whole.selectAll()
        QTest.keyClicks(form.whole, text)
        QTest.mouseClick(form.button, Qt.MouseButton.LeftButton)
        QTest.qWait(1)
    assert known == [True, False]

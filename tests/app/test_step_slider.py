from __future__ import annotations

import pytest
from closed_form import drag, turn_wheel
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest

from meshmash_viewer.app.controls.step_slider import Mark, StepSlider, decade_marks


@pytest.fixture
def slider(qtbot) -> StepSlider:
    slider = StepSlider()
    qtbot.addWidget(slider)
    slider.setRange(0, 199)
    slider.resize(300, slider.sizeHint().height())
    slider.show()
    return slider


def test_wheel_goes_one_step_a_notch_and_ten_with_control(slider: StepSlider) -> None:
    turn_wheel(slider, 3)
    assert slider.value() == 3
    turn_wheel(slider, 1, Qt.KeyboardModifier.ControlModifier)
    assert slider.value() == 13
    turn_wheel(slider, -20)
    assert slider.value() == 0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        (Qt.Key.Key_Right, 51),
        (Qt.Key.Key_Left, 49),
        (Qt.Key.Key_PageDown, 60),
        (Qt.Key.Key_PageUp, 40),
        (Qt.Key.Key_Home, 0),
        (Qt.Key.Key_End, 199),
    ],
)
def test_keys(slider: StepSlider, key: Qt.Key, value: int) -> None:
    slider.setValue(50)
    QTest.keyClick(slider, key)
    assert slider.value() == value


def test_a_click_jumps_there_and_drags_on(slider: StepSlider) -> None:
    row = 13
    QTest.mouseClick(slider, Qt.MouseButton.LeftButton, pos=QPoint(slider.value_x(120), row))
    assert abs(slider.value() - 120) <= 1
    drag(
        slider, QPoint(slider.value_x(120), row), QPoint(slider.value_x(30), row), QPoint(-50, row)
    )
    assert slider.value() == 0
    assert not slider.isSliderDown()


def test_marks_take_room_only_while_there_are_some(slider: StepSlider) -> None:
    bare = slider.sizeHint().height()
    slider.set_marks((Mark(0.0, "10⁵"), Mark(1.0, "10⁶")))
    assert slider.sizeHint().height() > bare
    slider.set_hatched((0.0, 0.4))
    assert not slider.grab().isNull()


def test_marks_of_a_slider_lie_at_their_place_in_log_scale() -> None:
    marks = decade_marks(1e5, 1e8)
    assert [mark.text for mark in marks] == ["10⁵", "10⁶", "10⁷", "10⁸"]
    assert [mark.share for mark in marks] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert decade_marks(0.0, 1.0) == ()
    assert 3 <= len(decade_marks(1.1e5, 2.3e6)) <= 6
    assert len(decade_marks(1e-12, 1e20)) <= 9

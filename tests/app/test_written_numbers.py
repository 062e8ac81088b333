"""Numbers typed into fields in common notations, or refused with a message."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from closed_form import part, rectangle_document
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.spectral.weyl import Target

LEFT, RETURN = Qt.MouseButton.LeftButton, Qt.Key.Key_Return
CONTROL = Qt.KeyboardModifier.ControlModifier


@pytest.fixture
def window(qtbot: QtBot, reopen_window: Callable[..., MainWindow]) -> MainWindow:
    """A window with a rectangle of 12 by 47 µm, in nm."""
    return reopen_window(rectangle_document(), (1300, 900))


def type_in(window: MainWindow, name: str, text: str) -> QWidget:
    field = part(window, name)
    QTest.mouseClick(field.lineEdit(), LEFT)
    field.selectAll()
    for key in text:
        if key.isascii():
            QTest.keyClicks(field, key)
        else:  # QTest has no such key
            QApplication.clipboard().setText(key)
            QTest.keyClick(field, Qt.Key.Key_V, CONTROL)
        catch_up()
    return field


def enter(field: QWidget) -> None:
    QTest.keyClick(field, RETURN)
    catch_up()


#: Family, field, typed text, and the number read, in nm and its powers.
TYPED = (
    ("eigenfunction", "target_wavelength_spin", "18 um", 18_000.0),
    ("eigenfunction", "target_eigenvalue_spin", "0,5 µm⁻²", 5e-7),
    ("eigenfunction", "mollify_spin", "0.01 %", 1e-4),
    ("eigenfunction", "limit_low_field", "\u22121×10^-5 nm^-1", -1e-5),
    ("eigenfunction", "limit_high_field", "50", 5e-5),  # in mm⁻¹, as on the render
    ("hks", "hks_t_max_field", "1.5×10⁹ nm²", 1.5e9),
    ("filter", "filter_parameter_0_field", "0.1um^-2", 1e-7),
)


@pytest.mark.slow
def test_numbers_and_units_in_the_fields_of_the_panels(window: MainWindow) -> None:
    for kind, name, text, number in TYPED:
        window.document.display.kind = kind
        window.wait(60.0)
        field = type_in(window, name, text)
        enter(field)
        assert field.value == number, (name, text)
        assert window.stage.hasFocus(), name


def test_compute_does_not_begin_with_what_is_refused(window: MainWindow, qtbot: QtBot) -> None:
    document, jobs = window.document, list[object]()
    document.work.requested.connect(jobs.append)
    document.solve.target = Target("count", 130)
    catch_up()
    for press in (
        lambda field: QTest.keyClick(field, RETURN, CONTROL),
        lambda field: QTest.mouseClick(part(window, "compute_button"), LEFT),
    ):
        press(type_in(window, "target_wavelength_spin", "18,800"))
        catch_up()
        assert jobs == []
        assert "18,800 may be 18800 or 18.8" in part(window, "target_fault").text()
        assert document.solve.target == Target("count", 130)
        window.stage.setFocus()
        QTest.qWait(1)
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    assert len(jobs) == 1, "the next click means what is there"


@pytest.mark.slow
def test_a_session_has_what_is_being_typed(window: MainWindow) -> None:
    field = type_in(window, "mollify_spin", "1e-4")
    assert window.document.solve.operator.mollify_factor != 1e-4
    QTest.keyClick(field, Qt.Key.Key_S, CONTROL)  # refused: this mesh is in no file
    assert window.document.solve.operator.mollify_factor == 1e-4

"""Typed values: taken once, announced, remembered, and distinct from keys of commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
)
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import format_number

LEFT = Qt.MouseButton.LeftButton
RETURN = Qt.Key.Key_Return
PATIENCE = 60_000
RADIUS = 500.0


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    made = {}
    for name, radius in (("ball", RADIUS), ("bead", 0.05)):
        mesh = shapes.icosphere(2, radius=radius)
        made[name] = tmp_path / f"{name}.npz"
        np.savez(made[name], vertices=mesh.vertices, faces=mesh.faces)
    return made


Open = Callable[[str], None]


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window()


@pytest.fixture
def open_file(qtbot: QtBot, window: MainWindow, files: dict[str, Path]) -> Open:
    """Function that opens a file and waits until it is displayed."""

    def opened(name: str) -> None:
        window.opening.open_path(files[name])
        rested(qtbot, window, lambda: window.document.path == files[name])

    return opened


def rested(qtbot: QtBot, window: MainWindow, condition: Callable[[], bool] = lambda: True) -> None:
    document, source = window.document, window.controller
    qtbot.waitUntil(
        lambda: condition() and document.work.job is None and source.idle, timeout=PATIENCE
    )
    catch_up()


def compute(qtbot: QtBot, window: MainWindow) -> None:
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    rested(qtbot, window, lambda: bool(window.document.spectrum))


def text_of(window: MainWindow, name: str) -> str:
    label = part(window, name)
    assert isinstance(label, QLabel)
    return label.text()


def type_in(window: MainWindow, name: str, text: str) -> None:
    """Click into a field, replace its text, and press Return."""
    field = part(window, name)
    if isinstance(field, QComboBox):
        field = field.lineEdit()
    QTest.mouseClick(field, LEFT, pos=field.rect().center())
    assert isinstance(field, (QLineEdit, QAbstractSpinBox))
    field.selectAll()
    press_keys(text)
    press_keys(RETURN)


def press_keys(*keys: Qt.Key | str) -> None:
    """Send keys to the focused widget."""
    for key in keys:
        focused = QApplication.focusWidget()
        assert focused is not None
        if isinstance(key, str):
            QTest.keyClicks(focused, key)
        else:
            QTest.keyClick(focused, key)
    catch_up()


# -- Return ------------------------------------------------------------------------------------


#: A field of each kind: its family, its name, and the typed text.
FIELDS = (
    ("eigenfunction", "unit_combo", "mm"),
    ("eigenfunction", "mollify_spin", "1e-6"),
    ("eigenfunction", "target_count_spin", "30"),
    ("eigenfunction", "target_wavelength_spin", "400"),
    ("eigenfunction", "eigenvector_spin", "3"),
    ("eigenfunction", "limit_low_field", "-1e-4"),
    ("hks", "hks_scales_spin", "9"),
    ("hks", "hks_t_min_field", "2e4"),
    ("band", "band_max_field", "1e-4"),
    ("band", "band_count_spin", "7"),
)


@pytest.mark.slow
def test_return_takes_what_is_typed_and_gives_the_keys_back(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    display, name_label = window.document.display, part(window, "mesh_name_label")
    window.document.solve.target = Target("count", 12)
    compute(qtbot, window)
    for kind, name, text in FIELDS:
        display.kind = kind
        rested(qtbot, window)
        before = shown_in(window, name)
        type_in(window, name, text)
        rested(qtbot, window)
        assert window.stage.hasFocus(), name
        taken = shown_in(window, name)
        assert taken != before, name
        display.kind = "wks"
        press_keys("2")
        assert display.kind == "hks", "a command, not a digit"
        display.kind = kind
        rested(qtbot, window)
        QTest.mouseClick(name_label, LEFT)
        assert shown_in(window, name) == taken


def shown_in(window: MainWindow, name: str) -> str:
    field = part(window, name)
    return field.currentText() if isinstance(field, QComboBox) else field.text()


@pytest.mark.slow
def test_return_in_a_panel_that_floats_gives_the_keys_back(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    dock = part(window, "mesh_dock")
    with qtbot.waitExposed(dock):
        dock.setFloating(True)
    dock.activateWindow()
    qtbot.waitUntil(dock.isActiveWindow, timeout=PATIENCE)
    type_in(window, "target_count_spin", "30")
    qtbot.waitUntil(window.stage.hasFocus, timeout=PATIENCE)


# -- units -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_change_of_coordinates_is_announced_and_undone(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    window.document.solve.target = Target("count", 12)
    compute(qtbot, window)
    area = window.document.ready.health.area
    type_in(window, "unit_combo", "2 mm")
    rested(qtbot, window, lambda: window.document.unit_text == "2 mm")
    assert window.document.ready.health.area == pytest.approx(4.0 * area)
    assert window.document.spectrum is None
    assert "Unit changed from none to 2 mm: lengths are scaled" in text_of(window, "message_text")
    QTest.mouseClick(part(window, "message_action"), LEFT)
    rested(qtbot, window, lambda: window.document.unit_text == "none")
    assert window.document.ready.health.area == pytest.approx(area)
    assert len(window.document.spectrum) == 12, "they are in the store"


@pytest.mark.parametrize("dismissed", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_ctrl_z_takes_back_what_the_message_offers_to(
    qtbot: QtBot, window: MainWindow, open_file: Open, dismissed: bool
) -> None:
    open_file("ball")
    action = window.findChild(QAction, "undo")
    assert not action.isEnabled()
    type_in(window, "unit_combo", "nm")
    rested(qtbot, window, lambda: window.document.unit_text == "nm")
    undo = part(window, "message_action")
    assert undo.isVisible()
    assert action.isEnabled()
    assert action.text() == "Undo change of unit"
    if dismissed:
        QTest.mouseClick(part(window, "dismiss_message"), LEFT)
    QTest.keyClick(QApplication.focusWidget(), Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert window.document.unit_text == "none"
    catch_up()
    assert not undo.isVisible(), "there is nothing left to undo"
    assert not action.isEnabled()


def test_ctrl_z_in_a_field_is_for_what_is_typed_there(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    type_in(window, "unit_combo", "nm")
    rested(qtbot, window, lambda: window.document.unit_text == "nm")
    combo = part(window, "unit_combo")
    assert isinstance(combo, QComboBox)
    combo.setFocus()
    QTest.keyClicks(combo, "x")
    assert combo.currentText() != "nm"
    QTest.keyClick(combo, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert combo.currentText() == "nm"
    assert window.document.unit_text == "nm", "the command waits until the field is as it was"


@pytest.mark.slow
def test_a_unit_that_begins_like_another_is_taken_as_typed(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    type_in(window, "unit_combo", "m")
    assert window.document.unit_text == "m"
    assert part(window, "message_action").isVisible()
    open_file("bead")
    assert not part(window, "message_action").isVisible(), "another mesh: nothing to undo"


@pytest.mark.parametrize("unit", [pytest.param("mm", marks=pytest.mark.slow), "8 nm"])
def test_a_unit_given_by_hand_is_remembered_for_its_file(
    qtbot: QtBot, window: MainWindow, open_file: Open, unit: str
) -> None:
    open_file("ball")
    type_in(window, "unit_combo", unit)
    rested(qtbot, window, lambda: window.document.unit_text == unit)
    open_file("bead")
    assert window.document.unit_text == "none", "each has its own"
    open_file("ball")
    assert window.document.unit_text == unit
    path = window.document.path
    assert path is not None
    window.opening.last_session.save()
    stored = window.opening.last_session.stored(path)
    assert stored is not None
    assert stored.unit == unit, "for the next run"


# -- computed pairs ----------------------------------------------------------------------------


@pytest.mark.slow
def test_proof_cost_and_compute_speak_of_one_state(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    button, action = part(window, "compute_button"), window.actions_["compute"]
    assert button.isEnabled()
    type_in(window, "target_wavelength_spin", "800")
    assert part(window, "target_count_spin").text().startswith("≈ ")
    assert "Takes about" in text_of(window, "cost_label")
    compute(qtbot, window)
    found = len(window.document.spectrum)
    assert text_of(window, "proof_label").startswith(f"{found} pairs · complete")
    assert part(window, "target_count_spin").text() == f"{found}"
    assert text_of(window, "cost_label") == f"Computed: {found} pairs."
    assert not button.isEnabled()
    assert not action.isEnabled()
    for count in (5, found, found + 1):  # each is another request
        type_in(window, "target_count_spin", f"{count}")
        assert "Takes about" in text_of(window, "cost_label")
        assert button.isEnabled()
        assert action.isEnabled()
    type_in(window, "target_wavelength_spin", "800")
    assert text_of(window, "cost_label") == f"Computed: {found} pairs."
    assert not button.isEnabled()
    QTest.mouseClick(part(window, "robust_check"), LEFT, pos=QPoint(8, 8))
    assert part(window, "compute_button").isEnabled(), "of another Laplacian there are none"


@pytest.mark.slow
def test_a_proof_is_of_what_is_computed_and_not_of_a_preview(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    window.document.solve.target = Target("count", 5)
    compute(qtbot, window)
    exact = window.document.spectrum
    values = np.concatenate([[0.0], np.linspace(1.0, 2.0, 19)]) * exact.eigenvalues[-1]
    rows = np.ones((20, window.document.mesh.n_vertices))
    nothing = np.full(20, np.nan)
    window.document.accept_spectrum(Eigenpairs(values, rows, nothing, n_exact=0, error=0.1))
    assert len(window.document.spectrum) == 20
    said = text_of(window, "proof_label")
    assert said.startswith("5 pairs · complete")
    assert said.endswith(" · 15 more from a preview")
    assert text_of(window, "cost_label") == "Computed: 5 pairs."
    asked, none = Target("count", 30), Certificate("none")
    cancelled = replace(exact.first(3), total=30, certificate=none, target=asked)
    preview = cancelled.before(Eigenpairs(values, rows, nothing, n_exact=0, error=0.1))
    window.document.solve.target = asked
    window.document.accept_spectrum(preview)
    stopped, more = "3 pairs of 30, stopped early", " · 17 more from a preview."
    assert text_of(window, "proof_label") == f"{stopped}: Compute resumes here{more}"
    type_in(window, "target_count_spin", "5")
    assert text_of(window, "proof_label") == f"{stopped}{more}", "another request"


# -- another mesh ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_length_does_not_carry_over_to_another_mesh(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    type_in(window, "target_wavelength_spin", "400")
    assert window.document.solve.target == Target("wavelength", 400.0)
    compute(qtbot, window)
    open_file("bead")
    assert window.document.solve.target.kind == "count"
    assert part(window, "target_count_radio").isChecked()
    assert part(window, "target_count_spin").value == 100


@pytest.mark.slow
def test_limits_are_locked_for_one_family(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    open_file("ball")
    window.document.solve.target = Target("count", 12)
    compute(qtbot, window)
    type_in(window, "limit_high_field", "3e-4")
    assert part(window, "limits_combo").currentText() == "Locked"
    press_keys("2")
    rested(qtbot, window)
    assert part(window, "limits_combo").currentText() == "Automatic"
    low, high = (part(window, f"limit_{end}_field").value for end in ("low", "high"))
    values = window.controller.field.values
    assert values.min() <= low < high <= values.max(), "not flat: the values of HKS"
    press_keys("1")
    rested(qtbot, window)
    assert part(window, "limit_high_field").value == 3e-4


# -- numbers -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_largest_eigenvalue_is_written_the_same_everywhere(
    qtbot: QtBot, window: MainWindow, open_file: Open
) -> None:
    """A small ball without a unit has eigenvalues of five digits, to be rounded."""
    open_file("bead")
    window.document.solve.target = Target("count", 40)
    compute(qtbot, window)
    largest = format_number(float(window.document.spectrum.eigenvalues[-1]))
    assert len(largest) == 5, "else it shows nothing"
    press_keys(Qt.Key.Key_End)
    rested(qtbot, window)
    assert text_of(window, "eigenvalue_label") == f"λ₃₉ = {largest}"
    assert f"λ₃₉ = {largest}," in text_of(window, "spectrum_readout")
    assert window.controller.field.quantity == f"λ₃₉ = {largest}"
    assert part(window, "target_eigenvalue_spin").text() == largest
    press_keys("3")
    rested(qtbot, window)
    assert part(window, "band_max_field").text() == largest
    dialog = ExportDialog(window.document, Path("."), window)
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("geometry-vectors"))
    assert f" to {largest}." in dialog.contents_label.text()
    dialog.deleteLater()
    type_in(window, "band_max_field", "12345.6")
    rested(qtbot, window)
    QTest.mouseClick(part(window, "mesh_name_label"), LEFT)
    assert part(window, "band_max_field").text() == "12345.6", "what was typed is left as it was"

"""Export and picture, by mouse and keys."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from closed_form import give, rectangle_document
from PIL import Image
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
)
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
from meshmash_viewer.app.dialogs.picture_dialog import PictureDialog
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.figure import FigureOptions
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.model.export import ExportJob

LEFT = Qt.MouseButton.LeftButton
CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
PATIENCE = 60_000


@pytest.fixture
def window(open_window: Callable[..., MainWindow]) -> MainWindow:
    """A window with a rectangle, and its eigenpairs in closed form."""
    return open_window(rectangle_document())


def asked(qtbot: QtBot, window: MainWindow, name: str, key: Qt.Key, *held: object) -> QDialog:
    """The dialog that a key opens."""
    modifiers = CONTROL
    for each in held:
        modifiers |= each
    QTest.keyClick(window, key, modifiers)
    found = lambda: [each for each in window.findChildren(QDialog, name) if each.isVisible()]  # noqa: E731
    qtbot.waitUntil(lambda: bool(found()), timeout=PATIENCE)
    return found()[0]


def test_a_picture_that_cannot_be_written_leaves_the_dialog_as_it_was(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = asked(qtbot, window, "picture_dialog", Qt.Key.Key_S, SHIFT)
    assert isinstance(dialog, PictureDialog)
    check, edit = dialog.transparent_check, dialog.file_row.edit
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    save = dialog.findChild(QPushButton, "picture_save_button")
    place = save.mapToGlobal(QPoint(0, 0))
    for name, said in (("nowhere/bun.png", "nowhere"), ("bun.jpg", ".png")):
        edit.selectAll()
        QTest.keyClicks(edit, str(tmp_path / name))
        QTest.mouseClick(save, LEFT)
        assert dialog.isVisible()
        assert said in dialog.remark_label.text()
        assert save.mapToGlobal(QPoint(0, 0)) == place, "nothing moves under the pointer"
    assert not list(tmp_path.iterdir())
    edit.selectAll()
    QTest.keyClicks(edit, str(tmp_path / "bun"))
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert not dialog.isVisible()
    qtbot.waitUntil((tmp_path / "bun.png").exists, timeout=PATIENCE)
    again = asked(qtbot, window, "picture_dialog", Qt.Key.Key_S, SHIFT)
    assert isinstance(again, PictureDialog)
    assert again.choice.transparent
    assert again.path == tmp_path / "bun.png"
    assert "will be replaced" in again.remark_label.text()
    again.reject()


def test_a_figure_has_the_width_of_a_journal(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = asked(qtbot, window, "figure_dialog", Qt.Key.Key_S, Qt.KeyboardModifier.AltModifier)
    assert isinstance(dialog, FigureDialog)
    assert dialog.options == FigureOptions()
    dialog.width_combo.setFocus()
    QTest.keyClick(dialog.width_combo, Qt.Key.Key_Down)
    dialog.width_combo.activated.emit(dialog.width_combo.currentIndex())
    assert dialog.options.width_mm == 114.0
    check = dialog.checks["axes"]
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    edit = dialog.file_row.edit
    edit.selectAll()
    QTest.keyClicks(edit, str(tmp_path / "figure.png"))
    assert dialog.ending == ".png"
    QTest.keyClick(edit, Qt.Key.Key_Return)
    qtbot.waitUntil((tmp_path / "figure.png").exists, timeout=PATIENCE)
    with Image.open(tmp_path / "figure.png") as picture:
        assert picture.width == pytest.approx(114.0 / 25.4 * 300.0, abs=1.0)
    again = asked(qtbot, window, "figure_dialog", Qt.Key.Key_S, Qt.KeyboardModifier.AltModifier)
    assert isinstance(again, FigureDialog)
    assert (again.options.width_mm, again.options.axes) == (114.0, False)
    again.reject()


def test_what_one_looks_at_is_offered_and_the_format_remembered(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    display = window.document.display
    for name, kind in (
        ("eigenfunction", "eigenpairs"),
        ("wks", "wks"),
        ("band", "geometry-vectors"),
    ):
        display.kind = name
        dialog = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
        assert isinstance(dialog, ExportDialog)
        assert dialog.kind == kind
        assert dialog.path.name == f"rectangle_{kind}.npz"
        dialog.reject()
    dialog = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    edit = dialog.findChild(QLineEdit, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(tmp_path / "mine.csv"))
    assert dialog.format.ending == ".csv", "the name says which"
    jobs: list[ExportJob] = []
    window.document.work.requested.disconnect()
    window.document.work.requested.connect(jobs.append)
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert [job.path for job in jobs] == [tmp_path / "mine.csv"]
    again = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    assert again.path == tmp_path / "rectangle_geometry-vectors.csv"
    again.reject()


def test_no_text_of_the_export_dialog_touches_another(qtbot: QtBot, window: MainWindow) -> None:
    dialog = ExportDialog(window.document, Path("/data"), window)
    qtbot.addWidget(dialog)
    dialog.show()
    for kind in EXPORTS:
        dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData(kind))
        qtbot.wait(30)
        column = [dialog.table, dialog.contents_label, dialog.columns_label, dialog.file_row]
        for upper, lower in pairwise(column):
            assert upper.geometry().bottom() < lower.geometry().top(), kind
        for label in (dialog.contents_label, dialog.columns_label, dialog.remark_label):
            assert label.heightForWidth(label.width()) <= label.height(), kind


def test_distances_are_exported_from_every_pin(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    document = window.document
    document.display.kind = "distance"
    document.pins.toggle(20)
    document.pins.toggle(70)
    window.show()
    dialog = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    assert dialog.kind == "distance"
    columns = dialog.findChild(QLabel, "export_columns_label").text()
    assert columns.startswith("geodesic_from_20,  geodesic_from_70")
    assert not dialog.findChild(QSpinBox, "export_pairs_spin").isVisible(), "none are needed"
    assert not dialog.findChild(QSpinBox, "export_count_spin").isVisible()
    told = dialog.findChild(QLabel, "export_contents_label").text()
    assert "2 columns" in told
    assert "Geodesic distance from 2 vertices" in told
    dialog.reject()
    for vertex in (20, 70):
        document.pins.toggle(vertex)
    again = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    again.kind_combo.setCurrentIndex(again.kind_combo.findData("distance"))
    assert "pin one" in again.findChild(QLabel, "export_contents_label").text()
    assert not again.findChild(QPushButton, "export_button").isEnabled()
    again.reject()


def test_arrows_of_a_number_stay_at_its_limits(qtbot: QtBot, window: MainWindow) -> None:
    dialog = ExportDialog(window.document, Path("/data"), window)
    qtbot.addWidget(dialog)
    dialog.show()
    spin = dialog.pairs_spin
    for value in (spin.minimum(), spin.maximum()):
        spin.setValue(value)
        picture = spin.grab().toImage()
        ratio, width, height = picture.devicePixelRatio(), spin.width(), spin.height()
        for top in (2, height // 2):
            seen = {
                picture.pixel(round(x * ratio), round(y * ratio))
                for x in range(width - 17, width - 4)
                for y in range(top + 1, top + height // 2 - 4)
            }
            assert len(seen) > 3, (value, top)


def test_fields_of_a_range_end_where_the_others_do(qtbot: QtBot, window: MainWindow) -> None:
    window.document.set_unit("none")
    window.document.display.kind = "band"
    tab = (
        window.field_panel.findChild(QAbstractSpinBox, "band_min_field")
        .parentWidget()
        .parentWidget()
    )
    qtbot.waitUntil(tab.isVisible)
    qtbot.wait(50)
    fields = tab.range_box.low, tab.range_box.high, tab.count_spin
    rights = [each.mapTo(tab, each.rect().topRight()).x() for each in fields]
    assert len(set(rights)) == 1, rights
    give(tab.range_box.low, "")  # which is refused: its sentence does not narrow them
    assert [each.mapTo(tab, each.rect().topRight()).x() for each in fields] == rights

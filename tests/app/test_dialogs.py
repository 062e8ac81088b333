"""Dialogs of exports and pictures, used by mouse and keys."""

from __future__ import annotations

import csv
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import give, rectangle_document
from PIL import Image
from PySide6.QtCore import QObject, QPoint, Qt, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QApplication,
    QDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
)
from pytestqt.qtbot import QtBot
from tiers import slow

import meshmash_viewer as mv
import meshmash_viewer.app.view.picture as picture_module
from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
from meshmash_viewer.app.dialogs.files import SaveDialog
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.model.jobs import Job

LEFT = Qt.MouseButton.LeftButton
CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
PATIENCE = 60_000


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    """Return a window with a rectangle and its eigenpairs in closed form."""
    return reopen_window(rectangle_document())


def asked(qtbot: QtBot, window: MainWindow, name: str, key: Qt.Key, *held: object) -> QDialog:
    """Press a key and return the dialog that it opens."""
    modifiers = CONTROL
    for each in held:
        modifiers |= each
    window.activateWindow()  # without a window manager, no window is active after a dialog
    qtbot.waitUntil(window.isActiveWindow, timeout=PATIENCE)
    QTest.keyClick(window, key, modifiers)
    found = lambda: [each for each in window.findChildren(QDialog, name) if each.isVisible()]  # noqa: E731
    qtbot.waitUntil(lambda: bool(found()), timeout=PATIENCE)
    return found()[0]


def pictured(qtbot: QtBot, window: MainWindow) -> FigureDialog:
    """Open the dialog of a picture; return it when its preview is shown."""
    dialog = asked(qtbot, window, "figure_dialog", Qt.Key.Key_S, SHIFT)
    assert isinstance(dialog, FigureDialog)
    size = dialog.findChild(QLabel, "figure_size_label")
    qtbot.waitUntil(lambda: bool(size.text()), timeout=PATIENCE)
    return dialog


def type_path(dialog: SaveDialog, path: Path) -> None:
    edit = dialog.file_row.edit
    QTest.mouseClick(edit, LEFT)
    edit.selectAll()
    QTest.keyClicks(edit, str(path))


@pytest.mark.slow
def test_a_picture_that_cannot_be_written_leaves_the_dialog_as_it_was(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = pictured(qtbot, window)
    edit, save = dialog.file_row.edit, dialog.findChild(QPushButton, "figure_save_button")
    place = save.mapToGlobal(QPoint(0, 0))
    for name, said in (("nowhere/bun.png", "nowhere"), ("bun.jpg", ".png")):
        type_path(dialog, tmp_path / name)
        QTest.mouseClick(save, LEFT)
        assert dialog.isVisible()
        assert said in dialog.remark_label.text()
        assert save.mapToGlobal(QPoint(0, 0)) == place, "nothing moves under the pointer"
    assert not list(tmp_path.iterdir())
    QTest.keyClick(dialog.background_combo, Qt.Key.Key_Down)
    type_path(dialog, tmp_path / "bun")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert not dialog.isVisible()
    qtbot.waitUntil((tmp_path / "bun.png").exists, timeout=PATIENCE)
    with Image.open(tmp_path / "bun.png") as picture:
        alpha = np.asarray(picture)[..., 3]
    assert (alpha.min(), alpha.max()) == (0, 255)
    again = pictured(qtbot, window)
    assert again.options.background == "transparent"
    assert again.path == tmp_path / "bun.png"
    assert "will be replaced" in again.remark_label.text()
    again.reject()


@pytest.mark.slow
def test_a_picture_has_the_width_of_a_journal_and_is_previewed(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    window.document.pins.toggle(40)
    with monkeypatch.context() as patch:  # a new window would block for a tenth of a second
        patch.setattr(picture_module, "new_window", lambda: pytest.fail("another window"))
        dialog = pictured(qtbot, window)
    size, shown = dialog.findChild(QLabel, "figure_size_label"), dialog.preview
    assert size.text().startswith("85 × ")
    assert "× " in size.text()
    assert "1,004 × " in size.text()

    def look() -> np.ndarray:
        image = shown.pixmap().toImage().convertToFormat(QImage.Format.Format_RGB888)
        rows = np.frombuffer(image.constBits(), np.uint8)
        return rows.reshape(image.height(), image.bytesPerLine())[:, : 3 * image.width()].copy()

    for check in dialog.checks.values():
        before = look()
        QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
        qtbot.waitUntil(lambda: look().shape != before.shape or (look() != before).any())  # noqa: B023
    check = dialog.checks["title"]
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    QTest.keyClick(dialog.width_combo, Qt.Key.Key_Down)
    assert dialog.options.width_mm == 114.0
    qtbot.waitUntil(lambda: size.text().startswith("114 × "), timeout=PATIENCE)
    QTest.keyClick(dialog.dpi_combo, Qt.Key.Key_Down)
    type_path(dialog, tmp_path / "figure.png")
    QTest.keyClick(dialog.file_row.edit, Qt.Key.Key_Return)
    qtbot.waitUntil((tmp_path / "figure.png").exists, timeout=PATIENCE)
    with Image.open(tmp_path / "figure.png") as picture:
        assert picture.width == pytest.approx(114.0 / 25.4 * 600.0, abs=1.0)
        assert picture.info["dpi"][0] == pytest.approx(600, abs=0.02)
    check_its_folder_is_shown(qtbot, window, tmp_path)
    again = pictured(qtbot, window)
    assert (again.options.width_mm, again.options.title, again.options.axes) == (114.0, True, False)
    again.font_spin.setValue(72)
    again.width_spin.setValue(20)
    qtbot.waitUntil(lambda: "no room" in again.preview.text(), timeout=PATIENCE)
    assert not again.accept_button.isEnabled()
    again.reject()


@pytest.mark.parametrize(
    ("stored", "ending", "expected"),
    [
        (
            '{"width_mm": 174.0, "dpi": 600, "background": "window", "pins": false}',
            ".svg",
            (174.0, 600, "window", False, ".svg"),
        ),
        slow('{"dpi": 77, "background": "tartan"}', ".doc", (85.0, 150, "white", True, ".png")),
        slow('{"width_mm": "wide"}', "", (85.0, 300, "white", True, ".png")),
        slow("{", "", (85.0, 300, "white", True, ".png")),
    ],
)
def test_stored_options_of_a_picture_are_offered_where_they_are_valid(
    qtbot: QtBot, window: MainWindow, stored: str, ending: str, expected: tuple
) -> None:
    window.settings.figure = stored, ending
    dialog = asked(qtbot, window, "figure_dialog", Qt.Key.Key_S, SHIFT)
    shown = dialog.options
    found = shown.width_mm, shown.dpi, shown.background, shown.pins, dialog.ending
    assert found == expected
    dialog.reject()
    window.settings.figure = "", ""


@pytest.mark.slow
def test_a_picture_is_drawn_by_another_process_and_can_be_cancelled(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture_module, "new_window", lambda: pytest.fail("in this process"))
    bar, file = window.stage.message_bar, tmp_path / "figure.png"
    for cancelled in (True, False):
        type_path(pictured(qtbot, window), file)
        QTest.keyClick(window.findChildren(FigureDialog)[-1].file_row.edit, Qt.Key.Key_Return)
        assert bar.notice.text == "Drawing figure.png …"
        if cancelled:
            QTest.mouseClick(bar.findChild(QPushButton, "message_action"), LEFT)
        qtbot.waitUntil(lambda: window.background_io.idle, timeout=PATIENCE)
        assert file.exists() == (not cancelled)
        said = "Cancelled: Drawing figure.png." if cancelled else f"Picture saved to {file}."
        assert bar.notice.text == said
    window.actions_["copy_picture"].trigger()
    qtbot.waitUntil(lambda: bar.notice.text == "Picture copied.", timeout=PATIENCE)
    assert not QApplication.clipboard().image().isNull()


def check_its_folder_is_shown(qtbot: QtBot, window: MainWindow, folder: Path) -> None:
    bar = window.stage.message_bar
    qtbot.waitUntil(lambda: "Picture saved" in bar.notice.text, timeout=PATIENCE)
    button = bar.findChild(QAbstractButton, "message_action")
    assert button.text() == "Show in folder"

    class Folders(QObject):
        """Stand-in for the file manager."""

        shown = Signal(QUrl)

    folders = Folders()
    QDesktopServices.setUrlHandler("file", folders, "shown")
    try:
        with qtbot.waitSignal(folders.shown) as heard:
            QTest.mouseClick(button, LEFT)
    finally:
        QDesktopServices.unsetUrlHandler("file")
    assert Path(heard.args[0].toLocalFile()) == folder


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
    jobs: list[Job] = []
    window.document.work.requested.disconnect()
    window.document.work.requested.connect(jobs.append)
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert [job.work.path for job in jobs] == [tmp_path / "mine.csv"]
    again = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    assert again.path == tmp_path / "rectangle_geometry-vectors.csv"
    again.reject()


@pytest.mark.slow
def test_maps_are_exported_without_eigenpairs(
    qtbot: QtBot, open_window: Callable[..., MainWindow], tmp_path: Path
) -> None:
    window = open_window()
    ball = shapes.icosphere(2)
    window.document.take_mesh(mv.Mesh(ball.vertices, ball.faces, unit="mm"))
    qtbot.waitUntil(lambda: window.document.mesh is not None, timeout=PATIENCE)
    window.document.display.kind = "map"
    qtbot.waitUntil(
        lambda: window.controller is not None and window.controller.field is not None,
        timeout=PATIENCE,
    )
    qtbot.waitUntil(window.actions_["export"].isEnabled, timeout=PATIENCE)
    dialog = asked(qtbot, window, "export_dialog", Qt.Key.Key_E)
    assert isinstance(dialog, ExportDialog)
    assert dialog.kind == "maps"
    kinds = [dialog.kind_combo.itemData(at) for at in range(dialog.kind_combo.count())]
    assert kinds == ["distance", "maps"], "what needs no eigenpairs"
    type_path(dialog, tmp_path / "ball.csv")
    QTest.keyClick(dialog.file_row.edit, Qt.Key.Key_Return)
    qtbot.waitUntil((tmp_path / "ball.csv").exists, timeout=PATIENCE)
    with (tmp_path / "ball.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["vertex", "Mean curvature"]
    found = np.array([row[1] for row in rows[1:]], dtype=float)
    np.testing.assert_array_equal(found, window.controller.field.values.astype(float))


def test_no_text_of_the_export_dialog_touches_another(qtbot: QtBot, window: MainWindow) -> None:
    dialog = ExportDialog(window.document, Path("/data"), window)
    qtbot.addWidget(dialog)
    dialog.show()
    for kind in (*EXPORTS, "maps"):
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


@pytest.mark.slow
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
    give(tab.range_box.low, "")  # a refused entry: the message does not narrow the fields
    assert [each.mapTo(tab, each.rect().topRight()).x() for each in fields] == rights

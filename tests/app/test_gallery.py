"""Gallery, used by mouse and keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from closed_form import part, rectangle_document
from PIL import Image
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog, QListWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view import frames
from meshmash_viewer.fields import FAMILIES

LEFT = Qt.MouseButton.LeftButton
KEYS = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
PATIENCE = 60_000


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window(rectangle_document(60))


def opened(qtbot: QtBot, window: MainWindow) -> QDialog:
    """Open the gallery and return it with all its thumbnails."""
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=PATIENCE)
    QTest.keyClick(window, Qt.Key.Key_G, KEYS)
    return filled(qtbot, window)


def filled(qtbot: QtBot, window: MainWindow) -> QDialog:
    dialog = next(each for each in window.findChildren(QDialog, "gallery_dialog"))
    found = dialog.findChild(QListWidget, "gallery_list")
    qtbot.waitUntil(
        lambda: found.count() > 0 and all(picture(found, at).any() for at in range(found.count())),
        timeout=PATIENCE,
    )
    return dialog


def picture(found: QListWidget, at: int) -> np.ndarray:
    """Return the colours and opacity of a thumbnail, shape (height, width, 4)."""
    image = found.item(at).icon().pixmap(found.iconSize()).toImage()
    pixels = np.frombuffer(image.constBits(), np.uint8)
    return pixels.reshape(image.height(), -1, 4)


@pytest.mark.slow
def test_a_click_on_a_thumbnail_goes_there(qtbot: QtBot, window: MainWindow) -> None:
    display = window.document.display
    display.change(FAMILIES["eigenfunction"], flipped=frozenset({6}))
    dialog = opened(qtbot, window)
    found = dialog.findChild(QListWidget, "gallery_list")
    captions = [found.item(at).text() for at in range(found.count())]
    assert len(captions) == 20
    assert captions[0].startswith("λ₀ = ")
    assert captions[19].startswith("λ₅₇ = ")
    QTest.mouseClick(found.viewport(), LEFT, pos=found.visualItemRect(found.item(2)).center())
    assert display.family.index == 6
    assert display.family.flipped == {6}, "what else was chosen stays"
    # the mark follows steps on the render; arrow keys and Return choose a thumbnail
    QTest.keyClick(window, Qt.Key.Key_Right)
    QTest.keyClick(window, Qt.Key.Key_Right)
    QTest.keyClick(window, Qt.Key.Key_Right)
    qtbot.waitUntil(lambda: found.currentRow() == 3, timeout=PATIENCE)
    dialog.activateWindow()
    qtbot.waitUntil(dialog.isActiveWindow, timeout=PATIENCE)
    QTest.keyClick(found, Qt.Key.Key_Right)
    QTest.keyClick(found, Qt.Key.Key_Return)
    assert display.family.index == 12
    a_row = sum(found.visualItemRect(found.item(at)).top() == 0 for at in range(found.count()))
    QTest.keyClick(found, Qt.Key.Key_Down)
    assert found.currentRow() == 4 + a_row
    # another family has its own gallery
    display.kind = "band"
    qtbot.waitUntil(lambda: found.count() == 16, timeout=PATIENCE)
    filled(qtbot, window)
    QTest.mouseClick(found.viewport(), LEFT, pos=found.visualItemRect(found.item(1)).center())
    assert display.fields["band"].index == 2


@pytest.mark.slow
def test_distances_have_a_picture_for_each_pin(qtbot: QtBot, window: MainWindow) -> None:
    document = window.document
    document.display.kind = "distance"
    window.actions_["gallery"].trigger()
    dialog = window.findChild(QDialog, "gallery_dialog")
    remark, found = part(dialog, "gallery_remark_label"), part(dialog, "gallery_list")
    assert remark.text().startswith("Pin vertices on the render: Distance from a vertex has")
    for vertex in (3, 40, 80):
        document.pins.toggle(vertex)
    document.pins.change("Rename", 40, name="tip")
    captions = ["from vertex 3", "from tip", "from vertex 80"]
    qtbot.waitUntil(
        lambda: [found.item(at).text() for at in range(found.count())] == captions,
        timeout=PATIENCE,
    )
    filled(qtbot, window)
    assert found.currentRow() == 2
    assert not remark.text()
    assert (picture(found, 0) != picture(found, 1)).any()
    QTest.mouseClick(found.viewport(), LEFT, pos=found.visualItemRect(found.item(1)).center())
    assert document.display.family.vertex == 40
    qtbot.waitUntil(lambda: found.currentRow() == 1, timeout=PATIENCE)
    assert picture(found, 0).any(), "a choice draws nothing anew"
    document.display.kind = "similarity"
    qtbot.waitUntil(lambda: found.item(1).text().startswith("from tip · bright"), timeout=PATIENCE)
    assert found.count() == 3


@pytest.mark.slow
@pytest.mark.pixels
def test_thumbnails_of_a_large_mesh_are_drawn_of_a_small_one(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = thumbnails(opened(qtbot, window))
    window.findChild(QDialog, "gallery_dialog").close()
    qtbot.waitUntil(lambda: not window.findChildren(QDialog, "gallery_dialog"), timeout=PATIENCE)
    monkeypatch.setattr(frames, "COARSE_VERTICES", 170)
    small = thumbnails(opened(qtbot, window))
    assert len(small) == len(whole) == 20
    differences = [np.abs(one - other).mean() for one, other in zip(whole, small, strict=True)]
    # long waves, which a few vertices resolve, look alike
    assert 0.0 < max(differences[:4]) < 12.0
    assert np.abs(whole[0] - small[3]).mean() > 2.0 * max(differences[:4])


def thumbnails(dialog: QDialog) -> list[np.ndarray]:
    found = dialog.findChild(QListWidget, "gallery_list")
    return [picture(found, at).astype(float) for at in range(found.count())]


@pytest.mark.slow
@pytest.mark.pixels
def test_a_range_is_chosen_and_saved(qtbot: QtBot, window: MainWindow, tmp_path: Path) -> None:
    dialog = opened(qtbot, window)
    found = dialog.findChild(QListWidget, "gallery_list")
    for name, value in (("first", 4), ("last", 9), ("step", 1)):
        spin = part(dialog, f"gallery_{name}_spin")
        spin.selectAll()
        QTest.keyClicks(spin, str(value))
        QTest.keyClick(spin, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: found.count() == 6, timeout=PATIENCE)
    filled(qtbot, window)
    out = tmp_path / "sheet.png"
    ask(qtbot, dialog, out)
    qtbot.waitUntil(out.exists, timeout=PATIENCE)
    qtbot.waitUntil(part(dialog, "gallery_save_button").isEnabled, timeout=PATIENCE)
    with Image.open(out) as image:
        sheet = np.asarray(image.convert("RGB")).astype(int)
        assert image.info["dpi"][0] == pytest.approx(300, abs=0.02)
    width, height = (part(dialog, "gallery_list").width(), part(dialog, "gallery_list").height())
    wide = round(85.0 / 25.4 * 300.0)
    assert sheet.shape == (round(wide * height / width), wide, 3)
    assert sheet[0, 0].tolist() == [255, 255, 255]
    # each thumbnail has its colours in the saved picture
    shares = [
        (sheet[..., 0] - sheet[..., 2] > 60).mean(),
        (sheet[..., 2] - sheet[..., 0] > 60).mean(),
    ]
    assert min(shares) > 0.02


@pytest.mark.slow
def test_options_of_a_saved_picture_are_offered_again(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = opened(qtbot, window)
    asked = asking(qtbot, dialog)
    for name in ("width", "dpi", "background"):
        QTest.keyClick(part(asked, f"figure_{name}_combo"), Qt.Key.Key_Down)
    chosen = asked.options
    assert (chosen.width_mm, chosen.dpi, chosen.background) == (114.0, 600, "transparent")
    enter(asked, tmp_path / "sheet.png")
    dialog.close()
    qtbot.waitUntil(lambda: not window.findChildren(QDialog, "gallery_dialog"), timeout=PATIENCE)
    assert asking(qtbot, opened(qtbot, window)).options == chosen


def asking(qtbot: QtBot, dialog: QDialog) -> QDialog:
    """Press the button that saves the gallery; return the dialog of the picture."""
    qtbot.waitUntil(part(dialog, "gallery_save_button").isEnabled, timeout=PATIENCE)
    QTest.mouseClick(part(dialog, "gallery_save_button"), LEFT)
    asked = dialog.findChild(QDialog, "figure_dialog")
    qtbot.waitUntil(asked.isVisible, timeout=PATIENCE)
    return asked


def ask(qtbot: QtBot, dialog: QDialog, path: Path) -> None:
    enter(asking(qtbot, dialog), path)


def enter(asked: QDialog, path: Path) -> None:
    edit = part(asked, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    QTest.keyClick(edit, Qt.Key.Key_Return)


@pytest.mark.slow
def test_cancel_and_closing_leave_no_file(qtbot: QtBot, window: MainWindow, tmp_path: Path) -> None:
    dialog = opened(qtbot, window)
    for name in ("cancel", "close"):
        ask(qtbot, dialog, tmp_path / "sheet.png")
        progress = part(dialog, "gallery_progress_bar")
        qtbot.waitUntil(lambda: progress.value() >= 1, timeout=PATIENCE)  # noqa: B023
        assert progress.value() < progress.maximum()
        button = part(dialog, f"gallery_{name}_button")
        QTest.mouseClick(button, LEFT, pos=QPoint(5, 5))
        qtbot.wait(300)
        assert not list(tmp_path.iterdir())
    assert not window.findChildren(QDialog, "gallery_dialog")
    again = opened(qtbot, window)
    window.close()
    assert not again.isVisible()


@pytest.mark.slow
def test_what_cannot_be_told_of_zeros_alone_is_said(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    window = open_window(rectangle_document(1))
    window.document.display.kind = "wks"
    window.actions_["gallery"].trigger()
    dialog = window.findChild(QDialog, "gallery_dialog")
    assert "eigenvalues are zero" in part(dialog, "gallery_remark_label").text()
    assert not part(dialog, "gallery_save_button").isEnabled()
    window.document.display.kind = "eigenfunction"
    filled(qtbot, window)
    assert part(dialog, "gallery_save_button").isEnabled()
    window.actions_["save_movie"].trigger()
    assert window.findChild(QDialog, "movie_dialog") is not None

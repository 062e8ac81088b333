"""Dialog of movies, used by mouse and keys."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from closed_form import part, rectangle_document
from PIL import Image
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.dialogs import movie_dialog
from meshmash_viewer.app.main_window import MainWindow

LEFT = Qt.MouseButton.LeftButton
KEYS = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
PATIENCE = 60_000


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window(rectangle_document(30))


def opened(qtbot: QtBot, window: MainWindow, path: Path) -> QDialog:
    """Open the dialog; enter a small size and the path."""
    QTest.keyClick(window, Qt.Key.Key_M, KEYS)
    dialog = window.findChild(QDialog, "movie_dialog")
    dialog.activateWindow()
    qtbot.waitUntil(dialog.isActiveWindow, timeout=PATIENCE)
    type_in(dialog, movie_width_spin="160", movie_height_spin="120")
    edit = part(dialog, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    return dialog


def type_in(dialog: QDialog, **texts: str) -> None:
    for name, text in texts.items():
        spin = part(dialog, name)
        spin.setFocus()
        spin.selectAll()
        QTest.keyClicks(spin, text)
        QTest.keyClick(spin, Qt.Key.Key_Tab)


@pytest.mark.slow
@pytest.mark.pixels
def test_a_sweep_is_described_and_made(qtbot: QtBot, window: MainWindow, tmp_path: Path) -> None:
    out = tmp_path / "film.gif"
    dialog = opened(qtbot, window, out)
    type_in(dialog, movie_first_spin="2", movie_last_spin="6")
    length = part(dialog, "movie_length_label")
    assert length.text() == "5 frames, 1.25 s"
    QTest.mouseClick(part(dialog, "movie_save_button"), LEFT)
    qtbot.waitUntil(out.exists, timeout=PATIENCE)
    qtbot.waitUntil(lambda: not window.findChildren(QDialog, "movie_dialog"), timeout=PATIENCE)
    assert f"Movie saved to {out}" in part(window, "message_text").text()
    frames, length = [], 0.0
    with Image.open(out) as image:
        assert (image.size, image.n_frames) == ((160, 120), 5)
        for at in range(5):
            image.seek(at)
            frames.append(np.asarray(image.convert("RGB")).astype(int))
            length += image.info["duration"]
    assert length == 1250.0
    assert min(np.abs(one - other).mean() for one, other in pairwise(frames)) > 2.0
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.slow
def test_a_turn_can_be_cancelled_and_leaves_nothing(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = opened(qtbot, window, tmp_path / "turn.mp4")
    motion = part(dialog, "movie_motion_combo")
    QTest.keyClick(motion, Qt.Key.Key_Down)
    assert not part(dialog, "movie_first_spin").isEnabled()
    assert part(dialog, "movie_length_label").text() == "150 frames, 6 s"
    progress = part(dialog, "movie_progress_bar")
    for way in ("cancel", "close"):
        QTest.mouseClick(part(dialog, "movie_save_button"), LEFT)
        qtbot.waitUntil(lambda: progress.value() >= 2, timeout=PATIENCE)
        assert progress.isVisible()
        assert not motion.isEnabled()
        assert [each.name.startswith(".") for each in tmp_path.iterdir()] == [True]
        if way == "cancel":
            QTest.keyClick(dialog, Qt.Key.Key_Escape)
            assert dialog.isVisible()
            assert motion.isEnabled()
            assert not progress.isVisible()
        else:
            window.close()
        # the thread, not ffmpeg, is waited for
        qtbot.waitUntil(lambda: not list(tmp_path.iterdir()), timeout=1_000)


@pytest.mark.slow
def test_what_cannot_be_filmed_is_said_before(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sentence = "An MP4 needs imageio-ffmpeg, which is not installed."
    monkeypatch.setattr(
        movie_dialog, "missing_encoder", lambda ending: sentence if ending == ".mp4" else ""
    )
    dialog = opened(qtbot, window, tmp_path / "film.gif")
    formats, remark = part(dialog, "movie_format_combo"), part(dialog, "movie_remark_label")
    save = part(dialog, "movie_save_button")
    assert formats.currentData() == ".gif", "the name says which"
    assert not formats.model().item(formats.findData(".mp4")).isEnabled()
    assert remark.text() == sentence
    assert save.isEnabled()
    type_in(dialog, movie_rate_spin="20", movie_seconds_spin="9")
    assert "180 frames are more than the 30 columns" in remark.text()
    assert not save.isEnabled()
    type_in(dialog, movie_seconds_spin="1")
    assert save.isEnabled()
    edit = part(dialog, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(tmp_path / "nowhere" / "film.gif"))
    QTest.mouseClick(save, LEFT)
    assert "nowhere" in remark.text()
    assert dialog.isVisible()


@pytest.mark.slow
def test_a_size_that_is_refused_starts_no_movie(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = opened(qtbot, window, tmp_path / "film.gif")
    width, remark = part(dialog, "movie_width_spin"), part(dialog, "movie_remark_label")
    dialog.activateWindow()
    width.setFocus()
    qtbot.waitUntil(width.hasFocus, timeout=PATIENCE)
    width.selectAll()
    QTest.keyClicks(width, "5")  # fewer than 16 pixels
    QTest.mouseClick(part(dialog, "movie_save_button"), LEFT)
    assert not part(dialog, "movie_progress_bar").isVisible()
    qtbot.waitUntil(lambda: "16" in remark.text(), timeout=PATIENCE)

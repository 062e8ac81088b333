from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.dialogs.files import FileRow


@pytest.fixture
def row(qtbot: QtBot) -> FileRow:
    row = FileRow(Path("/data/bunny_hks.npz"), "NumPy (*.npz)", ".npz")
    qtbot.addWidget(row)
    return row


@pytest.mark.parametrize("text", ["/data/cow", "~/cow", "~nobody-of-this-name/cow"])
def test_a_path_can_be_typed_letter_by_letter(row: FileRow, text: str) -> None:
    row.edit.selectAll()
    for letter in text:
        QTest.keyClicks(row.edit, letter)
        assert row.path is not None  # read after each key, to check whether the file exists
    assert row.named
    assert row.path.name == "cow.npz"
    assert (row.path.parent == Path.home()) == text.startswith("~/")


@pytest.mark.parametrize("text", ["", "  ", "/", "/data/", "."])
def test_a_folder_names_no_file_whatever_the_format(row: FileRow, text: str) -> None:
    row.edit.setText(text)
    assert not row.named
    row.set_ending(".csv", "CSV (*.csv)")
    assert not row.named
    row.edit.setText("/data/cow")
    assert row.path == Path("/data/cow.csv")


def test_another_format_changes_the_ending(row: FileRow) -> None:
    row.set_ending(".func.gii", "GIFTI (*.func.gii)")
    assert row.edit.text() == "/data/bunny_hks.func.gii"

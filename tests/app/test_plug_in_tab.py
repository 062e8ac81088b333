"""A family of a plug-in in the window, and the message about an unusable plug-in."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_plug_ins import ROOT, broken, good  # noqa: F401  fixtures

CODE = """
import time
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QListWidget, QSlider
import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

def until(holds):
    end = time.monotonic() + 120.0
    while not holds():
        assert time.monotonic() < end
        QTest.qWait(20)

window = mv.view(mv.read_mesh(sample_path("two_components")), block=False)
document = window.document
until(lambda: window.loaded)
print(*(each.text() for each in window.findChildren(QLabel) if "plug-in" in each.text()), sep="|")
until(lambda: document.solve.can_compute)
document.solve.compute()
until(lambda: document.solve.is_computed)
families = window.findChild(QListWidget, "field_list")
(row,) = families.findItems("Wavelets", Qt.MatchFlag.MatchExactly)
QTest.mouseClick(families.viewport(), Qt.MouseButton.LeftButton,
                 pos=families.visualItemRect(row).center())
until(lambda: window.controller.idle and document.display.kind == "wavelets")
slider = window.findChild(QSlider, "wavelets_slider")
slider.setFocus()
QTest.keyClick(slider, Qt.Key.Key_Right)
label = window.findChild(QLabel, "wavelets_quantity_label")
until(lambda: window.controller.idle and "λ" in label.text())
print(document.display.family.column, label.text())
window.close()
"""


@pytest.mark.slow
@pytest.mark.usefixtures("qapp")
def test_a_family_of_a_plug_in_is_chosen_and_stepped_through(
    good: Path,  # noqa: F811
    broken: Path,  # noqa: F811
) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (good, broken, ROOT)))}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CODE],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    said, shown = done.stdout.splitlines()
    assert "of broken 0.3 cannot be used" in said
    assert shown.startswith("1 λ = ")

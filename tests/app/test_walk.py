"""Random actions in the window: no exception, no warning, and no leak."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from fuzz.walk import Walk
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication


@pytest.fixture
def walk(qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Walk]:
    monkeypatch.chdir(tmp_path)  # a typed path may be a file name alone
    walk = Walk(tmp_path, seed=20)
    yield walk
    walk.close()


@pytest.mark.slow
@pytest.mark.usefixtures("own_process")
# pytest-qt would catch exceptions before the walk does
@pytest.mark.qt_no_exception_capture
def test_five_hundred_actions(walk: Walk) -> None:
    with walk.watched():
        walk.begin()
        walk.walk(100)
        before = walk.measure()
        walk.walk(400)
        after = walk.measure()
        for _ in range(5):
            if after.meshes > before.meshes:  # threads may still refer to meshes
                QTest.qWait(1000)
                after = walk.measure()
    assert not walk.faults, "\n".join(walk.faults)
    assert after.meshes <= before.meshes
    assert after.widgets <= before.widgets + 20
    # Matplotlib keeps used fonts open, and threads are created when first needed
    assert after.files <= before.files + 30
    assert after.threads <= before.threads + 4
    # work in pieces leaves two processes that track shared resources, and no worker
    assert after.processes <= before.processes + 2
    if not math.isnan(after.small):
        assert after.small <= before.small + 40.0
    # compiled loops of features take 110 MB once; if nothing is freed, it is over 200 MB
    assert after.megabytes <= before.megabytes + 190.0

"""Labels of the Mesh panel whose text is copied by their context menus."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapes
from PySide6.QtCore import QPoint, Qt, QTimer
from PySide6.QtGui import QContextMenuEvent, QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow

PATIENCE = 60_000


def copied(label: QLabel) -> str:
    """Return what the first entry of the context menu of a label copies."""

    def choose() -> None:
        menu = QApplication.activePopupWidget()
        if menu is not None:
            timer.stop()
            QTest.keyClick(menu, Qt.Key.Key_Down)
            QTest.keyClick(menu, Qt.Key.Key_Return)

    QGuiApplication.clipboard().clear()
    timer = QTimer(interval=50)
    timer.timeout.connect(choose)
    timer.start()
    place = QPoint(5, 5)
    at = label.mapToGlobal(place)
    QApplication.sendEvent(label, QContextMenuEvent(QContextMenuEvent.Reason.Mouse, place, at))
    return QGuiApplication.clipboard().text()


def test_proof_and_path_are_copied(qtbot: QtBot, window: MainWindow, tmp_path: Path) -> None:
    ball = shapes.icosphere(2)
    folder = tmp_path / "a folder with quite a long name" / "and another one that is long"
    folder.mkdir(parents=True)
    np.savez(path := folder / "ball.npz", vertices=ball.vertices, faces=ball.faces)
    window.open_mesh(path)
    qtbot.waitUntil(lambda: window.document.mesh is not None, timeout=PATIENCE)
    qtbot.waitUntil(lambda: window.document.work.job is None, timeout=PATIENCE)
    shown, proof = (window.findChild(QLabel, name) for name in ("mesh_path_label", "proof_label"))
    qtbot.waitUntil(lambda: "…" in shown.text(), timeout=PATIENCE)
    assert copied(shown) == str(path)
    window.document.solve.compute()
    qtbot.waitUntil(lambda: "complete" in proof.text(), timeout=PATIENCE)
    assert copied(proof) == proof.text()
    proof.setSelection(0, 5)
    assert copied(proof) == proof.text()[:5]

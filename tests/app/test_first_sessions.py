"""First sessions of the README by mouse and keys, in small and large, light and dark windows."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from closed_form import drag, turn_wheel
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QFileDialog, QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.notices import Severity

LEFT = Qt.MouseButton.LeftButton
KEYS, CONTROL = Qt.Key, Qt.KeyboardModifier.ControlModifier
PATIENCE = 120.0

#: Actions of each session with their arguments; ``until`` waits for that method of `Person`.
SESSIONS: dict[str, tuple[tuple[Any, ...], ...]] = {
    "open a mesh and compute": (
        ("press", KEYS.Key_O, CONTROL),
        ("until", "opened"),
        ("type", "unit_combo", "nm"),
        ("type", "target_count_spin", "40"),
        ("click", "compute_button"),
        ("until", "computed"),
    ),
    "scroll": (
        ("click", "scene_canvas", 0.02, 0.98),
        ("press", KEYS.Key_Home),
        ("press", KEYS.Key_PageDown),
        ("press", KEYS.Key_Right),
        ("wheel", "scene_canvas", 2),
        ("press", KEYS.Key_Left),
        ("press", KEYS.Key_N),
        ("press", KEYS.Key_F),
        ("until", "drawn"),
        ("until", "scrolled"),
        ("press", KEYS.Key_Space),
        ("until", "played"),
        ("press", KEYS.Key_Space),
    ),
    "tune, compare and export": (
        ("press", KEYS.Key_2),
        ("drag", "hks_time_slider", (0.5, 0.5), (0.8, 0.5)),
        ("press", KEYS.Key_3),
        ("click", "scene_canvas", 0.45, 0.55),
        ("until", "pinned"),
        ("press", KEYS.Key_S),
        ("until", "compared"),
        ("press", KEYS.Key_3),
        ("press", KEYS.Key_E, CONTROL),
        ("until", "asked"),
        ("type", "file_edit", "bands.npz"),
        ("until", "written"),
    ),
}


class Person:
    """Mouse and key actions in a window, and checks of their effects."""

    def __init__(self, window: MainWindow, folder: Path) -> None:
        self.window, self.folder = window, folder
        self.document = window.document

    def part(self, name: str) -> QWidget:
        found = [each for each in self.window.findChildren(QWidget, name) if each.isVisible()]
        assert found, f"{name} is not in sight"
        return found[-1]

    def at(self, widget: QWidget, across: float, down: float) -> QPoint:
        return QPoint(round(across * widget.width()), round(down * widget.height()))

    def do(self, verb: str, *what: Any) -> None:
        if verb == "until":
            deadline = time.monotonic() + PATIENCE
            condition: Callable[[], bool] = getattr(self, what[0])
            while not condition():
                assert time.monotonic() < deadline, f"not {what[0]}: {self.state()}"
                QTest.qWait(10)
        elif verb == "press":
            QTest.keyClick(self.window, *what)
        elif verb == "type":
            field = self.part(what[0])
            QTest.mouseClick(field, LEFT, pos=self.at(field, 0.3, 0.5))
            text = str(self.folder / what[1]) if what[0] == "file_edit" else what[1]
            QTest.keyClick(field, Qt.Key.Key_A, CONTROL)
            QTest.keyClicks(field, text)
            QTest.keyClick(field, Qt.Key.Key_Return)
        elif verb == "click":
            part = self.part(what[0])
            QTest.mouseClick(part, LEFT, pos=self.at(part, *(what[1:] or (0.5, 0.5))))
        elif verb == "wheel":
            turn_wheel(self.part(what[0]), what[1], CONTROL)
        else:
            part = self.part(what[0])
            drag(part, *[self.at(part, *place) for place in what[1:]])
        catch_up()

    def state(self) -> str:
        document, focus = self.document, QApplication.focusWidget()
        labels = {each.text() for each in self.window.findChildren(QLabel) if each.isVisible()}
        return f"{document.solve.target} {document.work.job} {document.spectrum} {focus} {labels}"

    # -- conditions for ``until`` -------------------------------------------------------------

    def opened(self) -> bool:
        return self.document.mesh is not None and self.document.work.job is None

    def computed(self) -> bool:
        spectrum = self.document.spectrum
        done = spectrum is not None and spectrum.complete and self.document.work.job is None
        proof = self.window.findChild(QLabel, "proof_label")
        return done and proof.isVisible() and "40 pairs · complete" in proof.text()

    def drawn(self) -> bool:
        caption = self.window.scene.renderer.caption
        return caption is not None and caption.lines == 0.0

    def scrolled(self) -> bool:
        shown = self.document.display[Eigenfunctions]
        title = self.window.scene.renderer.caption.title
        label = self.window.findChild(QLabel, "eigenvalue_label").text()
        return (
            (shown.index, shown.flipped) == (12, frozenset({12}))
            and title == "Eigenfunction 12"
            and label.startswith("λ₁₂ = ")
        )

    def played(self) -> bool:
        return self.document.display[Eigenfunctions].index >= 14

    def pinned(self) -> bool:
        return len(self.document.pins.placed) == 1

    def compared(self) -> bool:
        (pin,) = self.document.pins.placed
        field = self.window.controller.field
        chosen = self.document.display[Similarity]
        return field.family.name == "similarity" and chosen.vertex == pin.vertex

    def asked(self) -> bool:
        return any(each.isVisible() for each in self.window.findChildren(QDialog, "export_dialog"))

    def written(self) -> bool:
        return (self.folder / "bands.npz").exists() and self.document.work.job is None


@pytest.fixture(
    params=[
        pytest.param((900, 600), id="small"),
        pytest.param((1440, 900), id="large", marks=pytest.mark.slow),
    ]
)
def person(
    qapp: QApplication,
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Person]:
    mesh = shapes.icosphere(3, radius=500.0)
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(path), ""))
    window = MainWindow(fresh=True)
    window.resize(*request.param)
    window.show()
    window.activateWindow()
    person = Person(window, tmp_path)
    person.active = window.isActiveWindow  # type: ignore[attr-defined]
    person.do("until", "active")
    yield person
    window.close()
    window.deleteLater()
    theme.set_mode(theme.Mode.SYSTEM)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [theme.Mode.LIGHT, theme.Mode.DARK])
def test_the_first_sessions(person: Person, mode: theme.Mode) -> None:
    window, document = person.window, person.document
    theme.set_mode(mode)
    size = window.size()
    assert window.devicePixelRatioF() == float(os.environ.get("QT_SCALE_FACTOR", "1"))
    said: list[str] = []
    document.notices.shown.connect(
        lambda notice: (
            said.append(notice.text)
            if notice is not None and notice.severity is Severity.ERROR
            else None
        )
    )
    for steps in SESSIONS.values():
        for step in steps:
            person.do(*step)
    assert not said
    assert window.size() == size
    assert document.mesh.unit == "nm"
    chosen = document.display[HeatKernelSignature]
    low, high = chosen.range(document.spectrum)
    assert np.log(chosen.time_in(document.spectrum) / low) / np.log(high / low) > 0.7
    with np.load(person.folder / "bands.npz") as file:
        features = file["features"]
    assert features.shape == (642, document.display[GeometryVectors].count)
    # the bands sum to one, so the columns sum to the sum of the squared eigenfunctions
    squares = (np.asarray(document.spectrum.rows) ** 2).sum(axis=0)
    np.testing.assert_allclose(features.sum(axis=1), squares, rtol=1e-6)


@pytest.mark.slow
def test_the_first_sessions_at_a_scale_of_two() -> None:
    # Qt reads its scale when the application starts, hence the new process.
    test = f"{__file__}::{test_the_first_sessions.__name__}"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test, "-k", "small"],
        env={**os.environ, "QT_SCALE_FACTOR": "2"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert "2 passed" in done.stdout, done.stdout

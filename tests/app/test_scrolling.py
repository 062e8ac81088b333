"""Scrolling through eigenfunctions by real events."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
import shapes
from closed_form import turn_wheel
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QSpinBox
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.model.limits import SymmetricLimits
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

CONTROL = Qt.KeyboardModifier.ControlModifier
PATIENCE = 60_000
PAIRS = 230


@pytest.fixture
def window(qtbot: QtBot, open_window: Callable[..., MainWindow]) -> MainWindow:
    """A window with a mesh of 10 000 vertices and random eigenpairs."""
    window = open_window()
    mesh = shapes.icosphere(5)
    window.document.take_mesh(mesh)
    qtbot.waitUntil(
        lambda: window.document.mesh is not None and window.document.work.job is None,
        timeout=PATIENCE,
    )
    rows = np.random.default_rng(0).standard_normal((PAIRS, mesh.n_vertices))
    values = np.arange(PAIRS, dtype=np.float64)
    proven = Certificate("dense", PAIRS, PAIRS)
    window.document.accept_spectrum(Eigenpairs(values, rows, np.zeros(PAIRS), certificate=proven))
    qtbot.waitUntil(lambda: window.controller.idle, timeout=PATIENCE)
    return window


@pytest.mark.slow
def test_two_hundred_notches_in_a_row(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed_in: list[int] = []
    seen: list[object] = []  # keeps the arrays, so that no id is used twice
    limits = SymmetricLimits.limits

    turned = threading.Event()

    def counted(policy: SymmetricLimits, values: object, *others: object) -> tuple[float, float]:
        turned.wait(60.0)  # until all notches are sent
        computed_in.append(threading.get_ident())
        seen.append(values)
        return limits(policy, values, *others)

    monkeypatch.setattr(SymmetricLimits, "limits", counted)
    source, display = window.controller, window.document.display
    fields: list[object] = []
    source.drawn.connect(lambda field, _: fields.append(field))
    start, canvas = display[Eigenfunctions].index, window.findChild(RenderWidget)
    turn_wheel(canvas, 200, CONTROL)
    turned.set()
    assert display[Eigenfunctions].index == start + 200, "no notch is lost"
    qtbot.waitUntil(lambda: source.idle, timeout=PATIENCE)
    catch_up()
    row = window.document.spectrum.rows[start + 200].astype(np.float32)
    np.testing.assert_array_equal(window.scene.renderer.surface.values, row)
    assert window.scene.renderer.caption.quantity == source.field.quantity
    label = window.findChild(QLabel, "eigenvalue_label")
    assert label.text() == "λ₂₀₁ = 201"
    assert len(fields) < 20, "what was scrolled past is not computed"
    assert threading.get_ident() not in computed_in, "the window never waits for limits"
    assert len({id(values) for values in seen}) == len(seen), "once a field"
    assert len(seen) < 20, "nor what may come next, at every notch"

    count = len(fields)
    qtbot.wait(150)
    assert len(fields) == count
    assert source.idle, "nothing is left in the queue"


@pytest.mark.slow
def test_a_film_has_its_nodal_lines_in_every_picture(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, display = window.scene, window.document.display
    window.stage.setFocus()
    catch_up()
    display.change(Eigenfunctions, index=3)
    QTest.keyClick(window, Qt.Key.Key_N)
    qtbot.waitUntil(lambda: scene.renderer.caption.lines == 0.0, timeout=PATIENCE)
    catch_up()
    drawn: list[tuple[int, bool, int]] = []
    draw, spin = scene.plotter.draw, window.findChild(QSpinBox, "eigenvector_spin")

    def slowly() -> None:
        draw()
        time.sleep(0.1)  # as on a large mesh without a graphics card
        shown = int(scene.renderer.caption.title.split()[-1])
        drawn.append((shown, scene.renderer.caption.lines == 0.0, spin.value()))

    monkeypatch.setattr(scene.plotter, "draw", slowly)
    QTest.keyClick(window, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: len({shown for shown, _, _ in drawn}) > 5, timeout=PATIENCE)
    QTest.keyClick(window, Qt.Key.Key_Space)
    assert all(lines for _, lines, _ in drawn)
    pictures = itertools.pairwise(drawn)
    assert all(said >= before for (before, *_), (*_, said) in pictures), "the panel keeps up"
    qtbot.waitUntil(lambda: window.controller.idle and spin.value() == display.family.index)
    last = f"Eigenfunction {spin.value()}"
    qtbot.waitUntil(lambda: scene.renderer.caption.title == last, timeout=PATIENCE)

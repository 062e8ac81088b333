"""The shape from the lowest eigenfunctions: drawn, morphed, vibrating, saved, restored."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QLabel,
    QPushButton,
    QSlider,
    QSpinBox,
    QWidget,
)
from vtkmodules.util.numpy_support import vtk_to_numpy

import meshmash_viewer as mv
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.model.display import Shape, display_to_json, read_display
from meshmash_viewer.model.script import reproduction_script
from meshmash_viewer.spectral.weyl import Target

LEFT = Qt.MouseButton.LeftButton
RADIUS, PAIRS = 50.0, 40


def bumpy() -> mv.Mesh:
    """Return a dented ellipsoid far from the origin, without equal eigenvalues."""
    ball = shapes.icosphere(3, radius=RADIUS)
    along = ball.vertices / RADIUS
    dents = 1.0 + 0.1 * np.sin(9.0 * along[:, :1]) * np.cos(7.0 * along[:, 1:2])
    return mv.Mesh(ball.vertices * dents * [1.0, 1.3, 1.7] + 1e5, ball.faces, unit="nm")


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(10)
    catch_up()


def rest(window: MainWindow) -> None:
    QTest.qWait(5)
    window.wait(60.0)
    catch_up()


def part(window: MainWindow, kind: type, name: str) -> QWidget:
    (found,) = window.findChildren(kind, name)
    return found


def drawn(window: MainWindow) -> np.ndarray:
    """Return the vertices in VTK, in mesh coordinates."""
    scene = window.scene.renderer
    assert scene.surface is not None
    return vtk_to_numpy(scene.surface.data.GetPoints().GetData()) + scene.centre


@pytest.fixture(scope="module")
def one_window(
    tmp_path_factory: pytest.TempPathFactory, module_cache: Path
) -> Iterator[MainWindow]:
    application()
    folder = tmp_path_factory.mktemp("shape")
    mesh = bumpy()
    np.savez(folder / "ball.npz", vertices=mesh.vertices, faces=mesh.faces)
    window = MainWindow(fresh=True)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    window.open_mesh(folder / "ball.npz", "nm")
    wait_for(lambda: window.document.mesh is not None)
    rest(window)
    assert not part(window, QCheckBox, "shape_check").isEnabled()
    window.document.solve.target = Target("count", PAIRS)
    QTest.mouseClick(window.mesh_panel.compute_button, LEFT)
    wait_for(lambda: bool(window.document.spectrum and window.document.spectrum.complete))
    rest(window)
    window.arrangement.docks["shape"].raise_()
    QTest.qWait(50)
    yield window
    window.close()
    window.deleteLater()


@pytest.fixture
def window(one_window: MainWindow) -> MainWindow:
    display = one_window.document.display
    display.shape, display.vibrating, display.kind = Shape(), False, "eigenfunction"
    rest(one_window)
    np.testing.assert_array_equal(drawn(one_window), at_home(one_window))
    return one_window


def at_home(window: MainWindow) -> np.ndarray:
    centre = window.scene.renderer.centre
    return (window.document.mesh.vertices - centre).astype(np.float32) + centre


def rebuilt(window: MainWindow, count: int) -> np.ndarray:
    """Return the vertices as a sum over eigenpairs, weighted by area."""
    mesh, spectrum = window.document.mesh, window.document.spectrum
    mass = mv.compute_vertex_areas(mesh, robust=True)
    centre = np.average(mesh.vertices, axis=0, weights=mass)
    rows = np.asarray(spectrum.rows[:count], dtype=np.float64)
    return rows.T @ (rows @ (mass[:, np.newaxis] * (mesh.vertices - centre))) + centre


def type_number(window: MainWindow, name: str, number: int) -> None:
    spin = part(window, QSpinBox, name)
    spin.setFocus()
    spin.selectAll()
    QTest.keyClicks(spin, str(number))
    QTest.keyClick(spin, Qt.Key.Key_Return)
    rest(window)


def click_check(window: MainWindow) -> None:
    check = part(window, QCheckBox, "shape_check")
    QTest.mouseClick(check, LEFT, pos=check.rect().center() - check.rect().center() / 1.2)
    rest(window)


def described(window: MainWindow) -> str:
    """Return the last part of the line below the title of saved pictures."""
    return window.scene.renderer.twin().shown_caption.quantity.split(" · ")[-1]


def test_the_mesh_is_drawn_from_its_lowest_eigenfunctions_and_back(window: MainWindow) -> None:
    colours = np.array(window.scene.renderer.surface.values)
    type_number(window, "shape_pairs_spin", 16)
    assert part(window, QCheckBox, "shape_check").isChecked()
    wanted = rebuilt(window, 16)
    np.testing.assert_allclose(drawn(window), wanted, atol=1e-3)
    assert np.abs(wanted - window.document.mesh.vertices).max() > 1.0
    np.testing.assert_array_equal(window.scene.renderer.surface.values, colours)
    mass = mv.compute_vertex_areas(window.document.mesh, robust=True)
    away = np.linalg.norm(wanted - window.document.mesh.vertices, axis=1)
    told = part(window, QLabel, "shape_distance_label").text()
    assert told.endswith("\N{NO-BREAK SPACE}nm")
    assert float(told.split()[0]) == pytest.approx(
        np.sqrt(np.average(away**2, weights=mass)), rel=5e-3
    )
    shading = vtk_to_numpy(window.scene.renderer.surface.data.GetPointData().GetNormals())
    normals = mv.Mesh(wanted, window.document.mesh.faces).vertex_normals
    np.testing.assert_allclose(shading, normals, atol=1e-2)
    assert described(window) == "shape from 16 pairs"
    click_check(window)
    assert "shape" not in described(window)
    assert not window.document.display.shape.shown
    np.testing.assert_array_equal(drawn(window), at_home(window))
    assert part(window, QLabel, "shape_distance_label").text() == "–"


@pytest.mark.slow
def test_keys_on_the_sliders_lengthen_the_sum_and_morph(window: MainWindow) -> None:
    type_number(window, "shape_pairs_spin", 4)
    np.testing.assert_allclose(drawn(window), rebuilt(window, 4), atol=1e-3)
    slider = part(window, QSlider, "shape_pairs_slider")
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_Right)
    rest(window)
    assert slider.value() == 5
    np.testing.assert_allclose(drawn(window), rebuilt(window, 5), atol=1e-3)
    QTest.keyClick(slider, Qt.Key.Key_End)
    rest(window)
    assert described(window) == f"shape from {PAIRS} pairs"
    everything = rebuilt(window, PAIRS)
    np.testing.assert_allclose(drawn(window), everything, atol=1e-3)
    morph = part(window, QSlider, "shape_morph_slider")
    morph.setFocus()
    for _ in range(4):
        QTest.keyClick(morph, Qt.Key.Key_PageUp)
    rest(window)
    assert part(window, QLabel, "shape_morph_label").text() == "60\N{NO-BREAK SPACE}%"
    assert described(window) == f"shape from {PAIRS} pairs (60 %)"
    between = 0.4 * window.document.mesh.vertices + 0.6 * everything
    np.testing.assert_allclose(drawn(window), between, atol=1e-3)


@pytest.mark.slow
@pytest.mark.pixels
def test_what_is_on_the_mesh_goes_with_it(window: MainWindow) -> None:
    vertex = 17
    before = window.scene.display_point(vertex)
    type_number(window, "shape_pairs_spin", 4)
    wait_for(lambda: window.scene.can_pick)
    here = window.scene.display_point(vertex)
    assert (here - before).manhattanLength() > 0
    drawing = window.scene.renderer
    eye = drawing.view.axes[2]
    facing = mv.Mesh(drawn(window), window.document.mesh.faces).vertex_normals @ eye
    assert np.count_nonzero(facing[::40] > 0.2) > 3
    for other in range(0, window.document.mesh.n_vertices, 40):
        if facing[other] > 0.2 and not drawing.picker.hidden(other, eye):
            at = window.scene.display_point(other)
            assert window.scene.vertex_at(at.x(), at.y()) == other
    QTest.keyClick(window, Qt.Key.Key_Right)
    rest(window)
    plain = window.scene.picture((640, 480))[..., :3].max(axis=2)
    window.document.display.nodal_lines = True
    lined = window.scene.picture((640, 480))[..., :3].max(axis=2)
    assert ((lined < 60) & (plain > 90)).sum() > 50
    window.document.display.nodal_lines = False
    np.testing.assert_allclose(window.to_pyvista().points, drawn(window), atol=1e-2)


@pytest.mark.slow
def test_the_field_swings_along_the_normals(window: MainWindow) -> None:
    button = part(window, QPushButton, "shape_vibrate_button")
    QTest.keyClick(window, Qt.Key.Key_3, Qt.KeyboardModifier.NoModifier)
    window.document.display.kind = "eigenfunction"
    rest(window)
    QTest.mouseClick(button, LEFT)
    wait_for(lambda: np.abs(drawn(window) - at_home(window)).max() > 1.0)
    away = drawn(window) - at_home(window)
    along = np.einsum("ij,ij->i", away, window.document.mesh.vertex_normals)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), np.abs(along), atol=1e-2)
    values = window.controller.field.values
    assert abs(np.corrcoef(along, values)[0, 1]) > 0.999
    size = np.linalg.norm(np.ptp(window.document.mesh.vertices, axis=0))
    assert np.abs(along).max() <= 0.0501 * size
    assert not window.scene.can_pick
    assert button.text() == "Stop"
    QTest.mouseClick(button, LEFT)
    rest(window)
    np.testing.assert_array_equal(drawn(window), at_home(window))
    wait_for(lambda: window.scene.can_pick)
    window.document.display.kind = "hks"
    rest(window)
    assert not button.isEnabled()


@pytest.mark.slow
def test_the_shape_is_saved(
    window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not part(window, QPushButton, "shape_save_button").isEnabled()
    type_number(window, "shape_pairs_spin", 16)
    path = tmp_path / "smooth.ply"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    QTest.mouseClick(part(window, QPushButton, "shape_save_button"), LEFT)
    text = part(window, QLabel, "message_text")
    wait_for(lambda: f"Shape written to {path}" in text.text())
    again = mv.read_mesh(path)
    np.testing.assert_allclose(again.vertices, rebuilt(window, 16), atol=1e-4)
    assert again.unit == "nm"
    path = tmp_path / "lh.smooth.surf.gii"  # a format in mm
    QTest.mouseClick(part(window, QPushButton, "shape_save_button"), LEFT)
    wait_for(lambda: f"Shape written to {path}" in text.text())
    again = mv.read_mesh(path)
    np.testing.assert_allclose(again.vertices * 1e6, rebuilt(window, 16), rtol=1e-4, atol=1e-3)
    assert (again.unit, again.structure) == ("mm", "CortexLeft")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(tmp_path / "a.xyz"), ""))
    QTest.mouseClick(part(window, QPushButton, "shape_save_button"), LEFT)
    wait_for(lambda: ".ply" in text.text() and "xyz" in text.text())


def test_a_session_and_a_script_have_the_shape(window: MainWindow, tmp_path: Path) -> None:
    window.document.display.shape = Shape(True, 9, 0.5, 0.1)
    rest(window)
    path = tmp_path / "a.meshmash.json"
    window.opening.store_session(path)
    window.document.display.shape = Shape()
    window.opening.restore_session(path)
    wait_for(lambda: window.document.display.shape == Shape(True, 9, 0.5, 0.1))
    script = reproduction_script(window.document)
    assert "vertices = low_pass_vertices(mesh, decomposition, 9)" in script
    assert "0.5 * (vertices - mesh.vertices)" in script
    content = json.loads(path.read_text(encoding="utf-8"))["meshes"][0]["display"]
    assert content == display_to_json(window.document.display)
    for name, value in (("pairs", 3), ("morph", 1.5), ("shown", 1), ("amplitude", -0.1)):
        with raises("invalid-entry", f"display.shape.{name}"):
            read_display({"shape": {name: value}}, path)
    wait_for(lambda: window.document.spectrum is not None)
    rest(window)

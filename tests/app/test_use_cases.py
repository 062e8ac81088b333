"""Uses of spectral filtering in the window, on the render and in exported files.

Each filter is chosen and each number typed by real events; the field on the render and the exported
columns are compared with the library's functions on a decomposition of the same file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QListWidget

import meshmash_viewer as mv
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

LEFT = Qt.MouseButton.LeftButton
CONTROL = Qt.KeyboardModifier.ControlModifier
PAIRS = 60
BALL = shapes.icosphere(3, radius=500.0)
#: Without symmetry, so that all eigenvalues differ and each cutoff lies between two of them.
VERTICES = BALL.vertices * [1.0, 1.3, 1.8]
VERTICES = VERTICES + 40.0 * np.sin(0.004 * VERTICES[:, [1, 2, 0]] + [0.3, 1.0, 2.0])
DEPTH = np.sin(0.01 * VERTICES[:, 0]) + 0.3 * np.cos(0.03 * VERTICES[:, 1] + 1.0)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(10)


def rest(window: MainWindow) -> None:
    QTest.qWait(20)  # for listeners of the model
    wait_for(lambda: window.document.work.job is None and window.controller.idle)
    wait_for(lambda: not window.controller.field.draft)


def write(window: MainWindow, name: str, text: object) -> None:
    """Replace the text of a field, and press Return."""
    field = part(window, name)
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, str(text))
    QTest.keyClick(field, Qt.Key.Key_Return)
    QTest.qWait(20)


def choose(listed: QListWidget, text: str) -> None:
    (item,) = listed.findItems(text, Qt.MatchFlag.MatchExactly)
    QTest.mouseClick(listed.viewport(), LEFT, pos=listed.visualItemRect(item).center())


def choose_filter(window: MainWindow, text: str, **values: float) -> None:
    """Type the formula of a filter and the values of its parameters."""
    choose(part(window, "field_list"), "Filter")
    write(window, "filter_formula_edit", text)
    assert part(window, "filter_formula_edit").text() == text, part(window, "filter_fault").text()
    for place, value in enumerate(values.values()):
        write(window, f"filter_parameter_{place}_field", repr(float(value)))
    rest(window)


def exported(window: MainWindow, path: Path) -> dict[str, np.ndarray]:
    """Export the displayed field by the dialog; return the arrays."""
    QTest.keyClick(window, Qt.Key.Key_E, CONTROL)
    wait_for(lambda: window.findChild(QDialog, "export_dialog") is not None)
    dialog = window.findChild(QDialog, "export_dialog")
    field = part(dialog, "file_edit")
    field.selectAll()
    QTest.keyClicks(field, str(path))
    maps = part(dialog, "export_maps_check")
    if maps.isChecked():
        QTest.keyClick(maps, Qt.Key.Key_Space)
    QTest.mouseClick(part(dialog, "export_button"), LEFT)
    wait_for(path.exists)
    rest(window)
    with np.load(path) as archive:
        return dict(archive)


def shown(window: MainWindow) -> np.ndarray:
    rest(window)
    return np.asarray(window.controller.field.values, dtype=np.float64)


def assert_same(found: np.ndarray, wanted: np.ndarray) -> None:
    """Compare to 1e-6 of the largest value."""
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("use_cases") / "body.npz"
    np.savez(path, vertices=VERTICES, faces=BALL.faces, depth=DEPTH)
    return path


@pytest.fixture(scope="module")
def pairs(file: Path) -> Eigenpairs:
    """Eigenpairs of the same file by the library."""
    return mv.solve(*mv.cotangent_laplacian(mv.read_mesh(file), robust=True), PAIRS)


@pytest.fixture(scope="module")
def window(file: Path, module_cache: Path) -> Iterator[MainWindow]:
    """A window with a dropped mesh and its eigenpairs."""
    application()
    opened = MainWindow(fresh=True)
    opened.show()
    opened.activateWindow()
    wait_for(opened.isActiveWindow)
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(file))])
    place = QPointF(opened.stage.mapTo(opened, opened.stage.rect().center()))
    copy, none = Qt.DropAction.CopyAction, Qt.KeyboardModifier.NoModifier
    opened.dropEvent(QDropEvent(place, copy, data, LEFT, none))
    wait_for(lambda: opened.document.mesh is not None and opened.document.work.job is None)
    write(opened, "target_count_spin", PAIRS)
    QTest.mouseClick(part(opened, "compute_button"), LEFT)
    wait_for(lambda: bool(opened.document.spectrum and opened.document.spectrum.complete))
    rest(opened)
    yield opened
    opened.close()
    opened.deleteLater()


def between(pairs: Eigenpairs, at: int) -> float:
    """Return the mean of two neighbouring eigenvalues."""
    return float(pairs.eigenvalues[at - 1 : at + 1].mean())


@pytest.mark.slow
def test_eigenpairs_are_exported(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    choose(part(window, "field_list"), "Eigenfunctions")
    rest(window)
    archive = exported(window, tmp_path / "pairs.npz")
    assert_same(archive["eigenvalues"], pairs.eigenvalues)
    found, wanted = archive["eigenvectors"], pairs.eigenvectors
    signs = np.sign((found * wanted).sum(axis=0))
    assert_same(found * signs, wanted)


@pytest.mark.slow
def test_a_custom_filter(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    """Ten filters exp(-λ/σ), with σ = 1e-6 · 2^i, are exported at once."""
    sigmas = 1e-6 * 2.0 ** np.arange(10)
    choose_filter(window, "exp(-x/s)", s=sigmas[3])
    wanted = pairs.eigenvectors**2 @ np.exp(-np.outer(pairs.eigenvalues, 1.0 / sigmas))
    assert_same(shown(window), wanted[:, 3])
    set_range(window, "filter", sigmas[0], sigmas[-1], ("filter_low_field", "filter_high_field"))
    write(window, "filter_count_spin", 10)
    archive = exported(window, tmp_path / "custom.npz")
    assert_same(archive["features"], wanted)
    write(window, "filter_count_spin", 1)


def set_range(
    window: MainWindow, tab: str, low: float, high: float, names: tuple[str, str]
) -> None:
    automatic = part(window, f"{tab}_automatic_check")
    if automatic.isChecked():
        automatic.setFocus()
        QTest.keyClick(automatic, Qt.Key.Key_Space)
        QTest.qWait(20)
    for name, value in zip(names, (low, high), strict=True):
        write(window, name, repr(float(value)))


@pytest.mark.slow
def test_a_low_pass(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    cutoff = between(pairs, 20)
    choose_filter(window, "x < c", c=cutoff)
    wanted = mv.compute_features(pairs, mv.low_pass_bank(cutoff)).values
    assert_same(wanted[:, 0], (pairs.eigenvectors[:, :20] ** 2).sum(axis=1))
    assert_same(shown(window), wanted[:, 0])
    assert_same(exported(window, tmp_path / "low.npz")["features"], wanted)


@pytest.mark.slow
def test_a_band_pass(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    low, high = between(pairs, 10), between(pairs, 40)
    choose_filter(window, "a <= x <= b", a=low, b=high)
    wanted = mv.compute_features(pairs, mv.band_pass_bank(low, high)).values
    assert_same(wanted[:, 0], (pairs.eigenvectors[:, 10:40] ** 2).sum(axis=1))
    assert_same(shown(window), wanted[:, 0])
    assert_same(exported(window, tmp_path / "band.npz")["features"], wanted)


@pytest.mark.slow
def test_a_gaussian_pyramid(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    scales = np.geomspace(3e5, 3e6, 8)
    choose_filter(window, "exp(-s*x)", s=scales[0])
    set_range(window, "filter", scales[0], scales[-1], ("filter_low_field", "filter_high_field"))
    write(window, "filter_count_spin", 8)
    wanted = pairs.eigenvectors**2 @ np.exp(-np.outer(pairs.eigenvalues, scales))
    assert_same(shown(window), wanted[:, 0])
    archive = exported(window, tmp_path / "pyramid.npz")
    assert_same(archive["features"], wanted)
    canvas = window.scene.findChild(RenderWidget)
    for level in (1, 2, 3):
        QTest.keyClick(canvas, Qt.Key.Key_Right)
        assert_same(shown(window), wanted[:, level])
    write(window, "filter_count_spin", 1)


@pytest.mark.slow
def test_heat_kernel_signatures_and_what_is_like_a_vertex(
    window: MainWindow, pairs: Eigenpairs, tmp_path: Path
) -> None:
    """A pinned vertex is compared with all others by its signature."""
    times = np.geomspace(2e5, 2e6, 12)
    choose(part(window, "field_list"), "HKS")
    set_range(window, "hks", times[0], times[-1], ("hks_t_min_field", "hks_t_max_field"))
    write(window, "hks_scales_spin", len(times))
    wanted = mv.compute_features(pairs, mv.heat_kernel_bank(times))
    by_hand = pairs.eigenvectors**2 @ np.exp(-np.outer(pairs.eigenvalues, times))
    assert_same(wanted.values, by_hand)
    slider = part(window, "hks_time_slider")
    slider.setFocus()
    for key, column in ((Qt.Key.Key_Home, 0), (Qt.Key.Key_End, -1)):
        QTest.keyClick(slider, key)
        assert_same(shown(window), by_hand[:, column])
    assert_same(exported(window, tmp_path / "hks.npz")["features"], by_hand)

    canvas = window.scene.findChild(RenderWidget)
    wait_for(lambda: window.scene.can_pick and window.scene.at_rest)
    middle = canvas.rect().center()
    QTest.mouseMove(canvas, middle)
    QTest.mouseClick(canvas, LEFT, pos=middle)
    wait_for(lambda: len(window.document.pins.placed) == 1)
    vertex = window.document.pins.placed[0].vertex
    choose(part(window, "field_list"), "Similar")
    QTest.mouseClick(part(window, "similarity_basis_hks"), LEFT)
    distances = mv.feature_distance(wanted, vertex)
    found = shown(window)
    # the window leaves out directions in which features do not vary
    assert np.abs(found - distances).max() < 3e-3 * distances.max()
    others = np.delete(np.arange(len(found)), vertex)
    assert others[found[others].argmin()] == others[distances[others].argmin()]


@pytest.mark.slow
def test_geometry_vectors(window: MainWindow, pairs: Eigenpairs, tmp_path: Path) -> None:
    top = 0.9 * float(pairs.eigenvalues[-1])
    choose(part(window, "field_list"), "Geometry vectors")
    set_range(window, "band", 0.0, top, ("band_min_field", "band_max_field"))
    write(window, "band_count_spin", 16)
    wanted = mv.compute_features(pairs, mv.bspline_bank(0.0, top, 16)).values
    archive = exported(window, tmp_path / "bands.npz")
    assert_same(archive["features"], wanted)
    slider = part(window, "band_slider")
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_Home)
    QTest.keyClick(slider, Qt.Key.Key_Right)
    assert_same(shown(window), wanted[:, 1])


def test_a_map_is_smoothed_by_its_lowest_pairs(window: MainWindow, pairs: Eigenpairs) -> None:
    choose(part(window, "field_list"), "Own maps")
    choose(part(window, "map_list"), "depth")
    QTest.mouseClick(part(window, "map_view_pairs"), LEFT)
    write(window, "map_pairs_spin", 10)
    coefficients = mv.spectral_coefficients(pairs.eigenvectors, pairs.mass, DEPTH)[:10]
    assert_same(shown(window), mv.reconstruct(pairs.eigenvectors, coefficients))


@pytest.mark.slow
def test_a_map_is_passed_through_a_filter(window: MainWindow, pairs: Eigenpairs) -> None:
    """The map is smoothed by heat flow, by a low-pass, and by a formula."""
    choose(part(window, "field_list"), "Own maps")
    choose(part(window, "map_list"), "depth")
    QTest.mouseClick(part(window, "map_view_filter"), LEFT)
    cutoff, times = between(pairs, 25), (2e5, 3e6)
    combo = part(window, "map_filter_combo")
    combo.setFocus()
    QTest.keyClicks(combo, "Low-pass")
    write(window, "map_filter_parameter_0_field", repr(cutoff))
    assert_same(shown(window), mv.filter_map(pairs, DEPTH, mv.low_pass_bank(cutoff)))
    combo.setFocus()
    QTest.qWait(QApplication.keyboardInputInterval() + 100)  # so that keys begin a new search
    QTest.keyClicks(combo, "Gaussian")
    for time_ in times:
        write(window, "map_filter_parameter_0_field", repr(time_))
        wanted = mv.filter_map(pairs, DEPTH, lambda x, t=time_: np.exp(-t * x))
        assert_same(shown(window), wanted)
        by_hand = pairs.eigenvectors.T @ (pairs.mass * DEPTH) * np.exp(-time_ * pairs.eigenvalues)
        assert_same(wanted, pairs.eigenvectors @ by_hand)
    assert "exp(-s*x), s = 3×10⁶" in window.controller.field.quantity
    choose_filter(window, "x/c * (x < c)", c=cutoff)
    choose(part(window, "field_list"), "Own maps")
    assert part(window, "map_filter_combo").currentText() == "x/c * (x < c)"
    wanted = mv.filter_map(pairs, DEPTH, lambda x: x / cutoff * (x < cutoff))
    assert_same(shown(window), wanted)
    script: list[str] = window.controller.field.family.script(window.document.spectrum)
    told = {"mv": mv, "np": np, "mesh": window.document.mesh, "decomposition": pairs}
    exec("\n".join(script), told)
    assert_same(told["values"], wanted)

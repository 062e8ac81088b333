"""Features computed in pieces: displayed as they grow, reported, written, and kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
import shapes
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QDialog, QLineEdit, QPushButton, QSpinBox, QWidget

import meshmash_viewer as mv
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.spectral.weyl import Target

LEFT = Qt.MouseButton.LeftButton
MESH = shapes.icosphere(4, radius=500.0)
#: Enough eigenpairs of a piece to reproduce the values of the whole mesh far from cuts.
PAIRS = 60


def wait_for(condition: Callable[[], bool], seconds: float = 100.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(5)
    catch_up()


@pytest.fixture(scope="module")
def one_window(
    tmp_path_factory: pytest.TempPathFactory, module_cache: Path
) -> Iterator[MainWindow]:
    application()
    folder = tmp_path_factory.mktemp("mesh")
    np.savez(folder / "ball.npz", vertices=MESH.vertices, faces=MESH.faces)
    window = MainWindow(fresh=True)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    window.open_mesh(folder / "ball.npz", "nm")
    wait_for(lambda: window.document.mesh is not None)
    window.wait(60.0)
    yield window
    window.close()
    window.deleteLater()


@pytest.fixture
def window(one_window: MainWindow) -> Iterator[MainWindow]:
    yield one_window
    for each in one_window.document.mesh.maps:
        one_window.document.maps.remove(each.name)
    one_window.document.display.kind = "eigenfunction"
    one_window.stage.message_bar.dismiss()
    one_window.wait(60.0)


def begin(window: MainWindow, path: Path, family: str, pieces: int) -> None:
    """Start a computation in pieces by its dialog."""
    window.document.solve.target = Target("count", PAIRS)
    window.actions_["compute_in_pieces"].trigger()
    (dialog,) = window.findChildren(QDialog, "pieces_dialog")
    part(dialog, QComboBox, "pieces_family_combo").setCurrentIndex(
        part(dialog, QComboBox, "pieces_family_combo").findData(family)
    )
    spin = part(dialog, QSpinBox, "pieces_count_spin")
    spin.selectAll()
    QTest.keyClicks(spin, str(pieces))
    edit = part(dialog, QLineEdit, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    QTest.mouseClick(part(dialog, QPushButton, "pieces_compute_button"), LEFT)


def part(parent: QWidget, kind: type, name: str) -> QWidget:
    (found,) = parent.findChildren(kind, name)
    return found


def stitched(family: GeometryVectors | HeatKernelSignature, pieces: int) -> np.ndarray:
    """Compute the same features by the library."""
    stitcher = mv.MeshStitcher(MESH, n_jobs=1)
    core = MESH.n_vertices / pieces
    if isinstance(family, HeatKernelSignature):
        stitcher.split_mesh(int(np.ceil(core)), t_max=family.t_max)
    else:
        stitcher.split_mesh(int(np.ceil(1.35 * core)))
    top = 4.0 * np.pi * PAIRS / MESH.area

    def features(piece: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        found = mv.solve(*mv.cotangent_laplacian(piece, robust=True), max_eigenvalue=top)
        return mv.compute_features(found, family.bank(found.eigenvalues, bound=top)).values

    return stitcher.apply(features)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hks", "band"])
def test_they_are_the_librarys(window: MainWindow, tmp_path: Path, kind: str) -> None:
    top = 4.0 * np.pi * PAIRS / MESH.area
    window.document.display.put(
        HeatKernelSignature(scales=6, automatic=False, t_min=5 / top, t_max=8 / top, time=7 / top),
        GeometryVectors(index=3, count=6, automatic=False, low=0.0, high=top),
    )
    path = tmp_path / "pieces.npz"
    grown: list[int] = []

    def note() -> None:
        for each in window.document.mesh.maps:  # none after a refusal
            grown.append(int(np.count_nonzero(np.isfinite(each.values))))

    window.document.spectrum_changed.connect(note)
    begin(window, path, kind, 3)
    if kind == "band":  # bands reach farther than a piece
        bar = window.stage.message_bar
        wait_for(lambda: bar.notice is not None and "accept the seams." in bar.notice.text)
        assert bar.notice.severity is Severity.ERROR
        assert not list(tmp_path.iterdir())
        assert not window.document.mesh.maps
        grown.clear()
        button = part(bar, QPushButton, "message_action")
        assert button.text() == "Accept the seams"
        QTest.mouseClick(button, LEFT)
    wait_for(lambda: window.document.work.job is None and path.exists())
    window.wait(60.0)
    window.document.spectrum_changed.disconnect(note)
    assert len(grown) >= 3, "piece by piece"
    assert sorted(grown) == grown
    assert grown[0] < MESH.n_vertices == grown[-1]
    with np.load(path) as file:
        values = file["features"]
    wanted = stitched(window.document.display.fields[kind], 3)
    np.testing.assert_allclose(values, wanted, rtol=1e-6, atol=1e-12)
    children = psutil.Process().children(recursive=True)
    children = [each for each in children if each.name() != "Xvfb"]  # started by the test run
    assert len(children) <= 3, "the worker, and no more than what tracks its resources"
    field = window.controller.field
    assert isinstance(field.family, OwnMaps)
    np.testing.assert_allclose(field.values, wanted[:, 4 if kind == "hks" else 3], rtol=1e-6)
    notice = window.stage.message_bar.notice
    # heat kernels do not reach the cuts
    flagged = "by more than 1 % in the median where pieces meet" in notice.text
    assert flagged == (kind == "band")
    assert notice.severity is (Severity.WARNING if flagged else Severity.INFORMATION)
    assert "next to seams they differ by" in notice.text


@pytest.mark.slow
def test_cancel_shows_what_was_there(window: MainWindow, tmp_path: Path) -> None:
    path = tmp_path / "pieces.npz"
    window.document.display.kind = "map"
    window.wait(60.0)
    begin(window, path, "band", 5)
    wait_for(lambda: bool(window.document.mesh.maps))
    window.actions_["cancel"].trigger()
    wait_for(lambda: window.document.work.job is None)
    window.wait(60.0)
    assert not path.exists()
    assert not window.document.mesh.maps
    assert window.document.display.kind == "map"
    assert window.controller.field.title == "Mean curvature"
    assert "Cancelled" in window.stage.message_bar.notice.text
    assert not list(tmp_path.iterdir())

"""Eigenpairs of the selected vertices, computed in the window."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import shapes
from closed_form import part
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.io.session import write_session
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.model.export import Export
from meshmash_viewer.spectral.weyl import Target, weyl_eigenvalue

PATIENCE = 60_000
N = 12


def eigenvalues_of(mesh: shapes.Mesh, mask: np.ndarray) -> np.ndarray:
    """Return the lowest eigenvalues of a part, from its dense matrices."""
    faces = mesh.faces[mask[mesh.faces].all(axis=1)]
    used, compact = np.unique(faces, return_inverse=True)
    laplacian, mass = cotangent_laplacian((mesh.vertices[used], compact.reshape(faces.shape)))
    dense = laplacian.toarray(), np.diag(mass.diagonal())
    return scipy.linalg.eigh(*dense, eigvals_only=True)[:N]


@pytest.fixture
def solved(reopen_window: Callable[..., MainWindow], qtbot: QtBot, tmp_path: Path) -> MainWindow:
    """A window with a decomposed sphere whose upper half is selected."""
    ball = shapes.icosphere(3)
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=ball.vertices, faces=ball.faces)
    window = reopen_window()
    document = window.document
    document.solve.target = Target("count", N)
    window.open_mesh(path, "nm")
    qtbot.waitUntil(lambda: document.path == path and not document.work.job, timeout=PATIENCE)
    document.solve.compute()
    wait_for_pairs(qtbot, window)
    document.selection.set(document.mesh.vertices[:, 2] >= -1e-9)
    catch_up()
    return window


def wait_for_pairs(qtbot: QtBot, window: MainWindow) -> None:
    document = window.document

    def rests() -> bool:
        spectrum = document.spectrum
        complete = spectrum is not None and spectrum.complete
        return complete and document.work.job is None and window.controller.idle

    qtbot.waitUntil(rests, timeout=PATIENCE)


def click(window: MainWindow, name: str) -> None:
    QTest.mouseClick(part(window, name), Qt.MouseButton.LeftButton)


@pytest.mark.slow
def test_the_selection_is_solved_alone(solved: MainWindow, qtbot: QtBot, tmp_path: Path) -> None:
    document, mesh = solved.document, solved.document.mesh
    mask, whole = document.selection.mask, document.spectrum.eigenvalues
    assert whole[1] == pytest.approx(2.0, rel=0.02)
    click(solved, "compute_selection_button")
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    found, truth = document.spectrum.eigenvalues, eigenvalues_of(mesh, mask)
    assert np.allclose(found, truth, rtol=1e-9, atol=1e-9 * truth[-1])
    assert document.spectrum.complete
    catch_up()
    assert f"{mask.sum():,} of {mesh.n_vertices:,}" in part(solved, "part_label").text()
    assert not part(solved, "compute_selection_button").isVisible()  # already computed
    said = f" · on the mask of {mask.sum():,} of {mesh.n_vertices:,} vertices only"
    assert said in part(solved, "proof_label").text()
    # values outside are NaN, on the render and in a file of the whole mesh
    assert solved.scene.mesh is mesh
    assert np.array_equal(~np.isnan(solved.controller.field.values), mask)
    family, operator = HeatKernelSignature().exported(4), document.solve.operator
    job = Export(mesh, operator, tmp_path / "h.npz", family, N, part=document.part_mesh)
    document.work.write(job.path, job)
    qtbot.waitUntil(lambda: job.path.exists() and not document.work.job, timeout=PATIENCE)
    with np.load(job.path) as written:
        assert np.array_equal(~np.isnan(written["features"]).any(axis=1), mask)
        assert np.array_equal(written["faces"], mesh.faces)
        made = json.loads(str(written["meta"]))["options"]
    assert said in made["proof"]
    assert made["mask"] == f"of {mask.sum():,} of {mesh.n_vertices:,} vertices"
    # undo, redo, and compute the whole mesh by its button
    document.history.undo()
    assert np.array_equal(document.spectrum.eigenvalues, whole)
    assert document.part_mesh is None
    catch_up()
    assert "on the mask" not in part(solved, "proof_label").text()
    assert np.array_equal(document.selection.mask, mask)
    document.history.redo()
    assert document.selection.mask is None
    assert np.allclose(document.spectrum.eigenvalues, truth, atol=1e-9 * truth[-1])
    catch_up()
    click(solved, "compute_whole_button")
    qtbot.waitUntil(lambda: document.part_mesh is None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    assert np.allclose(document.spectrum.eigenvalues, whole, atol=1e-9 * whole[-1])


@pytest.mark.slow
def test_typed_parameters_stay_for_a_part(solved: MainWindow, qtbot: QtBot) -> None:
    document = solved.document
    typed = Filters("exp(-s*x)").with_values(s=0.3), Distances(measure="diffusion", time=0.2)
    document.display.put(*typed)
    document.take_part(document.selection.mask, then_compute=True)
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    assert document.display[Filters].value("s", document.spectrum) == 0.3
    assert document.display[Distances].time == 0.2
    document.take_part(None)
    qtbot.waitUntil(lambda: document.part_mesh is None, timeout=PATIENCE)
    assert document.display[Filters].value("s", document.spectrum) == 0.3
    document.display.put(Filters(), Distances())


@pytest.mark.slow
def test_a_part_is_seen_from_the_same_place_and_the_whole_is_computed(
    solved: MainWindow, qtbot: QtBot
) -> None:
    document, scene = solved.document, solved.scene
    QTest.keyClick(solved, Qt.Key.Key_R)
    before = scene.camera()
    assert not scene.turned_by_hand
    click(solved, "compute_selection_button")
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    assert scene.camera() == before
    catch_up()
    assert not part(solved, "robust_check").hasFocus()
    law = solved.spectrum_panel.view.weyl.getData()[1]
    assert law[-1] == pytest.approx(weyl_eigenvalue(document.part_mesh.area, N - 1), rel=1e-9)
    document.solve.target = Target("count", N + 5)
    catch_up()
    click(solved, "compute_whole_button")
    qtbot.waitUntil(lambda: document.part_mesh is None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    assert len(document.spectrum) == N + 5


@pytest.mark.slow
def test_a_part_is_compared_by_index_and_says_that_the_second_is_whole(
    solved: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    document = solved.document
    click(solved, "compute_selection_button")
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    height = document.mesh.vertices[:, 2].astype(np.float32)
    solved.add_map("height", height)
    path = tmp_path / "wide.npz"
    np.savez(path, vertices=document.mesh.vertices * [1, 1.2, 1.5], faces=document.mesh.faces)
    solved.opening.open_second(path, unit="nm")
    qtbot.waitUntil(part(solved, "carry_to_second_button").isEnabled, timeout=PATIENCE)
    assert part(solved, "pair_match_label").text() == "by index: same faces"
    assert "the first is computed on the mask of" in part(solved, "pair_remark").text().lower()
    click(solved, "carry_to_second_button")
    second = solved.opening.second_view.document
    carried = second.mesh.map_named("height").values
    np.testing.assert_array_equal(carried, height)


@pytest.mark.slow
def test_a_part_stays_with_its_maps_and_unit_and_goes_by_a_repair(
    solved: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    document = solved.document
    mask = document.selection.mask
    click(solved, "compute_selection_button")
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    document.set_unit("um")
    assert document.spectrum.mesh.unit == "µm"
    solved.add_map("height", document.mesh.vertices[:, 2])
    assert [each.name for each in document.spectrum.mesh.maps] == ["height"]
    assert np.array_equal(document.part_mesh.referenced, mask)
    # the script computes the same eigenvalue
    document.display.show(Eigenfunctions(index=3))
    solved.commands.copy_script()
    script = tmp_path / "script.py"
    script.write_text(QApplication.clipboard().text() + "\nprint(decomposition.eigenvalues[1])")
    command = [sys.executable, script.name]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=240)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) == pytest.approx(document.spectrum.eigenvalues[1])
    document.repair("drop_unreferenced_vertices")
    qtbot.waitUntil(lambda: document.part_mesh is None, timeout=PATIENCE)
    document.history.undo()
    assert np.array_equal(document.part_mesh.referenced, mask)


@pytest.mark.slow
def test_a_session_has_the_part(
    solved: MainWindow, qtbot: QtBot, tmp_path: Path, open_window: Callable[..., MainWindow]
) -> None:
    document = solved.document
    click(solved, "compute_selection_button")
    qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, solved)
    times = HeatKernelSignature(time=0.5), Distances(measure="diffusion", time=0.2)
    chosen = Eigenfunctions(index=7), *times
    document.display.put(*chosen)
    path = tmp_path / "ball.meshmash.json"
    write_session(path, session_of(document, solved.scene.camera()))
    other = open_window()
    other.opening.open_path(path)
    qtbot.waitUntil(lambda: other.document.part_mesh is not None, timeout=PATIENCE)
    wait_for_pairs(qtbot, other)
    catch_up()
    assert "on the mask of" in part(other, "proof_label").text()
    same = other.document.spectrum.eigenvalues == document.spectrum.eigenvalues
    assert same.all()
    assert (other.document.part_mesh.referenced == document.part_mesh.referenced).all()
    assert other.document.display.fields == document.display.fields


@pytest.mark.slow
def test_a_selection_without_a_face_is_refused_and_nothing_is_computed(
    solved: MainWindow, qtbot: QtBot
) -> None:
    document = solved.document
    document.solve.target = Target("count", 2 * N)  # more than are computed
    document.selection.set(np.arange(document.mesh.n_vertices) == 3)
    catch_up()
    click(solved, "compute_selection_button")
    bar = solved.stage.message_bar
    qtbot.waitUntil(lambda: bar.notice is not None and not document.work.job, timeout=PATIENCE)
    qtbot.wait(50)
    assert "no whole face" in bar.notice.text
    assert document.work.job is None
    assert len(document.spectrum) == N
    assert document.selection.mask is not None

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises
from listeners import Listener

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.io.spectrum import find_eigenpairs
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import decomposition
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.export import Export
from meshmash_viewer.model.jobs import prepare
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral import cost
from meshmash_viewer.spectral.cost import check_memory
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


@pytest.fixture
def listener(tmp_path: Path) -> Listener:
    return Listener(tmp_path)


def residuals(mesh: Mesh, grew: Eigenpairs) -> np.ndarray:
    spectrum = grew
    stiffness, mass = cotangent_laplacian(mesh, robust=True)
    rows = np.asarray(spectrum.rows[: len(spectrum)])
    defect = rows @ stiffness - spectrum.eigenvalues[:, None] * (rows @ mass)
    return np.linalg.norm(defect, axis=1) / np.linalg.norm(rows @ mass, axis=1)


def test_pairs_are_mapped_from_the_store(sphere: Mesh, listener: Listener) -> None:
    grew = decompose(sphere, OPERATOR, Target("count", 25), listener).content
    spectrum = grew
    assert len(spectrum) == spectrum.total == 25
    assert spectrum.complete
    assert "all 642 eigenvalues computed" in spectrum.certificate.sentence(25)
    assert spectrum.operator == OPERATOR
    assert not spectrum.rows.flags.writeable
    assert residuals(sphere, grew).max() < 1e-8
    np.testing.assert_allclose(spectrum.eigenvalues[1:4], 2.0, rtol=0.02)
    assert any(report.message for report in listener.reports)


def test_growth_never_shows_the_null_space_alone(three_spheres: Mesh, listener: Listener) -> None:
    decompose(three_spheres, OPERATOR, Target("count", 12), listener)
    assert all(message.eigenvalues.any() for message in listener.messages)
    assert all(message.certificate.method == "none" for message in listener.messages)


def test_what_is_stored_is_not_computed_again(
    sphere: Mesh, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = decompose(sphere, OPERATOR, Target("count", 20), listener).content
    moved, asked = Mesh(sphere.vertices + 1.0, sphere.faces), Target("count", 20)
    assert find_eigenpairs(moved, OPERATOR, asked) == (None, "")
    monkeypatch.delattr("meshmash_viewer.spectral.eigensolver.Run")
    known, remark = find_eigenpairs(sphere, OPERATOR, asked)
    assert known is not None
    assert not remark
    assert known.certificate == first.certificate
    again = decompose(sphere, OPERATOR, asked, listener).content
    np.testing.assert_array_equal(again.rows, first.rows)


def test_all_below_a_threshold_are_known_to_be_all(sphere: Mesh, listener: Listener) -> None:
    first = decompose(sphere, OPERATOR, Target("count", 12), listener).content
    threshold = float(first.eigenvalues[8]) + 0.9 * float(
        first.eigenvalues[9] - first.eigenvalues[8]
    )
    below = decompose(sphere, OPERATOR, Target("max_eigenvalue", threshold), listener).content
    assert below.eigenvalues[-1] < below.known_to <= first.eigenvalues[9]


def test_cancelled_run_keeps_what_converged(tmp_path: Path) -> None:
    mesh = shapes.icosphere(4)
    with pytest.raises(Cancelled):
        decompose(mesh, OPERATOR, Target("count", 300), Listener(tmp_path, stop_at=50))
    known, remark = find_eigenpairs(mesh, OPERATOR, Target("count", 300))
    assert not remark
    assert known is not None
    assert 50 <= len(known) < known.total == 300
    assert not known.complete
    listener = Listener(tmp_path)
    grew = decompose(mesh, OPERATOR, Target("count", 300), listener).content
    assert grew.complete
    assert len(listener.messages[0]) >= 50


@pytest.mark.slow
def test_what_a_cancelled_run_has_found_is_told_to_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decomposition, "_GROWTH_SECONDS", 1e9)  # only the first message is sent
    mesh, listener = shapes.icosphere(4), Listener(tmp_path, stop_at=200)
    with pytest.raises(Cancelled):
        decompose(mesh, OPERATOR, Target("count", 600), listener)
    known, _ = find_eigenpairs(mesh, OPERATOR, Target("count", 600))
    assert known is not None
    assert len(listener.messages[-1]) == len(known) >= 200


def test_what_cannot_fit_is_refused_with_a_way_out(
    sphere: Mesh, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_memory(1_000_000, 7_000_000, 100, 10**12)
    with raises("out-of-memory"):
        check_memory(1_000_000, 7_000_000, 300, 5 * 10**9)
    with raises("out-of-memory", "simplify the mesh"):
        check_memory(10**9, 7 * 10**9, 300, 10**9)
    monkeypatch.setattr(cost, "free_memory", lambda: 10_000)
    with raises("out-of-memory", "of memory"):
        decompose(sphere, OPERATOR, Target("count", 20), listener)
    with raises("out-of-memory", "of memory"):
        decompose(sphere, OPERATOR, Target("max_eigenvalue", 20.0), listener)


def test_a_damaged_row_is_found_before_a_number_is_used_and_only_its_batch_is_made_again(
    listener: Listener, tmp_path: Path
) -> None:
    mesh, asked = shapes.three_spheres(3), Target("count", 40)
    whole = decompose(mesh, OPERATOR, asked, listener).content
    before = np.array(whole.rows)
    path = EigenpairStore(mesh, OPERATOR, asked).folder / "eigenvectors.f64"
    with path.open("r+b") as file:
        file.seek(8 * (mesh.n_vertices * 23 + 100))
        file.write(b"1")
    job = Export(mesh, OPERATOR, tmp_path / "pairs.npz", Eigenfunctions(), 40, asked)
    with raises("no-eigenpairs", "damaged"):
        job(listener)
    dataclasses.replace(job, n_pairs=23)(listener)
    result = prepare(mesh, listener)
    ready = result.content
    assert "eigenpairs 3 to 39" in result.remark  # all but the null space
    assert ready.known is not None
    assert len(ready.known) == 3
    np.testing.assert_array_equal(ready.known.rows, before[:3])
    result = decompose(mesh, OPERATOR, asked, listener)
    again, remark = result.content, result.remark
    assert "eigenpairs 3 to 39" in remark
    assert again.complete
    np.testing.assert_array_equal(again.rows, before)
    job(listener)
    assert not decompose(mesh, OPERATOR, asked, listener).remark


def test_a_damaged_file_of_eigenvalues_is_told_of_on_opening(
    sphere: Mesh, listener: Listener
) -> None:
    decompose(sphere, OPERATOR, Target("count", 40), listener)
    asked = Target("count", 40)
    path = EigenpairStore(sphere, OPERATOR, asked).folder / "pairs.sealed"
    path.write_bytes(path.read_bytes()[:-1])
    known, remark = find_eigenpairs(sphere, OPERATOR, asked)
    assert known is None
    assert "all eigenpairs" in remark
    assert prepare(sphere, listener).remark == remark


def test_how_far_all_pairs_are_known_is_that_of_a_threshold_alone(
    sphere: Mesh, listener: Listener
) -> None:
    decompose(sphere, OPERATOR, Target("count", 9), listener)
    known, _ = find_eigenpairs(sphere, OPERATOR, Target("count", 9))
    assert known is not None
    assert known.known_to == 0.0
    other = Mesh(2.0 * sphere.vertices, sphere.faces)
    decompose(other, OPERATOR, Target("max_eigenvalue", 1.0), listener)
    known, _ = find_eigenpairs(other, OPERATOR, Target("max_eigenvalue", 1.0))
    assert known is not None
    assert known.known_to == 1.0
    assert len(known) == 4


def test_without_a_cache_the_session_has_a_store(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("MESHMASH_CACHE", str(tmp_path / "file"))
    listener = Listener(tmp_path)
    result = decompose(sphere, OPERATOR, Target("count", 8), listener)
    grew, remark = result.content, result.remark
    assert Path(grew.rows.filename).is_relative_to(tmp_path / "eigenpairs")
    assert "until the window is closed" in remark
    assert len(decompose(sphere, OPERATOR, Target("count", 5), listener).content) == 5
    Export(sphere, OPERATOR, tmp_path / "pairs.npz", Eigenfunctions(), 8)(listener)
    more = decompose(sphere, OPERATOR, Target("count", 30), listener).content
    assert more.complete


def test_a_cache_removed_while_computing_costs_nothing(
    sphere: Mesh, tmp_path: Path, own_cache: Path
) -> None:
    class Remover(Listener):
        def send(self, message: object) -> None:
            super().send(message)
            shutil.rmtree(own_cache, ignore_errors=True)

    remover = Remover(tmp_path)
    result = decompose(sphere, OPERATOR, Target("count", 300), remover)
    grew, remark = result.content, result.remark
    assert not list(own_cache.glob("**/*.sealed"))
    assert "until the window is closed" in remark
    assert grew.complete
    assert residuals(sphere, grew).max() < 1e-7
    Export(sphere, OPERATOR, tmp_path / "pairs.npz", Eigenfunctions(), 300)(Listener(tmp_path))
    # The next mesh uses the cache again.
    other = Mesh(sphere.vertices * 1.1, sphere.faces)
    assert not decompose(other, OPERATOR, Target("count", 8), Listener(tmp_path)).remark


def test_while_another_process_computes_the_same_it_is_computed_twice_and_said(
    sphere: Mesh, tmp_path: Path
) -> None:
    with EigenpairStore(sphere, OPERATOR, Target("count", 20)) as busy:
        busy.lock()
        listener = Listener(tmp_path)
        result = decompose(sphere, OPERATOR, Target("count", 20), listener)
        grew, remark = result.content, result.remark
        assert "Another process" in remark
        assert grew.complete


def test_read_repair_and_scale_bring_a_mesh_with_all_to_draw_it(
    neuron: Mesh, listener: Listener, tmp_path: Path
) -> None:
    np.savez(tmp_path / "neuron.npz", vertices=neuron.vertices, faces=neuron.faces)
    read = prepare(tmp_path / "neuron.npz", listener, unit="8 nm", operator=OPERATOR).content
    assert read.mesh.unit == "nm"
    assert read.path == tmp_path / "neuron.npz"
    np.testing.assert_allclose(read.mesh.vertices, 8.0 * neuron.vertices)
    assert read.normals.shape == neuron.vertices.shape
    repaired = prepare(
        read.mesh, listener, path=read.path, repairs=("keep_largest_component",)
    ).content
    assert repaired.health.n_components == 1 < read.health.n_components
    assert repaired.repairs == ("keep_largest_component",)
    decompose(neuron, OPERATOR, Target("count", 15), listener)
    assert prepare(neuron, listener).content.known is not None
    scaled = prepare(neuron, listener, unit="0.001 µm").content
    assert scaled.mesh.unit == "µm"
    assert scaled.health.area == pytest.approx(1e-6 * neuron.area)
    assert scaled.known is None

"""The store: what one process writes another reads, and nothing damaged is ever used."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from meshmash_viewer.io.cache import EigenpairCache, folder_size
from meshmash_viewer.io.spectrum import obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore, StoreBusy, StoredSpectrum, StoreUnusable
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigensolver import Decomposition, solve
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


def open_store(mesh: Mesh, root: Path, **options: Any) -> EigenpairStore:
    return EigenpairStore(mesh, OPERATOR, root, **options)


def synthetic(n: int, k: int, seed: int = 0) -> Decomposition:
    rng = np.random.default_rng(seed)
    return Decomposition(
        eigenvalues=np.arange(k, dtype=np.float64),
        rows=rng.normal(size=(k, n)),
        residuals=np.full(k, 1e-12),
        certificate=Certificate("inertia", k, k, float(k), orthonormality=1e-14),
        timings={"solve": 1.5},
        mass=np.ones(n),
    )


def loaded(mesh: Mesh, root: Path) -> StoredSpectrum:
    found = open_store(mesh, root).load()
    assert found is not None
    return found


def fill(store: EigenpairStore, whole: Decomposition, start: int, stop: int) -> None:
    stored = store.load()
    there = np.zeros(0) if stored is None else stored.eigenvalues
    rows = store.extend(whole.n_components, None, np.flatnonzero(np.isfinite(there)))
    rows[start:stop] = whole.rows[start:stop]
    store.append(start, whole.eigenvalues[start:stop], whole.residuals[start:stop])


def finish(
    store: EigenpairStore, whole: Decomposition, max_eigenvalue: float | None = None
) -> None:
    """Publish the pairs that have not come yet, and the proof."""
    stored = store.load()
    start = 0 if stored is None else stored.n_converged
    if start < whole.n_components:
        fill(store, whole, start, whole.n_components)
    store.finish(whole, max_eigenvalue)


@pytest.fixture
def whole(sphere: Mesh) -> Decomposition:
    return synthetic(sphere.n_vertices, 10)


def test_key_tells_meshes_and_operators_apart(sphere: Mesh) -> None:
    moved = Mesh(sphere.vertices + 1.0, sphere.faces)
    keys = {
        EigenpairStore.key(sphere, OPERATOR),
        EigenpairStore.key(moved, OPERATOR),
        EigenpairStore.key(sphere, OperatorOptions(robust=False)),
        EigenpairStore.key(sphere, OperatorOptions(mollify_factor=1e-4)),
    }
    assert len(keys) == 4
    renamed = Mesh(sphere.vertices, sphere.faces, unit="nm", name="other")
    assert EigenpairStore.key(renamed, OPERATOR) == EigenpairStore.key(sphere, OPERATOR)


def test_nothing_is_written_before_there_is_something(sphere: Mesh, tmp_path: Path) -> None:
    store = open_store(sphere, tmp_path / "cache")
    assert store.load() is None
    assert not (tmp_path / "cache").exists()


def test_room_that_nothing_came_into_is_given_back(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        store.extend(whole.n_components, None, np.zeros(0, dtype=np.int64))
        rows = store.folder / "eigenvectors.f64"
        assert rows.stat().st_size == whole.rows.nbytes
    assert rows.stat().st_size == 0


def test_solved_into_the_store_and_found_again(sphere: Mesh, tmp_path: Path) -> None:
    stiffness, mass = cotangent_laplacian(sphere, robust=True)
    with open_store(sphere, tmp_path) as store:
        solved = solve(stiffness, mass, 12, allocate=store.allocate, on_pairs=store.append)
        store.finish(solved)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.n_proven == 12
    again = found.decomposition(12)
    np.testing.assert_array_equal(again.rows, solved.rows)
    np.testing.assert_array_equal(again.eigenvalues, solved.eigenvalues)
    np.testing.assert_array_equal(again.mass, solved.mass)
    assert again.proof() == solved.proof()
    assert again.rows.flags["C_CONTIGUOUS"]
    assert not again.rows.flags["WRITEABLE"]


def test_pairs_are_published_as_they_come(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 4)
        first = loaded(sphere, tmp_path)
        assert (first.n_proven, first.n_converged) == (0, 4)
        fill(store, whole, 6, 8)  # a slice further up: not a leading pair yet
        assert loaded(sphere, tmp_path).n_converged == 4
        fill(store, whole, 4, 6)
        assert loaded(sphere, tmp_path).n_converged == 8
        np.testing.assert_array_equal(first.rows, whole.rows[:4])
    # Cut off here: what has converged is kept, and is no answer to anything.
    kept = loaded(sphere, tmp_path)
    assert kept.n_converged == 8
    assert kept.covers(Target("count", 2)) is None
    assert not kept.decomposition().complete


def test_asking_for_fewer_is_a_slice_and_for_more_is_more(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        finish(store, whole, max_eigenvalue=9.5)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.covers(Target("count", 3)) == 3
    assert found.covers(Target("count", 10)) == 10
    assert found.covers(Target("count", 11)) is None
    assert found.covers(Target("max_eigenvalue", 5.0)) == 6  # the threshold is included
    assert found.covers(Target("max_eigenvalue", 5.5)) == 6
    assert found.covers(Target("max_eigenvalue", 9.2)) == 10
    assert found.covers(Target("max_eigenvalue", 9.6)) is None
    assert found.decomposition(3).complete
    assert found.decomposition(3).certificate.counted == 10


def test_the_whole_spectrum_answers_everything(sphere: Mesh, tmp_path: Path) -> None:
    n = sphere.n_vertices
    with open_store(sphere, tmp_path) as store:
        finish(store, synthetic(n, n))
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.covers(Target("count", 10 * n)) == n
    assert found.covers(Target("max_eigenvalue", 1e9)) == n


def test_growing_keeps_what_is_proven_and_maps_of_it(sphere: Mesh, tmp_path: Path) -> None:
    few, many = synthetic(sphere.n_vertices, 10), synthetic(sphere.n_vertices, 1200)
    np.testing.assert_array_equal(few.rows, many.rows[:10])
    with open_store(sphere, tmp_path) as store:
        finish(store, few)
    before = open_store(sphere, tmp_path).load()
    assert before is not None
    with open_store(sphere, tmp_path) as store:
        rows = store.extend(1200, None, np.arange(10))
        np.testing.assert_array_equal(rows[:10], few.rows)
        rows[10:] = many.rows[10:]
        store.append(0, many.eigenvalues[:10], many.residuals[:10])  # known pairs come again
        store.append(10, many.eigenvalues[10:20], many.residuals[10:20])
        found = open_store(sphere, tmp_path).load()
        assert found is not None
        assert (found.n_proven, found.n_converged) == (10, 20)
        assert found.covers(Target("count", 10)) == 10
    with open_store(sphere, tmp_path) as store:
        store.extend(1200, None, np.arange(20))
        finish(store, many)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert (found.n_proven, found.damaged_batches()) == (1200, [])
    np.testing.assert_array_equal(before.rows, few.rows)  # an old map stays valid


def flip_bit(path: Path, place: int = -100) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_a_store_is_served_as_far_as_it_is_whole(sphere: Mesh, tmp_path: Path) -> None:
    whole = synthetic(sphere.n_vertices, 12)
    with open_store(sphere, tmp_path) as store:
        for start in (0, 4, 8):
            fill(store, whole, start, start + 4)
        finish(store, whole)
    flip_bit(store.folder / "pairs-000004-000008.sealed")
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.faults == ("eigenpairs 4 to 7",)
    assert (found.n_proven, found.n_converged) == (4, 4)
    assert found.covers(Target("count", 4)) == 4
    assert found.covers(Target("count", 5)) is None
    known = found.decomposition()
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(known.eigenvalues)), [4, 5, 6, 7])
    np.testing.assert_array_equal(known.rows[8:], whole.rows[8:])
    untouched = [store.folder / f"pairs-{i:06d}-{i + 4:06d}.sealed" for i in (0, 8)]
    written = [path.stat().st_mtime_ns for path in untouched]
    kept = np.flatnonzero(np.isfinite(known.eigenvalues))
    with open_store(sphere, tmp_path) as store:
        rows = store.extend(12, None, kept)
        rows[4:8] = whole.rows[4:8]
        store.append(4, whole.eigenvalues[4:8], 2.0 * whole.residuals[4:8])
        # Other numbers than those that the proof was made of.
        found = loaded(sphere, tmp_path)
        assert (found.n_proven, found.n_converged, found.faults) == (4, 12, ())
        finish(store, whole)
    assert [path.stat().st_mtime_ns for path in untouched] == written
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert (found.n_proven, found.faults) == (12, ())
    np.testing.assert_array_equal(found.rows, whole.rows)


def test_a_batch_that_is_gone_is_named(sphere: Mesh, tmp_path: Path) -> None:
    whole = synthetic(sphere.n_vertices, 12)
    with open_store(sphere, tmp_path) as store:
        for start in (0, 4, 8):
            fill(store, whole, start, start + 4)
        finish(store, whole)
    (store.folder / "pairs-000008-000012.sealed").unlink()
    found = loaded(sphere, tmp_path)
    assert found.faults == ("eigenpairs 8 to 11",)
    assert found.n_converged == 8


def test_a_file_in_place_of_another_is_none(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 5)
        finish(store, whole)
    proof, batch = store.folder / "proof.sealed", store.folder / "pairs-000005-000010.sealed"
    content = proof.read_bytes()
    proof.write_bytes(batch.read_bytes())
    batch.write_bytes(content)
    found = loaded(sphere, tmp_path)
    assert found.faults == ("eigenpairs 5 to 9", "their proof")
    assert (found.n_proven, found.n_converged) == (0, 5)


def test_rows_are_compared_with_their_checksums_when_asked(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 5)
        finish(store, whole)
    flip_bit(store.folder / "eigenvectors.f64", 8 * 7 * sphere.n_vertices + 5)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.n_proven == 10
    assert found.damaged_batches(5) == []
    damaged = found.damaged_batches()
    assert [(batch.start, batch.stop) for batch in damaged] == [(5, 10)]
    assert found.without(damaged).n_proven == 5
    assert found.damaged_batches(cancel=lambda: True) == []


def test_nothing_published_is_written_again(sphere: Mesh, tmp_path: Path) -> None:
    whole = synthetic(sphere.n_vertices, 10)
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 6)
        with pytest.raises(ValueError, match="published before"):
            store.append(3, whole.eigenvalues[3:8], whole.residuals[3:8])
        store.append(0, whole.eigenvalues[:6], whole.residuals[:6])
        assert len(list(store.folder.glob("pairs-*"))) == 1


def test_room_is_on_the_disk_before_anything_is_written(sphere: Mesh, tmp_path: Path) -> None:
    with open_store(sphere, tmp_path) as store:
        store.allocate(50)
        status = (store.folder / "eigenvectors.f64").stat()
        assert status.st_size == 8 * 50 * sphere.n_vertices
        assert 512 * status.st_blocks >= status.st_size
    # Nothing came of it.
    EigenpairCache(tmp_path).tidy()
    assert EigenpairCache(tmp_path).stores() == []


@pytest.mark.parametrize("supported", [True, False])
def test_a_full_disk_is_said_and_takes_nothing_away(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, supported: bool
) -> None:
    whole = synthetic(sphere.n_vertices, 10)
    with open_store(sphere, tmp_path) as store:
        finish(store, whole)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC if supported else errno.EOPNOTSUPP, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    store = open_store(sphere, tmp_path)
    if supported:
        with pytest.raises(StoreUnusable, match="no space left"):
            store.extend(40, None, np.arange(10))
    else:
        store.extend(40, None, np.arange(10))
        store.close()
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.n_proven == 10
    assert found.damaged_batches() == []
    assert found.path.stat().st_size == 8 * 10 * sphere.n_vertices


def test_left_overs_go_and_stores_of_other_versions_when_they_are_old(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 5)
    parts = [
        store.folder / name
        for name in (
            ".meshmash-01234567-99999999-89abcdef-eigenvectors.f64",
            ".meshmash-01234567-99999999-89abcdef-proof.sealed",
        )
    ]
    for part in parts:
        part.touch()
    with (store.folder / "eigenvectors.f64").open("ab") as file:
        file.write(bytes(10_000))
    removed = tmp_path / f"removed-{'0' * 32}-123"
    removed.mkdir()
    empty = tmp_path / ("1" * 32)
    empty.mkdir()
    others = {days: tmp_path / (str(days) * 32)[:32] for days in (2, 30)}
    for days, other in others.items():
        other.mkdir()
        (other / "problem.json").write_text('{"format": 1, "mesh": {"n_vertices": 3}}')
        then = time.time() - 86_400 * days
        os.utime(other / "problem.json", (then, then))
    with open_store(sphere, tmp_path) as busy:
        busy.lock()
        EigenpairCache(tmp_path).tidy()
        assert all(part.exists() for part in parts), "somebody writes there"
    EigenpairCache(tmp_path).tidy()
    assert not any(part.exists() for part in parts)
    assert not removed.exists()
    assert others[2].exists()
    assert not others[30].exists()
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.path.stat().st_size == 8 * 5 * sphere.n_vertices
    np.testing.assert_array_equal(found.rows, whole.rows[:5])
    # What is missing of a file is not made up for by zeros.
    os.truncate(found.path, 100)
    EigenpairCache(tmp_path).tidy()
    assert found.path.stat().st_size == 100


def test_the_laplacian_is_kept(sphere: Mesh, tmp_path: Path) -> None:
    stiffness, mass = cotangent_laplacian(sphere, robust=True)
    store = open_store(sphere, tmp_path)
    assert store.laplacian() is None
    store.keep_laplacian(stiffness, mass)
    kept = open_store(sphere, tmp_path).laplacian()
    assert kept is not None
    assert (kept[0] != stiffness).nnz == 0
    np.testing.assert_array_equal(kept[1].diagonal(), mass.diagonal())
    solved, again = solve(stiffness, mass, 12), solve(*kept, 12)
    np.testing.assert_array_equal(again.rows, solved.rows)
    flip_bit(store.folder / "laplacian.sealed")
    assert open_store(sphere, tmp_path).laplacian() is None


def _hold(mesh: Mesh, root: Path, ready: Any, go: Any) -> None:
    store = open_store(mesh, root)
    fill(store, synthetic(mesh.n_vertices, 10), 0, 5)
    ready.set()
    go.wait(30)
    os._exit(9)  # killed in the middle


def test_two_processes_never_write_at_once(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    other = context.Process(target=_hold, args=(sphere, tmp_path, ready, go))
    other.start()
    try:
        assert ready.wait(30)
        store = open_store(sphere, tmp_path)
        with pytest.raises(StoreBusy, match="Another process"):
            store.allocate(10)
        assert loaded(sphere, tmp_path).n_converged == 5  # looking is allowed
        assert EigenpairCache(tmp_path).clear() == 0
    finally:
        go.set()
        other.join(30)
    assert other.exitcode == 9
    # A killed process leaves no lock behind.
    with store:
        finish(store, whole)
    assert loaded(sphere, tmp_path).n_proven == 10


def test_same_process_is_no_exception(sphere: Mesh, tmp_path: Path) -> None:
    with open_store(sphere, tmp_path) as first:
        first.allocate(3)
        with pytest.raises(StoreBusy):
            open_store(sphere, tmp_path).allocate(3)
    with open_store(sphere, tmp_path) as second:
        second.allocate(3)


def shifted(mesh: Mesh, by: int) -> Mesh:
    return Mesh(mesh.vertices + by, mesh.faces)


def test_oldest_goes_when_the_cap_is_reached(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    stores = [open_store(shifted(sphere, i), tmp_path) for i in range(3)]
    for age, store in enumerate(stores[:2]):
        with store:
            finish(store, whole)
        os.utime(store.folder / "problem.json", ns=(0, age))
    one = folder_size(stores[0].folder)
    assert stores[0].load() is not None  # used again: the other is now the oldest
    stores[2] = open_store(shifted(sphere, 2), tmp_path, cap=int(2.5 * one))
    with stores[2]:
        finish(stores[2], whole)
    assert [store.folder.exists() for store in stores] == [True, False, True]
    cache = EigenpairCache(tmp_path)
    assert cache.size() >= 2 * 0.9 * one
    assert cache.clear() >= 2 * 0.9 * one
    assert cache.stores() == []


def test_unwritable_cache_is_said(sphere: Mesh, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = open_store(sphere, tmp_path / "file")
    assert store.load() is None
    with pytest.raises(StoreUnusable, match="Nothing can be kept in the cache folder"):
        store.allocate(3)


def test_too_much_for_the_disk_is_refused_beforehand(sphere: Mesh, tmp_path: Path) -> None:
    with pytest.raises(StoreUnusable, match="no space left"):
        open_store(sphere, tmp_path).allocate(10**8)
    assert open_store(sphere, tmp_path).load() is None
    with open_store(sphere, tmp_path) as store:
        store.allocate(3)


def test_a_smaller_request_goes_on_in_a_file_with_room_for_more(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 0, 4)
        rows = store.extend(6, None, np.arange(4))
        assert rows.shape == (6, sphere.n_vertices)
        np.testing.assert_array_equal(rows[:4], whole.rows[:4])
        rows[4:] = whole.rows[4:6]
        store.append(4, whole.eigenvalues[4:6], whole.residuals[4:6])
    np.testing.assert_array_equal(loaded(sphere, tmp_path).rows[:6], whole.rows[:6])


def test_what_the_disk_has_room_for_to_the_byte_is_taken(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed = 8 * 10 * sphere.n_vertices
    for free in (needed - 1, needed):
        disk = SimpleNamespace(free=free)
        monkeypatch.setattr(shutil, "disk_usage", lambda _, disk=disk: disk)
        with open_store(sphere, tmp_path) as store:
            if free < needed:
                with pytest.raises(StoreUnusable, match="no space left"):
                    store.allocate(10)
            else:
                assert store.allocate(10).shape == (10, sphere.n_vertices)


def test_what_is_stored_is_read_while_another_process_may_write(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHMASH_CACHE", str(tmp_path))
    target = Target("count", 12)
    computed = obtain_eigenpairs(sphere, OPERATOR, target).decomposition

    def locked(_: EigenpairStore) -> None:
        raise AssertionError("kept others from writing")

    monkeypatch.setattr(EigenpairStore, "lock", locked)
    again = obtain_eigenpairs(sphere, OPERATOR, target).decomposition
    np.testing.assert_array_equal(again.rows, computed.rows)


def test_where_a_system_counts_no_blocks_a_folder_is_as_large_as_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "some").write_bytes(bytes(1234))
    (tmp_path / "more").write_bytes(bytes(10))
    look = os.stat
    monkeypatch.setattr(os, "stat", lambda path: SimpleNamespace(st_size=look(path).st_size))
    assert folder_size(tmp_path) == 1244

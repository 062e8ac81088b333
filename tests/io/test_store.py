"""The store of eigenpairs: sharing between processes, growth, damage and disk space."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from meshmash_viewer.io.cache import EigenpairCache, folder_size
from meshmash_viewer.io.spectrum import obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore, StoreBusy, StoreUnusable
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


TARGET = Target("count", 10)


def open_store(mesh: Mesh, root: Path, **options: Any) -> EigenpairStore:
    return EigenpairStore(mesh, OPERATOR, TARGET, root, **options)


def synthetic(n: int, k: int, seed: int = 0) -> Eigenpairs:
    rng = np.random.default_rng(seed)
    return Eigenpairs(
        eigenvalues=np.arange(k, dtype=np.float64),
        rows=rng.normal(size=(k, n)),
        residuals=np.full(k, 1e-12),
        certificate=Certificate("inertia", k, k, float(k), orthonormality=1e-14),
        timings={"solve": 1.5},
        mass=np.ones(n),
    )


def loaded(mesh: Mesh, root: Path) -> Eigenpairs:
    found = open_store(mesh, root).load()
    assert found is not None
    return found


def fill(store: EigenpairStore, whole: Eigenpairs, stop: int) -> None:
    """Publish the pairs below index `stop`, without a certificate."""
    stored = store.load()
    start = 0 if stored is None else len(stored)
    rows = store.allocate(len(whole), n_kept=start)
    rows[start:stop] = whole.rows[start:stop]
    store.append(replace(whole.first(stop), certificate=Certificate("none")))


def finish(store: EigenpairStore, whole: Eigenpairs, known_to: float = 0.0) -> None:
    """Publish the remaining pairs and the certificate."""
    fill(store, whole, len(whole))
    store.append(replace(whole, known_to=known_to))


@pytest.fixture
def whole(sphere: Mesh) -> Eigenpairs:
    return synthetic(sphere.n_vertices, 10)


def test_key_tells_meshes_operators_and_targets_apart(sphere: Mesh) -> None:
    moved = Mesh(sphere.vertices + 1.0, sphere.faces)
    keys = {
        EigenpairStore.key(sphere, OPERATOR, TARGET),
        EigenpairStore.key(moved, OPERATOR, TARGET),
        EigenpairStore.key(sphere, OperatorOptions(robust=False), TARGET),
        EigenpairStore.key(sphere, OperatorOptions(mollify_factor=1e-4), TARGET),
        EigenpairStore.key(sphere, OPERATOR, Target("count", 11)),
        EigenpairStore.key(sphere, OPERATOR, Target("max_eigenvalue", 10)),
    }
    assert len(keys) == 6
    renamed = Mesh(sphere.vertices, sphere.faces, unit="nm", name="other")
    assert EigenpairStore.key(renamed, OPERATOR, TARGET) in keys


def test_nothing_is_written_before_there_is_something(sphere: Mesh, tmp_path: Path) -> None:
    store = open_store(sphere, tmp_path / "cache")
    assert store.load() is None
    assert not (tmp_path / "cache").exists()


def test_room_that_nothing_came_into_is_given_back(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs
) -> None:
    with open_store(sphere, tmp_path) as store:
        store.allocate(len(whole))
        rows = store.folder / "eigenvectors.f64"
        assert rows.stat().st_size == whole.rows.nbytes
    assert rows.stat().st_size == 0


def test_solved_into_the_store_and_found_again(sphere: Mesh, tmp_path: Path) -> None:
    stiffness, mass = cotangent_laplacian(sphere, robust=True)
    with open_store(sphere, tmp_path) as store:
        solved = solve(stiffness, mass, 12, allocate=store.allocate, on_pairs=store.append)
        store.append(solved)
    assert open_store(sphere, tmp_path).is_complete
    again = open_store(sphere, tmp_path).load(12)
    assert again is not None
    np.testing.assert_array_equal(again.rows, solved.rows)
    np.testing.assert_array_equal(again.eigenvalues, solved.eigenvalues)
    np.testing.assert_array_equal(again.mass, solved.mass)
    assert again.proof() == solved.proof()
    assert again.rows.flags["C_CONTIGUOUS"]
    assert not again.rows.flags["WRITEABLE"]


def test_pairs_are_published_as_they_come(sphere: Mesh, tmp_path: Path, whole: Eigenpairs) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 4)
        first = loaded(sphere, tmp_path)
        assert len(first) == 4
        fill(store, whole, 8)
        assert len(loaded(sphere, tmp_path)) == 8
        np.testing.assert_array_equal(first.rows, whole.rows[:4])
    # Closed without a certificate: the converged pairs are kept, but do not answer the request.
    part = loaded(sphere, tmp_path)
    assert (len(part), part.total, part.target, part.complete) == (8, 10, TARGET, False)
    assert not open_store(sphere, tmp_path).is_complete


def test_fewer_pairs_have_a_certificate_of_their_own(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs
) -> None:
    with open_store(sphere, tmp_path) as store:
        finish(store, whole, known_to=9.5)
    few = open_store(sphere, tmp_path).load(3)
    assert few is not None
    assert few.complete
    assert (len(few), few.known_to, few.certificate.counted) == (3, 0.0, 3)
    assert loaded(sphere, tmp_path).known_to == 9.5


def test_growing_keeps_what_is_published_and_maps_of_it(sphere: Mesh, tmp_path: Path) -> None:
    few, many = synthetic(sphere.n_vertices, 10), synthetic(sphere.n_vertices, 1200)
    np.testing.assert_array_equal(few.rows, many.rows[:10])
    with open_store(sphere, tmp_path) as store:
        fill(store, many, 10)
    before = loaded(sphere, tmp_path)
    with open_store(sphere, tmp_path) as store:
        assert store.load() is not None
        rows = store.allocate(1200, n_kept=10)
        np.testing.assert_array_equal(rows[:10], few.rows)
        rows[10:] = many.rows[10:]
        begun = replace(many, certificate=Certificate("none"))
        store.append(begun.first(10))  # published a second time
        store.append(begun.first(20))
        assert len(loaded(sphere, tmp_path)) == 20
    with open_store(sphere, tmp_path) as store:
        finish(store, many)
    assert len(loaded(sphere, tmp_path)) == 1200
    assert open_store(sphere, tmp_path).is_complete
    np.testing.assert_array_equal(before.rows, few.rows)  # the old memory map stays valid


def flip_bit(path: Path, place: int = -100) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_a_store_is_served_as_far_as_it_is_whole(sphere: Mesh, tmp_path: Path) -> None:
    whole = synthetic(sphere.n_vertices, 12)
    with open_store(sphere, tmp_path) as store:
        for stop in (1, 4, 9):
            fill(store, whole, stop)
        finish(store, whole)
    flip_bit(store.folder / "eigenvectors.f64", 8 * 5 * sphere.n_vertices + 5)
    found = open_store(sphere, tmp_path)
    few = found.load(5)
    assert few is not None
    assert (len(few), few.complete, found.damage) == (5, True, "")
    part = found.load()  # in whole batches
    assert part is not None
    assert (len(part), part.complete, found.damage) == (4, False, "eigenpairs 4 to 11")
    with found:
        rows = found.allocate(12, n_kept=4)
        assert len(loaded(sphere, tmp_path)) == 4  # the other rows are not published
        rows[4:] = whole.rows[4:]
        found.append(replace(whole.first(8), certificate=Certificate("none")))
        assert len(loaded(sphere, tmp_path)) == 8
        found.append(whole)
    assert open_store(sphere, tmp_path).is_complete
    np.testing.assert_array_equal(loaded(sphere, tmp_path).rows, whole.rows)
    with pytest.raises(Cancelled):
        open_store(sphere, tmp_path).load(cancel=lambda: True)


@pytest.mark.parametrize("name", ["pairs.sealed", "eigenvectors.f64"])
def test_damage_is_named_and_nothing_damaged_is_used(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs, name: str
) -> None:
    other = Mesh(sphere.vertices + 1.0, sphere.faces)
    for mesh, pairs in ((sphere, whole), (other, synthetic(sphere.n_vertices, 10, seed=1))):
        with open_store(mesh, tmp_path) as store:
            fill(store, pairs, 9)
            finish(store, pairs)
    path = open_store(sphere, tmp_path).folder / name
    content = path.read_bytes()
    changed = bytearray(content)
    changed[-100] ^= 1
    of_another = (store.folder / name).read_bytes()
    for spoiled in (changed, content[:-9], b"", of_another):
        path.write_bytes(spoiled)
        found = open_store(sphere, tmp_path)
        pairs = found.load()
        assert found.damage
        if pairs is not None:
            assert name == "eigenvectors.f64"
            np.testing.assert_array_equal(pairs.rows, whole.rows[:9])
    path.unlink()
    assert open_store(sphere, tmp_path).load() is None
    with open_store(sphere, tmp_path) as store:
        finish(store, whole)
    assert len(loaded(sphere, tmp_path)) == 10


def test_a_store_of_another_version_is_absent(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("meshmash_viewer.io.store.FORMAT", 5)
        with open_store(sphere, tmp_path) as store:
            finish(store, whole)
    store = open_store(sphere, tmp_path)
    assert (store.load(), store.damage) == (None, "")


def test_room_is_on_the_disk_before_anything_is_written(sphere: Mesh, tmp_path: Path) -> None:
    with open_store(sphere, tmp_path) as store:
        store.allocate(50)
        status = (store.folder / "eigenvectors.f64").stat()
        assert status.st_size == 8 * 50 * sphere.n_vertices
        assert 512 * status.st_blocks >= status.st_size
    # No pairs were published.
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
    assert store.load() is not None
    if supported:
        with pytest.raises(StoreUnusable, match="no space left"):
            store.allocate(40, n_kept=10)
    else:
        store.allocate(40, n_kept=10)
        store.close()
    assert open_store(sphere, tmp_path).is_complete
    assert len(loaded(sphere, tmp_path)) == 10
    assert (store.folder / "eigenvectors.f64").stat().st_size == 8 * 10 * sphere.n_vertices


def test_left_overs_go_and_stores_of_other_versions_when_they_are_old(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 5)
    parts = [
        store.folder / name
        for name in (
            ".meshmash-01234567-99999999-89abcdef-eigenvectors.f64",
            ".meshmash-01234567-99999999-89abcdef-pairs.sealed",
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
    path = store.folder / "eigenvectors.f64"
    assert path.stat().st_size == 8 * 5 * sphere.n_vertices
    np.testing.assert_array_equal(loaded(sphere, tmp_path).rows, whole.rows[:5])
    # A truncated file is not filled up with zeros.
    os.truncate(path, 100)
    EigenpairCache(tmp_path).tidy()
    assert path.stat().st_size == 100


def _hold(mesh: Mesh, root: Path, ready: Any, go: Any) -> None:
    store = open_store(mesh, root)
    fill(store, synthetic(mesh.n_vertices, 10), 5)
    ready.set()
    go.wait(60)
    os._exit(9)  # ends without cleaning up, as if killed


def test_two_processes_never_write_at_once(sphere: Mesh, tmp_path: Path, whole: Eigenpairs) -> None:
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    other = context.Process(target=_hold, args=(sphere, tmp_path, ready, go))
    other.start()
    try:
        assert ready.wait(60)
        store = open_store(sphere, tmp_path)
        with pytest.raises(StoreBusy, match="Another process"):
            store.allocate(10)
        assert len(loaded(sphere, tmp_path)) == 5  # reading is allowed
        assert EigenpairCache(tmp_path).clear() == 0
    finally:
        go.set()
        other.join(30)
    assert other.exitcode == 9
    # A killed process leaves no lock behind.
    with store:
        finish(store, whole)
    assert open_store(sphere, tmp_path).is_complete


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
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs
) -> None:
    stores = [open_store(shifted(sphere, i), tmp_path) for i in range(3)]
    for age, store in enumerate(stores[:2]):
        with store:
            finish(store, whole)
        os.utime(store.folder / "problem.json", ns=(0, age))
    one = folder_size(stores[0].folder)
    assert stores[0].load() is not None  # used now, so the second store is the oldest
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
    with pytest.raises(StoreUnusable, match="cannot be stored in the cache folder"):
        store.allocate(3)


def test_a_smaller_request_goes_on_in_a_file_with_room_for_more(
    sphere: Mesh, tmp_path: Path, whole: Eigenpairs
) -> None:
    with open_store(sphere, tmp_path) as store:
        fill(store, whole, 4)
        rows = store.allocate(6, n_kept=4)
        assert rows.shape == (6, sphere.n_vertices)
        np.testing.assert_array_equal(rows[:4], whole.rows[:4])
        rows[4:] = whole.rows[4:6]
        store.append(whole.first(6))
    np.testing.assert_array_equal(loaded(sphere, tmp_path).rows[:6], whole.rows[:6])


def test_what_the_disk_has_room_for_to_the_byte_is_taken(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(StoreUnusable, match="no space left"):
        open_store(sphere, tmp_path).allocate(10**8)
    assert open_store(sphere, tmp_path).load() is None
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
    computed, _ = obtain_eigenpairs(sphere, OPERATOR, Request(12))

    def locked(_: EigenpairStore) -> None:
        raise AssertionError("kept others from writing")

    monkeypatch.setattr(EigenpairStore, "lock", locked)
    again, _ = obtain_eigenpairs(sphere, OPERATOR, Request(12))
    np.testing.assert_array_equal(again.rows, computed.rows)


def test_where_a_system_counts_no_blocks_a_folder_is_as_large_as_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "some").write_bytes(bytes(1234))
    (tmp_path / "more").write_bytes(bytes(10))
    look = os.stat
    monkeypatch.setattr(os, "stat", lambda path: SimpleNamespace(st_size=look(path).st_size))
    assert folder_size(tmp_path) == 1244

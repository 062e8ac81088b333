"""The store: what one process writes another reads, and nothing damaged is ever used."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshmash_viewer.certificate import Certificate
from meshmash_viewer.eigensolver import Decomposition, solve
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.cache import EigenpairCache, folder_size
from meshmash_viewer.io.store import EigenpairStore, StoreBusy
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.weyl import Target

OPERATOR = OperatorOptions()


def open_store(mesh: Mesh, root: Path, **options: Any) -> EigenpairStore:
    return EigenpairStore.open_or_create(mesh, OPERATOR, root, **options)


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


def fill(store: EigenpairStore, whole: Decomposition, start: int, stop: int) -> None:
    rows = store.allocate(whole.n_components, whole.rows.shape[1])
    rows[start:stop] = whole.rows[start:stop]
    store.append(start, whole.eigenvalues[start:stop], whole.residuals[start:stop])


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
    assert store.converged == 0
    assert not (tmp_path / "cache").exists()


def test_solved_into_the_store_and_found_again(sphere: Mesh, tmp_path: Path) -> None:
    stiffness, mass = cotangent_laplacian(sphere, robust=True)
    with open_store(sphere, tmp_path) as store:
        solved = solve(stiffness, mass, 12, allocate=store.allocate, on_pairs=store.append)
        store.finish(solved)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.complete
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
        looker = open_store(sphere, tmp_path)
        fill(store, whole, 0, 4)
        assert looker.converged == 4
        first = looker.load(check=False)
        assert first is not None
        assert (first.n_proven, first.complete) == (0, False)
        fill(store, whole, 6, 8)  # a slice further up: not a leading pair yet
        assert looker.converged == 4
        fill(store, whole, 4, 6)
        assert looker.converged == 8
        np.testing.assert_array_equal(first.rows, whole.rows[:4])
    # Cut off here: what has converged is kept, and is no answer to anything.
    kept = open_store(sphere, tmp_path).load()
    assert kept is not None
    assert kept.n_converged == 8
    assert kept.covers(Target("count", 2)) is None
    assert not kept.decomposition().complete


def test_asking_for_fewer_is_a_slice_and_for_more_is_more(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        store.finish(whole, max_eigenvalue=9.5)
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
        store.finish(synthetic(n, n))
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    assert found.covers(Target("count", 10 * n)) == n
    assert found.covers(Target("max_eigenvalue", 1e9)) == n


def test_growing_keeps_the_proof_of_what_is_proven(sphere: Mesh, tmp_path: Path) -> None:
    few, many = synthetic(sphere.n_vertices, 10), synthetic(sphere.n_vertices, 1200)
    np.testing.assert_array_equal(few.rows, many.rows[:10])
    with open_store(sphere, tmp_path) as store:
        store.finish(few)
    before = open_store(sphere, tmp_path).load()
    assert before is not None
    with open_store(sphere, tmp_path) as store:
        rows = store.allocate(1200)
        np.testing.assert_array_equal(rows[:10], few.rows)
        rows[:] = many.rows
        store.append(0, many.eigenvalues[:20], many.residuals[:20])  # known pairs come again
        found = open_store(sphere, tmp_path).load()
        assert found is not None
    # Other numbers than the proven ones in their place: the proof goes.
    assert (found.n_proven, found.n_converged) == (0, 20)
    with open_store(sphere, tmp_path) as store:
        store.finish(many)
    with open_store(sphere, tmp_path) as store:
        fill(store, many, 0, 20)
        assert store.load().n_proven == 1200  # type: ignore[union-attr]
    np.testing.assert_array_equal(before.rows, few.rows)  # an old map stays valid


def test_resumed_run_gives_the_same(sphere: Mesh, tmp_path: Path) -> None:
    stiffness, mass = cotangent_laplacian(sphere, robust=True)
    for count in (8, 20):
        with open_store(sphere, tmp_path) as store:
            stored = store.load()
            known = None if stored is None else stored.decomposition()
            solved = solve(
                stiffness, mass, count, known=known, allocate=store.allocate, on_pairs=store.append
            )
            store.finish(solved)
    direct = solve(stiffness, mass, 20)
    found = open_store(sphere, tmp_path).load()
    assert found is not None
    np.testing.assert_allclose(found.eigenvalues, direct.eigenvalues, rtol=1e-9, atol=1e-9)


def damage_row(folder: Path) -> None:
    rows = np.load(folder / "eigenvectors.npy", mmap_mode="r+")
    rows[3] = 0.0


def damage_value(folder: Path) -> None:
    np.load(folder / "eigenvalues.npy", mmap_mode="r+")[5] *= 1.5


def cut_rows(folder: Path) -> None:
    with (folder / "eigenvectors.npy").open("rb+") as file:
        file.truncate(1000)


def spoil_meta(folder: Path) -> None:
    (folder / "meta.json").write_text('{"n_pairs": ')


def overstate_meta(folder: Path) -> None:
    meta = json.loads((folder / "meta.json").read_text())
    (folder / "meta.json").write_text(json.dumps(meta | {"n_pairs": 99}))


def noise(folder: Path) -> None:
    (folder / "eigenvalues.npy").write_bytes(np.random.default_rng(1).bytes(500))


def damage_mass(folder: Path) -> None:
    np.load(folder / "mass.npy", mmap_mode="r+")[7] *= 2.0


def empty(name: str) -> Callable[[Path], None]:
    return lambda folder: os.truncate(folder / name, 0)


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


ARRAYS = ("eigenvectors.npy", "residuals.npy", "checksums.npy", "mass.npy")


@pytest.mark.parametrize(
    "damage",
    [damage_row, damage_value, cut_rows, spoil_meta, overstate_meta, noise, damage_mass]
    + [empty(name) for name in ("eigenvalues.npy", *ARRAYS)]
    + [remove(name) for name in ARRAYS],
)
def test_damage_is_seen_and_set_aside(
    damage: Any, sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    with open_store(sphere, tmp_path) as store:
        store.finish(whole)
    damage(store.folder)
    store = open_store(sphere, tmp_path)
    assert store.load() is None
    assert "damaged" in store.notice
    assert not store.folder.exists()
    assert len(list((tmp_path / "aside").iterdir())) == 1
    with store:
        store.finish(whole)
    assert open_store(sphere, tmp_path).load() is not None


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
        assert store.converged == 5  # looking is allowed
        damage_row(store.folder)
        assert store.load() is None  # seen, but not taken from under the other's feet
        assert store.folder.exists()
        assert EigenpairCache(tmp_path).clear() == 0
    finally:
        go.set()
        other.join(30)
    assert other.exitcode == 9
    # A killed process leaves no lock behind, and the damage is set aside now.
    assert store.load() is None
    with store:
        store.finish(whole)


def test_same_process_is_no_exception(sphere: Mesh, tmp_path: Path) -> None:
    with open_store(sphere, tmp_path) as first:
        first.allocate(3)
        with pytest.raises(StoreBusy):
            open_store(sphere, tmp_path).allocate(3)
    open_store(sphere, tmp_path).allocate(3)


def shifted(mesh: Mesh, by: int) -> Mesh:
    return Mesh(mesh.vertices + by, mesh.faces)


def test_oldest_goes_when_the_cap_is_reached(
    sphere: Mesh, tmp_path: Path, whole: Decomposition
) -> None:
    stores = [open_store(shifted(sphere, i), tmp_path) for i in range(3)]
    for age, store in enumerate(stores[:2]):
        with store:
            store.finish(whole)
        os.utime(store.folder / "problem.json", ns=(0, age))
    one = folder_size(stores[0].folder)
    assert stores[0].load() is not None  # used again: the other is now the oldest
    stores[2] = open_store(shifted(sphere, 2), tmp_path, cap=int(2.5 * one))
    with stores[2]:
        stores[2].finish(whole)
    assert [store.folder.exists() for store in stores] == [True, False, True]
    cache = EigenpairCache(tmp_path)
    assert cache.size() >= 2 * 0.9 * one
    assert cache.clear() >= 2 * 0.9 * one
    assert cache.stores() == []


def test_unwritable_cache_is_said(sphere: Mesh, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = open_store(sphere, tmp_path / "file")
    assert store.load() is None
    with pytest.raises(InputError, match="cannot be written"):
        store.allocate(3)


def test_too_much_for_the_disk_is_refused_beforehand(sphere: Mesh, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="GB free"):
        open_store(sphere, tmp_path).allocate(10**12)
    assert open_store(sphere, tmp_path).load() is None
    open_store(sphere, tmp_path).allocate(3)

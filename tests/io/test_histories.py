"""Pairs and files of a request do not depend on what the store has been used for before."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
import shapes
from listeners import Listener
from tiers import slow

from meshmash_viewer.cli.main import main
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.io.spectrum import find_eigenpairs, last_eigenpairs, obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.export import Export
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()
#: Between the eigenvalues of pairs 63 and 64, which are 8-fold and 9-fold multiples of a sphere's.
COUNT, MOST = Target("count", 60), Target("max_eigenvalue", 61.3)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    """Return a mesh that is solved in slices, with multiple eigenvalues and two components."""
    ball = shapes.icosphere(4)
    far = np.array([[5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]])
    faces = np.vstack([ball.faces, len(ball.vertices) + np.arange(3)])
    return Mesh(np.vstack([ball.vertices, far]), faces)


def pairs_of(mesh: Mesh, target: Target, operator: OperatorOptions = OPERATOR) -> tuple:
    """Return all data on the pairs of a request, except times."""
    request = Request(target.n_components, target.max_eigenvalue)
    pairs, _ = obtain_eigenpairs(mesh, operator, request)
    arrays = (pairs.eigenvalues, pairs.eigenvectors, pairs.residuals, pairs.mass)
    numbers = (len(pairs), pairs.total, pairs.target, pairs.known_to, pairs.certificate)
    return (*numbers, *(np.ascontiguousarray(each).tobytes() for each in arrays))


def longer(mesh: Mesh, target: Target) -> None:
    """Store more pairs, and then more up to an eigenvalue."""
    pairs_of(mesh, Target("count", 90))
    pairs_of(mesh, Target("max_eigenvalue", 80.0))


def stopped_early(mesh: Mesh, target: Target) -> None:
    """Stop the same request after its first slice, and a longer one before its last."""
    for asked, stop in ((target, 20), (Target("count", 120), 50)):
        found = [0]
        request = Request(
            asked.n_components,
            asked.max_eigenvalue,
            on_pairs=lambda pairs, found=found: found.append(len(pairs)),
            cancel=lambda found=found, stop=stop: found[-1] >= stop,
        )
        with pytest.raises(Cancelled):
            obtain_eigenpairs(mesh, OPERATOR, request)
        stored, _ = find_eigenpairs(mesh, OPERATOR, asked)
        assert stored is not None
        assert not stored.complete
        assert stop <= len(stored) < (asked.n_components or 64)


def other_operator(mesh: Mesh, target: Target) -> None:
    pairs_of(mesh, target, OperatorOptions(robust=False))


def damaged(mesh: Mesh, target: Target) -> None:
    """Change a byte of a row of the second slice."""
    pairs_of(mesh, target)
    with (EigenpairStore(mesh, OPERATOR, target).folder / "eigenvectors.f64").open("r+b") as file:
        file.seek(8 * (mesh.n_vertices * 50 + 100))
        file.write(b"1")
    left, remark = find_eigenpairs(mesh, OPERATOR, target)
    assert left is not None
    assert 20 <= len(left) < 50
    assert "Damaged" in remark


HISTORIES = [longer, stopped_early, slow(other_operator), damaged]


@pytest.mark.parametrize("target", [COUNT, slow(MOST)], ids=["count", "threshold"])
@pytest.mark.parametrize("history", HISTORIES)
def test_pairs_of_a_request_are_the_same_after_any_history(
    ball: Mesh, own_cache: Path, history, target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setenv("MESHMASH_CACHE", str(own_cache / "empty"))
        fresh = pairs_of(ball, target)
    history(ball, target)
    assert pairs_of(ball, target) == fresh
    assert pairs_of(ball, target) == fresh  # now stored
    if target is COUNT:
        stiffness, mass = cotangent_laplacian(ball, robust=True)
        stored, _ = find_eigenpairs(ball, OPERATOR, COUNT)
        assert stored is not None
        again = stored.verify(stiffness, mass)
        assert again.complete
        assert fresh[4].counted <= 64  # the count is that of this request


def content(path: Path) -> dict[str, bytes]:
    """Return the entries of a file, without the time at which it was written."""
    with np.load(path) as file:
        entries = {name: file[name] for name in file.files}
    meta = json.loads(entries.pop("meta").item())
    del meta["created"]
    return {name: each.tobytes() for name, each in entries.items()} | {"meta": meta}


def test_files_of_a_request_are_the_same_from_window_and_command_line(
    ball: Mesh, own_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, listener = tmp_path / "ball.npz", Listener(tmp_path)
    np.savez(source, vertices=ball.vertices, faces=ball.faces)
    mesh = Mesh(ball.vertices, ball.faces, name="ball")

    def command(name: str) -> dict[str, bytes]:
        path = str(tmp_path / name)
        assert main(["features", str(source), "--kind", "hks", "--count", "60", "-o", path]) == 0
        return content(tmp_path / name)

    fresh = command("fresh.npz")
    monkeypatch.setenv("MESHMASH_CACHE", str(own_cache / "other"))
    for target in (Target("count", 90), COUNT):
        pairs = decompose(mesh, OPERATOR, target, listener).content
    family = HeatKernelSignature().resolved(pairs, {})
    Export(mesh, OPERATOR, tmp_path / "window.npz", family, 60, COUNT)(listener)
    window = content(tmp_path / "window.npz")
    assert window == fresh
    assert command("again.npz") == fresh


def test_a_part_of_the_pairs_has_a_proof_of_its_own(ball: Mesh, own_cache: Path) -> None:
    whole, _ = obtain_eigenpairs(ball, OPERATOR, Request(60))
    part = whole.first(20)
    values, certificate = whole.eigenvalues, part.certificate
    assert certificate.complete
    assert certificate.counted == np.count_nonzero(values <= values[19] * (1.0 + 1e-6))
    assert values[certificate.counted - 1] < certificate.bound < values[certificate.counted]
    assert certificate.residual == whole.residuals[:20].max()
    stiffness, mass = cotangent_laplacian(ball, robust=True)
    again = part.verify(stiffness, mass)
    assert again.complete
    assert part.target == Target("count", 20)


def test_opening_shows_what_was_asked_for(sphere: Mesh, own_cache: Path) -> None:
    assert last_eigenpairs(sphere, OPERATOR, None) == (None, "")
    for count in (30, 85, 50):
        obtain_eigenpairs(sphere, OPERATOR, Request(count))
        time.sleep(0.02)  # the resolution of times of files
    last, _ = last_eigenpairs(sphere, OPERATOR, Target("count", 30))
    assert (len(last), last.target) == (30, Target("count", 30))
    time.sleep(0.02)
    obtain_eigenpairs(sphere, OPERATOR, Request(85))
    for never_asked in (None, Target("count", 40)):
        last, _ = last_eigenpairs(sphere, OPERATOR, never_asked)
        assert (len(last), last.target) == (85, Target("count", 85))
    # more than all pairs are all pairs
    for count in (700, 900):
        obtain_eigenpairs(sphere, OPERATOR, Request(count))
    assert [each.value for each in EigenpairStore.targets(sphere, OPERATOR)] == [642, 85, 30, 50]

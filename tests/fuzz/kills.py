"""Processes killed while they compute eigenpairs, and checks of the files that remain.

Pairs published before the kill are not computed again, the next run gives bit by bit the result of
an undisturbed run, and only the files of the store remain.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
import numpy.typing as npt
import psutil

from meshmash_viewer.io.atomic import remove_abandoned
from meshmash_viewer.io.cache import ROWS
from meshmash_viewer.io.spectrum import find_eigenpairs, obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.worker import serve
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.work import Wire, end_group, start_child
from tests.fuzz.store_faults import OPERATOR, blanket

FloatArray = npt.NDArray[np.float64]

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGKILL", "SIGTERM", "SIGINT") if hasattr(signal, name)
)
#: Number of pairs proven before, and number of pairs requested.
PROVEN, WANTED = 60, 300
#: Paths allowed in a cache folder while no process writes into it.
_BELONGS = re.compile(
    r"eigenpairs(/locks(/[0-9a-f]{32}\.lock)?"
    r"|/[0-9a-f]{32}(/(problem\.json|eigenvectors\.f64|pairs\.sealed))?)?"
)


@dataclass(frozen=True, eq=False)
class Undisturbed:
    """Results of runs that are not killed.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        File of the mesh.
    eigenvalues : ndarray of float64
    proven : Path
        A cache folder with the first pairs.
    rows : ndarray of float64
        Eigenvectors.
    seconds : dict of float
        Duration of a run of each kind.
    """

    mesh: Mesh
    path: Path
    eigenvalues: FloatArray
    proven: Path
    rows: FloatArray
    seconds: dict[str, float]


def prepare(folder: Path, n_vertices: int) -> Undisturbed:
    """Write a mesh, and run each kind once without a kill."""
    mesh = blanket(n_vertices)
    path = folder / "blanket.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    with cache_at(folder / "whole"):
        whole = obtain_eigenpairs(mesh, OPERATOR, Request(WANTED))[0]
    with cache_at(folder / "proven"):
        obtain_eigenpairs(mesh, OPERATOR, Request(PROVEN))
    seconds = {}
    for kind in ("command line", "worker"):
        began = time.perf_counter()
        with _running(kind, mesh, path, folder / f"timed {kind}") as process:
            process.wait()
        seconds[kind] = time.perf_counter() - began
    eigenvalues = np.array(whole.eigenvalues)
    return Undisturbed(mesh, path, eigenvalues, folder / "proven", np.array(whole.rows), seconds)


def kill_once(undisturbed: Undisturbed, folder: Path, rng: np.random.Generator) -> str:
    """Kill a process at a random moment, and check that nothing is lost.

    Parameters
    ----------
    undisturbed : Undisturbed
    folder : Path
        An empty folder; removed afterwards.
    rng : numpy.random.Generator

    Returns
    -------
    str
        Description of the kill; empty if the process had already ended.

    Raises
    ------
    AssertionError
        If pairs are lost or files are left.
    """
    kind = str(rng.choice(list(undisturbed.seconds)))
    from_proven = bool(rng.integers(2))
    how = SIGNALS[int(rng.integers(len(SIGNALS)))]
    # After the imports, which take a third of the run.
    delay = float(rng.uniform(0.3, 1.0)) * undisturbed.seconds[kind]
    what = (
        f"{how.name} to the {kind}, {PROVEN if from_proven else 0} pairs proven, at {delay:.2f} s"
    )
    if from_proven:
        shutil.copytree(undisturbed.proven, folder / "cache")
    with _running(kind, undisturbed.mesh, undisturbed.path, folder) as process:
        time.sleep(delay)
        ended = process.poll() is not None
        family = [] if ended else psutil.Process(process.pid).children(recursive=True)
        process.send_signal(how)
        if kind != "worker":
            process.wait(60)
            _, alive = psutil.wait_procs(family, timeout=20)
            assert not alive, (what, alive)
    with cache_at(folder / "cache"):
        _see_that_nothing_is_lost(undisturbed, folder / "cache", from_proven, what)
    # The next window removes temporary folders of killed ones.
    with mock.patch("tempfile.tempdir", str(folder / "tmp")):
        remove_abandoned()
    remaining = {path.name for path in (folder / "tmp").iterdir()}
    assert not {name for name in remaining if "meshmash" in name}, (what, remaining)
    shutil.rmtree(folder)
    # The load of the machine changes, and with it the duration of a run.
    undisturbed.seconds[kind] *= 0.8 if ended else 1.03
    return "" if ended else what


def _see_that_nothing_is_lost(
    undisturbed: Undisturbed, cache: Path, from_proven: bool, what: str
) -> None:
    mesh = undisturbed.mesh
    if from_proven:
        assert EigenpairStore(mesh, OPERATOR, Target("count", PROVEN)).is_complete, what
    _, remark = find_eigenpairs(mesh, OPERATOR, Target("count", WANTED))
    assert not remark, (what, remark)
    pairs, remark = obtain_eigenpairs(mesh, OPERATOR, Request(WANTED))
    assert not remark, (what, remark)
    assert pairs.complete, what
    np.testing.assert_array_equal(pairs.eigenvalues, undisturbed.eigenvalues, err_msg=what)
    np.testing.assert_array_equal(pairs.rows, undisturbed.rows, err_msg=what)
    root = cache
    odd = [
        str(path.relative_to(root))
        for path in root.rglob("*")
        if not _BELONGS.fullmatch(path.relative_to(root).as_posix())
    ]
    assert not odd, (what, odd)
    counts = sorted(path.stat().st_size / (8 * mesh.n_vertices) for path in root.rglob(ROWS))
    assert counts == [PROVEN] * from_proven + [WANTED], (what, counts)


@contextmanager
def cache_at(folder: Path) -> Iterator[None]:
    """Set the cache folder of this process."""
    with mock.patch.dict(os.environ, {"MESHMASH_CACHE": str(folder)}):
        yield


@contextmanager
def _running(kind: str, mesh: Mesh, path: Path, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process that computes the pairs: a command line or a window's worker."""
    (folder / "tmp").mkdir(parents=True)
    environment = os.environ | {
        "MESHMASH_CACHE": str(folder / "cache"),
        "TMPDIR": str(folder / "tmp"),
    }
    if kind != "worker":
        command = [sys.executable, "-m", "meshmash_viewer", "features", str(path), "--kind", "hks"]
        command += ["--count", str(WANTED), "-o", str(folder / "hks.npz")]
        with subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            yield process
            return
    passing = folder / "passing"
    passing.mkdir()
    with start_child(serve, str(passing), env=environment, start_new_session=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        wire = Wire(process.stdout, process.stdin)  # type: ignore[arg-type]
        work = partial(decompose, mesh, OPERATOR, Target("count", WANTED))
        wire.send((1, ("Decomposing", work)))
        listener = threading.Thread(target=_listen, args=(wire, process))
        listener.start()
        try:
            yield process
        finally:
            # End the worker as a closing window does: SIGINT alone does not end it.
            end_group(process.pid, 2.0)
            listener.join()


def _listen(wire: Wire, process: subprocess.Popen[bytes]) -> None:
    """Receive the worker's messages; kill it when it has finished."""
    with suppress(EOFError, OSError, ValueError):
        while True:
            kind, _ = wire.receive()
            if kind in ("finished", "failed", "cancelled"):
                process.kill()
                return

from __future__ import annotations

import errno
import os
import queue
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from long_jobs import doubling, dying, endless, failing, parallel
from tiers import slow

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.jobs import Job, prepare
from meshmash_viewer.model.worker import Worker, _JobChannel
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.weyl import Target

_PATIENCE = 60.0
_ENDS = ("finished", "failed", "cancelled")


class Window:
    """Receiver of the messages of a worker, like a window."""

    def __init__(self) -> None:
        self.messages: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self.worker = Worker(lambda *message: self.messages.put(message))

    def wait_for(self, *kinds: str) -> Any:
        while True:
            kind, content = self.messages.get(timeout=_PATIENCE)
            if kind in kinds:
                return content
            assert kind not in _ENDS, content

    def run(self, job: Job, end: str = "finished") -> Any:
        self.worker.submit(job)
        return self.wait_for(end)

    def close(self) -> None:
        self.worker.close()
        assert not self.worker.folder.exists()
        assert self.worker.process_id is None


@pytest.fixture
def window() -> Iterator[Window]:
    window = Window()
    yield window
    window.close()


@pytest.fixture(scope="module")
def lasting() -> Iterator[Window]:
    """A window shared by tests that keep its process running."""
    window = Window()
    yield window
    window.close()


def lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def test_result_parts_and_progress_arrive(lasting: Window) -> None:
    values = np.arange(100_000.0)
    lasting.worker.submit(doubling(values))
    assert lasting.worker.busy
    assert lasting.messages.get(timeout=_PATIENCE)[1].message == "half way"
    np.testing.assert_array_equal(lasting.wait_for("sent"), values[:50_000])
    np.testing.assert_array_equal(lasting.wait_for("finished"), 2 * values)
    assert not lasting.worker.busy
    assert {path.name for path in lasting.worker.folder.iterdir()} == {"stderr.txt"}


def test_jobs_run_in_a_thread_of_the_same_process_where_tests_ask_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Worker, "in_process", True)
    window = Window()
    np.testing.assert_array_equal(window.run(doubling(np.ones(3))), 2.0)
    assert "a defect" in window.run(failing("defect"), "failed").text
    assert window.run(endless(), "sent") == os.getpid()
    window.worker.cancel()
    window.wait_for("cancelled")
    window.worker.submit(endless())
    window.close()


def test_one_job_at_a_time_in_one_warm_process(lasting: Window) -> None:
    ids = set()
    for _ in range(3):
        lasting.worker.submit(doubling(np.zeros(3)))
        with pytest.raises(RuntimeError, match="busy"):
            lasting.worker.submit(doubling(np.zeros(3)))
        lasting.wait_for("finished")
        ids.add(lasting.worker.process_id)
    assert len(ids) == 1


@pytest.mark.parametrize("deaf", [False, slow(True)])
def test_cancelling_asks_and_then_insists(
    lasting: Window, deaf: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    patience = 1.0 if deaf else 600.0  # the process may respond slowly
    monkeypatch.setattr("meshmash_viewer.model.worker._CANCEL_PATIENCE", patience)
    pid = lasting.run(endless(deaf=deaf), "sent")
    began = time.monotonic()
    lasting.worker.cancel()
    lasting.wait_for("cancelled")
    assert not deaf or time.monotonic() - began >= patience
    assert lives(pid) is not deaf
    np.testing.assert_array_equal(lasting.run(doubling(np.ones(2))), 2.0)


def test_cancelling_before_the_job_has_started_is_no_failure(lasting: Window) -> None:
    lasting.worker.submit(endless())
    lasting.worker.cancel()
    lasting.wait_for("cancelled")
    lasting.worker.cancel()
    assert not lasting.worker.busy
    # cancelling that job does not cancel the next
    pid = lasting.run(endless(), "sent")
    time.sleep(1.2)
    assert lives(pid)
    lasting.worker.cancel()
    lasting.wait_for("cancelled")


@pytest.mark.parametrize(
    ("kind", "sentence", "correctable"),
    [
        ("input", "The mesh is upside down: turn it over.", True),
        ("memory", "Memory ran out", True),
        ("file", "/nowhere/at/all: No such file or directory;", True),
        ("defect", "ZeroDivisionError: a defect", False),
        ("unpicklable", "Failing badly failed by a defect", False),
    ],
)
def test_failure_is_a_sentence(
    lasting: Window, kind: str, sentence: str, correctable: bool
) -> None:
    failure = lasting.run(failing(kind), "failed")
    assert sentence in failure.text
    assert "\n" not in failure.text
    assert failure.correctable is correctable
    assert bool(failure.details) is (kind != "input")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("SIGKILL", "most likely because memory ran out"), slow("SIGABRT", "signal 6")],
)
def test_end_of_the_process_is_a_sentence_and_another_takes_its_place(
    lasting: Window, name: str, sentence: str
) -> None:
    failure = lasting.run(dying(name), "failed")
    assert (sentence if os.name == "posix" else "its process ended with status") in failure.text
    lasting.run(doubling(np.zeros(3)))


@pytest.mark.slow
def test_idle_process_that_died_is_replaced(lasting: Window) -> None:
    lasting.run(doubling(np.zeros(3)))
    pid = lasting.worker.process_id
    assert pid is not None
    psutil.Process(pid).kill()
    wait_until(lambda: not lives(pid))
    lasting.run(doubling(np.zeros(3)))


@pytest.mark.slow
def test_a_process_that_cannot_be_started_again_is_said_by_the_next_job(
    lasting: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EAGAIN, "no more processes")

    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "Popen", refuse)
        lasting.run(dying("SIGABRT"), "failed")
        assert "no more processes" in lasting.run(doubling(np.zeros(3)), "failed").text
    lasting.run(doubling(np.zeros(3)))


def test_a_mesh_of_the_same_name_is_not_taken_for_the_one_before(
    lasting: Window, sphere: Mesh
) -> None:
    named = Mesh(sphere.vertices, sphere.faces, name="ball")
    other = Mesh(2.0 * sphere.vertices, sphere.faces, name="ball")
    for mesh in (named, other, named.in_unit("nm"), named.in_voxels((3.0, 3.0, 3.0), "nm")):
        ready = lasting.run(Job("Inspecting", "ball", partial(prepare, mesh))).content
        np.testing.assert_array_equal(ready.mesh.vertices, mesh.vertices)
        assert (ready.mesh.unit, ready.mesh.voxel) == (mesh.unit, mesh.voxel)
        assert ready.health.area == pytest.approx(mesh.area)
    work = partial(decompose, other, OperatorOptions(), Target("count", 4))
    grew = lasting.run(Job("Decomposing", "ball", work)).content
    np.testing.assert_allclose(grew.eigenvalues[1:], 0.5, rtol=0.02)
    errors = lasting.worker.folder / "stderr.txt"
    printed = errors.read_bytes().replace(b"a stray line on standard output", b"")
    assert printed == b"", "what it prepares next to the jobs works"


@pytest.mark.slow
def test_closing_ends_the_solvers_processes_too(window: Window) -> None:
    ids = window.run(parallel(), "sent")
    (window.worker.folder / "half-written").touch()
    assert all(lives(pid) for pid in ids)
    window.close()
    assert not any(lives(pid) for pid in ids)
    with pytest.raises(RuntimeError, match="closed"):
        window.worker.submit(endless())


def test_closing_at_once_leaves_nothing() -> None:
    Window().close()


def test_what_a_killed_window_left_goes_when_the_next_one_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code = "import tempfile; from meshmash_viewer.io.atomic import scratch_prefix\n"
    code += "print(tempfile.mkdtemp(prefix=scratch_prefix()))"
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    told = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    killed = Path(told.strip())
    assert killed.is_dir()
    window = Window()
    wait_until(lambda: not killed.exists())
    assert window.worker.folder.exists()
    window.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills with a signal")
def test_nothing_outlives_a_window_that_was_killed(tmp_path: Path) -> None:
    script = (
        "import sys, time\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[1])!r})\n"
        "from long_jobs import parallel\n"
        "from meshmash_viewer.model.worker import Worker\n"
        "def receive(kind, ids):\n"
        "    if kind == 'sent': print(*ids, worker.folder, flush=True)\n"
        "worker = Worker(receive)\n"
        "worker.submit(parallel())\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as window:
        assert window.stdout is not None
        *ids, folder = window.stdout.readline().split()
        window.kill()
    wait_until(lambda: not any(lives(int(pid)) for pid in ids))
    assert not Path(folder).exists()


def test_reports_are_thinned_but_for_the_first_of_a_stage(tmp_path: Path) -> None:
    received: list[Progress] = []
    channel = _JobChannel(lambda _, content: received.append(content), lambda: False, tmp_path)
    for stage in ("a", "b"):
        for _ in range(1000):
            channel.report(Progress(stage))
    stages = [progress.stage for progress in received]
    assert stages == sorted(stages)
    assert set(stages) == {"a", "b"}
    assert len(stages) < 1000

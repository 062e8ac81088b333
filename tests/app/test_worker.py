from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from long_jobs import DoubleJob, DyingJob, EndlessJob, FailingJob, ParallelJob
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.worker import Worker

_PATIENCE = 30_000


@pytest.fixture
def worker(qtbot: QtBot) -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.close()
    assert not worker.folder.exists()
    assert worker.process_id is None


def lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE / 1000
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def outcome(qtbot: QtBot, worker: Worker, job: Any) -> Any:
    with qtbot.waitSignal(worker.failed, timeout=_PATIENCE) as failed:
        worker.submit(job)
    return failed.args[0]


def test_result_parts_and_progress_arrive(qtbot: QtBot, worker: Worker) -> None:
    reports, parts = [], []
    worker.progressed.connect(reports.append)
    worker.sent.connect(parts.append)
    values = np.arange(100_000.0)
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE) as finished:
        worker.submit(DoubleJob(values))
        assert worker.busy
    np.testing.assert_array_equal(finished.args[0], 2 * values)
    np.testing.assert_array_equal(parts[0], values[:50_000])
    assert reports[0].message == "half way"
    assert not worker.busy
    assert {path.name for path in worker.folder.iterdir()} == {"stderr.txt"}


def test_jobs_run_in_a_thread_of_the_same_process_where_tests_ask_for_it(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Worker, "in_process", True)
    worker = Worker()
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE) as finished:
        worker.submit(DoubleJob(np.ones(3)))
    np.testing.assert_array_equal(finished.args[0], 2.0)
    assert "a defect" in outcome(qtbot, worker, FailingJob("defect")).text
    with qtbot.waitSignal(worker.sent, timeout=_PATIENCE) as sent:
        worker.submit(EndlessJob())
    assert sent.args[0] == os.getpid()
    with qtbot.waitSignal(worker.cancelled, timeout=_PATIENCE):
        worker.cancel()
    worker.submit(EndlessJob())
    worker.close()
    assert not worker.folder.exists()


def test_one_job_at_a_time_in_one_warm_process(qtbot: QtBot, worker: Worker) -> None:
    ids = set()
    for _ in range(3):
        with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
            worker.submit(DoubleJob(np.zeros(3)))
            with pytest.raises(RuntimeError, match="busy"):
                worker.submit(DoubleJob(np.zeros(3)))
        ids.add(worker.process_id)
    assert len(ids) == 1


@pytest.mark.parametrize("deaf", [False, True])
def test_cancelling_asks_and_then_insists(qtbot: QtBot, worker: Worker, deaf: bool) -> None:
    with qtbot.waitSignal(worker.sent, timeout=_PATIENCE) as sent:
        worker.submit(EndlessJob(deaf))
    pid = sent.args[0]
    with qtbot.waitSignal(worker.cancelled, timeout=_PATIENCE):
        worker.cancel()
    assert lives(pid) is not deaf
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE) as finished:
        worker.submit(DoubleJob(np.ones(2)))
    np.testing.assert_array_equal(finished.args[0], 2.0)


def test_cancelling_before_the_thread_takes_the_job_is_no_failure(
    qtbot: QtBot, worker: Worker
) -> None:
    # a thread that takes the job late: it was cancelled between the order and its start
    late = worker._run
    worker._run = lambda job: (time.sleep(0.3), late(job))
    failures = []
    worker.failed.connect(failures.append)
    with qtbot.waitSignal(worker.cancelled, timeout=_PATIENCE):
        worker.submit(EndlessJob())
        worker.cancel()
    assert failures == []


def test_cancelling_nothing_does_nothing(worker: Worker) -> None:
    worker.cancel()
    assert not worker.busy


@pytest.mark.parametrize(
    ("kind", "sentence", "correctable"),
    [
        ("input", "The mesh is upside down: turn it over.", True),
        ("memory", "Memory ran out", True),
        ("file", "/nowhere/at/all: No such file or directory;", True),
        ("defect", "ZeroDivisionError: a defect", False),
        ("unpicklable", "Failing failed by a defect", False),
    ],
)
def test_failure_is_a_sentence(
    qtbot: QtBot, worker: Worker, kind: str, sentence: str, correctable: bool
) -> None:
    failure = outcome(qtbot, worker, FailingJob(kind))
    assert sentence in failure.text
    assert "\n" not in failure.text
    assert failure.correctable is correctable
    assert bool(failure.details) is (kind != "input")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("SIGKILL", "most likely because memory ran out"), ("SIGABRT", "signal 6")],
)
def test_end_of_the_process_is_a_sentence_and_another_takes_its_place(
    qtbot: QtBot, worker: Worker, name: str, sentence: str
) -> None:
    failure = outcome(qtbot, worker, DyingJob(name))
    assert (sentence if os.name == "posix" else "its process ended with status") in failure.text
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))


def test_idle_process_that_died_is_replaced(qtbot: QtBot, worker: Worker) -> None:
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))
    pid = worker.process_id
    assert pid is not None
    psutil.Process(pid).kill()
    wait_for(lambda: not lives(pid))
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL])
def test_an_idle_process_whose_pipe_has_gone_is_replaced_on_every_system(
    qtbot: QtBot, worker: Worker, number: int
) -> None:
    """Windows answers EINVAL where POSIX answers EPIPE, and may not know yet that it has ended."""
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))
    pid, wire = worker.process_id, worker._wire
    assert wire is not None
    sink = wire._sink
    failures: list[Any] = []
    worker.failed.connect(failures.append)

    class Gone:
        def write(self, _: bytes) -> int:
            raise OSError(number, os.strerror(number))

        def flush(self) -> None: ...

        def close(self) -> None:
            sink.close()
            raise OSError(number, os.strerror(number))

    wire._sink = Gone()  # type: ignore[assignment]
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE) as finished:
        worker.submit(DoubleJob(np.ones(2)))
    np.testing.assert_array_equal(finished.args[0], 2.0)
    assert worker.process_id != pid
    assert failures == []


def test_a_process_that_cannot_be_started_again_is_said_by_the_next_job(
    qtbot: QtBot, worker: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EAGAIN, "no more processes")

    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "Popen", refuse)
        outcome(qtbot, worker, DyingJob("SIGABRT"))
        assert "no more processes" in outcome(qtbot, worker, DoubleJob(np.zeros(3))).text
    with qtbot.waitSignal(worker.finished, timeout=_PATIENCE):
        worker.submit(DoubleJob(np.zeros(3)))


def test_closing_ends_the_solvers_processes_too(qtbot: QtBot) -> None:
    worker = Worker()
    with qtbot.waitSignal(worker.sent, timeout=_PATIENCE) as sent:
        worker.submit(ParallelJob())
    (worker.folder / "half-written").touch()
    assert all(lives(pid) for pid in sent.args[0])
    worker.close()
    assert not any(lives(pid) for pid in sent.args[0])
    assert not worker.folder.exists()
    with pytest.raises(RuntimeError, match="closed"):
        worker.submit(EndlessJob())


def test_closing_at_once_leaves_nothing(qtbot: QtBot) -> None:
    worker = Worker()
    worker.close()
    assert not worker.folder.exists()
    assert worker.process_id is None


def test_what_a_killed_window_left_goes_when_the_next_one_opens(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code = "import tempfile; from meshmash_viewer.io.atomic import scratch_prefix\n"
    code += "print(tempfile.mkdtemp(prefix=scratch_prefix()))"
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    told = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    killed = Path(told.strip())
    assert killed.is_dir()
    worker = Worker()
    wait_for(lambda: not killed.exists())
    assert worker.folder.exists()
    worker.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="kills with a signal")
def test_nothing_outlives_a_window_that_was_killed(tmp_path: Path) -> None:
    script = (
        "import sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[1])!r})\n"
        "from PySide6.QtCore import QCoreApplication\n"
        "from long_jobs import ParallelJob\n"
        "from meshmash_viewer.app.worker import Worker\n"
        "app = QCoreApplication([])\n"
        "worker = Worker()\n"
        "worker.sent.connect(lambda ids: print(*ids, worker.folder, flush=True))\n"
        "worker.submit(ParallelJob())\n"
        "app.exec()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as window:
        assert window.stdout is not None
        *ids, folder = window.stdout.readline().split()
        window.kill()
    wait_for(lambda: not any(lives(int(pid)) for pid in ids))
    assert not Path(folder).exists()

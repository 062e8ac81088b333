"""Jobs with every possible behaviour, whose functions the process that runs them can import."""

from __future__ import annotations

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.work import Channel


def doubling(values: np.ndarray) -> Job:
    """Return a job that reports, sends half an array and returns it doubled."""
    return Job("Doubling", "an array", partial(_double, values))


def endless(*, deaf: bool = False) -> Job:
    """Return a job that works until it is cancelled; if deaf, it never checks."""
    return Job("Working", "on", partial(_work, deaf))


def parallel() -> Job:
    """Return a job that starts processes, as the solver does, and sends their ids."""
    return Job("Working", "in parallel", _work_in_parallel)


def dying(signal_name: str = "SIGKILL") -> Job:
    """Return a job that kills its process."""
    return Job("Dying", "", partial(_die, signal_name))


def failing(kind: str) -> Job:
    """Return a job that fails in the way of its kind."""
    return Job("Failing", "badly", partial(_fail, kind))


def _double(values: np.ndarray, channel: Channel) -> np.ndarray:
    channel.report(Progress("doubling", fraction=0.5, message="half way"))
    channel.send(values[: len(values) // 2])
    sys.stdout.write("a stray line on standard output")
    sys.stdout.flush()
    return 2 * values


def _work(deaf: bool, channel: Channel) -> None:
    channel.send(os.getpid())
    while True:
        time.sleep(0.01)
        if not deaf and channel.cancelled():
            raise Cancelled


def _work_in_parallel(channel: Channel) -> None:
    from joblib import Parallel, delayed

    ids = Parallel(n_jobs=2)(delayed(_pid_after)(0.2) for _ in range(2))
    channel.send([os.getpid(), *ids])
    Parallel(n_jobs=2)(delayed(_pid_after)(3600.0) for _ in range(2))


def _pid_after(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def _die(signal_name: str, _: Channel) -> None:
    os.kill(os.getpid(), getattr(signal, signal_name, signal.SIGTERM))
    time.sleep(60)


def _fail(kind: str, _: Channel) -> object:
    if kind == "input":
        raise InputError("The mesh is upside down: turn it over.")
    if kind == "memory":
        raise MemoryError
    if kind == "file":
        Path("/nowhere/at/all").read_text(encoding="utf-8")
    if kind == "unpicklable":
        return lambda: None
    raise ZeroDivisionError("a defect")

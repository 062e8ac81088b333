"""Jobs with every possible behaviour, importable by the process that runs them."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.work import Channel, Job


@dataclass(frozen=True, eq=False)
class DoubleJob(Job):
    """Job that reports, sends half an array and returns it doubled."""

    values: np.ndarray
    label: str = "Doubling"

    def run(self, channel: Channel) -> np.ndarray:
        channel.report(Progress("doubling", fraction=0.5, message="half way"))
        channel.send(self.values[: len(self.values) // 2])
        sys.stdout.write("a stray line on standard output")
        sys.stdout.flush()
        return 2 * self.values


@dataclass(frozen=True)
class EndlessJob(Job):
    """Job that works until it is cancelled; if deaf, it never checks."""

    deaf: bool = False
    label: str = "Working"

    def run(self, channel: Channel) -> None:
        channel.send(os.getpid())
        while True:
            time.sleep(0.01)
            if not self.deaf and channel.cancelled():
                raise Cancelled


@dataclass(frozen=True)
class ParallelJob(Job):
    """Job that starts processes, as the solver does, and sends their ids."""

    label: str = "Working in parallel"

    def run(self, channel: Channel) -> None:
        from joblib import Parallel, delayed

        ids = Parallel(n_jobs=2)(delayed(_pid_after)(0.2) for _ in range(2))
        channel.send([os.getpid(), *ids])
        Parallel(n_jobs=2)(delayed(_pid_after)(3600.0) for _ in range(2))


def _pid_after(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


@dataclass(frozen=True)
class DyingJob(Job):
    """Job that kills its process."""

    signal_name: str = "SIGKILL"
    label: str = "Dying"

    def run(self, channel: Channel) -> None:
        os.kill(os.getpid(), getattr(signal, self.signal_name, signal.SIGTERM))
        time.sleep(60)


@dataclass(frozen=True)
class FailingJob(Job):
    """Job that fails in the way of its `kind`."""

    kind: str
    label: str = "Failing"

    def run(self, channel: Channel) -> object:
        if self.kind == "input":
            raise InputError("The mesh is upside down: turn it over.")
        if self.kind == "memory":
            raise MemoryError
        if self.kind == "file":
            Path("/nowhere/at/all").read_text(encoding="utf-8")
        if self.kind == "unpicklable":
            return lambda: None
        raise ZeroDivisionError("a defect")

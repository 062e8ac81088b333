"""Measurements of event loop, drawing and memory, and a player of scripts."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from interaction_bystander import TICK, seconds_waited
from PySide6.QtCore import QEventLoop, Qt, QTimer

from meshmash_viewer.model.field import expected_bytes

Script = Iterator[float | Callable[[], bool]]


class Bystanders:
    """Processes that detect when a processor is withheld (`interaction_bystander.py`)."""

    def __init__(self) -> None:
        program = Path(__file__).with_name("interaction_bystander.py")
        count = os.cpu_count() if sys.platform == "linux" else 0
        # closed at the end of this process
        self._logs = [tempfile.TemporaryFile("w+") for _ in range(count or 0)]  # noqa: SIM115
        self._processes = [
            subprocess.Popen([sys.executable, str(program), str(number)], stdout=log)
            for number, log in enumerate(self._logs)
        ]

    def withheld(self) -> list[np.ndarray]:
        """End the processes; return the withheld intervals of each processor, shape (s, 2)."""
        found = []
        for process, log in zip(self._processes, self._logs, strict=True):
            process.terminate()
            process.wait()
            log.seek(0)
            times = [float(word) for word in log.read().split()]
            found.append(np.array(times[: len(times) // 2 * 2]).reshape(-1, 2))
        return found

    @staticmethod
    def here() -> int:
        """Return the number of the processor on which this thread runs."""
        return int(ctypes.CDLL(None).sched_getcpu()) if sys.platform == "linux" else 0


class Drawing:
    """Times inside VTK's own drawing calls."""

    def __init__(self) -> None:
        self.seconds = 0.0  # without waiting for a processor
        self.frames = 0
        self.calls: list[tuple[float, float, float]] = []  # beginning, end, waited meanwhile

    def watch(self, window: Any) -> Any:
        for name in ("Initialize", "Render", "Frame", "WaitForCompletion"):
            setattr(window, name, self._timed(name, getattr(window, name)))
        return window

    def _timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started, waited = time.perf_counter(), seconds_waited()
            try:
                return call(*arguments)
            finally:
                waited, ended = seconds_waited() - waited, time.perf_counter()
                self.calls.append((started, ended, waited))
                self.seconds += ended - started - waited
                self.frames += name == "Render"

        return timed


@dataclass(frozen=True)
class Gap:
    """The time between two ticks, in seconds."""

    start: float
    end: float
    waited: float
    calls: list[tuple[float, float, float]]
    processors: tuple[int, int]

    def lengths(self, withheld: list[np.ndarray]) -> tuple[float, float]:
        """Return the length with and without drawing, both without delays by the machine.

        The delay is the longer of two times: that of waiting for a processor, and that for which
        the processor was withheld, which may be part of the waiting.
        """
        known = withheld if withheld else [np.zeros((0, 2))] * (1 + max(self.processors))
        here = [known[number] for number in self.processors]
        drawn = sum(end - start for start, end, _ in self.calls)
        waited = self.waited - sum(part for _, _, part in self.calls)
        lost = max(_overlap(times, self.start, self.end) for times in here)
        outside = max(
            _overlap(times, self.start, self.end)
            - sum(_overlap(times, start, end) for start, end, _ in self.calls)
            for times in here
        )
        length = self.end - self.start
        return length - max(self.waited, lost), length - drawn - max(waited, outside)


def _overlap(times: np.ndarray, start: float, end: float) -> float:
    return float((np.minimum(times[:, 1], end) - np.maximum(times[:, 0], start)).clip(0.0).sum())


class Gaps:
    """Times between ticks of a timer, by phase of the session."""

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing
        self.phase = "start"
        self.found: dict[str, list[Gap]] = {}
        self.withheld: list[np.ndarray] = []
        self._bystanders = Bystanders()
        self._last = (time.perf_counter(), seconds_waited(), Bystanders.here())
        self._timer = QTimer(interval=round(1000 * TICK), timerType=Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)
        self._timer.start()

    def _tick(self) -> None:
        now, waited, here = time.perf_counter(), seconds_waited(), Bystanders.here()
        before, waited_before, there = self._last
        calls, self.drawing.calls = self.drawing.calls, []
        gap = Gap(before, now, waited - waited_before, calls, (there, here))
        self.found.setdefault(self.phase, []).append(gap)
        self._last = (now, waited, here)

    def stop(self) -> None:
        """Stop the timer, and read when processors were withheld."""
        self._timer.stop()
        self.withheld = self._bystanders.withheld()

    def summary(self, phases: list[str] | None = None) -> dict[str, float]:
        """Return the statistics of all or some phases in ms; call `stop` before."""
        names = phases if phases is not None else list(self.found)
        gaps = np.array([gap.lengths(self.withheld) for name in names for gap in self.found[name]])
        raw = np.array([gap.lengths([])[1] for name in names for gap in self.found[name]])
        return {
            "largest": 1e3 * float(gaps[:, 0].max()),
            "p99": 1e3 * float(np.percentile(gaps[:, 0], 99)),
            "largest_less": 1e3 * float(gaps[:, 1].max()),
            "p99_less": 1e3 * float(np.percentile(gaps[:, 1], 99)),
            "largest_raw": 1e3 * float(raw.max()),
        }


class Player:
    """Player of a script in the event loop: each step is a delay (s) or a condition."""

    def __init__(self, script: Script, patience: float = 900.0) -> None:
        self._script = script
        self._patience = patience
        # The end of the application's own loop would close all windows.
        self._loop = QEventLoop()

    def play(self) -> None:
        self.fault: BaseException | None = None
        self._next()
        self._loop.exec()
        if self.fault is not None:
            raise self.fault

    def _next(self) -> None:
        try:
            step = next(self._script)
        except StopIteration:
            self._loop.quit()
        except BaseException as fault:  # noqa: BLE001  raised again by `play`
            self.fault = fault
            self._loop.quit()
        else:
            if callable(step):
                self._wait(step, time.perf_counter() + self._patience)
            else:
                QTimer.singleShot(round(1000 * step), self._next)

    def _wait(self, condition: Callable[[], bool], deadline: float) -> None:
        if condition():
            self._next()
        elif time.perf_counter() > deadline:
            self.fault = TimeoutError("the window did not get there")
            self._loop.quit()
        else:
            QTimer.singleShot(2, lambda: self._wait(condition, deadline))


def seconds_stolen() -> float:
    """Return the seconds for which the host withheld processors; 0 if Linux does not count."""
    try:
        first, *_ = Path("/proc/stat").read_text().splitlines()
    except OSError:
        return 0.0
    return int(first.split()[8]) / os.sysconf("SC_CLK_TCK")


def claim_memory(upload: int, count: int = 300) -> None:
    """Make `malloc` keep memory for `count` uploads of `upload` bytes.

    Unlike other drivers, the no-op driver allocates new memory for each upload and never frees it.
    The system would have to clear new memory, which takes 2 ms for a million values, and the host
    of a virtual machine would have to provide it first, which takes 16 µs per page. So blocks of
    this size are allocated, written to and freed, and the driver gets them from `malloc`. The
    highest block is not freed, because `malloc` would return the blocks below to the system.
    """
    library = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    library.malloc.argtypes = [ctypes.c_size_t]
    library.free.argtypes = [ctypes.c_void_p]
    library.free(library.malloc(upload))  # makes `malloc` take such blocks from the heap
    blocks = sorted(library.malloc(upload) for _ in range(count))
    for block in blocks:
        ctypes.memset(block, 1, upload)
    for block in blocks[:-1]:
        library.free(block)


def private_bytes() -> int:
    """Return the anonymous memory of this process (RssAnon) in bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return 1024 * int(line.split()[1])
    raise RuntimeError("this system does not say")


def formula_bytes(n_vertices: int, n_faces: int) -> int:
    """Return the bytes that a window should need for n vertices and m faces.

    These are the mesh in double precision with 64-bit indices (24 n + 24 m), normals (12 n), the
    drawn surface (12 n + 4 n, and 16 m for its faces), the order of faces for picking (4 m), tables
    and fields.
    """
    mesh = 24 * n_vertices + 24 * n_faces + 12 * n_vertices
    surface = 16 * n_vertices + 16 * n_faces
    return mesh + surface + 4 * n_faces + expected_bytes(n_vertices)

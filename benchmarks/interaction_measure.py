"""What `interaction_window.py` measures with: event loop, drawing, memory; and a player."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QEventLoop, Qt, QTimer

from meshmash_viewer.model.live import expected_bytes

TICK = 0.005
#: Gaps (s, less drawing) above which `--trace` tells what ran.
LONG = 0.02

Script = Iterator[float | Callable[[], bool]]


def seconds_waited() -> float:
    """Seconds that the main thread was ready and other programs had the processors."""
    schedule = Path(f"/proc/{os.getpid()}/schedstat")
    return int(schedule.read_text().split()[1]) * 1e-9 if schedule.exists() else 0.0


class Drawing:
    """Seconds spent inside VTK's own drawing calls."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.frames = 0

    def watch(self, window: Any) -> Any:
        for name in ("Render", "Frame", "WaitForCompletion"):
            setattr(window, name, self._timed(name, getattr(window, name)))
        return window

    def _timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started, waited = time.perf_counter(), seconds_waited()
            try:
                return call(*arguments)
            finally:
                # What it waited for a processor is taken off the gaps as it is.
                waited = seconds_waited() - waited
                self.seconds += time.perf_counter() - started - waited
                self.frames += name == "Render"

        return timed


class Gaps:
    """The time between ticks of a timer, by phase of the session."""

    def __init__(self, drawing: Drawing, trace: bool) -> None:
        self.drawing = drawing
        self.phase = "start"
        self.found: dict[str, list[tuple[float, float]]] = {}
        self._last = (time.perf_counter(), 0.0, seconds_waited())
        self._samples: list[tuple[float, str]] = []
        self._main = threading.get_ident()
        self._timer = QTimer(interval=round(1000 * TICK), timerType=Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        if trace:
            threading.Thread(target=self._sample, daemon=True).start()

    def _tick(self) -> None:
        now, drawn, waited = time.perf_counter(), self.drawing.seconds, seconds_waited()
        gap = now - self._last[0] - (waited - self._last[2])
        less = gap - (drawn - self._last[1])
        self.found.setdefault(self.phase, []).append((gap, less))
        if self._samples and less > LONG:
            inside = [text for at, text in self._samples if self._last[0] < at < now]
            print(f"--- {self.phase}: {1e3 * gap:.0f} ms, {1e3 * less:.0f} less drawing")
            for text in sorted(set(inside), key=inside.index):
                print(f"  {inside.count(text)} × {text}")
        self._samples.clear()
        self._last = (now, drawn, waited)

    def _sample(self) -> None:
        while True:
            time.sleep(0.002)
            frame, calls = sys._current_frames().get(self._main), []
            # Nothing in between may let the other thread run on: no files, no formatting.
            while frame is not None and len(calls) < 8:
                calls.append((frame.f_code, frame.f_lineno))
                frame = frame.f_back
            at = time.perf_counter()
            texts = [f"{Path(c.co_filename).name}:{line} {c.co_name}" for c, line in calls]
            self._samples.append((at, " < ".join(texts)))

    def summary(self, phases: list[str] | None = None) -> dict[str, float]:
        names = phases if phases is not None else list(self.found)
        gaps = np.array([gap for name in names for gap in self.found[name]]) * 1e3
        return {
            "largest": float(gaps[:, 0].max()),
            "p99": float(np.percentile(gaps[:, 0], 99)),
            "largest_less": float(gaps[:, 1].max()),
            "p99_less": float(np.percentile(gaps[:, 1], 99)),
        }


class Player:
    """Plays a script while the event loop runs: each step is a delay (s) or a condition."""

    def __init__(self, script: Script, patience: float = 900.0) -> None:
        self._script = script
        self._patience = patience
        # Not the application's own loop, whose end closes all windows.
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
        except BaseException as fault:  # noqa: BLE001  raised again where it is waited for
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


def private_bytes() -> int:
    """Memory of this process that no file backs."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return 1024 * int(line.split()[1])
    raise RuntimeError("this system does not say")


def trimmed_bytes() -> int:
    """The same after the C library has given back what it keeps for later."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    return private_bytes()


def formula_bytes(n_vertices: int, n_faces: int) -> int:
    """What a window should hold.

    The mesh in double precision with 64-bit indices (24 n + 24 m), its normals (12 n), the
    surface that is drawn (12 n + 4 n and, for its faces, 16 m), the search structure for picking
    (about 24 m), then tables and fields.
    """
    mesh = 24 * n_vertices + 24 * n_faces + 12 * n_vertices
    surface = 16 * n_vertices + 16 * n_faces
    return mesh + surface + 24 * n_faces + expected_bytes(n_vertices)

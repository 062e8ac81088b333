"""One window, driven by events and measured from inside; started by `interaction.py`."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from PySide6.QtCore import QEventLoop, QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QTabWidget, QWidget

import meshmash_viewer.app.picture as picture_module
from meshmash_viewer.app.canvas import Canvas
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.field import compute_field, request_of
from meshmash_viewer.model.jobs import ExportJob
from meshmash_viewer.model.live import expected_bytes
from meshmash_viewer.model.squares import sum_squares
from meshmash_viewer.weyl import Target

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


def _trimmed_bytes() -> int:
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


class Session:
    """The window and what is done with it."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.order = order
        self.folder = Path(order["result"]).parent
        self.drawing = Drawing()
        make = picture_module._new_window
        picture_module._new_window = lambda: self.drawing.watch(make())
        self.window = MainWindow(fresh=True)
        self.window.resize(1400, 900)
        self.window.show()
        self.drawing.watch(self.window.scene._canvas.window)
        self.document = self.window.document
        self.display = self.document.display
        self.source = self.window.field_source
        self.canvas = self.window.findChild(Canvas)
        self.gaps = Gaps(self.drawing, order["trace"])
        self.empty = private_bytes()
        self.result: dict[str, Any] = {}

    # -- parts of scripts -------------------------------------------------------------------

    def phase(self, name: str) -> None:
        self.gaps.phase = name
        if self.order["trace"]:
            print(f"{time.process_time():7.1f} s of processor time: {name}")

    def part(self, name: str) -> Any:
        return self.window.findChild(QWidget, name)

    def at_rest(self) -> bool:
        scene = self.window.scene
        return (
            self.source.idle
            and self.document.job is None
            and scene.can_pick
            and not scene._rest.isActive()
            and scene._pool.activeThreadCount() == 0
        )

    def wheel(self, widget: QWidget, notches: int, modifiers: Qt.KeyboardModifier) -> None:
        middle = QPointF(widget.rect().center())
        turn = QPoint(0, 120 * notches)
        event = QWheelEvent(
            middle, QPointF(widget.mapToGlobal(middle.toPoint())), QPoint(), turn,
            Qt.MouseButton.NoButton, modifiers, Qt.ScrollPhase.NoScrollPhase, False,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)

    def drag(self, widget: QWidget, way: list[QPoint], pause: float = 0.016) -> Script:
        left = Qt.MouseButton.LeftButton
        QTest.mousePress(widget, left, pos=way[0])
        yield pause
        for point in way[1:]:
            QTest.mouseMove(widget, point)
            yield pause
        QTest.mouseRelease(widget, left, pos=way[-1])
        yield pause

    def sweep(self, slider: QWidget, count: int) -> list[QPoint]:
        middle = 13
        ends = np.concatenate(
            [np.linspace(0.1, 0.9, count // 2), np.linspace(0.9, 0.3, count // 2)]
        )
        return [QPoint(round(share * slider.width()), middle) for share in ends]

    # -- scripts ------------------------------------------------------------------------------

    def open(self) -> Script:
        self.phase("empty")
        yield 1.0
        self.phase("open")
        self.window.open_mesh(self.order["mesh"])
        yield lambda: self.document.ready is not None and self.document.job is None
        self.phase("open, picking and stand-in")
        yield 0.5
        yield lambda: self.window.scene.can_pick
        if self.order["what"] == "session":
            yield self.at_rest

    def session(self) -> Script:
        none, control = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ControlModifier
        canvas, window, display = self.canvas, self.window, self.display
        yield from self.open()
        self.result["after_open"] = (private_bytes() - self.empty) / 1e6
        self.phase("scroll by wheel")
        for _ in range(200):
            self.wheel(canvas, -1, control)
            yield 0.016
        yield self.at_rest
        self.phase("hover")
        for turn in range(60):
            centre = canvas.rect().center()
            QTest.mouseMove(canvas, centre + QPoint(2 * turn - 60, turn - 30))
            yield 0.016
        self.phase("turn")
        yield from self.drag(canvas, [QPoint(300 + 4 * x, 250 + x) for x in range(60)])
        yield self.at_rest
        self.phase("zoom")
        for _ in range(20):
            self.wheel(canvas, 1, none)
            yield 0.016
        for _ in range(20):
            self.wheel(canvas, -1, none)
            yield 0.016
        yield self.at_rest
        self.phase("HKS, table being made")
        tabs = self.part("field_tabs")
        assert isinstance(tabs, QTabWidget) or hasattr(tabs, "setCurrentIndex")
        tabs.setCurrentIndex(1)
        yield 0.1
        slider = self.part("hks_time_slider")
        yield from self.drag(slider, self.sweep(slider, 60))
        yield self.at_rest
        self.phase("HKS")
        yield from self.drag(slider, self.sweep(slider, 120))
        yield self.at_rest
        self.phase("bands, table being made")
        tabs.setCurrentIndex(2)
        yield 0.1
        for band in range(8):
            display.band = band
            yield 0.03
        yield self.at_rest
        self.phase("bands")
        for band in range(32):
            display.band = band
            yield 0.016
        yield self.at_rest
        self.phase("pins")
        centre = canvas.rect().center()
        for shift in (QPoint(0, 0), QPoint(40, 30), QPoint(-50, 20)):
            QTest.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=centre + shift)
            yield 0.3
        if not self.document.pins:
            self.document.toggle_pin(self.document.mesh.n_vertices // 2)
        yield self.at_rest
        self.phase("similarity")
        window.commands.similar()
        yield 0.2
        yield self.at_rest
        for step in range(20):
            display.similarity_vertex = 1000 * step
            yield 0.03
        yield self.at_rest
        self.phase("nodal lines")
        tabs.setCurrentIndex(0)
        yield 0.2
        display.nodal_lines = True
        for _ in range(20):
            self.wheel(canvas, 1, control)
            yield 0.016
        yield 0.3
        yield self.at_rest
        display.nodal_lines = False
        self.phase("limits")
        from meshmash_viewer.model.limits import MinMaxLimits, PercentileLimits

        for policy in (MinMaxLimits(), PercentileLimits(), None):
            display.limits = policy
            yield 0.3
        self.phase("export of features")
        times = {"t_min": None, "t_max": None, "n_scales": 8}
        self.document.export(
            ExportJob(
                self.document.mesh, self.document.spectrum.operator or self.document.operator,
                self.folder / "hks.npz", "hks", len(self.document.spectrum), times,
            )
        )  # fmt: skip
        yield 0.1
        yield lambda: self.document.job is None
        self.phase("picture")
        yield from self.picture()
        self.phase("end")
        yield self.at_rest

    def picture(self) -> Script:
        from meshmash_viewer.app.picture_dialog import PictureDialog

        path = self.folder / "picture.png"
        dialog = PictureDialog((1920, 1080), path, self.window)
        self.window.commands._write_picture(dialog)
        yield path.exists
        dialog.deleteLater()

    def ticks(self) -> Script:
        """From a change of the display to the frame that shows it, one at a time."""
        display, count = self.display, 40
        pairs, vertices = self.order["pairs"], self.order["vertices"]
        kinds = {
            "step": (
                FieldKind.EIGENFUNCTION,
                lambda i: setattr(display, "index", (3 + 7 * i) % pairs),
            ),
            "hks": (FieldKind.HKS, lambda i: setattr(display, "time", self.time((i % 37) / 37))),
            "band": (FieldKind.BAND, lambda i: setattr(display, "band", i % 32)),
            "similarity": (
                FieldKind.SIMILARITY,
                lambda i: setattr(display, "similarity_vertex", 7919 * (i + 1) % vertices),
            ),
        }  # fmt: skip
        self.result["ticks"], self.result["tick_parts"] = {}, {}
        for name, (kind, change) in kinds.items():
            self.phase(f"tick {name}")
            if kind is FieldKind.SIMILARITY:
                display.similarity_vertex = 0
            display.kind = kind
            yield 0.5
            yield self.at_rest
            took, computing = [], []
            for i in range(count):
                field, loop, started = self.source.field, QEventLoop(), time.perf_counter()
                change(i)

                def drawn(field: Any = field, loop: QEventLoop = loop) -> None:
                    if self.source.field is not field:
                        loop.quit()

                # The window's own slot is connected before this one: the frame is done.
                self.canvas.frame_due.connect(drawn)
                QTimer.singleShot(5000, loop.quit)
                loop.exec()
                took.append(time.perf_counter() - started)
                self.canvas.frame_due.disconnect(drawn)
                request = request_of(self.document)
                started = time.perf_counter()
                answer = compute_field(request, self.source.live)
                answer.limits(display.limits)
                computing.append(time.perf_counter() - started)
                del answer, field
                yield 0.03
            self.result["ticks"][name] = 1e3 * median(took)
            self.result["tick_parts"][name] = 1e3 * median(computing)
            yield self.at_rest

    def time(self, share: float) -> float:
        from meshmash_viewer.model.ranges import hks_range

        low, high = hks_range(self.document.spectrum, self.display)
        return float(low * (high / low) ** share)

    def compressed(self) -> dict[str, float]:
        """The table of the heat kernel signature against the direct sum."""
        table, spectrum = self.source.live.heat_table, self.document.spectrum
        fast, slow, errors = [], [], []
        for share in (0.05, 0.3, 0.5, 0.7, 0.95):
            time_ = self.time(share)
            for _ in range(5):
                started = time.perf_counter()
                short = table.at(time_)
                fast.append(time.perf_counter() - started)
            decay = np.exp(-spectrum.eigenvalues * time_)[None]
            started = time.perf_counter()
            exact = sum_squares(spectrum.rows, decay, np.float64)[0]
            slow.append(time.perf_counter() - started)
            errors.append(np.nanmax(np.abs(short - exact)) / np.ptp(exact[np.isfinite(exact)]))
        return {
            "hks_table": 1e3 * median(fast),
            "hks_direct": 1e3 * median(slow),
            "hks_error": float(max(errors)),
        }

    def readd(self) -> float:
        """What a pyvista script does for the next eigenfunction, smooth as here (ms)."""
        import pyvista as pv

        mesh, spectrum = self.document.mesh, self.document.spectrum
        plotter = pv.Plotter(off_screen=True, window_size=(900, 600))
        surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
        took = []
        for index in range(1, 4):
            started = time.perf_counter()
            surface.point_data["field"] = spectrum.rows[index]
            plotter.add_mesh(surface, scalars="field", smooth_shading=True, name="mesh")
            plotter.render()
            took.append(time.perf_counter() - started)
        plotter.close()
        return 1e3 * median(took)

    def decompose(self) -> Script:
        yield from self.open()
        self.phase("decompose")
        self.document.target = Target("count", self.order["pairs"])
        self.document.compute()
        yield 0.1
        step = 0
        while self.document.job is not None:
            if self.document.spectrum is not None and len(self.document.spectrum) > 5:
                step += 1
                self.display.index = 1 + step % (len(self.document.spectrum) - 1)
            yield 0.05
        self.phase("end")
        yield self.at_rest

    def run(self) -> dict[str, Any]:
        if self.order["what"] == "decompose":
            Player(self.decompose()).play()
        else:
            Player(self.session()).play()
        self.result["driver"] = "no-op" if _is_noop(self.window) else "software"
        phases = [name for name in self.gaps.found if name != "start"]
        self.result["gaps"] = self.gaps.summary(phases)
        self.result["phases"] = {name: self.gaps.summary([name]) for name in phases}
        if self.order["what"] == "session":
            gc.collect()
            mesh = self.document.mesh
            self.result["private"] = (private_bytes() - self.empty) / 1e6
            self.result["tables"] = self.source.live.nbytes / 1e6
            self.result["trimmed"] = (_trimmed_bytes() - self.empty) / 1e6
            self.result["formula"] = formula_bytes(mesh.n_vertices, mesh.n_faces) / 1e6
            Player(self.ticks()).play()
            self.result["compressed"] = self.compressed()
            values, target = np.zeros(mesh.n_vertices, np.float32), self.source.field.values.copy()
            started = time.perf_counter()
            for _ in range(20):
                np.copyto(target, values)
            self.result["floor"] = 1e3 * (time.perf_counter() - started) / 20
            if self.result["driver"] == "no-op":
                self.result["readd"] = self.readd()
        self.window.close()
        return self.result


def _is_noop(window: MainWindow) -> bool:
    return "NOOP" in window.scene._canvas.window.ReportCapabilities()


def main() -> None:
    """Do what the argument says and leave the result where it says."""
    order = json.loads(sys.argv[1])
    application()
    session = Session(order)
    result = session.run()
    Path(order["result"]).write_text(json.dumps(result))


if __name__ == "__main__":
    main()

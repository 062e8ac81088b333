"""Window driven by events and measured in its own process; started by `interaction.py`."""

from __future__ import annotations

import gc
import json
import sys
import time
from collections.abc import Callable, Collection, Generator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from interaction_measure import (
    Drawing,
    Gaps,
    Player,
    Script,
    claim_memory,
    formula_bytes,
    private_bytes,
    seconds_stolen,
)
from PySide6.QtCore import QEventLoop, QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QListWidget, QWidget

import meshmash_viewer.app.view.figure  # noqa: F401  (imported behind the window by `run_app`)
import meshmash_viewer.app.view.picture as picture_module
from meshmash_viewer.app.controller import Controller
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application, collect_garbage_when_idle
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import Export
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import subscript

#: Largest number of rounds of ticks, and the share of a processor above which a round is repeated
#: because the host of a virtual machine has withheld it.
ROUNDS, STOLEN = 25, 0.01


class Awaited:
    """Observer of whether a render has shown another field since its construction."""

    def __init__(self, canvas: RenderWidget, source: Controller) -> None:
        self.canvas, self.shown = canvas, False
        self._source, self._field, self._drawn = source, source.field, False
        # The window's own slot is connected before this one: the frame is drawn, but not yet on
        # the screen.
        canvas.frame_due.connect(self._note)
        canvas.frameSwapped.connect(self._swapped)

    def _note(self) -> None:
        self._drawn = self._source.field is not self._field

    def _swapped(self) -> None:
        self.shown = self.shown or self._drawn

    def let_go(self) -> None:
        """Disconnect from the render."""
        self.canvas.frame_due.disconnect(self._note)
        self.canvas.frameSwapped.disconnect()


class Session:
    """The window, and the scripts that operate it."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.order = order
        self.folder = Path(order["result"]).parent
        self.drawing = Drawing()
        make = picture_module.new_window
        picture_module.new_window = lambda: self.drawing.watch(make())
        self.window = MainWindow(fresh=True)
        self.window.resize(1400, 900)
        self.window.show()
        collect_garbage_when_idle(self.window)
        self.drawing.watch(self.window.scene.plotter.ren_win)
        self.document = self.window.document
        self.display = self.document.display
        self.source = self.window.controller
        self.canvas = self.window.findChild(RenderWidget)
        #: Renders that a tick waits for, and the controllers that compute their fields.
        self.renders = [(self.canvas, self.source)]
        self.gaps = Gaps(self.drawing)
        self.empty = private_bytes()
        self.result: dict[str, Any] = {}
        self.moments: dict[str, float] = {}
        self.document.mesh_changed.connect(lambda: self.note("mesh"))
        self.document.spectrum_changed.connect(self.note_pairs)
        # the window's own slot is connected before this one: the frame is drawn
        self.canvas.frame_due.connect(self.note_frame)

    # -- times of events ----------------------------------------------------------------------

    def note(self, what: str) -> None:
        self.moments.setdefault(what, time.perf_counter())

    def note_pairs(self) -> None:
        spectrum = self.document.spectrum
        if spectrum is not None and len(spectrum) >= 20 and spectrum.is_exact(19):
            self.note("pairs_20")
        if spectrum is not None and spectrum.complete:
            self.note("pairs_all")

    def note_frame(self) -> None:
        scene, drawing = self.window.scene, self.window.scene.renderer
        # if drawing is slow, the mesh is not drawn before its stand-in is made
        drawn = drawing.surface and drawing.surface.actor.GetVisibility()
        seen = scene.renderer.shows_coarse or drawn
        if self.source.field is not None and scene.mesh is self.document.mesh and seen:
            self.note("field")
            family = self.source.field.request.family
            if isinstance(family, Eigenfunctions) and self.document.spectrum.is_exact(family.index):
                self.note("exact_field")

    def since_mesh(self, what: str) -> float | None:
        """Return the seconds from reading the mesh to an event."""
        return self.moments[what] - self.moments["mesh"] if what in self.moments else None

    # -- parts of scripts -------------------------------------------------------------------

    def phase(self, name: str) -> None:
        self.gaps.phase = name

    def part(self, name: str) -> Any:
        return self.window.findChild(QWidget, name)

    def at_rest(self) -> bool:
        scene = self.window.scene
        return (
            self.source.idle and self.document.work.job is None and scene.can_pick and scene.at_rest
        )

    def wheel(self, widget: QWidget, notches: int, modifiers: Qt.KeyboardModifier) -> None:
        middle = QPointF(widget.rect().center())
        turn = QPoint(0, 120 * notches)
        event = QWheelEvent(
            middle, QPointF(widget.mapToGlobal(middle.toPoint())), QPoint(), turn,
            Qt.MouseButton.NoButton, modifiers, Qt.ScrollPhase.NoScrollPhase, False,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)

    def wheel_fault(self, index: int) -> str:
        """Return what is wrong after scrolling to an eigenfunction, or ""."""
        window, rows = self.window, self.document.spectrum.shown_rows
        shown = window.scene.renderer.surface.values
        label = self.part("eigenvalue_label").text()
        if self.display[Eigenfunctions].index != index:
            return f"at {self.display[Eigenfunctions].index} instead of {index}"
        if not np.array_equal(shown, np.asarray(rows[index], dtype=np.float32)):
            return "another field is displayed"
        if not label.startswith(f"λ{subscript(index)} "):
            return f"the label says {label}"
        return "" if self.source.idle else "the queue is not idle"

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
        yield 0.5  # the first paint is measured by the part "start"
        if _is_noop(self.window):  # the no-op driver stands for a graphics card
            self.window.scene.frames.software = False
        self.phase("empty")
        yield 1.0
        self.phase("open")
        self.window.open_mesh(self.order["mesh"])
        yield lambda: self.document.ready is not None and self.document.work.job is None
        self.phase("open, picking and stand-in")
        yield 0.5
        yield lambda: self.window.scene.can_pick
        yield self.at_rest

    def session(self) -> Script:
        none, control = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ControlModifier
        canvas, display = self.canvas, self.display
        yield from self.open()
        self.result["after_open"] = (private_bytes() - self.empty) / 1e6
        self.phase("scroll by wheel")
        # the first function that is not constant on every component
        start = display[Eigenfunctions].index
        for _ in range(200):
            self.wheel(canvas, -1, control)
            yield 0.016
        yield self.at_rest
        yield 0.1
        reached = min(start + 200, self.order["pairs"] - 1)
        paced = self.wheel_fault(reached)
        self.phase("200 notches at once")
        for number in range(200):
            self.wheel(canvas, 1, control)
            if number % 20 == 19:
                yield 0.0  # the window is measured, not this loop
        yield self.at_rest
        yield 0.1
        self.result["wheel"] = paced or self.wheel_fault(max(reached - 200, 0)) or "ok"
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
        families = self.part("field_list")
        assert isinstance(families, QListWidget)
        families.setCurrentRow(1)
        yield 0.1
        slider = self.part("hks_time_slider")
        yield from self.drag(slider, self.sweep(slider, 60))
        yield self.at_rest
        self.phase("HKS")
        yield from self.drag(slider, self.sweep(slider, 120))
        yield self.at_rest
        self.phase("bands, table being made")
        families.setCurrentRow(2)
        yield 0.1
        for band in range(8):
            display.change(GeometryVectors, index=band)
            yield 0.03
        yield self.at_rest
        self.phase("bands")
        for band in range(32):
            display.change(GeometryVectors, index=band)
            yield 0.016
        yield self.at_rest
        self.phase("pins")
        centre = canvas.rect().center()
        for shift in (QPoint(0, 0), QPoint(40, 30), QPoint(-50, 20)):
            QTest.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=centre + shift)
            yield 0.3
        if not self.document.pins.placed:
            self.document.pins.toggle(self.document.mesh.n_vertices // 2)
        yield self.at_rest
        self.phase("similarity")
        self.document.similar()
        yield 0.2
        yield self.at_rest
        for step in range(20):
            display.change(Similarity, vertex=1000 * step)
            yield 0.03
        yield self.at_rest
        self.phase("nodal lines")
        families.setCurrentRow(0)
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
            display.set_limits(policy)
            yield 0.3
        self.phase("export of features")
        from meshmash_viewer.fields import EXPORTS

        spectrum, path = self.document.spectrum, self.folder / "hks.npz"
        operator, family = spectrum.operator or self.document.solve.operator, EXPORTS["hks"]
        export = Export(self.document.mesh, operator, path, family.exported(8), len(spectrum))
        self.document.work.write(path, export)
        yield 0.1
        yield lambda: self.document.work.job is None
        self.phase("picture")
        yield from self.picture()
        self.phase("end")
        yield self.at_rest

    def picture(self) -> Script:
        from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog

        pictures = self.window.commands.pictures
        dialog = FigureDialog(self.folder / "picture", pictures._seen, self.window, None)
        said: list[object] = []
        self.document.notices.shown.connect(said.append)
        yield 0.1  # a user takes longer to press Save
        self.window.commands.pictures._write_picture(dialog)
        # a notice: the picture is saved, or refused as empty if nothing is drawn
        yield lambda: bool(said)
        self.document.notices.shown.disconnect(said.append)
        dialog.deleteLater()

    def ticks(self, names: Collection[str] = ()) -> Script:
        """Measure ticks of each kind: from a change of the display to the frame that shows it."""
        display = self.display
        count = 40 if self.result["driver"] == "no-op" else 12
        pairs, vertices = self.order["pairs"], self.order["vertices"]
        kinds = {
            "step": (Eigenfunctions, "index", lambda i: (3 + i) % pairs),
            "leap": (Eigenfunctions, "index", lambda i: (3 + 107 * i) % pairs),
            "hks": (HeatKernelSignature, "time", lambda i: time_at(self.document, (i % 37) / 37)),
            "band": (GeometryVectors, "index", lambda i: (i + 1) % 32),
            "filter": (Filters, "values", self.heat_at),
            "filter_edges": (Filters, "values", self.edges_at),
            "similarity": (Similarity, "vertex", lambda i: 7919 * (i + 1) % vertices),
            "wks": (WaveKernelSignature, "index", lambda i: (i + 1) % 32),
            "diffusion": (
                Distances, "time", lambda i: time_at(self.document, (i % 37) / 37)
            ),
            "map_pairs": (OwnMaps, "pairs", lambda i: 20 + i),
            "map_filter": (Filters, "values", self.heat_at),
        }  # fmt: skip
        for key in ("ticks", "ticks_p95", "ticks_in_render", "ticks_thread", "ticks_rounds"):
            self.result[key] = {}
        for name, (family, parameter, value_of) in kinds.items():
            if names and name not in names:
                continue
            self.phase(f"tick {name}")
            if family is Similarity:
                display.change(Similarity, vertex=0)
            if family is Filters:
                text = READY["Band-pass"] if name == "filter_edges" else "exp(-t*x)"
                display.change(Filters, text=text, values=())
            if family is Distances:
                display.change(Distances, vertex=0, measure="diffusion")
            of_map = name.startswith("map")
            if of_map:
                display.change(OwnMaps, view="pairs" if family is OwnMaps else "filter")
            display.kind = OwnMaps.name if of_map else family.name
            yield 0.5
            yield self.at_rest
            rounds = []
            while len(rounds) < ROUNDS and all(stolen > STOLEN for stolen, _ in rounds):
                yield float(bool(rounds))
                rounds.append((yield from self.round_of_ticks(family, parameter, value_of, count)))
            _, frames = min(rounds, key=lambda one: one[0])
            took, rendering, working = 1e3 * np.array(frames).T
            self.result["ticks"][name] = median(took)
            self.result["ticks_p95"][name] = float(np.percentile(took, 95))
            self.result["ticks_in_render"][name] = median(rendering)
            self.result["ticks_thread"][name] = median(working)
            self.result["ticks_rounds"][name] = len(rounds)
            yield self.at_rest

    def pair(self) -> Script:
        """Open the mesh next to itself, and measure ticks of both renders."""
        window = self.window
        window.opening.open_second(Path(self.order["mesh"]))
        yield lambda: window.opening.second_view is not None
        beside = window.opening.second_view
        yield lambda: beside.idle and beside.pair.comparison is not None
        self.drawing.watch(beside.scene.plotter.ren_win)
        self.renders.append((beside.scene.plotter, beside.controller))
        yield from self.ticks(("step", "leap", "hks", "band", "wks", "filter"))

    def heat_at(self, i: int) -> tuple[tuple[str, float], ...]:
        return (("t", time_at(self.document, (i % 37) / 37)),)

    def edges_at(self, i: int) -> tuple[tuple[str, float], ...]:
        """Return the ends of a sharp band of a quarter of the spectrum."""
        assert self.document.spectrum is not None
        share = (i % 37) / 37
        last = float(self.document.spectrum.eigenvalues[-1])
        return ("a", 0.7 * share * last), ("b", (0.25 + 0.7 * share) * last)

    def round_of_ticks(
        self, family: type[Family], parameter: str, value_of: Callable[[int], float], count: int
    ) -> Generator[Any, None, tuple[float, list[tuple[float, float, float]]]]:
        """Return the share of a processor withheld by the host, and three times of each tick.

        The times are the seconds of the tick, the part in Render, and the processor time of the
        interface thread until the next tick.
        """
        claim_memory(4 * self.order["vertices"])
        frames = []
        stolen, begun = seconds_stolen(), time.perf_counter()
        for i in range(count):
            loop, drawn_before = QEventLoop(), self.drawing.seconds
            waits = [Awaited(*render) for render in self.renders]

            def shown(loop: QEventLoop = loop, waits: list[Awaited] = waits) -> None:
                nonlocal ended
                if all(each.shown for each in waits):
                    # not after the loop, which first handles the events that are waiting
                    ended = min(ended, time.perf_counter())
                    loop.quit()

            for each in waits:
                each.canvas.frameSwapped.connect(shown)
            value = value_of(i)
            QTimer.singleShot(5000, loop.quit)  # takes 0.5 ms, so before `started`
            started, worked = time.perf_counter(), time.thread_time()
            self.display.change(family, **{parameter: value})
            ended = started + 5.0
            loop.exec()
            took = ended - started
            rendering = self.drawing.seconds - drawn_before
            for each in waits:
                each.let_go()
            yield 0.03
            frames.append((took, rendering, time.thread_time() - worked))
        return (seconds_stolen() - stolen) / (time.perf_counter() - begun), frames

    def solve(self) -> Script:
        """Open a mesh without stored pairs, compute at once, and step through pairs meanwhile."""
        yield 0.5
        self.phase("empty")
        yield 1.0
        self.phase("open")
        self.window.open_mesh(self.order["mesh"])
        yield lambda: self.document.mesh is not None
        self.phase("preview and solve")
        self.document.solve.target = Target("count", self.order["pairs"])
        self.document.solve.compute()
        yield 0.1
        step = 0
        while self.document.work.job is not None:
            spectrum = self.document.spectrum
            # only after the first exact pairs have replaced the preview
            if spectrum is not None and "pairs_20" in self.moments:
                step += 1
                self.display.change(Eigenfunctions, index=1 + step % (len(spectrum) - 1))
            yield 0.05
        self.phase("end")
        yield self.at_rest

    def run(self) -> dict[str, Any]:
        what = self.order["what"]
        scripts = {
            "solve": self.solve,
            "session": self.session,
            "ticks": self.open,
            "pair": self.open,
        }
        Player(scripts[what]()).play()
        # not earlier: the query makes the context, for which the window must be on the screen
        self.result["driver"] = "no-op" if _is_noop(self.window) else "software"
        self.gaps.stop()
        phases = [name for name in self.gaps.found if name != "start"]
        self.result["gaps"] = self.gaps.summary(phases)
        self.result["phases"] = {name: self.gaps.summary([name]) for name in phases}
        self.result["moments"] = {name: self.since_mesh(name) for name in self.moments}
        if what == "session":
            self.measure_memory()
        if what == "pair":
            Player(self.pair()).play()
        if what == "ticks":
            Player(self.ticks()).play()
        self.window.close()
        return self.result

    def measure_memory(self) -> None:
        gc.collect()
        mesh = self.document.mesh
        self.result["private"] = (private_bytes() - self.empty) / 1e6
        contents = [table.content for table in self.source.live.tables.values()]
        parts = [
            part for each in contents for part in getattr(each, "__dict__", {"": each}).values()
        ]
        tables = sum(part.nbytes for part in parts if isinstance(part, np.ndarray))
        self.result["tables"] = tables / 1e6
        self.result["formula"] = formula_bytes(mesh.n_vertices, mesh.n_faces) / 1e6


def time_at(document: Document, share: float) -> float:
    """Return the diffusion time at a position of the slider, from 0 to 1."""
    low, high = document.display[HeatKernelSignature].range(document.spectrum)
    return float(low * (high / low) ** share)


def _is_noop(window: MainWindow) -> bool:
    return "NOOP" in window.scene.plotter.ren_win.ReportCapabilities()


def main() -> None:
    """Run the script named in the JSON argument, and write the result to its path."""
    order = json.loads(sys.argv[1])
    application()
    session = Session(order)
    result = session.run()
    Path(order["result"]).write_text(json.dumps(result))


if __name__ == "__main__":
    main()

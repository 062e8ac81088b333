"""Times of selecting on a large mesh: by a brush, a lasso, and a range of values.

    xvfb-run -a -s "-screen 0 1600x1000x24" python benchmarks/selection.py MESH.npz [COUNT]

Opens the window with Mesa's no-op driver, in which drawing costs nothing, and prints the median,
the 95th percentile and the largest of COUNT (200) times in milliseconds: of a move of the brush,
from the mouse event to the frame that shows the selection; of a lasso, from the release of the
button to that frame; and of a step of a handle of a range of values.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

os.environ["GALLIUM_NOOP"] = "1"

import numpy as np
from PySide6.QtCore import QEventLoop, QPoint, Qt, QTimer
from PySide6.QtTest import QTest

from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application

LEFT = Qt.MouseButton.LeftButton


def wait_for(condition: Callable[[], object], pause: float = 0.02) -> None:
    """Process events until a condition holds."""
    while not condition():
        rest(pause)


def rest(seconds: float) -> None:
    """Process events for a while."""
    loop = QEventLoop()
    QTimer.singleShot(round(1e3 * seconds), loop.quit)
    loop.exec()


class Hand:
    """The mouse over the render of a window."""

    def __init__(self, window: MainWindow) -> None:
        self.window, self.canvas, self.tool = window, window.scene.plotter, window.select_tool

    def timed(self, act: Callable[[], None]) -> float:
        """Return the milliseconds from a call to the frame that shows another selection."""
        loop, before = QEventLoop(), self.window.document.selection.mask
        drawn = False

        def due() -> None:
            nonlocal drawn
            drawn = self.window.document.selection.mask is not before

        def swapped() -> None:
            if drawn:
                loop.quit()

        self.canvas.frame_due.connect(due)
        self.canvas.frameSwapped.connect(swapped)
        QTimer.singleShot(1000, loop.quit)
        began = time.perf_counter()
        act()
        loop.exec()
        took = time.perf_counter() - began
        self.canvas.frame_due.disconnect(due)
        self.canvas.frameSwapped.disconnect(swapped)
        rest(0.02)
        return 1e3 * took

    def way(self, count: int) -> Iterator[QPoint]:
        """Yield positions of a pointer that moves over the mesh in steps of 8 pixels."""
        rng, at = np.random.default_rng(0), self.canvas.rect().center()
        size = np.array([self.canvas.width(), self.canvas.height()])
        while not self.hits(at):
            at = QPoint(*(int(each) for each in rng.uniform(0.1, 0.9, 2) * size))
        heading = 0.0
        for _ in range(count):
            for turn in (0.3, 1.0, 2.0, np.pi):
                angle = heading + turn * rng.uniform(-1.0, 1.0)
                to = at + QPoint(round(8.0 * np.cos(angle)), round(8.0 * np.sin(angle)))
                if self.hits(to):
                    at, heading = to, angle
                    break
            yield at

    def hits(self, at: QPoint) -> bool:
        """Return whether there is a vertex at a position."""
        return self.canvas.rect().contains(at) and self.window.scene.vertex_at(at.x(), at.y()) >= 0

    def brush(self, count: int) -> list[float]:
        """Return the times of moves of the brush that select further vertices."""
        self.tool.select_with("brush")
        wait_for(lambda: self.tool.prepared)
        places = list(self.way(count + 1))
        QTest.mousePress(self.canvas, LEFT, pos=places[0])
        rest(0.2)
        took, selection = [], self.window.document.selection
        for place in places[1:]:
            before = selection.mask
            time_of = self.timed(lambda place=place: QTest.mouseMove(self.canvas, place))
            if selection.mask is not before:
                took.append(time_of)
        QTest.mouseRelease(self.canvas, LEFT, pos=places[-1])
        return took

    def lasso(self, count: int) -> list[float]:
        """Return the times from the end of a lasso to its selection."""
        self.tool.select_with("lasso")
        took = []
        for turn in range(count):
            middle = next(self.way(1))
            radius = (0.1 + 0.3 * turn / count) * self.canvas.height()
            angles = np.linspace(0.0, 6.2, 40)
            places = [
                middle + QPoint(round(radius * np.cos(a)), round(radius * np.sin(a)))
                for a in angles
            ]
            QTest.mousePress(self.canvas, LEFT, pos=places[0])
            for place in places[1:]:
                QTest.mouseMove(self.canvas, place)
            release = partial(QTest.mouseRelease, self.canvas, LEFT, pos=places[-1])
            took.append(self.timed(release))
            wait_for(lambda: is_idle(self.tool))
        return took

    def values(self, count: int) -> list[float]:
        """Return the times from a new range of values to its selection."""
        self.tool.select_with("value")
        wait_for(lambda: self.tool.field is not None)
        low, high = np.nanpercentile(self.tool.field.values, [2.0, 98.0])
        ends = np.linspace(low, high, count + 1)[1:]
        return [self.timed(lambda end=end: self.tool.set_range(low, end)) for end in ends]


def main() -> None:
    """Print the table."""
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 200
    application()
    window = MainWindow(fresh=True)
    window.resize(1400, 900)
    window.show()
    rest(0.5)
    window.scene.frames.software = False  # the driver stands for a graphics card
    window.open_mesh(Path(sys.argv[1]))
    document = window.document
    wait_for(lambda: document.ready is not None and document.work.job is None)
    wait_for(lambda: window.scene.can_pick and window.scene.at_rest and window.controller.idle)
    print(f"{document.mesh.n_vertices:,} vertices; ms: median, 95 %, largest, number")
    hand = Hand(window)
    for name, times in (
        ("brush, one move", hand.brush(count)),
        ("lasso", hand.lasso(max(count // 5, 10))),
        ("range of values", hand.values(count)),
    ):
        figures = np.percentile(times, [50, 95, 100])
        print(f"{name:18s}" + "".join(f"{each:8.1f}" for each in figures) + f"{len(times):6d}")
    window.close()


if __name__ == "__main__":
    main()

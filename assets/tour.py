"""Tour of the real window that saves a picture of each stop.

    python assets/tour.py DIR [MESH] [--stops N]

Needs a display; ``./dev shots DIR`` uses a virtual display. MESH is the sample dendrite by default.
Settings and stored eigenpairs are temporary; those of the user are neither read nor changed.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from make_samples import ORIGIN
from PySide6.QtCore import QEventLoop, QPoint, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog
from trimesh.creation import icosphere
from trimesh.remesh import subdivide

from meshmash_viewer.app import theme
from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.model.display import Shape
from meshmash_viewer.samples import sample_path

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 600.0


def pause(milliseconds: int) -> None:
    """Process events for a while; unlike `QTest.qWait`, release Python's lock for threads."""
    loop = QEventLoop()
    QTimer.singleShot(milliseconds, loop.quit)
    loop.exec()


class LastStop(Exception):
    """Raised after the last requested picture."""


class Tour:
    """The window, and the folder of its pictures."""

    def __init__(self, folder: Path, stops: int | None = None) -> None:
        self.folder = folder
        self.number, self.stops = 0, stops
        self.window = MainWindow(fresh=True)
        self.document = self.window.document
        self.display = self.window.document.display

    # -- walking ------------------------------------------------------------------------------

    def wait(self, condition: Callable[[], bool]) -> None:
        """Process events until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError("the window did not get there")
            pause(10)

    def settle(self) -> None:
        """Wait until the window is up to date, including nodal lines and profiles."""
        pause(250)
        if self.document.spectrum is not None:
            self.wait(lambda: self.window.controller.idle)
        self.wait(lambda: self.window.scene.at_rest)
        self.wait(lambda: is_idle(self.window))
        pause(700)

    def resize(self, width: int, height: int) -> None:
        """Resize the window, twice, because its panels may have to shrink first."""
        for _ in range(2):
            self.window.resize(width, height)
            pause(150)

    def shoot(self, name: str) -> None:
        """Save a picture of the window on the screen, including dialogs over it."""
        catch_up()
        pause(60)
        window = self.window
        window.repaint()  # a busy machine may not have painted it yet
        self.number += 1
        place = window.mapToGlobal(QPoint(0, 0))
        picture = window.screen().grabWindow(
            0, place.x(), place.y(), window.width(), window.height()
        )
        path = self.folder / f"{self.number:02d}-{name}.png"
        if not picture.save(str(path)):
            raise OSError(f"{path} could not be written")
        print(path)
        if self.number == self.stops:
            raise LastStop

    def open(self, path: Path, unit: str = "") -> None:
        """Open a mesh and wait until it is drawn."""
        document = self.document
        self.window.open_mesh(path, unit)
        self.wait(lambda: document.path == path and document.work.job is None)
        self.wait(lambda: self.window.scene.can_pick)
        self.settle()

    def ask_for(self, count: int) -> None:
        """Type a number of eigenpairs and press Compute."""
        spin = self.window.mesh_panel.target_box.count_spin
        spin.setFocus()
        spin.selectAll()
        QTest.keyClicks(spin, str(count))
        QTest.mouseClick(self.window.mesh_panel.compute_button, LEFT)
        self.window.setFocus()

    def dialog(self, command: str, name: str, picture: str) -> None:
        """Open a dialog, take a picture, and close it again."""
        window = self.window
        window.actions_[command].trigger()
        self.wait(lambda: window.findChild(QDialog, name) is not None)
        dialog = window.findChild(QDialog, name)
        pause(200)
        centre = window.mapToGlobal(window.rect().center())
        dialog.move(centre - dialog.rect().center())
        self.settle()
        self.shoot(picture)
        dialog.reject()
        dialog.deleteLater()
        self.settle()

    def vertices_in_sight(self, count: int) -> list[int]:
        """Return some visible vertices, far from one another."""
        scene, vertices = self.window.scene, self.document.mesh.vertices
        seen = []
        for down in np.linspace(0.1, 0.9, 24):
            for across in np.linspace(0.1, 0.85, 32):
                vertex = scene.vertex_at(across * scene.width(), down * scene.height())
                if vertex >= 0:
                    seen.append(vertex)
        chosen = [seen[len(seen) // 2]]
        while len(chosen) < count:
            gaps = [np.linalg.norm(vertices[chosen] - vertices[v], axis=1).min() for v in seen]
            chosen.append(seen[int(np.argmax(gaps))])
        return chosen

    # -- the stops ----------------------------------------------------------------------------

    def go(self, mesh: Path) -> None:
        """Take all pictures."""
        window, document, display = self.window, self.document, self.display
        theme.set_mode(theme.Mode.LIGHT)
        window.move(0, 0)
        self.resize(1440, 900)
        window.show()
        window.activateWindow()
        self.settle()
        self.shoot("empty")

        self.open(mesh)
        self.shoot("mesh")

        constants = document.ready.health.n_components  # the first pairs are constants
        self.ask_for(2000)
        self.wait(
            lambda: document.spectrum is not None and len(document.spectrum) >= constants + 12
        )
        display.change(Eigenfunctions, index=constants + 5)
        self.settle()
        self.shoot("computing")
        document.work.cancel()
        self.wait(lambda: document.work.job is None)
        self.settle()
        self.shoot("stopped")

        self.ask_for(200)
        self.wait(lambda: document.work.job is None and document.spectrum.complete)
        window.stage.message_bar.dismiss()
        display.change(Eigenfunctions, index=constants + 7)
        display.nodal_lines = True
        self.settle()
        self.shoot("eigenfunction")

        display.kind = "hks"
        self.settle()
        self.shoot("hks")
        display.kind = "band"
        display.change(GeometryVectors, index=9)
        self.settle()
        self.shoot("bands")

        display.kind = "hks"
        for vertex in self.vertices_in_sight(4):
            place = window.scene.display_point(vertex)
            child = window.scene.childAt(place) or window.scene
            QTest.mouseClick(child, LEFT, pos=child.mapFrom(window.scene, place))
        self.settle()
        self.shoot("pins-and-profiles")
        window.actions_["similar"].trigger()
        self.settle()
        self.shoot("similar")

        self.go_through_instruments(mesh)
        display.kind = "hks"
        self.settle()
        self.dialog("export", "export_dialog", "export")
        self.dialog("save_picture", "figure_dialog", "picture")
        self.dialog("help", "help_dialog", "help")

        broken = self.folder / "truncated.ply"
        broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n")
        window.open_mesh(broken)
        self.wait(window.stage.message_bar.isVisible)
        broken.unlink()
        self.settle()
        self.shoot("error")
        window.stage.message_bar.dismiss()

        theme.set_mode(theme.Mode.DARK)
        display.kind = "eigenfunction"
        display.change(Eigenfunctions, index=constants + 16)
        self.settle()
        self.shoot("dark-eigenfunction")
        display.kind = "hks"
        self.settle()
        self.shoot("dark-hks")
        self.dialog("export", "export_dialog", "dark-export")
        self.resize(1100, 700)
        self.settle()
        self.shoot("dark-small")
        theme.set_mode(theme.Mode.LIGHT)
        display.kind = "band"
        self.settle()
        self.shoot("small")
        available = window.screen().availableGeometry()
        self.resize(available.width(), available.height())
        display.kind = "eigenfunction"
        self.settle()
        self.shoot("large")

        self.resize(1440, 900)
        self.open(sample_path("two_components"))
        self.ask_for(30)
        self.wait(lambda: document.work.job is None and document.spectrum is not None)
        display.change(Eigenfunctions, index=3)
        self.settle()
        self.shoot("faults")
        theme.set_mode(theme.Mode.DARK)
        self.settle()
        self.shoot("dark-faults")
        theme.set_mode(theme.Mode.LIGHT)
        self.go_to_the_soma()
        self.go_first_sessions()
        self.go_large(mesh)
        window.close()

    def go_through_instruments(self, mesh: Path) -> None:
        """Take pictures of curvature, distances, a filter, the shape from few pairs, two meshes."""
        window, document, display = self.window, self.document, self.display
        display.nodal_lines = False
        display.kind = "map"
        self.settle()
        self.shoot("curvature")
        display.nodal_lines = True
        display.show(Distances(vertex=document.pins.placed[0].vertex))
        self.settle()
        self.shoot("distance")
        display.nodal_lines = False
        display.kind = "filter"
        self.settle()
        self.shoot("filter")

        docks = window.arrangement.docks
        display.kind = "map"
        docks["shape"].raise_()
        display.shape = Shape(shown=True, pairs=150)
        self.wait(lambda: window.shape_source.idle)
        self.settle()
        self.shoot("shape")
        display.shape = Shape()
        self.wait(lambda: window.shape_source.idle)

        display.kind = "eigenfunction"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bent.npz"
            bend(mesh, path)
            window.opening.open_second(path, unit="nm")
            display.nodal_lines = True
            second = window.opening.second_view
            assert second is not None
            self.wait(lambda: second.idle)
            self.settle()
            self.shoot("compare")
            window.opening.end_comparison()
            display.nodal_lines = False
        docks["mesh"].raise_()
        self.settle()

    def go_to_the_soma(self) -> None:
        """Take pictures of the curvature of a neuron, and of distances from its soma."""
        document, display = self.document, self.display
        self.open(sample_path("neuron"))
        self.ask_for(200)
        self.wait(lambda: document.work.job is None and document.spectrum is not None)
        display.kind = "map"
        self.settle()
        self.shoot("soma-curvature")
        from_soma = document.mesh.vertices - ORIGIN
        near = np.linalg.norm(from_soma[:, :2], axis=1) < 1000.0
        document.pins.toggle(int(np.argmax(np.where(near, from_soma[:, 2], -np.inf))))
        display.nodal_lines = True
        display.show(Distances(vertex=document.pins.placed[0].vertex))
        self.settle()
        self.shoot("soma-distance")
        theme.set_mode(theme.Mode.DARK)
        self.settle()
        self.shoot("dark-soma-distance")
        theme.set_mode(theme.Mode.LIGHT)
        display.nodal_lines = False

    def go_first_sessions(self) -> None:
        """Take pictures for the pages on first sessions, of surfaces given by formulas."""
        document, display = self.document, self.display
        with tempfile.TemporaryDirectory(prefix="meshes-") as folder:
            sphere, folded = Path(folder) / "ball.ply", Path(folder) / "folded.npz"
            faults = Path(shutil.copy(sample_path("two_components"), folder))
            ball = icosphere(5)
            ball.export(sphere)
            self.open(sphere)
            self.ask_for(50)
            self.wait(lambda: document.work.job is None and document.spectrum is not None)
            display.change(Eigenfunctions, index=7)
            display.nodal_lines = True
            self.settle()
            self.shoot("first-session-ball")
            display.nodal_lines = False

            self.open(faults)
            self.shoot("first-session-faults")

            x, y, z = ball.vertices.T
            folds = np.sin(9.0 * x + 2.0 * y) * np.sin(8.0 * y - 3.0 * z) * np.cos(7.0 * z)
            np.savez(
                folded,
                vertices=ball.vertices * ((50.0 + 6.0 * folds) * (1.0 + 0.3 * y**2))[:, None],
                faces=ball.faces,
            )
            self.open(folded, "mm")
            self.ask_for(150)
            self.wait(lambda: document.work.job is None and document.spectrum is not None)
            display.kind = "band"
            display.change(GeometryVectors, index=6)
            self.settle()
            self.shoot("first-session-folded")

    def go_large(self, mesh: Path) -> None:
        """Take pictures of a large mesh: preview, its replacement, and the stand-in."""
        document, display = self.document, self.display
        window, canvas = self.window, self.window.findChild(RenderWidget)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{mesh.name.split('.')[0]}_large.npz"
            refine(mesh, path)
            window.open_mesh(path, "nm")
            self.wait(lambda: document.path == path and document.spectrum is not None)
            constants = document.ready.health.n_components
            display.change(Eigenfunctions, index=constants + 4)
            self.settle()
            self.shoot("preview")

            # the same function as a preview, then exact
            before, limits = self.shown()
            self.ask_for(constants + 20)
            self.wait(lambda: document.spectrum.is_exact(display[Eigenfunctions].index))
            self.wait(lambda: document.work.job is None)
            window.stage.message_bar.dismiss()
            self.settle()
            self.shoot("preview-replaced")
            after, new_limits = self.shown()
            alike = float(np.corrcoef(before, after)[0, 1])
            print(
                f"hand-over: correlation {alike:.4f}, limits ±{limits:.3g}, then ±{new_limits:.3g}"
            )

            self.wait(lambda: window.scene.can_pick)
            middle = canvas.rect().center()
            QTest.mousePress(canvas, LEFT, pos=middle)
            for step in range(1, 9):
                QTest.mouseMove(canvas, middle + QPoint(6 * step, 2 * step))
                pause(40)
            print(f"stand-in while it is turned: {window.scene.renderer.shows_coarse}")
            self.shoot("turning")
            QTest.mouseRelease(canvas, LEFT, pos=middle + QPoint(48, 16))
            self.settle()
            self.shoot("turned")

    def shown(self) -> tuple[np.ndarray, float]:
        """Return the values on the render, and the upper end of the colour scale."""
        field = self.window.controller.field
        return field.values[np.isfinite(field.values)], field.limits(self.display.limits)[1]


def bend(mesh: Path, path: Path) -> None:
    """Write a mesh in another pose: bent by a thirtieth of a circle."""
    read = read_mesh(mesh)
    low, high = read.bounds
    long = int(np.argmax(high - low))
    side = (long + 1) % 3
    radius = 30.0 * (high[long] - low[long]) / (2.0 * np.pi)
    vertices = read.vertices.copy()
    angle = (vertices[:, long] - low[long]) / radius
    reach = radius + vertices[:, side] - low[side]
    vertices[:, long], vertices[:, side] = reach * np.sin(angle), reach * np.cos(angle)
    np.savez(path, vertices=vertices, faces=read.faces)


def refine(mesh: Path, path: Path) -> None:
    """Write a large mesh, with every face of a mesh split in four."""
    read = read_mesh(mesh)
    vertices, faces = subdivide(read.vertices, read.faces)
    np.savez(path, vertices=vertices, faces=faces)


def main() -> int:
    """Read the command line and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("mesh", type=Path, nargs="?", default=None, help="instead of the sample")
    parser.add_argument("--stops", type=int, help="end after so many pictures")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="meshmash-viewer-tour-") as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        application()
        tour = Tour(options.folder, options.stops)
        try:
            with contextlib.suppress(LastStop):
                tour.go(options.mesh or sample_path())
        finally:
            tour.window.close()
            QApplication.processEvents()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

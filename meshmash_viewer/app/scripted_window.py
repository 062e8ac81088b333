"""Methods of a window for scripts and consoles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QDeadlineTimer, QThread
from PySide6.QtWidgets import QApplication, QMainWindow

from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.pins import pin_table
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.background import BackgroundIO
    from meshmash_viewer.app.commands import Commands
    from meshmash_viewer.app.controller import Controller
    from meshmash_viewer.app.opening import Opening
    from meshmash_viewer.app.shape_source import ShapeSource
    from meshmash_viewer.app.view.mesh_view import MeshView
    from meshmash_viewer.app.view.render_widget import RenderWidget
    from meshmash_viewer.model.document import Document


class ScriptedWindow(QMainWindow):
    """Base class of `MainWindow` with the methods for scripts."""

    document: Document
    scene: MeshView
    commands: Commands
    controller: Controller
    shape_source: ShapeSource
    background_io: BackgroundIO
    opening: Opening

    @property
    def plotter(self) -> RenderWidget:
        """The render as a `pyvista.Plotter` in mesh coordinates, to which actors can be added."""
        return self.scene.plotter

    def to_pyvista(self) -> Any:
        """Return the mesh with the displayed field, see `app.view.picture.displayed_surface`."""
        from meshmash_viewer.app.view.picture import displayed_surface

        return displayed_surface(self.scene.renderer)

    def add_map(self, name: str, values: npt.ArrayLike, unit: str = "") -> None:
        """Add values per vertex to the mesh as a map, and display it.

        Parameters
        ----------
        name : str
        values : array_like, shape (n,)
            Values per vertex of the mesh, or per vertex of its file.
        unit : str
            Unit of the values; "" for none.

        Raises
        ------
        InputError
            If there is no mesh, or the number of values is not the number of vertices.
        """
        mesh = self.document.mesh
        if mesh is None:
            raise InputError("no-mesh", "There is no mesh to put a map on", "open the mesh first")
        self.document.maps.add(mesh, [VertexMap(name, np.asarray(values), unit=unit)])

    def add_pins(
        self, at: npt.ArrayLike, names: Sequence[str] = (), colors: Sequence[str] = ()
    ) -> None:
        """Pin vertices of the mesh; existing pins are given the names and colours.

        Parameters
        ----------
        at : array_like
            Indices of vertices in the mesh file, shape (m,), or positions, shape (m, 3), in the
            unit of the mesh or in its voxels. The vertex nearest to each position is pinned.
        names : sequence of str
            Name of each pin, "" for none.
        colors : sequence of str
            Colour of each pin, "#RRGGBB", or "" for a default colour.

        Raises
        ------
        InputError
            If a vertex does not exist, a position is far from the mesh, or the lengths differ.
            Nothing is pinned then.
        """
        self.commands.pins.add(pin_table(at, names, colors))

    def wait(self, seconds: float = 3600.0) -> None:
        """Handle events until nothing is being read or computed and the requested field is shown.

        Parameters
        ----------
        seconds : float
            Time limit.

        Raises
        ------
        TimeoutError
            If the window is still busy after the time limit.
        """
        deadline = QDeadlineTimer(round(1000.0 * seconds))
        while not (
            self.document.work.job is None
            and is_idle(self)
            and self.controller.idle
            and self.shape_source.idle
            and (self.opening.second_view is None or self.opening.second_view.idle)
        ):
            if deadline.hasExpired():
                raise TimeoutError(f"The window is still busy after {seconds:g} s.")
            QApplication.processEvents()
            QThread.msleep(5)
        QApplication.processEvents()

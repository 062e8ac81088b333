"""What scripts and consoles call of a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QDeadlineTimer, QThread
from PySide6.QtWidgets import QApplication, QMainWindow

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.pins import pin_table
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.background import BackgroundIO
    from meshmash_viewer.app.commands import Commands
    from meshmash_viewer.app.controller import Controller
    from meshmash_viewer.app.opening import Opening
    from meshmash_viewer.app.point_tool import PointTool
    from meshmash_viewer.app.shape_source import ShapeSource
    from meshmash_viewer.app.view.mesh_view import MeshView
    from meshmash_viewer.app.view.render_widget import RenderWidget
    from meshmash_viewer.model.document import Document


class ScriptedWindow(QMainWindow):
    """The methods of `MainWindow` for scripts, which `view` returns."""

    document: Document
    scene: MeshView
    commands: Commands
    controller: Controller
    shape_source: ShapeSource
    background_io: BackgroundIO
    opening: Opening
    point_tool: PointTool

    @property
    def plotter(self) -> RenderWidget:
        """The render as a `pyvista.Plotter`, in mesh coordinates: what is added to it stays."""
        return self.scene.plotter

    def to_pyvista(self) -> Any:
        """The mesh with the displayed field (`app.view.picture.displayed_surface`)."""
        from meshmash_viewer.app.view.picture import displayed_surface

        return displayed_surface(self.scene.renderer)

    def add_map(self, name: str, values: npt.ArrayLike, unit: str = "") -> None:
        """Add values per vertex to the mesh, and show them.

        Parameters
        ----------
        name : str
        values : array_like, shape (n,)
            One for each vertex, or for each of the file.
        unit : str
            Unit of the values; "" for none.

        Raises
        ------
        InputError
            If there is no mesh, or another number of values.
        """
        mesh = self.document.mesh
        if mesh is None:
            raise InputError("There is no mesh to put a map on: open the mesh first.")
        self.document.maps.add(mesh, [VertexMap(name, np.asarray(values), unit=unit)])

    def add_pins(
        self, at: npt.ArrayLike, names: Sequence[str] = (), colors: Sequence[str] = ()
    ) -> None:
        """Pin vertices of the mesh; those that are pinned get the names and colours.

        Parameters
        ----------
        at : array_like
            Indices in the mesh file, shape (m,), or positions in the mesh's unit or in its voxels,
            shape (m, 3), of which the nearest vertices are pinned.
        names : sequence of str
            A name for each, "" for none.
        colors : sequence of str
            A colour for each, "#RRGGBB" or "".

        Raises
        ------
        InputError
            If a vertex does not exist, a position is far from the mesh, or numbers differ; nothing
            is pinned then.
        """
        self.commands.pins.add(pin_table(at, names, colors))

    def wait(self, seconds: float = 3600.0) -> None:
        """Handle events until nothing is being read or computed and the wanted field is shown.

        Parameters
        ----------
        seconds : float
            For how long at most.

        Raises
        ------
        TimeoutError
            If something is still being computed then.
        """
        deadline = QDeadlineTimer(round(1000.0 * seconds))
        while not (
            self.document.work.job is None
            and self.background_io.idle
            and self.controller.idle
            and self.shape_source.idle
            and self.point_tool.idle
            and (self.opening.second_view is None or self.opening.second_view.idle)
        ):
            if deadline.hasExpired():
                raise TimeoutError(f"The window is still busy after {seconds:g} s.")
            QApplication.processEvents()
            QThread.msleep(5)
        QApplication.processEvents()

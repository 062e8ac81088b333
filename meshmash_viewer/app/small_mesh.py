"""A mesh of few vertices in the place of a large one, where that makes no difference."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QThreadPool, Signal

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.clustering import cluster_vertices

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.mesh_view import MeshView

__all__ = ["SmallMesh"]

#: From so many vertices on a mesh is large, and about how many the small one has: those of a
#: thumbnail are hardly a pixel apart, and a processor draws them in a few hundredths of a second.
_LARGE, _SMALL = 40_000, 15_000


class SmallMesh(QObject):
    """Made in a thread, once.

    Signals
    -------
    ready()
        It is there.
    """

    ready = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._asked = False
        self._made: tuple[Mesh, npt.NDArray[np.int64]] | None = None

    def of(self, mesh: Mesh | None) -> bool:
        """Whether it is there, or not needed; otherwise `ready` will say so."""
        if mesh is None or mesh.n_vertices <= _LARGE or self._made is not None:
            return True
        if not self._asked:
            self._asked = True
            self._pool.start(lambda: self._make(mesh))
        return False

    def drawing(self, scene: MeshView) -> tuple[MeshRenderer, npt.NDArray[np.int64] | None]:
        """What is on the render without its field, and the vertices that are left; None for all."""
        from meshmash_viewer.app.view.mesh_renderer import MeshRenderer

        if self._made is None:
            return scene.twin(), None
        (mesh, picked), shown = self._made, scene.renderer
        drawing = MeshRenderer(shown.dark)
        drawing.set_mesh(mesh, None if shown.normals is None else shown.normals[picked])
        drawing.view = shown.view
        return drawing, picked

    def _make(self, mesh: Mesh) -> None:
        from meshmash_viewer.app.view.geometry import geometry_of

        made = cluster_vertices(mesh.vertices, mesh.faces, _SMALL)
        small = Mesh(mesh.vertices[made.representatives], made.faces, unit=mesh.unit)
        geometry_of(small)
        self._made = small, made.representatives
        self.ready.emit()

    def close(self) -> None:
        """Wait until it is made."""
        self._pool.waitForDone()

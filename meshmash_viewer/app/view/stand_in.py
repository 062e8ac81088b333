"""What is drawn of a mesh whose frames are slow, while something moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.clustering import CoarseMesh, cluster_vertices, scatter

__all__ = ["StandIn"]

#: A frame that takes longer than this (s) is slow.
SLOW_FRAME = 0.045
#: One that takes longer than this is not made slower by smoothing its edges well.
VERY_SLOW_FRAME = 0.3
#: So many frames of a mesh are measured, after a first one that tells nothing.
MEASURED_FRAMES = 4
#: About how many vertices the stand-in has; it takes a mesh of twice as many to be worth one.
COARSE_VERTICES = 40_000
#: How many dots are drawn until it is there, and how wide they are in points.
DOTS, DOT_SIZE = 36_000, 6.0


class StandIn:
    """Learns how slow frames are, and puts a coarse mesh into the drawing where that helps.

    Parameters
    ----------
    drawing : MeshRenderer
    """

    def __init__(self, drawing: MeshRenderer) -> None:
        self._drawing = drawing
        #: Whether OpenGL runs on the processor, as far as is known.
        self.software = False
        self.forget()

    def forget(self) -> None:
        """Start anew with another mesh."""
        self._seconds: float | None = None
        self._frames = 0
        #: Whether the coarse mesh has been asked for, and whether it has not come yet.
        self.asked = self.awaited = False

    @property
    def slow(self) -> bool:
        """Whether frames of the full mesh are."""
        return self._seconds is not None and self._seconds > SLOW_FRAME

    @property
    def very_slow(self) -> bool:
        """Whether nothing may be added to frames of the full mesh."""
        return self._seconds is not None and self._seconds > VERY_SLOW_FRAME

    @property
    def measuring(self) -> bool:
        """Whether the next full frame is to be measured; on a processor all of them are."""
        return self.software or self._frames <= MEASURED_FRAMES

    @property
    def _helps(self) -> bool:
        mesh = self._drawing.mesh
        return mesh is not None and mesh.n_vertices > 2 * COARSE_VERTICES

    def begin(self, scale: float) -> bool:
        """Draw dots before the first full frame, if that will be slow without a doubt.

        Parameters
        ----------
        scale : float
            Pixels to a point.

        Returns
        -------
        bool
            Whether a coarse mesh is to be made.
        """
        if not (self.software and self._helps):
            return False
        self._seconds = np.inf
        self._put(scatter(self._mesh.faces, DOTS), DOT_SIZE * scale)
        self.asked = self.awaited = True
        return True

    @property
    def _mesh(self) -> Mesh:
        assert self._drawing.mesh is not None
        return self._drawing.mesh

    def measure(self, seconds: float) -> bool:
        """Learn from a frame of the full mesh; returns whether a coarse mesh is to be made."""
        if not self.measuring:
            return False
        self._frames += 1
        if self._frames == 1:
            # It also compiled shaders and filled the card's memory, and tells nothing.
            return False
        self._seconds = seconds
        if not (self.slow and self._helps) or self.asked:
            return False
        self.asked = self.awaited = True
        return True

    def task(self) -> Callable[[], CoarseMesh]:
        """What makes the coarse mesh of the mesh that is there now; it takes its time."""
        mesh = self._mesh
        return lambda: cluster_vertices(mesh.vertices, mesh.faces, COARSE_VERTICES)

    def take(self, coarse: CoarseMesh) -> None:
        """Draw what was made from now on."""
        self.awaited = False
        self._put(coarse)

    def give_up(self) -> None:
        """Do without what could not be made; dots stay where they were drawn first."""
        self.awaited = False

    def _put(self, coarse: CoarseMesh, dot_size: float = 0.0) -> None:
        drawing, chosen = self._drawing, coarse.representatives
        points: npt.NDArray[np.float32]
        points = (self._mesh.vertices[chosen] - drawing.centre).astype(np.float32)
        assert drawing.normals is not None
        drawing.set_coarse(coarse, points, drawing.normals[chosen], dot_size)

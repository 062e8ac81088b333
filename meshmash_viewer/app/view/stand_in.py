"""Coarse meshes in the place of large ones: while something moves slowly, and for thumbnails."""

from __future__ import annotations

import math

from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.clustering import CoarseMesh, cluster_vertices, scatter

__all__ = ["StandIn", "dots_of", "stand_in_of"]

#: A frame that takes longer than this (s) is slow.
SLOW_FRAME = 0.045
#: One that takes longer than this is not made slower by smoothing its edges well.
VERY_SLOW_FRAME = 0.3
#: About how many vertices the stand-in has; it takes a mesh of twice as many to be worth one.
COARSE_VERTICES = 40_000
#: So many frames of a mesh are measured, after a first one that tells nothing.
MEASURED_FRAMES = 4
#: How many dots are drawn until it is there.
DOTS = 36_000


class StandIn:
    """Learns how slow the frames of a mesh are."""

    def __init__(self) -> None:
        #: Whether OpenGL runs on the processor, as far as is known.
        self.software = False
        self.begin(0)

    def begin(self, n_vertices: int) -> None:
        """Start anew with another mesh; of a large one that a processor draws nothing is asked."""
        self._n_vertices = n_vertices
        self._seconds = math.inf if self.software and self.large else 0.0
        self._frames = 0
        #: Whether it has been asked for.
        self.asked = False

    @property
    def large(self) -> bool:
        """Whether the mesh has many more vertices than a stand-in."""
        return self._n_vertices > 2 * COARSE_VERTICES

    @property
    def slow(self) -> bool:
        """Whether frames of the full mesh are."""
        return self._seconds > SLOW_FRAME

    @property
    def very_slow(self) -> bool:
        """Whether nothing may be added to frames of the full mesh."""
        return self._seconds > VERY_SLOW_FRAME

    @property
    def measuring(self) -> bool:
        """Whether the next full frame is to be measured; on a processor all of them are."""
        return self.software or self._frames <= MEASURED_FRAMES

    def measure(self, seconds: float) -> None:
        """Learn from a frame of the full mesh."""
        self._frames += 1
        # the first one also compiled shaders and filled the card's memory, and tells nothing
        if self._frames > 1:
            self._seconds = seconds

    def look_at(self, window: vtkRenderWindow) -> None:
        """Find out what draws a window, which can tell once it is on the screen."""
        told = window.ReportCapabilities().lower()
        names = "llvmpipe", "softpipe", "swrast", "swiftshader"
        self.software = any(name in told for name in names)


def dots_of(mesh: Mesh) -> CoarseMesh:
    """What is drawn until the stand-in is there: dots from all over a mesh, at once."""
    return scatter(mesh.faces, DOTS)


def stand_in_of(mesh: Mesh) -> CoarseMesh:
    """The stand-in of a mesh, which takes a second at a million vertices."""
    return cluster_vertices(mesh.vertices, mesh.faces, COARSE_VERTICES)

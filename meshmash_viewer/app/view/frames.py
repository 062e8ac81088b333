"""Frames of the render; a simplified mesh, the stand-in, replaces a large mesh drawn slowly."""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, QTimer, Signal

from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import hasten
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.surface.decimation import CoarseMesh, cluster_vertices

#: Milliseconds without movement after which the full mesh is drawn again.
REST = 220
#: Durations in seconds above which a frame is slow, and above which multisampling is disabled.
SLOW_FRAME, VERY_SLOW_FRAME = 0.045, 0.3
#: Samples of a pixel in frames that are multisampled.
SAMPLES = 4
#: Approximate number of vertices of a stand-in, made for meshes of more than twice this number.
COARSE_VERTICES = 40_000
#: Number of frames timed for each mesh, after the first frame, which compiles shaders.
MEASURED_FRAMES = 4
#: Names of OpenGL drivers that run on the processor.
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader")


class Frames(QObject):
    """Drawing and timing of frames, when the canvas is painted.

    If frames of a large mesh are slow, its stand-in is drawn while the picture is changing. If
    OpenGL runs on the processor, frames of a large mesh count as slow before they are timed.
    """

    #: The first frame is on the screen.
    first_drawn = Signal()
    #: The camera was moved by a script.
    camera_moved = Signal()
    #: The stand-in is ready, and `small_twin` returns a drawing.
    stand_in_made = Signal()

    def __init__(self, drawing: MeshRenderer, canvas: RenderWidget, parent: QObject) -> None:
        super().__init__(parent)
        self._drawing, self._canvas = drawing, canvas
        self._first = True
        #: Whether OpenGL runs on the processor.
        self.software = False
        self.rest = QTimer(self, interval=REST, singleShot=True)
        self.rest.timeout.connect(self._come_to_rest)
        self._coarsening = Slot(self, "stand-in")
        self.begin()
        canvas.frame_due.connect(self._draw)
        canvas.drag_ended.connect(self._come_to_rest)

    def begin(self) -> None:
        """Reset the timings, and the request of a stand-in, for a new mesh."""
        self._coarsening.drop()
        self.rest.stop()
        self._seconds, self._measured, self._requested = 0.0, 0, False
        self._expect_slow_frames()

    def move(self) -> None:
        """Request a frame while the picture is changing."""
        if self.slow:
            self.rest.start()
        self._canvas.render()

    def close(self) -> None:
        """Stop drawing frames."""
        self._canvas.frame_due.disconnect(self._draw)

    @property
    def slow(self) -> bool:
        """Whether frames of the full mesh are slow."""
        return self._seconds > SLOW_FRAME

    @property
    def at_rest(self) -> bool:
        """Whether the full mesh is drawn, and no stand-in is being made."""
        return not self.rest.isActive() and not self._coarsening.working

    def small_twin(self) -> tuple[MeshRenderer, npt.NDArray[np.int64] | None] | None:
        """Return a copy of the drawing for thumbnails, and its vertices (None for all vertices).

        A large mesh is replaced by its stand-in, without a field. If the stand-in is not ready, it
        is requested, and the result is None until `stand_in_made` is emitted.
        """
        if not self._large:
            return self._drawing.twin(), None
        self._request_stand_in()
        return self._drawing.coarse_twin()

    def mesh_alone(self) -> npt.NDArray[np.uint8] | None:
        """Draw the mesh without background and annotations; see `OffScreen.draw`.

        If frames are slow, the stand-in is drawn; the result is None until it is ready.
        """
        drawing = self._drawing
        if self.slow and self._large and drawing.coarse is None:
            self._request_stand_in()
            return None
        before, faults = drawing.shows_coarse, drawing.overlays.get("faults")
        props = drawing.handle, None if faults is None else faults.actor
        hidden = [each for each in props if each is not None and each.GetVisibility()]
        drawing.show_coarse(self.slow)
        drawing.annotated = False
        drawing.leave_background()
        for each in hidden:
            each.VisibilityOff()
        try:
            drawing.prepare(*self._canvas.pixels())
            return self._canvas.draw_aside()
        finally:
            for each in hidden:
                each.VisibilityOn()
            drawing.set_theme(drawing.dark)
            drawing.annotated = True
            drawing.show_coarse(before)

    @property
    def _large(self) -> bool:
        """Whether the mesh is large enough for a stand-in."""
        mesh = self._drawing.mesh
        return mesh is not None and mesh.n_vertices > 2 * COARSE_VERTICES

    def _expect_slow_frames(self) -> None:
        """Count frames of a large mesh as slow if OpenGL runs on the processor."""
        if self.software and self._large:
            self._seconds = math.inf
            self._request_stand_in()
            self.rest.start()

    def _come_to_rest(self) -> None:
        if self._canvas.dragging:
            self.rest.start()
        else:
            self._canvas.render()

    def _request_stand_in(self) -> None:
        """Make the stand-in of a large mesh, unless requested before."""
        mesh = self._drawing.mesh
        if mesh is not None and self._large and not self._requested:
            self._requested = True
            self._coarsening.submit(
                lambda _: cluster_vertices(mesh.vertices, mesh.faces, COARSE_VERTICES),
                self._take_stand_in,
            )

    def _take_stand_in(self, made: CoarseMesh) -> None:
        self._drawing.set_coarse(made)
        self.stand_in_made.emit()
        if self.rest.isActive():
            self._canvas.render()

    def _draw(self) -> None:
        """Draw a frame; called when Qt paints the canvas."""
        drawing, window = self._drawing, self._canvas.window_of_vtk
        if self._first:  # the driver can be queried once the window is on the screen
            capabilities = window.ReportCapabilities().lower()
            self.software = any(name in capabilities for name in _SOFTWARE)
            self._expect_slow_frames()
        at_rest = not self.rest.isActive()
        coarse = not at_rest and self.slow and drawing.coarse is not None
        drawing.show_coarse(coarse)
        # Multisampling may double the time of a frame. Slow frames are multisampled only at rest;
        # very slow frames at rest are smoothed by FXAA instead.
        quickly = self.slow and (self._seconds > VERY_SLOW_FRAME or not at_rest)
        window.SetMultiSamples(0 if quickly else SAMPLES)
        drawing.renderer.SetUseFXAA(quickly and at_rest)
        started, view = perf_counter(), drawing.view
        drawing.prepare(*self._canvas.pixels())
        if view is not None and drawing.view is not view:
            self.camera_moved.emit()
        self._canvas.draw()
        hasten()
        measuring = self.software or self._measured <= MEASURED_FRAMES
        if measuring:
            window.WaitForCompletion()  # because a graphics card draws asynchronously
        took = perf_counter() - started
        if self._first:
            self._first = False
            self.first_drawn.emit()
        elif drawing.surface is not None and not coarse and measuring:
            self._measured += 1
            if self._measured > 1:  # ignore the first frame, which also compiled shaders
                self._seconds = took
            if self.slow:
                self._request_stand_in()

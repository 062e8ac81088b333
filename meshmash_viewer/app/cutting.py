"""The clipping plane of the first mesh: its commands, and its handle on the render."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from meshmash_viewer.model.display import Cut
from meshmash_viewer.model.document import Document
from meshmash_viewer.surface.rays import Plane

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView


class Cutting:
    """Commands that change the clipping plane of the document's display."""

    def __init__(self, document: Document, scene: MeshView) -> None:
        self._document, self._scene = document, scene
        scene.cut_handle.moved = self._put

    def cut(self, on: bool) -> None:
        """Cut the mesh at the last plane, initially an oblique plane, or show the whole mesh."""
        display = self._document.display
        if on and not display.cut.placed:
            self.reset_cut()
        else:
            display.cut = replace(display.cut, shown=on)

    def flip_cut(self) -> None:
        """Hide the other side of the plane."""
        cut = self._document.display.cut
        x, y, z = cut.normal
        self._document.display.cut = replace(cut, normal=(-x, -y, -z), offset=-cut.offset)

    def reset_cut(self) -> None:
        """Cut through the middle obliquely, and hide the side to the right and towards the eye."""
        view = self._scene.renderer.view
        if view is not None:
            self._cut_across(-(view.axes[0] + view.axes[2]) / np.sqrt(2.0))

    def cut_across(self, axis: str) -> None:
        """Cut through the middle across an axis, "x", "y" or "z", and hide the nearer side."""
        view, normal = self._scene.renderer.view, np.eye(3)["xyz".index(axis)]
        if view is not None:
            self._cut_across(-normal if view.axes[2] @ normal > 0.0 else normal)

    def _cut_across(self, normal: np.ndarray) -> None:
        mesh = self._document.mesh
        if mesh is not None:
            self._put(Plane(normal, float(normal @ mesh.bounds.mean(axis=0))))
            self._document.history.end_gesture()  # a following drag is a separate undo step

    def _put(self, plane: Plane) -> None:
        mesh = self._document.mesh
        if mesh is not None:
            self._document.display.cut = Cut.at(plane, mesh.bounds)

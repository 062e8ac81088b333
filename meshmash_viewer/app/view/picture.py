"""Pictures without a window, and without Qt; on a machine without a display where VTK can."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.colors import ColorMap
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.limits import LockedLimits, MinMaxLimits, SymmetricLimits

__all__ = [
    "OffScreen",
    "draw_picture",
    "new_window",
    "render_picture",
    "straight",
    "text_scale",
]

#: Of all pixels together: a driver holds some 8 bytes for each, and has to have room for them.
_MOST_SAMPLES = 1 << 28


def render_picture(
    mesh: Mesh,
    values: npt.NDArray[np.floating] | None,
    path: str | Path,
    *,
    size: tuple[int, int] = (1600, 1200),
    colormap: ColorMap = "RdBu_r",
    limits: tuple[float, float] | None = None,
    title: str = "",
    quantity: str = "",
    unit: str = "",
    transparent: bool = False,
    dark: bool = False,
) -> None:
    """Draw a field on a mesh and write it as PNG.

    Parameters
    ----------
    mesh : Mesh
    values : ndarray, shape (n,), or None
        A value a vertex, NaN where there is none; None draws the bare mesh.
    path : str or Path
        Where the PNG goes; an older file is replaced only when the new one is whole.
    size : (int, int)
        Width and height in pixels.
    colormap : str
        Name of one of matplotlib's colour maps.
    limits : (float, float) or None
        Ends of the colour bar; None takes the smallest and the largest value, or a range
        symmetric about zero if there are values of both signs.
    title, quantity : str
        First and second line of the caption.
    unit : str
        Unit of the values.
    transparent : bool
        Leave the background out.
    dark : bool
        Light text on a dark ground.
    """
    drawing = MeshRenderer(dark)
    drawing.set_mesh(mesh, mesh.vertex_normals)
    if values is not None:
        values = np.asarray(values, dtype=np.float32)
        limits = _limits(values, limits)
        drawing.set_field(mesh.on_surface(values), limits, colormap, title, quantity, unit)
    pixels = draw_picture(drawing, size, transparent)
    # Late: the writers load more than a picture on the screen needs.
    from meshmash_viewer.io.write import write_picture

    write_picture(path, pixels)


def _limits(
    values: npt.NDArray[np.float32], wanted: tuple[float, float] | None
) -> tuple[float, float]:
    """Ends of the colour bar, the lower below the upper for a constant field, too."""
    if wanted is not None:
        return LockedLimits(*wanted).limits(values)
    signed = bool((values < 0.0).any() and (values > 0.0).any())
    return (SymmetricLimits() if signed else MinMaxLimits()).limits(values)


def draw_picture(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
) -> npt.NDArray[np.uint8]:
    """Draw off the screen; returns RGBA, shape (height, width, 4), first row on top."""
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        return straight(window.draw())


def straight(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """RGBA of a picture as `OffScreen.draw` returns it; needs no graphics, any thread can do it."""
    rgba = np.full((*picture.shape[:2], 4), 255, dtype=np.uint8)
    rgba[..., : picture.shape[2]] = picture
    if picture.shape[2] == 4:
        opacity = np.maximum(picture[..., 3:].astype(np.float32), 1.0) / 255.0
        rgba[..., :3] = np.minimum(picture[..., :3] / opacity, 255.0).round()
    return rgba


class OffScreen:
    """A window that nobody sees, for one picture of a drawing or for many of the same size.

    What is written grows with the picture, so that text stays as legible as on the screen.

    Parameters
    ----------
    drawing : MeshRenderer
        Nobody else's (`MeshRenderer.twin`).
    size : (int, int)
        Width and height in pixels.
    transparent : bool
        Leave the background out.
    """

    def __init__(
        self, drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
    ) -> None:
        self.drawing, self.transparent = drawing, transparent
        self.size = int(size[0]), int(size[1])
        self._window = new_window()
        self._window.SetOffScreenRendering(True)
        self._window.SetMultiSamples(max(min(8, _MOST_SAMPLES // (self.size[0] * self.size[1])), 1))
        self._window.SetAlphaBitPlanes(transparent)
        self._window.SetSize(*self.size)
        drawing.add_to(self._window)
        if transparent:
            drawing.leave_background()
        self._window.SetDPI(round(72 * text_scale(self.size)))

    def draw(self) -> npt.NDArray[np.uint8]:
        """Draw it as it is now.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3 or 4)
            First row on top. With four channels, colours are multiplied by the opacity (`straight`
            undoes it).
        """
        width, height = self.size
        self.drawing.prepare(width, height, text_scale(self.size), plates=not self.transparent)
        self._window.Render()
        pixels = vtkUnsignedCharArray()
        corners = (0, 0, width - 1, height - 1)
        if self.transparent:
            # The samples of a pixel are averaged here once more: VTK averages light, not colours
            # times opacity, for the frame on the screen.
            self._window.GetRGBACharPixelData(*corners, 0, pixels, 0)
        else:
            # The frame as it would be on the screen; averaged already, while it was drawn.
            self._window.GetPixelData(*corners, 1, pixels, 0)
        rows: npt.NDArray[np.uint8] = vtk_to_numpy(pixels).reshape(height, width, -1)
        return np.ascontiguousarray(rows[::-1])

    def close(self) -> None:
        """Give back what it takes of the card."""
        self.drawing.remove_from(self._window)
        self._window.Finalize()


def text_scale(size: tuple[int, int]) -> float:
    """Pixels to one point of what is written on a picture."""
    return max(1.0, min(size[0] / 1000, size[1] / 750))


def new_window() -> vtkRenderWindow:
    """A render window that needs no display where there is none."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        # Asked for by name: the general one tries the display first, and complains.
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    return vtkRenderWindow()

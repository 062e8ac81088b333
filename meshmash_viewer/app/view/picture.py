"""Pictures without a window, and without Qt; on a machine without a display where VTK can."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.colors import ColorMap
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer, read_pixels
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.limits import LockedLimits, MinMaxLimits, SymmetricLimits

__all__ = [
    "OffScreen",
    "RawPicture",
    "all_steps",
    "draw_in_steps",
    "draw_picture",
    "new_window",
    "render_picture",
    "text_scale",
]

#: Rows of pixels that are read back at a time.
_ROWS = 256


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


@dataclass(frozen=True, eq=False)
class RawPicture:
    """A frame as it was read back; what is left to do needs no graphics, and any thread can do it.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (height, width, 3 or 4)
        With four channels, the colours are multiplied by the opacity.
    """

    pixels: npt.NDArray[np.uint8]

    def rgba(self) -> npt.NDArray[np.uint8]:
        """Straight colours and opacity, shape (height, width, 4), first row on top."""
        height, width, channels = self.pixels.shape
        picture = np.full((height, width, 4), 255, dtype=np.uint8)
        if channels == 3:
            picture[..., :3] = self.pixels
            return picture
        opacity = self.pixels[..., 3:].astype(np.float32) / 255.0
        straight = self.pixels[..., :3] / np.maximum(opacity, 1.0 / 255.0)
        picture[..., :3] = np.minimum(straight, 255.0).round().astype(np.uint8)
        picture[..., 3] = self.pixels[..., 3]
        return picture


def draw_picture(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
) -> npt.NDArray[np.uint8]:
    """Draw off the screen; returns RGBA, shape (height, width, 4), first row on top."""
    return all_steps(draw_in_steps(drawing, size, transparent)).rgba()


def all_steps(steps: Generator[None, None, RawPicture]) -> RawPicture:
    """Take all steps at once."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            drawn: RawPicture = end.value
            return drawn


def draw_in_steps(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
) -> Generator[None, None, RawPicture]:
    """The part of `draw_picture` that needs the thread of the graphics, in steps.

    Between them it may do something else; the last one returns the picture.
    """
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        return (yield from window.draw())


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
        self._window.SetMultiSamples(8)
        self._window.SetAlphaBitPlanes(transparent)
        self._window.SetSize(*self.size)
        drawing.add_to(self._window)
        if transparent:
            # What comes out is colour times opacity, which is then undone.
            drawing.leave_background()
        self._window.SetDPI(round(72 * text_scale(self.size)))

    def draw(self) -> Generator[None, None, RawPicture]:
        """Draw it as it is now, in steps, see `draw_in_steps`."""
        width, height = self.size
        self.drawing.prepare(width, height, text_scale(self.size), plates=not self.transparent)
        yield
        self._window.Render()
        yield
        pixels = np.empty((height, width, 4 if self.transparent else 3), dtype=np.uint8)
        for bottom in range(0, height, _ROWS):
            rows = min(_ROWS, height - bottom)
            part = read_pixels(self._window, self.transparent, bottom, rows)
            pixels[height - bottom - len(part) : height - bottom] = part
            yield
        return RawPicture(pixels)

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
        import vtkmodules.vtkRenderingOpenGL2 as opengl

        for name in ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"):
            kind = getattr(opengl, name, None)
            if kind is not None:
                window: vtkRenderWindow = kind()
                return window
    return vtkRenderWindow()

"""Pictures and scene files of a drawing, off screen: without Qt and, where VTK can, a display."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.annotations import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.style import LIGHT, NAN_COLOR, ColorMap
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh, mesh_to_poly
from meshmash_viewer.model.limits import (
    Limits,
    LockedLimits,
    MinMaxLimits,
    SymmetricLimits,
    beyond_limits,
    extremes_of,
)

if TYPE_CHECKING:
    import pyvista

#: Seconds after which a graphics driver is given up.
_DRIVER_TIMEOUT = 30.0
#: Samples of a pixel, and their largest number for all pixels: a driver stores 8 bytes of each.
_SAMPLES, _MAX_SAMPLES = 8, 1 << 28


def new_drawing(
    mesh: Mesh,
    values: npt.NDArray[np.floating] | None,
    *,
    colormap: ColorMap = "RdBu_r",
    limits: Limits | tuple[float, float] | None = None,
    title: str = "",
    quantity: str = "",
    unit: str = "",
    formula: str = "",
    dark: bool = False,
) -> MeshRenderer:
    """Return the drawing of a field on a mesh; None draws the mesh without a field.

    `values`, shape (n,), are NaN where there is none; `colormap` is one of matplotlib's.
    Limits are on a linear scale unless they say otherwise, and by default the smallest and the
    largest value, or a range symmetric about zero if there are values of both signs. `title` and
    `quantity` are the lines of the caption, `formula` says in small below the title what the values
    are, `unit` is theirs.
    """
    drawing = MeshRenderer(dark)
    drawing.set_mesh(mesh, mesh.vertex_normals)
    if values is not None:
        values = np.asarray(values, dtype=np.float32)
        limits = _limits(values, limits)
        beyond = beyond_limits(limits, extremes_of(values))
        low, high, log = limits
        shown = title, quantity, unit, low, high, colormap
        caption = Caption(*shown, logarithmic=log, beyond=beyond, formula=formula)
        drawing.set_field(values, caption)
    return drawing


def _limits(values: npt.NDArray[np.float32], wanted: Limits | tuple[float, float] | None) -> Limits:
    """Limits of the colour bar, of which the lower is below the upper for constant fields, too."""
    if wanted is not None:
        logarithmic = Limits(*wanted).logarithmic
        return Limits(*LockedLimits(*wanted[:2]).limits(values), logarithmic)
    signed = bool((values < 0.0).any() and (values > 0.0).any())
    return Limits(*(SymmetricLimits() if signed else MinMaxLimits()).limits(values))


def draw_picture(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
) -> npt.NDArray[np.uint8]:
    """Draw off screen; returns RGBA, shape (height, width, 4), first row on top."""
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        return straight(window.draw())


def straight(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """RGBA with straight alpha of a picture from `OffScreen.draw`, in any thread."""
    rgba = np.full((*picture.shape[:2], 4), 255, dtype=np.uint8)
    rgba[..., : picture.shape[2]] = picture
    if picture.shape[2] == 4:
        opacity = np.maximum(picture[..., 3:].astype(np.float32), 1.0) / 255.0
        rgba[..., :3] = np.minimum(picture[..., :3] / opacity, 255.0).round()
    return rgba


class OffScreen:
    """An off-screen window that draws pictures of one size in pixels; text grows with it.

    The drawing must be in no other window (`MeshRenderer.twin`). Few `samples` of a pixel are fast.
    """

    def __init__(
        self,
        drawing: MeshRenderer,
        size: tuple[int, int],
        transparent: bool = False,
        samples: int = _SAMPLES,
    ) -> None:
        self.drawing, self.transparent = drawing, transparent
        self.size = int(size[0]), int(size[1])
        self._window = new_window()
        self._window.SetOffScreenRendering(True)
        most = _MAX_SAMPLES // (self.size[0] * self.size[1])
        self._window.SetMultiSamples(max(min(samples, most), 1))
        self._window.SetAlphaBitPlanes(transparent)
        self._window.SetSize(*self.size)
        self._window.AddRenderer(drawing.renderer)
        if transparent:
            drawing.leave_background()
        self._window.SetDPI(round(72 * text_scale(self.size)))

    def draw(self) -> npt.NDArray[np.uint8]:
        """Draw the current state: uint8, shape (height, width, 3 or 4), first row on top.

        Four channels have premultiplied alpha, see `straight`.
        """
        width, height = self.size
        self.drawing.prepare(width, height, text_scale(self.size), plates=not self.transparent)
        self._window.Render()
        return pixels_of(self._window, self.size, self.transparent)

    def close(self) -> None:
        """Release the memory of the graphics card."""
        self._window.RemoveRenderer(self.drawing.renderer)
        self._window.Finalize()


def pixels_of(
    window: vtkRenderWindow, size: tuple[int, int], transparent: bool
) -> npt.NDArray[np.uint8]:
    """The last frame of a window; see `OffScreen.draw`."""
    pixels, (width, height) = vtkUnsignedCharArray(), size
    corners = (0, 0, width - 1, height - 1)
    if transparent:
        # averages the samples of a pixel with their opacity, unlike the frame on the screen
        window.GetRGBACharPixelData(*corners, 0, pixels, 0)
    else:
        # the frame of the screen, whose samples have been averaged already
        window.GetPixelData(*corners, 1, pixels, 0)
    rows: npt.NDArray[np.uint8] = vtk_to_numpy(pixels).reshape(height, width, -1)
    return np.ascontiguousarray(rows[::-1])


def text_scale(size: tuple[int, int]) -> float:
    """Pixels per point of text on a picture."""
    return max(1.0, min(size[0] / 1000, size[1] / 750))


def new_window() -> vtkRenderWindow:
    """A render window, on a machine without a display one that needs none."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        # the default window would try the display first, and warn
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    return vtkRenderWindow()


def graphics(window: vtkRenderWindow) -> str:
    """Name and version of the OpenGL driver of a window that has rendered a frame."""
    lines = window.ReportCapabilities().splitlines()
    values = dict(line.split(":", 1) for line in lines if ":" in line)
    names = "OpenGL renderer string", "OpenGL version string"
    return ", ".join(values[name].strip() for name in names if name in values) or "none"


def asked_graphics() -> str:
    """Name and version of the OpenGL driver, found in a subprocess, which some drivers crash."""
    command = [sys.executable, "-m", __name__]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=_DRIVER_TIMEOUT)
    except subprocess.TimeoutExpired:
        return f"no answer within {_DRIVER_TIMEOUT:.0f} s"
    return answer.stdout.strip() or f"none (its test ended with status {answer.returncode})"


#: Formats of scenes by their ending.
SCENES = {
    ".gltf": "glTF, for Blender, PowerPoint and viewers",
    ".html": "HTML page, for any browser",
}
#: Libraries that make web pages, see the extra "html".
_PAGE_MAKERS = ("trame_pyvista", "nest_asyncio2")


def missing_pages() -> str:
    """Why HTML pages cannot be written, and the remedy; empty if they can."""
    if all(importlib.util.find_spec(name) is not None for name in _PAGE_MAKERS):
        return ""
    return (
        'An HTML page needs trame, which is not installed: pip install "meshmash-viewer[html]", or'
        " write .gltf."
    )


def displayed_surface(drawing: MeshRenderer) -> pyvista.PolyData:
    """Copy the mesh as it is drawn, in its own coordinates, with the displayed field.

    The field is its active scalars, named by its title, NaN where there is no value; ``user_dict``
    has ``"quantity"``, ``"unit"``, ``"colormap"`` (of labels the colours), ``"limits"`` and
    ``"log_scale"``. Faces that are hidden, or with a vertex that is cut away, are left out.
    `ValueError` is raised if no mesh is displayed, or no face of it.
    """
    if drawing.mesh is None:
        raise ValueError("No mesh is shown: open one first.")
    vertices, faces = drawing.mesh
    if (away := drawing.away()) is not None:
        faces = faces[~away[faces].any(axis=1)]
    if not len(faces):
        raise InputError("All faces are hidden or cut away: show some first.")
    surface: pyvista.PolyData = mesh_to_poly((vertices, faces))
    if drawing.drawn_vertices is not drawing.mesh.vertices:
        surface.points = drawing.drawn_vertices
    caption = drawing.caption
    if caption is not None and drawing.surface is not None:
        surface.point_data[caption.title] = drawing.surface.shown_values()
        surface.set_active_scalars(caption.title)
        named = caption.colormap
        surface.user_dict = {
            "quantity": caption.quantity,
            "unit": caption.unit,
            "colormap": named if isinstance(named, str) else list(named),
            "limits": [caption.low, caption.high],
            "log_scale": caption.logarithmic,
        }
    return surface


def write_scene(surface: pyvista.PolyData, path: str | Path) -> None:
    """Write a surface from `displayed_surface` in the colours of its field.

    The path ends in ".gltf" (one self-contained file) or ".html" (a page that needs no server).

    `InputError` is raised if the ending is unknown, trame is missing, or the file cannot be
    written.
    """
    # imported late: the writers load more than a picture on the screen needs
    from meshmash_viewer.io.atomic import writing_errors, written_whole
    from meshmash_viewer.io.write import check_output

    path = Path(path)
    check_output(path, "scene")
    page = path.suffix.lower() == ".html"
    if page and (missing := missing_pages()):
        raise InputError(missing)
    import pyvista

    plotter = pyvista.Plotter(off_screen=True)
    try:
        about = dict(surface.user_dict)
        if about:
            title = " ".join(filter(None, (surface.active_scalars_name, about["unit"])))
            plotter.add_mesh(
                surface,
                cmap=about["colormap"],
                clim=about["limits"],
                log_scale=about["log_scale"],
                nan_color=NAN_COLOR,
                smooth_shading=True,
                scalar_bar_args={"title": title},
            )
        else:
            plotter.add_mesh(surface, color=LIGHT.surface, smooth_shading=True)
        with writing_errors(path), written_whole(path) as part:
            if page:
                plotter.trame.export_html(str(part))
            else:
                plotter.export_gltf(str(part), rotate_scene=False)
    finally:
        plotter.close()


if __name__ == "__main__":
    window = new_window()
    window.SetOffScreenRendering(True)
    window.Render()
    sys.stdout.write(graphics(window))

"""Pictures and scene files of a drawing, made off screen and without Qt."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.style import LIGHT, NAN_COLOR, ColorMap
from meshmash_viewer.errors import InputError, require
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

#: Seconds after which the test of a graphics driver is terminated.
_DRIVER_TIMEOUT = 30.0
#: Samples per pixel, and maximum number of samples of a picture; each takes 8 bytes in a driver.
SAMPLES, _MAX_SAMPLES = 8, 1 << 28


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
    """Return the drawing of a field on a mesh; without `values`, the mesh has a single colour.

    `values` have shape (n,) and are NaN for vertices without a value. The default limits are the
    minimum and maximum, or symmetric about zero if values of both signs exist. `title`, `formula`
    (small) and `quantity` are the lines of the caption; `unit` is the unit of the values.
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
    """Return the limits of the colour bar; low < high even for a constant field."""
    if wanted is not None:
        logarithmic = Limits(*wanted).logarithmic
        return Limits(*LockedLimits(*wanted[:2]).limits(values), logarithmic)
    signed = bool((values < 0.0).any() and (values > 0.0).any())
    return Limits(*(SymmetricLimits() if signed else MinMaxLimits()).limits(values))


def draw_picture(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
) -> npt.NDArray[np.uint8]:
    """Draw a picture off screen; RGBA, shape (height, width, 4), first row on top."""
    return straight(draw_frame(drawing, size, transparent))


def draw_frame(
    drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False, samples: int = SAMPLES
) -> npt.NDArray[np.uint8]:
    """Draw a frame off screen, see `OffScreen` and `OffScreen.draw`."""
    with contextlib.closing(OffScreen(drawing, size, transparent, samples)) as window:
        return window.draw()


#: A function like `draw_frame`.
DrawFrame: TypeAlias = Callable[..., npt.NDArray[np.uint8]]


def straight(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return a picture of `OffScreen.draw` as RGBA with straight alpha; may run in any thread."""
    rgba = np.full((*picture.shape[:2], 4), 255, dtype=np.uint8)
    rgba[..., : picture.shape[2]] = picture
    if picture.shape[2] == 4:
        opacity = np.maximum(picture[..., 3:].astype(np.float32), 1.0) / 255.0
        rgba[..., :3] = np.minimum(picture[..., :3] / opacity, 255.0).round()
    return rgba


class OffScreen:
    """Off-screen window for pictures of one size in pixels; text is scaled with the size.

    The drawing must not belong to another window (see `MeshRenderer.twin`). `samples` is the number
    of samples per pixel.
    """

    def __init__(
        self,
        drawing: MeshRenderer,
        size: tuple[int, int],
        transparent: bool = False,
        samples: int = SAMPLES,
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
        """Return a frame: uint8, shape (height, width, 3), first row on top.

        A transparent frame has four channels with premultiplied alpha, see `straight`.
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
    """Return the last frame of a window; see `OffScreen.draw`."""
    pixels, (width, height) = vtkUnsignedCharArray(), size
    corners = (0, 0, width - 1, height - 1)
    if transparent:
        # averages the samples of a pixel together with their opacity
        window.GetRGBACharPixelData(*corners, 0, pixels, 0)
    else:
        # reads the displayed frame, in which the samples have been averaged
        window.GetPixelData(*corners, 1, pixels, 0)
    rows: npt.NDArray[np.uint8] = vtk_to_numpy(pixels).reshape(height, width, -1)
    return np.ascontiguousarray(rows[::-1])


def text_scale(size: tuple[int, int]) -> float:
    """Return the number of pixels per point for a picture of a given size in pixels."""
    return max(1.0, min(size[0] / 1000, size[1] / 750))


def new_window() -> vtkRenderWindow:
    """Return a render window; on Linux without a display, an EGL window."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        # VTK's default window would try the display first, and print a warning
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    return vtkRenderWindow()


def graphics(window: vtkRenderWindow) -> str:
    """Return name and version of the OpenGL driver of a window that has rendered a frame."""
    lines = window.ReportCapabilities().splitlines()
    values = dict(line.split(":", 1) for line in lines if ":" in line)
    names = "OpenGL renderer string", "OpenGL version string"
    return ", ".join(values[name].strip() for name in names if name in values) or "none"


def asked_graphics() -> str:
    """Return name and version of the OpenGL driver, or the reason why its test failed.

    The test runs in a subprocess, because some drivers crash.
    """
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
#: Libraries required for web pages (the extra "html").
_PAGES = ("An HTML page needs", "html", "trame_pyvista", "nest_asyncio2")


def missing_pages() -> str:
    """Return the reason why HTML pages cannot be written, with the remedy, or ""."""
    try:
        require(*_PAGES)
    except InputError as fault:
        return str(fault)
    return ""


def displayed_surface(drawing: MeshRenderer) -> pyvista.PolyData:
    """Return a copy of the displayed surface and field, in mesh coordinates.

    The active scalars are the field, named by its title, NaN for vertices without a value.
    The keys of ``user_dict`` are ``"quantity"``, ``"unit"``, ``"colormap"`` (a name, or the colours
    of labels), ``"limits"`` and ``"log_scale"``. Faces at hidden or cut-away vertices are omitted.

    Raises
    ------
    ValueError
        If no mesh or no face is displayed.
    """
    if drawing.mesh is None:
        raise ValueError("No mesh is shown: open one first.")
    vertices, faces = drawing.mesh
    if (away := drawing.away()) is not None:
        faces = faces[~away[faces].any(axis=1)]
    if not len(faces):
        raise InputError("nothing-visible", "All faces are hidden or cut away", "show some first")
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

    Raises
    ------
    InputError
        If the ending is unknown, trame is missing, or the file cannot be written.
    """
    # imported here, because the window does not need the writers at its start
    from meshmash_viewer.io.atomic import writing_errors, written_whole
    from meshmash_viewer.io.write import check_output

    path = Path(path)
    check_output(path, "scene")
    page = path.suffix.lower() == ".html"
    if page:
        require(*_PAGES)
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

"""Scene files of the displayed mesh with its field, for other programs and browsers."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

from meshmash_viewer.app.view.style import LIGHT, NAN_COLOR
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.write import check_output
from meshmash_viewer.mesh import mesh_to_poly

if TYPE_CHECKING:
    import pyvista

    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer

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

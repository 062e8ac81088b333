"""The mesh with its field as a scene that other programs and browsers show, by pyvista."""

from __future__ import annotations

import importlib.util
import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from meshmash_viewer.app.view.colors import LIGHT, NAN_COLOR
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.write import check_output

if TYPE_CHECKING:
    import pyvista

__all__ = ["child_command", "missing_pages", "serve", "write_scene"]

#: What makes web pages, see the extra "html".
_PAGE_MAKERS = ("trame_pyvista", "nest_asyncio2")


def missing_pages() -> str:
    """Why no HTML page can be written here, and the way out; empty if it can."""
    if all(importlib.util.find_spec(name) is not None for name in _PAGE_MAKERS):
        return ""
    return (
        'An HTML page needs trame, which is not installed: pip install "meshmash-viewer[html]", or'
        " write .gltf."
    )


def write_scene(surface: pyvista.PolyData, path: str | Path) -> None:
    """Write a surface in the colours of its field, in its own coordinates.

    Parameters
    ----------
    surface : pyvista.PolyData
        From `MeshView.to_pyvista`; without a field it is plain.
    path : str or Path
        Ends in ".gltf" (glTF with everything inside) or ".html" (a page that needs no server).

    Raises
    ------
    InputError
        If the ending is another one, trame is missing for a page, or the system refuses.
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


def child_command() -> list[str]:
    """Command line of a process that writes the pickled surface and path on its standard input."""
    code = (
        "import sys; sys.path[:] = sys.argv[1:]; "
        "from meshmash_viewer.app.view.scene import serve; serve()"
    )
    return [sys.executable, "-c", code, *sys.path]


def serve() -> None:
    """Write the scene that comes on standard input; what can be mended is said, with status 2."""
    surface, path = pickle.load(sys.stdin.buffer)
    try:
        write_scene(surface, path)
    except InputError as fault:
        sys.stderr.write(str(fault))
        sys.exit(2)

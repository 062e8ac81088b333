from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import draw_picture, new_drawing
from meshmash_viewer.mesh import Mesh

pytestmark = pytest.mark.pixels


def drawn(mesh: Mesh, values: np.ndarray | None, **options: object) -> np.ndarray:
    drawing = MeshRenderer()
    drawing.set_mesh(mesh, mesh.vertex_normals)
    if values is not None:
        drawing.set_field(values, Caption("Title", "λ₅ = 1", "nm⁻¹", -1.0, 1.0, "RdBu_r"))
    return draw_picture(drawing, (400, 300), **options)


def test_size_and_opacity(sphere: Mesh) -> None:
    drawing = new_drawing(sphere, sphere.vertices[:, 2], title="Height", unit="nm")
    picture = draw_picture(drawing, (321, 234))
    assert picture.shape == (234, 321, 4)
    assert (picture[..., 3] == 255).all()
    assert picture[..., :3].std() > 5.0


def test_the_background_can_be_left_out(sphere: Mesh) -> None:
    solid, clear = drawn(sphere, None), drawn(sphere, None, transparent=True)
    assert (clear[:12, 180:220, 3] == 0).all()
    middle = (slice(130, 170), slice(180, 220))
    assert (clear[(*middle, 3)] == 255).all()
    difference = solid[middle].astype(int) - clear[middle].astype(int)
    assert np.abs(difference).max() <= 2
    # Pixels of edges have the colour of the mesh, not of the missing background.
    edge = clear[(clear[..., 3] > 60) & (clear[..., 3] < 200)]
    assert len(edge)
    assert edge[:, :3].max() > 40


def test_colours_are_those_of_the_field(sphere: Mesh) -> None:
    """High values are red, low values blue, and missing values grey."""
    for level, channel in ((0.9, 0), (-0.9, 2)):
        picture = drawn(sphere, np.full(sphere.n_vertices, level, dtype=np.float32))
        middle = picture[150, 180].astype(int)
        assert middle[channel] == middle[:3].max()
        assert middle[channel] - middle[2 - channel] > 60
    picture = drawn(sphere, np.full(sphere.n_vertices, np.nan, dtype=np.float32))
    middle = picture[150, 180].astype(int)
    assert np.ptp(middle[:3]) < 12
    assert 60 < middle[0] < 200


def test_far_from_the_origin_it_looks_the_same(sphere: Mesh) -> None:
    near = drawn(sphere, None)
    far = drawn(Mesh(sphere.vertices + np.array([1e7, -2e7, 3e7]), sphere.faces), None)
    assert np.abs(near.astype(int) - far.astype(int)).mean() < 0.5


def test_limits_of_a_constant_field_are_opened(sphere: Mesh) -> None:
    for value, limits in ((1.0, (1.0, 1.0)), (np.nan, None)):
        drawing = new_drawing(sphere, np.full(sphere.n_vertices, value), limits=limits)
        assert drawing.caption.low < drawing.caption.high
        assert draw_picture(drawing, (200, 150))[..., :3].std() > 5.0


def test_wrong_fields_and_colour_maps_are_refused(sphere: Mesh) -> None:
    with pytest.raises(ValueError, match="does not fit a mesh"):
        new_drawing(sphere, np.ones(3))
    with pytest.raises(ValueError, match="colour map"):
        new_drawing(sphere, sphere.vertices[:, 0], colormap="mauve")


SCRIPT = """
import sys
import numpy as np
import meshmash_viewer.app.view.child
from meshmash_viewer.app.view.picture import draw_picture, new_drawing
from meshmash_viewer.mesh import Mesh
corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
mesh = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
picture = draw_picture(new_drawing(mesh, corners[:, 0]), (200, 150))
print(*{"PySide6", "pyvista", "scipy", "meshmash_viewer.model.document"} & set(sys.modules))
from meshmash_viewer.io.write import write_picture
write_picture(sys.argv[1], picture)
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays are Linux's own affair")
def test_no_display_and_no_slow_library_are_needed(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    hidden = ("DISPLAY", "WAYLAND_DISPLAY")
    surroundings = {name: value for name, value in os.environ.items() if name not in hidden}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(path)],
        env=surroundings,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert not done.stdout.split(), "imported by the process that draws pictures"
    with Image.open(path) as picture:
        assert picture.size == (200, 150)


@pytest.mark.slow
def test_a_log_scale_has_the_middle_colour_at_the_geometric_mean(sphere: Mesh) -> None:
    pictures = []
    for value, limits in ((1e-6, (1e-9, 1e-3, True)), (0.5, (0.0, 1.0)), (-1.0, (1e-9, 1.0, True))):
        values = np.full(sphere.n_vertices, value, dtype=np.float32)
        drawing = new_drawing(sphere, values, colormap="viridis", limits=limits)
        pictures.append(draw_picture(drawing, (300, 240))[120, 140].astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 4
    lowest = new_drawing(sphere, np.zeros(sphere.n_vertices), colormap="viridis", limits=(0.0, 1.0))
    assert np.abs(pictures[2] - draw_picture(lowest, (300, 240))[120, 140]).max() <= 2

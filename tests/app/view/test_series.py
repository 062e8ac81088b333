from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
import shapes
from closed_form import A, B, rectangle_spectrum

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import draw_picture, new_drawing, straight
from meshmash_viewer.app.view.series import (
    Shot,
    compute_shot,
    draw_series,
    series_view,
    shots_of,
    show_shot,
    turntable,
)
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.table import sweep
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import FieldRequest, LiveFeatures
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.vertex_map import Label, VertexMap

pytestmark = pytest.mark.pixels

SIZE = (320, 240)


@pytest.fixture(scope="module")
def plate() -> Mesh:
    flat = shapes.rectangle(12, 30, A, B)
    return Mesh(flat.vertices, flat.faces, unit="nm", name="plate")


def eigenfunctions(mesh: Mesh, columns: range) -> list[Shot]:
    spectrum = rectangle_spectrum(mesh, 40)
    family = FAMILIES["eigenfunction"]()
    found = sweep(family.resolved(spectrum, {}), spectrum, columns)
    return [Shot(FieldRequest(spectrum, "nm", each)) for each in found]


def drawing_of(mesh: Mesh) -> MeshRenderer:
    drawing = MeshRenderer()
    drawing.set_mesh(mesh, mesh.vertex_normals)
    return drawing


@pytest.mark.slow
def test_a_picture_of_a_series_is_the_one_of_its_field(plate: Mesh) -> None:
    shots = eigenfunctions(plate, range(1, 30, 7))
    series = draw_series(drawing_of(plate), SIZE, shots, Display())
    found = [straight(picture) for picture in series]
    assert len(found) == len(shots)
    for shot, picture in zip(shots, found, strict=True):
        assert shot.request is not None
        spectrum, family = shot.request.spectrum, shot.request.family
        described = shot.request.description
        drawing = new_drawing(
            plate,
            np.asarray(spectrum.rows[family.index]),
            title=described.title,
            quantity=described.quantity,
            unit=described.unit("nm"),
        )
        alone = draw_picture(drawing, SIZE).astype(int)
        assert np.abs(alone - picture).mean() < 0.5
    assert np.abs(found[0].astype(int) - found[1]).mean() > 5.0


def test_a_field_carried_to_another_mesh_has_no_value_where_there_is_no_match(plate: Mesh) -> None:
    (shot,) = eigenfunctions(plate, range(5, 6))
    field = compute_shot(shot, Display(), LiveFeatures())
    assert field is not None
    drawing, matches = drawing_of(plate), np.arange(plate.n_vertices)
    show_shot(drawing, shot, field.carried(matches), Display())
    assert drawing.caption is not None
    assert not drawing.caption.missing
    matches[:50] = -1
    show_shot(drawing, shot, field.carried(matches), Display())
    assert drawing.caption.missing


def test_no_more_pictures_are_held_however_many_there_are(plate: Mesh) -> None:
    alive: list[weakref.ref[np.ndarray]] = []
    most = 0
    for picture in draw_series(
        drawing_of(plate), (64, 48), eigenfunctions(plate, range(24)), Display()
    ):
        alive.append(weakref.ref(picture))
        del picture
        gc.collect(0)
        most = max(most, sum(each() is not None for each in alive))
    assert len(alive) == 24
    assert most <= 2


def test_a_mesh_on_a_turntable_comes_round_and_stays_in_the_picture(plate: Mesh) -> None:
    drawing = drawing_of(plate)
    drawing.view = series_view(drawing, SIZE, turning=True)
    views = turntable(drawing, drawing.view, 8)
    quarter = np.array([each.axes for each in views])
    np.testing.assert_allclose(quarter[4][[0, 2]], -quarter[0][[0, 2]], atol=1e-9)
    np.testing.assert_allclose(quarter[:, 1], quarter[:1, 1].repeat(8, axis=0), atol=1e-9)
    for view in views:
        x, y = view.to_pixels(plate.vertices, *SIZE)[:, :2].T
        assert 0 <= x.min() <= x.max() <= SIZE[0]
        assert 0 <= y.min() < y.max() <= SIZE[1]
        assert (x.min() + x.max()) / 2 == pytest.approx(SIZE[0] / 2, abs=2.0)
    pictures = [
        straight(picture).astype(int)
        for picture in draw_series(
            drawing, SIZE, [Shot(view=each) for each in (*views, views[0])], Display()
        )
    ]
    assert np.abs(pictures[0] - pictures[8]).mean() < 0.01
    assert np.abs(pictures[0] - pictures[2]).mean() > 1.0


def test_what_was_looked_at_is_what_the_series_shows(plate: Mesh) -> None:
    """A series shows the whole mesh if it was in view, and otherwise the part in view."""
    drawing = drawing_of(plate)
    drawing.view = series_view(drawing, (800, 600))
    far = drawing.view.zoomed(0.25, 400, 300, 800, 600)
    near = drawing.view.zoomed(6.0, 300, 300, 800, 600)
    drawing.view = far
    again = series_view(drawing, (200, 300), (800, 600))
    assert again.to_pixels(plate.vertices, 200, 300)[:, 0].max() > 150
    drawing.view = near
    part = series_view(drawing, (200, 300), (800, 600))
    np.testing.assert_array_equal(part.focus, near.focus)
    corners = np.array([near.from_pixels(x, y, 800, 600) for x in (0, 800) for y in (0, 600)])
    places = part.to_pixels(corners, 200, 300)[:, :2]
    np.testing.assert_allclose((places.min(axis=0)[0], places.max(axis=0)[0]), (0, 200), atol=1e-6)


def test_each_map_has_the_colours_that_suit_it(plate: Mesh) -> None:
    """Labels have their own colours, and curvature has a diverging colour map."""
    half = (plate.vertices[:, 0] > A / 2).astype(np.float64)
    labels = Label(0, "left", "#d01010"), Label(1, "right", "#1010d0")
    mesh = plate.with_maps(VertexMap("halves", half, labels=labels), VertexMap("x", half + 1.0))
    bare = Eigenpairs.without_pairs(mesh)
    families = sweep(FAMILIES["map"](), bare, range(4))
    shots = shots_of(families, bare, mesh, mesh.area_sample(), {})
    names = ["halves", "x", "Mean curvature", "Gaussian curvature"]
    assert [shot.request.caption for shot in shots if shot.request is not None] == names
    drawing = drawing_of(mesh)
    found = [
        (drawing.caption.colormap, straight(picture))
        for picture in draw_series(drawing, SIZE, shots, Display(nodal_lines=True))
        if drawing.caption is not None
    ]
    colors = [shades for shades, _ in found]
    assert colors == [("#d01010", "#1010d0"), "viridis", "RdBu_r", "RdBu_r"]
    pixels = found[0][1][..., :3].astype(int)
    for channel in (0, 2):
        strong = pixels[..., channel] > 2 * pixels[..., [1, 2 - channel]].max(axis=-1)
        assert strong.sum() > 2000, "both halves are in the colour of their label"


def test_each_of_hundreds_of_labels_has_its_own_colour() -> None:
    """Labels 200 and 201 of 400 would share a colour in a table of 256 colours."""
    mesh = shapes.rectangle(40, 60, A, B)
    keys = np.where(mesh.vertices[:, 0] > A / 2, 201, 200)
    keys[np.linspace(0, mesh.n_vertices - 1, 400).astype(int)] = np.arange(400)
    colors = {200: "#d01010", 201: "#1010d0"}
    labels = tuple(Label(key, "", colors.get(key, "#808080")) for key in range(400))
    mesh = mesh.with_maps(VertexMap("parts", keys, labels=labels))
    bare = Eigenpairs.without_pairs(mesh)
    (family,) = sweep(FAMILIES["map"](), bare, range(1))
    (shot,) = shots_of([family], bare, mesh, mesh.area_sample(), {})
    (picture,) = draw_series(drawing_of(mesh), SIZE, [shot], Display())
    pixels = straight(picture)[..., :3].astype(int)
    for channel in (0, 2):
        strong = pixels[..., channel] > 2 * pixels[..., [1, 2 - channel]].max(axis=-1)
        assert strong.sum() > 2000


@pytest.mark.slow
def test_lines_of_a_distance_are_said_on_its_picture(plate: Mesh) -> None:
    bare = Eigenpairs.without_pairs(plate)
    far = FAMILIES["distance"].exported(vertices=[7])
    shots = shots_of([far], bare, plate, plate.area_sample(), {})
    quantities, pictures = [], []
    for lines in (True, False):
        drawing = drawing_of(plate)
        (picture,) = draw_series(drawing, SIZE, shots, Display(nodal_lines=lines))
        assert drawing.caption is not None
        quantities.append(drawing.caption.quantity)
        pictures.append(straight(picture).astype(int)[70:])
    assert " · lines every " in quantities[0]
    assert quantities[0].startswith(quantities[1])
    dark = [(each[..., :3].max(axis=-1) < 40).sum() for each in pictures]
    assert dark[0] > dark[1] + 100, "the lines are on it"

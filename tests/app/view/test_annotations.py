"""Annotations of a picture: texts, colour bar and scale bar are right, sharp and in place."""

from __future__ import annotations

import itertools
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from written_annotations import Written

from meshmash_viewer.app.view.annotations import title_size
from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import OffScreen, draw_picture
from meshmash_viewer.app.view.style import text_size
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.units import NO_BREAK

pytestmark = pytest.mark.pixels

SIZE = (800, 600)
#: Square of 1 mm, so that the scale of a picture follows from its size.
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
SQUARE = Mesh(CORNERS, np.array([[0, 1, 2], [0, 2, 3]]), "mm")


def shown(title: str = "Eigenfunction 5", quantity: str = "λ₅ = 1", **field: object):
    renderer = MeshRenderer()
    renderer.set_mesh(SQUARE, SQUARE.vertex_normals)
    values = field.pop("values", np.zeros(4))
    limits = field.pop("limits", (-0.4, 1.3))
    renderer.set_field(values, Caption(title, quantity, "nm⁻¹", *limits, "viridis"))
    return renderer


def difference(one: MeshRenderer, other: MeshRenderer, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return the first and last row, and first and last column, of the pixels that differ."""
    pictures = [draw_picture(renderer, size).astype(int) for renderer in (one, other)]
    rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).max(axis=2) > 8)
    return np.array([rows.min(), rows.max(), columns.min(), columns.max()])


def test_labels_of_the_bar_stand_where_their_values_are_and_share_a_unit(qapp) -> None:
    written = Written(shown(limits=(-1.3e-5, 2.6e-5)), SIZE)
    assert "mm⁻¹" in written.texts
    ((_, below, _, tall),) = written.strips
    for text in ("−10", "0", "10", "20"):
        share = (written.texts[text][1] - below) / tall
        value = float(text.replace("−", "-"))
        assert share == pytest.approx((value + 13.0) / 39.0, abs=1.0 / tall)


def test_labels_of_a_narrow_range_are_not_cut(qapp) -> None:
    texts = Written(shown(limits=(0.0811939550, 0.0811939575)), SIZE).texts
    labels = [text for text in texts if text.startswith("81.19")]
    assert len(labels) >= 2
    assert not any("…" in text for text in texts)


@pytest.mark.parametrize("size", [(430, 340), (560, 420), (900, 400)])
def test_the_colour_bar_begins_below_the_title(qapp, size: tuple[int, int]) -> None:
    texts = Written(shown(limits=(-1.3e-5, 2.6e-5)), size).texts
    unit, quantity = texts["mm⁻¹"][1], texts["λ₅ = 1"][1]
    assert unit + 14 < quantity - 12


def test_the_bar_shows_the_colours_of_the_field(qapp) -> None:
    from matplotlib import colormaps

    from meshmash_viewer.app.view.annotations import BAR_SPACE

    picture = draw_picture(shown(), SIZE)[:, SIZE[0] - BAR_SPACE :, :3].astype(int)
    rows = []
    for share in (0.02, 0.5, 0.98):
        wanted = np.array(colormaps["viridis"](share, bytes=True)[:3])
        away = np.abs(picture - wanted).max(axis=2)
        assert away.min() <= 6
        rows.append(int(np.argmin(away.min(axis=1))))
    assert rows == sorted(rows, reverse=True), "the highest value is on top"


@pytest.mark.parametrize("beyond", [(False, False), (True, False), (False, True), (True, True)])
def test_arrows_at_the_bar_say_that_values_are_beyond_its_limits(
    qapp, beyond: tuple[bool, bool]
) -> None:
    drawing = shown()
    drawing.caption = replace(drawing.caption, beyond=beyond)
    written = Written(drawing, SIZE)
    ((left, below, _, tall),) = written.strips
    tips = [each[5] for each in written.polygons if each[0] == left]
    assert [any(tip < below for tip in tips), any(tip > below + tall for tip in tips)] == [*beyond]


@pytest.mark.parametrize("size", [(800, 600), (400, 260)])
def test_the_formula_is_between_title_and_quantity_where_there_is_room(
    qapp, size: tuple[int, int]
) -> None:
    drawing = shown()
    drawing.caption = replace(drawing.caption, formula="Σ exp(−λt) φ²")
    texts = Written(drawing, size).texts
    assert ("Σ exp(−λt) φ²" in texts) == (size == (800, 600))
    heights = [y for text, (_, y) in texts.items() if text in ("Eigenfunction 5", "λ₅ = 1")]
    if "Σ exp(−λt) φ²" in texts:
        heights.insert(1, texts["Σ exp(−λt) φ²"][1])
    assert all(above - below >= 15 for above, below in itertools.pairwise(heights))


def test_no_value_is_said_where_there_is_one_without(qapp) -> None:
    complete, missing = shown(), shown(values=np.array([np.nan, 0.0, 0.0, 0.0]))
    for drawing, said in ((complete, False), (missing, True)):
        written = Written(drawing, SIZE)
        assert ("no value" in written.texts) == said
        assert ([14, 10] in [[*each[2:]] for each in written.rectangles]) == said


@pytest.mark.parametrize("size", [(1000, 750), (2000, 1500), (1000, 1200)])
def test_the_scale_bar_is_as_long_as_it_says(qapp, size: tuple[int, int]) -> None:
    renderer = shown()
    written = Written(renderer, size, size[0] / 1000)
    long = max(width for _, _, width, _ in written.rectangles)
    camera = renderer.renderer.GetActiveCamera()
    millimetres = long * 2.0 * camera.GetParallelScale() / size[1]
    lengths = [
        text.split() for text in written.texts if text.endswith((f"{NO_BREAK}mm", f"{NO_BREAK}µm"))
    ]
    ((number, unit),) = lengths
    said = float(number) * {"mm": 1.0, "µm": 1e-3}[unit]
    assert millimetres == pytest.approx(said, abs=1.0 / long)


@pytest.mark.parametrize("scale", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_title_is_at_its_place_in_any_size_and_drawn_for_it(qapp, scale: int) -> None:
    size = (1000 * scale, 750 * scale)
    top, bottom, left, right = difference(shown("", ""), shown(), size) / scale
    caption = shown().caption
    assert 12 <= left <= 20
    assert 10 <= top <= 22
    assert bottom <= title_size(caption)[1]
    assert right <= title_size(caption)[0]
    # as wide as the font at this size, not enlarged from a smaller font
    assert right - left == pytest.approx(text_size("Eigenfunction 5", 15, True)[0], abs=3)


def test_a_title_too_long_for_the_picture_ends_in_an_ellipsis(qapp) -> None:
    renderer = shown("Eigenfunction of a mesh with a very long name " * 3)
    text = max(Written(renderer, SIZE).texts, key=len)
    assert text.endswith("…")
    assert text_size(text, 15, True)[0] <= SIZE[0] - 32


def test_texts_of_an_earlier_field_are_gone_and_later_ones_are_drawn(qapp) -> None:
    drawing, bare, later = shown(), MeshRenderer(), shown("Eigenfunction 6", "λ₆ = 2")
    bare.set_mesh(SQUARE, SQUARE.vertex_normals)
    bare.fit_view(*SIZE, 1.0)
    for each in (drawing, later):
        each.view = bare.view
    with closing(OffScreen(drawing, SIZE)) as window:
        window.draw()
        drawing.set_field(None)
        without = window.draw()
        drawing.set_field(np.zeros(4), later.caption)
        again = window.draw()
    for picture, wanted in ((without, bare), (again, later)):
        with closing(OffScreen(wanted, SIZE)) as window:
            assert np.abs(picture.astype(int) - window.draw()).max() <= 1


@pytest.mark.slow
def test_plates_have_the_colour_of_the_ground(qapp) -> None:
    picture = draw_picture(shown("i.", ""), SIZE)[..., :3].astype(int)
    # the plate is next to and below the letters; the background is left of the plate
    plate = picture[14:34, 16:40]
    ink = plate.min(axis=2) < 200
    assert ink.any()
    assert np.abs(plate - picture[14:34, 2:3])[~ink & (plate.min(axis=2) > 225)].max() <= 3

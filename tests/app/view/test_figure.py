"""Figures for a paper: size, resolution, text and contents."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises
from PIL import Image
from PySide6.QtGui import QImage, QPainter
from PySide6.QtSvg import QSvgRenderer
from tiers import slow

from meshmash_viewer.app.view.caption import PointLegend
from meshmash_viewer.app.view.figure import (
    FigureOptions,
    compose,
    compose_figure,
    picture_of,
    save_figure,
    seen_of,
)
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import new_drawing
from meshmash_viewer.cli.main import main
from meshmash_viewer.mesh import Mesh


def drawing(size: float = 20.0, unit: str = "mm") -> MeshRenderer:
    """Return a drawing of a ball of the given radius, coloured by x, with two pins."""
    ball = shapes.icosphere(3, radius=size)
    mesh = Mesh(ball.vertices, ball.faces, unit=unit)
    values = mesh.vertices[:, 0]
    made = new_drawing(mesh, values, title="Height", quantity="along x", unit=unit)
    made.set_pins([(0, "#d5530b", "soma"), (5, "#1b7a4b", "2")])
    made.fit_view(800, 600, 1.0)
    return made


def opened(path: Path) -> Image.Image:
    with Image.open(path) as picture:
        picture.load()
    return picture


@pytest.mark.parametrize(("width", "dpi"), [slow(85.0, 600), slow(174.0, 300), (114.0, 150)])
def test_a_png_has_its_width_on_paper(qapp, tmp_path: Path, width: float, dpi: int) -> None:
    options = FigureOptions(width_mm=width, dpi=dpi)
    save_figure(compose_figure([drawing(), drawing(40.0)], options), tmp_path / "a.png")
    picture = opened(tmp_path / "a.png")
    assert picture.info["dpi"][0] == pytest.approx(dpi, abs=0.02)
    assert picture.width == round(width / 25.4 * dpi)
    assert picture.width / picture.info["dpi"][0] * 25.4 == pytest.approx(width, abs=0.05)
    pixels = np.asarray(picture.convert("RGB"))
    edges = [pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]]
    assert all((edge == 255).all() for edge in edges), "nothing is cut off"


@pytest.mark.parametrize("turned", [(1, 0, 2), slow((0, 2, 1)), slow((2, 1, 0))])
@pytest.mark.parametrize("sign", [1.0, slow(-1.0)])
def test_axes_that_point_left_or_down_are_on_the_page(
    qapp, turned: tuple[int, ...], sign: float
) -> None:
    made = drawing()
    tilted = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    made.fit_view(800, 600, 1.0, sign * np.eye(3)[list(turned)] @ tilted)
    figure = compose_figure([made], FigureOptions())
    letters = [text for text in figure.texts if text.get_text() in ("x", "y", "z")]
    assert len(letters) >= 2
    pixels = picture_of(figure, 150.0)[:, :, :3]  # draws the letters
    edges = [pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]]
    assert all((edge == 255).all() for edge in edges), "nothing is cut off"


@pytest.mark.parametrize("width", [slow(640), 937])
def test_nothing_is_seen_through_the_bar_of_an_svg(qapp, tmp_path: Path, width: int) -> None:
    made = drawing()
    figure = compose_figure([made], FigureOptions(background="transparent"))
    save_figure(figure, tmp_path / "a.svg")
    renderer = QSvgRenderer(str(tmp_path / "a.svg"))
    height = round(width * figure.get_figheight() / figure.get_figwidth())
    picture = QImage(width, height, QImage.Format.Format_RGBA8888)
    picture.fill(0)
    painter = QPainter(picture)
    renderer.render(painter)
    painter.end()
    pixels = np.frombuffer(picture.constBits(), np.uint8).reshape(height, width, 4)
    # right of the ball, the colour bar has the longest opaque column
    opaque = pixels[:, int(0.75 * width) :, 3]
    column = opaque[:, np.count_nonzero(opaque, axis=0).argmax()]
    runs = np.split(column, np.flatnonzero(np.diff(column > 0)) + 1)
    bar = max(runs, key=np.count_nonzero)[2:-2]  # without the smooth ends
    assert len(bar) > 0.2 * height
    assert bar.min() == 255


@pytest.mark.slow
def test_text_of_svg_and_pdf_is_text(qapp, tmp_path: Path) -> None:
    figure = compose_figure([drawing()], FigureOptions())
    save_figure(figure, tmp_path / "a.svg")
    svg = (tmp_path / "a.svg").read_text(encoding="utf-8")
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    for text in ("Height", "along x", "mm", "soma", "10", "−10", "10\N{NO-BREAK SPACE}mm"):
        assert text in texts
    assert svg.count("<image") == 1, "the render alone; the bar is made of vectors"
    save_figure(figure, tmp_path / "a.pdf")
    for text in ("Height", "along x", "soma", "10\u00a0mm"):
        assert text in pdf_text(tmp_path / "a.pdf")


def pdf_text(path: Path) -> str:
    """Return the text of a PDF as a viewer selects it, with the pieces of a kerned line joined."""
    shown = []
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", path.read_bytes(), re.S):
        try:
            content = zlib.decompress(stream)
        except zlib.error:
            continue
        for line in re.findall(rb"\[((?:[^\]\\]|\\.)*)\]\s+TJ|(\(.*?\)) Tj", content, re.S):
            pieces = re.findall(rb"\(((?:[^()\\]|\\.)*)\)", line[0] or line[1], re.S)
            # a character has two bytes, which the fonts map to the same code point
            shown.append(b"".join(pieces).replace(b"\x00", b"").decode("latin-1"))
    return "\n".join(shown)


@pytest.mark.slow
def test_two_hemispheres_on_a_column_have_their_whole_titles(qapp, tmp_path: Path) -> None:
    hemispheres = []
    for name in ("lh.pial.very_long_name_of_a_subject_that_has_no_spaces", "Right"):
        ball = shapes.icosphere(3, radius=40.0)
        made = new_drawing(
            Mesh(ball.vertices * [0.6, 1.0, 0.7], ball.faces, "mm", f"mesh of {name[:2]}"),
            -1e-7 * ball.vertices[:, 0], title=f"{name} $hemisphere$",
            quantity="Heat kernel signature at the longest time, t = 1.25×10⁵ mm², up to λ₉₉",
            unit="mm⁻²",
        )  # fmt: skip
        made.fit_view(1000, 500, 1.0, np.array([[0, 1, 0], [0, 0, 1], [1.0, 0, 0]]))
        hemispheres.append(made)
    options = FigureOptions(width_mm=85.0, dpi=600)
    figure = compose_figure(hemispheres, options)
    save_figure(figure, tmp_path / "a.png")
    picture = opened(tmp_path / "a.png")
    assert picture.info["dpi"] == pytest.approx((600, 600), abs=0.02)
    assert picture.width == 2008
    pixels = np.asarray(picture.convert("RGB"))
    edges = [pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]]
    assert all((edge == 255).all() for edge in edges), "nothing is cut off"
    boxes = [text.get_window_extent() for text in figure.texts if text.get_text()]
    for at, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[at + 1 :]), figure.texts[at]
    save_figure(figure, tmp_path / "a.pdf")
    pdf = (tmp_path / "a.pdf").read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf)
    assert float(box[0]) / 72.0 * 25.4 == pytest.approx(85.0, abs=0.01)
    assert float(box[1]) / 72.0 * 600.0 == pytest.approx(picture.height, abs=1.0)
    text = pdf_text(tmp_path / "a.pdf")
    assert all(name in text for name in ("$hemisphere$", "mesh of lh", "mesh of Ri"))
    # the preview has the aspect ratio of the saved picture
    preview = picture_of(figure, 100.0)
    assert preview.shape[0] / preview.shape[1] == pytest.approx(
        picture.height / picture.width, rel=0.01
    )


@pytest.mark.slow
def test_one_colour_bar_serves_two_meshes_with_the_same_colours(qapp) -> None:
    """A shared bar is next to the last mesh and narrows both; other limits need two bars."""
    options = FigureOptions(width_mm=85.0, dpi=100)

    def found(*sizes: float, plain: bool = False) -> tuple[int, float]:
        panels = [seen_of(drawing(size)) for size in sizes]
        if plain:
            panels[1] = replace(panels[1], around=replace(panels[1].around, caption=None))
        figure = compose(panels, options)
        units = [text for text in figure.texts if text.get_text() == "mm"]
        images = [axes.get_position().width for axes in figure.axes if axes.images]
        return len(units), min(images)

    (one, wide), (two, narrow) = found(20.0, 20.0), found(20.0, 30.0)
    assert (one, two) == (1, 2)
    assert wide > 1.1 * narrow
    bars, beside = found(20.0, 20.0, plain=True)
    assert bars == 1
    assert beside < 0.95 * wide, "the bar of the first has its room there"


def test_a_legend_of_points_is_on_the_page_above_the_bar(qapp) -> None:
    panel = seen_of(drawing())
    rows = ("#d5530b", "excitatory"), ("#1b7a4b", "inhibitory")
    around = replace(panel.around, legend=PointLegend("type", rows))
    figure = compose([replace(panel, around=around)], FigureOptions(width_mm=85.0, dpi=100))
    boxes = {text.get_text(): text.get_window_extent() for text in figure.texts}
    (image,) = (axes.get_window_extent() for axes in figure.axes if axes.images)
    for name in ("type", "excitatory", "inhibitory"):
        assert image.x1 <= boxes[name].x0 < boxes[name].x1 <= figure.bbox.x1
        others = [box for text, box in boxes.items() if text not in (name, "")]
        assert not any(boxes[name].overlaps(other) for other in others)


def test_a_view_of_a_part_is_as_wide_as_on_the_screen(qapp) -> None:
    near = drawing()
    near.view = replace(near.view, half_size=5.0)
    assert seen_of(near, (800, 400)).shape == pytest.approx(0.5, abs=0.02)


def test_the_scale_bar_is_true(qapp, tmp_path: Path) -> None:
    """Without other annotations, the scale bar is compared with a ball of 40 mm in pixels."""
    options = FigureOptions(
        width_mm=100.0, dpi=254, title=False, color_bar=False, axes=False, pins=False
    )
    save_figure(compose_figure([drawing()], options), tmp_path / "a.png")
    pixels = np.asarray(opened(tmp_path / "a.png").convert("RGB")).astype(int)
    ink = abs(pixels - (0x1D, 0x23, 0x2B)).sum(axis=2) < 12
    rows = ink.sum(axis=1)
    bar = int(rows[-60:].max())
    colored = (pixels.max(axis=2) - pixels.min(axis=2) > 25).any(axis=0)
    ball = int(np.flatnonzero(colored)[-1] - np.flatnonzero(colored)[0] + 1)
    svg = tmp_path / "a.svg"
    save_figure(compose_figure([drawing()], options), svg)
    (length,) = re.findall(r">(\d+)\smm<", svg.read_text(encoding="utf-8"))
    assert bar / ball == pytest.approx(float(length) / 40.0, rel=0.03)


@pytest.mark.slow
def test_backgrounds(qapp, tmp_path: Path) -> None:
    corner = {}
    for background in ("white", "transparent", "window"):
        options = FigureOptions(background=background, dpi=72)
        save_figure(compose_figure([drawing()], options), tmp_path / "a.png")
        corner[background] = opened(tmp_path / "a.png").convert("RGBA").getpixel((1, 1))
    assert corner["white"] == (255, 255, 255, 255)
    assert corner["transparent"][3] == 0
    assert corner["window"][3] == 255
    assert corner["window"] != corner["white"]


@pytest.mark.parametrize(
    ("wrong", "code", "word"),
    [
        ({"width_mm": 0.0}, "out-of-range", "from 10 to 2000"),
        ({"width_mm": float("nan")}, "out-of-range", "from 10 to 2000"),
        ({"dpi": 5}, "out-of-range", "from 30 to 2400"),
        ({"font_points": 900.0}, "out-of-range", "from 3 to 72"),
        ({"width_mm": 2000.0, "dpi": 2400}, "picture-size", "wider than"),
    ],
)
def test_what_cannot_be_is_one_sentence(wrong: dict, code: str, word: str) -> None:
    with raises(code, word):
        FigureOptions(**wrong)


def test_text_without_room_and_unknown_endings_are_refused(qapp, tmp_path: Path) -> None:
    with raises("picture-size", "no room"):
        compose_figure([drawing()], FigureOptions(width_mm=12.0, font_points=12.0))
    with raises("unknown-ending", ".pdf"):
        save_figure(compose_figure([drawing()], FigureOptions(dpi=30)), tmp_path / "a.docx")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_command_line_writes_figures(qapp, tmp_path: Path) -> None:
    ball = shapes.icosphere(2)
    np.savez(tmp_path / "ball.npz", vertices=ball.vertices, faces=ball.faces)
    mesh, out = str(tmp_path / "ball.npz"), tmp_path / "out.pdf"
    wanted = ["render", mesh, "--field", "eigenfunction", "--index", "4", "--count", "8"]
    assert main([*wanted, "-o", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    png = tmp_path / "out.png"
    assert main([*wanted, "-o", str(png), "--width-mm", "85", "--dpi", "600"]) == 0
    with Image.open(png) as picture:
        assert picture.width == 2008
    assert main([*wanted, "-o", str(png), "--width-mm", "-3"]) == 2

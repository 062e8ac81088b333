"""What is written about a field: numbers, and where on the colour bar they belong."""

from __future__ import annotations

import pytest
from vtkmodules.vtkRenderingCore import vtkRenderer

from meshmash_viewer.app.view.colors import LIGHT, color_table
from meshmash_viewer.app.view.overlay import PARTS, Caption, ColorBar, Sheet
from meshmash_viewer.app.view.painter import Painter
from meshmash_viewer.app.view.text_layer import Block, Text


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_each_label_has_a_mark_at_its_place_on_the_bar(scale: float) -> None:
    painter = Painter(vtkRenderer(), PARTS)
    sheet = Sheet(painter, LIGHT, round(800 * scale), round(600 * scale), scale)
    caption = Caption("Eigenfunction 5", "λ", "nm⁻¹", -0.4, 1.3, color_table("viridis"))
    bar = ColorBar.on(sheet, caption)
    assert bar is not None
    painter.begin()
    painter.part("labels", None, lambda: bar.paint_labels(sheet))
    painter.end()
    items = painter._parts["labels"].texts
    texts = {item.text: item for item in items if isinstance(item, Text)}
    marks = [item for item in items if isinstance(item, Block)]
    assert len(marks) == len(bar.labels) >= 3
    for (value, text), mark in zip(bar.labels, marks, strict=True):
        place = bar.y + bar.height * (value + 0.4) / 1.7
        assert abs(mark.y + mark.height / 2 - place) <= 1.0
        assert abs(texts[text].y - place) <= 1.0
        assert bar.x < mark.x < mark.x + mark.width < texts[text].x
        assert (mark.width, mark.height) == (4 * scale, scale)


def test_a_mark_thinner_than_a_pixel_is_one_pixel_thick() -> None:
    painter = Painter(vtkRenderer(), PARTS)
    painter.begin()
    painter.part("labels", None, lambda: painter.block(10.2, 5.6, 4.4, 0.3, "#123456"))
    painter.end()
    assert painter._parts["labels"].texts == [Block(10, 6, 4, 1, "#123456")]

"""Texts, rectangles, polygons and strips in the annotations of a frame."""

from __future__ import annotations

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer


class Written:
    """Texts with their places, rectangles, and places of strips in a frame of a given size."""

    def __init__(self, drawing: MeshRenderer, size: tuple[int, int], scale: float = 1.0) -> None:
        self.texts: dict[str, tuple[float, float]] = {}
        self.rectangles: list[tuple[float, ...]] = []
        self.strips: list[tuple[float, ...]] = []
        self.polygons: list[list[float]] = []
        drawing.prepare(*size, scale)
        for line in drawing.annotations.texts:
            self.texts[line.text] = line.x, line.y
        for draw, arguments, *_ in drawing.annotations.shapes:
            if draw == "DrawRect":
                self.rectangles.append(arguments)
            elif draw == "DrawPolygon":
                self.polygons.append(arguments[0])
            elif draw == "DrawImage":
                x, y, image = arguments
                self.strips.append((x, y, *image.GetDimensions()[:2]))

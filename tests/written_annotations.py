"""What annotations paint, noted instead of painted."""

from __future__ import annotations

from vtkmodules.vtkRenderingContext2D import vtkBrush, vtkPen
from vtkmodules.vtkRenderingCore import vtkTextProperty

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer


class Written:
    """What a frame of a size has: texts with their places, rectangles, and places of strips."""

    def __init__(self, drawing: MeshRenderer, size: tuple[int, int], scale: float = 1.0) -> None:
        self.texts: dict[str, tuple[float, float]] = {}
        self.rectangles: list[tuple[float, ...]] = []
        self.strips: list[tuple[float, ...]] = []
        self.polygons: list[list[float]] = []
        pen, brush, look = vtkPen(), vtkBrush(), vtkTextProperty()
        self.GetPen, self.GetBrush, self.GetTextProp = lambda: pen, lambda: brush, lambda: look
        self.DrawEllipse = self.SetTransform = lambda *_: None
        drawing.prepare(*size, scale)
        drawing.annotations.Paint(None, self)

    def DrawString(self, x: float, y: float, text: str) -> None:
        self.texts[text] = x, y

    def DrawRect(self, *place: float) -> None:
        self.rectangles.append(place)

    def DrawPolygon(self, corners: list[float], _count: int) -> None:
        self.polygons.append(corners)

    def DrawImage(self, place, _image) -> None:
        self.strips.append((place.GetX(), place.GetY(), place.GetWidth(), place.GetHeight()))

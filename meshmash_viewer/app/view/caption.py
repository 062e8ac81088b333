"""Contents of the annotations of a render: caption of the field, legend of points, and pins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.style import ColorMap, color_table

if TYPE_CHECKING:  # slow to import, and not needed to draw a caption
    from meshmash_viewer.model.field import Field
    from meshmash_viewer.model.limits import Limits


@dataclass(frozen=True)
class Caption:
    """Title, unit, limits and colours of the displayed field."""

    title: str
    #: Second line, such as an eigenvalue or a time with its unit.
    quantity: str
    #: Unit of the values.
    unit: str
    low: float
    high: float
    colormap: ColorMap
    #: Whether some vertices have no value.
    missing: bool = False
    #: Whether colours follow the logarithm of the values.
    logarithmic: bool = False
    #: Whether there are values below the lower limit, and above the upper limit.
    beyond: tuple[bool, bool] = (False, False)
    #: Short formula of the values.
    formula: str = ""
    #: Distance between the values of level lines; 0 for zero lines alone, None for no lines.
    lines: float | None = None

    @property
    def table(self) -> npt.NDArray[np.uint8]:
        """Colours from the lower end to the upper, shape (256, 4)."""
        return color_table(self.colormap)


def caption_of(field: Field, limits: Limits, colormap: ColorMap, *, lined: bool) -> Caption:
    """Return the caption of a field; `lined` adds level lines."""
    return Caption(
        field.title,
        field.description(lined),
        field.unit,
        float(limits.low),
        float(limits.high),
        colormap,
        logarithmic=limits.logarithmic,
        beyond=field.beyond(limits),
        formula=field.family.definition,
        lines=field.line_spacing if lined else None,
    )


@dataclass(frozen=True)
class PointLegend:
    """Legend of the colours of points."""

    title: str
    #: Colour "#rrggbb" and text of each row, from above.
    rows: tuple[tuple[str, str], ...]
    #: Whether the colours are shades of a scale, drawn without gaps.
    graded: bool = False


@dataclass(frozen=True)
class Pin:
    """A marked vertex."""

    vertex: int
    #: Position in mesh coordinates.
    position: tuple[float, float, float]
    color: str
    label: str
    #: Whether the mesh hides the vertex.
    hidden: bool

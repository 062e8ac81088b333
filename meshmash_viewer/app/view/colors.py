"""Colours of the render: themes and tables of colour maps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps

from meshmash_viewer.errors import InputError

#: A name of one of matplotlib's colour maps, or the colours of labels 0, 1, 2 … as "#rrggbb".
ColorMap: TypeAlias = str | tuple[str, ...]

#: Colour of vertices without a value: a grey that no colour map has.
NAN_COLOR = "#8c8c8c"
#: Colour that is mixed into selected vertices.
SELECTION_COLOR = "#ff2bd6"


@dataclass(frozen=True)
class RenderTheme:
    """Colours around the field, as "#rrggbb"."""

    background_top: str
    background_bottom: str
    ink: str
    faint_ink: str
    surface: str
    line: str
    #: Of what faces inwards where the mesh is cut.
    inside: str
    halo: str

    def ground(self, share: float) -> tuple[float, ...]:
        """Red, green and blue of the background at a fraction of its height from below."""
        share = min(max(share, 0.0), 1.0)
        ends = zip(rgb(self.background_bottom), rgb(self.background_top), strict=True)
        return tuple(low + share * (high - low) for low, high in ends)


LIGHT = RenderTheme(
    background_top="#eef1f4",
    background_bottom="#cdd4dc",
    ink="#1d232b",
    faint_ink="#4d5762",
    surface="#b9c4d0",
    line="#14181d",
    inside="#6f7883",
    halo="#ffffff",
)
#: Lighter than the dark end of every sequential map: with a contrast of at least 1.5.
DARK = RenderTheme(
    background_top="#525963",
    background_bottom="#3f444b",
    ink="#f3f5f7",
    faint_ink="#c9d0d8",
    surface="#8d9aa8",
    line="#101317",
    inside="#79828d",
    halo="#ffffff",
)


@lru_cache(maxsize=64)
def rgb(color: str) -> tuple[float, float, float]:
    """Red, green and blue from 0 to 1 of "#rrggbb"."""
    return tuple(int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5))  # type: ignore[return-value]


@lru_cache(maxsize=32)
def color_table(name: ColorMap, count: int = 256) -> npt.NDArray[np.uint8]:
    """Colours of one of matplotlib's colour maps, or of labels, shape (count, 4), RGBA.

    Each of at most `count` labels has an equal part of the table.

    `InputError` is raised if there is no colour map of that name.
    """
    if isinstance(name, tuple):
        colors = np.array([[*rgb(each), 1.0] for each in name])
        places = np.arange(count) * len(name) // count
        # the middle of each part has exactly the colour of its label, however narrow it is
        places[((np.arange(len(name)) + 0.5) * count / len(name)).astype(int)] = range(len(name))
        labelled = np.round(255.0 * colors[places]).astype(np.uint8)
        labelled.setflags(write=False)
        return labelled
    if name not in colormaps:
        raise InputError(
            f"{name!r} is not a colour map of matplotlib; RdBu_r, viridis and magma are some."
        )
    table = colormaps[name].resampled(count)(np.arange(count), bytes=True)
    table.setflags(write=False)  # shared by the cache
    return np.asarray(table)

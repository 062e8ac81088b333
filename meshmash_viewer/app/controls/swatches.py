"""Colour maps that every kind of colour vision can read, and pictures of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from PySide6.QtGui import QIcon, QImage, QPixmap

__all__ = ["DIVERGING", "SEQUENTIAL", "swatch_icon"]

#: matplotlib's name to the name on the list. All keep their order in grey or in the three common
#: kinds of colour blindness (Brewer 2003, Moreland 2009; viridis and its family).
DIVERGING = {
    "RdBu_r": "Blue – red",
    "PuOr_r": "Purple – orange",
    "PRGn": "Purple – green",
    "BrBG_r": "Teal – brown",
    "coolwarm": "Cool – warm",
}
SEQUENTIAL = {
    "viridis": "Viridis",
    "cividis": "Cividis",
    "magma": "Magma",
    "inferno": "Inferno",
    "plasma": "Plasma",
    "YlGnBu_r": "Blue – yellow",
}


@lru_cache(maxsize=64)
def swatch_icon(name: str, width: int = 56, height: int = 12) -> QIcon:
    """A strip of a colour map, from its low end to its high one, as the icon of an entry.

    Parameters
    ----------
    name : str
        Of a matplotlib colour map.
    width, height : int
        In logical pixels; drawn at twice that.
    """
    from matplotlib import colormaps

    colors = colormaps[name](np.linspace(0.0, 1.0, 2 * width), bytes=True)
    pixels = np.ascontiguousarray(np.broadcast_to(colors, (2 * height, 2 * width, 4)))
    kind = QImage.Format.Format_RGBA8888
    image = QImage(pixels.data, 2 * width, 2 * height, 8 * width, kind)
    picture = QPixmap.fromImage(image)
    picture.setDevicePixelRatio(2.0)
    return QIcon(picture)

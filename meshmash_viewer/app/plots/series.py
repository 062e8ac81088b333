"""Curves of a plot as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Series:
    """A curve or points in the units of the labels of `Plot`; in the legend if it has a `color`."""

    name: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    color: str = ""

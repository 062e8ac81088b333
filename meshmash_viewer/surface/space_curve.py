"""Order of points along a space-filling curve."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def curve_order(points: npt.NDArray[np.floating]) -> npt.NDArray[np.int64]:
    """Return positions of points, shape (m, 3), along a curve through a grid (Morton 1966).

    They are below 2³⁰: ten interleaved bits of each coordinate, in a cube around all points.
    """
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    grid = ((points - low) * (1023.0 / extent)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        spread = grid[:, axis]
        # ten bits with two free places after each
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            spread = (spread | (spread << shift)) & mask
        code |= spread << axis
    return code

"""One piece of a mesh, as functions get it: a pair that knows of the whole."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["Piece"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]


class Piece(tuple[FloatArray, IntArray]):
    """``(vertices, faces)`` of a piece, the indices of `faces` counted within it.

    Attributes
    ----------
    first : ndarray of float64, shape (n_i,)
        Square of the first eigenvector of the whole mesh at the vertices of the piece: one over
        the area of the component that it is constant on, and 0 on all others.
    """

    first: FloatArray

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray, first: FloatArray) -> Piece:
        """Make one of its arrays."""
        piece = cls((vertices, faces))
        piece.first = first
        return piece

"""A piece of a mesh, the argument of functions that `MeshStitcher` applies."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]


class Piece(tuple[FloatArray, IntArray]):
    """``(vertices, faces)`` of a piece, with `faces` as indices into its vertices.

    Attributes
    ----------
    first : ndarray of float64, shape (n_i,)
        Square of the first eigenvector of the whole mesh at the vertices of the piece: one over
        the area of the first component there, and 0 on all others.
    """

    first: FloatArray

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray, first: FloatArray) -> Piece:
        """Create a piece from its arrays."""
        piece = cls((vertices, faces))
        piece.first = first
        return piece

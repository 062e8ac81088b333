"""Correspondence between the vertices of a mesh file and those of the repaired mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class FileNumbering:
    """Map from the vertices of a file to those of a repaired mesh.

    Examples
    --------
    >>> from meshmash_viewer.numbering import FileNumbering
    >>> numbering = FileNumbering(np.array([-1, 0, 1, 0]))
    >>> numbering.in_file, numbering.whole(np.array([0.5, 0.25]))
    (array([1, 2]), array([ nan, 0.5 , 0.25, 0.5 ]))
    """

    #: Shape (n_file,): For each vertex of the file its vertex in the mesh, the same one for merged
    #: vertices; -1 for removed ones.
    here: npt.NDArray[np.int64]

    @property
    def n_file(self) -> int:
        """Number of vertices of the file."""
        return len(self.here)

    @cached_property
    def in_file(self) -> npt.NDArray[np.int64]:
        """For each vertex of the mesh its index in the file, the lowest of merged ones, (n,)."""
        indices = np.flatnonzero(self.here >= 0)[::-1]
        result = np.zeros(int(self.here.max(initial=-1)) + 1, dtype=np.int64)
        # for merged vertices the last assignment remains, that of the lowest index
        result[self.here[indices]] = indices
        return result

    def then(self, here: npt.NDArray[np.int64]) -> FileNumbering:
        """Compose with another repair, given by its map from the mesh before it."""
        return FileNumbering(np.where(self.here >= 0, here[self.here], -1))

    def whole(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Expand values of shape (n, ...) to the vertices of the file, NaN at removed ones.

        Merged vertices have the same value. Integers become float64.
        """
        kind = values.dtype if values.dtype.kind == "f" else np.dtype(np.float64)
        result = np.full((self.n_file, *values.shape[1:]), np.nan, dtype=kind)
        left = self.here >= 0
        result[left] = values[self.here[left]]
        return result

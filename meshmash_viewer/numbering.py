"""The vertices of a mesh by the numbers that they have in its file, whatever was repaired since."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class FileNumbering:
    """What the vertices of a file have become in a repaired mesh.

    Parameters
    ----------
    here : ndarray of int64, shape (n_file,)
        For each vertex of the file the vertex of the mesh that it is now, the same one for
        vertices that were merged; -1 for those that were left out.

    Examples
    --------
    >>> from meshmash_viewer.numbering import FileNumbering
    >>> numbering = FileNumbering(np.array([-1, 0, 1, 0]))
    >>> numbering.in_file, numbering.whole(np.array([0.5, 0.25]))
    (array([1, 2]), array([ nan, 0.5 , 0.25, 0.5 ]))
    """

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
        result[self.here[indices]] = indices  # of those written twice the last one stays
        return result

    def then(self, here: npt.NDArray[np.int64]) -> FileNumbering:
        """The same after another repair, of which `here` is as above, for the mesh before it."""
        return FileNumbering(np.where(self.here >= 0, here[self.here], -1))

    def whole(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Values of shape (n, ...) at the vertices of the file, NaN where the mesh has none.

        Merged vertices have that of the vertex that they became. Whole numbers become float64.
        """
        kind = values.dtype if values.dtype.kind == "f" else np.dtype(np.float64)
        result = np.full((self.n_file, *values.shape[1:]), np.nan, dtype=kind)
        left = self.here >= 0
        result[left] = values[self.here[left]]
        return result

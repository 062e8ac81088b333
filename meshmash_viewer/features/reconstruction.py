"""The coordinates of a mesh as a sum over its lowest eigenfunctions, which a slider lengthens."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.map_spectrum import inner_products, partial_sum
from meshmash_viewer.mesh import Mesh

FloatArray: TypeAlias = npt.NDArray[np.float64]

#: Pairs that are added at a time: some hundredths of a second at a million vertices.
_STEP = 8


class Reconstruction:
    """``Φ_k Φ_kᵀ M v`` for the vertices v, moved from one number of pairs to another.

    The null space carries the centre of mass of each component exactly. It is taken off first,
    which gives the same sum with no digits lost to an origin far away, and leaves each component
    in its place where there are more of them than pairs.

    Parameters
    ----------
    mesh : Mesh
    rows : array_like, shape (>= k, n)
        Eigenvectors, one a row; they may lie in a file.
    mass : ndarray of float64, shape (n,)
        The areas that they are orthonormal with; 0 at vertices that no face has.
    """

    def __init__(self, mesh: Mesh, rows: Any, mass: FloatArray) -> None:
        self._mesh, self._rows = mesh, rows
        self._used = used = mass > 0.0
        labels = mesh.component_labels[used]
        self._mass = np.where(used, mass, 0.0)
        total = np.bincount(labels, weights=mass[used])
        vertices = mesh.vertices[used].T
        centres = np.stack([np.bincount(labels, mass[used] * axis) / total for axis in vertices])
        #: Where the centre of its component is, and how far each vertex is from it.
        self._centres = mesh.vertices.T.copy()
        self._centres[:, used] = centres[:, labels]
        self._offsets = mesh.vertices.T - self._centres
        self._coefficients = np.zeros((3, 0))
        self._sum = np.zeros(self._offsets.shape)
        #: How many pairs are in the sum.
        self.count = 0

    def move_to(self, count: int) -> Iterator[None]:
        """Add pairs, or take them off, until there are `count`; each step leaves a whole sum."""
        while self.count != count:
            step = min(max(count - self.count, -_STEP), _STEP)
            first, last = sorted((self.count, self.count + step))
            known = self._coefficients.shape[1]
            if last > known:
                weighted = self._offsets * self._mass
                more = inner_products(self._rows, weighted, self._used, known, last)
                self._coefficients = np.concatenate([self._coefficients, more], axis=1)
            change = partial_sum(self._rows, self._coefficients, first, last)
            if not self._used.all():
                change[:, ~self._used] = 0.0
            if step > 0:
                self._sum += change
            else:
                self._sum -= change
            self.count += step
            yield

    @property
    def vertices(self) -> FloatArray:
        """The vertices from the pairs in the sum, shape (n, 3), in the unit of the mesh.

        Those that no face has stay where they are.
        """
        return np.ascontiguousarray((self._centres + self._sum).T)

    @property
    def rms_distance(self) -> float:
        """Root mean square, over the area, of how far the surface is from where it was."""
        left = np.square(self._offsets - self._sum).sum(axis=0)
        return float(np.sqrt(left @ self._mass / self._mass.sum()))

"""Reconstruction of the coordinates of a mesh from its lowest eigenfunctions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.map_spectrum import inner_products, partial_sum
from meshmash_viewer.mesh import Mesh

FloatArray: TypeAlias = npt.NDArray[np.float64]

#: Pairs added at a time: some hundredths of a second at a million vertices.
_STEP = 8


class Reconstruction:
    """The sum ``Φ_k Φ_kᵀ M v`` for the vertices v, updated when the number of pairs changes.

    The null space represents the centre of mass of each component exactly. It is subtracted first,
    which avoids cancellation far from the origin, and keeps each component at its position even if
    there are more components than pairs.

    `rows` are eigenvectors, shape (>= k, n), and may be a memory map; `mass`, shape (n,), is 0 at
    unreferenced vertices.
    """

    def __init__(self, mesh: Mesh, rows: Any, mass: FloatArray) -> None:
        self._mesh, self._rows = mesh, rows
        self._used = used = mass > 0.0
        labels = mesh.component_labels[used]
        self._mass = np.where(used, mass, 0.0)
        total = np.bincount(labels, weights=mass[used])
        vertices = mesh.vertices[used].T
        centres = np.stack([np.bincount(labels, mass[used] * axis) / total for axis in vertices])
        # centre of the component of each vertex, and offset of the vertex from it
        self._centres = mesh.vertices.T.copy()
        self._centres[:, used] = centres[:, labels]
        self._offsets = mesh.vertices.T - self._centres
        self._coefficients = np.zeros((3, 0))
        self._sum = np.zeros(self._offsets.shape)
        #: Number of pairs in the sum.
        self.count = 0

    def move_to(self, count: int) -> Iterator[None]:
        """Add or subtract pairs until there are `count`; the sum is valid after each step."""
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
        """Reconstructed vertices, shape (n, 3), in the unit of the mesh.

        Unreferenced vertices are unchanged.
        """
        return np.ascontiguousarray((self._centres + self._sum).T)

    @property
    def rms_distance(self) -> float:
        """Area-weighted root mean square distance between reconstructed and original vertices."""
        left = np.square(self._offsets - self._sum).sum(axis=0)
        return float(np.sqrt(left @ self._mass / self._mass.sum()))

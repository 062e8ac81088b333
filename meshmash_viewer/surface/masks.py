"""Masks of vertices on a surface: grown, shrunk, without holes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.mesh import Mesh

#: Which vertices, shape (n,).
Mask: TypeAlias = npt.NDArray[np.bool_]


def grown(mesh: Mesh, mask: Mask) -> Mask:
    """Add the neighbours of the vertices of a mask."""
    a, b, c = (mask[mesh.faces[:, corner]] for corner in range(3))
    result = mask.copy()
    result[mesh.faces[(a | b | c) & ~(a & b & c)]] = True
    return result


def shrunk(mesh: Mesh, mask: Mask) -> Mask:
    """Leave out the vertices with a neighbour outside the mask."""
    return ~grown(mesh, ~mask)


def parts(mesh: Mesh, mask: Mask) -> IntArray:
    """Number the connected parts of a mask from 0, shape (n,); -1 outside."""
    from meshmash_viewer.surface.kernels import parts_of

    return np.asarray(parts_of(mesh.faces, mask))


def filled(mesh: Mesh, mask: Mask) -> Mask:
    """Add the parts of the surface that the mask separates from the largest one.

    In each connected component of the mesh the part outside the mask with the largest area stays
    outside. Components without a vertex in the mask stay outside as well.
    """
    components = mesh.component_labels
    outside = ~mask & (components >= 0)
    part = parts(mesh, outside)
    if part.max() < 0:
        return mask
    areas = np.bincount(part[outside], mesh.vertex_areas[outside])
    of_part = np.zeros(len(areas), dtype=np.int64)  # its component
    of_part[part[outside]] = components[outside]
    largest = np.zeros(int(components.max()) + 1, dtype=np.int64)
    order = np.argsort(areas, kind="stable")
    largest[of_part[order]] = order  # the last assignment remains, that of the largest
    stays = np.isin(np.arange(len(areas)), largest[np.unique(of_part)])
    result = mask.copy()
    result[outside] = ~stays[part[outside]]
    return result

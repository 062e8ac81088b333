"""Meshes as layers of napari, without napari."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import MeshLike, as_mesh

__all__ = ["to_napari"]


def to_napari(
    mesh: MeshLike, field: npt.ArrayLike | None = None
) -> tuple[tuple[npt.NDArray[Any], ...], dict[str, Any], str]:
    """A mesh as the layer tuple that napari takes.

    Parameters
    ----------
    mesh : MeshLike
    field : array_like, shape (n,), optional
        A value for each vertex; NaN has no colour.

    Returns
    -------
    tuple
        Data ``(vertices, faces)`` or ``(vertices, faces, values)``, options and "surface".
        Coordinates are turned round, to (z, y, x), as the axes of images in napari are.

    Raises
    ------
    InputError
        If there is not one value for each vertex.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(3)
    >>> data, options, kind = mv.to_napari(ball, ball.vertices[:, 2])
    >>> kind, len(data)
    ('surface', 3)
    """
    mesh = as_mesh(mesh)
    options: dict[str, Any] = {"metadata": {"unit": mesh.unit}, "shading": "smooth"}
    if mesh.name:
        options["name"] = mesh.name
    data: tuple[npt.NDArray[Any], ...] = (mesh.vertices[:, ::-1].copy(), mesh.faces.copy())
    if field is None:
        return data, options, "surface"
    values = np.array(field, dtype=np.float64)
    if values.shape != (mesh.n_vertices,):
        raise InputError(
            f"A field of shape {values.shape} does not go with {mesh.n_vertices:,} vertices: give"
            " one value for each."
        )
    finite = values[np.isfinite(values)]
    if len(finite) and finite.min() < finite.max():
        options["contrast_limits"] = (float(finite.min()), float(finite.max()))
    options["colormap"] = "viridis"
    return (*data, values), options, "surface"

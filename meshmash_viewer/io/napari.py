"""Meshes as layers of napari, without napari."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.vertex_map import VertexMap

#: Of vertices without a label, RGBA.
_NO_LABEL = (0.7, 0.7, 0.7, 1.0)


def to_napari(
    mesh: MeshLike, field: npt.ArrayLike | VertexMap | None = None
) -> tuple[tuple[npt.NDArray[Any], ...], dict[str, Any], str]:
    """A mesh as the layer tuple that napari takes.

    `InputError` is raised if there is not one value for each vertex.

    Parameters
    ----------
    mesh : MeshLike
    field : array_like, shape (n,), or VertexMap, optional
        A value for each vertex; NaN has no colour. Labels give each vertex the colour of its own,
        their names are in ``metadata["labels"]`` by their numbers; napari's own layers of labels
        are of images only.

    Returns
    -------
    tuple
        Data ``(vertices, faces)`` or ``(vertices, faces, values)``, options and "surface".
        Coordinates are in reverse order, (z, y, x), as the axes of images in napari are. A mesh
        with a unit has it as ``units`` of its three axes, which napari knows since 0.5.

    Examples
    --------
    >>> data, options, kind = mv.to_napari(ball, ball.vertices[:, 2])
    >>> kind, len(data)
    ('surface', 3)
    """
    mesh = as_mesh(mesh)
    options: dict[str, Any] = {"metadata": {"unit": mesh.unit}, "shading": "smooth"}
    if mesh.name:
        options["name"] = mesh.name
    if mesh.unit:
        options["units"] = (mesh.unit,) * 3
    data: tuple[npt.NDArray[Any], ...] = (mesh.vertices[:, ::-1].copy(), mesh.faces.copy())
    if field is None:
        return data, options, "surface"
    known = field if isinstance(field, VertexMap) else None
    values = np.array(field if known is None else known.values, dtype=np.float64)
    if values.shape != (mesh.n_vertices,):
        raise InputError(
            f"A field of shape {values.shape} does not go with {mesh.n_vertices:,} vertices: give"
            " one value for each."
        )
    if known is not None and known.labels:
        options["metadata"]["labels"] = {label.key: label.name for label in known.labels}
        options["vertex_colors"] = _colors(known)
        return (*data, values), options, "surface"
    finite = values[np.isfinite(values)]
    if len(finite) and finite.min() < finite.max():
        options["contrast_limits"] = (float(finite.min()), float(finite.max()))
    options["colormap"] = "viridis"
    return (*data, values), options, "surface"


def _colors(labelled: VertexMap) -> npt.NDArray[np.float32]:
    """RGBA of the label of each vertex, shape (n, 4)."""
    table = [
        (*(int(label.color[at : at + 2], 16) / 255.0 for at in (1, 3, 5)), 1.0)
        for label in labelled.labels
    ]
    places = np.nan_to_num(labelled.shown, nan=len(table)).astype(np.int64)
    return np.array([*table, _NO_LABEL], dtype=np.float32)[places]

"""Writing of label sets, and of tables of regions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.write import mesh_arrays, write_table
from meshmash_viewer.io.writers import FeatureTable
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.vertex_map import COLOR, VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.features.regions import Regions


def write_regions(path: str | Path, table: Regions, meta: dict[str, Any] | None = None) -> None:
    """Write a table with a row per region, as CSV, Parquet or NPZ.

    The columns of `regions` are followed by ``unit``, the unit of lengths: areas are in its square,
    volumes in its cube. `meta` are JSON-able options of the computation, or a result of
    `provenance`.

    `InputError` is raised if the path has none of the endings of `SPECTRUM_WRITERS`, or the file
    cannot be written.

    Examples
    --------
    >>> cap = mv.regions(ball, ball.vertices[:, 2] > 0.5, neck=False)
    >>> write_regions(folder / "cap.csv", cap)
    >>> (folder / "cap.csv").read_text().splitlines()[0]
    '"label","part","vertices","area","volume","loops","extent","x","y","z","unit"'
    """
    columns = {**table.columns, "unit": np.full(len(table), table.mesh.unit)}
    made = FeatureTable(table.mesh, columns, archive_is_table=True)
    options = {
        "kind": "regions",
        "units": {name: table.unit_of(name) for name in table.columns},
        "remarks": list(table.remarks),
    }
    write_table(path, "regions", made, options, meta)


def write_labels(
    path: str | Path, labels: VertexMap, mesh: MeshLike, meta: dict[str, Any] | None = None
) -> None:
    """Write a label set with names and colours to a file, for `read_labels` and other programs.

    ``.label.gii`` and ``.npz`` files have all labels, as have ``.ply`` files in comments. ``.csv``
    has a row per vertex with the columns ``vertex``, ``label``, ``name`` and ``color``, so labels
    without a vertex are lost. ``.annot`` numbers the labels from 0 and distinguishes them by
    colour: a black label, or a label with the colour of another, gets the next free colour.
    ``.label`` has the vertices of a single label, without its name and colour. PLY and NPZ contain
    the mesh; other files have a value for each vertex of the mesh file. `meta` are JSON-able
    options of the computation, or a result of `provenance`.

    `InputError` is raised if the path has none of the endings of `LABEL_WRITERS`, the labels are of
    another mesh or missing, or the format does not support them.

    Examples
    --------
    >>> names = (mv.Label(1, "north", "#4477aa"), mv.Label(2, "south", "#ee6677"))
    >>> halves = mv.VertexMap("half", np.where(ball.vertices[:, 2] > 0, 1, 2), names)
    >>> mv.write_labels(folder / "half.annot", halves, ball)
    >>> [label.name for label in mv.read_labels(folder / "half.annot", ball).labels]
    ['north', 'south']
    """
    surface = as_mesh(mesh)
    known = surface.with_only_maps(labels).maps[0]
    _check_labels(known)
    numbers = np.where(np.isnan(known.shown), known.no_label, known.values).astype(np.int64)
    names, keys = [each.name for each in known.labels], [each.key for each in known.labels]
    colors = [each.color for each in known.labels]
    has_mesh = str(path).lower().endswith((".npz", ".ply"))
    archive: dict[str, npt.NDArray[Any]] = {
        "labels": numbers,
        "label_numbers": np.array(keys),
        "label_names": np.array(names),
        "label_colors": np.array(colors),
        **mesh_arrays(surface),
    }
    if not has_mesh:
        whole = surface.on_file(numbers.astype(np.float64))
        numbers = np.nan_to_num(whole, nan=known.no_label).astype(np.int64)
        places = np.nan_to_num(VertexMap("", numbers, known.labels).shown, nan=-1.0).astype(int)
        archive = {
            "vertex": np.arange(len(numbers)),
            "label": numbers,
            "name": np.array([*names, None], dtype=object)[places],
            "color": np.array([*colors, None], dtype=object)[places],
        }
    table = FeatureTable(
        surface, archive, (known.name,), numbers[:, np.newaxis],
        labels=known.labels, archive_is_table=not has_mesh,
    )  # fmt: skip
    options = {"kind": "labels", "unlabelled": known.no_label}
    write_table(path, "labels", table, options, meta)


def _check_labels(known: VertexMap) -> None:
    """Raise `InputError` for labels that cannot be written."""
    if not known.labels:
        fault = f"Map {known.name!r} has no labels"
        raise InputError("no-labels", fault, "give it some, as VertexMap(name, values, labels)")
    for label in known.labels:
        if not -(2**31) <= label.key < 2**31:
            fault = f"Label {label.name!r} has number {label.key}"
            raise InputError("out-of-range", fault, "give a smaller one")
        if not COLOR.fullmatch(label.color):
            fault = f"Label {label.name!r} has the colour {label.color!r}"
            raise InputError("wrong-color", fault, "write it as #rrggbb")

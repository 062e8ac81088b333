"""GIFTI surfaces and maps, by nibabel; coordinates are in millimetres."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.provenance import stated_mesh
from meshmash_viewer.io.raw import MOST_MAPS, RawMap, RawMesh, maps_alone
from meshmash_viewer.vertex_map import Label


def read_gifti(path: Path) -> RawMesh:
    """Read the point set and triangles of a GIFTI surface.

    `InputError` is raised if one of the two is absent, or an array is not what its attributes say.
    """
    image = _gifti(path)
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = image.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if not points or not triangles:
        raise InputError(
            "holds no surface (a GIFTI surface has a point set and triangles;"
            " functional and label files have neither)"
        )
    if len(points) > 1 or len(triangles) > 1:
        raise InputError(
            f"holds {len(points)} point sets and {len(triangles)} sets of triangles, and does not"
            " say which is the surface: write each surface to a file of its own."
        )
    vertices, faces = points[0].data, triangles[0].data
    if vertices is None or faces is None:
        raise InputError("has a point set or triangles without data")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"has arrays of shapes {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise InputError("has triangles whose vertex indices are no whole numbers")
    said = _said(image)
    return RawMesh(
        np.asarray(vertices, dtype=np.float64),
        faces.astype(np.int64),
        "" if stated_mesh(said)[0] == "" else "mm",
        tuple(_gifti_maps(image))[:MOST_MAPS],
        structure=_structure(points[0]) or _structure(image),
        meta=said,
    )


def _said(image: Any) -> str:
    return str(dict(image.meta or {}).get("meshmash-viewer", ""))


def _structure(described: Any) -> str:
    return printable(dict(described.meta or {}).get("AnatomicalStructurePrimary", ""), 60)


def gifti_maps(path: Path) -> RawMesh:
    """Read the arrays of a GIFTI file with one number a vertex, labels with their table."""
    image = _gifti(path)
    return maps_alone(_gifti_maps(image, path.name), meta=_said(image))


def _gifti(path: Path) -> Any:
    from xml.parsers.expat import ExpatError

    from nibabel.gifti import parse_gifti_fast

    content = path.read_bytes()
    if many := re.search(rb"Dimensionality\s*=\s*.\s*(\d{2,})", content):  # nibabel looks for all
        raise InputError(f"has an array of {printable(many[1].decode(), 20)} dimensions")
    untyped: Any = parse_gifti_fast
    parser = untyped.GiftiImageParser()
    try:
        with path.open("rb") as file:  # its name is where external data are looked for
            parser.parse(fptr=file)
    except ExpatError as fault:
        raise InputError(f"is not the XML of a GIFTI file ({printable(fault)})") from fault
    if parser.img is None:
        raise InputError("is not a GIFTI file")
    return parser.img


def _gifti_maps(image: Any, name: str = "") -> Iterator[RawMap]:
    """Every array that is neither the points nor the triangles; numbered if it has no name."""
    from nibabel.nifti1 import intent_codes

    table = tuple(
        Label(int(each.key), str(each.label), _hexadecimal(each.rgba))
        for each in image.labeltable.labels
        if each.key != 0 or each.alpha != 0.0  # as Connectome Workbench has what has no label
    )
    for at, array in enumerate(image.darrays):
        intent = intent_codes.niistring[array.intent]
        data = array.data
        if intent in ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE") or data is None:
            continue
        alone = len(image.darrays) == 1
        own_name = dict(array.meta or {}).get("Name") or (
            "" if alone else f"{name} {at}" if name else f"map {at}"
        )
        labels = table if intent == "NIFTI_INTENT_LABEL" else ()
        own = "meshmash-viewer" in dict(image.meta or {})
        columns = [data] if data.ndim == 1 else list(data.T) if data.ndim == 2 else []
        for column in columns:
            yield RawMap(own_name, np.ascontiguousarray(column), labels, keep_unused=own)


def _hexadecimal(rgba: Any) -> str:
    """A colour from shares of red, green and blue; grey where a file does not say."""
    shares = [0.5 if share is None else min(max(float(share), 0.0), 1.0) for share in rgba[:3]]
    return "#" + "".join(f"{round(255 * share):02x}" for share in shares)

"""Brain surfaces: GIFTI and FreeSurfer, by nibabel; both are in millimetres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh

__all__ = ["FREESURFER_ENDINGS", "read_freesurfer", "read_gifti"]

#: What surfaces are called in a FreeSurfer subject's ``surf`` folder, after "lh" or "rh".
FREESURFER_ENDINGS = (
    ".pial",
    ".white",
    ".inflated",
    ".sphere",
    ".orig",
    ".smoothwm",
    ".midthickness",
    ".nofix",
    ".fsurf",
)


def read_gifti(path: Path) -> RawMesh:
    """Read the point set and triangles of a GIFTI surface.

    Raises
    ------
    InputError
        If one of the two is absent.
    """
    import nibabel
    from nibabel.gifti.gifti import GiftiImage

    image = nibabel.load(path)
    if not isinstance(image, GiftiImage):
        raise InputError("is not a GIFTI file")
    surface: Any = image
    points = surface.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = surface.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if not points or not triangles:
        raise InputError(
            "holds no surface (a GIFTI surface has a point set and triangles;"
            " functional and label files have neither)"
        )
    vertices = np.asarray(points[0].data, dtype=np.float64)
    faces = np.asarray(triangles[0].data)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"has arrays of shapes {vertices.shape} and {faces.shape}")
    return RawMesh(vertices, faces.astype(np.int64), "mm")


def read_freesurfer(path: Path) -> RawMesh:
    """Read a FreeSurfer surface (triangle or quadrangle file).

    Raises
    ------
    InputError
        If the file does not begin like one.
    """
    from nibabel.freesurfer.io import read_geometry

    with path.open("rb") as file:
        magic = file.read(3)
    if magic not in (b"\xff\xff\xfe", b"\xff\xff\xff", b"\xff\xff\xfd"):
        raise InputError("does not begin like a FreeSurfer surface")
    read: Any = read_geometry
    vertices, faces = read(str(path))[:2]
    return RawMesh(
        np.asarray(vertices, dtype=np.float64).reshape(-1, 3),
        np.asarray(faces, dtype=np.int64).reshape(-1, 3),
        "mm",
    )

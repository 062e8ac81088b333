"""Features, eigenpairs and pictures to files, each with how it was made.

Every file is written beside its place and renamed, so a failure leaves an older one whole. NPZ,
Parquet, VTP, PLY, GIFTI and PNG carry their provenance inside; NPY and CSV have a ``.json`` beside
them, "features.npy.json" for "features.npy".
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.provenance import provenance

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition
    from meshmash_viewer.features import Features
    from meshmash_viewer.mesh import Mesh

__all__ = [
    "EIGENPAIR_WRITERS",
    "WRITERS",
    "FeatureTable",
    "check_output",
    "provenance",
    "write_eigenpairs",
    "write_features",
    "write_picture",
]


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """All that a writer of features can put into a file.

    Parameters
    ----------
    values : ndarray, shape (n, f)
    columns : tuple of str
    mesh : Mesh
    eigenvalues : ndarray of float64, shape (k,)
        Of the pairs that the features were made of; empty if not given.
    meta : str
        Provenance, one line of JSON.
    """

    values: npt.NDArray[Any]
    columns: tuple[str, ...]
    mesh: Mesh
    eigenvalues: npt.NDArray[np.float64]
    meta: str


FeatureWriter: TypeAlias = Callable[[Path, FeatureTable], None]
EigenpairWriter: TypeAlias = Callable[[Path, "Decomposition", "Mesh", str], None]


def write_features(
    path: str | Path,
    features: Features,
    mesh: Mesh,
    *,
    eigenvalues: npt.ArrayLike | None = None,
    meta: dict[str, Any] | None = None,
) -> None:
    """Write feature columns in the format that the file's ending names.

    Parameters
    ----------
    path : str or Path
        A file with one of the endings of `WRITERS`.
    features : Features
        Values of shape (n, f), one row a vertex.
    mesh : Mesh
        The mesh they belong to.
    eigenvalues : array_like, shape (k,), optional
        Of the pairs that took part; kept where the format has room (NPZ).
    meta : dict, optional
        JSON-able options that led to the features, or what `provenance` made of them.

    Raises
    ------
    InputError
        If the ending is unknown, the rows do not go with the mesh, or the system refuses.
    """
    path = Path(path)
    writer = _writer(WRITERS, path, "features")
    if len(features.values) != mesh.n_vertices:
        raise InputError(
            f"Features of {len(features.values)} rows do not go with a mesh of"
            f" {mesh.n_vertices} vertices: give one row a vertex."
        )
    # Where the options have nothing to say of it, the features speak for themselves.
    said = {"kind": features.kind, "values_unit": features.unit, **features.meta}
    made = json.dumps(_made(mesh, said, meta) | {"columns": list(features.columns)})
    values = np.zeros(0) if eigenvalues is None else np.asarray(eigenvalues, dtype=np.float64)
    table = FeatureTable(features.values, features.columns, mesh, values, made)
    with writing_errors(path), _with_note(path, made) as part:
        writer(part, table)


def write_eigenpairs(
    path: str | Path, decomposition: Decomposition, mesh: Mesh, meta: dict[str, Any] | None = None
) -> None:
    """Write eigenvalues and eigenvectors with their proof, as NPZ or VTP.

    Parameters
    ----------
    path : str or Path
        A file with one of the endings of `EIGENPAIR_WRITERS`.
    decomposition : Decomposition
    mesh : Mesh
    meta : dict, optional
        JSON-able options that led to it, or what `provenance` made of them.

    Raises
    ------
    InputError
        If the ending is unknown or the system refuses.
    """
    path = Path(path)
    writer = _writer(EIGENPAIR_WRITERS, path, "eigenpairs")
    said = {"kind": "eigenpairs", "proof": decomposition.proof(mesh.unit)}
    made = json.dumps(_made(mesh, said, meta))
    with writing_errors(path), written_whole(path) as part:
        writer(part, decomposition, mesh, made)


def write_picture(
    path: str | Path, pixels: npt.NDArray[np.uint8], meta: dict[str, Any] | None = None
) -> None:
    """Write pixels as PNG, with provenance as text where it is given.

    Parameters
    ----------
    path : str or Path
        Ends in ".png".
    pixels : ndarray of uint8, shape (height, width, 3 or 4)
        RGB or RGBA, first row on top.
    meta : dict, optional
        JSON-able; see `provenance`.

    Raises
    ------
    InputError
        If the ending is another one or the system refuses.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"{path} is not the name of a picture; give it the ending .png.")
    about = PngInfo()
    about.add_text("Software", "meshmash-viewer")
    if meta:
        about.add_itxt("meshmash-viewer", json.dumps(meta))
    with writing_errors(path), written_whole(path) as part:
        image = Image.fromarray(np.ascontiguousarray(pixels))
        image.save(part, format="PNG", pnginfo=about)


def _made(mesh: Mesh, said: dict[str, Any], meta: dict[str, Any] | None) -> dict[str, Any]:
    """Provenance with what the result says of itself, and over it the options given."""
    given = meta or {}
    whole = given if {"program", "mesh", "options"} <= given.keys() else provenance(mesh, given)
    return {**whole, "options": {**said, **whole["options"]}}


def check_output(path: str | Path, kind: str = "features") -> None:
    """See, before a long computation, that its result can be written.

    Parameters
    ----------
    path : str or Path
    kind : "features", "eigenpairs" or "picture"

    Raises
    ------
    InputError
        If the ending is unknown, there is no such folder, or it may not be written to.
    """
    path = Path(path)
    tables: dict[str, dict[str, Any]] = {
        "features": WRITERS,
        "eigenpairs": EIGENPAIR_WRITERS,
        "picture": {".png": write_picture},
    }
    _writer(tables[kind], path, "pictures" if kind == "picture" else kind)
    with writing_errors(path):
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(13, "Permission denied")


def _writer(table: dict[str, Any], path: Path, what: str) -> Any:
    name = path.name.lower()
    for ending in sorted(table, key=len, reverse=True):  # .func.gii before .gii
        if name.endswith(ending) and len(name) > len(ending):
            return table[ending]
    raise InputError(
        f"{path} has no ending in which {what} can be written; give it one of {' '.join(table)}."
    )


@contextlib.contextmanager
def _with_note(path: Path, made: str) -> Iterator[Path]:
    """Write `path`, and for formats without room the provenance in a file beside it."""
    if path.suffix.lower() not in _NOTED:
        with written_whole(path) as part:
            yield part
        return
    with written_whole(path.with_name(path.name + ".json")) as note, written_whole(path) as part:
        note.write_text(json.dumps(json.loads(made), indent=1) + "\n", encoding="utf-8")
        yield part


# Features, one function a format --------------------------------------------------------------


def _features_npz(path: Path, table: FeatureTable) -> None:
    with path.open("wb") as file:
        np.savez(
            file,
            features=table.values,
            columns=np.array(table.columns),
            eigenvalues=table.eigenvalues,
            vertices=table.mesh.vertices,
            faces=table.mesh.faces,
            meta=np.array(table.meta),
        )


def _features_npy(path: Path, table: FeatureTable) -> None:
    with path.open("wb") as file:
        np.save(file, np.ascontiguousarray(table.values))


def _arrow_table(table: FeatureTable) -> Any:
    import pyarrow

    names = ["vertex", *table.columns]
    arrays = [pyarrow.array(np.arange(len(table.values)))]
    arrays += [pyarrow.array(np.ascontiguousarray(column)) for column in table.values.T]
    return pyarrow.table(arrays, names=names)


def _features_csv(path: Path, table: FeatureTable) -> None:
    import pyarrow.csv

    options = pyarrow.csv.WriteOptions(quoting_style="needed")
    pyarrow.csv.write_csv(_arrow_table(table), str(path), options)


def _features_parquet(path: Path, table: FeatureTable) -> None:
    import pyarrow.parquet

    content = _arrow_table(table).replace_schema_metadata({"meshmash-viewer": table.meta})
    pyarrow.parquet.write_table(content, str(path))


def _features_vtp(path: Path, table: FeatureTable) -> None:
    columns = zip(table.columns, table.values.T, strict=True)
    _write_vtp(path, table.mesh, columns, {}, table.meta)


def _features_ply(path: Path, table: FeatureTable) -> None:
    names = _property_names(table.columns)
    vertex = np.dtype([(axis, "<f8") for axis in "xyz"] + [(name, "<f4") for name in names])
    records = np.empty(len(table.values), dtype=vertex)
    for axis, coordinates in zip("xyz", table.mesh.vertices.T, strict=True):
        records[axis] = coordinates
    for name, column in zip(names, table.values.T, strict=True):
        records[name] = column
    triangles = np.empty(table.mesh.n_faces, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"] = 3
    triangles["corners"] = table.mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment meshmash-viewer {table.meta}",
        f"element vertex {len(records)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property float {name}" for name in names),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(records.tobytes())
        file.write(triangles.tobytes())


def _property_names(columns: tuple[str, ...]) -> list[str]:
    """PLY names are ASCII without white space, and none may come twice."""
    names: list[str] = []
    for column in columns:
        name = re.sub(r"[^!-~]", "_", column.replace("λ", "lambda")) or "feature"
        if name in names or name in ("x", "y", "z"):
            name = f"{name}_{len(names)}"
        names.append(name)
    return names


def _features_gifti(path: Path, table: FeatureTable) -> None:
    from nibabel.gifti import gifti as nibabel_gifti

    gifti: Any = nibabel_gifti  # it ships no types
    image = gifti.GiftiImage(meta=gifti.GiftiMetaData({"meshmash-viewer": table.meta}))
    for name, column in zip(table.columns, table.values.T, strict=True):
        image.add_gifti_data_array(
            gifti.GiftiDataArray(
                np.ascontiguousarray(column, dtype=np.float32),
                intent="NIFTI_INTENT_NONE",
                datatype="NIFTI_TYPE_FLOAT32",
                meta=gifti.GiftiMetaData({"Name": name}),
            )
        )
    path.write_bytes(image.to_bytes())


# Eigenpairs -----------------------------------------------------------------------------------


def _eigenpairs_npz(path: Path, decomposition: Decomposition, mesh: Mesh, meta: str) -> None:
    with path.open("wb") as file:
        np.savez(
            file,
            eigenvalues=decomposition.eigenvalues,
            eigenvectors=decomposition.eigenvectors,
            residuals=decomposition.residuals,
            mass=decomposition.mass,
            vertices=mesh.vertices,
            faces=mesh.faces,
            meta=np.array(meta),
        )


def _eigenpairs_vtp(path: Path, decomposition: Decomposition, mesh: Mesh, meta: str) -> None:
    digits = max(3, len(str(decomposition.n_components)))
    columns = ((f"phi_{i:0{digits}d}", row) for i, row in enumerate(decomposition.rows))
    beside = {"eigenvalues": decomposition.eigenvalues, "residuals": decomposition.residuals}
    _write_vtp(path, mesh, columns, beside, meta)


def _write_vtp(
    path: Path,
    mesh: Mesh,
    columns: Any,
    beside: dict[str, npt.NDArray[np.float64]],
    meta: str,
) -> None:
    """Points, triangles, one point array a column; anything else as field data."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    to_vtk: Any = numpy_support.numpy_to_vtk
    kept = []  # VTK points into these arrays until the file is written

    def wrapped(values: npt.NDArray[Any], name: str = "") -> Any:
        kept.append(np.ascontiguousarray(values))
        array = to_vtk(kept[-1])
        if name:
            array.SetName(name)
        return array

    points, cells, poly = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(wrapped(mesh.vertices))
    offsets = np.arange(0, 3 * mesh.n_faces + 1, 3, dtype=np.int64)
    cells.SetData(wrapped(offsets), wrapped(mesh.faces.reshape(-1)))
    poly.SetPoints(points)
    poly.SetPolys(cells)
    for name, column in columns:
        poly.GetPointData().AddArray(wrapped(column, name))
    if poly.GetPointData().GetNumberOfArrays():
        poly.GetPointData().SetActiveScalars(poly.GetPointData().GetArrayName(0))
    for name, values in beside.items():
        poly.GetFieldData().AddArray(wrapped(values, name))
    text = vtkStringArray()
    text.SetName("meshmash-viewer")
    text.InsertNextValue(meta)
    poly.GetFieldData().AddArray(text)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(poly)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToNone()  # eigenvectors hardly shrink, and it takes minutes
    if not writer.Write() or writer.GetErrorCode():
        raise OSError(writer.GetErrorCode(), "VTK could not write it")


#: The one table of feature formats: lower-case ending to writer.
WRITERS: dict[str, FeatureWriter] = {
    ".npz": _features_npz,
    ".npy": _features_npy,
    ".csv": _features_csv,
    ".parquet": _features_parquet,
    ".vtp": _features_vtp,
    ".ply": _features_ply,
    ".func.gii": _features_gifti,
    ".shape.gii": _features_gifti,
    ".gii": _features_gifti,
}

#: The same for eigenpairs.
EIGENPAIR_WRITERS: dict[str, EigenpairWriter] = {".npz": _eigenpairs_npz, ".vtp": _eigenpairs_vtp}

#: Formats without room for provenance.
_NOTED = (".npy", ".csv")

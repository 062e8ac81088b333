"""Features, eigenpairs and meshes in files: one function a format, each with its provenance."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.mesh import mesh_to_poly
from meshmash_viewer.plug_ins import plug_ins

if TYPE_CHECKING:
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.eigensolver import Decomposition

__all__ = [
    "EIGENPAIR_WRITERS",
    "MESH_WRITERS",
    "NEEDED",
    "SPECTRUM_WRITERS",
    "WITHOUT_PROVENANCE",
    "WRITERS",
    "FeatureTable",
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
SpectrumWriter: TypeAlias = Callable[[Path, dict[str, npt.NDArray[Any]], str], None]
MeshWriter: TypeAlias = Callable[[Path, "Mesh", str], None]
EigenpairWriter: TypeAlias = Callable[[Path, "Decomposition", "Mesh", str], None]


# Features ---------------------------------------------------------------------------------------


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
        free, number = name, len(names)
        while free in names or free in ("x", "y", "z"):
            free, number = f"{name}_{number}", number + 1
        names.append(free)
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


# Spectra of maps --------------------------------------------------------------------------------


def _spectrum_npz(path: Path, columns: dict[str, npt.NDArray[Any]], meta: str) -> None:
    with path.open("wb") as file:
        np.savez(file, meta=np.array(meta), **columns)  # type: ignore[arg-type]


def _spectrum_csv(path: Path, columns: dict[str, npt.NDArray[Any]], meta: str) -> None:
    import pyarrow.csv

    pyarrow.csv.write_csv(pyarrow.table(columns), str(path))


def _spectrum_parquet(path: Path, columns: dict[str, npt.NDArray[Any]], meta: str) -> None:
    import pyarrow.parquet

    content = pyarrow.table(columns).replace_schema_metadata({"meshmash-viewer": meta})
    pyarrow.parquet.write_table(content, str(path))


# Meshes -----------------------------------------------------------------------------------------


def _mesh_npz(path: Path, mesh: Mesh, meta: str) -> None:
    with path.open("wb") as file:
        np.savez(file, vertices=mesh.vertices, faces=mesh.faces, meta=np.array(meta))


def _mesh_vtp(path: Path, mesh: Mesh, meta: str) -> None:
    _write_vtp(path, mesh, (), {}, meta)


def _mesh_ply(path: Path, mesh: Mesh, meta: str) -> None:
    none = np.empty((mesh.n_vertices, 0))
    _features_ply(path, FeatureTable(none, (), mesh, np.empty(0), meta))


def _mesh_obj(path: Path, mesh: Mesh, meta: str) -> None:
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# meshmash-viewer {meta}\n")
        np.savetxt(file, mesh.vertices, "v %.17g %.17g %.17g")
        np.savetxt(file, mesh.faces + 1, "f %d %d %d")


def _mesh_by_trimesh(path: Path, mesh: Mesh, meta: str) -> None:
    import trimesh

    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    plain.export(path, file_type=path.suffix[1:].lower())


# Eigenpairs -------------------------------------------------------------------------------------


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
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    poly = mesh_to_poly(mesh)
    for name, column in columns:
        poly.point_data.set_array(np.ascontiguousarray(column), name)
    if poly.point_data.keys():
        poly.point_data.active_scalars_name = poly.point_data.keys()[0]
    for name, values in beside.items():
        poly.field_data[name] = values
    poly.field_data["meshmash-viewer"] = [meta]
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

WRITERS |= plug_ins("writers", WRITERS)

#: The same for eigenpairs.
EIGENPAIR_WRITERS: dict[str, EigenpairWriter] = {".npz": _eigenpairs_npz, ".vtp": _eigenpairs_vtp}

#: The same for meshes alone.
MESH_WRITERS: dict[str, MeshWriter] = {
    ".ply": _mesh_ply,
    ".obj": _mesh_obj,
    ".stl": _mesh_by_trimesh,
    ".glb": _mesh_by_trimesh,
    ".vtp": _mesh_vtp,
    ".npz": _mesh_npz,
}

#: The same for what a map is on eigenpairs.
SPECTRUM_WRITERS: dict[str, SpectrumWriter] = {
    ".csv": _spectrum_csv,
    ".parquet": _spectrum_parquet,
    ".npz": _spectrum_npz,
}

#: Packages that are asked for before the work that ends in a file.
NEEDED = {".csv": "pyarrow", ".parquet": "pyarrow", ".gii": "nibabel"}

#: Formats without room for provenance.
WITHOUT_PROVENANCE = (".npy", ".csv", ".stl", ".glb")

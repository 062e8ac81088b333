"""Writers of features, eigenpairs and meshes with provenance: one function per format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, package_missing, unknown_ending
from meshmash_viewer.io.movie import MOVIE_ENDINGS
from meshmash_viewer.io.provenance import comment_lines, property_names
from meshmash_viewer.mesh import Mesh, mesh_to_poly
from meshmash_viewer.plug_ins import PlugIn, plug_ins
from meshmash_viewer.vertex_map import Label, VertexMap, labels_in_use


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Input of a writer: a mesh and columns of values at its vertices, or another table."""

    mesh: Mesh
    #: Arrays for an NPZ file, without the provenance.
    archive: dict[str, npt.NDArray[Any]]
    columns: tuple[str, ...] = ()
    #: Shape (n, f): A row per vertex; without columns, the shape is not used.
    values: npt.NDArray[Any] = field(default_factory=lambda: np.empty((0, 0)))
    #: Shape (k,): Eigenvalues of the pairs used for the features; empty if not given.
    eigenvalues: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    #: Provenance, one line of JSON.
    meta: str = ""
    #: Arrays with other lengths than the table, for formats that support them.
    extra: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    #: Labels of the numbers in `values`, for a label set.
    labels: tuple[Label, ...] = ()
    #: Whether CSV and Parquet have the columns of `archive`, in place of a row per vertex.
    archive_is_table: bool = False

    @property
    def repaired(self) -> bool:
        """Whether a row is a vertex whose index in the mesh file may be another."""
        return self.mesh.numbering is not None and not self.archive_is_table


#: Factors for the conversion of lengths to mm, by unit.
_MILLIMETRES = {"nm": 1e-6, "µm": 1e-3, "mm": 1.0, "m": 1e3}

Writer: TypeAlias = Callable[[Path, FeatureTable], None]
#: Values, intent and metadata.
_GiftiArray: TypeAlias = tuple[npt.NDArray[Any], str, dict[str, str]]


def _npz(path: Path, table: FeatureTable) -> None:
    archive: dict[str, Any] = {**table.archive, "meta": np.array(table.meta)}
    with path.open("wb") as file:
        np.savez(file, **archive)


def _npy(path: Path, table: FeatureTable) -> None:
    with path.open("wb") as file:
        np.save(file, np.ascontiguousarray(table.values))


def _arrow_table(table: FeatureTable) -> Any:
    import pyarrow

    columns = table.archive
    if not table.archive_is_table:
        values = zip(table.columns, table.values.T, strict=True)
        columns = {"vertex": table.mesh.file_indices, **dict(values)}
    arrays = [pyarrow.array(np.ascontiguousarray(column)) for column in columns.values()]
    return pyarrow.table(arrays, names=list(columns))


def _csv(path: Path, table: FeatureTable) -> None:
    import pyarrow.csv

    pyarrow.csv.write_csv(_arrow_table(table), str(path))


def _parquet(path: Path, table: FeatureTable) -> None:
    import pyarrow.parquet

    content = _arrow_table(table).replace_schema_metadata({"meshmash-viewer": table.meta})
    pyarrow.parquet.write_table(content, str(path))


def _vtp(path: Path, table: FeatureTable) -> None:
    """Write points, triangles, a point array per column, and `extra` arrays as field data."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    poly = mesh_to_poly(table.mesh)
    for name, column in zip(table.columns, table.values.T, strict=True):
        poly.point_data.set_array(np.ascontiguousarray(column), name)
    if table.repaired:
        poly.point_data.set_array(table.mesh.file_indices, "vertex")
    if table.columns:
        poly.point_data.active_scalars_name = table.columns[0]
    for name, values in table.extra.items():
        poly.field_data[name] = values
    poly.field_data["meshmash-viewer"] = [table.meta]
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(poly)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToNone()  # compression takes minutes and saves little
    if not writer.Write() or writer.GetErrorCode():
        raise OSError(writer.GetErrorCode(), "VTK could not write it")


def _ply(path: Path, table: FeatureTable) -> None:
    types = {"double": "<f8", "float": "<f4", "int": "<i4"}
    columns = [
        (axis, "double", each) for axis, each in zip("xyz", table.mesh.vertices.T, strict=True)
    ]
    if table.repaired:
        columns.append(("vertex", "int", table.mesh.file_indices))
    kind = "int" if table.values.dtype.kind == "i" else "float"
    names = property_names(table.columns)
    columns += [(name, kind, each) for name, each in zip(names, table.values.T, strict=True)]
    records = np.empty(table.mesh.n_vertices, [(name, types[kind]) for name, kind, _ in columns])
    for name, _, each in columns:
        records[name] = each
    triangles = np.empty(table.mesh.n_faces, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"] = 3
    triangles["corners"] = table.mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *comment_lines(table.meta, "comment"),
        f"element vertex {len(records)}",
        *(f"property {kind} {name}" for name, kind, _ in columns),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(records.tobytes())
        file.write(triangles.tobytes())


def _gifti(path: Path, table: FeatureTable, intent: str = "NIFTI_INTENT_NONE") -> None:
    """Write a data array per column; as int32 if the columns are labels."""
    kind = np.int32 if table.labels else np.float32
    arrays = [
        (column.astype(kind), intent, {"Name": name})
        for name, column in zip(table.columns, table.values.T, strict=True)
    ]
    _write_gifti(path, table, arrays, _structure(table.mesh))


def _gifti_surface(path: Path, table: FeatureTable) -> None:
    """Write the mesh in mm, the unit of GIFTI; without a unit, coordinates are not scaled."""
    vertices = table.mesh.vertices * _MILLIMETRES.get(table.mesh.unit, 1.0)
    arrays: list[_GiftiArray] = [
        (vertices.astype(np.float32), "NIFTI_INTENT_POINTSET", _structure(table.mesh)),
        (table.mesh.faces.astype(np.int32), "NIFTI_INTENT_TRIANGLE", {}),
    ]
    _write_gifti(path, table, arrays, {})


def _structure(mesh: Mesh) -> dict[str, str]:
    """Return the metadata of the brain structure, which Connectome Workbench needs."""
    return {"AnatomicalStructurePrimary": mesh.structure} if mesh.structure else {}


def _write_gifti(
    path: Path, table: FeatureTable, arrays: list[_GiftiArray], about: dict[str, str]
) -> None:
    """Write arrays and the labels of the table, with metadata of the file."""
    from nibabel.gifti import gifti as nibabel_gifti

    gifti: Any = nibabel_gifti  # untyped
    names, labels = gifti.GiftiLabelTable(), table.labels
    for label in labels:
        shares = [share / 255.0 for share in bytes.fromhex(label.color[1:])]
        names.labels.append(gifti.GiftiLabel(label.key, *shares, 1.0))
        names.labels[-1].label = label.name
    if labels and 0 not in [label.key for label in labels]:  # as in Connectome Workbench
        names.labels.append(gifti.GiftiLabel(0, 0.0, 0.0, 0.0, 0.0))
        names.labels[-1].label = "???"
    image = gifti.GiftiImage(
        meta=gifti.GiftiMetaData({**about, "meshmash-viewer": table.meta}),
        darrays=[
            gifti.GiftiDataArray(values, intent, meta=gifti.GiftiMetaData(said))
            for values, intent, said in arrays
        ],
        labeltable=names if labels else None,
    )
    path.write_bytes(image.to_bytes())


def _annotation(path: Path, table: FeatureTable) -> None:
    """Write labels, numbered from 0 in their order.

    The format stores the colour of its label at each vertex, and black for no label. A black label,
    or a label with the colour of another, therefore gets the next free colour.
    """
    from nibabel.freesurfer import io as freesurfer

    taken, colors = {0}, []
    for label in table.labels:
        wanted = int(label.color[1:], 16)
        packed = next(wanted ^ step for step in count() if wanted ^ step not in taken)
        taken.add(packed)
        colors.append([*packed.to_bytes(3, "big"), 0])
    places = VertexMap("", table.values[:, 0], table.labels).shown
    write: Any = freesurfer.write_annot
    names = [label.name for label in table.labels]
    write(str(path), np.nan_to_num(places, nan=-1.0).astype(int), np.array(colors), names)


def _one_label(path: Path, table: FeatureTable) -> None:
    """Write the vertices of a single label, with their positions in mm, as text."""
    used = labels_in_use(table.labels, table.values)
    if len(used) != 1:
        fault = f"{path} can hold one label, and {table.columns[0]!r} has {len(used)} with vertices"
        remedy = "write .annot or .label.gii, or give one label alone"
        raise InputError("several-labels", fault, remedy)
    inside = np.flatnonzero(table.values[:, 0] == used[0].key)
    points = table.mesh.on_file(table.mesh.vertices)[inside]
    rows = np.column_stack([inside, points * _MILLIMETRES.get(table.mesh.unit, 1.0)])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"#!ascii label {used[0].name}, from subject\n{len(inside)}\n")
        np.savetxt(file, rows, "%d  %.9g  %.9g  %.9g 0")


def _obj(path: Path, table: FeatureTable) -> None:
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"{line}\n" for line in comment_lines(table.meta, "#"))
        np.savetxt(file, table.mesh.vertices, "v %.17g %.17g %.17g")
        np.savetxt(file, table.mesh.faces + 1, "f %d %d %d")


def _by_trimesh(path: Path, table: FeatureTable) -> None:
    import trimesh

    # vertices without faces may be beyond the range of float32
    largest = np.finfo(np.float32).max
    vertices = np.clip(table.mesh.vertices, -largest, largest)
    plain = trimesh.Trimesh(vertices, table.mesh.faces, process=False)
    plain.export(path, file_type=path.suffix[1:].lower())


#: Writers of features and eigenpairs by lower-case ending.
WRITERS: dict[str, Writer] = {
    ".npz": _npz,
    ".npy": _npy,
    ".csv": _csv,
    ".parquet": _parquet,
    ".vtp": _vtp,
    ".ply": _ply,
    ".func.gii": _gifti,
    ".shape.gii": partial(_gifti, intent="NIFTI_INTENT_SHAPE"),
    ".gii": _gifti,
}

WRITERS |= plug_ins("writers", WRITERS)

#: Writers of meshes without fields by lower-case ending.
MESH_WRITERS: dict[str, Writer] = {
    ".ply": _ply,
    ".obj": _obj,
    ".stl": _by_trimesh,
    ".glb": _by_trimesh,
    ".vtp": _vtp,
    ".npz": _npz,
    ".surf.gii": _gifti_surface,
}

#: Writers of spectra of maps, regions and points by lower-case ending.
SPECTRUM_WRITERS: dict[str, Writer] = {".csv": _csv, ".parquet": _parquet, ".npz": _npz}

#: Writers of label sets by lower-case ending.
LABEL_WRITERS: dict[str, Writer] = {
    ".label.gii": partial(_gifti, intent="NIFTI_INTENT_LABEL"),
    ".annot": _annotation,
    ".label": _one_label,
    ".csv": _csv,
    ".npz": _npz,
    ".ply": _ply,
}

#: Endings of scenes, which are written by pyvista.
SCENE_ENDINGS = (".gltf", ".html")

#: Packages needed for writing, by the last part of the ending.
_NEEDED = {".csv": "pyarrow", ".parquet": "pyarrow", ".gii": "nibabel", ".annot": "nibabel"}

#: Formats whose provenance is written to a second file.
WITHOUT_PROVENANCE = (".npy", ".csv", ".stl", ".glb", ".annot", ".label")

#: Formats without vertex indices; the indices are written to the provenance as ranges.
WITHOUT_INDEX = (".npy", ".gii", ".obj", ".stl", ".glb")

#: Endings of GIFTI files that are not for features in other programs.
_NO_FEATURES = (".surf.gii", ".label.gii", ".coord.gii", ".topo.gii")
#: Plural and writers by ending of each kind of result; None for files written by other modules.
_KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    "features": ("features", WRITERS),
    "eigenpairs": ("eigenpairs", WRITERS),
    "coefficients": ("coefficients", SPECTRUM_WRITERS),
    "regions": ("regions", SPECTRUM_WRITERS),
    "labels": ("labels", LABEL_WRITERS),
    "mesh": ("meshes", MESH_WRITERS),
    "picture": ("pictures", {".png": None}),
    "figure": ("figures", {".png": None, ".pdf": None, ".svg": None}),
    "plot": ("plots", {".svg": None, ".pdf": None, ".png": None, ".csv": None}),
    "movie": ("movies", dict.fromkeys(MOVIE_ENDINGS)),
    "scene": ("scenes", dict.fromkeys(SCENE_ENDINGS)),
    "pins": ("pins", {".csv": None}),
    "points": ("points", SPECTRUM_WRITERS),
}


def writer_of(kind: str, path: Path) -> Any:
    """Return the writer of a kind of result by the file's ending, None if in another module.

    `InputError` is raised if the ending is unknown, or the needed package is not installed.
    """
    plural, table = _KINDS[kind]
    name = path.name.lower()
    if table is WRITERS and name.endswith(_NO_FEATURES):
        fault = f"{path} has the name of a surface or of labels, and {plural} are neither"
        raise InputError("unknown-ending", fault, "give it the ending .func.gii or .shape.gii")
    for ending in table:
        if name.endswith(ending) and len(name) > len(ending):
            needed = _NEEDED.get(ending[ending.rindex(".") :])
            writer = table[ending]
            if writer is not None and needed and find_spec(needed) is None:
                raise package_missing(f"{path} is written by", needed)
            return writer.load() if isinstance(writer, PlugIn) else writer
    raise unknown_ending(path, table)

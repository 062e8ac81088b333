"""Writing of features, eigenpairs and meshes with their provenance, and of pictures.

Every file is written with a temporary name and renamed, so that a failure leaves an older file
unchanged. NPZ, Parquet, VTP, PLY, OBJ and GIFTI files contain their provenance. NPY, CSV, STL and
GLB files have it in a second file, such as "features.npy.json" for "features.npy", together with
the SHA-256 of the first file (``table_sha256``).
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, unknown_ending, wrong_type
from meshmash_viewer.io.atomic import writing_errors, written_together, written_whole
from meshmash_viewer.io.provenance import provenance
from meshmash_viewer.io.writers import WITHOUT_INDEX, WITHOUT_PROVENANCE, FeatureTable, writer_of
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike, as_eigenpairs
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.features.map_spectrum import MapSpectrum
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.mesh import Mesh

#: Arrays of eigenpairs, with a value for each, that are options in the provenance.
_OF_PAIRS = ("eigenvalues", "mesh_errors")


def write_features(
    path: str | Path,
    features: Features,
    mesh: MeshLike,
    *,
    eigenvalues: npt.ArrayLike | None = None,
    mesh_errors: npt.ArrayLike = (),
    meta: dict[str, Any] | None = None,
) -> None:
    """Write feature columns in the format given by the file's ending.

    `InputError` is raised if the ending is unknown, there is not one row per vertex of the mesh, or
    the file cannot be written.

    Parameters
    ----------
    path : str or Path
        A file with one of the endings of `WRITERS`.
    features : Features
        Values of shape (n, f), one row per vertex.
    mesh : MeshLike
        The mesh of the features.
    eigenvalues : array_like, shape (k,), optional
        Eigenvalues of the pairs used for the features, an array of NPZ files.
    mesh_errors : array_like, shape (k,), optional
        Their `Eigenpairs.mesh_errors`. The provenance of all formats has both.
    meta : dict, optional
        JSON-able options of the computation, or a result of `provenance`.

    Examples
    --------
    >>> hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.5, 1.0]))
    >>> mv.write_features(folder / "hks.npz", hks, mv.Mesh(ball.vertices, ball.faces))
    >>> np.load(folder / "hks.npz")["features"].shape
    (642, 2)
    """
    from meshmash_viewer.features.sums import Features

    if not isinstance(features, Features):
        raise wrong_type("Features", type(features), "mv.Features(values, columns)")
    mesh = as_mesh(mesh)
    if len(features.values) != mesh.n_vertices:
        raise InputError(
            "other-mesh",
            f"Features of {len(features.values)} rows do not match a mesh of {mesh.n_vertices}"
            " vertices",
            "give one row per vertex",
        )
    values = np.zeros(0) if eigenvalues is None else np.asarray(eigenvalues, dtype=np.float64)
    archive = {
        "features": features.values,
        "columns": np.array(features.columns),
        "eigenvalues": values,
        **mesh_arrays(mesh),
    }
    if np.size(mesh_errors):
        archive["mesh_errors"] = np.asarray(mesh_errors, dtype=np.float64)
    table = FeatureTable(mesh, archive, features.columns, features.values, values)
    # options given by the caller take precedence
    options = {"kind": features.kind, "values_unit": features.unit, **features.meta}
    write_table(path, "features", table, options, meta)


def write_eigenpairs(
    path: str | Path,
    decomposition: EigenpairsLike,
    mesh: MeshLike,
    meta: dict[str, Any] | None = None,
) -> None:
    """Write eigenvalues and eigenvectors with a sentence on their verification.

    Arguments are as for `write_features`. Column i is ``phi_i``; the eigenvalues and their
    `Eigenpairs.mesh_errors` are arrays of NPZ and VTP files, and in the provenance of all formats.

    Examples
    --------
    >>> mv.write_eigenpairs(folder / "pairs.npz", pairs, mv.Mesh(ball.vertices, ball.faces))
    >>> np.load(folder / "pairs.npz")["eigenvectors"].shape
    (642, 16)
    """
    mesh = as_mesh(mesh)
    decomposition = as_eigenpairs("write_eigenpairs(path, pairs, mesh)", decomposition, mesh)
    extra = {"eigenvalues": decomposition.eigenvalues, "residuals": decomposition.residuals}
    if len(decomposition.mesh_errors):
        extra["mesh_errors"] = decomposition.mesh_errors
    archive = {
        **extra,
        "eigenvectors": decomposition.eigenvectors,
        "mass": decomposition.mass,
        **mesh_arrays(mesh),
    }
    count = decomposition.n_components
    digits = max(3, len(str(count)))
    names = tuple(f"phi_{i:0{digits}d}" for i in range(count))
    table = FeatureTable(
        mesh, archive, names, decomposition.eigenvectors, decomposition.eigenvalues, extra=extra
    )
    options = {"kind": "eigenpairs", "proof": decomposition.proof(mesh.unit)}
    write_table(path, "eigenpairs", table, options, meta)


def write_map_spectrum(
    path: str | Path,
    spectrum: MapSpectrum,
    mesh: MeshLike,
    name: str = "",
    meta: dict[str, Any] | None = None,
) -> None:
    """Write the spectrum of a map, as CSV, Parquet or NPZ.

    Columns are ``pair`` (from 0), ``eigenvalue``, ``mesh_error`` (`Eigenpairs.mesh_errors`, if
    known), ``coefficient``, and ``share``, the share of the energy in the pairs up to the row's
    pair. `name` is the name of the map, and `mesh` its mesh.
    Other arguments are as for `write_features`, with the endings of `SPECTRUM_WRITERS`.

    Examples
    --------
    >>> height = mv.map_spectrum(pairs, ball.vertices[:, 2])
    >>> mv.write_map_spectrum(folder / "z.csv", height, mv.Mesh(ball.vertices, ball.faces))
    >>> len((folder / "z.csv").read_text().splitlines())
    17
    """
    counts = np.arange(len(spectrum))
    columns = {
        "pair": counts,
        "eigenvalue": spectrum.eigenvalues,
        **({"mesh_error": spectrum.mesh_errors} if len(spectrum.mesh_errors) else {}),
        "coefficient": spectrum.coefficients,
        "share": np.array([spectrum.share(int(count) + 1) for count in counts]),
    }
    table = FeatureTable(as_mesh(mesh), columns, archive_is_table=True)
    options = {"kind": "map-spectrum", "map_name": name, "energy": spectrum.energy}
    write_table(path, "coefficients", table, options, meta)


def write_mesh(path: str | Path, mesh: Mesh, meta: dict[str, Any] | None = None) -> None:
    """Write a mesh without fields, in a format of `MESH_WRITERS`.

    STL, GLB and GIFTI files have float32 coordinates, STL repeats the vertices of each face, and
    GIFTI is in mm. `meta` are JSON-able options of the computation, or a result of `provenance`.
    `InputError` is raised if the ending is unknown or the file cannot be written.
    """
    write_table(path, "mesh", FeatureTable(mesh, mesh_arrays(mesh)), {"kind": "mesh"}, meta)


def write_picture(
    path: str | Path, pixels: npt.NDArray[np.uint8], dpi: float | None = None
) -> None:
    """Write pixels, RGB or RGBA of shape (height, width, 3 or 4), top row first, as PNG.

    `dpi`, the number of pixels per inch on paper, is written into the file. `InputError` is raised
    if the ending is not .png or the file cannot be written.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    path = Path(path)
    if path.suffix.lower() != ".png":
        raise unknown_ending(path, [".png"])
    about = PngInfo()
    about.add_text("Software", "meshmash-viewer")
    with writing_errors(path), written_whole(path) as part:
        image = Image.fromarray(np.ascontiguousarray(pixels))
        image.save(part, pnginfo=about, dpi=None if dpi is None else (dpi, dpi))


def mesh_arrays(mesh: Mesh) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a mesh by name, and after repairs the index in the file per vertex."""
    arrays: dict[str, npt.NDArray[Any]] = {"vertices": mesh.vertices, "faces": mesh.faces}
    return arrays if mesh.numbering is None else {**arrays, "vertex": mesh.file_indices}


def _plain(value: Any) -> Any:
    """Convert an option for JSON: NumPy arrays and sets to lists, other objects to text."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return sorted(map(str, value)) if isinstance(value, (set, frozenset)) else str(value)


def write_table(
    path: str | Path,
    kind: str,
    table: FeatureTable,
    options: dict[str, Any],
    meta: dict[str, Any] | None,
) -> None:
    """Write a table and its provenance, to a second file for formats without metadata.

    The second file has the checksum of the table, as two files cannot be replaced at once. The
    `options` describe the result, with eigenvalues and errors of the pairs; options in `meta`,
    which may be a provenance, take precedence.
    """
    path, given, arrays = Path(path), meta or {}, table.archive
    of_pairs = {each: arrays[each] for each in _OF_PAIRS if np.size(arrays.get(each, ()))}
    is_provenance = {"program", "mesh", "options"} <= given.keys()
    about = dict(given) if is_provenance else provenance(table.mesh, given)
    about["options"] = {**options, **of_pairs, **about["options"]}
    if kind in ("features", "eigenpairs", "labels"):
        about["columns"] = list(table.columns)
    if table.labels:
        about["labels"] = [[each.key, each.name, each.color] for each in table.labels]
    if table.repaired and path.name.lower().endswith(WITHOUT_INDEX):
        about["rows"] = _ranges(table.mesh.file_indices)
    about = json.loads(json.dumps(about, default=_plain))
    table = replace(table, meta=json.dumps(about, separators=(",", ":")))
    writer = writer_of(kind, path)
    with writing_errors(path):
        if path.suffix.lower() not in WITHOUT_PROVENANCE:
            with written_whole(path) as part:
                writer(part, table)
            return
        with written_together(path, path.with_name(path.name + ".json")) as (part, note):
            writer(part, table)
            with part.open("rb") as file:
                about["table_sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
            note.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


def _ranges(indices: npt.NDArray[np.int64]) -> list[list[int]]:
    """Convert ascending indices to half-open ranges."""
    starts = np.flatnonzero(np.diff(indices, prepend=-2) > 1)
    ends = np.append(starts[1:], len(indices)) - 1
    return np.stack([indices[starts], indices[ends] + 1], axis=1).tolist()  # type: ignore[no-any-return]


def unused_path(path: str | Path) -> Path:
    """Return a path, or if it exists, the first unused path with a number, such as `hks_2.npz`.

    Examples
    --------
    >>> np.savez(folder / "times.npz", times=np.zeros(3))
    >>> unused_path(folder / "free.npz").name, unused_path(folder / "times.npz").name
    ('free.npz', 'times_2.npz')
    """
    path = Path(path)
    ending = "".join(path.suffixes[-2:]) if path.suffix == ".gii" else path.suffix
    stem, number, found = path.name.removesuffix(ending), 1, path
    # the second file, of formats without metadata, must not exist either
    while os.path.lexists(found) or os.path.lexists(f"{found}.json"):
        number += 1
        found = path.with_name(f"{stem}_{number}{ending}")
    return found


def check_output(path: str | Path, kind: str = "features") -> None:
    """Check, before a long computation, that a result of a kind can be written to a file.

    `InputError` is raised if the ending is unknown, or the folder does not exist or cannot be
    written.
    """
    path = Path(path)
    writer_of(kind, path)
    with writing_errors(path):
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(13, "Permission denied")


# -- layers of napari, without napari ------------------------------------------------------------

#: RGBA of vertices without a label.
_NO_LABEL = (0.7, 0.7, 0.7, 1.0)


def to_napari(
    mesh: MeshLike, field: npt.ArrayLike | VertexMap | None = None
) -> tuple[tuple[npt.NDArray[Any], ...], dict[str, Any], str]:
    """Return a mesh as a layer tuple of napari.

    `InputError` is raised unless `field` has one value per vertex.

    Parameters
    ----------
    mesh : MeshLike
    field : array_like, shape (n,), or VertexMap, optional
        A value for each vertex; NaN has no colour. For a label set, vertices have the colours of
        their labels, and ``metadata["labels"]`` has the names of labels by number; the layer is a
        surface, as napari's label layers are for images only.

    Returns
    -------
    tuple
        Data ``(vertices, faces)`` or ``(vertices, faces, values)``, options and "surface".
        Coordinates are in reverse order, (z, y, x), like image axes in napari. The unit of the
        mesh, if any, is in the option ``units`` of the three axes, which needs napari 0.5.

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
        fault = f"A field of shape {values.shape} does not go with {mesh.n_vertices:,} vertices"
        raise InputError("wrong-shape", fault, "give one value for each")
    if known is not None and known.labels:
        options["metadata"]["labels"] = {label.key: label.name for label in known.labels}
        options["vertex_colors"] = _napari_colors(known)
        return (*data, values), options, "surface"
    finite = values[np.isfinite(values)]
    if len(finite) and finite.min() < finite.max():
        options["contrast_limits"] = (float(finite.min()), float(finite.max()))
    options["colormap"] = "viridis"
    return (*data, values), options, "surface"


def _napari_colors(labelled: VertexMap) -> npt.NDArray[np.float32]:
    """Return the RGBA of the label of each vertex, shape (n, 4)."""
    table = [
        (*(int(label.color[at : at + 2], 16) / 255.0 for at in (1, 3, 5)), 1.0)
        for label in labelled.labels
    ]
    places = np.nan_to_num(labelled.shown, nan=len(table)).astype(np.int64)
    return np.array([*table, _NO_LABEL], dtype=np.float32)[places]

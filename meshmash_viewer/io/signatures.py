"""Recognition of files by their first bytes, to name a remedy for wrong endings."""

from __future__ import annotations

import codecs
import gzip
import re
import zlib
from pathlib import Path

from meshmash_viewer.errors import InputError

#: Number of bytes that are compared.
_BEGINNING = 2_000
_OF_ONE_SURFACE = "write the values of one surface as GIFTI, with wb_command -cifti-separate"
_ON_SURFACE = (
    "sample it on the surface with wb_command -volume-to-surface-mapping or mri_vol2surf, or"
    " convert values of a surface with mri_convert to .mgh"
)
_WITH_PYBICPL = "convert it to a Wavefront OBJ with obj_mni2wf of the Python package pybicpl"
_BY_LINK = "open a segment by its link, such as precomputed://file:///folder#segment=123"
#: Ending of datasets of AFNI, and what to do with them.
_AFNI = ".dset", "is a dataset of AFNI", "write it as GIFTI, with ConvertDset -o_gii"
#: Pattern of the first bytes, kind of file, and the endings of this kind or a remedy.
_SIGNATURES: tuple[tuple[bytes, str, tuple[str, ...] | str], ...] = (
    (rb"ply\s", "a PLY file", (".ply",)),
    (rb"\s*solid\b[^\n]*\s+facet\s+normal\b", "an STL file", (".stl",)),
    (rb"\s*(ST|C|N)*OFF\s", "an OFF file", (".off",)),
    (rb"glTF", "a binary glTF file", (".glb",)),
    (rb"DRACO", "a Draco file", (".drc",)),
    (rb"# vtk DataFile", "a legacy VTK file", (".vtk",)),
    (rb'[^\0]*?<VTKFile[^>]*"PolyData"', "a VTK XML file of polygons", (".vtp",)),
    (rb'[^\0]*?<VTKFile[^>]*"UnstructuredGrid"', "a VTK XML file of a grid", (".vtu",)),
    (rb"[^\0]*?<GIFTI\b", "a GIFTI file", (".gii",)),
    (rb"\x89HDF\r\n", "an HDF5 file", (".h5",)),
    (rb"\x93NUMPY", "a NumPy array", (".npy",)),
    (rb"PAR1", "a Parquet table", (".parquet",)),
    (rb"PK\x03\x04.{26}[^\0]*\.npy", "an NPZ archive", (".npz",)),
    (rb".{4}n[+i]2\0.*<CIFTI", "a CIFTI file", _OF_ONE_SURFACE),
    (rb".{344}(n\+1|ni1)\0|.{4}n[+i]2\0", "a NIfTI volume", _ON_SURFACE),
    (rb"MZ[\x01-\x7f]\0", "a file of Surf Ice (MZ3)", "save it there as PLY, OBJ or GIFTI"),
    (rb"P(\s+[-+.\deE]+){5}\s+\d+\s", "an object file of MNI and CIVET", _WITH_PYBICPL),
    (rb"MATLAB \d", "a MATLAB file", "write its vertices, and its faces minus 1, as NPZ or PLY"),
    (rb'\s*\{.*"asset"', "a glTF file", (".gltf",)),
    (rb'\s*\{.*"(fragments|data_type|@type)"', "a part of a layer of Neuroglancer", _BY_LINK),
    (rb'\s*[{\[]\s*["{\[\d-]', "a JSON file", "write the arrays in it as NPZ"),
    (rb"PK\x03\x04", "a ZIP archive", "unpack it, or export the mesh in it as PLY"),
    (rb"version https://git-lfs", "a pointer of Git LFS", "fetch the file with git lfs pull"),
    (rb"(?i)\s*(<!doctype html|<html)", "a web page", "download the file that the page links to"),
)


def misnamed(path: Path, ending: str) -> InputError | None:
    """Return the fault of a file whose ending is of another kind than its content.

    `ending` is in lower case. None is returned if the first bytes, unpacked from a gzip file, match
    it, or no known kind.
    """
    if ending.removesuffix(".gz") == _AFNI[0]:
        return InputError("wrong-ending", *_AFNI[1:])
    try:
        with path.open("rb") as file:
            is_packed = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if is_packed else path.open("rb") as file:
            beginning = file.read(_BEGINNING).removeprefix(codecs.BOM_UTF8)
    except (OSError, EOFError, zlib.error):
        beginning = b""
    if ending == ".gltf" and beginning.lstrip()[:1] in (b"{", b"["):
        return None  # the word "asset" may be anywhere in its JSON
    kinds = (each for each in _SIGNATURES if re.match(each[0], beginning, re.DOTALL))
    _, kind, remedy = next(kinds, (b"", "", ("",)))
    if isinstance(remedy, str):
        return InputError("wrong-ending", f"is {kind}", remedy)
    if is_packed and not ending.endswith((".gz", ".mgz")):
        fault = "is a gzip file by its content"
        return InputError("wrong-ending", fault, "add .gz to its name")
    if not kind or (ending.removesuffix(".gz") if is_packed else ending).endswith(remedy):
        return None
    right = f"change its ending to {remedy[0]}{'.gz' * is_packed}"
    return InputError("wrong-ending", f"is {kind} by its content", right)

"""Reader of mesh files of all formats; errors are one sentence with the fault and a remedy."""

from __future__ import annotations

import contextlib
import gzip
import shutil
import warnings
import zlib
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

from meshmash_viewer.arrays import distinct_corners, scaled_vertices
from meshmash_viewer.errors import (
    InputError,
    MeshWarning,
    conflicting,
    cut_short,
    not_readable,
    printable,
)
from meshmash_viewer.io.atomic import remove_abandoned, scratch_prefix
from meshmash_viewer.io.formats.brain import (
    FREESURFER_ENDINGS,
    freesurfer_kind,
    read_freesurfer,
    read_freesurfer_ascii,
    read_gifti,
)
from meshmash_viewer.io.formats.draco import is_draco, read_draco
from meshmash_viewer.io.formats.gltf import gltf_limits, read_gltf
from meshmash_viewer.io.formats.meshparty import read_meshparty
from meshmash_viewer.io.formats.npz import npz_limits, read_npz
from meshmash_viewer.io.formats.polygons import read_obj, read_off, read_ply, read_stl
from meshmash_viewer.io.formats.vtk import read_legacy_vtk, read_vtk_xml
from meshmash_viewer.io.links import (
    LINK_ENDING,
    MeshLink,
    is_link,
    link_of_manifest,
    parse_link,
    read_link,
)
from meshmash_viewer.io.raw import (
    AS_SURFACE,
    REPAIR,
    LimitExceeded,
    RawMesh,
    ReadLimits,
    checked_maps,
    read_guarded,
    read_raw,
    unreadable,
)
from meshmash_viewer.io.segments import read_linked, read_segment
from meshmash_viewer.io.signatures import misnamed
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.plug_ins import plug_ins
from meshmash_viewer.progress import CancelCallback, Cancelled, ProgressCallback
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.structures import structure_of_file
from meshmash_viewer.units import NO_VOXEL, counted

Reader: TypeAlias = Callable[[Path], RawMesh]

#: Readers by lower-case ending.
READERS: dict[str, Reader] = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".stl": read_stl,
    ".off": read_off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".vtp": read_vtk_xml,
    ".vtu": read_vtk_xml,
    ".vtk": read_legacy_vtk,
    ".npz": read_npz,
    ".gii": read_gifti,
    ".h5": read_meshparty,
    ".drc": read_draco,
    LINK_ENDING: read_linked,
    ".asc": read_freesurfer_ascii,
    **dict.fromkeys(FREESURFER_ENDINGS, read_freesurfer),
}
READERS |= plug_ins("readers", READERS)


#: Formats not read from gzip files, as they are already compressed or refer to other files.
_NEVER_GZIPPED = (".npz", ".gltf", ".glb", ".h5", LINK_ENDING)

#: Limits for formats whose libraries crash or hang on some broken files, or whose files may be much
#: larger when unpacked; the limits are None for a file that needs none.
_LIMITS: dict[Reader, Callable[[Path], ReadLimits | None]] = {
    **dict.fromkeys(
        (read_vtk_xml, read_legacy_vtk, read_gifti, read_meshparty, read_draco),
        lambda path: ReadLimits.of(path.stat().st_size),
    ),
    read_gltf: gltf_limits,
    read_npz: npz_limits,
}

#: Endings of files that `read_mesh` reads.
READABLE_ENDINGS: tuple[str, ...] = (
    *READERS,
    *(ending + ".gz" for ending in READERS if ending not in _NEVER_GZIPPED),
)


def read_mesh(
    path: str | Path,
    unit: str | None = None,
    *,
    segment: int | str | None = None,
    lod: int | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Mesh:
    """Read a triangle mesh from a file, or download the mesh of a segment.

    The format is given by the file's ending, for FreeSurfer surfaces by the first bytes. Polygons,
    also concave ones, are triangulated. The objects of a scene are combined to one mesh. STL and
    glTF vertices with equal coordinates are merged, and texture seams do not cut the surface. Other
    values per vertex in PLY, VTP, VTU, VTK, GLB, glTF, NPZ and GIFTI files become `Mesh.maps`.

    `InputError` is raised if the file does not exist or has no usable mesh; the message names the
    file, the fault and a remedy.

    Parameters
    ----------
    path : str or Path
        A file with one of `READABLE_ENDINGS`, or a FreeSurfer surface; or a link as a string: the
        source of a layer, such as "precomputed://gs://bucket/layer" or "graphene://https://…", or a
        URL of Neuroglancer that contains its state.
    unit : str, optional
        The unit of the file's coordinates: "nm", "µm", "mm", "m", "none", or the size of a
        voxel such as "8 nm" or "4 x 4 x 40 nm", by which coordinates are multiplied. None for the
        unit stated by the file or its format: mm for GIFTI and FreeSurfer (m, with a warning, if
        the extent is that of a brain in metres), nm for links, otherwise no unit.
    segment : int or str, optional
        The id of the segment, for links that do not select one.
    lod : int, optional
        The level of detail, for links to multi-resolution meshes; 0 is the finest. None is also the
        finest, but raises an error for more than 20 million vertices, with a level that has fewer.
    progress : callable, optional
        For links, called with a `Progress` during the download.
    cancel : callable, optional
        For links, called repeatedly; if it returns True, `Cancelled` is raised.

    Returns
    -------
    Mesh
        A mesh with `Mesh.unit` and `Mesh.voxel`. `Mesh.name` is the file's name without its ending,
        or the id of the segment. `Mesh.structure` is stated in the file, or derived from FreeSurfer
        file names such as ``lh.pial``.

    Warns
    -----
    MeshWarning
        For each kind of content that is not read, and for a guessed unit.

    Examples
    --------
    >>> from meshmash_viewer.samples import sample_path
    >>> mesh = mv.read_mesh(sample_path("dendrite"))
    >>> mesh.unit, mesh.name
    ('nm', 'dendrite')
    """
    voxel, given_unit = (NO_VOXEL, None) if unit is None else parse_unit(unit)
    if not isinstance(path, (str, PathLike)):
        raise InputError(
            "wrong-type",
            f"read_mesh reads a file, not an object of type {type(path).__name__}",
            "give its path; other functions take meshes",
        )
    link, ending = _linked(path, segment, lod), LINK_ENDING
    if link is None:
        path = Path(path)
        check_file(path)
        if (link := link_of_manifest(path)) is None:
            ending = _ending(path)
            link = read_link(path) if ending == LINK_ENDING else None
    subject, name = (path, mesh_name(path)) if link is None else (link, str(link.segment))
    ReadLimits.of(0)  # raises an error for an invalid environment variable
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # errors are raised below, in one sentence
            if link is None:
                raw = _read_raw(Path(path), ending)
            else:
                raw = read_segment(link, progress, cancel)
            _check_content(raw)
            n = len(raw.vertices)
            maps = [each for each in raw.described_maps if each.last >= 0 or len(each.values) == n]
            known, _, unusable = checked_maps(maps, n)
            mesh = Mesh(
                scaled_vertices(raw.vertices, voxel),
                raw.faces,
                unit=raw.unit or "" if given_unit is None else given_unit,
                name=name,
                voxel=voxel,
                maps=tuple(known),
                structure=raw.structure or structure_of_file(Path(path).name),
            )
    except PermissionError as fault:
        raise no_permission(path) from fault
    except MemoryError as fault:
        what = f"{subject} needs more memory than this machine has"
        remedy = "read it on a larger one or reduce the mesh first"
        raise InputError("out-of-memory", what, remedy) from fault
    except Cancelled:
        raise
    except Exception as fault:  # libraries raise various types
        plain = fault if isinstance(fault, InputError) else unreadable(fault)
        other = misnamed(Path(path), ending) if link is None else None
        raise (other or plain).of(subject, _remedy(ending)) from fault
    remarks = (*raw.remarks, *unusable)
    if unit is None and raw.unit_remark:
        remarks = (raw.unit_remark, *remarks)
    for remark in remarks:
        warnings.warn(f"{subject} {remark}.", MeshWarning, stacklevel=2)
    return mesh


def _linked(path: str | Path, segment: int | str | None, lod: int | None) -> MeshLink | None:
    """Parse the link in an argument; return None for a file."""
    if is_link(path):
        return parse_link(str(path), segment, lod)
    if segment is not None or lod is not None:
        raise conflicting(
            f"{path} is a file, but segment and level of detail need a link",
            "give a link, such as precomputed://gs://bucket/layer, or omit them",
        )
    return None


def _read_raw(path: Path, ending: str) -> RawMesh:
    """Unpack a gzip file, and call the reader, in a child process if limits are needed."""
    reader = READERS.get(ending.removesuffix(".gz"), read_freesurfer)
    with unpacked(path, ending) as (plain, limits):
        if limits is None and reader in _LIMITS:
            limits = _LIMITS[reader](plain)
        return read_raw(reader, plain) if limits is None else read_guarded(reader, plain, limits)


def mesh_name(path: str | Path) -> str:
    """Return the name of a mesh: "neuron" for "neuron.obj" and "neuron.obj.gz"."""
    name = Path(path).name
    if name.lower().endswith(".gz"):
        name = name[:-3]
    stem, suffix = Path(name).stem, Path(name).suffix.lower()
    if suffix not in READERS or suffix in FREESURFER_ENDINGS:
        return name  # lh.pial and lh.white are two surfaces
    return stem.removesuffix(".surf") if suffix == ".gii" else stem


def file_ending(path: Path) -> str:
    """Return the ending of a file in lower case, with the one before ".gz": ".gii.gz"."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    return "".join(suffixes[-2:] if suffixes[-1:] == [".gz"] else suffixes[-1:])


def _ending(path: Path) -> str:
    ending = file_ending(path)
    if ending not in READABLE_ENDINGS and is_draco(path):  # fragments have no ending
        return ".drc"
    if ending not in READABLE_ENDINGS and not freesurfer_kind(path):
        if other := misnamed(path, ending):
            raise other.of(path)
        known = " ".join(key for key in READERS if key not in FREESURFER_ENDINGS)
        fault = f"{path} has an ending ({printable(ending, 40) or 'none'}) of no known mesh format"
        remedy = f"convert it to one of {known}, or a FreeSurfer surface such as lh.pial"
        raise InputError("unknown-ending", fault, remedy)
    return ending


def check_file(path: Path) -> None:
    """Raise `InputError`, with the file's name, unless a path is a regular, readable file."""
    try:
        if not path.exists():
            what = f"{path} does not exist"
            raise InputError("file-not-found", what, "check the spelling of its name and folder")
        if path.is_dir():
            raise InputError("not-a-file", f"{path} is a folder", "name a mesh file in it")
        if not path.is_file():
            raise InputError("not-a-file", f"{path} is not a regular file", "name a mesh file")
        if path.stat().st_size == 0:
            raise InputError("file-empty", f"{path} is empty", "copy or export it again")
        with path.open("rb"):
            pass
    except PermissionError as fault:
        raise no_permission(path) from fault
    except OSError as fault:
        raise not_readable(path, fault) from fault


def no_permission(path: object) -> InputError:
    """Return the fault of a file that may not be read."""
    remedy = "give yourself read permission, or copy it elsewhere"
    return InputError("no-permission", f"{path} cannot be read", remedy)


def _check_content(raw: RawMesh) -> None:
    n = len(raw.vertices)
    if not n:
        raise InputError("no-vertices", "holds no vertices")
    if not len(raw.faces):
        fault = "has no faces, so it is a point cloud or a drawing"
        raise InputError("no-faces", fault, AS_SURFACE)
    wrong = np.flatnonzero((raw.faces < 0) | (raw.faces >= n)) // 3
    if len(wrong):
        face = int(wrong[0])
        index = next(int(i) for i in raw.faces[face] if not 0 <= i < n)
        fault = (
            f"has {counted(len(np.unique(wrong)), 'face')} with a vertex index out of range, the"
            f" first being face {face} with index {index} of {n} vertices, all counted from 0"
        )
        from_one = raw.faces.min() == 1 and raw.faces.max() == n
        remedy = "subtract 1 from the faces" if from_one else REPAIR
        raise InputError("vertex-out-of-range", fault, remedy)
    broken = np.flatnonzero(~np.isfinite(raw.vertices).all(axis=1))
    if len(broken):
        fault = (
            f"has {counted(len(broken), 'vertex')} with a coordinate that is not finite, the"
            f" first being vertex {broken[0]}, counted from 0"
        )
        raise InputError("not-finite", fault, REPAIR)
    if not distinct_corners(raw.faces).any():
        raise InputError("no-faces", "has no triangle with three different corners", REPAIR)


def _remedy(ending: str) -> str:
    """Return the remedy of faults that have none of their own."""
    if ending == LINK_ENDING:
        return "look at it in Neuroglancer, or open another segment"
    return f"check that it is {_kind(ending.removesuffix('.gz'))}, or export it again"


def _kind(ending: str) -> str:
    if READERS.get(ending, read_freesurfer) in (read_freesurfer, read_freesurfer_ascii):
        return "a FreeSurfer surface"
    name = "GIFTI" if ending == ".gii" else ending.lstrip(".").upper()
    return f"an {name} mesh" if name[0] in "HONS" else f"a {name} mesh"  # an OBJ, an NPZ


@contextlib.contextmanager
def unpacked(path: Path, ending: str) -> Iterator[tuple[Path, ReadLimits | None]]:
    """Yield the file itself, or the content of a gzip file as a temporary file of the same name.

    The second value is the limits for reading, if the unpacked size is unusually large for a mesh.
    """
    if not ending.endswith(".gz"):
        yield path, None
        return
    remove_abandoned()
    packed_size = path.stat().st_size
    most = ReadLimits.of(packed_size).memory
    with TemporaryDirectory(prefix=scratch_prefix(), ignore_cleanup_errors=True) as folder:
        plain = Path(folder) / path.name[: -len(".gz")]
        size = 0
        try:
            with gzip.open(path) as file, plain.open("wb") as unpacked:
                while block := file.read(1_000_000):
                    size += len(block)
                    if size > most:
                        raise LimitExceeded(f"unpacks to more than {most / 1e6:.0f} MB")
                    unpacked.write(block)
        except EOFError as fault:
            raise cut_short("ends before its content is unpacked") from fault
        except (gzip.BadGzipFile, zlib.error) as fault:
            what = "cannot be unpacked because it is no gzip file, or damaged"
            raise InputError("wrong-format", what, "copy or export it again") from fault
        except OSError as fault:
            what = f"cannot be unpacked into {plain.parent.parent} ({fault.strerror})"
            remedy = "check that folder and its free space, or unpack the file yourself"
            raise InputError("not-writable", what, remedy) from fault
        if size == 0:
            raise InputError("file-empty", "is empty once unpacked", "copy or export it again")
        if (about := path.with_name(plain.name + ".json")).is_file():  # provenance of a table
            shutil.copy(about, plain.with_name(about.name))
        yield plain, ReadLimits.if_needed(packed_size, size)

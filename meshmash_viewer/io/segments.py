"""Reader of meshes of segments by cloud-volume, in a child process that can be cancelled."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import os
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias
from urllib.parse import urlsplit
from urllib.request import getproxies

from meshmash_viewer.arrays import blocks
from meshmash_viewer.errors import InputError, package_missing, printable
from meshmash_viewer.io.atomic import remove_abandoned, scratch_prefix
from meshmash_viewer.io.links import MeshLink, read_link
from meshmash_viewer.io.raw import (
    RAISE_LIMITS,
    LimitExceeded,
    RawMesh,
    ReadLimits,
    is_child,
    limit_factor,
)
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback, check_cancelled
from meshmash_viewer.units import counted
from meshmash_viewer.work import ChildEnded, ProcessTree, call_in_child

#: Called in the child process with the completed share and the expected number of vertices.
_Note: TypeAlias = Callable[[float, float], None]

#: Maximum number of vertices unless a level of detail is given.
MOST_VERTICES = 20_000_000
#: Bytes per vertex with its two faces: in a decoded mesh, and the minimum in a compressed one.
_BYTES, _PACKED_BYTES = 36, 0.5
#: Number of fragments downloaded at a time.
_AT_ONCE = 64
#: Timeouts in seconds: of a download without progress, and of a connection.
_SILENCE, _ANSWER = 300.0, 8.0
#: HTTP status codes for missing credentials.
_REFUSED = (401, 403)
#: Faults of segments.
_MISSING = "segment-not-found", "has no mesh", "check the id, or open another segment"
_ONE_LEVEL = "no-such-level", "has one level of detail", "leave it out, or give 0"
_NO_LAYER = "no-layer", "belongs to no layer", "check the link, whose folder has no file info"
#: Remedy of fragments that are missing or broken.
_REPORT = "report it to those who host the layer, or open another segment"
#: Hosts of the cloud storages.
_HOSTS = {"gs": "storage.googleapis.com", "s3": "s3.amazonaws.com"}
#: Parts of the names of exceptions of cloud libraries, and the faults that explain them.
_FAULTS = {
    ("Credential", "Authenti", "Forbidden", "Unauthorized", "Permission", "RefreshError"): (
        "no-permission",
        "may not be read with your permissions or credentials",
        "give cloud-volume those that it needs in ~/.cloudvolume/secrets, or open a public layer",
    ),
    ("InfoUnavailable",): _NO_LAYER,
    ("MeshDecode", "FileType", "Decompress", "Decoding"): (
        "file-damaged",
        "has a broken fragment",
        _REPORT,
    ),
    ("Connect", "Timeout", "gaierror", "NameResolution", "Transport"): (
        "not-reached",
        "cannot be reached",
        "check the network, a proxy, and the link",
    ),
}


def read_linked(path: Path) -> RawMesh:
    """Read the mesh of a link in a file."""
    return read_segment(read_link(path))


def read_segment(
    link: MeshLink,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> RawMesh:
    """Read the mesh of a segment, in nm.

    `InputError` is raised if it cannot be read, and `Cancelled` if `cancel` returns True.
    """
    if importlib.util.find_spec("cloudvolume") is None:
        raise package_missing("is read by", "cloudvolume", "neuro")
    remove_abandoned()
    with TemporaryDirectory(prefix=scratch_prefix(), ignore_cleanup_errors=True) as folder:
        notes = Path(folder, "notes")
        if is_child():
            return fetch(link, notes)
        look, env = _follower(notes, progress, cancel), {"OPENBLAS_NUM_THREADS": "1"}
        try:
            return call_in_child(fetch, link, notes, look=look, env=env)
        except ChildEnded:
            fault = "has a fragment so broken that the library that reads it ends on it"
            raise InputError("process-crashed", fault, "open another segment") from None


def _follower(
    notes: Path, progress: ProgressCallback | None, cancel: CancelCallback | None
) -> Callable[[ProcessTree], None]:
    """Return a check of the child process, which reports its progress, or raises to end it."""
    last, since = ("", 0), time.monotonic()

    def look(tree: ProcessTree) -> None:
        nonlocal last, since
        check_cancelled(cancel)
        seconds, memory = tree.measured()
        # the last line may be incomplete
        lines = notes.read_text().split("\n")[:-1] if notes.exists() else []
        note = lines[-1] if lines else ""
        share, n_vertices = map(float, note.split() or (0.0, 0.0))
        if note != last[0] and progress is not None:
            text = "Downloading the segment" if share < 1.0 else "Joining its fragments"
            progress(Progress("reading", share, message=text))
        if last != (note, int(seconds)):
            last, since = (note, int(seconds)), time.monotonic()
        elif time.monotonic() - since > _SILENCE:
            fault = f"sends nothing for {_SILENCE:.0f} seconds"
            raise InputError("not-reached", fault, "try it later")
        if memory > (limit := ReadLimits.of(round(n_vertices * _BYTES)).memory):
            raise LimitExceeded(f"takes more than {limit / 1e6:.0f} MB of memory to read")

    return look


# -- in the child process ------------------------------------------------------------------------


def fetch(link: MeshLink, notes: Path) -> RawMesh:
    """Read the mesh of a segment in this process, and append progress lines to a file `notes`."""

    def note(share: float, n_vertices: float) -> None:
        with notes.open("a") as file:
            file.write(f"{share} {n_vertices}\n")

    try:
        with contextlib.redirect_stdout(io.StringIO()):
            _check_place(link.source)
            return _read(link, note)
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # noqa: BLE001  its text may contain a secret
        raise _explained(fault) from None


def _explained(fault: Exception) -> InputError:
    """Explain an exception of a cloud library without its text, which may contain a secret."""
    seen: list[BaseException] = [fault]
    while (cause := seen[-1].__cause__ or seen[-1].__context__) and cause not in seen:
        seen.append(cause)
    for each in seen:
        response = getattr(each, "response", None)
        status = getattr(response, "status_code", getattr(each, "code", None))
        names = " ".join(kind.__name__ for kind in type(each).__mro__)
        names += " Forbidden" if status in _REFUSED else ""
        for parts, explained in _FAULTS.items():
            if any(part in names for part in parts):
                return InputError(*explained)
        if status in (400, 404):
            return InputError(*_MISSING)
    said = f"cannot be read ({type(fault).__name__})"
    return InputError("not-readable", said, "check the link, and open it in Neuroglancer")


def _check_place(source: str) -> None:
    """Raise `InputError` if the server is unreachable, as libraries would retry for minutes."""
    protocol, _, rest = source.partition("://")[2].partition("://")
    if protocol == "file":
        if os.name == "posix" and not os.path.isdir(rest):
            remedy = "check the link, whose folder does not exist"
            raise InputError("no-layer", "belongs to no layer", remedy)
        return
    if {"http", "https", "all"} & set(getproxies()):
        return  # the proxy resolves the host
    place = urlsplit(f"https://{_HOSTS.get(protocol, rest)}")
    host, port = place.hostname or "", place.port or (80 if protocol == "http" else 443)
    try:
        socket.create_connection((host, port), _ANSWER).close()
    except OSError:
        fault = f"cannot be reached, as {host} does not answer"
        raise InputError("not-reached", fault, "check the network and the link") from None


def _read(link: MeshLink, note: _Note) -> RawMesh:
    from cloudvolume import CloudVolume

    is_graphene = link.source.startswith("graphene")
    layer, _, folder = link.source.rstrip("/").rpartition("/")
    if is_graphene or not _is_mesh_folder(link.source.partition("://")[2]):
        source = CloudVolume(link.source, progress=False).mesh
    else:  # cloud-volume reads meshes of layers alone: describe a layer around the folder
        info = CloudVolume.create_new_info(
            1, "segmentation", "uint64", "raw", (1, 1, 1), (0, 0, 0), (1, 1, 1), mesh=folder
        )
        source = CloudVolume(layer, info=info, progress=False).mesh
    if is_graphene:
        found = source.get(link.segment)
        mesh, n_fragments = found[link.segment] if isinstance(found, dict) else found, 2
    else:
        read = _of_levels if hasattr(source, "get_manifest") else _of_fragments
        mesh, n_fragments = read(source, link, note)
    note(1.0, len(mesh.vertices))
    return _joined(mesh.vertices, mesh.faces, n_fragments)


def _is_mesh_folder(place: str) -> bool:
    """Return whether a place is a folder of meshes; False for a layer with meshes.

    `InputError` is raised if it is neither.
    """
    import requests
    from cloudfiles import CloudFiles

    info = CloudFiles(place).get_json("info")
    if info is None and place.startswith("http"):  # cloud-files reports a denied file as missing
        answer = requests.get(f"{place}/info", timeout=_ANSWER)
        if answer.status_code in _REFUSED:
            answer.raise_for_status()
    if not isinstance(info, dict):
        raise InputError(*_NO_LAYER)
    if info.get("@type") in ("neuroglancer_legacy_mesh", "neuroglancer_multilod_draco"):
        if not place.partition("://")[2].strip("/").count("/"):
            raise InputError(
                "no-layer",
                "is a folder of meshes at the top of its server or bucket, which cloud-volume"
                " cannot read",
                "give the link of the layer whose info names this folder as its mesh",
            )
        return True
    if not info.get("mesh"):
        fault = "belongs to a layer without meshes (its info names no folder of them)"
        remedy = "take a layer of segments that Neuroglancer shows in 3D"
        raise InputError("no-mesh", fault, remedy)
    return False


def _of_fragments(source: Any, link: MeshLink, note: _Note) -> tuple[Any, int]:
    """Read the fragments in a manifest; return their union and their number.

    Unlike cloud-volume, this also reads fragments compressed by Draco, and sorts fragments by name,
    so that the mesh is reproducible.
    """
    from cloudfiles import CloudFiles
    from cloudvolume import Mesh
    from cloudvolume.datasource.precomputed.mesh.common import apply_transform

    if link.lod:
        raise InputError(*_ONE_LEVEL)
    folder = CloudFiles(source.meta.layerpath, progress=False)
    manifest = folder.get_json(f"{link.segment}:0")
    if manifest is None:
        raise InputError(*_MISSING)
    names = sorted(set(manifest["fragments"]))
    sizes = folder.size(names)
    lacking = [name for name in names if sizes[name] is None]
    if lacking or not names:
        what = f"lacks {counted(len(lacking), 'fragment')}" if lacking else "lists no fragments"
        raise InputError("missing-data", what, _REPORT)
    total, done, n_vertices, meshes = sum(sizes.values()), 0, 0, []
    # the first fragment is downloaded alone, to estimate the number of vertices of all
    for batch in (names[:1], *(names[part] for part in blocks(len(names), _AT_ONCE, 1))):
        found = {each["path"]: each["content"] for each in folder.get(batch)}
        for name in batch:
            meshes.append(_decoded(Mesh, name, found[name]))
            n_vertices, done = n_vertices + len(meshes[-1]), done + sizes[name]
        expected = n_vertices * total / max(done, 1)
        if link.lod is None:
            _check_size([expected])
        note(0.99 * done / max(total, 1), expected)
    mesh = Mesh.concatenate(*meshes)
    mesh.vertices = apply_transform(mesh.vertices, source.transform)
    return mesh, len(names)


def _decoded(kind: Any, name: str, content: bytes) -> Any:
    """Decode a fragment by the mesh class `kind` of cloud-volume."""
    try:
        packed = content[:5] == b"DRACO"
        mesh = kind.from_draco(content) if packed else kind.from_precomputed(content)
        if len(mesh.faces) and int(mesh.faces.max()) >= len(mesh.vertices):
            raise ValueError
    except Exception:  # noqa: BLE001  decoders raise various types
        fault = f"has a broken fragment, {printable(name, 80)}"
        raise InputError("file-damaged", fault, _REPORT) from None
    return mesh


def _of_levels(source: Any, link: MeshLink, note: _Note) -> tuple[Any, int]:
    """Read a level of detail of a multi-resolution mesh; return it and its number of fragments."""
    manifest = source.get_manifest(link.segment)
    if manifest is None:
        raise InputError(*_MISSING)
    n_levels, lod = manifest.num_lods, link.lod or 0
    if lod >= n_levels:
        if n_levels == 1:
            raise InputError(*_ONE_LEVEL)
        several = f"has the levels of detail 0 to {n_levels - 1}"
        raise InputError("no-such-level", several, "give one of these")
    sizes = [int(each.sum()) for each in manifest.fragment_offsets]
    n_vertices = sizes[lod] / _PACKED_BYTES
    if link.lod is None and n_vertices > MOST_VERTICES * limit_factor():
        # the bytes per vertex are measured on the coarsest level
        n_coarse = len(source.get(link.segment, lod=n_levels - 1)[link.segment].vertices)
        expected = [n_coarse * size / max(sizes[-1], 1) for size in sizes]
        _check_size(expected)
        n_vertices = expected[0]
    note(0.1, n_vertices)
    found = source.get(link.segment, lod=lod)
    if link.segment not in found:
        fault = f"has nothing at level of detail {lod}"
        raise InputError("no-such-level", fault, "give another one")
    return found[link.segment], len(manifest.fragment_offsets[lod])


def _check_size(expected: Sequence[float]) -> None:
    """Raise `InputError`, with a level that fits, if the first level has too many vertices."""
    most = MOST_VERTICES * limit_factor()
    said = f"has about {_millions(expected[0])}, more than the {_millions(most)} that are read"
    fitting = next((lod for lod, n in enumerate(expected) if n <= most), None)
    if fitting == 0:
        return
    if fitting is not None:
        size = _millions(expected[fitting])
        raise InputError(
            "too-large",
            f"{said} unasked",
            f"take level of detail {fitting} with about {size} (--lod {fitting}, or lod={fitting})",
        )
    remedy = f"where that fits into memory, set {RAISE_LIMITS}={math.ceil(expected[0] / most)}"
    raise InputError("too-large", f"{said}, and no coarser level of detail", remedy)


def _millions(n: float) -> str:
    return f"{n / 1e6:,.0f} million vertices" if n >= 1e6 else counted(round(n), "vertex")


def _joined(vertices: Any, faces: Any, n_fragments: int) -> RawMesh:
    """Join fragments at coincident boundary edges."""
    from meshmash_viewer.health import repair_mesh
    from meshmash_viewer.mesh import Mesh

    if n_fragments < 2 or not len(faces):
        return RawMesh(vertices, faces, "nm")
    mesh = repair_mesh(Mesh(vertices, faces), "merge_seams")
    n_joined = len(vertices) - mesh.n_vertices
    remark = f"has {counted(n_joined, 'vertex')} at the seams of its fragments, now joined"
    return RawMesh(mesh.vertices, mesh.faces, "nm", remarks=(remark,) if n_joined else ())

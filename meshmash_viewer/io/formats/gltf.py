"""glTF and GLB scenes, by trimesh in a process of its own."""

from __future__ import annotations

import binascii
import json
import struct
import urllib.parse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.guarded import ReadLimits, read_guarded
from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.polygons import MOST_MAPS, RawMap, RawMesh

__all__ = ["gltf_mesh", "read_gltf"]


def read_gltf(path: Path) -> RawMesh:
    """Read all triangle meshes of a scene, placed by its transforms, as one mesh.

    The format repeats a vertex wherever its normal, texture coordinate or material changes;
    vertices with exactly equal coordinates are therefore merged, as for STL.

    Raises
    ------
    InputError
        If the file is no glTF, or its scene holds no triangle mesh.
    """
    scene = _scene_description(path)
    try:
        size = path.stat().st_size + _check_files(scene, path.parent)
    except (TypeError, AttributeError) as fault:
        raise InputError(f"has a scene that is not glTF ({printable(fault, 80)})") from fault
    # One array can be named by a thousand meshes, and one mesh placed by a thousand nodes.
    return read_guarded(gltf_mesh, path, ReadLimits.of(size))


def gltf_mesh(path: Path) -> RawMesh:
    """Read a scene, however large its meshes become; only `read_guarded` calls this."""
    import trimesh

    options: dict[str, Any] = {"process": False, "skip_materials": True}
    try:
        scene = trimesh.load_scene(path, file_type=path.suffix[1:].lower(), **options)
    except (AssertionError, binascii.Error) as fault:
        raise InputError("has a buffer that is shorter than its parts, or damaged") from fault
    vertices, faces, offset = [], [], 0
    attributes: dict[str, list[tuple[int, npt.NDArray[Any]]]] = {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh):
            continue
        placed = np.asarray(geometry.vertices, dtype=np.float64)
        if placed.ndim != 2 or placed.shape[1] != 3:
            raise InputError("has vertices without three coordinates each")
        if not np.array_equal(transform, np.eye(4)):
            placed = placed @ transform[:3, :3].T + transform[:3, 3]
        corners = np.asarray(geometry.faces, dtype=np.int64)
        if np.linalg.det(transform[:3, :3]) < 0:
            corners = corners[:, ::-1]  # a mirror turns triangles inside out
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(placed):
            raise InputError("has a face whose vertex index is out of range")
        vertices.append(placed)
        faces.append(corners + offset)
        for attribute, values in geometry.vertex_attributes.items():
            # those of the format's own have other names: a map's begins with an underscore
            if attribute.startswith("_") and np.size(values) == len(placed):
                attributes.setdefault(attribute[1:], []).append((offset, np.ravel(values)))
        offset += len(placed)
    if not vertices:
        raise InputError("holds no triangle mesh")
    merged, corners, kept = join_vertices(np.concatenate(vertices), np.concatenate(faces))
    maps = []
    for attribute, parts in list(attributes.items())[:MOST_MAPS]:
        whole = np.full(offset, np.nan)  # where a mesh of the scene has not got it
        for start, values in parts:
            whole[start : start + len(values)] = values
        maps.append(RawMap(attribute, whole[kept]))
    return RawMesh(merged, corners, maps=tuple(maps))


def _scene_description(path: Path) -> dict[str, Any]:
    """The JSON that a scene begins with, alone in a .gltf and as the first chunk of a .glb."""
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            head = file.read(20)
            if len(head) < 20 or not head.startswith(b"glTF"):
                raise InputError('does not begin with "glTF"')
            version, _, length, kind = struct.unpack("<4xIII4s", head)
            if version != 2:
                raise InputError(f"is of version {version}, of which only 2 can be read")
            if kind != b"JSON":
                raise InputError("does not begin with the description of a scene")
            text = file.read(min(length, path.stat().st_size))  # asking for 4 GB takes them
        else:
            text = file.read()
    try:
        scene = json.loads(text)
    except (ValueError, RecursionError):
        scene = None
    if not isinstance(scene, dict):
        raise InputError("does not hold the JSON that a glTF scene begins with")
    return scene


def _check_files(scene: dict[str, Any], folder: Path) -> int:
    """Refuse files that are not there, or no files; the bytes of those that are."""
    size = 0
    for buffer in scene.get("buffers", []):
        uri = buffer.get("uri", "data:")
        if not uri.startswith("data:"):
            names = (folder / uri, folder / urllib.parse.unquote(uri))
            found = next((name for name in names if name.is_file()), None)
            if found is None:
                raise InputError(f"refers to a file {printable(uri, 60)} that is not beside it")
            size += found.stat().st_size
    return size

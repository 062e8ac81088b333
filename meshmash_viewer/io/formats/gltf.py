"""glTF and GLB scenes, by trimesh."""

from __future__ import annotations

import binascii
import json
import struct
import urllib.parse
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.faults import printable
from meshmash_viewer.io.guarded import read_guarded
from meshmash_viewer.io.limits import ReadLimits
from meshmash_viewer.io.polygons import RawMesh, merge_equal_vertices

__all__ = ["gltf_mesh", "read_gltf"]

#: Bytes of a component, and components of an element; the names are those of the standard.
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: Triangles and strips of them.
_TRIANGLE_MODES = (4, 5)
#: What trimesh spends on a mesh or a node of a scene, and on a step up from a node, in as many
#: bytes of vertices as it reads in that time.
_OBJECT_BYTES, _STEP_BYTES = 5_000, 200


def read_gltf(path: Path) -> RawMesh:
    """Read all triangle meshes of a scene, placed by its transforms, as one mesh.

    The format repeats a vertex wherever its normal, texture coordinate or material changes;
    vertices with exactly equal coordinates are therefore merged, as for STL.

    Raises
    ------
    InputError
        If the file is no glTF, or its scene holds no triangle mesh.
    """
    size, scene = path.stat().st_size, _scene_description(path)
    try:
        size += _check_files(scene, path.parent)
        effort = _checked_effort(scene)
    except InputError:
        raise
    except KeyError as fault:
        raise InputError(f"has a scene without the entry {printable(fault, 40)}") from fault
    except (TypeError, ValueError, AttributeError, IndexError, RecursionError) as fault:
        raise InputError(f"has a scene that is not glTF ({printable(fault, 80)})") from fault
    # One array can be named by a thousand meshes, and one mesh placed by a thousand nodes.
    if ReadLimits.are_needed(size, effort):
        return read_guarded(gltf_mesh, path, ReadLimits.of(size))
    return gltf_mesh(path)


def gltf_mesh(path: Path) -> RawMesh:
    """Read a scene that has been checked."""
    import trimesh

    options: dict[str, Any] = {"process": False, "skip_materials": True}
    try:
        scene = trimesh.load_scene(path, file_type=path.suffix[1:].lower(), **options)
    except (AssertionError, binascii.Error) as fault:
        raise InputError("has a buffer that is shorter than its parts, or damaged") from fault
    vertices, faces, offset = [], [], 0
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
        offset += len(placed)
    if not vertices:
        raise InputError("holds no triangle mesh")
    return RawMesh(*merge_equal_vertices(np.concatenate(vertices), np.concatenate(faces)))


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
            _check_chunks(file, path.stat().st_size)
            text = file.read(length)
        else:
            text = file.read()
    try:
        scene = json.loads(text)
    except (ValueError, RecursionError):
        scene = None
    if not isinstance(scene, dict):
        raise InputError("does not hold the JSON that a glTF scene begins with")
    return scene


def _check_chunks(file: BinaryIO, size: int) -> None:
    """Refuse a chunk that promises more than is there, for which room would be made."""
    begin = file.tell()
    place = 12
    while place + 8 <= size:
        file.seek(place)
        length = int.from_bytes(file.read(4), "little")
        place += 8 + length
        if place > size:
            raise InputError(
                f"has a part that promises {length} bytes but ends before, so it was cut short"
            )
    file.seek(begin)


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


def _checked_effort(scene: dict[str, Any]) -> float:
    """Bytes that all meshes in all their places come to; indices are within their lists."""
    views, accessors = scene.get("bufferViews", []), scene.get("accessors", [])
    meshes, nodes = scene.get("meshes", []), scene.get("nodes", [])
    for view in views:
        _entry(scene.get("buffers", []), view["buffer"], "buffer")
    effort = float(sum(_natural(view["byteLength"], "a length") for view in views))
    sizes = []
    for accessor in accessors:
        components = _COMPONENTS[accessor["type"]] * _COMPONENT_BYTES[accessor["componentType"]]
        sizes.append(_natural(accessor["count"], "a count") * components)
        _natural(accessor.get("byteOffset", 0), "an offset")
        if "bufferView" in accessor:
            view = _entry(views, accessor["bufferView"], "bufferView")
            # Overlapping elements, of which there may be more than bytes.
            if accessor["count"] > view["byteLength"]:
                raise InputError(
                    f"promises {accessor['count']} elements in {view['byteLength']} bytes, so it"
                    " was cut short"
                )
    effort += sum(sizes)
    of_mesh = []
    for mesh in meshes:
        used = 0
        for primitive in mesh["primitives"]:
            drawn = primitive.get("mode", 4) in _TRIANGLE_MODES
            if drawn and "POSITION" not in primitive["attributes"]:
                raise InputError("has triangles without positions")
            named = [primitive["attributes"].get("POSITION"), primitive.get("indices")]
            used += sum(_entry(sizes, index, "accessor") for index in named if index is not None)
            used += _OBJECT_BYTES
        of_mesh.append(used)
    effort += sum(of_mesh)
    # Every node is reached from its parents once, however often they are.
    depths = dict.fromkeys(_roots(scene), 1)
    waiting = list(depths)
    while waiting:
        parent = waiting.pop()
        node = _entry(nodes, parent, "node")
        effort += _OBJECT_BYTES + _STEP_BYTES * depths[parent]
        if "mesh" in node:
            effort += _entry(of_mesh, node["mesh"], "mesh")
        for child in node.get("children", []):
            if child not in depths:
                depths[child] = depths[parent] + 1
                waiting.append(child)
            effort += _STEP_BYTES
    return effort


def _roots(scene: dict[str, Any]) -> list[int]:
    scenes = scene.get("scenes", [])
    if not scenes:
        return []
    roots: list[int] = _entry(scenes, scene.get("scene", 0), "scene").get("nodes", [])
    return roots


def _entry(entries: list[Any], index: Any, what: str) -> Any:
    if not isinstance(index, int) or not 0 <= index < len(entries):
        raise InputError(f"refers to {what} {printable(index, 20)} of {len(entries)}")
    return entries[index]


def _natural(number: Any, what: str) -> int:
    if not isinstance(number, int) or not 0 <= number < 2**53:
        raise InputError(f"has {what} of {printable(number, 20)}")
    return number

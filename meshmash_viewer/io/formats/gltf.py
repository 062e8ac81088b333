"""glTF and GLB scenes, by trimesh."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh, merge_equal_vertices

__all__ = ["read_gltf"]


def read_gltf(path: Path) -> RawMesh:
    """Read all triangle meshes of a scene, placed by its transforms, as one mesh.

    The format repeats a vertex wherever its normal, texture coordinate or material changes;
    vertices with exactly equal coordinates are therefore merged, as for STL.

    Raises
    ------
    InputError
        If the file is no glTF, or its scene holds no triangle mesh.
    """
    import trimesh

    if path.suffix.lower() == ".gltf":
        _check_json(path)
    options: dict[str, Any] = {"process": False, "skip_materials": True}
    scene = trimesh.load_scene(path, file_type=path.suffix[1:].lower(), **options)
    vertices, faces, offset = [], [], 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh):
            continue
        placed = np.asarray(geometry.vertices, dtype=np.float64)
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


def _check_json(path: Path) -> None:
    """Refuse what is no JSON, of which trimesh only says that it has no "model.gltf"."""
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise InputError("does not hold the JSON that a glTF scene begins with")

"""Layers of segments in local folders, in the formats of Neuroglancer."""

from __future__ import annotations

import json
from pathlib import Path

import DracoPy
import numpy as np
import trimesh

from meshmash_viewer.mesh import Mesh

SEGMENT = 720575940612345678
_BITS = 16
_LEGACY = {"@type": "neuroglancer_legacy_mesh"}


def write_layer(folder: Path, mesh_info: dict[str, object] | None = None) -> Path:
    """Write the info of a layer of segments; without `mesh_info` it has no meshes."""
    scale = {
        "key": "8_8_40", "size": [64, 64, 64], "chunk_sizes": [[64, 64, 64]], "encoding": "raw",
        "resolution": [8, 8, 40], "voxel_offset": [0, 0, 0],
    }  # fmt: skip
    info: dict[str, object] = {
        "type": "segmentation", "data_type": "uint64", "num_channels": 1, "scales": [scale],
    }  # fmt: skip
    folder.mkdir(parents=True)
    if mesh_info is not None:
        info["mesh"] = "mesh"
        (folder / "mesh").mkdir()
        (folder / "mesh" / "info").write_text(json.dumps(mesh_info))
    (folder / "info").write_text(json.dumps(info))
    return folder


def source(folder: Path) -> str:
    return f"precomputed://file://{folder}"


def halves(mesh: Mesh) -> list[Mesh]:
    """Divide a mesh into two chunks by its faces, each with only the vertices it uses."""
    left = mesh.vertices[mesh.faces, 0].mean(axis=1) < 0.0
    pieces = []
    for faces in (mesh.faces[left], mesh.faces[~left]):
        used, corners = np.unique(faces, return_inverse=True)
        pieces.append(Mesh(mesh.vertices[used], corners.reshape(-1, 3)))
    return pieces


def fragment(mesh: Mesh) -> bytes:
    """Return a legacy fragment."""
    parts = (
        np.uint32(mesh.n_vertices), mesh.vertices.astype("<f4"), mesh.faces.astype("<u4")
    )  # fmt: skip
    return b"".join(each.tobytes() for each in parts)


def packed(points: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a mesh encoded by Draco; vertices are nonnegative integers."""
    return bytes(
        DracoPy.encode(
            points, faces, quantization_bits=_BITS, quantization_range=2**_BITS - 1,
            quantization_origin=np.zeros(3),
        )
    )  # fmt: skip


def write_fragments(folder: Path, contents: list[bytes], segment: int = SEGMENT) -> Path:
    """Write a layer with one segment in several fragments."""
    write_layer(folder, _LEGACY)
    names = [f"{segment}:0:{number}" for number in range(len(contents))]
    (folder / "mesh" / f"{segment}:0").write_text(json.dumps({"fragments": names}))
    for name, content in zip(names, contents, strict=True):
        (folder / "mesh" / name).write_bytes(content)
    return folder


def write_levels(folder: Path, meshes: list[Mesh], *, sharded: bool = False) -> Path:
    """Write a layer with a multi-resolution mesh of one segment, the finest level first.

    The meshes lie in the cube from -1000 to 1000. Each level has two fragments. On the finest level
    the fragments are two chunks, each half as wide as the cube.
    """
    from cloudvolume.datasource.precomputed.mesh.multilod import MultiLevelPrecomputedMeshManifest
    from cloudvolume.datasource.precomputed.sharding import ShardingSpecification

    chunk, top = np.array([1000.0, 2000.0, 2000.0]), 2**_BITS - 1
    positions, sizes, data = [], [], b""
    for level, mesh in enumerate(meshes):
        parts, size = [], chunk * 2**level
        for number, piece in enumerate(halves(mesh)):
            place = [0 if level else number, 0, 0]
            inside = np.clip((piece.vertices + 1000.0) / size - place, 0.0, 1.0)
            parts.append(packed(np.round(inside * top), piece.faces))
        positions.append(np.array([[0, 0, 0], [0 if level else 1, 0, 0]]))
        sizes.append(np.array([len(part) for part in parts]))
        data += b"".join(parts)
    manifest = MultiLevelPrecomputedMeshManifest(
        SEGMENT, chunk, np.full(3, -1000.0), len(meshes), [2.0**k for k in range(len(meshes))],
        np.zeros((len(meshes), 3)), [2] * len(meshes), positions, np.array(sizes).ravel(),
    ).to_binary()  # fmt: skip
    sharding = {
        "@type": "neuroglancer_uint64_sharded_v1", "preshift_bits": 0, "shard_bits": 1,
        "hash": "murmurhash3_x86_128", "minishard_bits": 1, "minishard_index_encoding": "gzip",
        "data_encoding": "raw",
    }  # fmt: skip
    info = {
        "@type": "neuroglancer_multilod_draco", "vertex_quantization_bits": _BITS,
        "transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], "lod_scale_multiplier": 1.0,
    }  # fmt: skip
    write_layer(folder, {**info, "sharding": sharding} if sharded else info)
    if sharded:
        spec = ShardingSpecification.from_dict(sharding)
        shards = spec.synthesize_shards({SEGMENT: data + manifest}, {SEGMENT: len(manifest)})
        for name, content in shards.items():
            (folder / "mesh" / name).write_bytes(content)
    else:
        (folder / "mesh" / f"{SEGMENT}.index").write_bytes(manifest)
        (folder / "mesh" / str(SEGMENT)).write_bytes(data)
    return folder


def box(n_divisions: int) -> Mesh:
    """Return a cube of side 1800 that has vertices on its middle plane, too."""
    made = trimesh.creation.box((1800.0, 1800.0, 1800.0))
    for _ in range(n_divisions):
        made = made.subdivide()
    return Mesh(made.vertices, made.faces)

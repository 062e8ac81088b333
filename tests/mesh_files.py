"""An octahedron in files of every format, written without the package where that is possible."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from meshmash_viewer.mesh import Mesh

# An octahedron stretched along x: closed, all corners exact in float32.
VERTICES = np.array(
    [[2, 0, 0], [-2, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64
)
FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
)


def write_obj(path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in VERTICES]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    path.write_text("\n".join(lines) + "\n")


def write_off(path: Path) -> None:
    lines = ["OFF", "# an octahedron", f"{len(VERTICES)} {len(FACES)} 12"]
    lines += [" ".join(map(str, row)) for row in VERTICES]
    lines += ["3 " + " ".join(map(str, row)) + " 255 0 0" for row in FACES]
    path.write_text("\n".join([*lines, ""]))


def ply_header(kind: str, n_faces: int = len(FACES)) -> bytes:
    return (
        f"ply\nformat {kind} 1.0\ncomment test\nelement vertex {len(VERTICES)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        f"element face {n_faces}\nproperty list uchar int vertex_indices\n"
        "property float alpha\nend_header\n"
    ).encode()


def write_ply(path: Path, order: str = "<") -> None:
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = b"".join(struct.pack(order + "3fB", *row, 7) for row in VERTICES)
    body += b"".join(struct.pack(order + "B3if", 3, *row, 0.5) for row in FACES)
    path.write_bytes(ply_header(kind) + body)


def write_big_endian_ply(path: Path) -> None:
    write_ply(path, ">")


def write_text_ply(path: Path) -> None:
    body = "".join(f"{x} {y} {z} 7\n" for x, y, z in VERTICES)
    body += "".join(f"3 {a} {b} {c} 0.5\n" for a, b, c in FACES)
    path.write_bytes(ply_header("ascii") + body.encode())


def write_stl(path: Path) -> None:
    body = b"".join(
        struct.pack("<3f9fH", 0, 0, 0, *VERTICES[face].reshape(-1), 0) for face in FACES
    )
    # A header that begins with "solid" is legal in binary files too.
    path.write_bytes(b"solid".ljust(80) + struct.pack("<I", len(FACES)) + body)


def write_text_stl(path: Path) -> None:
    lines = ["solid thing"]
    for face in FACES:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {x:e} {y:e} {z:e}" for x, y, z in VERTICES[face]]
        lines += [" endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid thing"]))


def write_npz(path: Path) -> None:
    np.savez(path, vertices=VERTICES, faces=FACES)


def write_glb(path: Path) -> None:
    import trimesh

    trimesh.Trimesh(VERTICES, FACES, process=False).export(path)


def write_gltf(path: Path) -> None:
    import trimesh

    files = trimesh.Trimesh(VERTICES, FACES, process=False).scene().export(file_type="gltf")
    for name, content in files.items():
        (path if name.endswith(".gltf") else path.parent / name).write_bytes(content)


def write_vtk(path: Path) -> None:
    import pyvista

    pyvista.PolyData.from_regular_faces(VERTICES, FACES).save(path)


def write_vtu(path: Path) -> None:
    import pyvista

    pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: FACES}, VERTICES).save(path)


def write_gifti(path: Path) -> None:
    from nibabel.gifti import GiftiDataArray, GiftiImage

    arrays = [
        GiftiDataArray(VERTICES.astype(np.float32), intent="NIFTI_INTENT_POINTSET"),
        GiftiDataArray(FACES.astype(np.int32), intent="NIFTI_INTENT_TRIANGLE"),
    ]
    path.write_bytes(GiftiImage(darrays=arrays).to_bytes())


def write_freesurfer(path: Path) -> None:
    from nibabel.freesurfer import write_geometry

    write_geometry(str(path), VERTICES, FACES, create_stamp="")


def write_freesurfer_text(path: Path) -> None:
    rows = [" ".join(map(str, each)) + " 0" for each in (*VERTICES.tolist(), *FACES.tolist())]
    sizes = f"{len(VERTICES)} {len(FACES)}"
    path.write_text("\n".join(["#!ascii version of lh.pial", sizes, *rows]) + "\n")


def draco_bytes() -> bytes:
    import DracoPy

    step = 1.0 / 64.0  # quantization step
    return bytes(
        DracoPy.encode(
            VERTICES,
            FACES,
            quantization_bits=9,
            quantization_range=511 * step,
            quantization_origin=np.full(3, -2.0),
        )
    )


def write_draco(path: Path) -> None:
    path.write_bytes(draco_bytes())


def write_meshparty(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["vertices"] = VERTICES.astype(np.float32)
        file["faces"] = FACES.astype(np.uint32).ravel()  # flat, as MeshParty sometimes stores them


#: Writers by file name.
WRITERS: dict[str, Callable[[Path], None]] = {
    "mesh.obj": write_obj,
    "mesh.off": write_off,
    "mesh.ply": write_ply,
    "big.ply": write_big_endian_ply,
    "text.ply": write_text_ply,
    "mesh.stl": write_stl,
    "text.stl": write_text_stl,
    "mesh.npz": write_npz,
    "mesh.glb": write_glb,
    "mesh.gltf": write_gltf,
    "mesh.vtp": write_vtk,
    "mesh.vtu": write_vtu,
    "mesh.vtk": write_vtk,
    "mesh.surf.gii": write_gifti,
    "mesh.h5": write_meshparty,
    "mesh.drc": write_draco,
    "lh.pial": write_freesurfer,
    "lh.pial.asc": write_freesurfer_text,
}


def same_surface(mesh: Mesh, vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Return whether two surfaces have the same oriented triangles, in any order."""

    def triangles(points: np.ndarray, corners: np.ndarray) -> list[tuple[float, ...]]:
        rolled = []
        for triangle in points[corners] + 0.0:
            start = min(range(3), key=lambda i: tuple(triangle[i]))
            rolled.append(tuple(np.roll(triangle, -start, axis=0).reshape(-1)))
        return sorted(rolled)

    return mesh.n_vertices == len(vertices) and np.allclose(
        triangles(mesh.vertices, mesh.faces), triangles(vertices, faces)
    )

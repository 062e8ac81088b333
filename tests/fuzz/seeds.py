"""Small valid files of every format, as input of the mutators."""

from __future__ import annotations

import base64
import gzip
import io
import json
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np

Seed = tuple[str, bytes]

# Vertices per side of a bumpy sheet: an open, asymmetric surface with non-integer coordinates.
_SIDE = 5


def _sheet() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(_SIDE), np.arange(_SIDE), indexing="ij")
    height = np.sin(1.3 * x) + np.cos(0.7 * y)
    vertices = np.column_stack([x.ravel(), y.ravel(), height.ravel()]).astype(np.float32)
    corner = (x[:-1, :-1] * _SIDE + y[:-1, :-1]).ravel()
    a, b, c, d = corner, corner + _SIDE, corner + _SIDE + 1, corner + 1
    return vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def sound_files() -> dict[str, list[Seed]]:
    """Return names and contents of valid files, by format."""
    vertices, faces = _sheet()
    files = {
        "obj": _obj(vertices, faces),
        "off": _off(vertices, faces),
        "ply": _ply(vertices, faces),
        "stl": _stl(vertices, faces),
        "npz": _npz(vertices, faces),
        "gltf": _gltf(vertices, faces),
        "vtk": _vtk(vertices, faces),
        "vtp": _vtp(vertices, faces),
        "gifti": _gifti(vertices, faces),
        "freesurfer": _freesurfer(vertices, faces),
    }
    plain = [files[kind][0] for kind in ("obj", "ply", "stl", "gifti")]
    files["gzip"] = [(f"{name}.gz", gzip.compress(data, 6, mtime=0)) for name, data in plain]
    return files


def _rows(array: np.ndarray) -> str:
    return "".join(" ".join(f"{value:.6g}" for value in row) + "\n" for row in array)


def _obj(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    points = "".join(f"v {line}\n" for line in _rows(vertices).splitlines())
    plain = points + "".join(f"f {a} {b} {c}\n" for a, b, c in faces + 1)
    rich = "# made by hand\r\nmtllib a.mtl\r\n" + points.replace("\n", " 0.5 0.5 0.5\r\n")
    rich += "vt 0 0\r\nvn 0 0 1\r\no sheet\r\ng side\r\nusemtl a\r\n"
    rich += "".join(f"f {a}/1/1 {b}/1/1 \\\r\n{c}/1/1\r\n" for a, b, c in faces[:8] + 1)
    rich += "".join(f"f {a}//1 {b}//1 {c}//1\r\n" for a, b, c in faces[8:] - len(vertices))
    return [("mesh.obj", plain.encode()), ("rich.obj", rich.encode())]


def _off(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    counts = f"{len(vertices)} {len(faces)} 0\n"
    body = _rows(vertices) + "".join(f"3 {a} {b} {c} 255 0 0\n" for a, b, c in faces)
    return [
        ("mesh.off", ("OFF\n" + counts + body).encode()),
        ("c.off", ("COFF # coloured\n" + counts.replace("\n", "\r\n") + body).encode()),
    ]


def _ply(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    header = (
        "ply\nformat {kind} 1.0\ncomment a sheet\nelement vertex {n}\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nelement face {m}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    n, m = len(vertices), len(faces)
    text = "".join(f"{line} 7\n" for line in _rows(vertices).splitlines())
    text += "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
    seeds = [("text.ply", (header.format(kind="ascii", n=n, m=m) + text).encode())]
    for order, kind in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        body = b"".join(struct.pack(order + "3fB", *row, 7) for row in vertices)
        body += b"".join(struct.pack(order + "B3i", 3, *row) for row in faces)
        seeds.append((f"{kind}.ply", header.format(kind=kind, n=n, m=m).encode() + body))
    head = header.format(kind="binary_little_endian", n=n, m=2)
    body = b"".join(struct.pack("<3fB", *row, 7) for row in vertices)
    uneven = struct.pack("<B3iB4i", 3, 0, 5, 6, 4, 1, 6, 7, 2)
    seeds.append(("uneven.ply", head.encode() + body + uneven))
    head = head.replace("element face 2", "element tristrips 1").replace("list uchar", "list int")
    strips = struct.pack("<i9i", 9, 0, 5, 1, 6, -1, 2, 7, 3, 8)
    seeds.append(("strips.ply", head.encode() + body + strips))
    return seeds


def _stl(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel(), 0) for face in faces)
    lines = ["solid thing"]
    for face in faces:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {x:e} {y:e} {z:e}" for x, y, z in vertices[face]]
        lines += [" endloop", "endfacet"]
    return [
        ("mesh.stl", bytes(80) + struct.pack("<I", len(faces)) + body),
        ("text.stl", "\n".join([*lines, "endsolid thing\n"]).encode()),
    ]


def _npz(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    seeds = []
    for name, save in (("mesh.npz", np.savez), ("packed.npz", np.savez_compressed)):
        file = io.BytesIO()
        meta = json.dumps({"mesh": {"unit": "nm"}})
        save(file, vertices=vertices, faces=faces, meta=np.array(meta))
        seeds.append((name, file.getvalue()))
    return seeds


def _gltf(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    points, corners = vertices.tobytes(), faces.astype("<u2").tobytes()
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1, 2], "rotation": [0, 0, 0.6, 0.8]},
            {"mesh": 0, "translation": [1, 2, 3]},
            {"mesh": 0, "scale": [1, -1, 2]},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(points) + len(corners)}],
    }
    data = points + corners
    packed = glb(json.dumps(scene).encode(), data)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    scene["buffers"] = [{"byteLength": len(data), "uri": uri}]
    return [("mesh.glb", packed), ("mesh.gltf", json.dumps(scene).encode())]


def glb(text: bytes, data: bytes) -> bytes:
    """Return a GLB file of a scene's JSON text and its buffer."""
    text += b" " * (-len(text) % 4)
    data += bytes(-len(data) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, length) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def _vtk(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    head = "# vtk DataFile Version 3.0\na sheet\n{kind}\nDATASET {data}\n"
    points = f"POINTS {len(vertices)} float\n"
    cells = np.column_stack([np.full(len(faces), 3), faces])
    polygons = f"POLYGONS {len(faces)} {cells.size}\n"
    values = f"POINT_DATA {len(vertices)}\nSCALARS height float 1\nLOOKUP_TABLE default\n"
    text = head.format(kind="ASCII", data="POLYDATA") + points + _rows(vertices)
    text += polygons + _rows(cells) + values + _rows(vertices[:, 2:])
    binary = (head.format(kind="BINARY", data="POLYDATA") + points).encode()
    binary += vertices.astype(">f4").tobytes() + b"\n" + polygons.encode()
    binary += cells.astype(">i4").tobytes() + b"\n" + values.encode()
    binary += vertices[:, 2].astype(">f4").tobytes() + b"\n"
    grid = head.format(kind="ASCII", data="UNSTRUCTURED_GRID") + points + _rows(vertices)
    grid += f"CELLS {len(faces)} {cells.size}\n" + _rows(cells)
    grid += f"CELL_TYPES {len(faces)}\n" + "5\n" * len(faces)
    strips = text[: text.index("POLYGONS")] + "TRIANGLE_STRIPS 1 7\n6 0 5 1 6 2 7\n"
    return [
        ("text.vtk", text.encode()),
        ("binary.vtk", binary),
        ("grid.vtk", grid.encode()),
        ("strips.vtk", strips.encode()),
    ]


def _vtp(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    points, cells, poly = vtkPoints(), vtkCellArray(), vtkPolyData()
    corners = np.ascontiguousarray(faces, dtype=np.int64)
    offsets = np.arange(0, corners.size + 1, 3, dtype=np.int64)
    points.SetData(numpy_support.numpy_to_vtk(vertices))
    cells.SetData(*(numpy_support.numpy_to_vtk(part) for part in (offsets, corners.ravel())))
    poly.SetPoints(points)
    poly.SetPolys(cells)
    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("text", "inline", "appended", "raw", "packed"):
            path = Path(folder) / f"{name}.vtp"
            writer = vtkXMLPolyDataWriter()
            writer.SetFileName(str(path))
            writer.SetInputData(poly)
            getattr(writer, f"SetCompressorTypeTo{'ZLib' if name == 'packed' else 'None'}")()
            mode = {"text": "Ascii", "inline": "Binary"}.get(name, "Appended")
            getattr(writer, f"SetDataModeTo{mode}")()
            writer.SetEncodeAppendedData(name == "appended")
            writer.Write()
            seeds.append((path.name, path.read_bytes()))
    return seeds


def _gifti(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    seeds = []
    arrays = (("POINTSET", "FLOAT32", vertices), ("TRIANGLE", "INT32", faces.astype("<i4")))
    for name, encoding in (
        ("text", "ASCII"),
        ("plain", "Base64Binary"),
        ("packed", "GZipBase64Binary"),
    ):
        body = ""
        for intent, kind, array in arrays:
            data = array.tobytes() if name != "packed" else zlib.compress(array.tobytes())
            text = _rows(array) if name == "text" else base64.b64encode(data).decode()
            body += (
                f'<DataArray Intent="NIFTI_INTENT_{intent}" DataType="NIFTI_TYPE_{kind}"'
                f' ArrayIndexingOrder="RowMajorOrder" Dimensionality="2" Dim0="{len(array)}"'
                f' Dim1="3" Encoding="{encoding}" Endian="LittleEndian" ExternalFileName=""'
                ' ExternalFileOffset=""><MetaData><MD><Name>a</Name><Value>b</Value></MD>'
                f"</MetaData><Data>{text}</Data></DataArray>"
            )
        whole = f'<?xml version="1.0"?><GIFTI Version="1.0" NumberOfDataArrays="2">{body}</GIFTI>'
        seeds.append((f"{name}.surf.gii", whole.encode()))
    return seeds


def _freesurfer(vertices: np.ndarray, faces: np.ndarray) -> list[Seed]:
    n, m = len(vertices), len(faces)
    triangles = b"\xff\xff\xfecreated by nobody\n\n" + struct.pack(">ii", n, m)
    triangles += vertices.astype(">f4").tobytes() + faces.astype(">i4").tobytes()
    quads = np.column_stack([faces[: m // 2], faces[m // 2 :, 2]])
    corners = b"".join(int(corner).to_bytes(3, "big") for corner in quads.ravel())
    counts = n.to_bytes(3, "big") + len(quads).to_bytes(3, "big")
    new = b"\xff\xff\xfd" + counts + vertices.astype(">f4").tobytes() + corners
    old = b"\xff\xff\xff" + counts + (100 * vertices).astype(">i2").tobytes() + corners
    values = b"\xff\xff\xff" + struct.pack(">iii", n, m, 1) + vertices[:, 2].astype(">f4").tobytes()
    return [("lh.pial.T1", triangles), ("lh.white", new), ("lh.orig", old), ("lh.sphere", values)]

"""Byte order marks at the beginning of text files of every format."""

from __future__ import annotations

import codecs
import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.features.formula import Formula
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.session import Session, read_session, write_session

pytestmark = pytest.mark.usefixtures("read_here")

POINTS = "0 0 0", "2 0 0", "2 1 0", "0 1 0"
FACES = (0, 1, 2), (0, 2, 3)


def rows(form: str, faces: tuple[tuple[int, ...], ...] = FACES) -> str:
    return "".join(form.format(*face) + "\n" for face in faces)


def facet(face: tuple[int, ...]) -> str:
    corners = "".join(f"vertex {POINTS[corner]}\n" for corner in face)
    return f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"


PLY = (
    "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
)
LEGACY = "# vtk DataFile Version 3.0\na sheet\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n"
XML = (
    '<VTKFile type="PolyData" version="0.1"><PolyData><Piece NumberOfPoints="4" NumberOfPolys="2">'
    '<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">{}</DataArray>'
    '</Points><Polys><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 0 2 3'
    '</DataArray><DataArray type="Int32" Name="offsets" format="ascii">3 6</DataArray></Polys>'
    "</Piece></PolyData></VTKFile>"
)

#: Mesh files that cannot be read correctly if a byte order mark hides their first line.
TEXTS = {
    "vertex first.obj": "".join(f"v {p}\n" for p in POINTS) + rows("f -4 -3 -2", FACES[:1])
    + "f 1 3 4\n",
    "face first.obj": "f 1 2 3\nf 1 3 4\n" + "".join(f"v {p}\n" for p in POINTS),
    "a.ply": PLY.format("ascii") + "\n".join(POINTS) + "\n" + rows("3 {} {} {}"),
    "a.off": "OFF\n4 2 0\n" + "\n".join(POINTS) + "\n" + rows("3 {} {} {}"),
    "comment first.off": "# made\nCOFF4 2 0\n" + " 0 0 0 1\n".join(POINTS) + " 0 0 0 1\n"
    + rows("3 {} {} {}"),
    "a.stl": "solid\n" + "".join(map(facet, FACES)) + "endsolid\n",
    "a.vtk": LEGACY + "\n".join(POINTS) + "\nPOLYGONS 2 8\n" + rows("3 {} {} {}"),
    "a.vtp": XML.format(" ".join(POINTS)),
}  # fmt: skip
ENCODINGS: dict[str, Callable[[str], bytes]] = {
    "UTF-8": lambda text: codecs.BOM_UTF8 + text.encode(),
    "UTF-8 twice": lambda text: 2 * codecs.BOM_UTF8 + text.encode(),
    "UTF-8, lines ended by two": lambda text: (
        codecs.BOM_UTF8 + text.encode().replace(b"\n", b"\r\n")
    ),
    "UTF-8, old lines": lambda text: codecs.BOM_UTF8 + text.encode().replace(b"\n", b"\r"),
    "UTF-16, little": lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
    "UTF-16, big": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    "UTF-32, little": lambda text: codecs.BOM_UTF32_LE + text.encode("utf-32-le"),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("name", [name for name in TEXTS if not name.endswith((".vtk", ".vtp"))])
def test_a_mark_in_front_of_a_mesh(name: str, encoding: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(ENCODINGS[encoding](TEXTS[name]))
    mesh = read_mesh(tmp_path / name)
    assert (mesh.n_vertices, mesh.n_faces, mesh.area) == (4, 2, 2.0)


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("a.vtk", "UTF-8"), ("a.vtk", "UTF-16, little"), ("a.vtp", "UTF-8")],
)
def test_a_mark_in_front_of_what_vtk_reads(name: str, encoding: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(ENCODINGS[encoding](TEXTS[name]))
    mesh = read_mesh(tmp_path / name)
    assert (mesh.n_vertices, mesh.n_faces, mesh.area) == (4, 2, 2.0)


def test_marks_within_gzip_and_between_files(tmp_path: Path) -> None:
    marked = codecs.BOM_UTF8 + TEXTS["vertex first.obj"].encode()
    (tmp_path / "a.obj.gz").write_bytes(gzip.compress(marked))
    assert read_mesh(tmp_path / "a.obj.gz").area == 2.0
    (tmp_path / "two.obj").write_bytes(marked + codecs.BOM_UTF8 + b"v 0 0 1\nf 1 2 5\n")
    mesh = read_mesh(tmp_path / "two.obj")
    assert (mesh.n_vertices, mesh.n_faces, mesh.area) == (5, 3, 3.0)


@pytest.mark.parametrize("order", "<>")
def test_a_mark_in_front_of_a_binary_ply(order: str, tmp_path: Path) -> None:
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    points = np.array([row.split() for row in POINTS], dtype=f"{order}f4")
    body = points.tobytes()
    for face in FACES:
        body += b"\3" + np.array(face, dtype=f"{order}i4").tobytes()
    path = tmp_path / "a.ply"
    for header in (PLY, PLY.replace("\n", "\r\n"), PLY.replace("\n", "\r")):
        path.write_bytes(codecs.BOM_UTF8 + header.format(kind).encode() + body)
        assert read_mesh(path).area == 2.0


def test_a_mark_that_something_else_follows(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(codecs.BOM_UTF16_LE + b"v 0 0 0\xd8")
    with raises("wrong-format", "begins as text in UTF-16 and has something else"):
        read_mesh(tmp_path / "a.obj")


def test_marks_in_tables_formulas_and_sessions(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TEXTS["vertex first.obj"])
    mesh = read_mesh(tmp_path / "a.obj")
    (tmp_path / "a.csv").write_bytes(codecs.BOM_UTF8 + b"height\n3\n1\n4\n1\n")
    (height,) = read_maps(tmp_path / "a.csv", mesh)
    assert (height.name, height.values.tolist()) == ("height", [3, 1, 4, 1])
    assert Formula("\ufeffexp(-t*x)") == Formula("exp(-t*x)")
    write_session(tmp_path / "a.session", Session(mesh_path=str(tmp_path / "a.obj"), pins=[2]))
    written = (tmp_path / "a.session").read_bytes()
    for mark in (codecs.BOM_UTF8, codecs.BOM_UTF16_LE):
        encoded = written if mark == codecs.BOM_UTF8 else written.decode().encode("utf-16-le")
        (tmp_path / "b.session").write_bytes(mark + encoded)
        assert read_session(tmp_path / "b.session").pins == [2]

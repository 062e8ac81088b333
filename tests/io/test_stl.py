"""STL files with unusual names, spellings, headers and counts."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.io.read import read_mesh

# A pyramid without its base, all corners exact in float32: 4 triangles, 5 vertices.
CORNERS = np.array([[2, 0, 0], [0, 2, 0], [-2, 0, 0], [0, -2, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
AREA = 4 * 0.5 * np.linalg.norm(np.cross([-2, 2, 0], [-2, 0, 1]))


def facet(face: np.ndarray) -> str:
    corners = "".join(f"  vertex {x:e} {y:e} {z:e}\n" for x, y, z in CORNERS[face])
    return f"facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet\n"


FACETS = "".join(map(facet, FACES))
HALVES = "".join(map(facet, FACES[:2])), "".join(map(facet, FACES[2:]))
SPACED = FACETS.replace("endfacet", "end facet").replace("endloop", "end loop")

TEXTS = {
    "plain": f"solid thing\n{FACETS}endsolid thing\n",
    "name of words": f"solid vertex facet normal endfacet\n{FACETS}endsolid vertex endfacet\n",
    "name of a vertex": f"solid vertex 1 2 3\n{FACETS}endsolid vertex 1 2 3",
    "name of a facet": f"solid facet normal 0 0 1\n{FACETS}endsolid facet normal 0 0 1\n",
    "name of an end": f"solid endsolid end solid\n{FACETS}endsolid\n",
    "no name": f"solid\n{FACETS}endsolid\n",
    "words apart": f"solid thing\n{SPACED}end solid thing\n",
    "capitals": f"SOLID THING\n{FACETS.upper()}ENDSOLID\n",
    "some capitals": f"Solid Thing\n{FACETS.title()}EndSolid\n",
    "comments first": f"# made by hand\n\n; with 4 facets\nsolid thing\n{FACETS}endsolid\n",
    "comments of words first": f"vertex list\nfacet normal ones\nsolid\n{FACETS}endsolid\n",
    "comments within": f"solid\n# vertex 1 2 3\n{FACETS}# endfacet\nendsolid\n",
    "no endsolid": f"solid thing\n{FACETS}",
    "no endsolid, no last line end": f"solid thing\n{FACETS}".rstrip(),
    "no solid": FACETS + "endsolid\n",
    "neither": FACETS,
    "two solids": f"solid a\n{HALVES[0]}endsolid a\nsolid b\n{HALVES[1]}endsolid b\n",
    "two solids, no ends": f"solid vertex\n{HALVES[0]}solid facet\n{HALVES[1]}",
    "an empty solid too": f"solid a\nendsolid a\nsolid b\n{FACETS}endsolid b\n",
    "two line ends": f"solid thing\n{FACETS}endsolid\n".replace("\n", "\r\n"),
    "old line ends": f"solid vertex\n{FACETS}endsolid\n".replace("\n", "\r"),
    "tabs": f"solid thing\n{FACETS}endsolid\n".replace("  ", "\t\t").replace(" outer", "\touter"),
    "empty lines": f"\n\nsolid thing\n{FACETS}endsolid\n".replace("\n", "\n\n"),
    "spaces at ends": f"  solid thing\n{FACETS}endsolid\n".replace("\n", "  \n"),
    "no indentation": f"solid thing\n{FACETS}endsolid\n".replace("\n ", "\n").replace("\n ", "\n"),
    "one line": f"solid thing\n{FACETS}endsolid\n".replace("\n", " "),
    "one line, name of a word": f"solid vertex\n{FACETS}endsolid vertex\n".replace("\n", " "),
    "a line for each facet": "solid thing\n"
    + "".join(facet(face).replace("\n", " ").strip() + "\n" for face in FACES)
    + "endsolid\n",
    "other letters": f"solid Würfel\n{FACETS}endsolid Würfel\n",
}


@pytest.mark.parametrize("name", TEXTS)
def test_text(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(TEXTS[name].encode())
    mesh = read_mesh(tmp_path / "a.stl")
    assert (mesh.n_vertices, mesh.n_faces) == (5, 4)
    assert mesh.area == pytest.approx(AREA)


def test_facets_of_four_corners(tmp_path: Path) -> None:
    corners = "".join(f"vertex {x} {y} 0\n" for x, y in ((0, 0), (2, 1), (0, 2), (0.5, 1)))
    text = f"solid\nfacet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n{FACETS}endsolid\n"
    (tmp_path / "a.stl").write_text(text)
    mesh = read_mesh(tmp_path / "a.stl")
    assert mesh.n_faces == 6
    assert mesh.area == pytest.approx(AREA + 1.5)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (f"solid\n{FACETS[: len(FACETS) // 2]}", "file-cut-short"),
        (f"solid\n{FACETS}facet nor", "file-cut-short"),
        (f"solid\n{FACETS}fac", "file-cut-short"),
        (f"solid\n{FACETS}".replace("endfacet\n", "", 1), "file-cut-short"),
        (f"solid\n{FACETS}".replace("  vertex", "  vertx", 1), "file-cut-short"),
        (f"solid\n{FACETS}".replace("0.0", "0,0", 1), "not-a-number"),
        (f"solid\n{FACETS}".replace("e+00\n", "e+00 1\n", 1), "wrong-shape"),
        (f"solid vertex\n{FACETS.replace('vertex', 'vertex nan', 1)}endsolid", "wrong-shape"),
        ("solid vertex facet normal\nendsolid\n", "no-vertices"),
    ],
)
def test_text_that_is_broken(text: str, code: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_text(text)
    with raises(code):
        read_mesh(tmp_path / "a.stl")


def binary(header: bytes = bytes(80), count: int = len(FACES), after: bytes = b"") -> bytes:
    records = b"".join(struct.pack("<12fH", 0, 0, 1, *CORNERS[face].ravel(), 0) for face in FACES)
    return header + struct.pack("<I", count) + records + after


BINARIES = {
    "plain": binary(),
    "solid": binary(b"solid thing".ljust(80)),
    "solid of words": binary(b"solid facet normal vertex endfacet endsolid".ljust(80)),
    "solid, bytes after it": binary(b"solid thing".ljust(80), after=b"made by hand"),
    "solid, lines after it": binary(b"solid\nfacet normal\n".ljust(80), after=b"\n\n"),
    "bytes after it": binary(after=bytes(7)),
    "a record of nothing after it": binary(after=bytes(50)),
    "text after it": binary(after=b"colour: red, and other things that are said here. " * 3),
    "marked in front": binary("\ufeffsolid".encode().ljust(80)),
    "count 0": binary(count=0),
    "count of all bits": binary(count=0xFFFFFFFF),
    "solid, count 0": binary(b"solid thing".ljust(80), count=0),
    "solid, count of all bits": binary(b"solid thing".ljust(80), count=0xFFFFFFFF),
    "short header": binary(bytes(79)),
    "shorter header": binary(b"solid thing\n"),
    "no header": binary(b""),
    "long header": binary(b"a header of more bytes".ljust(96)),
    "header with line ends": binary(b"\r\n" * 40),
}  # fmt: skip


@pytest.mark.parametrize("name", BINARIES)
def test_binary(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(BINARIES[name])
    mesh = read_mesh(tmp_path / "a.stl")
    assert (mesh.n_vertices, mesh.n_faces) == (5, 4)
    assert mesh.area == pytest.approx(AREA)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (binary()[:-7], "file-cut-short"),
        (binary(count=5), "file-cut-short"),
        (binary(count=2), "counts-differ"),
        (binary(count=2, after=bytes(7)), "counts-differ"),
        (binary(count=0)[:-7], "file-cut-short"),
        (binary(count=0xFFFFFFFF, after=b"end"), "file-cut-short"),
        (bytes(84), "no-vertices"),
        (bytes(60), "file-cut-short"),
    ],
)
def test_binary_that_is_broken(content: bytes, code: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(content)
    with raises(code):
        read_mesh(tmp_path / "a.stl")

"""Provenance and column names in comment lines of PLY and OBJ files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.provenance import comment_lines, stated_comment
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import write_features, write_mesh
from meshmash_viewer.mesh import Mesh

BALL = shapes.icosphere(1)
MESH = Mesh(BALL.vertices, BALL.faces, unit="nm", name="ball")
TIMES = tuple(f"hks_t={time:.6g} nm²" for time in np.geomspace(5e4, 2e7, 32))
NINE = np.random.default_rng(1).normal(size=(MESH.n_vertices, 9))
#: Column names: many, none, repeated, long, with spaces, quotes, line ends and accents.
COLUMNS: dict[str, tuple[str, ...]] = {
    "32 times": TIMES,
    "one": ("band",),
    "none": (),
    "twice": ("a", "a", "x", "a"),
    "long": ("a" * 700, "a" * 700 + "b"),
    "spaces": ("two  words", f"{'far' + ' ' * 600 + 'apart'}", "end, ", ' "quoted", "twice" '),
    "control": ("line\nend", "tab\there", "null\0"),
    "accents": ("λ₂ µm⁻²", "\N{GREEK SMALL LETTER PHI}" * 90),
    "commas": tuple('," ' * count for count in range(1, 60)),
}


def header(path: Path) -> list[str]:
    return path.read_bytes().partition(b"end_header")[0].decode("ascii").split("\n")


@pytest.mark.parametrize("name", COLUMNS)
def test_header_lines_are_short_and_whole(name: str, tmp_path: Path) -> None:
    columns = COLUMNS[name]
    shape = MESH.n_vertices, len(columns)
    values = np.arange(np.prod(shape), dtype=np.float64).reshape(shape)
    path = tmp_path / "ball.ply"
    write_features(path, Features(values, columns), MESH, meta={"formula": "a b " * 900})
    lines = header(path)
    assert max(map(len, lines)) <= 500
    assert not [
        line for line in lines if line.endswith(" ") or "comment meshmash-viewer+  " in line
    ]
    comments = [line.removeprefix("comment ") for line in lines if line.startswith("comment")]
    meta = json.loads(stated_comment(comments))
    assert meta["columns"] == list(columns)
    assert meta["options"]["formula"] == "a b " * 900
    mesh = read_mesh(path)
    assert mesh.unit == "nm"
    assert len(mesh.maps) == len(columns)
    for column, found in zip(values.T, mesh.maps, strict=True):
        np.testing.assert_array_equal(found.values, column)
    if name == "32 times":
        assert tuple(each.name for each in mesh.maps) == columns


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_files_with_all_of_it_in_one_line_are_read(line_end: str, tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    write_features(path, Features(NINE, TIMES[:9]), MESH)
    start, _, body = path.read_bytes().partition(b"end_header\n")
    lines = start.decode("ascii").splitlines()
    said = stated_comment(each.removeprefix("comment ") for each in lines)
    lines = [each for each in lines if not each.startswith("comment")]
    lines[2:2] = ["comment made long ago", f"comment meshmash-viewer {said}"]
    assert len(lines[3]) > 500
    path.write_bytes(line_end.join([*lines, "end_header", ""]).encode() + body)
    mesh = read_mesh(path)
    assert mesh.unit == "nm"
    assert tuple(each.name for each in mesh.maps) == TIMES[:9]
    np.testing.assert_array_equal(mesh.maps[1].values, np.float32(NINE[:, 1]))


def test_properties_that_another_program_left_or_added_keep_their_names(tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    write_features(path, Features(NINE, TIMES[:9]), MESH)
    content = path.read_bytes().replace(
        b"property float hks_t=50000_nm_", b"property float quality"
    )
    path.write_bytes(content)
    assert [each.name for each in read_mesh(path).maps] == ["quality", *TIMES[1:9]]


@pytest.mark.parametrize("meta", ["", "{", "[]", '{"columns": 3}', '{"columns": [1, null]}', "1"])
def test_comments_of_others_are_left_alone(meta: str, tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    write_mesh(path, MESH)
    start, end, body = path.read_bytes().partition(b"element vertex")
    kept = [line for line in start.decode().splitlines() if not line.startswith("comment")]
    start = "\n".join([*kept, f"comment meshmash-viewer {meta}", ""]).encode()
    path.write_bytes(start + end + body)
    assert read_mesh(path).unit == ""


def test_any_text_is_one_again() -> None:
    rng = np.random.default_rng(0)
    for length in (0, 1, 470, 480, 481, 482, 2000):
        for letters in ("a", "a ", " ", ', "', "   a", "\\ "):
            text = "".join(rng.choice(list(letters), length))
            lines = list(comment_lines(json.dumps([text, 1], separators=(",", ":")), "comment"))
            assert max(map(len, lines)) <= 500
            assert not [line for line in lines if line != line.rstrip()]
            said = stated_comment(line.removeprefix("comment ") for line in lines)
            assert json.loads(said) == [text, 1]

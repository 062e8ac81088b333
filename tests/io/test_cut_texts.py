"""Text files that end within a record: no cut is read as another mesh without a remark."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.formats.brain import freesurfer_label
from meshmash_viewer.io.formats.vtk import read_legacy_vtk
from meshmash_viewer.io.read import read_mesh

VERTICES = "0.25 0.5 10.125\n12.5 0.25 0.75\n1.5 22.75 0.625\n1.125 2.25 13.375\n"
#: Twelve unused vertices, so that the last index has two digits, of which the first is valid, too.
MORE = "".join(f"{at}.25 1.5 2.75\n" for at in range(12))
CORNERS = [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 15)]
FACES = "".join("3 {} {} {}\n".format(*each) for each in CORNERS)
PLY = "ply\nformat ascii 1.0\n"
PLY_VERTEX = "element vertex 16\nproperty float x\nproperty float y\nproperty float z\n"
PLY_FACE = "element face 4\nproperty list uchar int vertex_indices\n"
POINTS = VERTICES + MORE
TEXTS = {
    "faces_last.obj": "".join(f"v {row}\n" for row in POINTS.splitlines())
    + "".join("f {} {} {}\n".format(*(corner + 1 for corner in each)) for each in CORNERS),
    "vertices_last.obj": "".join(
        "f {} {} {}\n".format(*(corner + 1 for corner in each)) for each in CORNERS
    )
    + "".join(f"v {row}\n" for row in POINTS.splitlines()),
    "faces_last.off": f"OFF\n16 4 0\n{POINTS}{FACES}",
    "faces_last.ply": f"{PLY}{PLY_VERTEX}{PLY_FACE}end_header\n{POINTS}{FACES}",
    "vertices_last.ply": f"{PLY}{PLY_FACE}{PLY_VERTEX}end_header\n{FACES}{POINTS}",
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_cut_that_loses_a_number_is_refused_or_said(name: str, tmp_path: Path) -> None:
    path, whole = tmp_path / name, TEXTS[name]
    last = whole.split("\n")[-2]
    for count in range(1, len(last.split())):
        cut = whole[: whole.rindex(last)] + " ".join(last.split()[:count])
        path.write_text(cut)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                read_mesh(path)
            except InputError:
                continue
        assert len(caught) == 1, cut
        assert f"{path} ends within a line, so it may be cut short" in str(caught[0].message)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \n\n"])
@pytest.mark.parametrize("name", TEXTS)
def test_a_whole_text_has_no_remark(name: str, end: str, tmp_path: Path) -> None:
    for text in (TEXTS[name], TEXTS[name].removesuffix("\n")):
        (tmp_path / name).write_bytes(text.replace("\n", end).encode())
        read_mesh(tmp_path / name)  # a warning would be an error


def test_a_binary_body_needs_no_line_end(tmp_path: Path) -> None:
    import pyvista

    points = np.array([row.split() for row in POINTS.splitlines()], dtype=np.float32)
    surface = pyvista.PolyData.from_regular_faces(points, np.array(CORNERS))
    meshes: list[Any] = []
    for name in ("mesh.ply", "mesh.vtk"):
        surface.save(path := tmp_path / name)
        path.write_bytes(path.read_bytes().rstrip(b"\n"))
        meshes.append(read_legacy_vtk(path) if name == "mesh.vtk" else read_mesh(path))
    assert [len(mesh.faces) for mesh in meshes] == [4, 4]


def test_a_label_with_fewer_vertices_than_it_promises_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "lh.cortex.label"
    rows = "".join(f"{at} 0 0 0 0.5\n" for at in range(12))
    path.write_text(f"#!ascii label\n12\n{rows}")
    assert len(freesurfer_label(path).maps[0].values) == 12
    path.write_text(f"#!ascii label\n12\n{rows}"[: -len("11 0 0 0 0.5\n")])
    with raises("file-cut-short", "promises 12 vertices and has 11, so it was cut short"):
        freesurfer_label(path)

"""Joining the corners of triangle soups, at any position and scale of the mesh."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import shapes

from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.read import read_mesh

FloatArray = npt.NDArray[np.float64]
BALL = shapes.icosphere(3, 1.2)


def soup(corners: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    points = corners.reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3)


def text_stl(path: Path, corners: FloatArray) -> Path:
    lines = ["solid thing"]
    for triangle in corners.tolist():
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x!r} {y!r} {z!r}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid thing\n"]))
    return path


def binary_stl(path: Path, corners: FloatArray) -> Path:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *each.ravel(), 0) for each in corners)
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + body)
    return path


def ground(half: float) -> FloatArray:
    a, b, c, d = np.array([[-1, -1, -2], [1, -1, -2], [1, 1, -2], [-1, 1, -2]]) * [half, half, 1.0]
    return np.array([[a, b, c], [a, c, d]])


@pytest.mark.parametrize(
    "shift", [(0, 0, 0), (6.378e6, 0, 0), (1e6, -2e6, 3e6), (0, 0, 1e9), (-4e7, 1, 1)], ids=str
)
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_a_ball_keeps_its_vertices_wherever_it_is(
    shift: tuple[float, float, float], scale: float, tmp_path: Path
) -> None:
    corners = (BALL.vertices[BALL.faces] + shift) * scale
    mesh = read_mesh(text_stl(tmp_path / "far.stl", corners))
    assert (mesh.n_vertices, mesh.n_faces, mesh.n_components) == (642, 1280, 1)
    assert mesh.area == pytest.approx(BALL.area * scale**2, rel=1e-5)


@pytest.mark.parametrize("half", [10.0, 1e4, 6e6, 1e8])
@pytest.mark.parametrize("write", [text_stl, binary_stl])
def test_a_ball_keeps_its_vertices_on_a_ground_of_any_size(write, half, tmp_path: Path) -> None:
    corners = np.concatenate([ground(half), BALL.vertices[BALL.faces]])
    mesh = read_mesh(write(tmp_path / "ground.stl", corners))
    assert (mesh.n_vertices, mesh.n_faces, mesh.n_components) == (646, 1282, 2)
    assert mesh.area == pytest.approx(BALL.area + 4.0 * half**2, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_residues_are_joined(scale: float, shift: float) -> None:
    """Corners that differ by rounding errors of 1e-15 are joined."""
    rng = np.random.default_rng(0)
    corners = BALL.vertices[BALL.faces] + shift
    corners += rng.uniform(-1e-15, 1e-15, corners.shape)
    vertices, faces, kept = join_vertices(*soup(corners * scale))
    assert (len(vertices), len(faces)) == (642, 1280)
    np.testing.assert_array_equal(vertices, soup(corners * scale)[0][kept])


def test_a_face_that_is_a_residue_collapses() -> None:
    """A face as small as the rounding error is removed, and the corners around it are joined."""
    here = BALL.vertices[0]
    tiny = here + 1e-16 * np.eye(3)
    corners = np.concatenate(
        [
            BALL.vertices[BALL.faces],
            tiny[None],
            np.repeat(here, 3).reshape(1, 3, 3).transpose(0, 2, 1),
        ]
    )
    vertices, faces, _ = join_vertices(*soup(corners))
    assert (len(vertices), len(faces)) == (642, 1280)


@pytest.mark.parametrize("far", [1e6, 1e30, 1e200, np.finfo(np.float64).max])
def test_an_unused_vertex_far_away_changes_nothing(far: float) -> None:
    points, faces = soup(BALL.vertices[BALL.faces] + 1e-15)
    more = np.concatenate([points, [[far, -far, far]]])
    vertices, joined, kept = join_vertices(more, faces)
    expected, expected_faces, _ = join_vertices(points, faces)
    np.testing.assert_array_equal(vertices, [*expected, more[-1]])
    np.testing.assert_array_equal(joined, expected_faces)
    assert kept[-1] == len(points)


def test_neighbours_in_single_precision_stay_two() -> None:
    """Corners that differ by one float32 step at the largest coordinate stay separate."""
    step = float(np.spacing(np.float32(1000.0)))
    corners = np.array(
        [
            [[1000.0, 0, 0], [1000.0 + step, 1, 0], [0, 0, 1e-17]],
            [[1000, 0, 0], [0, 0, 0], [0, 1, 0]],
        ]
    )
    assert len(join_vertices(*soup(corners))[0]) == 4
    corners[0, 1] = 1000.0 + step, 0, 0
    assert len(join_vertices(*soup(corners))[0]) == 4

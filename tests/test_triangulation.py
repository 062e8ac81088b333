"""Triangulation of polygons: correct areas, and the same triangles everywhere."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import pyvista
from faults import raises
from tiers import slow_but

from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import as_mesh
from meshmash_viewer.triangulation import triangulate

Points = list[tuple[float, float]]


def circle(radii: list[float], turns: float = 1.0) -> Points:
    angles = 2 * np.pi * turns * np.arange(len(radii)) / len(radii)
    return [(r * np.cos(a), r * np.sin(a)) for r, a in zip(radii, angles, strict=True)]


def spiral(side: int) -> Points:
    """Return the outline of a band of width 1 that winds inwards."""
    t = np.linspace(0, 4 * np.pi, side)
    outer = [(r * np.cos(a), r * np.sin(a)) for r, a in zip(t + 2, t, strict=True)]
    inner = [(r * np.cos(a), r * np.sin(a)) for r, a in zip(t + 1, t, strict=True)]
    return outer + inner[::-1]


L: Points = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
SQUARES: Points = [(0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (1, 2), (2, 2), (2, 1)]

#: Corners in the plane, the order of their connection, and the area.
SIMPLE: dict[str, tuple[Points, list[int], float]] = {
    "L": (L, [*range(6)], 3.0),
    "star": (circle([1, 0.4] * 5), [*range(10)], 5 * 0.4 * np.sin(np.pi / 5)),
    "thin star": (circle([1, 0.02] * 12), [*range(24)], 12 * 0.02 * np.sin(np.pi / 12)),
    "arrow head": ([(0, 0), (2, 1), (0, 2), (0.5, 1)], [*range(4)], 1.5),
    "flat arrow head": ([(0, 0), (10, 1), (0, 2), (9, 1)], [*range(4)], 1.0),
    "comb": (
        [(i, 1.0 if i % 2 else 9.0) for i in range(40)] + [(39, 0), (0, 0)],
        [*range(42)],
        195.0,
    ),
    "spiral": (spiral(50), [*range(100)], 0.0),
    "corner in an edge": ([(0, 0), (0.5, 0), (1, 0), (1, 1), (0, 1)], [*range(5)], 1.0),
    "triangle of four corners": ([(0, 0), (1, 0), (2, 0), (0, 1)], [*range(4)], 1.0),
    "many corners in edges": (
        [(i / 10, 0) for i in range(11)] + [(1, i / 10) for i in range(1, 11)] + [(0.5, 0.5)],
        [*range(22)],
        0.5,
    ),
    "square with a hole": (SQUARES, [0, 1, 2, 3, 0, 4, 5, 6, 7, 4], 8.0),
    "two squares at a corner": (
        [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (1, 2), (0, 1)],
        [0, 1, 2, 3, 4, 5, 2, 6],
        2.0,
    ),
    "corner given twice": (L, [0, 1, 1, 2, 3, 3, 3, 4, 5], 3.0),
    "closed by its first corner": (L, [0, 1, 2, 3, 4, 5, 0], 3.0),
    "two vertices at a place": ([*L, (2, 0)], [0, 1, 6, 2, 3, 4, 5], 3.0),
    "there and back": ([(0, 0), (0.5, 0), (1, 0), (1, 1), (0, 1)], [0, 2, 1, 2, 3, 4], 1.0),
}
PLACES = {
    "as it is": (1.0, 0.0),
    "tiny": (1e-9, 0.0),
    "huge": (1e9, 0.0),
    "far": (50.0, 1e6),
    "tiny and far": (1e-9, 1e-3),
}


def area_of(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def vector_area(points: np.ndarray) -> float:
    moved = points - points[0]
    return float(np.linalg.norm(np.cross(moved, np.roll(moved, -1, axis=0)).sum(axis=0)) / 2)


def cut(points: np.ndarray, *polygons: list[int]) -> np.ndarray:
    corners = np.array([*itertools.chain(*polygons)])
    return triangulate(points, corners, np.array([len(each) for each in polygons]))


def placed(points: Points, scale: float = 1.0, offset: float = 0.0) -> np.ndarray:
    """Return the corners in an oblique plane."""
    axes, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    return scale * (np.asarray(points, dtype=float) @ axes[:2]) + offset


@pytest.mark.parametrize("place", slow_but(["as it is", "tiny and far"], PLACES))
@pytest.mark.parametrize("name", SIMPLE)
def test_area_and_triangles_do_not_depend_on_the_first_corner(name: str, place: str) -> None:
    flat, order, area = SIMPLE[name]
    scale, offset = PLACES[place]
    points = placed(flat, scale, offset)
    area = area or vector_area(placed(flat)[order])
    wanted = cut(points, order)
    assert area_of(points, wanted) == pytest.approx(area * scale**2, rel=1e-6)
    assert set(wanted.ravel().tolist()) == set(order)
    for start in range(1, len(order)):
        np.testing.assert_array_equal(cut(points, order[start:] + order[:start]), wanted)
    backwards = cut(points, order[::-1])
    assert area_of(points, backwards) == pytest.approx(area * scale**2, rel=1e-6)


@pytest.mark.parametrize("name", SIMPLE)
def test_triangles_keep_the_side_of_their_polygon(name: str) -> None:
    flat, order, _ = SIMPLE[name]
    points = np.column_stack([np.asarray(flat, dtype=float), np.zeros(len(flat))])
    a, b, c = (points[cut(points, order)[:, corner]] for corner in range(3))
    upwards = np.cross(b - a, c - a)[:, 2]
    moved = points[order]
    side = np.sign(np.cross(moved, np.roll(moved, -1, axis=0))[:, 2].sum())
    assert (side * upwards > -1e-12).all()


@pytest.mark.parametrize(
    "polygon", [circle([1] * 5, 2), circle([1] * 7, 3), [(0, 0), (1, 1), (1, 0), (0, 1)]]
)
def test_a_polygon_that_crosses_itself_keeps_at_least_its_area(polygon: Points) -> None:
    points = placed(polygon)
    with warnings.catch_warnings(action="ignore", category=MeshWarning):
        triangles = cut(points, [*range(len(points))])
    assert len(triangles) == len(points) - 2
    assert area_of(points, triangles) >= vector_area(points)


@pytest.mark.parametrize(
    "polygon", [[(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (3, 0), (3, 1), (1, -0.3), (0, 1)]]
)
def test_a_file_with_a_polygon_that_crosses_itself_says_so(polygon: Points, tmp_path: Path) -> None:
    path = tmp_path / "crossed.obj"
    lines = [f"v {x} {y} 0" for x, y in polygon]
    face = " ".join(str(at + 1) for at in range(len(polygon)))
    path.write_text("\n".join([*lines, f"f {face}", ""]))
    with pytest.warns(MeshWarning, match="crossed.obj has a fault: 1 polygon intersects itself"):
        read_mesh(path)


@pytest.mark.parametrize("polygon", [[0, 1, 0, 2], [0, 0, 1, 1], [0, 1], [0], [], [2] * 6])
def test_polygons_without_area_are_left_out(polygon: list[int]) -> None:
    points = placed(L)
    assert cut(points, polygon, [0, 1, 2], polygon).tolist() == [[0, 1, 2]]


def test_triangles_among_polygons_stay_where_and_as_they_are() -> None:
    points = placed(L)
    triangles = cut(points, [5, 0, 1], [*range(6)], [2, 1, 0], [1, 1, 2], [0, 1, 2, 5])
    assert triangles[[0, 5, 6]].tolist() == [[5, 0, 1], [2, 1, 0], [1, 1, 2]]
    assert area_of(points, triangles[1:5]) == pytest.approx(3.0)


@pytest.mark.parametrize("sides", [5, 6, 9])
def test_polygons_that_are_not_flat_have_all_their_corners(sides: int) -> None:
    rng = np.random.default_rng(sides)
    points = np.column_stack([circle([1] * sides), 0.2 * rng.normal(size=sides)])
    wanted = cut(points, [*range(sides)])
    assert len(wanted) == sides - 2
    edges = {frozenset(edge) for t in wanted.tolist() for edge in itertools.combinations(t, 2)}
    assert {frozenset((i, (i + 1) % sides)) for i in range(sides)} <= edges
    for start in range(1, sides):
        turned = [(start + i) % sides for i in range(sides)]
        np.testing.assert_array_equal(cut(points, turned), wanted)


def test_quadrilaterals_are_cut_along_the_shorter_diagonal_inside() -> None:
    rng = np.random.default_rng(0)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    for _ in range(50):
        points = square + 0.1 * rng.normal(size=(4, 3))
        first, second = cut(points, [0, 1, 2, 3]).tolist()
        shared = sorted(set(first) & set(second))
        diagonals = {i: np.linalg.norm(points[i] - points[i + 2]) for i in (0, 1)}
        shorter = min(diagonals, key=diagonals.__getitem__)
        assert shared == [shorter, shorter + 2]


def test_a_very_large_polygon_is_cut_if_it_is_convex() -> None:
    count = 10_001
    points = np.column_stack([circle([1.0] * count), np.zeros(count)])
    assert area_of(points, cut(points, [*range(count)])) == pytest.approx(np.pi, rel=1e-6)
    points[5] *= 0.5
    with raises("too-many", "A polygon of 10,001 corners is not convex"):
        cut(points, [*range(count)])


# The same in every format ------------------------------------------------------------------------

Polygons = list[list[int]]


def write_obj(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    rows += ["f " + " ".join(f"{corner + 1}/1" for corner in polygon) for polygon in polygons]
    path.write_text("\n".join(rows) + "\n")


def write_off(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    rows = ["OFF", f"{len(points)} {len(polygons)} 0"]
    rows += [f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    rows += [" ".join(map(str, [len(polygon), *polygon])) for polygon in polygons]
    path.write_text("\n".join(rows) + "\n")


def ply_header(kind: str, points: np.ndarray, polygons: Polygons) -> str:
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {len(points)}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {len(polygons)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )


def write_text_ply(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    rows += [" ".join(map(str, [len(polygon), *polygon])) for polygon in polygons]
    path.write_text(ply_header("ascii", points, polygons) + "\n".join(rows) + "\n")


def write_binary_ply(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    order = "<" if path.name.startswith("little") else ">"
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = points.astype(f"{order}f8").tobytes()
    for polygon in polygons:
        body += bytes([len(polygon)]) + np.array(polygon, f"{order}i4").tobytes()
    path.write_bytes(ply_header(kind, points, polygons).encode() + body)


def polydata(points: np.ndarray, polygons: Polygons) -> pyvista.PolyData:
    cells = [*itertools.chain(*([len(polygon), *polygon] for polygon in polygons))]
    return pyvista.PolyData(points, cells)


def write_polydata(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    polydata(points, polygons).save(path, binary=not path.name.startswith("text"))


def write_grid(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    cells = [*itertools.chain(*([len(polygon), *polygon] for polygon in polygons))]
    kinds = [int(pyvista.CellType.POLYGON)] * len(polygons)
    pyvista.UnstructuredGrid(cells, kinds, points).save(path)


def write_npz(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    np.savez(path, vertices=points, faces=np.array(polygons))


def write_cells_npz(path: Path, points: np.ndarray, polygons: Polygons) -> None:
    np.savez(path, vertices=points, faces=polydata(points, polygons).faces)


WRITERS: dict[str, Callable[[Path, np.ndarray, Polygons], None]] = {
    "a.obj": write_obj,
    "a.off": write_off,
    "text.ply": write_text_ply,
    "little.ply": write_binary_ply,
    "big.ply": write_binary_ply,
    "a.vtk": write_polydata,
    "text.vtk": write_polydata,
    "grid.vtk": write_grid,
    "a.vtp": write_polydata,
    "rows.npz": write_npz,
    "list.npz": write_cells_npz,
}


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("file", WRITERS)
def test_readers_and_library_agree(file: str, tmp_path: Path) -> None:
    """Two polygons share an edge; each starts at any corner."""
    flat = [*L, (4, 0), (4, 1), (3, 1), (3, 3), (1, 3)]
    points = placed(flat)
    first, second = [*range(6)], [1, 6, 7, 8, 9, 10, 4, 3, 2]
    if file.startswith("rows"):
        first, second = first, [2, 1, 6, 7, 8, 3]  # equally many corners
    wanted = as_mesh(polydata(points, [first, second]))
    assert wanted.area == pytest.approx(vector_area(points[first]) + vector_area(points[second]))
    for start in range(6):
        turned = [each[start:] + each[:start] for each in (first, second)]
        WRITERS[file](tmp_path / file, points, turned)
        mesh = read_mesh(tmp_path / file)
        np.testing.assert_array_equal(mesh.faces, wanted.faces)
        np.testing.assert_allclose(mesh.vertices, wanted.vertices, rtol=1e-9)


def test_polydata_with_strips_and_empty_cells() -> None:
    points = placed(L)
    poly = pyvista.PolyData(points, faces=[4, 0, 1, 2, 3], strips=[4, 0, 3, 5, 4])
    mesh = as_mesh(poly)
    assert mesh.faces.tolist() == [[0, 1, 3], [1, 2, 3], [0, 3, 5], [5, 3, 4]]
    with raises("no-faces", "no faces"):
        as_mesh(pyvista.PolyData(points))
    with raises("no-faces", "no faces"):
        as_mesh(pyvista.PolyData())

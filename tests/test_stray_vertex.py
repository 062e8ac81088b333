"""Vertices of no face, however far away, which must not change results or pictures."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.app.view.camera import default_axes, geometry_of
from meshmash_viewer.health import REPAIRS, median_edge_length, mesh_health
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.preview import preview_eigenpairs
from meshmash_viewer.surface.decimation import cluster_vertices
from meshmash_viewer.surface.geodesics import GeodesicSolver
from meshmash_viewer.surface.masks import prepared
from meshmash_viewer.surface.rays import RayTarget

FAR = [1e6, 1e30, 1e100, 1e300, float(np.finfo(np.float64).max)]
BALL = shapes.icosphere(3, 2.0)
#: A ball with two more faces, one almost without area.
FAULTY = Mesh(
    np.concatenate([BALL.vertices, [[2.5, 0, 0], [3, 0, 0], [3.5, 1e-14, 0], [4, 0, 1]]]),
    np.concatenate([BALL.faces, [[642, 643, 644], [642, 643, 645]]]),
    unit="nm",
)


def strayed(mesh: Mesh, far: float) -> Mesh:
    """Return a mesh with three more vertices, two of no face and one of a degenerate face."""
    more = far * np.array([[1.0, -1, 0.5], [-1, -1, -1], [0, 0, 1]])
    n = mesh.n_vertices
    faces = np.concatenate([mesh.faces, [[0, 0, n]]])
    return Mesh(np.concatenate([mesh.vertices, more]), faces, mesh.unit)


@pytest.mark.parametrize("far", FAR)
def test_neither_size_nor_health(far: float) -> None:
    mesh, stray = FAULTY, strayed(FAULTY, far)
    expected = asdict(mesh_health(mesh))
    expected["n_vertices"] += 3
    expected["unreferenced_vertices"] += 3
    expected["n_faces"] += 1
    expected["degenerate_faces"] += 1
    assert asdict(mesh_health(stray)) == expected
    np.testing.assert_array_equal(stray.bounds, mesh.bounds)
    np.testing.assert_array_equal(stray.degenerate_faces[:-1], mesh.degenerate_faces)
    np.testing.assert_array_equal(stray.vertex_normals[:-3], mesh.vertex_normals)
    assert hash(stray) == hash(strayed(FAULTY, far))
    again = stray.in_voxels((1e-3, 4.0, 40.0), "nm").in_voxels((1.0, 1.0, 1.0), "")
    np.testing.assert_allclose(again.vertices[:-3], mesh.vertices, rtol=1e-15)


@pytest.mark.parametrize("name", REPAIRS)
def test_no_repair(name: str) -> None:
    expected, found = (mv.repair_mesh(each, name) for each in (FAULTY, strayed(FAULTY, FAR[-1])))
    np.testing.assert_array_equal(found.vertices[: expected.n_vertices], expected.vertices)
    np.testing.assert_array_equal(found.faces[: expected.n_faces], expected.faces)


@pytest.mark.parametrize("far", FAR)
@pytest.mark.parametrize("robust", [False, True])
def test_not_the_operator(far: float, robust: bool) -> None:
    mesh, stray = BALL, strayed(BALL, far)
    for expected, found in zip(
        mv.cotangent_laplacian(mesh, robust), mv.cotangent_laplacian(stray, robust), strict=True
    ):
        np.testing.assert_array_equal(found.toarray()[:-3, :-3], expected.toarray())
        assert not found.toarray()[-3:].any()


@pytest.mark.parametrize("far", [slow(FAR[0]), FAR[-1]])
def test_no_field(far: float) -> None:
    mesh, stray = BALL, strayed(BALL, far)

    def same(function, **tolerance) -> None:
        found = np.asarray(function(stray))
        axis = found.shape.index(stray.n_vertices)
        kept = np.take(found, np.arange(mesh.n_vertices), axis)
        np.testing.assert_allclose(kept, function(mesh), **tolerance)

    same(mv.mean_curvature)
    same(mv.gaussian_curvature)
    same(lambda each: mv.decompose_mesh(each, 12)[1], atol=1e-6)
    same(lambda each: np.asarray(preview_eigenpairs(each, 10).rows), atol=1e-6)
    same(lambda each: GeodesicSolver(each).from_vertex(5), rtol=1e-9)
    assert median_edge_length(stray) == median_edge_length(mesh)


@pytest.mark.parametrize("far", FAR)
def test_not_what_is_drawn(far: float) -> None:
    mesh, stray = BALL, strayed(BALL, far)
    expected, found = geometry_of(mesh), geometry_of(stray)
    for name in ("centre", "bounds", "sample", "axes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    np.testing.assert_array_equal(found.points[:-3], expected.points)
    assert np.abs(found.points).max() == np.abs(expected.points).max()
    np.testing.assert_array_equal(default_axes(stray), default_axes(mesh))
    coarse, other = (cluster_vertices(*each, 100) for each in (mesh, stray))
    np.testing.assert_array_equal(coarse.representatives, other.representatives)
    eye = np.array([0.6, 0.0, 0.8])
    targets = [RayTarget(each.points, each.faces) for each in (expected, found)]
    assert len({each.seen_vertex(np.array([0.1, 0.2, 0.3]), eye) for each in targets}) == 1


@pytest.mark.parametrize("far", FAR)
def test_not_the_brush(far: float) -> None:
    discs = [prepared(each).within(np.array([0]), 0.5) for each in (BALL, strayed(BALL, far))]
    for expected, found in zip(*discs, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("ending", [".ply", ".stl", ".obj", ".glb"])
@pytest.mark.parametrize("far", [FAR[-1]])
def test_no_file(ending: str, far: float, tmp_path: Path) -> None:
    path = tmp_path / f"ball{ending}"
    write_mesh(path, replace(strayed(BALL, far), name="ball"))
    found = mv.read_mesh(path, unit="1000 nm")  # overflows for the largest float
    assert mesh_health(found).n_components == 1
    assert found.area == pytest.approx(BALL.area * 1e6, rel=1e-5)
    np.testing.assert_allclose(found.bounds, BALL.bounds * 1e3, rtol=1e-6)


@pytest.mark.parametrize("far", [1e80, 1e200])
def test_one_that_a_face_uses_is_refused(far: float) -> None:
    faces = np.concatenate([BALL.faces, [[0, 1, 642]]])
    with raises("beyond-floating-point", "Coordinates of size"):
        Mesh(np.concatenate([BALL.vertices, [[far, 0, 0]]]), faces)

"""The mesh: valid input, refused input, and properties."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
import shapes
import trimesh
from faults import raises

from meshmash_viewer.decompose import decompose_mesh
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.mesh import Mesh, as_mesh, mesh_to_poly
from meshmash_viewer.vertex_map import VertexMap

TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("vertices", "faces", "code", "word"),
    [
        (TRIANGLE[:, :2], [[0, 1, 2]], "wrong-shape", "Vertices have shape (3, 2)"),
        ("abc", [[0, 1, 2]], "wrong-type", "not an array of numbers"),
        (TRIANGLE + 1j, [[0, 1, 2]], "wrong-type", "not an array of numbers"),
        (TRIANGLE, [[0, 1, 2, 0]], "wrong-shape", "Faces have shape (1, 4)"),
        (TRIANGLE, [[3, 0, 1, 2]], "wrong-shape", "faces[:, 1:]"),
        (TRIANGLE, np.zeros((0, 3), int), "no-faces", "surface"),
        (TRIANGLE, [], "no-faces", "surface"),
        (TRIANGLE, [[0, 1, 3]], "vertex-out-of-range", "face 0, the first as [0, 1, 3]"),
        (TRIANGLE, [[0, 1, 2], [0, -1, 2]], "vertex-out-of-range", "face 1, the first as [0, -1"),
        (TRIANGLE, [[1, 2, 3]], "vertex-out-of-range", "subtract 1"),
        (TRIANGLE, [[0.0, 1.0, 1.5]], "vertex-out-of-range", "count from 0 to 2"),
        (TRIANGLE, [[0.0, 1.0, np.nan]], "vertex-out-of-range", "count from 0 to 2"),
        (TRIANGLE, [["a", "b", "c"]], "wrong-type", "vertex indices"),
        (TRIANGLE, [[True, False, True]], "wrong-type", "type bool"),
        (TRIANGLE, [[0, 0, 1]], "no-area", "coincide"),
        (TRIANGLE * [1.0, 0.0, 0.0], [[0, 1, 2]], "no-area", "lie on lines"),
        (np.zeros((0, 3)), [[0, 1, 2]], "vertex-out-of-range", "[0, 1, 2]"),
    ],
)
def test_invalid_meshes_are_refused_by_name(vertices, faces, code, word):
    with raises(code, word):
        Mesh(vertices, faces)


def test_first_offenders_are_named_and_the_others_counted():
    vertices = np.zeros((20, 3))
    vertices[[3, 5, 7, 9, 11, 13, 15], 1] = np.nan
    vertices[17, 2] = np.inf
    with raises("not-finite", "vertex 3, 5, 7, 9, 11 and 3 more"):
        Mesh(vertices, [[0, 1, 2]])


def test_an_unknown_unit_is_refused():
    with raises("unknown-name", "furlong", "none, nm"):
        Mesh(TRIANGLE, [[0, 1, 2]], "furlong")


def test_arrays_are_copied_and_read_only():
    given = TRIANGLE.copy()
    mesh = Mesh(given, np.array([[0, 1, 2]]))
    given[0] = 9.0
    np.testing.assert_array_equal(mesh.vertices, TRIANGLE)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int64


def test_every_accepted_form_is_the_same_mesh(neuron):
    import pyvista
    import trimesh

    padded = np.column_stack([np.full(neuron.n_faces, 3), neuron.faces]).ravel()
    forms = {
        "pair": (neuron.vertices, neuron.faces),
        "list": [neuron.vertices.tolist(), neuron.faces.astype(np.uint32)],
        "object": SimpleNamespace(vertices=neuron.vertices, faces=neuron.faces.astype(np.int32)),
        "trimesh": trimesh.Trimesh(neuron.vertices, neuron.faces, process=False),
        "polydata": pyvista.PolyData(neuron.vertices.copy(), padded),
    }
    for name, form in forms.items():
        assert as_mesh(form).content_hash == neuron.content_hash, name
    assert as_mesh(neuron) is neuron


@pytest.mark.parametrize(
    ("thing", "remedy"),
    [
        (None, "give (vertices, faces), or an object"),
        (3, "not of type int"),
        ((1, 2, 3), "a tuple of 3"),
        (SimpleNamespace(vertices=np.eye(3)), "not of type SimpleNamespace"),
        (SimpleNamespace(faces=np.eye(3)), "not of type SimpleNamespace"),
        ("mesh.ply", "read a file with read_mesh."),
        (Path("mesh.ply"), "read a file with read_mesh."),
        (pyvista.ImageData(dimensions=(2, 2, 2)), "mesh.extract_surface()"),
        (trimesh.Scene(trimesh.creation.box()), "scene.to_mesh()"),
        (np.eye(3), "as one argument, (vertices, faces)"),
        (shapes.flat_torus(4), "give the mesh itself"),
    ],
)
def test_what_is_no_triangle_mesh_is_refused_with_its_conversion(thing, remedy):
    with raises("wrong-type", remedy):
        as_mesh(thing)


def test_a_mesh_of_vertices_and_triangles_is_taken_with_a_unit_in_words():
    open3d = SimpleNamespace(vertices=np.eye(3), triangles=[[0, 1, 2]])
    assert as_mesh(open3d).n_faces == 1
    assert Mesh(open3d.vertices, open3d.triangles, unit="micron").unit == "µm"


def test_polydata_shares_nothing_and_carries_values(neuron):
    poly = mesh_to_poly(neuron)
    np.testing.assert_array_equal(poly.points, neuron.vertices)
    np.testing.assert_array_equal(poly.faces.reshape(-1, 4)[:, 1:], neuron.faces)
    poly.points[0] = 0.0
    poly["values"] = np.arange(neuron.n_vertices)
    assert neuron.vertices[0].any()
    assert mesh_to_poly(neuron).n_points == neuron.n_vertices
    assert as_mesh(mesh_to_poly(neuron)).content_hash == neuron.content_hash


def test_area_and_bounds_of_known_shapes(rectangle):
    assert rectangle.area == pytest.approx(3.0, rel=1e-13)
    np.testing.assert_allclose(rectangle.bounds, [[0, 0, 0], [2, 1.5, 0]], atol=1e-15)
    assert shapes.icosphere(5, 3.0).area == pytest.approx(36.0 * np.pi, rel=2e-3)


def test_components_by_shared_vertices_numbered_by_their_lowest():
    one = shapes.icosphere(0)
    mesh = shapes.together(one, np.full((1, 3), 9.0), shapes.moved(one, 5.0))
    mesh = Mesh(mesh.vertices, mesh.faces[::-1])
    np.testing.assert_array_equal(mesh.component_labels, [0] * 12 + [-1] + [1] * 12)
    assert mesh.n_components == 2
    assert not mesh.referenced[12]


def test_a_vertex_of_collapsed_faces_only_is_unreferenced():
    mesh = Mesh(np.concatenate([TRIANGLE, [[2.0, 2.0, 2.0]]]), [[0, 1, 2], [0, 3, 3]])
    np.testing.assert_array_equal(mesh.referenced, [True, True, True, False])


def test_normals_point_out_and_are_never_nan(sphere, neuron):
    outward = np.einsum("ij,ij->i", sphere.vertex_normals, sphere.vertices)
    assert outward.min() > 0.999
    normals = neuron.vertex_normals
    assert normals.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_array_equal(normals[~neuron.referenced][0], [0, 0, 1])


def test_faces_that_cancel_have_a_normal_all_the_same():
    mesh = Mesh(TRIANGLE, [[0, 1, 2], [2, 1, 0]])
    assert np.isfinite(mesh.vertex_normals).all()


@pytest.mark.parametrize(("size", "count"), [(0.3, 3300), (0.15, 0)])
def test_the_area_sample_weighs_by_area_and_leaves_small_components_out(
    sphere: Mesh, size: float, count: int
) -> None:
    n = sphere.n_vertices
    mesh = shapes.together(sphere, shapes.moved(sphere, 5.0, 0.0, 0.0, scale=size))
    assert mesh.small_components[n:].all() == (count == 0)
    assert not mesh.small_components[:n].any()
    sample = mesh.area_sample(40_000)
    assert np.count_nonzero(sample >= n) == pytest.approx(count, abs=20)
    upper = np.count_nonzero(mesh.vertices[sample, 2] > 0.0) / len(sample)
    assert upper == pytest.approx(0.5, abs=0.05)
    np.testing.assert_array_equal(sample, mesh.area_sample(40_000))


def test_voxels_of_another_size_speak_of_the_same_file(neuron):
    first = neuron.in_voxels((4.0, 4.0, 32.0), "nm")
    np.testing.assert_array_equal(first.vertices, neuron.vertices * (4.0, 4.0, 32.0))
    again = first.in_voxels((8.0, 8.0, 8.0), "µm")
    np.testing.assert_array_equal(again.vertices, 8.0 * neuron.vertices)
    assert (again.unit, again.voxel, again.name) == ("µm", (8.0, 8.0, 8.0), neuron.name)
    assert pickle.loads(pickle.dumps(again)).voxel == again.voxel
    for repair in REPAIRS.values():
        assert repair.apply(again).voxel == again.voxel


@pytest.mark.parametrize(
    "voxel", [(1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, np.nan), (8.0,), 8.0, "8 nm"]
)
def test_a_voxel_has_three_positive_sizes(voxel):
    with raises("out-of-range", "three positive sizes"):
        Mesh(TRIANGLE, [[0, 1, 2]], voxel=voxel)


def test_values_are_kept_on_the_surface_alone(neuron):
    values = np.full(neuron.n_vertices, np.nan)
    seen = neuron.on_surface(values)
    np.testing.assert_array_equal(np.isnan(seen), neuron.referenced)
    assert np.isnan(values).all(), "what came is not changed"
    assert len(neuron.unreferenced)


@pytest.mark.parametrize("scale", [1e76, 1e150, 1e200, 1e-76, 1e-200])
def test_coordinates_beyond_the_range_of_areas_are_refused(scale: float) -> None:
    one = shapes.icosphere(1)
    with raises("beyond-floating-point", "leave no room for areas"):
        Mesh(one.vertices * scale, one.faces)


@pytest.mark.parametrize("scale", [2.0**240, 2.0**-240])
def test_coordinates_at_the_ends_of_the_range_are_decomposed(scale: float) -> None:
    one = shapes.icosphere(2)
    far = Mesh(one.vertices * scale, one.faces)
    values = decompose_mesh(far, 6)[0] * scale * scale
    np.testing.assert_allclose(values, decompose_mesh(one, 6)[0], rtol=1e-12)


def test_maps_that_there_are_are_named_where_another_is_asked_for(sphere: Mesh) -> None:
    values = np.zeros(sphere.n_vertices)
    mesh = sphere.with_maps(VertexMap("depth", values), VertexMap("width", values))
    with raises("unknown-name", "'depth', 'width'"):
        mesh.map_named("height")
    with raises("unknown-name", "none"):
        sphere.map_named("height")


def test_a_mesh_unpacks_and_indexes_like_its_pair():
    mesh = shapes.icosphere(1)
    vertices, faces = mesh
    assert vertices is mesh[0] is mesh[-2] is mesh.vertices
    assert faces is mesh[1] is mesh[-1] is mesh.faces
    assert (len(mesh), len(mesh[0]), mesh[:0]) == (2, 42, ())
    with pytest.raises(IndexError):
        mesh[2]


def test_equal_meshes_are_equal_and_have_one_hash():
    mesh = shapes.icosphere(1, unit="nm")
    vertices, faces = mesh
    others = [
        Mesh(vertices.tolist(), faces.astype(np.int32), "nm", "another name"),
        Mesh(np.asfortranarray(vertices), faces, "nm"),
        Mesh(np.where(vertices == 0.0, -0.0, vertices), faces, "nm"),
        mesh.with_maps(VertexMap("height", vertices[:, 2])),
        mesh.in_unit("mm").in_unit("nm"),
        pickle.loads(pickle.dumps(mesh)),
        copy.deepcopy(mesh),
    ]
    for other in others:
        assert mesh == other
        assert hash(mesh) == hash(other)
    assert {mesh, *others} == {mesh}
    moved = vertices.copy()
    moved[7, 1] = np.nextafter(moved[7, 1], np.inf)
    unlike = [
        mesh.in_unit("µm"),
        Mesh(moved, faces, "nm"),
        Mesh(vertices, faces[:, [1, 2, 0]], "nm"),
        Mesh(vertices, faces[::-1], "nm"),
        Mesh(vertices, faces[1:], "nm"),
        Mesh(np.append(vertices, [[0.0, 0.0, 9.0]], axis=0), faces, "nm"),
        (vertices, faces),
        None,
    ]
    assert mesh not in unlike

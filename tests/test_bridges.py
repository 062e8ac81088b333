"""Meshes and eigenpairs exchanged with other programs, which tests use if installed."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapes
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.mesh import as_mesh

BALL = shapes.icosphere(3)


def test_an_object_with_v_and_t_is_a_mesh() -> None:
    taken = as_mesh(SimpleNamespace(v=BALL.vertices, t=BALL.faces))
    assert taken.content_hash == BALL.content_hash
    tetrahedra = SimpleNamespace(v=BALL.vertices, t=np.zeros((2, 4), dtype=int))
    with raises("wrong-shape", "Faces have shape (2, 4)"):
        as_mesh(tetrahedra)


def test_a_layer_of_napari_has_the_axes_of_images() -> None:
    mesh = mv.Mesh(BALL.vertices * (1.0, 2.0, 3.0), BALL.faces, "µm", "egg")
    field = mesh.vertices[:, 2].copy()
    field[5] = np.nan
    (places, faces, values), options, kind = mv.to_napari(mesh, field)
    assert kind == "surface"
    np.testing.assert_array_equal(places.max(axis=0), mesh.vertices.max(axis=0)[[2, 1, 0]])
    np.testing.assert_array_equal(np.delete(places[:, 0], 5), np.delete(values, 5))
    np.testing.assert_array_equal(faces, mesh.faces)
    assert (options["name"], options["metadata"]) == ("egg", {"unit": "µm"})
    assert options["units"] == ("µm", "µm", "µm")
    assert options["contrast_limits"] == (np.nanmin(field), np.nanmax(field))


def test_a_layer_of_napari_needs_no_field_and_shares_no_memory() -> None:
    data, options, _ = mv.to_napari(BALL)
    assert len(data) == 2
    assert "contrast_limits" not in options
    assert "units" not in options
    assert not np.shares_memory(data[0], BALL.vertices)
    assert not np.shares_memory(data[1], BALL.faces)
    assert "contrast_limits" not in mv.to_napari(BALL, np.ones(BALL.n_vertices))[1]


def test_a_field_of_another_mesh_is_refused() -> None:
    with raises("wrong-shape", "does not go with 642 vertices"):
        mv.to_napari(BALL, np.ones(7))


def test_labels_give_each_vertex_of_a_layer_its_colour() -> None:
    keys = np.arange(BALL.n_vertices) % 3 * 5
    labels = (mv.Label(10, "top", "#0000ff"), mv.Label(0, "left", "#ff0000"))
    known = mv.VertexMap("parts", keys, labels=labels)
    (_, _, values), options, _ = mv.to_napari(BALL.with_maps(known), known)
    np.testing.assert_array_equal(values, keys)
    colors = options["vertex_colors"]
    np.testing.assert_array_equal(colors[0], (1, 0, 0, 1))
    np.testing.assert_array_equal(colors[2], (0, 0, 1, 1))
    assert len(np.unique(colors[1::3], axis=0)) == 1
    assert options["metadata"]["labels"] == {10: "top", 0: "left"}
    assert not {"colormap", "contrast_limits"} & options.keys()


def test_a_map_of_numbers_is_a_field() -> None:
    known = mv.VertexMap("height", BALL.vertices[:, 2])
    found, wanted = mv.to_napari(BALL, known), mv.to_napari(BALL, known.values)
    np.testing.assert_array_equal(found[0][2], wanted[0][2])
    assert found[1:] == wanted[1:]


@pytest.mark.filterwarnings("default")
def test_lapy_takes_our_eigenpairs_and_we_its_mesh() -> None:
    lapy = pytest.importorskip("lapy")
    theirs = lapy.TriaMesh(BALL.vertices.copy(), BALL.faces.copy())
    values, vectors = mv.decompose_mesh(theirs, 16, robust=False)
    wanted, _ = lapy.Solver(theirs, lump=True).eigs(k=16)
    np.testing.assert_allclose(values[1:], wanted[1:], rtol=1e-5)
    heat = pytest.importorskip("lapy.heat").kernel(
        np.array([0.5]), 7, vectors, values[:, np.newaxis], 16
    )
    ours = vectors * np.exp(-0.5 * values) @ vectors[7]
    np.testing.assert_allclose(np.ravel(heat), ours, rtol=1e-10, atol=1e-12)


@pytest.mark.filterwarnings("default")
def test_pyfm_takes_our_eigenpairs() -> None:
    signatures = pytest.importorskip("pyFM.signatures")
    values, vectors = mv.decompose_mesh(BALL, 16)
    times = np.geomspace(0.1, 2.0, 5)
    theirs = signatures.HKS(values, vectors, times)
    ours = np.square(vectors) @ mv.heat_kernel_bank(times)(values).T
    np.testing.assert_allclose(theirs, ours, rtol=1e-10)


@pytest.mark.filterwarnings("default")
def test_napari_makes_a_layer_of_it() -> None:
    layers = pytest.importorskip("napari.layers")
    layer = layers.Layer.create(*mv.to_napari(BALL, BALL.vertices[:, 2]))
    assert type(layer).__name__ == "Surface"
    np.testing.assert_array_equal(layer.vertex_values, BALL.vertices[:, 2])
    for unit, name in (("nm", "nanometer"), ("µm", "micrometer"), ("mm", "millimeter")):
        layer = layers.Layer.create(*mv.to_napari(BALL.in_unit(unit)))
        assert [str(each) for each in layer.units] == [name] * 3
    labels = (mv.Label(0, "left", "#ff0000"), mv.Label(1, "right", "#0000ff"))
    known = mv.VertexMap("sides", np.arange(BALL.n_vertices) % 2, labels=labels)
    layer = layers.Layer.create(*mv.to_napari(BALL, known))
    np.testing.assert_array_equal(layer.vertex_colors[1], (0, 0, 1, 1))

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solved import spectrum_of

from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import FEWEST_PAIRS, Shape
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import LiveFeatures, compute_field, request_of
from meshmash_viewer.model.limits import LockedLimits, MinMaxLimits
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.vertex_map import Label, VertexMap


@pytest.fixture
def document(rectangle: Mesh) -> Document:
    document = Document()
    mesh = rectangle.in_unit("nm")
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(spectrum_of(rectangle, 40))
    return document


def test_nothing_to_show_before_there_are_pairs(rectangle: Mesh) -> None:
    document = Document()
    assert request_of(document) is None
    document.accept_mesh(MeshReady(rectangle, mesh_health(rectangle), rectangle.vertex_normals))
    assert request_of(document) is None
    nothing = Eigenpairs(np.zeros(0), np.zeros((3, rectangle.n_vertices)), np.zeros(0))
    document.accept_spectrum(nothing)
    assert request_of(document) is None


def test_eigenfunction_and_its_other_sign(document: Document) -> None:
    document.display.change(Eigenfunctions, index=5)
    request = request_of(document)
    assert request is not None
    field = compute_field(request, LiveFeatures())
    assert field is not None
    assert field.values.dtype == np.float32
    np.testing.assert_allclose(field.values, document.spectrum.rows[5], rtol=1e-6)
    assert (field.title, field.unit, field.signed) == ("Eigenfunction 5", "nm⁻¹", True)
    assert field.quantity == f"λ₅ = {document.spectrum.eigenvalues[5]:.4g}\N{NO-BREAK SPACE}nm⁻²"
    document.flip()
    flipped = compute_field(request_of(document), LiveFeatures())
    np.testing.assert_array_equal(flipped.values, -field.values)


def test_index_beyond_what_has_converged_shows_the_last(document: Document) -> None:
    document.display.change(Eigenfunctions, index=10_000)
    assert request_of(document).family.index == 39


def test_what_does_not_matter_makes_no_other_request(document: Document) -> None:
    before = request_of(document)
    document.display.change(GeometryVectors, count=7)
    document.display.change(HeatKernelSignature, time=3.0)
    document.display.change(Eigenfunctions, flipped=frozenset({17}))
    assert request_of(document) == before
    document.accept_spectrum(replace(document.spectrum))
    assert request_of(document) != before


def test_hks_names_time_and_length(document: Document) -> None:
    document.display.kind = "hks"
    document.display.change(HeatKernelSignature, time=0.25)
    field = compute_field(request_of(document), LiveFeatures())
    assert field.quantity == "t = 0.25\N{NO-BREAK SPACE}nm² (√t = 0.5\N{NO-BREAK SPACE}nm)"
    assert (field.unit, field.signed, field.family.time) == ("nm⁻²", False, 0.25)


@pytest.mark.parametrize(("count", "band"), [(1, 0), (3, 1), (12, 0), (12, 4), (12, 11)])
def test_band_names_its_support(document: Document, count: int, band: int) -> None:
    from meshmash_viewer.features.filters import bspline_bank

    document.display.kind = "band"
    document.display.change(GeometryVectors, count=count)
    document.display.change(GeometryVectors, index=band)
    request = request_of(document)
    ends = request.family.range(document.spectrum)
    low, high = request.family.support(document.spectrum)
    grid = np.linspace(*ends, 2001)
    weights = bspline_bank(*ends, count)(grid)[band]
    step = grid[1] - grid[0]
    inside = grid[weights > 0.0]
    assert inside[0] == pytest.approx(low, abs=1.5 * step)
    assert inside[-1] == pytest.approx(high, abs=1.5 * step)


def test_similarity_needs_a_vertex_and_a_table(document: Document) -> None:
    document.display.kind = "similarity"
    assert request_of(document).family.name == "eigenfunction"
    document.display.change(Similarity, vertex=3)
    live = LiveFeatures()
    for basis in FEATURES:
        document.display.change(Similarity, basis=basis)
        request = request_of(document)
        assert compute_field(request, live) is None
        live.prepare(request)
        field = compute_field(request, live)
        assert field.values[3] == 0.0
        assert field.colors(document.display)[1] == "viridis_r"  # similar vertices are bright
        assert field.unit == ""
        assert "vertex 3" in field.quantity


def test_limits_follow_the_policy_and_are_computed_once(document: Document) -> None:
    field = compute_field(request_of(document), LiveFeatures())
    low, high = field.limits(None)
    assert -low == high == pytest.approx(np.abs(field.values).max())
    assert field.limits(LockedLimits(1.0, 2.0)) == (1.0, 2.0)
    field.values[:] = 0.0
    assert field.limits(None) == (low, high)


def test_limits_of_a_carried_field_stay_with_it(document: Document) -> None:
    field = compute_field(request_of(document), LiveFeatures())
    carried = field.carried(np.zeros(len(field.values), dtype=np.int64))
    assert carried.limits(MinMaxLimits()) != field.limits(MinMaxLimits())


def test_labels_have_the_colours_of_their_own(rectangle: Mesh) -> None:
    labels = (Label(4, "a", "#ff0000"), Label(-2, "b", "#00ff00"))
    parts = np.array([4, -2])[np.arange(rectangle.n_vertices) % 2]
    mesh = rectangle.with_maps(VertexMap("parts", parts, labels))
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(replace(spectrum_of(rectangle, 40), mesh=mesh))
    document.display.kind = "map"
    document.display.change(OwnMaps, chosen="parts")
    field = compute_field(request_of(document), LiveFeatures())
    assert field.colors(document.display) == ((-0.5, 1.5, False), ("#ff0000", "#00ff00"))


def test_labels_without_a_vertex_have_colours_too(rectangle: Mesh) -> None:
    labels = (Label(1, "a", "#ff0000"), Label(2, "b", "#00ff00"))
    mesh = rectangle.with_maps(VertexMap("parts", np.zeros(rectangle.n_vertices), labels))
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.display.show(OwnMaps(chosen="parts"))
    field = compute_field(request_of(document), LiveFeatures())
    limits, colors = field.colors(document.display)
    assert (limits, colors) == ((-0.5, 1.5, False), ("#ff0000", "#00ff00"))
    assert (field.beyond(limits), field.value_text(0)) == ((False, False), "no value")
    kept = field.as_map()
    assert [each.name for each in kept.labels] == ["a", "b"]
    assert np.isnan(kept.shown).all()


@pytest.mark.parametrize(
    ("kind", "end"), [("hks", ", 40 pairs"), ("eigenfunction", ""), ("wks", ", 40 pairs")]
)
def test_a_kept_field_has_the_number_of_pairs_on_which_it_depends(
    rectangle: Mesh, kind: str, end: str
) -> None:
    document = Document()
    document.accept_mesh(MeshReady(rectangle, mesh_health(rectangle), rectangle.vertex_normals))
    document.accept_spectrum(replace(spectrum_of(rectangle, 40), mesh=rectangle))
    document.display.kind = kind
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    field = compute_field(request, live)
    assert field.as_map().name == f"{field.title} {field.quantity}{end}".replace("\xa0", " ")


@pytest.mark.parametrize(
    ("view", "text"), [("residual", "1"), ("filter", "x >= c"), ("pairs", "1")]
)
def test_differences_from_the_mean_have_limits_as_far_apart_as_the_map(
    rectangle: Mesh, view: str, text: str
) -> None:
    height = 5.0 + np.cos(2.0 * rectangle.vertices[:, 0])
    mesh = rectangle.with_maps(VertexMap("height", height))
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(replace(spectrum_of(rectangle, 40), mesh=mesh))
    document.display.put(Filters().with_text(text))
    document.display.show(OwnMaps(chosen="height", view="map"))
    whole = compute_field(request_of(document), LiveFeatures())
    document.display.show(OwnMaps(chosen="height", view=view, pairs=3))
    live = LiveFeatures()
    live.prepare(request_of(document))
    field = compute_field(request_of(document), live)
    low, high = whole.limits(None)
    assert field.signed == (view != "pairs")
    half = 0.5 * (high - low)
    assert field.limits(None) == ((-half, half) if field.signed else (low, high))


@pytest.mark.parametrize(
    ("asked", "there", "taken"), [(50, 200, 50), (50, 20, 20), (1, 200, FEWEST_PAIRS)]
)
def test_a_shape_is_rebuilt_from_as_many_pairs_as_there_are(
    asked: int, there: int, taken: int
) -> None:
    assert Shape(pairs=asked).within(there) == taken

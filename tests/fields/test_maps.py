"""Maps of a mesh as fields: displayed values equal those that the library computes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest
from faults import raises
from solved import spectrum_of

import meshmash_viewer as mv
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.maps import CURVATURES, OwnMaps
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import LiveFeatures
from meshmash_viewer.spectral import eigenpairs as spectra
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.vertex_map import Label, VertexMap

CHOSEN = {name: family() for name, family in FAMILIES.items()}
LABELS = (mv.Label(4, "a", "#ff0000"), mv.Label(-2, "b", "#00ff00"))


@dataclass
class Asked:
    spectrum: Eigenpairs
    family: Family


@pytest.fixture(scope="module")
def pairs(rectangle: Mesh) -> Eigenpairs:
    return mv.solve(*mv.cotangent_laplacian(rectangle, robust=True), n_components=60)


@pytest.fixture(scope="module")
def mapped(rectangle: Mesh) -> Mesh:
    rng = np.random.default_rng(3)
    n = rectangle.n_vertices
    height = np.sin(3.0 * rectangle.vertices[:, 0]) + 0.1 * rng.standard_normal(n)
    holed = np.where(np.arange(n) % 7 == 0, np.nan, np.abs(height))
    parts = np.array([4, -2, 9])[np.arange(n) % 3]
    return rectangle.with_maps(
        mv.VertexMap("height", height, unit="mm"),
        mv.VertexMap("holed", holed),
        mv.VertexMap("parts", parts, LABELS),
    )


@pytest.fixture(scope="module")
def spectrum(mapped: Mesh, pairs: Eigenpairs) -> Eigenpairs:
    return replace(spectrum_of(mapped, 60), rows=pairs.rows, mass=pairs.mass, mesh=mapped)


def shown(spectrum: Eigenpairs, live: LiveFeatures | None = None, **choice: object) -> np.ndarray:
    live = live or LiveFeatures()
    asked = Asked(spectrum, replace(OwnMaps(), **choice).resolved(spectrum, CHOSEN))
    live.prepare(asked)
    answer = live.compute(asked)
    assert answer is not None
    assert not answer.draft
    return answer.values


@pytest.mark.parametrize("n_pairs", [0, 60])
def test_a_map_is_shown_as_it_is(mapped: Mesh, spectrum: Eigenpairs, n_pairs: int) -> None:
    known = spectrum if n_pairs else Eigenpairs.without_pairs(mapped)
    for name in ("height", "holed"):
        values = mapped.map_named(name).values
        np.testing.assert_array_equal(shown(known, chosen=name), values.astype(np.float32))
    np.testing.assert_array_equal(shown(known, chosen="no such map"), shown(known, chosen="height"))
    family = OwnMaps(chosen="parts").resolved(known, CHOSEN)
    assert family.describe(known, "").labels == LABELS
    wanted = np.array([0.0, 1.0, np.nan])[np.arange(mapped.n_vertices) % 3]
    np.testing.assert_array_equal(shown(known, chosen="parts", view="pairs"), wanted)
    assert OwnMaps(chosen="height").resolved(known, CHOSEN).signed
    assert not OwnMaps(chosen="holed").resolved(known, CHOSEN).signed


def test_curvatures_are_always_there(sphere: Mesh) -> None:
    bare = Eigenpairs.without_pairs(sphere.in_unit("mm"))
    for name, function, unit in zip(
        CURVATURES, (mv.mean_curvature, mv.gaussian_curvature), ("mm⁻¹", "mm⁻²"), strict=True
    ):
        np.testing.assert_allclose(shown(bare, chosen=name), function(sphere), rtol=1e-6)
        family = OwnMaps(chosen=name).resolved(bare, CHOSEN)
        assert family.describe(bare, "mm").unit("mm") == unit
        assert family.signed


def test_mean_curvature_where_faces_disagree_says_so(sphere: Mesh) -> None:
    faces = np.where(np.arange(sphere.n_faces)[:, None] < 9, sphere.faces[:, ::-1], sphere.faces)
    for mesh, doubted in ((Mesh(sphere.vertices, faces), {"Mean curvature"}), (sphere, set())):
        bare, said = Eigenpairs.without_pairs(mesh), set()
        for name in CURVATURES:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                shown(bare, chosen=name)
            family = OwnMaps(chosen=name).resolved(bare, CHOSEN)
            if "faces do not agree on which side is outside" in family.describe(bare, "").quantity:
                said.add(name)
            assert [each.category for each in caught] == [mv.MeshWarning] * (name in said)
        assert said == doubted


def test_the_sum_of_pairs_is_that_of_the_library(
    spectrum: Eigenpairs, mapped: Mesh, pairs: Eigenpairs
) -> None:
    """Sums are correct in any order of the slider's positions."""
    live, values = LiveFeatures(), mapped.map_named("height").values
    found = mv.map_spectrum(pairs, values)
    for count in (5, 6, 60, 58, 1, 2, 33):
        wanted = mv.reconstruct(pairs.eigenvectors, found.coefficients[:count])
        given = shown(spectrum, live, chosen="height", view="pairs", pairs=count)
        np.testing.assert_allclose(given, wanted, rtol=1e-5, atol=1e-6)
    left = np.sqrt(np.sum(pairs.mass * (values - wanted) ** 2) / np.sum(pairs.mass * values**2))
    assert found.residual(33) == pytest.approx(left, rel=1e-9)


def test_dominant_bands_are_those_of_the_library(
    spectrum: Eigenpairs, mapped: Mesh, pairs: Eigenpairs
) -> None:
    with pytest.warns(mv.MissingValuesWarning):
        found = mv.map_spectrum(pairs, mapped.map_named("holed").values)
    wanted = mv.dominant_bands(found, pairs.rows).astype(float)
    wanted[np.isnan(mapped.map_named("holed").values)] = np.nan
    np.testing.assert_array_equal(shown(spectrum, chosen="holed", view="band"), wanted)
    family = OwnMaps(chosen="holed", view="band").resolved(spectrum, CHOSEN)
    labels = family.describe(spectrum, "mm").labels
    assert len(labels) > np.nanmax(wanted)
    assert len({label.color for label in labels}) == len(labels)
    longest = 2.0 * np.pi / np.sqrt(spectrum.eigenvalues[1])
    assert labels[0].name.startswith(f"{longest:.3g}")


def test_the_spectrum_of_a_map_is_drawn_and_dragged(
    spectrum: Eigenpairs, mapped: Mesh, pairs: Eigenpairs
) -> None:
    family = OwnMaps(chosen="height", pairs=12)
    shown(spectrum, chosen="height")
    response = family.response(spectrum, spectrum.eigenvalues)
    assert response is not None
    places, heights = response.curve
    lines = heights.reshape(-1, 3)
    squares = np.square(mv.map_spectrum(pairs, mapped.maps[0].values).coefficients)
    wanted = 1.0 + np.log10(squares / squares[1:].max()) / 6.0
    np.testing.assert_allclose(lines[:, 1], np.clip(wanted, 0.0, 1.0), atol=1e-9)
    assert (lines[:, [0, 2]] == 0.0).all()
    assert response.handle == spectrum.eigenvalues[11]
    assert family.at_eigenvalue(spectrum, response.handle).pairs == 12
    assert family.step(spectrum, 3).chosen == "Mean curvature", "the next maps"
    again = replace(family, view="pairs").step(spectrum, 3)
    assert (again.pairs, again.step(spectrum, 100).pairs) == (15, 60)
    assert OwnMaps(chosen="parts").resolved(spectrum, CHOSEN).response(spectrum, places) is None


def test_a_profile_is_what_each_pair_adds(spectrum: Eigenpairs) -> None:
    values = shown(spectrum, chosen="height", view="pairs", pairs=60)
    profile = OwnMaps(chosen="height").profile(spectrum, "")
    assert profile is not None
    _, parts = profile.dots.values(spectrum.rows[:60, 77])
    assert parts.sum() == pytest.approx(values[77], rel=1e-5)


def test_labels_are_not_summed_over_pairs(rectangle: Mesh) -> None:
    labels = Label(0, "left", "#d01010"), Label(1, "right", "#1010d0")
    mesh = rectangle.with_maps(VertexMap("halves", rectangle.vertices[:, 0] > 1, labels=labels))
    OwnMaps.exported(chosen="halves").check_mesh(mesh)
    OwnMaps.exported(chosen="Mean curvature", view="pairs").check_mesh(mesh)
    for chosen in ({}, {"chosen": "halves"}):
        with raises("labels-not-values", "halves contains labels"):
            OwnMaps.exported(view="pairs", **chosen).check_mesh(mesh)


def test_a_filter_is_near_while_it_moves_over_a_large_mesh_and_right_where_it_rests(
    spectrum: Eigenpairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spectra, "_SMALL", 0)
    live, near = LiveFeatures(), None
    mass, rows = spectrum.vertex_areas, np.asarray(spectrum.rows)
    height = spectrum.mesh.map_named("height").values
    coefficients = rows @ (mass * height)
    for text, values in (
        ("exp(-t*x)", {"t": 0.01}),
        ("exp(-t*x)", {"t": 0.05}),
        ("x < c", {"c": 80.0}),
    ):
        chosen = {**CHOSEN, "filter": Filters(text).with_values(**values)}
        family = OwnMaps(chosen="height", view="filter").resolved(spectrum, chosen)
        weights = chosen["filter"].weights(spectrum)
        wanted = (weights * coefficients) @ rows
        asked = Asked(spectrum, family)
        if near is not None:
            found = live.compute(asked)
            assert found.draft
            np.testing.assert_allclose(found.values, wanted, atol=0.02 * np.ptp(wanted))
        live.prepare(asked)
        found = live.compute(asked)
        assert not found.draft
        np.testing.assert_allclose(found.values, wanted, rtol=1e-5, atol=1e-6)
        assert near is None or live.tables["map"].content.near is near, "it is built once"
        near = live.tables["map"].content.near


def test_mean_is_that_of_the_surface(rectangle: Mesh) -> None:
    """The mean is weighted by area, so an uneven density of vertices does not change it."""
    vertices = np.array(rectangle.vertices)
    width = np.ptp(vertices[:, 0])
    vertices[:, 0] = width * ((vertices[:, 0] - vertices[:, 0].min()) / width) ** 3
    stray = np.array([[9.0, 9.0, 9.0]])
    crowded = Mesh(np.concatenate([vertices, stray]), rectangle.faces)
    values = np.append(vertices[:, 0], 1e6)
    crowded = crowded.with_maps(
        mv.VertexMap("x", values),
        mv.VertexMap("flat", np.where(values < 0.3 * width, np.nan, 2.0)),
        mv.VertexMap("parts", np.array([4, -2])[np.arange(len(values)) % 2], LABELS),
    )
    bare = Eigenpairs.without_pairs(crowded)
    assert np.isnan(OwnMaps(chosen="x").mean(bare)), "areas are not summed by who only asks"
    for name, wanted in (("x", 0.5 * width), ("flat", 2.0), ("parts", np.nan)):
        family = OwnMaps(chosen=name).resolved(bare, CHOSEN)
        family.compute(bare, None)
        np.testing.assert_allclose(family.mean(bare), wanted, rtol=1e-12)


def test_sums_of_one_map_are_not_shown_for_another(spectrum: Eigenpairs) -> None:
    one, other = (
        OwnMaps(chosen=name, view="pairs").resolved(spectrum, CHOSEN)
        for name in ("height", "holed")
    )
    table = one.prepare(spectrum, None)
    assert one.compute(spectrum, table) is not None
    assert other.compute(spectrum, table) is None

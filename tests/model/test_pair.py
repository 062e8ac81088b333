"""Linked views: a copy of a mesh displays the same field as the mesh."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from faults import raises
from tiers import slow, slow_but

import meshmash_viewer as mv
from meshmash_viewer.features.comparison import (
    compare_shapes,
    corresponding_vertices,
    match_functions,
)
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health, repair_mesh
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, LiveFeatures, compute_field, request_of
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)
from meshmash_viewer.model.matching import MATCHED_IN, ComparisonRequest
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.model.script import reproduction_script
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

COUNT = 60


def opened(mesh: Mesh, first: Document | None = None) -> Document:
    """Return a document that decomposes its mesh at once; of the window of `first`, if given."""
    document = Document(None if first is None else first.history.of("second"))
    document.work.requested.connect(partial(answer, document))
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    return document


def answer(document: Document, job: Job) -> None:
    mesh, operator, target = job.work.args
    matrices = cotangent_laplacian(mesh, robust=True)
    if target.kind == "count":
        found = solve(*matrices, round(target.value))
        known_to = 0.0
    else:
        found = solve(*matrices, max_eigenvalue=target.value)
        known_to = target.value
    spectrum = Eigenpairs(
        found.eigenvalues, found.rows, found.residuals, total=len(found.eigenvalues),
        certificate=found.certificate, operator=operator, mass=found.mass, known_to=known_to,
    )  # fmt: skip
    document.accept_spectrum(spectrum)


def paired(first: Document, second: Document) -> Pair:
    """Return a pair whose comparisons are computed at once."""
    pair = Pair(first, second)
    pair.comparison_requested.connect(lambda request: pair.accept(request, request.answered()))
    return pair


@pytest.fixture(scope="module")
def meshes() -> tuple[Mesh, Mesh, np.ndarray]:
    mesh = shapes.blob(3)
    return mesh, *shapes.moved_copy(mesh)


@pytest.fixture
def pair(meshes: tuple[Mesh, Mesh, np.ndarray]) -> Pair:
    first = opened(meshes[0])
    pair = paired(first, opened(meshes[1], first))
    first.solve.target = Target("count", COUNT)
    first.solve.compute()
    return pair


def shown(document: Document) -> Field:
    request, live = request_of(document), LiveFeatures()
    assert request is not None
    live.prepare(request)
    field = compute_field(request, live)
    assert field is not None
    return field


def test_both_are_solved_to_the_same_eigenvalue_times_area_and_compared(pair: Pair) -> None:
    first, second = pair.first.spectrum, pair.second.spectrum
    assert len(first) == len(second) == COUNT
    found = pair.comparison
    np.testing.assert_allclose(found.distance, 0.0, atol=1e-6)
    assert found.mutual_share > 0.99
    # the library computes the same numbers
    decompositions = [
        solve(*cotangent_laplacian(each.mesh, robust=True), COUNT)
        for each in (pair.first, pair.second)
    ]
    bank = MATCHED_IN[pair.matched_in].exported(100).bank(found.spectra[0])
    wanted = compare_shapes(*decompositions, bank)
    np.testing.assert_allclose(found.spectra, wanted.spectra, rtol=1e-6)
    np.testing.assert_array_equal(found.forth.indices, wanted.forth.indices)


@pytest.mark.parametrize("name", slow_but(["eigenfunction", "hks", "distance"], FAMILIES))
def test_the_copy_shows_what_the_mesh_shows(
    pair: Pair, meshes: tuple[Mesh, Mesh, np.ndarray], name: str
) -> None:
    first, place = pair.first, meshes[2]
    first.pins.toggle(40)
    first.display.change(Eigenfunctions, index=7)
    first.display.change(HeatKernelSignature, time=0.2)
    first.display.change(GeometryVectors, index=5)
    first.display.change(Filters, text="exp(-t*x)", values=(("t", 0.1),))
    first.display.change(Similarity, vertex=40)
    first.display.change(Distances, vertex=40, measure="diffusion", time=0.3)
    first.display.kind = name
    mine, other = shown(first), shown(pair.second)
    assert pair.second.display.kind == name == other.family.name
    carried = other.values[place]
    carried = carried / np.linalg.norm(carried)
    np.testing.assert_allclose(carried, mine.values / np.linalg.norm(mine.values), atol=2e-4)


def test_a_function_that_was_turned_round_and_moved_is_the_same_one(
    meshes: tuple[Mesh, Mesh, np.ndarray],
) -> None:
    first, second = (opened(mesh) for mesh in meshes[:2])
    pair = paired(first, second)
    second.work.requested.disconnect()
    second.work.requested.connect(partial(swapped, second))
    first.solve.target = Target("count", COUNT)
    first.solve.compute()
    functions, one = pair.comparison.functions, nearest_neighbours(first.spectrum)
    assert functions.indices[one] == one + 1
    assert functions.indices[one + 1] == one
    first.display.change(Eigenfunctions, index=one)
    mine, other = shown(first), shown(second)
    assert other.family.index == one + 1
    assert np.corrcoef(mine.values, other.values[meshes[2]])[0, 1] > 0.999


def nearest_neighbours(spectrum: Eigenpairs) -> int:
    """Return the first of the two nearest pairs, whose exchange keeps the features."""
    return int(np.argmin(np.diff(spectrum.eigenvalues[:20])))


def swapped(document: Document, job: Job) -> None:
    """Answer with two functions exchanged and every third sign flipped."""
    answer(document, job)
    spectrum = document.spectrum
    rows, one = np.array(spectrum.rows), nearest_neighbours(spectrum)
    rows[[one, one + 1]] = rows[[one + 1, one]]
    rows[::3] *= -1.0
    document.accept_spectrum(replace(spectrum, rows=rows))


def test_what_is_cut_stays(pair: Pair) -> None:
    first, second = pair.first.display, pair.second.display
    first.kind = "hks"
    pair.link("kind", False)
    first.kind = "band"
    assert second.kind == "hks"
    pair.link("kind", True)
    assert second.kind == "band"
    first.change(GeometryVectors, index=3)
    pair.link("position", False)
    first.change(GeometryVectors, index=9)
    assert second[GeometryVectors].index == 3
    pair.close()
    first.kind = "hks"
    assert second.kind == "band"


def test_links_and_match_are_undone_with_what_they_replaced(pair: Pair) -> None:
    first, second, history = pair.first.display, pair.second.display, pair.first.history
    first.change(GeometryVectors, index=9)
    pair.link("position", False)
    second.change(GeometryVectors, index=3)
    pair.link("position", True)
    assert second[GeometryVectors].index == 9
    pair.carry(True)
    pair.match_by("hks")
    assert history.undo_label == "match of the second mesh"
    history.undo()
    history.undo()
    assert (pair.matched_in, pair.carries) == ("wks", False)
    assert history.undo_label == "link of the second mesh"
    history.undo()
    assert "position" not in pair.links
    assert second[GeometryVectors].index == 3
    history.redo()
    assert "position" in pair.links
    assert second[GeometryVectors].index == 9


def test_a_pin_has_matches_and_corresponds_to_the_pin_of_its_number_on_the_other_mesh(
    pair: Pair, meshes: tuple[Mesh, Mesh, np.ndarray]
) -> None:
    place, first, second = meshes[2], pair.first.pins, pair.second.pins
    first.toggle(100)
    first.change("name of a pin", 100, name="soma")
    best, *others = pair.best_matches(100)
    assert best[0] == place[100]
    assert len(others) == 3
    scores = [best[1], *(score for _, score in others)]
    assert scores == sorted(scores)
    assert best[1] == pytest.approx(0.0, abs=1e-3)
    second.toggle(int(place[100]))
    second.toggle(5)
    assert [(each.number, each.name) for each in second.placed] == [(1, "soma"), (2, "")]
    first.toggle(9)
    assert pair.landmarks == ((100, place[100]), (9, 5))
    second.change("name of a pin", 5, name="axon")
    assert first.placed[1].name == "axon"
    pair.first.history.undo()
    assert {each.name for each in (*first.placed, *second.placed)} == {"soma", ""}
    first.toggle(100)
    assert pair.landmarks == ((9, 5),)


def test_what_is_pinned_on_the_second_stays_there_through_its_repair() -> None:
    blob, debris = shapes.blob(3), shapes.icosphere(1)
    vertices = np.concatenate([debris.vertices * 1e-3 + blob.bounds[1], blob.vertices])
    pair = solved(blob, Mesh(vertices, np.concatenate([debris.faces, blob.faces + 42])))
    second, repair = pair.second, "keep_largest_component"
    for vertex in (60, 5):  # the other is on debris, and restored by undo
        second.pins.toggle(vertex)
    before = second.mesh
    assert before is not None
    mesh = repair_mesh(before, repair)
    second.accept_mesh(
        MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals, repairs=(repair,), derived=True)
    )
    assert [mesh.file_index(pin.vertex) for pin in second.pins.placed] == [60]
    second.undo_repair()
    assert [pin.vertex for pin in second.pins.placed] == [60, 5]


def test_vertices_are_matched_in_another_feature(pair: Pair) -> None:
    before = pair.comparison
    for name in MATCHED_IN:
        pair.match_by(name)
        assert pair.comparison is not None
        assert pair.comparison.mutual_share > 0.99
    assert pair.comparison is not before


@pytest.mark.slow
def test_the_match_is_refined_with_pins_of_both_meshes_as_landmarks(
    pair: Pair, meshes: tuple[Mesh, Mesh, np.ndarray]
) -> None:
    place = meshes[2]
    pair.match_by(refined=True)
    assert pair.comparison is not None
    assert pair.comparison.functional is not None
    assert np.mean(pair.comparison.forth.indices == place) > 0.99
    assert np.mean(place[pair.comparison.back.indices] == np.arange(len(place))) > 0.99
    assert pair.landmarks == ()
    before = pair.comparison
    pair.first.pins.toggle(50)
    pair.second.pins.toggle(int(place[50]))
    assert pair.landmarks == ((50, place[50]),)
    assert pair.comparison is not before
    assert "refine=True, landmarks=[[50, " in reproduction_script(pair.first, pair)
    pair.match_by(refined=False)
    assert pair.comparison.functional is None


def test_more_pairs_than_needed_are_compared_too(meshes: tuple[Mesh, Mesh, np.ndarray]) -> None:
    # as if more pairs had been stored before
    first, second = (opened(mesh) for mesh in meshes[:2])
    second.solve.target = Target("count", COUNT + 30)
    second.solve.compute()
    pair = paired(first, second)
    first.solve.target = Target("count", COUNT)
    first.solve.compute()
    assert pair.comparison is not None
    assert len(pair.comparison.spectra[1]) == COUNT


def test_a_mesh_that_has_too_little_is_one_sentence(pair: Pair) -> None:
    tetrahedron = mv.Mesh(np.eye(4)[:, :3], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    small = opened(tetrahedron)
    small.solve.target = Target("count", 2)
    small.solve.compute()
    request = ComparisonRequest(small.spectrum, pair.second.spectrum, pair.matched_in)
    with raises("too-few-pairs", "1 nonzero eigenvalue, too few"):
        request.answered()


def solved(first: Mesh, second: Mesh, disturb=lambda document, job: answer(document, job)) -> Pair:
    """Decompose and compare both meshes; `disturb` answers for the second."""
    one = opened(first)
    other = opened(second, one)
    other.work.requested.disconnect()
    other.work.requested.connect(partial(disturb, other))
    pair = paired(one, other)
    one.solve.target = Target("count", COUNT)
    one.solve.compute()
    return pair


def stretched(*factors: float) -> Mesh:
    """Return a ball with three planes of symmetry, whose sides look alike."""
    ball = shapes.icosphere(3)
    return Mesh(ball.vertices * factors, ball.faces, "mm")


def test_functions_that_cross_are_told_where_both_meshes_are_of_one_template() -> None:
    # the function along x has index 2 on the first mesh and 3 on the second; no signature
    # distinguishes the sides of such a shape
    pair = solved(stretched(1.02, 1.0, 1.6), stretched(1.0, 1.02, 1.6), flipped)
    first, second = pair.first, pair.second
    assert pair.comparison.given
    one = 2
    assert first.spectrum.eigenvalues[one + 1] / first.spectrum.eigenvalues[one] < 1.05
    functions = pair.comparison.functions
    assert functions.indices[[one, one + 1]].tolist() == [one + 1, one]
    for index in (1, one, one + 1, 7):
        first.display.change(Eigenfunctions, index=index)
        mine, other = shown(first), shown(second)
        assert np.corrcoef(mine.values, other.values)[0, 1] > 0.99
    # the library matches the same functions
    pairs = [solve(*cotangent_laplacian(each.mesh, robust=True), COUNT) for each in (first, second)]
    found = match_functions(*pairs, np.arange(first.mesh.n_vertices), turned=True)
    np.testing.assert_array_equal(functions.indices, found.indices)
    np.testing.assert_allclose(functions.correlations, found.correlations, atol=1e-6)


def flipped(document: Document, job: Job) -> None:
    answer(document, job)
    rows = np.array(document.spectrum.rows)
    rows[::2] *= -1.0
    document.accept_spectrum(replace(document.spectrum, rows=rows))


def test_a_multiplet_is_turned_as_a_whole_to_be_that_of_the_first() -> None:
    ball = shapes.icosphere(3)
    pair = solved(ball, Mesh(2.0 * ball.vertices + 5.0, ball.faces), turned)
    first, second = pair.first, pair.second
    assert pair.comparison.functions.determined[:9].all()
    for index in range(1, 9):
        first.display.change(Eigenfunctions, index=index)
        mine, other = shown(first), shown(second)
        np.testing.assert_allclose(2.0 * other.values, mine.values, atol=1e-5)
        assert "no match" not in first.display[Eigenfunctions].correspondence_text(
            pair.correspondence
        )
    # files keep the solver's functions
    areas = second.spectrum.vertex_areas
    own = np.asarray(second.spectrum.rows[1:4])
    drawn = np.asarray(second.spectrum.shown_rows[1:4])
    assert np.abs(own - drawn).max() > 0.01
    np.testing.assert_allclose((drawn * areas) @ drawn.T, np.eye(3), atol=1e-9)


def turned(document: Document, job: Job) -> None:
    """Answer with the three functions of the first multiplet rotated."""
    answer(document, job)
    rows = np.array(document.spectrum.rows)
    rotation, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    rows[1:4] = rotation @ rows[1:4]
    document.accept_spectrum(replace(document.spectrum, rows=rows))


def test_as_many_vertices_alone_are_no_correspondence(
    pair: Pair, meshes: tuple[Mesh, Mesh, np.ndarray]
) -> None:
    mesh, copy, _ = meshes
    assert mesh.n_vertices == copy.n_vertices
    assert corresponding_vertices(mesh, copy) is None
    assert not pair.comparison.given
    mirrored = Mesh(mesh.vertices * [1.0, -1.0, 1.0], mesh.faces[:, ::-1])
    np.testing.assert_array_equal(
        corresponding_vertices(mesh, mirrored), np.arange(mesh.n_vertices)
    )
    fewer = Mesh(mesh.vertices, mesh.faces[:-1])
    assert corresponding_vertices(mesh, fewer) is None


def test_a_part_corresponds_by_index_to_what_the_whole_does() -> None:
    ball = shapes.icosphere(2)
    left = Mesh(ball.vertices, ball.faces, name="lh.pial")
    half = left.masked(ball.vertices[:, 2] >= 0.0)
    wide, right = (
        Mesh(ball.vertices * [1.0, 1.2, 1.5], ball.faces, name=name)
        for name in ("lh.inflated", "rh.pial")
    )
    for first, second in ((half, wide), (wide, half)):
        np.testing.assert_array_equal(
            corresponding_vertices(first, second), np.arange(left.n_vertices)
        )
    assert corresponding_vertices(half, right) is None  # of the same orientation


def test_hemispheres_correspond_by_index_only_where_one_is_the_mirror_image() -> None:
    ball = shapes.icosphere(1)
    left = Mesh(ball.vertices, ball.faces, name="lh.pial")
    for structure, faces, same in (
        ("CortexRight", ball.faces, False),  # equal indices are on opposite sides
        ("CortexRight", np.roll(ball.faces, 1, axis=1), False),
        ("CortexRight", ball.faces[:, ::-1], True),
        ("CortexLeft", ball.faces, True),
        ("", ball.faces, True),
    ):
        other = Mesh(ball.vertices, faces, structure=structure)
        assert (corresponding_vertices(left, other) is not None) == same, structure


def test_pins_of_one_template_are_at_the_same_vertex() -> None:
    pair = solved(stretched(1.02, 1.0, 1.6), stretched(1.0, 1.02, 1.6))
    pair.first.pins.toggle(17)
    assert pair.best_matches(17)[0][0] == 17


@pytest.mark.parametrize(
    "policy",
    [
        None,
        slow(SymmetricLimits()),
        slow(MinMaxLimits()),
        PercentileLimits(2.0, 98.0),
        slow(LockedLimits(-0.1, 0.4)),
    ],
)
@pytest.mark.parametrize("kind", slow_but(["hks"], ["eigenfunction", "hks", "band"]))
def test_one_colour_is_one_value_on_both(kind: str, policy: LimitPolicy | None) -> None:
    first = shapes.blob(3)
    second = Mesh(2.0 * first.vertices * [1.1, 1.0, 1.0], first.faces)
    pair = solved(first, second)
    pair.first.display.kind = kind
    pair.first.display.set_limits(policy)
    for index in (3, 8):
        pair.first.display.change(Eigenfunctions, index=index)
        pair.first.display.change(GeometryVectors, index=index)
        mine, other = shown(pair.first), shown(pair.second)
        drawn, limits = pair.shown_field(mine, other)
        power = 1 if kind == "eigenfunction" else 2
        scale = (second.area / first.area) ** (power / 2)
        np.testing.assert_allclose(drawn.values, other.values * scale, rtol=1e-5)
        assert "area of the first mesh" in drawn.description(lines=False)
        each = [field.limits(policy) for field in (mine, replace(drawn, _limits={}))]
        wanted = min(low for low, _ in each), max(high for _, high in each)
        np.testing.assert_allclose(limits[:2], wanted, rtol=1e-6)
    pair.link("colors", False)
    assert pair.shown_field(mine, other) is None


def test_a_copy_of_another_size_has_the_same_colours(pair: Pair) -> None:
    mine, other = shown(pair.first), shown(pair.second)
    drawn, limits = pair.shown_field(mine, other)
    np.testing.assert_allclose(limits[:2], mine.limits(None), rtol=1e-5)
    np.testing.assert_allclose(drawn.limits(None), mine.limits(None), rtol=1e-5)


def test_what_is_measured_keeps_its_values_and_needs_one_unit() -> None:
    first = stretched(1.0, 1.1, 1.6)
    larger = Mesh(2.0 * first.vertices, first.faces, "mm")
    pair = solved(first, larger)
    pair.first.display.show(OwnMaps(chosen="Mean curvature"))
    mine, other = shown(pair.first), shown(pair.second)
    drawn, limits = pair.shown_field(mine, other)
    assert drawn is other
    assert limits[:2] == mine.limits(None)  # the larger mesh has half the curvature
    pair.second.set_unit("µm")
    assert pair.shown_field(mine, shown(pair.second)) is None


def test_a_map_of_the_second_is_looked_at_on_it() -> None:
    first = stretched(1.0, 1.1, 1.6)
    pair = solved(first, stretched(1.0, 1.2, 1.6))
    mesh = pair.second.mesh
    pair.second.maps.add(mesh, [VertexMap("thickness", mesh.vertices[:, 0])])
    assert pair.first.display.kind == "map"
    assert shown(pair.second).title == "thickness"
    pair.first.pins.toggle(3)
    pair.link("camera", False)
    assert shown(pair.second).title == "thickness"
    pair.first.display.change(OwnMaps, chosen="Gaussian curvature")
    assert shown(pair.second).title == "Gaussian curvature"
    # with maps of one name, each mesh displays its own, also in a later pair
    pair.first.maps.add(first, [VertexMap("thickness", first.vertices[:, 1])])
    assert (shown(pair.first).title, shown(pair.second).title) == ("thickness",) * 2
    third = opened(first)
    paired(pair.first, third)
    third.maps.add(first, [VertexMap("height", first.vertices[:, 1])], shown=False)
    assert third.display[OwnMaps].chosen == "thickness"


def test_a_map_that_comes_later_is_shown_on_both() -> None:
    ball = shapes.icosphere(2)
    kept, late = (VertexMap(name, ball.vertices[:, 2]) for name in ("kept", "late"))
    pair = paired(opened(ball.with_maps(kept)), opened(ball.with_maps(kept, late)))
    pair.first.solve.target = Target("count", 8)
    pair.first.solve.compute()
    pair.first.display.show(OwnMaps(chosen="late"))  # its file is still being read
    assert pair.second.display[OwnMaps].chosen == "kept"
    pair.first.maps.add(pair.first.mesh, [late], shown=False)
    assert pair.second.display[OwnMaps].chosen == "late"


def test_labels_carried_again_replace_those_carried_before(
    pair: Pair, meshes: tuple[Mesh, Mesh, np.ndarray]
) -> None:
    there, first, second = meshes[2], pair.first, pair.second
    height = first.mesh.vertices[:, 2]
    labels = mv.Label(1, "upper", "#aa0000"), mv.Label(2, "lower", "#00aa00")
    given = VertexMap("parts", np.where(height > 0.0, 1, 2), labels)
    second.maps.add(second.mesh, [VertexMap("own", np.arange(len(there)))])
    first.maps.add(first.mesh, [given])
    pair.carry_maps()
    moved = replace(given, values=np.where(height > 0.3, 1, 2))
    first.maps.change("labels", moved)
    first.maps.add(first.mesh, [VertexMap("height", height)])

    def carried(labels: VertexMap, *others: str) -> None:
        """Check the maps of the second mesh and `Pair.carried` against the labels."""
        names = [each.name for each in second.mesh.maps]
        assert sorted(names) == sorted(["own", "match score", "parts", *others])
        found = second.mesh.map_named("parts")
        np.testing.assert_array_equal(found.values[there], labels.values)
        assert found.labels == labels.labels
        known = {id(each) for each in pair.carried}
        assert [each.name for each in second.mesh.maps if id(each) not in known] == ["own"]

    carried(given)
    before = pair.carried
    pair.carry_maps()
    carried(moved, "height")
    assert "Replaced 2 maps" in second.notices.last.text
    assert len(pair.carried) == len(before) + 3  # kept after an undo of the replacement
    first.history.undo()
    carried(given)
    pair.carry_maps()
    carried(moved, "height")
    np.testing.assert_array_equal(second.mesh.map_named("height").values[there], height)


@pytest.mark.parametrize(
    ("known", "masked"),
    [slow(COUNT + 5, True), slow(COUNT + 5, False), slow(10, True), (10, False)],
    ids=["more-part", "more-whole", "fewer-part", "fewer-whole"],
)
def test_a_script_solves_and_compares_the_pairs_that_were_compared(
    masked: bool, known: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first mesh is whole or masked; the second has more or fewer stored pairs."""
    mesh = shapes.blob(3)
    wide = Mesh(mesh.vertices * [1.0, 1.2, 1.5], mesh.faces)
    first, second = opened(mesh), opened(wide)
    if masked:
        height = mesh.vertices[:, 2]
        part = mesh.masked(height > np.quantile(height, 0.4))
        first.accept_part((MeshReady(part, mesh_health(part), part.vertex_normals), None))
    second.solve.target = Target("count", known)
    second.solve.compute()
    pair = paired(first, second)
    first.solve.target = Target("count", COUNT)
    first.solve.compute()
    monkeypatch.chdir(tmp_path)
    for feature in MATCHED_IN:
        pair.match_by(feature)
        wanted = pair.comparison
        script = reproduction_script(first, pair)
        filled = script.replace("mv.Mesh(vertices, faces, unit=...)", "meshes.pop(0)")
        made: dict[str, Any] = {"meshes": [mesh, wide]}
        exec(filled, made)
        assert len(made["decomposition"].eigenvalues) == len(first.spectrum) == COUNT
        assert len(made["other_decomposition"].eigenvalues) == len(second.spectrum)
        found = made["comparison"]
        assert found.distance == pytest.approx(wanted.distance, rel=1e-6)
        np.testing.assert_allclose(found.forth.scores, wanted.forth.scores, atol=1e-5)
        np.testing.assert_array_equal(found.forth.indices, wanted.forth.indices)

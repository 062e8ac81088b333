"""Changes of a document: another mesh, repairs and undo, units, pins, jobs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from solved import spectrum_of

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health, repair_mesh
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Job, Queueing
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.model.notices import Notice
from meshmash_viewer.model.open_mesh import MapGrew, MeshReady
from meshmash_viewer.model.pins import PIN_COLORS, distinct_name
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

#: A repair of components that touch.
pytestmark = pytest.mark.filterwarnings("ignore:.*keep_largest_component leaves")


@pytest.fixture
def document(sphere: Mesh) -> Document:
    document = Document()
    document.accept_mesh(MeshReady(sphere, mesh_health(sphere), sphere.vertex_normals))
    return document


def ready(mesh: Mesh, *repairs: str, derived: bool = False) -> MeshReady:
    return MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals, repairs=repairs, derived=derived)


@pytest.fixture
def requested(document: Document) -> list[Job]:
    """Jobs requested by the document."""
    jobs: list[Job] = []
    document.work.requested.connect(jobs.append)
    return jobs


def test_another_mesh_starts_without_what_was_chosen_on_the_last(
    document: Document, three_spheres: Mesh
) -> None:
    display = document.display
    display.change(Eigenfunctions, index=9)
    document.flip()
    assert display[Eigenfunctions].flipped == {9}
    document.pins.toggle(3)
    display.change(Similarity, vertex=3)
    display.kind = "similarity"
    document.accept_mesh(ready(three_spheres))
    assert display[Eigenfunctions].flipped == frozenset()
    assert display[Eigenfunctions].index == 3  # the first not constant on each sphere
    assert display[Similarity].vertex is None
    assert display.kind == "eigenfunction"
    assert document.pins.placed == ()
    assert not document.undo_repair_steps


def test_a_second_flip_takes_the_first_back(document: Document) -> None:
    document.display.change(Eigenfunctions, index=4)
    document.flip()
    document.display.change(Eigenfunctions, index=5)
    document.flip()
    document.display.change(Eigenfunctions, index=4)
    document.flip()
    assert document.display[Eigenfunctions].flipped == {5}


def test_undo_and_redo_go_through_repairs_and_units_in_their_order(
    document: Document, sphere: Mesh
) -> None:
    spectrum = spectrum_of(sphere, 8)
    document.accept_spectrum(spectrum)
    document.accept_mesh(ready(Mesh(sphere.vertices, sphere.faces[1:]), "one", derived=True))
    document.set_unit("nm")
    document.accept_mesh(
        ready(Mesh(sphere.vertices, sphere.faces[2:], unit="nm"), "one", "two", derived=True)
    )
    document.set_unit("µm")

    def state() -> tuple[int, str, tuple[str, ...], int]:
        assert document.mesh is not None
        known = 0 if document.spectrum is None else len(document.spectrum)
        return document.mesh.n_faces, document.unit, document.repairs, known

    n = sphere.n_faces
    states = [
        (n, "", (), 8), (n - 1, "", ("one",), 0), (n - 1, "nm", ("one",), 0),
        (n - 2, "nm", ("one", "two"), 0), (n - 2, "µm", ("one", "two"), 0),
    ]  # fmt: skip
    labels = ["repair", "change of unit"] * 2
    for at in reversed(range(4)):
        assert state() == states[at + 1]
        assert document.history.undo_label == labels[at]
        document.history.undo()
    assert state() == states[0]
    assert document.history.undo_label == ""
    document.history.undo()
    assert state() == states[0]
    for at in range(4):
        assert document.history.redo_label == labels[at]
        document.history.redo()
        assert state() == states[at + 1]
    assert document.history.redo_label == ""


def test_pairs_computed_since_stay_where_undo_does_not_change_the_shape(
    document: Document, sphere: Mesh
) -> None:
    document.accept_spectrum(spectrum_of(sphere, 8))
    document.set_unit("nm")
    assert document.mesh is not None
    document.accept_spectrum(spectrum_of(document.mesh, 20))
    document.history.undo()
    assert document.unit == ""
    assert document.spectrum is not None
    assert len(document.spectrum) == 20
    assert document.spectrum.mesh is document.mesh


def test_a_new_change_ends_what_can_be_redone_and_another_mesh_ends_all(
    document: Document, sphere: Mesh
) -> None:
    document.pins.toggle(3)
    document.history.undo()
    assert document.history.redo_label == "pin"
    document.pins.toggle(4)
    assert document.history.redo_label == ""
    document.accept_mesh(ready(sphere))
    assert document.history.undo_label == ""


def test_pins_signs_colours_limits_and_maps_are_undone_and_redone(document: Document) -> None:
    display, mesh = document.display, document.mesh
    assert mesh is not None
    display.change(Eigenfunctions, index=4)

    def everything() -> tuple[Any, ...]:
        assert document.mesh is not None
        maps = tuple(each.name for each in document.mesh.maps)
        colors = display.sequential_colormap, display.diverging_colormap, display.limits
        return document.pins.placed, display[Eigenfunctions].flipped, colors, maps

    def lock() -> None:
        display.set_limits(LockedLimits(0.0, 2.0))

    def recolor() -> None:
        display.sequential_colormap = "magma"

    def add_map() -> None:
        document.maps.add(mesh, [VertexMap("height", mesh.vertices[:, 2])])
        display.kind = "eigenfunction"

    changes: dict[str, Callable[[], object]] = {
        "pin": lambda: document.pins.toggle(7),
        "flip of a sign": document.flip,
        "colour limits": lock,
        "colour map": recolor,
        "new map": add_map,
        "removal of a pin": lambda: document.pins.toggle(7),
        "removal of a map": lambda: document.maps.remove("height"),
    }
    states = [everything()]
    for label, change in changes.items():
        change()
        assert document.history.undo_label == label
        states.append(everything())
    assert len(set(map(repr, states))) > 6
    for state in reversed(states[:-1]):
        document.history.undo()
        assert everything() == state
    for state in states[1:]:
        document.history.redo()
        assert everything() == state


def test_what_a_notice_offers_to_undo_is_that_change_alone(document: Document) -> None:
    notices: list[Notice | None] = []
    document.notices.shown.connect(notices.append)
    document.set_unit("nm")
    offer = notices[-1].action
    assert offer is not None
    offer()
    assert document.unit == ""
    document.set_unit("nm")
    assert notices[-1] is not None
    document.pins.toggle(3)
    assert notices[-1] is None, "it is withdrawn"


def test_undo_of_other_voxels_restores_mesh_and_spectrum(
    document: Document, sphere: Mesh, requested: list[Job]
) -> None:
    document.accept_spectrum(spectrum_of(sphere, 8))
    document.set_unit("8 nm")
    requested.pop().accept(ready(sphere.in_voxels((8.0, 8.0, 8.0), "nm"), derived=True))
    assert document.mesh is not None
    np.testing.assert_allclose(document.mesh.vertices, 8.0 * sphere.vertices)
    document.history.undo()
    assert not requested
    assert document.mesh.vertices is sphere.vertices
    assert document.spectrum is not None
    document.history.redo()
    np.testing.assert_allclose(document.mesh.vertices, 8.0 * sphere.vertices)


LARGEST, MERGE = "keep_largest_component", "merge_coincident_vertices"


def halves() -> Mesh:
    """Return a small sphere, and a larger one in two halves with separate vertices."""
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    faces = large.faces + small.n_vertices
    upper = large.vertices[large.faces].mean(axis=1)[:, 2] > 0.0
    faces[upper] += large.n_vertices
    vertices = [small.vertices + 9.0, large.vertices, large.vertices]
    return Mesh(np.concatenate(vertices), np.concatenate([small.faces, faces]))


def repair(document: Document, *names: str) -> None:
    """Repair the mesh as the worker does."""
    for name in names:
        assert document.mesh is not None
        mesh, names_before = repair_mesh(document.mesh, name), document.repairs
        document.accept_mesh(ready(mesh, *names_before, name, derived=True))


def pinned(document: Document) -> dict[int, int]:
    """Return the index in the file of each pin, by number."""
    assert document.mesh is not None
    return {pin.number: document.mesh.file_index(pin.vertex) for pin in document.pins.placed}


@pytest.fixture
def split(document: Document) -> Document:
    document.accept_mesh(ready(halves()))
    return document


def test_pins_follow_to_the_vertex_of_their_index_and_come_back(split: Document) -> None:
    mesh = split.mesh
    assert mesh is not None
    one, other = mesh.referenced[42:204], mesh.referenced[204:]
    lower, seam, upper = (
        42 + int(np.flatnonzero(which)[0]) for which in (one & ~other, one & other, other & ~one)
    )
    for vertex in (3, lower, seam, seam + 162, upper + 162):
        split.pins.toggle(vertex)
    split.display.change(Similarity, vertex=lower)
    everything = pinned(split)
    assert list(everything) == [1, 2, 3, 4, 5]
    notices: list[Notice | None] = []
    split.notices.shown.connect(notices.append)

    repair(split, MERGE)
    # the two pins on the seam are merged; the last has the index of its merged vertex
    assert pinned(split) == {1: 3, 2: lower, 3: seam, 5: upper}
    assert notices[-1].text.startswith("1 pin went with a vertex")
    repair(split, LARGEST)
    assert 1 not in pinned(split), "the small sphere is left out"
    assert pinned(split)[2] == lower
    assert split.mesh is not None
    assert split.mesh.file_index(split.display[Similarity].vertex) == lower
    assert notices[-1].action is not None

    notices[-1].action()
    assert pinned(split)[1] == 3
    split.undo_repair()
    assert pinned(split) == everything
    assert split.display[Similarity].vertex == lower
    repair(split, LARGEST)
    split.pins.toggle(5)
    split.accept_mesh(ready(halves()))  # opened, not repaired
    assert split.pins.placed == ()


def test_pins_made_after_a_repair_are_undone_before_it(split: Document) -> None:
    mesh = split.mesh
    assert mesh is not None
    kept = int(np.flatnonzero(mesh.component_labels == 1)[5])
    for vertex in (3, kept):
        split.pins.toggle(vertex)
    repair(split, LARGEST)
    split.pins.toggle(0)
    split.pins.clear()
    split.pins.clear()  # without pins, no step
    assert pinned(split) == {}
    split.history.undo()
    split.history.undo()
    assert pinned(split) == {2: kept}
    split.history.undo()
    assert pinned(split) == {1: 3, 2: kept}
    split.history.redo()
    assert pinned(split) == {2: kept}
    split.pins.toggle(0)
    split.undo_repair()
    assert pinned(split) == {1: 3, 2: kept}
    assert not split.undo_repair_steps


def test_a_mesh_repaired_as_it_is_read_can_be_undone_step_by_step(
    document: Document, requested: list[Job]
) -> None:
    notices: list[Notice | None] = []
    document.notices.shown.connect(notices.append)
    raw = halves()
    merged = repair_mesh(raw, MERGE)
    largest = repair_mesh(merged, LARGEST)
    document.accept_mesh(
        replace(ready(largest, MERGE, LARGEST), before=(raw, merged), source="a", unasked=True)
    )
    assert notices[-1].text == (
        "Repaired as before: Merge all coincident vertices, Keep the largest component."
    )
    assert document.file_mesh is raw
    for repairs, mesh in (((MERGE,), merged), ((), raw)):
        document.undo_repair()
        requested.pop().accept(ready(mesh, *repairs, derived=True))
        assert document.mesh.content_hash == mesh.content_hash
        assert document.ready.source == "a"
        assert document.file_mesh is raw or document.file_mesh.content_hash == raw.content_hash
    assert not document.undo_repair_steps
    document.history.redo()
    document.history.redo()
    assert document.repairs == (MERGE, LARGEST)


def test_an_index_beyond_a_finished_spectrum_comes_back_to_its_end(
    document: Document, sphere: Mesh
) -> None:
    document.display.change(Eigenfunctions, index=30)
    spectrum = spectrum_of(sphere, 8)
    document.accept_spectrum(replace(spectrum, certificate=Certificate("none")))
    assert document.display[Eigenfunctions].index == 30  # not computed yet
    document.accept_spectrum(spectrum)
    assert document.display[Eigenfunctions].index == 7


def test_exact_eigenvalues_translate_a_target_only_for_the_operator_they_belong_to(
    document: Document, sphere: Mesh
) -> None:
    fifth = Target("count", 5)
    spectrum = replace(spectrum_of(sphere, 8), operator=document.solve.operator)
    document.accept_spectrum(spectrum)
    assert document.solve.translation().eigenvalue(fifth) == (spectrum.eigenvalues[4], True)
    document.solve.operator = OperatorOptions(robust=not document.solve.operator.robust)
    assert not document.solve.translation().eigenvalue(fifth)[1]
    document.accept_spectrum(replace(spectrum, operator=document.solve.operator, n_exact=0))
    assert not document.solve.translation().eigenvalue(fifth)[1]


def test_more_pins_than_colours_go_round_them(document: Document) -> None:
    assert len(set(PIN_COLORS)) == len(PIN_COLORS) >= 12
    for vertex in range(2 * len(PIN_COLORS) + 2):
        document.pins.toggle(vertex)
    assert [pin.color for pin in document.pins.placed] == [
        *PIN_COLORS,
        *PIN_COLORS,
        *PIN_COLORS[:2],
    ]
    assert [pin.number for pin in document.pins.placed] == [
        *range(1, len(document.pins.placed) + 1)
    ]
    before = {pin.vertex: (pin.number, pin.color) for pin in document.pins.placed}
    document.pins.toggle(4)
    after = {pin.vertex: (pin.number, pin.color) for pin in document.pins.placed}
    assert after == {vertex: pin for vertex, pin in before.items() if vertex != 4}
    document.pins.toggle(100)
    assert document.pins.placed[-1].number == 5, "the lowest that is free"
    document.pins.clear()
    assert document.pins.placed == ()


def test_a_mesh_that_comes_repaired_has_nothing_before_it(sphere: Mesh) -> None:
    document = Document()
    document.undo_repair()  # no effect
    document.accept_mesh(ready(sphere, "one"))
    assert not document.undo_repair_steps
    document.undo_repair()
    assert document.mesh is sphere


def test_what_is_asked_for_carries_what_it_needs(
    document: Document, sphere: Mesh, requested: list[Job]
) -> None:
    document.solve.operator = OperatorOptions(robust=False)
    document.solve.target = Target("count", 33)
    document.accept_mesh(replace(ready(sphere, "one"), path=Path("a.ply")))
    document.open_mesh("b.ply", "8 nm")
    document.take_mesh(sphere)
    document.repair("drop_duplicate_faces")
    document.solve.compute()
    *prepared, computed = (job.work for job in requested)
    assert [work.args for work in prepared] == [(Path("b.ply").absolute(),), (sphere,), (sphere,)]
    read, taken, repaired = (work.keywords for work in prepared)
    assert (read["unit"], taken["path"], repaired["path"]) == ("8 nm", None, Path("a.ply"))
    assert (repaired["repairs"], repaired["earlier"]) == (("drop_duplicate_faces",), ("one",))
    operator = document.solve.operator
    assert computed.args == (sphere, operator, Target("count", 33))
    assert [given["operator"] for given in (read, taken, repaired)] == 3 * [operator]


def test_settings_are_told_of_when_they_change(document: Document) -> None:
    told: list[str] = []
    document.solve.changed.connect(lambda: told.append("settings"))
    document.solve.operator = OperatorOptions()
    document.solve.target = Target("count", 100)
    assert not told
    document.solve.operator = OperatorOptions(robust=False)
    document.solve.target = Target("count", 7)
    assert told == ["settings", "settings"]


def test_a_job_is_followed_from_start_to_end(document: Document, sphere: Mesh) -> None:
    told: list[Any] = []

    def listen() -> None:
        job = document.work.job
        told.append(job and (job, job.progress.fraction, job.cancelling))

    document.work.changed.connect(listen)
    document.work.cancel_requested.connect(lambda: told.append("cancel"))
    document.work.cancel()
    document.work.progressed(Progress("slices"))
    assert told == []
    assert document.solve.can_compute
    document.work.started(Job("Previewing", "", print, queueing=Queueing.NEWEST))
    assert document.solve.can_compute  # a preview may be stopped
    requested: list[Job] = []
    document.work.requested.connect(requested.append)
    document.solve.compute()
    (job,) = requested
    document.work.started(job)
    assert not document.solve.can_compute
    document.work.progressed(Progress("slices", 0.5))
    document.work.cancel()
    document.work.ended()
    assert document.solve.can_compute
    states, rest = told[1:4], told[4:]
    assert states == [(job, None, False), (job, 0.5, False), (job, 0.5, True)]
    assert rest == ["cancel", None]
    document.work.ended()
    assert told[-1] is None
    assert not Document().solve.can_compute


def test_a_new_document_plays_nothing_and_takes_ranges_from_the_spectrum() -> None:
    display = Document().display
    assert not display.playing
    assert not display.nodal_lines
    assert display[HeatKernelSignature].automatic
    assert display[GeometryVectors].automatic
    assert display[Eigenfunctions].index == 1
    assert display[Eigenfunctions].flipped == frozenset()


def test_what_is_left_is_told_before_the_work_itself_can_and_learned_from(
    document: Document, sphere: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    document.solve.seconds_rate = 10.0 / (sphere.n_vertices * (40 + 15))
    target = Target("count", 40)
    assert document.solve.expected_seconds(target) == pytest.approx(10.0)
    jobs: list[Job] = []
    document.work.requested.connect(jobs.append)
    document.solve.target = target
    document.solve.compute()

    def left(progress: Progress) -> float | None:
        document.work.progressed(progress)
        assert document.work.job is not None
        return document.work.job.progress.remaining

    document.work.started(jobs[0])
    now[0] += 4.0
    assert left(Progress("operator")) == pytest.approx(6.0)
    assert left(Progress("eigenpairs", 0.5, 4.0)) == 4.0, "the work knows better"
    now[0] += 16.0
    assert left(Progress("operator")) is None, "longer than was expected: nobody knows"

    document.accept_spectrum(spectrum_of(sphere, 40))
    document.work.cancel()
    document.work.ended()
    assert document.solve.expected_seconds(target) == pytest.approx(10.0), (
        "what was stopped tells nothing"
    )
    document.solve.compute()
    document.work.started(jobs[1])
    jobs[1].take(spectrum_of(sphere, 40))
    now[0] += 30.0
    document.work.ended()
    assert document.solve.expected_seconds(target) == pytest.approx(30.0)
    document.work.started(Job("Previewing", "", print))
    assert left(Progress("preview")) is None


def test_names_and_colours_of_pins_are_undone_and_follow_a_repair(split: Document) -> None:
    vertex = 50
    split.pins.toggle(vertex)
    before = split.pins.placed
    split.pins.change("name of a pin", vertex, name="soma")
    split.pins.change("colour of a pin", vertex, own_color="#123456")
    assert (split.pins.placed[0].title, split.pins.placed[0].color) == ("soma", "#123456")
    assert split.history.undo_label == "colour of a pin"
    split.history.undo()
    assert split.pins.placed[0].name == "soma"
    split.history.undo()
    assert split.pins.placed == before
    split.history.redo()
    split.history.redo()
    assert (split.pins.placed[0].label, split.pins.placed[0].color) == ("soma", "#123456")
    split.pins.change("name of a pin", 10**6, name="none")
    assert split.history.undo_label == "colour of a pin", "no such pin"
    repair(split, LARGEST)
    assert pinned(split) == {1: 50}
    assert split.pins.placed[0].name == "soma"


def test_doubled_names_get_a_number() -> None:
    assert distinct_name(" soma\n ", []) == "soma"
    assert distinct_name("spine", ["spine", "spine 2"]) == "spine 3"
    assert distinct_name("", [""]) == ""


def test_a_map_that_grows_leaves_alone_what_is_made_meanwhile(document: Document) -> None:
    mesh, maps, history = document.mesh, document.maps, document.history
    assert mesh is not None
    maps.add(mesh, [VertexMap("hks", np.zeros(mesh.n_vertices))])
    maps.grow(mesh, MapGrew("hks", np.array([3]), np.array([1.0])))
    document.set_unit("nm")
    assert [each.name for each in document.mesh.maps] == ["hks", "hks 2"]
    history.undo()
    assert document.unit == ""
    maps.grow(mesh, MapGrew("hks", np.array([4]), np.array([1.0])))
    assert list(np.flatnonzero(document.mesh.maps[-1].values == 1.0)) == [3, 4]
    maps.end_growing(whole=False)
    assert [each.name for each in document.mesh.maps] == ["hks"], "the one from before stays"
    history.redo()
    assert [each.name for each in document.mesh.maps] == ["hks"]
    assert document.unit == "nm"


def test_undo_of_a_repair_shows_the_field_whose_source_the_repair_removed(
    document: Document, three_spheres: Mesh
) -> None:
    document.accept_mesh(ready(three_spheres))
    display, last = document.display, three_spheres.n_vertices - 1
    display.show(replace(display[Similarity], vertex=last))
    repaired = repair_mesh(three_spheres, "keep_largest_component")
    document.accept_mesh(ready(repaired, "keep_largest_component", derived=True))
    assert display.kind == "eigenfunction"
    for _ in range(2):
        document.history.undo()
        assert (display.kind, display[Similarity].vertex) == ("similarity", last)
        document.history.redo()
        assert (display.kind, display[Similarity].vertex) == ("eigenfunction", None)

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from solved import spectrum_of

from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.notices import Notice
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pins import PIN_COLORS
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target


@pytest.fixture
def document(sphere: Mesh) -> Document:
    document = Document()
    document.accept_mesh(MeshReady(sphere, mesh_health(sphere), sphere.vertex_normals))
    return document


def test_a_second_click_takes_the_pin_away(document: Document) -> None:
    for vertex in (3, 5, 8):
        document.pins.toggle(vertex)
    document.pins.toggle(5)
    assert [pin.vertex for pin in document.pins.placed] == [3, 8]
    document.pins.toggle(9)  # takes the colour that is free again
    assert {pin.color for pin in document.pins.placed} == set(PIN_COLORS[:3])


@pytest.mark.parametrize("vertex", [-1, 10**9])
def test_a_vertex_that_is_not_there_cannot_be_pinned(document: Document, vertex: int) -> None:
    with pytest.raises(IndexError, match="not in the mesh"):
        document.pins.toggle(vertex)
    assert document.pins.placed == ()


def ready_of(mesh: Mesh, path: str = "") -> MeshReady:
    where = Path(path) if path else None
    return MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals, where)


@pytest.mark.parametrize("kind", ["wavelength", "max_eigenvalue"])
def test_lengths_and_eigenvalues_do_not_carry_over(kind: str, sphere: Mesh) -> None:
    document = Document()
    document.solve.target = asked = Target(kind, 18.0)
    document.accept_mesh(ready_of(sphere, "a.ply"))
    assert document.solve.target == asked, "it was asked for this mesh"
    document.accept_mesh(ready_of(sphere, "a.ply"))
    assert document.solve.target == asked, "read again"
    document.accept_mesh(replace(ready_of(sphere, "a.ply"), derived=True))
    assert document.solve.target == asked, "repaired"
    document.accept_mesh(ready_of(sphere, "b.ply"))
    assert document.solve.target == Target("count", 100)
    document.solve.target = asked
    scaled = sphere.in_voxels((8.0, 8.0, 8.0), "nm")
    document.accept_mesh(replace(ready_of(scaled, "b.ply"), derived=True))
    assert document.solve.target == Target("count", 100), "coordinates are other ones"


def test_a_time_that_a_stored_spectrum_does_not_have_is_not_kept(sphere: Mesh) -> None:
    document = Document()
    document.accept_mesh(ready_of(sphere, "a.ply"))
    larger = sphere.in_voxels((1000.0, 1000.0, 1000.0), "nm")
    known = spectrum_of(larger, 20)
    for time, kept in ((1.0, None), (1e6, 1e6)):
        document.display.change(HeatKernelSignature, time=time)
        document.accept_mesh(replace(ready_of(larger, f"{time}.ply"), known=known))
        assert document.display[HeatKernelSignature].time == kept


def test_times_stay_for_a_mesh_in_the_same_unit_only(sphere: Mesh) -> None:
    document = Document()
    document.accept_mesh(ready_of(sphere.in_unit("nm"), "a.ply"))
    document.display.change(HeatKernelSignature, time=5e5, t_min=1e5)
    document.accept_mesh(ready_of(sphere.in_unit("nm"), "b.ply"))
    assert document.display[HeatKernelSignature].time == 5e5
    document.accept_mesh(ready_of(sphere.in_unit("µm"), "c.ply"))
    assert document.display[HeatKernelSignature] == HeatKernelSignature()


def test_a_count_carries_over(document: Document, sphere: Mesh) -> None:
    document.solve.target = Target("count", 7)
    document.accept_mesh(ready_of(sphere, "b.ply"))
    assert document.solve.target == Target("count", 7)


def approximate(spectrum: Eigenpairs) -> Eigenpairs:
    """Return a preview: inexact eigenvalues, no residuals, no certificate."""
    nothing = np.full(len(spectrum), np.nan)
    return replace(
        spectrum,
        eigenvalues=1.02 * spectrum.eigenvalues,
        residuals=nothing,
        certificate=Certificate("none"),
        n_exact=0,
        error=0.03,
    )


@pytest.mark.parametrize("preview_first", [True, False])
def test_a_preview_is_not_replaced_by_less(
    document: Document, sphere: Mesh, preview_first: bool
) -> None:
    exact, preview = spectrum_of(sphere, 5), approximate(spectrum_of(sphere, 20))
    order = (preview, exact) if preview_first else (exact, preview)
    for spectrum in order:
        document.accept_spectrum(spectrum)
    shown = document.spectrum
    assert (len(shown), shown.n_exact, shown.preview) == (20, 5, True)
    assert shown.complete, "what was asked for is"
    np.testing.assert_array_equal(shown.eigenvalues[:5], exact.eigenvalues)
    np.testing.assert_array_equal(shown.eigenvalues[5:], preview.eigenvalues[5:])
    np.testing.assert_array_equal(shown.rows[:5], exact.rows[:5])
    np.testing.assert_array_equal(shown.rows[5:20], preview.rows[5:20])
    # exports use the exact pairs
    np.testing.assert_array_equal(shown.exact.eigenvalues, exact.eigenvalues)
    assert not shown.exact.preview
    # more exact pairs replace the preview
    more = spectrum_of(sphere, 30)
    document.accept_spectrum(more)
    assert document.spectrum.rows is more.rows
    # the preview is dropped with its mesh
    document.accept_mesh(ready_of(sphere, "b.ply"))
    document.accept_spectrum(exact)
    assert document.spectrum.rows is exact.rows


def test_what_is_there_and_whole_need_not_be_computed_again(
    document: Document, sphere: Mesh
) -> None:
    assert not document.solve.is_computed
    operator, asked = document.solve.operator, Target("count", 9)
    whole = replace(spectrum_of(sphere, 9), operator=operator, target=asked)
    for spectrum, count, there in (
        (approximate(whole), 9, False),
        (replace(whole, certificate=Certificate("none")), 9, False),  # not certified yet
        (whole, 8, False),  # more than asked for
        (whole, 9, True),
        (whole, 10, False),
    ):
        document.accept_spectrum(spectrum)
        document.solve.target = Target("count", count)
        assert document.solve.is_computed == there
        assert document.solve.can_compute != there
    # the first pairs of another request do not replace these
    part = replace(whole.first(4), certificate=Certificate("none"), target=Target("count", 20))
    document.accept_spectrum(part)
    assert document.spectrum.target == asked
    fewer = whole.first(4)
    document.accept_spectrum(fewer)
    assert document.spectrum.target == Target("count", 4)


def test_opening_restores_what_was_asked_for(document: Document, sphere: Mesh) -> None:
    document.solve.target = Target("wavelength", 2.5)
    asked = document.solve.asked
    assert asked.kind == "max_eigenvalue"
    stored = replace(spectrum_of(sphere, 9), operator=document.solve.operator, target=asked)
    document.accept_mesh(replace(ready_of(sphere, "a.ply"), known=stored, derived=True))
    assert document.solve.target == Target("wavelength", 2.5)  # as the user stated it
    assert document.solve.is_computed
    part = replace(stored, target=Target("count", 300), certificate=Certificate("none"))
    document.accept_mesh(replace(ready_of(sphere, "b.ply"), known=part))
    assert document.solve.target == Target("count", 300)  # which Compute resumes
    assert not document.solve.is_computed
    # a repair or part with Compute computes what was asked for
    document.solve.target = asked = Target("count", 20)
    repaired = replace(ready_of(sphere, "b.ply"), known=stored, derived=True)
    jobs: list[Job] = []
    document.work.requested.connect(jobs.append)
    document.repair("drop_duplicate_faces", then_compute=True)
    jobs[-1].take(repaired)
    assert document.solve.target == asked
    document.take_part(None, then_compute=True)
    jobs[-1].take((None, stored))
    assert document.solve.target == asked


def test_a_change_of_unit_is_said_and_can_be_taken_back(document: Document) -> None:
    notices: list[Notice] = []
    document.notices.shown.connect(notices.append)
    before = document.unit_text
    document.set_unit("mm")
    assert document.unit_text == "mm"
    undo = notices[-1].action
    assert undo is not None
    undo()
    assert document.unit_text == before


def test_similarity_is_to_the_vertex_pinned_last(document: Document) -> None:
    document.similar()
    assert document.display.kind != "similarity", "to which vertex nobody has said"
    for vertex in (3, 17):
        document.pins.toggle(vertex)
    document.similar()
    assert document.display.kind == "similarity"
    assert document.display[Similarity].vertex == 17

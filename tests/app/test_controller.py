from __future__ import annotations

import threading
from collections.abc import Iterator
from unittest.mock import MagicMock

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from solved import spectrum_of

import meshmash_viewer.app.controller as controller_module
from meshmash_viewer.app.controller import Controller
from meshmash_viewer.app.executor import shutdown
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, FieldRequest, LiveFeatures
from meshmash_viewer.model.notices import Notice
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


def show(document: Document, mesh: Mesh, n_pairs: int = 60) -> None:
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(spectrum_of(mesh, n_pairs))


@pytest.fixture
def document() -> Document:
    return Document()


@pytest.fixture
def view() -> MagicMock:
    return MagicMock(spec=MeshView, mesh=None, turned_by_hand=False)


@pytest.fixture
def source(qtbot: QtBot, document: Document, view: MagicMock) -> Iterator[Controller]:
    source = Controller(document, view)
    yield source
    shutdown(source)


def test_first_field_comes_by_itself(
    qtbot: QtBot, document: Document, source: Controller, view: MagicMock, rectangle: Mesh
) -> None:
    assert source.idle
    with qtbot.waitSignal(
        source.drawn, check_params_cb=lambda field, _: field is not None
    ) as ready:
        show(document, rectangle)
        assert not source.idle
    assert ready.args[0] is source.field
    assert view.set_field.call_args.args[:2] == tuple(ready.args)
    assert source.field.family.index == document.display[Eigenfunctions].index
    qtbot.waitUntil(lambda: source.idle)


def test_latest_request_wins_and_none_waits_in_line(
    qtbot: QtBot,
    document: Document,
    source: Controller,
    rectangle: Mesh,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    show(document, rectangle)
    fields: list[Field] = []
    source.drawn.connect(lambda field, _: fields.append(field))
    asked, limits = threading.Event(), Field.limits

    def slow(field: Field, *given: object) -> tuple[float, float]:
        assert threading.current_thread() is not threading.main_thread()
        asked.wait(60.0)
        return limits(field, *given)

    monkeypatch.setattr(Field, "limits", slow)
    for index in range(200):
        document.display.change(Eigenfunctions, index=index % 60)
    asked.set()
    qtbot.waitUntil(lambda: source.idle)
    assert source.field.family.index == 199 % 60
    assert len(fields) < 20
    np.testing.assert_allclose(
        source.field.values, document.spectrum.rows[199 % 60], rtol=1e-5, atol=1e-12
    )


def test_a_field_of_the_kind_just_left_does_not_flash(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh
) -> None:
    show(document, rectangle)
    qtbot.waitUntil(lambda: source.idle)
    fields: list[Field] = []
    source.drawn.connect(lambda field, _: fields.append(field))
    left = source.field
    document.display.kind = "hks"
    source._take(left.request, source._color(left))  # computed while the kind changed
    assert not fields
    qtbot.waitUntil(lambda: source.idle)
    assert {field.family.name for field in fields} == {"hks"}


def test_table_is_built_behind_a_first_answer(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh
) -> None:
    show(document, rectangle)
    with qtbot.waitSignal(
        source.drawn, check_params_cb=lambda field, _: field and field.family.name == "hks"
    ):
        document.display.kind = "hks"
    qtbot.waitUntil(lambda: source.idle)
    assert source.live.tables.get("hks") is not None
    assert source.live.tables.get("hks").spectrum is document.spectrum


def test_similarity_comes_as_soon_as_it_can(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh
) -> None:
    show(document, rectangle)
    document.display.change(Similarity, vertex=17)
    with qtbot.waitSignal(
        source.drawn, check_params_cb=lambda field, _: field and field.family.name == "similarity"
    ):
        document.display.kind = "similarity"
    assert source.field.values[17] == 0.0


def test_what_is_on_the_render_is_not_overtaken_by_an_older_field(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh
) -> None:
    show(document, rectangle)
    qtbot.waitUntil(lambda: source.idle)
    older = source.field
    document.display.change(Eigenfunctions, index=older.family.index + 1)
    qtbot.waitUntil(lambda: source.idle)
    newer = source.field
    assert newer is not older
    source._take(older.request, older)
    assert source.field is newer


def test_a_fault_is_a_sentence(
    qtbot: QtBot,
    document: Document,
    source: Controller,
    rectangle: Mesh,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    show(document, rectangle)
    document.display.kind = "band"
    qtbot.waitUntil(lambda: source.idle)

    def fails(*arguments: object) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(controller_module, "compute_field", fails)
    said: list[Notice] = []
    document.notices.shown.connect(said.append)
    document.display.change(GeometryVectors, index=7)
    qtbot.waitUntil(lambda: bool(said))
    assert said[0].text == "The field cannot be computed (MemoryError): no room"
    assert source.late


def test_another_mesh_takes_field_and_tables_away(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh, sphere: Mesh
) -> None:
    show(document, rectangle)
    document.display.kind = "hks"
    qtbot.waitUntil(lambda: source.idle and source.live.tables.get("hks") is not None)
    document.accept_mesh(MeshReady(sphere, mesh_health(sphere), sphere.vertex_normals))
    assert source.field is None
    assert not source.live.tables
    document.accept_spectrum(spectrum_of(sphere, 20))
    qtbot.waitUntil(lambda: source.idle and source.field is not None)
    assert len(source.field.values) == sphere.n_vertices


def test_another_mesh_of_as_many_vertices_is_another_mesh(
    qtbot: QtBot,
    document: Document,
    source: Controller,
    sphere: Mesh,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun, leave, compute = threading.Event(), threading.Event(), controller_module.compute_field

    def slow(request: FieldRequest, live: LiveFeatures) -> Field | None:
        begun.set()
        leave.wait(60)
        return compute(request, live)

    monkeypatch.setattr(controller_module, "compute_field", slow)
    show(document, sphere)
    begun.wait()
    fields: list[Field | None] = []
    source.drawn.connect(lambda field, _: fields.append(field))
    show(document, Mesh(sphere.vertices * (1.0, 1.0, 1.7), sphere.faces))
    leave.set()  # the field of the first mesh is ready too late
    qtbot.waitUntil(lambda: source.idle)
    drawn = [field.request.spectrum for field in fields if field is not None]
    assert set(map(id, drawn)) == {id(document.spectrum)}


def test_what_takes_long_is_said_until_it_comes(
    qtbot: QtBot,
    document: Document,
    source: Controller,
    view: MagicMock,
    sphere: Mesh,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    show(document, sphere)
    qtbot.waitUntil(lambda: source.idle)
    said: list[str] = []
    view.set_awaited.side_effect = said.append
    leave, compute = threading.Event(), controller_module.compute_field

    def slow(request: FieldRequest, live: LiveFeatures) -> Field | None:
        if request.family.name == "hks":
            leave.wait(60)
        return compute(request, live)

    monkeypatch.setattr(controller_module, "compute_field", slow)
    document.display.kind = "hks"
    qtbot.waitUntil(lambda: said == ["Heat kernel signature"])
    assert source.field.family.name == "eigenfunction", "which is why it has to be said"
    leave.set()
    qtbot.waitUntil(lambda: source.idle)
    assert set(said[1:]) == {""}


def test_field_that_cannot_be_computed_is_a_sentence(
    qtbot: QtBot, document: Document, source: Controller, rectangle: Mesh
) -> None:
    show(document, rectangle)
    qtbot.waitUntil(lambda: source.idle)
    broken = Eigenpairs(np.arange(500.0), np.zeros((1, rectangle.n_vertices)), np.zeros(500))
    document.display.change(Eigenfunctions, index=2)
    said: list[Notice] = []
    document.notices.shown.connect(said.append)
    document.accept_spectrum(broken)
    qtbot.waitUntil(lambda: bool(said))
    assert "cannot be computed" in said[0].text


def test_closing_does_not_wait_for_tables(
    qtbot: QtBot, document: Document, view: MagicMock, rectangle: Mesh
) -> None:
    source = Controller(document, view)
    show(document, rectangle)
    document.display.kind = "band"
    shutdown(source)
    document.display.kind = "hks"
    shutdown(source)

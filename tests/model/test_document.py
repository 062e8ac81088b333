from __future__ import annotations

import pytest

from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import PIN_COLORS, Document
from meshmash_viewer.model.jobs import MeshReady


@pytest.fixture
def document(sphere: Mesh) -> Document:
    document = Document()
    document.accept_mesh(MeshReady(sphere, mesh_health(sphere), sphere.vertex_normals))
    return document


def test_a_second_click_takes_the_pin_away(document: Document) -> None:
    for vertex in (3, 5, 8):
        document.toggle_pin(vertex)
    document.toggle_pin(5)
    assert [pin.vertex for pin in document.pins] == [3, 8]
    document.toggle_pin(9)  # takes the colour that has become free
    assert {pin.color for pin in document.pins} == set(PIN_COLORS[:3])


@pytest.mark.parametrize("vertex", [-1, 10**9])
def test_a_vertex_that_is_not_there_cannot_be_pinned(document: Document, vertex: int) -> None:
    with pytest.raises(IndexError, match="not in the mesh"):
        document.toggle_pin(vertex)
    assert document.pins == ()

"""The selection: one change for a stroke, kept by repairs, undone and redone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.health import mesh_health, repair_mesh
from meshmash_viewer.io.session import packed_mask, unpacked_mask
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.selection import mask_in_file


def ready(mesh: Mesh, *repairs: str) -> MeshReady:
    return MeshReady(
        mesh, mesh_health(mesh), mesh.vertex_normals, repairs=repairs, derived=bool(repairs)
    )


@pytest.fixture
def document(sphere: Mesh) -> Document:
    document = Document()
    document.accept_mesh(ready(sphere))
    return document


def of(document: Document, *vertices: int) -> np.ndarray:
    assert document.mesh is not None
    mask = np.zeros(document.mesh.n_vertices, dtype=np.bool_)
    mask[list(vertices)] = True
    return mask


def chosen(document: Document) -> list[int]:
    mask = document.selection.mask
    return [] if mask is None else np.flatnonzero(mask).tolist()


def test_a_stroke_is_one_change(document: Document) -> None:
    selection, history = document.selection, document.history
    for last in (3, 4, 5):
        selection.draw(of(document, *range(last)), "brush")
    selection.finish()
    selection.draw(of(document, 20), "brush")
    selection.finish()
    assert [step.label for step in history.past] == ["brush", "brush"]
    history.undo()
    assert chosen(document) == [0, 1, 2, 3, 4]
    history.undo()
    assert selection.mask is None
    history.redo()
    history.redo()
    assert chosen(document) == [20]


def test_vertices_are_added_and_taken_away(document: Document) -> None:
    selection = document.selection
    selection.take(of(document, 1, 2))
    selection.take(of(document, 2, 3), "add")
    selection.take(of(document, 1), "remove")
    assert chosen(document) == [2, 3]
    with pytest.raises(ValueError, match="read-only"):
        selection.mask[0] = True  # type: ignore[index]
    selection.invert()
    assert document.mesh is not None
    assert len(chosen(document)) == document.mesh.n_vertices - 2
    selection.clear()
    steps = len(document.history.past)
    selection.clear()  # nothing changes
    selection.take(of(document))
    assert len(document.history.past) == steps
    with pytest.raises(ValueError, match="one bool for each"):
        selection.set(np.ones(3, dtype=np.bool_))


def test_it_follows_a_repair_and_comes_back(sphere: Mesh) -> None:
    extra = Mesh(
        np.concatenate([[[9.0, 9.0, 9.0]], sphere.vertices]), sphere.faces + 1, unit=sphere.unit
    )
    document = Document()
    document.accept_mesh(ready(extra))
    document.selection.set(of(document, 0, 5, 9))
    repaired = repair_mesh(extra, "drop_unreferenced_vertices")
    document.accept_mesh(ready(repaired, "drop_unreferenced_vertices"))
    assert chosen(document) == [4, 8]
    assert document.selection.mask is not None
    assert np.flatnonzero(mask_in_file(repaired, document.selection.mask)).tolist() == [5, 9]
    document.history.undo()
    assert chosen(document) == [0, 5, 9]
    document.accept_mesh(replace(ready(sphere), derived=False))  # another mesh
    assert document.selection.mask is None


def test_a_mask_is_written_packed(document: Document) -> None:
    mask = of(document, 0, 7, 8, 300)
    assert np.array_equal(unpacked_mask(packed_mask(mask), len(mask)), mask)
    assert unpacked_mask(packed_mask(None), 10) is None
    with raises("other-mesh"):
        unpacked_mask(packed_mask(mask), 99)

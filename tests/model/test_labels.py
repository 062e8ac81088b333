"""Label sets: creation, changes, undo and redo, and refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.health import mesh_health
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.labels import label_sizes
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pins import PIN_COLORS
from meshmash_viewer.vertex_map import MOST_LABELS, Label, VertexMap

MESH = shapes.icosphere(2, radius=3.0)
N = MESH.n_vertices
UP = MESH.vertices[:, 2] > 0.5
RIGHT = MESH.vertices[:, 0] > 0.0


@pytest.fixture
def document() -> Document:
    document = Document()
    document.accept_mesh(MeshReady(MESH, mesh_health(MESH), MESH.vertex_normals))
    return document


@pytest.fixture
def two(document: Document) -> Document:
    """A document with two labels: the upper part, and the right of the rest."""
    labels = document.labels
    labels.new_set()
    labels.new_label()
    document.selection.set(RIGHT)
    labels.assign(2)
    document.selection.set(UP)
    labels.assign(1)
    return document


def state(document: Document) -> list[tuple[object, ...]]:
    return [(each.name, each.labels, each.values.tolist()) for each in document.labels.sets]


def said(document: Document) -> list[str]:
    texts: list[str] = []
    document.notices.shown.connect(lambda notice: notice and texts.append(notice.text))
    return texts


def test_a_new_set_is_displayed_and_waits_for_vertices(document: Document) -> None:
    document.labels.new_set()
    (found,) = document.labels.sets
    assert (found.name, document.labels.current) == ("labels", found)
    assert found.labels == (Label(1, "label 1", PIN_COLORS[0]),)
    assert not found.values.any()
    assert (document.display.kind, document.display[OwnMaps].chosen) == ("map", "labels")
    document.labels.new_set()
    assert [each.name for each in document.labels.sets] == ["labels", "labels 2"]
    assert document.labels.current.name == "labels 2"


def test_the_selection_is_given_to_a_label(two: Document) -> None:
    known = two.labels.current
    np.testing.assert_array_equal(known.values, np.where(UP, 1, np.where(RIGHT, 2, 0)))
    counts, areas, _ = label_sizes(MESH, known)
    assert counts.tolist() == [UP.sum(), (RIGHT & ~UP).sum()]
    np.testing.assert_allclose(areas[0], MESH.vertex_areas[UP].sum())
    two.labels.assign(None)
    np.testing.assert_array_equal(two.labels.current.values, np.where(RIGHT & ~UP, 2, 0))
    two.labels.select([2])
    np.testing.assert_array_equal(two.selection.mask, RIGHT & ~UP)
    two.labels.assign_nth(1)
    assert set(two.labels.current.values[RIGHT & ~UP].tolist()) == {1}


def test_a_locked_label_keeps_its_vertices(two: Document) -> None:
    texts = said(two)
    two.labels.lock(1, True)
    two.selection.set(np.ones(N, dtype=bool))
    two.labels.assign(2)
    np.testing.assert_array_equal(two.labels.current.values, np.where(UP, 1, 2))
    assert texts[-1].startswith(f"{UP.sum()} vertices of locked labels unchanged: ")
    two.labels.assign(None)
    np.testing.assert_array_equal(two.labels.current.values, np.where(UP, 1, 0))
    for act in (lambda: two.labels.delete([1]), lambda: two.labels.join([2, 1])):
        before = state(two)
        act()
        assert texts[-1] == "Label label 1 is locked: unlock it first."
        assert state(two) == before
    two.labels.assign(1)  # a locked label may gain vertices
    assert set(two.labels.current.values.tolist()) == {1}


def test_what_is_given_to_a_set_that_is_not_displayed_is_said(two: Document) -> None:
    texts = said(two)
    two.selection.set(RIGHT)
    two.labels.assign_nth(2)
    assert texts == [], "the render shows it"
    two.maps.add(MESH, [VertexMap("thickness", MESH.vertices[:, 2])])
    texts.clear()
    two.labels.assign_nth(1)
    assert texts == [f"{RIGHT.sum()} vertices given to label 1 of labels."]
    assert two.notices.last.holds is None, "it goes by itself"
    two.labels.lock(2, True)
    two.selection.set(np.ones(N, dtype=bool))
    two.labels.assign(None)
    assert texts[1:] == [f"{(RIGHT | UP).sum()} vertices taken out of the labels of labels."]
    two.history.undo()
    two.selection.set(np.arange(N) < 5)
    two.display.kind = "eigenfunction"
    two.labels.assign(2)
    n_given = np.count_nonzero(two.labels.current.values[:5] == 2)
    assert texts[-1] == f"{n_given} vertices given to label 2 of labels."


ACTS: dict[str, Callable[[Document], None]] = {
    "new map": lambda document: document.labels.new_set(),
    "new label": lambda document: document.labels.new_label(),
    "name of a label": lambda document: document.labels.rename(2, "shaft"),
    "colour of a label": lambda document: document.labels.recolor(2, "#123456"),
    "lock of a label": lambda document: document.labels.lock(2, True),
    "joining of labels": lambda document: document.labels.join([2, 1]),
    "removal of a label": lambda document: document.labels.delete([2]),
    "labels": lambda document: document.labels.assign(2),
    "removal from labels": lambda document: document.labels.assign(None),
    "removal of a map": lambda document: document.labels.delete([1, 2]),
}


def test_labels_are_hidden_shown_and_isolated(two: Document) -> None:
    labels, known = two.labels, two.labels.current
    labels.show([1], False)
    np.testing.assert_array_equal(two.hiding.mask, UP)
    assert label_sizes(MESH, known, two.hiding.mask).hidden.tolist() == [True, False]
    partly = UP & (MESH.vertices[:, 0] > 0.0)
    assert label_sizes(MESH, known, partly).hidden.tolist() == [False, False]
    labels.show([2], False)
    labels.show([1], True)
    np.testing.assert_array_equal(two.hiding.mask, RIGHT & ~UP)
    labels.isolate([1])
    np.testing.assert_array_equal(two.hiding.mask, ~UP)
    for expected in (RIGHT & ~UP, RIGHT | UP, UP):
        two.history.undo()
        np.testing.assert_array_equal(two.hiding.mask, expected)


@pytest.mark.parametrize("label", ACTS)
def test_every_act_is_undone_and_redone(label: str, two: Document) -> None:
    before, old = state(two), two.labels.current
    ACTS[label](two)
    after = state(two)
    assert after != before
    assert (two.history.undo_label, len(two.history.past)) == (label, 7)
    two.history.undo()
    assert state(two) == before
    assert two.labels.current is old
    two.history.redo()
    assert state(two) == after


def test_joined_labels_have_name_and_colour_of_the_first(two: Document) -> None:
    first = two.labels.current.labels[1]
    two.labels.join([2, 1])
    (left,) = two.labels.current.labels
    assert left == first
    np.testing.assert_array_equal(two.labels.current.values, np.where(UP | RIGHT, 2, 0))


def test_a_new_label_takes_no_number_that_vertices_have(document: Document) -> None:
    values = np.where(UP, 7, 0)
    document.maps.add(MESH, [VertexMap("parts", values, (Label(0, "rest", "#E69F00"),))])
    document.labels.new_label()
    assert document.labels.current.labels[-1] == Label(8, "label 2", PIN_COLORS[1])
    document.selection.set(RIGHT)
    document.labels.assign(8)
    document.labels.assign(None)  # 0 is a label here
    assert set(document.labels.current.values[RIGHT].tolist()) == {-1}


def test_colours_and_names_do_not_repeat_while_there_are_others(document: Document) -> None:
    for _ in range(14):
        document.labels.new_label()
    labels = document.labels.current.labels
    assert [each.color for each in labels[:12]] == list(PIN_COLORS)
    document.labels.rename(3, " label   1 ")
    assert document.labels.current.labels[2].name == "label 1 2"
    document.labels.delete([5])
    document.labels.new_label()
    assert len({each.name for each in document.labels.current.labels}) == 14


def test_the_displayed_set_is_the_current_one(two: Document) -> None:
    two.labels.new_set()
    two.display.show(HeatKernelSignature())
    assert two.labels.current.name == "labels 2"
    two.labels.choose("labels")
    assert two.display[OwnMaps].chosen == "labels"
    heard = []
    two.labels.changed.connect(lambda: heard.append(two.labels.current.name))
    two.display.change(OwnMaps, chosen="labels 2")
    assert heard == ["labels 2"]


def test_that_nothing_is_selected_is_said_until_something_is(two: Document) -> None:
    two.selection.set(None)
    two.labels.assign(1)
    assert two.notices.last is not None
    two.selection.set(RIGHT)
    assert two.notices.last is None


def test_a_map_without_a_mesh_is_named() -> None:
    empty = Document()
    empty.maps.open([Path("lh.thickness")])
    assert "There is no mesh to put lh.thickness on" in empty.notices.last.text


@pytest.mark.parametrize(
    ("act", "sentence"),
    [
        (lambda labels: labels.assign(1), "Nothing is selected: select vertices, then"),
        (lambda labels: labels.assign(9), "There is no label 9: give one of 1, 2"),
        (lambda labels: labels.assign_nth(4), "no label 4, as there are 2 labels: make one"),
        (lambda labels: labels.rename(1, "  "), "A label needs a name: type one."),
        (lambda labels: labels.recolor(1, "blue"), "'blue' is not a colour"),
        (lambda labels: labels.join([1]), "Two or more labels are needed"),
        (lambda labels: labels.delete([]), "No label is chosen"),
        (lambda labels: labels.select([1]), "No vertex has this label yet"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(
    act: Callable[[object], None], sentence: str, document: Document
) -> None:
    document.labels.new_set()
    document.labels.new_label()
    if "label 9" in sentence:
        document.selection.set(UP)
    before, steps, texts = state(document), document.history.past, said(document)
    act(document.labels)
    assert sentence in texts[-1]
    assert (state(document), document.history.past) == (before, steps)


def test_without_a_set_or_a_mesh_it_is_one_sentence(document: Document) -> None:
    texts = said(document)
    document.selection.set(UP)
    document.labels.assign(1)
    assert texts[-1] == "There is no label set: make one with New label."
    document.labels.assign_nth(1)
    assert texts == 2 * ["There is no label set: make one with New label."]
    jobs: list[object] = []
    document.work.requested.connect(jobs.append)
    document.labels.measure_regions()
    assert not jobs
    empty = Document()
    texts = said(empty)
    empty.labels.new_label()
    assert texts == ["There is no mesh to label: open one first."]


def test_labels_cannot_be_more_than_colours(document: Document) -> None:
    labels = tuple(Label(key, f"{key}", "#808080") for key in range(1, MOST_LABELS + 1))
    document.maps.add(MESH, [VertexMap("many", np.ones(N), labels)])
    texts = said(document)
    document.labels.new_label()
    assert "513 labels, more than 512 colours" in texts[-1]


def test_numbers_take_four_bytes_unless_one_is_large(two: Document) -> None:
    labels = two.labels.current.labels
    assert two.labels.current.values.dtype == np.int32
    for number in (2**40, -(2**31)):
        known = VertexMap("large", np.array([1, number, 2]), labels)
        assert known.values.tolist() == [1, number, 2]
        assert np.isnan(known.shown[1])
    assert (
        VertexMap("key", np.zeros(3, dtype=np.uint8), (Label(2**40, "a", "#000000"),))
        .mask()
        .tolist()
        == [False] * 3
    )


def test_values_are_shared_and_never_written(two: Document) -> None:
    before = two.labels.current
    two.labels.rename(1, "top")
    after = two.labels.current
    assert after.values is before.values
    with pytest.raises(ValueError, match="read-only"):
        after.values[0] = 3


def test_curvature_is_shown_again_after_a_map_of_a_known_name(document: Document) -> None:
    """The removed map is still the chosen one, and curvature is shown in its place."""
    height = VertexMap("height", MESH.vertices[:, 2])
    document.maps.add(MESH, [height])
    document.maps.remove("height")
    document.display.kind = "map"
    document.maps.add(MESH, [height])
    document.history.undo()
    assert document.display.kind == "map"


def test_undo_and_redo_show_the_field_that_was_shown(document: Document) -> None:
    """Of every step that adds or removes the displayed map."""

    def shown() -> tuple[str, str]:
        return document.display.kind, document.maps.displayed

    height, maps, labels = VertexMap("height", MESH.vertices[:, 2]), document.maps, document.labels
    document.display.kind = "hks"
    states = [shown()]
    steps: list[Callable[[], None]] = [
        labels.new_set,
        labels.new_set,
        lambda: maps.add(MESH, [height]),
        lambda: maps.remove("height"),
        labels.remove_set,
        lambda: labels.delete([1]),  # the last label, and its set
        lambda: maps.add(MESH, [height, replace(height, name="depth")]),
    ]
    for act in steps:
        act()
        states.append(shown())
    first, second = ("map", "labels"), ("map", "labels 2")
    assert states == [
        ("hks", ""), first, second, ("map", "height"), second, first, ("hks", ""), ("map", "depth"),
    ]  # fmt: skip
    for before in reversed(states[:-1]):
        document.history.undo()
        assert shown() == before
    for after in states[1:]:
        document.history.redo()
        assert shown() == after


def test_undo_leaves_a_field_chosen_since(document: Document) -> None:
    document.labels.new_set()
    document.display.kind = "wks"
    for change in (document.history.undo, document.history.redo):
        change()
        assert document.display.kind == "wks"

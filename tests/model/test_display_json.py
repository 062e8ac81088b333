"""The display in a session: written, restored, and refused if invalid."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from faults import raises

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.display import (
    Cut,
    Display,
    display_from_json,
    display_to_json,
    read_display,
)
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

CONTENT = {
    "kind": "band",
    "nodal_lines": True,
    "label_borders": True,
    "label_graph": True,
    "diverging_colormap": "PuOr_r",
    "sequential_colormap": "magma",
    "log_scales": {"hks": True, "band": False},
    "hide_small": True,
    "cut": {"shown": True, "normal": [0.0, 0.6, 0.8], "offset": -0.25},
    "fields": {
        "eigenfunction": {"index": 7, "flipped": [3, 5]},
        "hks": {"time": 1.5e5, "automatic": False, "t_min": 1.0, "t_max": 2e5, "scales": 64},
        "band": {"index": 3, "count": 12, "automatic": False, "low": 0.0, "high": 1e-4},
        "similarity": {"vertex": 17, "basis": "band"},
    },
    "policies": {"hks": {"policy": "LockedLimits", "low": -2.0, "high": 3e-8}},
}
BY_MAP = {"map:lh.sulc: depth": LockedLimits(1.0, 4.5), "map:other": PercentileLimits(1.0, 90.0)}
PATH = Path("some") / "now.meshmash.json"


@pytest.mark.parametrize(
    "limits",
    [None, SymmetricLimits(), MinMaxLimits(), PercentileLimits(5, 95), LockedLimits(-2.0, 3e-8)],
)
def test_comes_back(limits: LimitPolicy | None) -> None:
    before = Display(
        kind="similarity",
        nodal_lines=True,
        label_borders=True,
        label_graph=True,
        diverging_colormap="PuOr_r",
        sequential_colormap="magma",
        log_scales={"hks": True, "band": False},
        hide_small=True,
        cut=Cut(True, (0.0, 0.6, 0.8), -0.25),
        policies={} if limits is None else {"hks": limits, **BY_MAP},
    )
    before.put(
        Eigenfunctions(7, frozenset({3, 5})),
        HeatKernelSignature(1.5e5, automatic=False, t_min=1.0, t_max=2e5, scales=64),
        GeometryVectors(3, 12, automatic=False, low=0.0, high=1e-4),
        Similarity(17, "band"),
    )
    content = json.loads(json.dumps(display_to_json(before)))
    after = Display()
    display_from_json(after, read_display(content, PATH))
    assert after == before


@pytest.mark.parametrize(
    "part", [{"t_min": None, "t_max": 2.0}, {"t_min": 2.0, "t_max": None}, {"scales": 1024}, {}]
)
def test_an_end_that_is_not_said_is_in_order(part: dict[str, object]) -> None:
    taken = read_display(CONTENT | {"fields": {"hks": part}}, PATH)
    for name, value in part.items():
        assert taken["fields"]["hks"][name] == value


def entries(content: dict[str, object], *within: str) -> Iterator[tuple[str, ...]]:
    """Return the path of each entry, and of those within it."""
    for name, value in content.items():
        yield (*within, name)
        if isinstance(value, dict):
            yield from entries(value, *within, name)


def changed(content: dict[str, object], path: tuple[str, ...], value: object) -> dict[str, object]:
    first, *rest = path
    inner = changed(content.get(first) or {}, tuple(rest), value) if rest else value
    return content | {first: inner}


def test_an_entry_of_another_type_is_named() -> None:
    content = display_to_json(Display(cut=Cut()))
    content = json.loads(json.dumps(content | {"policies": CONTENT["policies"]}))
    found = list(entries(content))
    assert len(found) > 50
    for path in found:
        for wrong in ([{"another": 1}], 10**400):
            with raises("invalid-entry", ".".join(("display", *path))):
                read_display(changed(content, path, wrong), PATH)


@pytest.mark.parametrize(
    ("path", "value", "clause"),
    [
        ("kind", "x", "display.kind (Invalid enum value 'x')"),
        ("policies.hks", {"low": 1.0, "high": 2.0}, "missing required field `policy`"),
        ("policies.hks", {"policy": "LockedLimits"}, "missing required field `low`"),
        ("policies.hks.high", -3.0, "hks.low (-2 is not below -3)"),
        ("policies.hks", {"policy": "PercentileLimits", "low": 1, "high": 101}, ".high ("),
        ("cut.normal", [1.0, 0.0], "normal (Expected `array` of length 3, got 2)"),
        ("fields.eigenfunction.index", -1, "index (Expected `int` >= 0)"),
        ("fields.eigenfunction.flipped", [1, "x"], "flipped[1]"),
        ("fields.hks.scales", 10**9, "scales (Expected `int` <= 1024)"),
        ("fields.hks.time", float("inf"), "time (Expected `float` <= "),
        ("fields.hks.t_min", 3e5, "t_min (300000 is not below 200000)"),
        ("fields.similarity.vertex", 0.5, "vertex (Expected `int | null`, got `float`)"),
    ],
)
def test_a_value_out_of_range_is_named(path: str, value: object, clause: str) -> None:
    with raises("invalid-entry", f"display.{path.rpartition('.')[0]}", clause):
        read_display(changed(CONTENT, tuple(path.split(".")), value), PATH)


def test_one_scale_is_enough() -> None:
    display = Display()
    display_from_json(display, read_display({"fields": {"hks": {"scales": 1}}}, PATH))
    assert display[HeatKernelSignature].scales == 1


def test_a_vertex_that_the_mesh_has_not_is_left_out() -> None:
    content, display = read_display(CONTENT, PATH), Display()
    assert display_from_json(display, content, {17: 4}.get) == []
    assert display[Similarity].vertex == 4
    assert display_from_json(display, content, {16: 4}.get) == [("fields.similarity.vertex", 17)]
    assert display[Similarity].vertex is None


def test_vertices_are_written_by_the_index_that_is_asked_for() -> None:
    display = Display()
    display.change(Similarity, vertex=17)
    content = display_to_json(display, {17: 2100}.__getitem__)
    assert content["fields"]["similarity"]["vertex"] == 2100
    assert content["fields"]["distance"]["vertex"] is None
    assert display_to_json(display)["fields"]["similarity"]["vertex"] == 17


def test_entries_of_later_programs_are_passed_over() -> None:
    assert read_display({"novelty": 1, "playing": True}, PATH) == {}

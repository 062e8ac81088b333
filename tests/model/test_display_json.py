"""The display in a session: written, restored, and refused if invalid."""

from __future__ import annotations

import json
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


@pytest.mark.parametrize(
    ("entry", "value", "clause"),
    [
        ("kind", "x", "display.kind (Invalid enum value 'x')"),
        ("kind", ["hks"], "display.kind"),
        ("nodal_lines", None, "display.nodal_lines"),
        ("sequential_colormap", "nonsense", "display.sequential_colormap (Invalid enum"),
        ("diverging_colormap", None, "display.diverging_colormap"),
        ("log_scales", {"hks": "yes"}, "display.log_scales.hks"),
        ("policies", {"hks": {"policy": "Nobody"}}, "display.policies.hks.policy"),
        (
            "policies",
            {"hks": {"low": 1.0, "high": 2.0}},
            "missing required field `policy`",
        ),
        (
            "policies",
            {"hks": {"policy": "LockedLimits"}},
            "missing required field `low`",
        ),
        (
            "policies",
            {"hks": {"policy": "LockedLimits", "low": 2, "high": 1}},
            "hks.low (2 is not below 1)",
        ),
        (
            "policies",
            {"hks": {"policy": "LockedLimits", "low": "a", "high": 1}},
            "hks.low (Expected",
        ),
        (
            "policies",
            {"hks": {"policy": "PercentileLimits", "low": 1, "high": 101}},
            ".high (",
        ),
        ("policies", {"hks": 3}, "display.policies.hks (Expected `object`, got `int`)"),
        ("policies", 3, "display.policies (Expected `object`, got `int`)"),
        ("cut", {"normal": [1.0, 0.0]}, "display.cut.normal (Expected `array` of length 3, got 2)"),
    ],
)
def test_every_bad_entry_is_named(entry: str, value: object, clause: str) -> None:
    content = CONTENT | {entry: value}
    with raises("invalid-entry", clause):
        read_display(content, PATH)


@pytest.mark.parametrize(
    ("family", "entry", "value", "clause"),
    [
        ("eigenfunction", "index", "x", "index (Expected `int`, got `str`)"),
        ("eigenfunction", "index", -1, "display.fields.eigenfunction.index (Expected `int` >= 0)"),
        ("eigenfunction", "index", 2**31, "display.fields.eigenfunction.index"),
        ("eigenfunction", "flipped", [1, "x"], "display.fields.eigenfunction.flipped[1]"),
        ("hks", "scales", 0, "display.fields.hks.scales (Expected `int` >= 1)"),
        ("hks", "scales", 10**9, "display.fields.hks.scales (Expected `int` <= 1024)"),
        ("hks", "time", "abc", "hks.time (Expected `float | null`, got `str`)"),
        ("hks", "time", -1, "display.fields.hks.time (Expected `float` >= "),
        ("hks", "time", float("inf"), "display.fields.hks.time (Expected `float` <= "),
        ("hks", "automatic", 1, "hks.automatic (Expected `bool`, got `int`)"),
        ("hks", "t_min", 3e5, "display.fields.hks.t_min (300000 is not below 200000)"),
        ("band", "index", 512, "display.fields.band.index (Expected `int` <= 511)"),
        ("band", "low", -0.5, "display.fields.band.low"),
        ("band", "count", 10**7, "display.fields.band.count (Expected `int` <= 512)"),
        ("similarity", "vertex", "x", "display.fields.similarity.vertex"),
        ("similarity", "basis", None, "display.fields.similarity.basis"),
        ("similarity", "basis", "x", "display.fields.similarity.basis (Invalid enum value 'x')"),
        (
            "similarity",
            "vertex",
            0.5,
            "vertex (Expected `int | null`, got `float`)",
        ),
    ],
)
def test_every_bad_parameter_is_named(family: str, entry: str, value: object, clause: str) -> None:
    display = Display()
    display.put(HeatKernelSignature(t_min=1.0, t_max=2e5))
    content = display_to_json(display)
    content["fields"][family][entry] = value
    with raises("invalid-entry", clause):
        read_display(content, PATH)


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

"""The display in a session: written, restored, and refused if invalid."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshmash_viewer.errors import InputError
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
        ("kind", "x", 'display.kind = "x", which should be "eigenfunction" or'),
        ("kind", ["hks"], "display.kind"),
        ("nodal_lines", None, "display.nodal_lines"),
        ("sequential_colormap", "nonsense", "display.sequential_colormap = .*colour map"),
        ("diverging_colormap", None, "display.diverging_colormap"),
        ("log_scales", {"hks": "yes"}, "display.log_scales.hks"),
        ("policies", {"hks": {"policy": "Nobody"}}, "display.policies.hks.policy"),
        ("policies", {"hks": {"low": 1.0, "high": 2.0}}, "display.policies.hks = .* with policy"),
        ("policies", {"hks": {"policy": "LockedLimits"}}, "display.policies.hks = .* with low"),
        ("policies", {"hks": {"policy": "LockedLimits", "low": 2, "high": 1}}, "low below high"),
        ("policies", {"hks": {"policy": "LockedLimits", "low": "a", "high": 1}}, "hks.low"),
        ("policies", {"hks": {"policy": "PercentileLimits", "low": 1, "high": 101}}, "0 to 100"),
        ("policies", {"hks": 3}, "display.policies.hks = 3"),
        ("policies", 3, "display.policies = 3"),
        ("cut", {"normal": [1.0, 0.0]}, "display.cut.normal = .* 3 values"),
    ],
)
def test_every_bad_entry_is_named(entry: str, value: object, clause: str) -> None:
    content = CONTENT | {entry: value}
    with pytest.raises(InputError, match=clause) as told:
        read_display(content, PATH)
    assert str(told.value).startswith("now.meshmash.json has display")


@pytest.mark.parametrize(
    ("family", "entry", "value", "clause"),
    [
        ("eigenfunction", "index", "x", 'index = "x", which should be a whole number'),
        ("eigenfunction", "index", -1, "display.fields.eigenfunction.index = -1"),
        ("eigenfunction", "index", 2**31, "display.fields.eigenfunction.index"),
        ("eigenfunction", "flipped", [1, "x"], r"display.fields.eigenfunction.flipped\[1\]"),
        ("hks", "scales", 0, "display.fields.hks.scales = 0, .* from 1 to 1024"),
        ("hks", "scales", 10**9, "display.fields.hks.scales = 1000000000, .* from 1 to 1024"),
        ("hks", "time", "abc", 'hks.time = "abc", which should be null or a number'),
        ("hks", "time", -1, "display.fields.hks.time = -1"),
        ("hks", "time", float("inf"), "display.fields.hks.time = Infinity"),
        ("hks", "automatic", 1, "hks.automatic = 1, which should be true or false"),
        ("hks", "t_min", 3e5, "t_min below t_max"),
        ("band", "index", 512, "display.fields.band.index = 512"),
        ("band", "low", -0.5, "display.fields.band.low"),
        ("band", "count", 10**7, "display.fields.band.count = .* from 1 to 512"),
        ("similarity", "vertex", "x", "display.fields.similarity.vertex"),
        ("similarity", "basis", None, "display.fields.similarity.basis"),
        ("similarity", "basis", "x", 'display.fields.similarity.basis = "x"'),
        ("similarity", "vertex", 0.5, "display.fields.similarity.vertex = 0.5"),
    ],
)
def test_every_bad_parameter_is_named(family: str, entry: str, value: object, clause: str) -> None:
    display = Display()
    display.put(HeatKernelSignature(t_min=1.0, t_max=2e5))
    content = display_to_json(display)
    content["fields"][family][entry] = value
    with pytest.raises(InputError, match=clause):
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

"""What is looked at goes into a session and comes back; nothing else gets in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.display_json import (
    display_from_json,
    display_to_json,
    drop_vertices,
    read_display,
)
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

#: What a display was in the first version of sessions.
VERSION_1 = {
    "kind": "band",
    "index": 7,
    "flipped": [3, 5],
    "time": 1.5e5,
    "hks_automatic": False,
    "hks_t_min": 1.0,
    "hks_t_max": 2e5,
    "hks_scales": 64,
    "band": 3,
    "band_count": 12,
    "band_automatic": False,
    "band_min": 0.0,
    "band_max": 1e-4,
    "similarity_vertex": 17,
    "similarity_basis": "bands",
    "nodal_lines": True,
    "diverging_colormap": "PuOr_r",
    "sequential_colormap": "magma",
    "limits": {"policy": "LockedLimits", "low": -2.0, "high": 3e-8},
}
PATH = Path("some") / "now.meshmash.json"


@pytest.mark.parametrize(
    "limits",
    [None, SymmetricLimits(), MinMaxLimits(), PercentileLimits(5, 95), LockedLimits(-2.0, 3e-8)],
)
def test_comes_back(limits: LimitPolicy | None) -> None:
    before = Display(
        kind="similarity",
        nodal_lines=True,
        diverging_colormap="PuOr_r",
        sequential_colormap="magma",
        policies={} if limits is None else {"hks": limits},
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
    ("entry", "value", "clause"),
    [
        ("kind", "x", 'display.kind = "x", which should be "eigenfunction" or'),
        ("kind", ["hks"], "display.kind"),
        ("index", "x", 'display.index = "x", which should be a whole number'),
        ("index", -1, "display.index = -1"),
        ("index", 2**31, "display.index"),
        ("flipped", [1, "x"], r"display.flipped\[1\]"),
        ("time", "abc", 'display.time = "abc", which should be null or a number'),
        ("time", -1, "display.time = -1"),
        ("time", float("inf"), "display.time = Infinity"),
        ("hks_automatic", 1, "display.hks_automatic = 1, which should be true or false"),
        ("hks_scales", 10**9, "display.hks_scales = 1000000000, .* from 1 to 1024"),
        ("hks_scales", 0, "display.hks_scales = 0"),
        ("band_count", 10**7, "display.band_count = 10000000, .* from 1 to 512"),
        ("band", 512, "display.band = 512"),
        ("band_min", -0.5, "display.band_min"),
        ("similarity_vertex", "x", "display.similarity_vertex"),
        ("similarity_basis", None, "display.similarity_basis"),
        ("nodal_lines", None, "display.nodal_lines"),
        ("sequential_colormap", "nonsense", "display.sequential_colormap = .*colour map"),
        ("diverging_colormap", None, "display.diverging_colormap"),
        ("limits", {"policy": "Nobody"}, "display.limits.policy"),
        ("limits", {"low": 1.0, "high": 2.0}, "display.limits = .* with policy"),
        ("limits", {"policy": "LockedLimits"}, "display.limits = .* with low"),
        ("limits", {"policy": "LockedLimits", "low": 2, "high": 1}, "with low below high"),
        ("limits", {"policy": "LockedLimits", "low": "a", "high": 1}, "display.limits.low"),
        ("limits", {"policy": "PercentileLimits", "low": 1, "high": 101}, "from 0 to 100"),
        ("limits", 3, "display.limits = 3"),
    ],
)
def test_every_bad_entry_is_named(entry: str, value: object, clause: str) -> None:
    content = VERSION_1 | {entry: value}
    with pytest.raises(InputError, match=clause) as told:
        read_display(content, PATH)
    assert str(told.value).startswith("now.meshmash.json has display")


@pytest.mark.parametrize(
    ("family", "entry", "value", "clause"),
    [
        ("eigenfunction", "index", -1, "display.fields.eigenfunction.index = -1"),
        ("eigenfunction", "flipped", [1, "x"], r"display.fields.eigenfunction.flipped\[1\]"),
        ("hks", "scales", 0, "display.fields.hks.scales = 0, .* from 1 to 1024"),
        ("hks", "t_min", 3e5, "t_min below t_max"),
        ("band", "count", 10**7, "display.fields.band.count = .* from 1 to 512"),
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


def test_sessions_of_version_1_are_read() -> None:
    display = Display()
    display_from_json(display, read_display(VERSION_1, PATH))
    assert display[Eigenfunctions] == Eigenfunctions(7, frozenset({3, 5}))
    assert display[HeatKernelSignature] == HeatKernelSignature(1.5e5, False, 1.0, 2e5, 64)
    assert display[GeometryVectors] == GeometryVectors(3, 12, False, 0.0, 1e-4)
    assert display[Similarity] == Similarity(17, "band")
    assert (display.kind, display.nodal_lines) == ("band", True)
    assert display.limits == LockedLimits(-2.0, 3e-8)


def test_one_scale_is_enough() -> None:
    display = Display()
    display_from_json(display, read_display(VERSION_1 | {"hks_scales": 1}, PATH))
    assert display[HeatKernelSignature].scales == 1


def test_a_vertex_that_the_mesh_has_not_is_left_out() -> None:
    content = read_display(VERSION_1, PATH)
    assert list(drop_vertices(content, 18)) == []
    assert list(drop_vertices(content, 17)) == [("fields.similarity.vertex", 17)]
    display = Display()
    display_from_json(display, content)
    assert display[Similarity].vertex is None


@pytest.mark.parametrize(("low", "high"), [("hks_t_min", "hks_t_max"), ("band_min", "band_max")])
def test_ranges_are_in_order(low: str, high: str) -> None:
    content = VERSION_1 | {low: 2.0, high: 1.0}
    with pytest.raises(InputError, match=f"{low} below {high}"):
        read_display(content, PATH)


def test_entries_of_later_programs_are_passed_over() -> None:
    assert read_display({"novelty": 1, "playing": True}, PATH) == {}

"""What is looked at goes into a session and comes back; nothing else gets in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.model.display import Display, FieldKind, SimilarityBasis
from meshmash_viewer.model.display_json import display_from_json, display_to_json, read_display
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

PATH = Path("some") / "now.meshmash.json"


@pytest.mark.parametrize(
    "limits",
    [None, SymmetricLimits(), MinMaxLimits(), PercentileLimits(5, 95), LockedLimits(-2.0, 3e-8)],
)
def test_comes_back(limits: LimitPolicy | None) -> None:
    before = Display(
        kind=FieldKind.SIMILARITY,
        index=7,
        flipped=frozenset({3, 5}),
        time=1.5e5,
        hks_automatic=False,
        hks_t_min=1.0,
        hks_t_max=2e5,
        hks_scales=64,
        band=3,
        band_count=12,
        band_automatic=False,
        band_min=0.0,
        band_max=1e-4,
        similarity_vertex=17,
        similarity_basis=SimilarityBasis.BANDS,
        nodal_lines=True,
        diverging_colormap="PuOr_r",
        sequential_colormap="magma",
        limits=limits,
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
        ("limits", {"policy": "LockedLimits"}, "display.limits = .* with low"),
        ("limits", {"policy": "LockedLimits", "low": 2, "high": 1}, "with low below high"),
        ("limits", {"policy": "LockedLimits", "low": "a", "high": 1}, "display.limits.low"),
        ("limits", {"policy": "PercentileLimits", "low": 1, "high": 101}, "from 0 to 100"),
        ("limits", 3, "display.limits = 3"),
    ],
)
def test_every_bad_entry_is_named(entry: str, value: object, clause: str) -> None:
    content = display_to_json(Display()) | {entry: value}
    with pytest.raises(InputError, match=clause) as told:
        read_display(content, PATH)
    assert str(told.value).startswith("now.meshmash.json has display")


@pytest.mark.parametrize(("low", "high"), [("hks_t_min", "hks_t_max"), ("band_min", "band_max")])
def test_ranges_are_in_order(low: str, high: str) -> None:
    content = display_to_json(Display()) | {low: 2.0, high: 1.0}
    with pytest.raises(InputError, match=f"{low} below {high}"):
        read_display(content, PATH)


def test_entries_of_later_programs_are_passed_over() -> None:
    assert read_display({"novelty": 1, "playing": True}, PATH) == {}

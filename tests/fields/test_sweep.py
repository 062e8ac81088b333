from __future__ import annotations

import pytest
import shapes
from closed_form import A, B, rectangle_spectrum
from faults import raises

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.table import SWEPT, chosen_columns, evenly, n_columns, sweep
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@pytest.fixture(scope="module")
def spectrum() -> Eigenpairs:
    return rectangle_spectrum(shapes.rectangle(12, 30, A, B), 37)


def resolved(name: str, spectrum: Eigenpairs, count: int = 11) -> Family:
    chosen = {each: family() for each, family in FAMILIES.items()}
    # maps have one column each unless summed over pairs; distances have one for each vertex
    given = {
        "map": {"view": "pairs"},
        "distance": {"vertices": list(range(37)), "measure": "biharmonic"},
    }.get(name, {})
    counted = count if FAMILIES[name].counted else None
    return FAMILIES[name].exported(counted, **given).resolved(spectrum, chosen)


@pytest.mark.parametrize("name", SWEPT)
def test_columns_are_all_that_there_are_and_each_is_another(
    name: str, spectrum: Eigenpairs
) -> None:
    family = resolved(name, spectrum)
    most = n_columns(family, spectrum)
    assert most == (11 if family.counted else 37)
    found = sweep(family, spectrum, range(most))
    assert len(set(found)) == most
    assert len({each.describe(spectrum, "nm").quantity for each in found}) == most
    places = [each.place(spectrum) for each in found]
    assert places == sorted(places) or places == sorted(places, reverse=True)
    some = sweep(family, spectrum, range(2, 9, 3))
    assert some == [found[2], found[5], found[8]]
    # continuous parameters allow any number of frames, others at most one for each column
    ends = sweep(family, spectrum, range(2, 9), 3)
    assert [each.place(spectrum) for each in ends] == pytest.approx(
        [places[2], places[5], places[8]]
    )


@pytest.mark.parametrize("name", sorted(set(FAMILIES) - set(SWEPT)))
def test_what_nobody_has_chosen_has_one_column(name: str, spectrum: Eigenpairs) -> None:
    assert n_columns(FAMILIES[name](), spectrum) == 1


def test_only_a_film_has_more_frames_than_columns(spectrum: Eigenpairs) -> None:
    times = sweep(resolved("hks", spectrum), spectrum, range(11), 50)
    assert len({each.place(spectrum) for each in times}) == 50
    with raises("too-many", "50 frames are more than the 11 columns"):
        sweep(resolved("eigenfunction", spectrum), spectrum, range(11), 50)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("0:32:4", range(0, 32, 4)),
        ("1:6", range(1, 6)),
        (":", range(40)),
        ("30:", range(30, 40)),
        ("::9", range(0, 40, 9)),
        ("7", range(7, 8)),
    ],
)
def test_columns_are_written_as_in_python(text: str, columns: range) -> None:
    assert list(chosen_columns(text, 40)) == list(
        range(40)[columns.start : columns.stop : columns.step]
    )


@pytest.mark.parametrize(
    "text", ["", "a:b", "1:2:3:4", "5:5", "9:3", "-3:4", "0:9:0", "0:41", "40"]
)
def test_columns_that_there_are_not_are_said(text: str) -> None:
    with raises("out-of-range", "column"):
        chosen_columns(text, 40)


def test_some_are_spread_over_all() -> None:
    assert list(evenly(7, 24)) == list(range(7))
    found = evenly(200, 24)
    assert len(found) <= 24 < 2 * len(found)
    assert found[-1] >= 200 - found.step

from __future__ import annotations

import math

import pytest
from faults import raises

from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.units import (
    LENGTH_UNITS,
    NO_BREAK,
    NO_VOXEL,
    Voxel,
    counted,
    format_lengths,
    format_number,
    format_quantity,
    format_range,
    format_share,
    grouped,
    plain_text,
    power_text,
    whole_number,
    written_unit,
)


@pytest.mark.parametrize(
    ("text", "voxel", "unit", "written"),
    [
        (" none ", NO_VOXEL, "", "none"),
        ("", NO_VOXEL, "", "none"),
        ("microns", NO_VOXEL, "µm", "µm"),
        ("cm", (10.0, 10.0, 10.0), "mm", "10 mm"),
        ("2 Å", (0.2, 0.2, 0.2), "nm", "0.2 nm"),
        ("8,5 x 8.5 x 8,5 nm", (8.5, 8.5, 8.5), "nm", "8.5 nm"),
        ("1 nm", NO_VOXEL, "nm", "nm"),
        ("4nm 4nm 40nm", (4.0, 4.0, 40.0), "nm", "4 × 4 × 40 nm"),
    ],
)
def test_a_unit_is_read_and_written(text: str, voxel: Voxel, unit: str, written: str) -> None:
    assert parse_unit(text) == (voxel, unit)
    assert written_unit(unit, voxel) == written
    assert parse_unit(written) == (voxel, unit)


@pytest.mark.parametrize(
    "text",
    [
        "furlong", "8", "0 nm", "-8 nm", "1e999 nm", "8 8 nm", "4 x 4 x 0 nm", "4 x 4 x nm",
        "8 nm!", "4,4,40 nm", (4, 4, 40),
    ],
)  # fmt: skip
def test_what_is_no_unit_is_refused_with_what_is(text: object) -> None:
    with raises("wrong-unit", repr(text), *LENGTH_UNITS, "4 x 4 x 40 nm"):
        parse_unit(text)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (64_005.0, 2, "64000"),
        (64_005.0, 5, "64005"),
        (999_999.0, 4, "1×10⁶"),
        (1_000_000.0, 4, "1×10⁶"),
        (-64_005.0, 3, "−64000"),
        (-1.2345e-8, 3, "−1.23×10⁻⁸"),
        (12.0, 4, "12"),
        (math.inf, 4, "inf"),
    ],
)
def test_numbers_are_written_out_where_that_is_short(value: float, digits: int, text: str) -> None:
    assert format_number(value, digits) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(64_005.0, "64,000"), (-640_050.0, "−640,000"), (6400.0, "6400"), (0.0029712, "0.00297")],
)
def test_numbers_of_tables_have_separators(value: float, text: str) -> None:
    assert grouped(value, 3) == text


@pytest.mark.parametrize(
    ("value", "unit", "power", "text"),
    [
        (40_370.0, "nm", 1, "40.4 µm"),
        (-40_370.0, "nm", 1, "−40.4 µm"),
        (500.0, "nm", 1, "500 nm"),
        (0.5, "µm", 1, "0.5 µm"),
        (0.05, "mm", 1, "50 µm"),
        (0.0, "nm", 1, "0 nm"),
        (1.2e-8, "nm", -2, "0.012 µm⁻²"),
        (1e-4, "mm", -2, "0.0001 mm⁻²"),
        (3.47e7, "nm", 2, "34.7 µm²"),
        (98_120.0, "mm", 2, "98100 mm²"),
        (3e-5, "nm", -1, "30 mm⁻¹"),
        (0.05, "mm", -1, "0.05 mm⁻¹"),
        (1e-9, "nm", -1, "0.001 mm⁻¹"),
        (50.0, "m", -1, "50 m⁻¹"),
        (5_000.0, "m", -1, "5 mm⁻¹"),
        (1e-7, "", 2, "1×10⁻⁷"),
        (12_000.0, "mV", 1, "12000 mV"),
        (math.nan, "nm", 1, "nan nm"),
    ],
)
def test_a_quantity_is_written_in_a_unit_of_its_size(
    value: float, unit: str, power: int, text: str
) -> None:
    written = format_quantity(value, unit, power)
    assert written == text.replace(" ", NO_BREAK), "no line is broken before a unit"
    assert plain_text(written) == text.replace("−", "-")


def test_numbers_of_a_range_share_the_unit_of_the_larger_one() -> None:
    assert plain_text(format_range(2.0, 40_370.0, "nm", word="to")) == "0.002 to 40.4 µm"
    assert plain_text(format_quantity(2.0, "nm", like=40_370.0)) == "0.002 µm"
    assert plain_text(format_share(0.8191)) == "81.9 %"


@pytest.mark.parametrize(
    ("number", "noun", "text"),
    [
        (1, "pair", "1 pair"),
        (0, "pair", "0 pairs"),
        (22_351, "vertex", "22,351 vertices"),
        (1, "vertex", "1 vertex"),
    ],
)
def test_one_of_something_is_not_many(number: int, noun: str, text: str) -> None:
    assert counted(number, noun) == text


@pytest.mark.parametrize("count", [0, -1, 1.5, math.nan, math.inf])
def test_a_count_is_a_whole_number_from_one(count: float) -> None:
    assert whole_number(3.0, "n_components") == 3
    with raises("out-of-range", "n_components is", ": give a whole number from 1"):
        whole_number(count, "n_components")


def test_powers_of_ten_are_written_out_near_one() -> None:
    assert power_text(-8) == "10⁻⁸"
    assert power_text(5, 2) == "2×10⁵"
    assert power_text(-1, 5) == "0.5"
    assert power_text(0) == "1"


@pytest.mark.parametrize(
    ("lengths", "unit", "text"),
    [
        ((150_000.0, 20_000.0, 900.0), "nm", "150 × 20 × 0.9\N{NO-BREAK SPACE}µm"),
        ((150_000.0, 20_000.0, 900.0), "", "150000 × 20000 × 900"),
        ((1.92e7, 2.65e7, 1.8e6), "", "(1.92 × 2.65 × 0.18)×10⁷"),
        ((0.0, 0.0, 0.0), "mm", "0 × 0 × 0\N{NO-BREAK SPACE}mm"),
    ],
)
def test_lengths_have_one_unit(lengths: tuple[float, ...], unit: str, text: str) -> None:
    assert format_lengths(lengths, unit) == text

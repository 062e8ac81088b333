"""Numbers with either decimal sign, groups and a unit, never read as a different number."""

from __future__ import annotations

import math

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_several, parse_whole
from meshmash_viewer.units import format_quantity, power_unit


@pytest.mark.parametrize(
    ("texts", "number"),
    [
        ("7|+7|7.|07|7,0", 7.0),
        ("0.5|.5|0,5|,5|5e-1|5E-1|5e\u22121|50×10^-2|5×10⁻¹", 0.5),
        ("1e-5|1×10^-5|1 x 10^-5|10⁻⁵|10^-5|0,00001", 1e-5),
        ("1 234 567|1\u202f234\u2009567|1,234,567|1234567", 1234567.0),
        ("1,234.5|1 234.5|1 234,5|1234,5|≈ 1234.5", 1234.5),
        ("-18.800|\u221218,8|\u201318.8", -18.8),
    ],
)
def test_ways_to_write_one_number(texts: str, number: float) -> None:
    assert {text: parse_number(text) for text in texts.split("|")} == dict.fromkeys(
        texts.split("|"), number
    )


@pytest.mark.parametrize("text", ["1,000", "-1,234", "1,500e3", "18,800 nm"])
def test_text_that_may_be_two_numbers_is_refused_with_both(text: str) -> None:
    with pytest.raises(InputError) as fault:
        parse_number(text, "nm")
    digits = text.split(" ")[0].split("e")[0]
    assert digits.replace(",", "") in str(fault.value)
    assert str(float(digits.replace(",", "."))) in str(fault.value)


@pytest.mark.parametrize(
    "text",
    [
        "", "abc", "nan", "inf", "-", ",", "1 00", "12 34", "1,23,4", "1.2.3", "1.234,5", "1--2",
        "1.234.567", "1'234", "1_000", "0x10", "1/2", "1e", "e5", "2^3", "1×10-5", "½", "1\n2",
        "5 %", "(5)", "4 x 4 x 40 nm", "1" * 200, "1,234 567.8",
    ],
)  # fmt: skip
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is not a number|unit that is not known"):
        parse_number(text)


@pytest.mark.parametrize("text", ["1e999", "-1e309", "1e-400", "10^99999", "1e" + "9" * 60])
def test_a_number_beyond_the_range_of_floats_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="too large or too small"):
        parse_number(text)


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("0.5 µm", "nm", 500.0),
        ("0.5 μm", "nm", 500.0),
        ("4.35um", "nm", 4350.0),
        ("500 nm", "µm", 0.5),
        ("5 Å", "nm", 0.5),
        ("3 cm", "mm", 30.0),
        ("1 234,5 nm", "nm", 1234.5),
        *((f"20 {unit}", "nm²", 2e7) for unit in ("µm²", "um^2", "um2")),
        *((f"2{unit}", "nm⁻²", 2e-6) for unit in (" µm⁻²", " µm^-2", " um-2", "/µm²", " / µm^2")),
        ("5 mV", "mV", 5.0),
    ],
)
def test_a_unit_is_converted(text: str, unit: str, number: float) -> None:
    assert parse_number(text, unit) == number


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("20 µm", "nm²"),
        ("1/µm", "nm⁻²"),
        ("5 s", "nm"),
        ("1 um", ""),
        ("1 um", "mV"),
        ("5 V", "mV"),
    ],
)
def test_another_unit_is_refused(text: str, unit: str) -> None:
    with pytest.raises(InputError):
        parse_number(text, unit)


@pytest.mark.parametrize("unit", ["", "nm", "m"])
@pytest.mark.parametrize("power", [-2, 1, 4])
@pytest.mark.parametrize("number", [0.0, -3.25, 64_005.0, 1.25e-8, 2.5e21])
def test_output_is_read_back(number: float, unit: str, power: int) -> None:
    assert parse_number(format_quantity(number, unit, power, 9), power_unit(unit, power)) == number


def test_a_share_may_be_in_percent() -> None:
    assert parse_number("0.1 %", share=True) == parse_number("1e-3", share=True) == 0.001


@pytest.mark.parametrize(
    ("text", "number"), [("2929", 2929), ("1,234", 1234), ("1 234", 1234), ("1e3", 1000), ("-0", 0)]
)
def test_a_whole_number(text: str, number: int) -> None:
    assert parse_whole(text, 0, 2929, "The index") == number


@pytest.mark.parametrize("text", ["2930", "-1", "12.5", "", "text", "1.234", "5 nm", "nan"])
def test_other_whole_numbers_are_refused_with_the_range(text: str) -> None:
    with pytest.raises(InputError, match="The index is a whole number from 0 to 2,929"):
        parse_whole(text, 0, 2929, "The index")


@pytest.mark.parametrize(
    "text", ["4 4 40", "4,4,40", "4, 4, 40", "4 x 4 × 40", "4;4;40", "4,0 4 40"]
)
def test_several_numbers(text: str) -> None:
    assert parse_several(text, 3, parse_number, "") == (4.0, 4.0, 40.0)
    found = parse_several(f"{text} µm", 3, parse_quantity, "")
    assert [each.in_unit("nm") for each in found] == [4000.0, 4000.0, 40000.0]


def test_a_unit_may_be_known_later() -> None:
    time = parse_quantity("20um^2", 2)
    assert (time.in_unit("nm"), time.in_unit("µm")) == (2e7, 20.0)
    assert parse_quantity("2e7", 2).in_unit("nm") == parse_quantity("2e7", 2).in_unit("") == 2e7
    assert math.isclose(parse_quantity("1/um^2", -2).in_unit("nm"), 1e-6, rel_tol=1e-15)
    with pytest.raises(InputError, match="the mesh has none"):
        time.in_unit("")

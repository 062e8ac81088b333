"""Numbers with either decimal sign, thin grouping and a unit, never read as a different number."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from faults import raises
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import (
    parse_number,
    parse_quantity,
    parse_several,
    parse_unit,
    parse_whole,
)
from meshmash_viewer.units import (
    LENGTH_UNITS,
    METRES,
    format_number,
    format_quantity,
    plain_number,
    power_unit,
)

stable = settings(derandomize=True, database=None, deadline=None)
NUMBERS = st.floats(-1e150, 1e150, allow_subnormal=False).filter(lambda x: not 0 < abs(x) < 1e-150)
SIGNS, THIN = st.sampled_from(".,"), st.sampled_from("\u2009\u202f")


@stable
@given(NUMBERS, SIGNS, THIN)
def test_what_is_written_is_read_back(number: float, sign: str, thin: str) -> None:
    rounded = float(f"{number:.9g}")
    for text in (
        plain_number(number, 9),
        format_number(number, 9),
        f"≈ {format_number(number, 9)}",
    ):
        if len(text.partition(".")[2].split("e")[0].split("×")[0]) != 3:
            text = text.replace(".", sign)  # three digits after a comma are ambiguous
        assert parse_number(text) == rounded
    whole = round(number % 10**12)
    assert parse_number(f"{whole:,}".replace(",", thin)) == whole
    assert parse_whole(f"{whole:,}", 0, 10**12, "") == parse_whole(f"{whole}", 0, 10**12, "")


@stable
@given(NUMBERS, st.sampled_from(LENGTH_UNITS), st.sampled_from([-4, -2, -1, 1, 2, 4]))
def test_a_quantity_is_read_back_in_any_unit(number: float, unit: str, power: int) -> None:
    written = power_unit(unit, power)
    found = parse_number(format_quantity(number, unit, power, 9), written)
    assert math.isclose(found, float(f"{number:.9g}"), rel_tol=1e-8)
    for name, exponent in METRES.items() if unit else ():
        length = parse_number(f"1{name}^{power}", written)
        assert math.isclose(length, 10.0 ** (power * (exponent - METRES[unit])), rel_tol=1e-15)
        assert parse_quantity(f"1 {name}{power}", power).in_unit(unit) == length


@stable
@given(st.integers(1, 999), st.integers(0, 999), st.sampled_from(["", "-", "+"]), NUMBERS)
def test_what_may_be_two_numbers_is_refused_with_both(
    high: int, low: int, sign: str, other: float
) -> None:
    text = f"{high},{low:03}"
    for written in (f"{sign}{text}", f"{sign}{text}e3", f"{sign}{text} nm"):
        with raises("ambiguous-number", f"{high}{low:03}", f"{float(f'{high}.{low:03}')}"):
            parse_number(written, "nm")
    with raises("ambiguous-number"):
        parse_unit(f"{text} nm")
    with raises("ambiguous-number"):
        parse_several(f"{other!r} {text}", 2, parse_number, "")
    with raises(
        "not-a-number", f"The index is a whole number from 0 to 999,999, not {high}.{low:03}"
    ):
        parse_whole(f"{high}.{low:03}", 0, 999_999, "The index")


def fault_of(parse: Callable[[str], object], text: str) -> str:
    try:
        parse(text)
    except InputError as fault:
        return str(fault)
    return ""


@stable
@given(st.text(max_size=50) | st.text("0123456789.,+-eEx^×⁻² \u2009nmµ%/", max_size=20))
def test_any_other_text_is_one_fault(text: str) -> None:
    for parse in (parse_number, parse_quantity, parse_unit, lambda text: parse_number(text, "nm")):
        assert len(fault_of(parse, text).splitlines()) < 2
    fault = fault_of(lambda text: parse_whole(text, 0, 2929, "The index"), text)
    assert fault == "" or fault.startswith("The index is a whole number from 0 to 2,929, not ")


@pytest.mark.parametrize(
    ("code", "texts"),
    [
        (
            "not-a-number",
            "|nan|-|,|1 00|12 34|1,23,4|1.234,5|1,234,567|1,234.5|1--2|1'234|½|(5)",
        ),
        ("out-of-range", "1e999|-1e309|1e-400"),
        ("wrong-unit", "20 µm²|1 µm^-1|5 s|5 V"),
    ],
)
def test_numbers_that_are_refused(code: str, texts: str) -> None:
    for text in texts.split("|"):
        with pytest.raises(InputError) as fault:
            parse_number(text, "nm")
        assert fault.value.code == code, text


def test_a_unit_needs_a_unit_and_a_share_may_be_in_percent() -> None:
    assert parse_number("0.1 %", share=True) == parse_number("1e-3", share=True) == 0.001
    assert parse_number("5 mV", "mV") == 5.0
    for unit in ("", "mV"):
        with raises("no-unit"):
            parse_number("1 um", unit)
    with raises("no-unit", "the mesh has none"):
        parse_quantity("20um^2", 2).in_unit("")


@pytest.mark.parametrize("text", ["4 4 40", "4, 4, 40", "4 x 4 × 40", "4;4;40", "4. 4,0 4×10^1"])
def test_several_numbers(text: str) -> None:
    assert parse_several(text, 3, parse_number, "") == (4.0, 4.0, 40.0)
    found = parse_several(f"{text} µm", 3, parse_quantity, "")
    assert [each.in_unit("nm") for each in found] == [4000.0, 4000.0, 40000.0]
    with raises("not-a-number", "is not 2 numbers", "4 40"):
        parse_several(text, 2, parse_number, "4 40")

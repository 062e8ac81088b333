"""Numbers in many notations, never read as a different number."""

from __future__ import annotations

import math

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_whole
from meshmash_viewer.units import format_quantity, power_unit

SPACES = (" ", "\u00a0", "\u202f", "\u2009", "\u2007")


@pytest.mark.parametrize(
    ("texts", "number"),
    [
        ("7 +7 7. 7.0 07 7,0", 7.0),
        ("0.5 .5 0,5 ,5 5e-1 5E-1 5e\u22121 50×10^-2 5×10⁻¹", 0.5),
        ("-5 \u22125 \u20135 -5,0", -5.0),
        ("1e-5 1×10^-5 1x10^-5 1*10**-5 1·10⁻⁵ 10⁻⁵ 10^-5 10^(-5) 0,00001", 1e-5),
        ("1_000 1'000 1’000 1e3 10^3 10³ 1000.0 1000,0", 1000.0),
        ("1,234,567 1.234.567 1'234'567 1_234_567 12,34,567", 1234567.0),
        ("1,234.5 1.234,5 1'234.5 1'234,5 1234,5 1_234.5", 1234.5),
        ("1.234,567 1,234.567", 1234.567),
        ("18.800 18,8", 18.8),
        ("0,001 0.001", 0.001),
        ("3.1e5 3,1E5 310000 310'000 ≈310000", 3.1e5),
        ("١٢٣ １２３", 123.0),
    ],
)
def test_ways_to_write_one_number(texts: str, number: float) -> None:
    assert {text: parse_number(text) for text in texts.split()} == dict.fromkeys(
        texts.split(), number
    )


@pytest.mark.parametrize("space", SPACES)
def test_groups_of_three_with_spaces_of_every_kind(space: str) -> None:
    assert parse_number(f"1{space}234{space}567") == 1234567.0
    assert parse_number(f"-1{space}234,5") == -1234.5
    assert parse_number(f"0.000{space}012{space}5") == 0.0000125
    assert parse_whole(f"12{space}345", 0, 99999, "It") == 12345


@pytest.mark.parametrize(
    ("text", "readings"),
    [
        ("1,000", ("1000", "1.0")),
        ("18,800", ("18800", "18.8")),
        ("-1,234", ("-1234", "-1.234")),
        ("1,500e3", ("1500e3", "1.5e3")),
        ("18,800 nm", ("18800", "18.8")),
    ],
)
def test_what_may_be_two_numbers_is_refused_with_both(text: str, readings: tuple[str, str]) -> None:
    with pytest.raises(InputError) as fault:
        parse_number(text, "nm")
    assert f"{text} may be {readings[0]} or {readings[1]}:" in str(fault.value)


@pytest.mark.parametrize(
    "text",
    [
        "", " ", "abc", "nan", "inf", "-", ",", ".", "1 00", "12 34", "1,23,4", "1.2.3", "1.23.456",
        "1,000.0,0", "1--2", "5,", "1.5.", "0x10", "1/2", "12:30", "1e", "e5", "2^3", "1×10-5",
        "1×10", "1 000'000", "1,234 567.8", "½", "--5", "1_00", "0 000", "\0", "1\n2", "5 %", "(5)",
        "4 x 4 x 40 nm", "1" * 200,
    ],
)  # fmt: skip
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is not a number: write 3\.1e5\.|unit that is not known"):
        parse_number(text)


@pytest.mark.parametrize("text", ["1e999", "-1e309", "1e-400", "10^99999", "1e" + "9" * 60])
def test_a_size_that_no_number_has_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="too large or too small"):
        parse_number(text)


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("0.5 µm", "nm", 500.0),
        ("0.5 μm", "nm", 500.0),
        ("1 um", "nm", 1000.0),
        ("4.35um", "nm", 4350.0),
        ("500 nm", "µm", 0.5),
        ("3 microns", "nm", 3000.0),
        ("5 Å", "nm", 0.5),
        ("3 cm", "mm", 30.0),
        ("1 m", "nm", 1e9),
        ("1,234.5 nm", "nm", 1234.5),
        ("1 234,5 nm", "nm", 1234.5),
        *((f"20 {unit}", "nm²", 2e7) for unit in ("µm²", "um^2", "um2", "um**2", "um^(2)")),
        ("2e7 nm^2", "nm²", 2e7),
        ("3.1e5 nm²", "nm²", 3.1e5),
        *(
            (f"2{unit}", "nm⁻²", 2e-6)
            for unit in (
                " µm⁻²", " µm^-2", " um-2", " um^(-2)", "/µm²", " / µm^2", " 1/µm²", " per µm²",
                "·µm⁻²",
            )
        ),
        ("1/µm²", "nm⁻²", 1e-6),
        ("21/µm²", "nm⁻²", 2.1e-5),
        ("5 mV", "mV", 5.0),
        ("5mV", "mV", 5.0),
        ("5 %", "%", 5.0),
    ],
)  # fmt: skip
def test_a_unit_is_converted_to_the_one_that_is_meant(text: str, unit: str, number: float) -> None:
    assert parse_number(text, unit) == number


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("20 µm", "nm²", "20 µm is a length: write it in µm²."),
        ("1 µm²", "nm", "1 µm² is an area: write it in µm."),
        ("1/µm", "nm⁻²", "1/µm is an inverse length: write it in µm⁻²."),
        ("5 nm^3", "nm²", "write it in nm²"),
        ("5 s", "nm", "5 s is in a unit that is not known: write the number alone."),
        ("5 M", "nm", "not known"),
        ("1 um", "", "1 um has a unit, and none is known here: write the number alone."),
        ("1 um", "mV", "1 um has a unit, and this is in mV: write the number alone."),
        ("5 V", "mV", "not known"),
        ("5 %", "nm", "5 % is not a number"),
    ],
)
def test_another_unit_is_never_taken_for_the_one_that_is_meant(
    text: str, unit: str, says: str
) -> None:
    with pytest.raises(InputError) as fault:
        parse_number(text, unit)
    assert says in str(fault.value)


@pytest.mark.parametrize("unit", ["", "nm", "µm", "mm", "m"])
@pytest.mark.parametrize("power", [-4, -2, -1, 1, 2, 4])
@pytest.mark.parametrize("number", [0.0, -3.25, 64_005.0, 1.25e-8, 2.5e21])
def test_what_is_written_is_read(number: float, unit: str, power: int) -> None:
    assert parse_number(format_quantity(number, unit, power, 9), power_unit(unit, power)) == number


def test_a_share_may_be_in_percent() -> None:
    assert parse_number("0.1 %", share=True) == 0.001
    assert parse_number("1e-5", share=True) == 1e-5


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0", 0), ("2929", 2929), ("1,234", 1234), ("1 234", 1234), ("1'234", 1234), ("1e3", 1000),
        ("50.0", 50), ("-0", 0), ("+7", 7), ("٣", 3),
    ],
)  # fmt: skip
def test_a_whole_number(text: str, number: int) -> None:
    assert parse_whole(text, 0, 2929, "The index") == number
    assert isinstance(parse_whole(text, 0, 2929, "The index"), int)


@pytest.mark.parametrize(
    "text",
    ["99999", "2930", "-1", "12.5", "1,5", "", " ", "text", "1.234", "5 nm", "5 %", "1e-1", "nan"],
)
def test_what_is_no_whole_number_in_range_is_refused_with_the_range(text: str) -> None:
    with pytest.raises(InputError) as fault:
        parse_whole(text, 0, 2929, "The index")
    assert str(fault.value).startswith("The index is a whole number from 0 to 2,929")
    assert (text.strip() or "empty") in str(fault.value)


def test_a_unit_may_be_known_later() -> None:
    time = parse_quantity("20um^2", 2)
    assert time.in_unit("nm") == 2e7
    assert time.in_unit("µm") == 20.0
    assert parse_quantity("2e7", 2).in_unit("nm") == parse_quantity("2e7", 2).in_unit("") == 2e7
    assert math.isclose(parse_quantity("1/um^2", -2).in_unit("nm"), 1e-6, rel_tol=1e-15)
    with pytest.raises(InputError, match=r"20um\^2 has a unit, and the mesh has none"):
        time.in_unit("")
    with pytest.raises(InputError, match="is a length"):
        parse_quantity("20 um", 2)

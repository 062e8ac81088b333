from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.app.view.style import bar_labels, exponent_text, scale_bar_text, ticks
from meshmash_viewer.units import NO_BREAK, round_length


@pytest.mark.parametrize(
    ("longest", "length"),
    [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.99, 2.0), (5.0, 5.0), (9.9, 5.0), (0.07, 0.05)],
)
@pytest.mark.parametrize("power", [-9, 0, 6])
def test_lengths_are_round(longest: float, length: float, power: int) -> None:
    assert round_length(longest * 10.0**power) == pytest.approx(length * 10.0**power)


@pytest.mark.parametrize(
    ("length", "unit", "text"),
    [
        (500.0, "nm", "500 nm"),
        (1000.0, "nm", "1 µm"),
        (20_000.0, "nm", "20 µm"),
        (2e6, "nm", "2 mm"),
        (0.02, "m", "20 mm"),
        (0.5, "m", "0.5 m"),
        (0.05, "mm", "50 µm"),
        (50.0, "mm", "50 mm"),
        (0.2, "", "0.2 units"),
        (1.0, "", "1 unit"),
        (1e-7, "", "1×10⁻⁷ units"),
    ],
)
def test_lengths_are_written_in_the_unit_of_their_size(length: float, unit: str, text: str) -> None:
    assert scale_bar_text(length, unit) == text.replace(" ", NO_BREAK)


def test_exponents() -> None:
    assert exponent_text(-5) == "×10⁻⁵"
    assert exponent_text(0) == ""


@pytest.mark.parametrize(
    ("low", "high"),
    [(-1.3e-5, 1.3e-5), (0.0, 1.0), (0.0, 7e8), (3e-9, 4e-9), (-250.0, 1e3), (1e-300, 3e-300)],
)
@pytest.mark.parametrize("most", [2, 4, 7])
def test_ticks_are_round_true_and_few(low: float, high: float, most: int) -> None:
    values, form, exponent = ticks(low, high, most)
    power, span = 10.0**exponent, high - low
    assert 1 <= len(values) <= most
    assert all(low - 1e-5 * span <= value * power <= high + 1e-5 * span for value in values)
    texts = [form % value for value in values]
    assert len(set(texts)) == len(texts)
    np.testing.assert_allclose([float(text) for text in texts], values, rtol=1e-6, atol=1e-6)


def test_zero_is_a_tick_of_a_symmetric_bar_and_decimals_agree() -> None:
    values, form, exponent = ticks(-1.3e-5, 1.3e-5, 6)
    assert exponent == -5
    assert [form % value for value in values] == ["-1.0", "-0.5", "0.0", "0.5", "1.0"]
    values, form, exponent = ticks(-0.4886, 0.4886, 4)
    assert [form % value for value in values] == ["-0.4", "0.0", "0.4"]
    values, form, exponent = ticks(0.0, 100.0, 6)
    assert exponent == 0
    assert [form % value for value in values] == ["0", "20", "40", "60", "80", "100"]


def test_a_narrow_range_far_from_zero_is_told_apart() -> None:
    values, form, _ = ticks(1.0 - 1e-7, 1.0 + 1e-7, 5)
    assert len({form % value for value in values}) == len(values)


def test_a_logarithmic_bar_has_decades_at_their_places() -> None:
    labels, heading = bar_labels(1e-9, 1e-5, "", logarithmic=True)
    assert heading == ""
    assert [label for _, label in labels] == ["10⁻⁹", "10⁻⁸", "10⁻⁷", "10⁻⁶", "10⁻⁵"]
    assert [share for share, _ in labels] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_a_bar_is_labelled_in_a_unit_of_the_size_of_its_values() -> None:
    labels, heading = bar_labels(-40_000.0, 40_000.0, "nm", most=3)
    assert heading == "µm"
    assert labels == [(0.0, "−40"), (0.5, "0"), (1.0, "40")]
    labels, heading = bar_labels(1e-8, 1e-4, "nm⁻²", logarithmic=True)
    assert heading == "µm⁻²"
    assert [text for _, text in labels] == ["0.01", "0.1", "1", "10", "100"]


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (0.15, 40.0, ["0.15", "1", "10", "40"]),
        (2e-6, 9e-6, ["2×10⁻⁶", "5×10⁻⁶", "9×10⁻⁶"]),
        (3.2, 3.3, ["3.20", "3.22", "3.24", "3.26", "3.28", "3.30"]),
    ],
)
def test_a_short_logarithmic_bar_has_multiples_too(
    low: float, high: float, texts: list[str]
) -> None:
    labels, _ = bar_labels(low, high, "", logarithmic=True)
    assert [text for _, text in labels] == texts
    assert all(0.0 <= share <= 1.0 for share, _ in labels)


@pytest.mark.parametrize(
    ("low", "high", "logarithmic", "texts"),
    [
        (-0.0173, 0.0173, False, ["−0.0173", "0.0173"]),  # zero is the only round value inside
        (0.0, 98.76, False, ["0", "98.8"]),
        (0.004, 10.0, False, ["0.0040", "10"]),
        (-1e-7, 10.0, False, ["0", "10"]),
        (1234.0, 5678.9, False, ["1234", "5679"]),
        (-2.345e-6, 1.2e-5, False, ["−0.23", "1.20"]),
        (1.0 - 1.2e-7, 1.0 + 1e-7, False, ["0.9999999", "1.0000001"]),
        (2.34e-8, 7.1e-4, True, ["2.3×10⁻⁸", "0.00071"]),
        (0.0123, 4567.0, True, ["0.0123", "4570"]),
        (3.213, 3.287, True, ["3.2130", "3.2870"]),
    ],
)
@pytest.mark.parametrize("most", [2, 7])
def test_both_ends_of_a_bar_are_labelled(
    low: float, high: float, logarithmic: bool, texts: list[str], most: int
) -> None:
    labels, _ = bar_labels(low, high, "", logarithmic, most, 0.2)
    shares = [share for share, _ in labels]
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert [labels[0][1], labels[-1][1]] == texts
    assert all(0.2 <= share <= 0.8 for share in shares[1:-1])

from __future__ import annotations

import pytest

from meshmash_viewer.app.controls.scale_marks import decade_marks, linear_texts, power_text


@pytest.mark.parametrize(
    ("values", "spacing", "texts"),
    [
        ([0.0, 1e-8, 2e-8], 1e-8, ["0", "1×10⁻⁸", "2×10⁻⁸"]),
        ([0.0, 5e-9, 1e-8], 5e-9, ["0", "0.5×10⁻⁸", "1.0×10⁻⁸"]),
        ([-1e-4, 0.0, 1e-4], 1e-4, ["−1×10⁻⁴", "0", "1×10⁻⁴"]),
        ([0.0, 50.0, 100.0], 50.0, ["0", "50", "100"]),
        ([0.0, 0.25, 0.5], 0.25, ["0", "0.25", "0.50"]),
        ([0.0, 2e6], 2e6, ["0", "2×10⁶"]),
        ([], 1.0, []),
    ],
)
def test_ticks_have_the_digits_that_tell_them_apart(values, spacing, texts) -> None:
    assert linear_texts(values, spacing) == texts


def test_powers() -> None:
    assert power_text(-8) == "10⁻⁸"
    assert power_text(5, 2) == "2×10⁵"
    assert power_text(-1, 5) == "0.5"
    assert power_text(0) == "1"


def test_marks_of_a_slider_lie_at_their_place_in_log_scale() -> None:
    marks = decade_marks(1e5, 1e8)
    assert [mark.text for mark in marks] == ["10⁵", "10⁶", "10⁷", "10⁸"]
    assert [mark.share for mark in marks] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert decade_marks(0.0, 1.0) == ()
    assert 3 <= len(decade_marks(1.1e5, 2.3e6)) <= 6
    assert len(decade_marks(1e-12, 1e20)) <= 9

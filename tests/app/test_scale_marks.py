from __future__ import annotations

import pytest

from meshmash_viewer.app.controls.scale_marks import decade_marks, power_text


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

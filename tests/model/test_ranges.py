from __future__ import annotations

import math

import numpy as np
import pytest

from meshmash_viewer.model.display import Display, FieldKind
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.ranges import (
    HKS_STEPS,
    MISSING_SHARE,
    band_range,
    first_nonzero,
    hks_range,
    hks_time,
    required_eigenvalue,
    resolved_time,
    show_end,
    step,
)
from meshmash_viewer.model.spectrum import Spectrum

EIGENVALUES = np.array([1e-18, 2e-17, 1.0, 2.0, 4.0, 5.0, 8.0]) * 1e-8


@pytest.fixture
def document() -> Document:
    document = Document()
    rows = np.zeros((len(EIGENVALUES), 3))
    document.accept_spectrum(Spectrum(EIGENVALUES, rows, np.zeros(len(EIGENVALUES)), complete=True))
    return document


def test_zeros_of_several_components_are_left_out() -> None:
    assert first_nonzero(EIGENVALUES) == 2
    assert first_nonzero(np.zeros(4)) == 4
    assert first_nonzero(np.empty(0)) == 0


def test_automatic_times_are_those_of_sun_2009() -> None:
    low, high = hks_range(Display(), EIGENVALUES)  # type: ignore[misc]
    assert low == pytest.approx(4 * math.log(10) / 8e-8)
    assert high == pytest.approx(4 * math.log(10) / 1e-8)
    assert hks_time(Display(), EIGENVALUES) == pytest.approx(math.sqrt(low * high))
    assert resolved_time(EIGENVALUES) < low  # type: ignore[operator]


def test_time_stays_in_a_range_by_hand() -> None:
    display = Display(hks_automatic=False, hks_t_min=10.0, hks_t_max=1000.0)
    assert hks_range(display, EIGENVALUES) == (10.0, 1000.0)
    assert hks_time(display, EIGENVALUES) == pytest.approx(100.0)
    display.time = 1e9
    assert hks_time(display, EIGENVALUES) == 1000.0


def test_a_range_that_is_none_is_none() -> None:
    assert hks_range(Display(), np.zeros(3)) is None
    assert band_range(Display(), np.zeros(3)) is None
    assert resolved_time(np.zeros(3)) is None
    assert hks_time(Display(), np.array([0.0, 1.0])) is None
    crossed = Display(hks_automatic=False, hks_t_min=10.0, hks_t_max=5.0)
    assert hks_range(crossed, EIGENVALUES) is None


def test_resolved_time_leaves_the_stated_share_of_the_heat_trace() -> None:
    # a flat torus of area A: the exact heat trace, and what the pairs at hand miss of it
    side = 2 * math.pi
    grid = np.arange(-80, 81)
    eigenvalues = np.sort((grid[:, None] ** 2 + grid[None, :] ** 2).ravel() * 1.0)
    kept = eigenvalues[eigenvalues <= 400]
    time = resolved_time(kept)
    assert time is not None
    whole = side**2 / (4 * math.pi * time)
    missing = 1 - np.exp(-kept * time).sum() / whole
    assert missing == pytest.approx(MISSING_SHARE, rel=0.1)
    assert required_eigenvalue(time) == pytest.approx(kept[-1])


def test_bands_span_the_spectrum_unless_told() -> None:
    assert band_range(Display(), EIGENVALUES) == (0.0, 8e-8)
    display = Display(band_automatic=False, band_max=3e-8)
    assert band_range(display, EIGENVALUES) == (0.0, 3e-8)


def test_steps_end_at_the_ends_or_wrap(document: Document) -> None:
    display = document.display
    step(document, 1)
    assert display.index == 2
    step(document, 100)
    assert display.index == 6
    step(document, 1, wrap=True)
    assert display.index == 0
    show_end(document, last=True)
    assert display.index == 6
    display.kind = FieldKind.BAND
    step(document, -1)
    assert display.band == 0
    step(document, -1, wrap=True)
    assert display.band == display.band_count - 1


def test_time_steps_are_equal_in_log(document: Document) -> None:
    display = document.display
    display.kind = FieldKind.HKS
    low, high = hks_range(display, EIGENVALUES)  # type: ignore[misc]
    step(document, 1)
    assert display.time == pytest.approx(low * (high / low) ** (0.5 + 1 / HKS_STEPS))
    show_end(document, last=False)
    assert display.time == pytest.approx(low)


def test_nothing_to_step_through() -> None:
    step(Document(), 1)

"""Estimates of the time and memory of a decomposition, and their texts."""

from __future__ import annotations

import pytest

from meshmash_viewer.spectral.cost import (
    decomposition_bytes,
    decomposition_seconds,
    estimate_memory,
    measured_rate,
    written_bytes,
    written_duration,
)
from meshmash_viewer.units import NO_BREAK


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.4, "under a second"),
        (0.99, "under a second"),
        (1.0, "1 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (200.0, "3 min 20 s"),
        (599.0, "9 min 59 s"),
        (600.0, "10 min"),
        (1234.0, "21 min"),
        (7500.0, "2 h 5 min"),
        (90_000.0, "25 h 0 min"),
    ],
)
def test_durations_are_written_as_people_say_them(seconds: float, words: str) -> None:
    assert written_duration(seconds) == (words if seconds < 1 else words.replace(" ", NO_BREAK))


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 B"),
        (999, "999 B"),
        (999.6, "1 kB"),
        (1234, "1.23 kB"),
        (5e6, "5 MB"),
        (1.2e9, "1.2 GB"),
        (3.45e12, "3450 GB"),
    ],
)
def test_bytes_are_written_with_three_digits(count: float, words: str) -> None:
    assert written_bytes(count) == words.replace(" ", NO_BREAK)


def test_time_grows_with_pairs_and_vertices_up_to_all_there_are() -> None:
    assert decomposition_seconds(1000, 100, rate=1e-3) == pytest.approx(115.0)
    assert decomposition_seconds(1000, 5000, rate=1e-3) == pytest.approx(1015.0)
    assert decomposition_seconds(1000, 100) < decomposition_seconds(2000, 100)


def test_a_run_predicts_itself_unless_it_was_too_short_to_tell() -> None:
    rate = measured_rate(1000, 100, 12.0)
    assert rate is not None
    assert decomposition_seconds(1000, 100, rate) == pytest.approx(12.0)
    assert measured_rate(1000, 100, 2.0) is None
    assert measured_rate(160_000, 1, 16.0) is None, "nearly all went into what comes before"


def test_memory_is_that_of_the_solver() -> None:
    assert decomposition_bytes(10_000, 99.7) == estimate_memory(10_000, 70_000, 100)
    assert decomposition_bytes(900, 1e9) == estimate_memory(900, 6300, 900)
    assert decomposition_bytes(900, 0.1) == estimate_memory(700, 4900, 1), "which is dense"


@pytest.mark.parametrize("n_pairs", [1, 20, 47, 60, 300, 700, 2000])
def test_predicted_memory_falls_with_the_vertices(n_pairs: int) -> None:
    sizes = [2, 63, 700, 701, 750, 902, 1500, 2099, 2500, 2501, 2502, 4000, 10_000, 400_000]
    predicted = [decomposition_bytes(n, n_pairs) for n in sizes]
    assert predicted == sorted(predicted)


@pytest.mark.parametrize(
    ("n_vertices", "n_pairs", "n_jobs", "measured"),
    [(50_000, 300, 2, 491e6), (50_000, 300, 1, 354e6), (265_000, 300, 2, 2493e6)],
)
def test_predicted_memory_is_what_was_measured(
    n_vertices: int, n_pairs: int, n_jobs: int, measured: float
) -> None:
    predicted = estimate_memory(n_vertices, 7 * n_vertices, n_pairs, n_jobs)
    assert predicted == pytest.approx(measured, rel=0.35)

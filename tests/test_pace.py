"""How far a run says that it is."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pytest
import scipy.sparse as sp

import meshmash_viewer as mv
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.engine.basis import BLOCK
from meshmash_viewer.spectral.engine.lanczos import usual_rows
from meshmash_viewer.spectral.engine.pace import Pace
from meshmash_viewer.spectral.engine.workers import slice_sizes


def test_steps_count_before_the_first_pairs_are_there() -> None:
    told: list[Progress] = []
    pace = Pace(told.append, 100, partial(slice_sizes, 5000))
    pace.stage("matrices")
    pace.stage("order")
    pace.begin_slices(100)
    pace.pairs(1, 101, 0)
    for steps in range(1, 40):
        pace.pairs(1, 101, steps)
    pace.pairs(101, 101, 40)
    fractions = [report.fraction or 0.0 for report in told]
    assert all(first <= second for first, second in itertools.pairwise(fractions))
    assert fractions[0] == 0.0
    assert fractions[1] < 0.25  # nothing but the order is there
    assert fractions[3] < fractions[12] <= fractions[-2] < 1.0
    assert (fractions[-1], told[-1].remaining) == (1.0, 0.0)
    assert told[-2].remaining is not None


def test_a_stage_that_says_nothing_makes_nobody_expect_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter([0.0, 1.0, 2.0, 4.0, 6.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    told: list[Progress] = []
    pace = Pace(told.append, 100, partial(slice_sizes, 5000))
    for stage in ("matrices", "order", "order", "order"):
        pace.stage(stage)
    left = [report.remaining for report in told]
    assert left[0] is None, "nobody knows yet"
    assert left[1] is not None
    assert left[1] > 4.0
    assert left[2:] == pytest.approx([left[1] - 2.0, left[1] - 4.0])


def test_a_null_space_is_no_sign_of_how_long_slices_take(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    told: list[Progress] = []
    pace = Pace(told.append, 300, partial(slice_sizes, 400_000))
    left = []
    for done in (0, 64, 64):
        now[0] += 5.0
        if done and len(left) == 2:
            pace.begin_slices(236)
        pace.pairs(done, 300, 0)  # the first 64 are constants of components
        left.append(told[-1].remaining)
    assert left[0] is not None
    assert left[1:] == pytest.approx([left[0] - 5.0, left[0] - 10.0])


def after_steps(monkeypatch: pytest.MonkeyPatch, seconds: float, lean: bool = False) -> Progress:
    """What is told after some steps of so many seconds each, where the stages before took ten."""
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    told: list[Progress] = []
    pace = Pace(told.append, 300, partial(slice_sizes, 5000, lean=lean))
    pace.stage("matrices")
    now[0] = 10.0
    pace.begin_slices(300)
    for steps in range(1, 31):
        now[0] += seconds
        pace.pairs(1, 301, steps)
    return told[-1]


def test_what_is_left_follows_the_pace_of_the_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    fast, slow = (after_steps(monkeypatch, seconds).remaining for seconds in (1.0, 10.0))
    assert fast is not None
    assert slow is not None
    assert slow == pytest.approx(10.0 * fast)


def test_small_slices_take_more_steps_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    wide, lean = (after_steps(monkeypatch, 1.0, lean).remaining for lean in (False, True))
    assert wide is not None
    assert lean is not None
    assert lean > 1.2 * wide


def test_a_run_tells_of_a_share_that_only_grows_and_ends_at_one() -> None:
    n = 60
    path = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    grid = sp.kronsum(path, path, format="csc")
    told: list[Progress] = []
    mv.solve(grid, sp.identity(n * n, format="csc"), n_components=60, progress=told.append)
    fractions = [report.fraction or 0.0 for report in told]
    assert all(first <= second for first, second in itertools.pairwise(fractions))
    assert fractions[0] < 0.5
    assert fractions[-1] == 1.0
    assert {report.stage for report in told} >= {"matrices", "order", "eigenpairs"}


@pytest.mark.parametrize("n_pairs", [100, 300, 1000])
def test_the_time_left_is_that_of_slices_of_the_usual_length(
    monkeypatch: pytest.MonkeyPatch, n_pairs: int
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    told: list[tuple[float, float]] = []
    sizes = slice_sizes(5000, n_pairs)
    # A step orthogonalizes against those before; then all of them are made into pairs.
    costs = [np.linspace(0.7, 1.3, round(usual_rows(size) / BLOCK * 1.13)) for size in sizes]
    end = 32.0 + 1.5 * sum(float(cost.sum()) for cost in costs)

    def tell(progress: Progress) -> None:
        if progress.remaining is not None and now[0] < 0.9 * end:
            told.append((now[0], progress.remaining))

    pace = Pace(tell, n_pairs, partial(slice_sizes, 5000))
    pace.stage("matrices")
    now[0] = 18.0
    pace.stage("order")
    now[0] = 32.0
    pace.begin_slices(n_pairs)
    taken, done = 0, 0
    for size, cost in zip(sizes, costs, strict=True):
        for seconds in cost:
            now[0] += seconds
            taken += 1
            pace.step(taken)
        now[0] += 0.5 * cost.sum()
        done += round(size)
        pace.pairs(done, n_pairs, taken)
    assert now[0] == pytest.approx(end, rel=0.02)
    times, left = np.array(told).T
    ratio = left / (end - times)
    assert ratio.min() > 0.8
    assert 0.85 < np.median(ratio) < 1.5
    assert ratio.max() < 2.1
    assert len(told) > 30

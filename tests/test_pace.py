"""Progress reports of a solve."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.sparse as sp

import meshmash_viewer as mv
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.engine.output import Pace


def test_the_reported_share_only_grows_and_ends_at_one_with_nothing_left() -> None:
    n = 60
    path = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    grid = sp.kronsum(path, path, format="csc")
    reports: list[Progress] = []
    mv.solve(grid, sp.identity(n * n, format="csc"), n_components=60, progress=reports.append)
    fractions = [report.fraction or 0.0 for report in reports]
    assert all(first <= second for first, second in itertools.pairwise(fractions))
    assert fractions[0] < 0.5
    assert fractions[-1] == 1.0
    assert {report.stage for report in reports} >= {"matrices", "order", "eigenpairs"}
    remaining = [report.remaining for report in reports]
    assert remaining[0] is None, "nothing is known yet"
    assert remaining[-1] == 0.0
    assert all(left is None or left >= 0.0 for left in remaining)
    assert any(left is not None and left > 0.0 for left in remaining)


def test_an_estimated_end_that_has_passed_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: clock[0])
    reports: list[Progress] = []
    pace = Pace(reports.append, 1000, lambda pairs: [pairs / 4.0] * 4)
    for clock[0] in (1.0, 50.0):
        pace.pairs(1, 6000, 10)
    assert [each.message for each in reports] == ["1 of 6,000 eigenpairs"] * 2
    assert reports[0].remaining > 0.0
    assert reports[1].remaining is None
    pace.pairs(6000, 6000, 10)
    assert reports[2].remaining == 0.0


def test_progress_is_reported_before_the_first_pairs_have_converged() -> None:
    n = 60
    path = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    grid = sp.kronsum(path, path, format="csc")
    reports: list[Progress] = []
    mv.solve(grid, sp.identity(n * n, format="csc"), n_components=100, progress=reports.append)
    assert any(report.fraction for report in reports if report.converged == 0)

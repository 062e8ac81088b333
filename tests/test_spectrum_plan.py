"""Where eigenvalues are counted, and how often the matrix is factored for that."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_eigensolver import torus

from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine import factorization, workers
from meshmash_viewer.spectral.engine.plan import SpectrumPlan
from meshmash_viewer.spectral.engine.workers import slice_sizes

STOP = np.zeros(1, dtype=np.uint8)
SIZES = partial(slice_sizes, 100_000)


class Spectrum:
    """Stands for a pencil in elimination order, with a count that grows like a power."""

    def __init__(self, n_null: int, scale: float, power: float) -> None:
        self.n_null, self.scale, self.power = n_null, scale, power
        self.pencil = SimpleNamespace(n=100_000, n_null=n_null, norm=1e6)
        self.kept: dict[float, Any] = {}
        self.counted: list[float] = []

    def factor(self, shift: float, _nudge: float, _stop: Any) -> Any:
        """What is counted at a shift."""
        self.counted.append(shift)
        count = self.n_null + int(self.scale * shift**self.power)
        return SimpleNamespace(shift=shift, count_below=count, blur=0.0)


@pytest.mark.parametrize("power", [0.45, 0.6, 1.0, 1.2])
@pytest.mark.parametrize("scale", [0.8, 1.25])
@pytest.mark.parametrize("wanted", [60, 100, 300, 1000])
def test_a_few_counts_find_the_top(power: float, scale: float, wanted: int) -> None:
    spectrum = Spectrum(30, scale * 100.0 ** (1.0 - power), power)
    plan = SpectrumPlan(spectrum, STOP, SIZES)  # type: ignore[arg-type]
    most = wanted + max(4, wanted // 40)
    top = plan.find_top(wanted, most)
    assert wanted <= plan.count(top) <= most
    assert len(spectrum.counted) <= (5 if wanted < 500 else 8), spectrum.counted


def test_slices_have_their_shifts_where_was_counted() -> None:
    spectrum = Spectrum(1, 0.95, 1.0)
    plan = SpectrumPlan(spectrum, STOP, SIZES, n_jobs=2)  # type: ignore[arg-type]
    top = plan.find_top(200, 205)
    assert len(spectrum.kept) == 2
    n_counted = len(spectrum.counted)
    slices = list(plan.slices(0.0, top))
    assert len(spectrum.counted) == n_counted, "the border between both was counted with the top"
    assert [interval.shift in spectrum.counted for interval in slices] == [True, True]
    for interval in slices:
        inside = int(0.95 * interval.shift) + 1 - interval.first
        assert 0.25 * interval.owed < inside < 0.75 * interval.owed
    assert set(spectrum.kept) == {interval.shift for interval in slices}


def test_a_long_run_begins_with_a_small_slice() -> None:
    spectrum = Spectrum(1, 0.95, 1.0)
    sizes = partial(slice_sizes, 1_000_000, early=True)
    plan = SpectrumPlan(spectrum, STOP, sizes, n_jobs=2)  # type: ignore[arg-type]
    top = plan.find_top(300, 305)
    small, first, second = plan.slices(0.0, top)
    assert 8 <= small.owed <= 25
    assert small.shift == small.high, "its border was counted, and that factor serves it"
    assert small.shift in spectrum.kept
    assert first.shift in spectrum.kept
    assert first.owed == pytest.approx(second.owed, rel=0.3)
    assert len(spectrum.counted) == len(set(spectrum.counted)) <= 5


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_the_lowest_pairs_come_first_where_they_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, n_jobs: int
) -> None:
    monkeypatch.setattr(workers, "_LONG_RUN", 0.0)
    matrices, exact = torus(60, 40, 3.0, 2.0)
    places: list[tuple[int, int]] = []
    found = solve(
        *matrices,
        120,
        n_jobs=n_jobs,
        early=True,
        on_pairs=lambda start, values, _: places.append((start, len(values))),
    )
    np.testing.assert_allclose(found.eigenvalues, exact[:120], rtol=1e-9, atol=1e-9)
    assert found.verify(*matrices).complete
    assert places[0] == (0, 1), "the constant"
    assert places[1][1] < 40 < places[2][1]


def test_a_slice_is_shifted_to_the_count_nearest_its_middle() -> None:
    plan = SpectrumPlan(Spectrum(1, 0.95, 1.0), STOP, SIZES)  # type: ignore[arg-type]
    knots = [plan.find(count, count + 2) for count in (20, 48, 75, 100)]
    slices = plan.interval(0.0, knots[-1])
    assert slices.shift == knots[1]


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_no_factor_is_made_twice(monkeypatch: pytest.MonkeyPatch, n_jobs: int) -> None:
    shifts: list[float] = []
    kind: Any = factorization.Factor
    make = kind.__init__

    def note(self: Any, ordered: Any, shift: float, stop: Any) -> None:
        shifts.append(shift)
        make(self, ordered, shift, stop)

    monkeypatch.setattr(kind, "__init__", note)
    found = solve(*torus(60, 50, 1.0, 1.3)[0], 120, n_jobs=n_jobs)
    assert found.complete
    # One at a time keeps the first slice's factor only: two would be memory that it spares.
    assert len(shifts) - len(set(shifts)) <= 2 - n_jobs

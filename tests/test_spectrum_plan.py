"""Shifts at which eigenvalues are counted, and the number of factorizations."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from test_eigensolver import torus

from meshmash_viewer.spectral import cost
from meshmash_viewer.spectral.cost import slice_sizes
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine import factorization
from meshmash_viewer.spectral.engine.factorization import FactorizationError
from meshmash_viewer.spectral.engine.plan import SpectrumPlan

SIZES = partial(slice_sizes, 100_000)


class Spectrum:
    """Stand-in for a pencil in elimination order; the count grows like a power of the shift."""

    def __init__(self, n_null: int, scale: float, power: float) -> None:
        self.n_null, self.scale, self.power = n_null, scale, power
        self.pencil = SimpleNamespace(n=100_000, n_null=n_null, norm=1e6)
        self.kept: dict[float, Any] = {}
        self.counted: list[float] = []

    def factor(self, shift: float, _nudge: float) -> Any:
        """Return a factor with the count below a shift."""
        self.counted.append(shift)
        count = self.n_null + int(self.scale * shift**self.power)
        return SimpleNamespace(shift=shift, count_below=count, blur=0.0)


@pytest.mark.parametrize("power", [0.45, 0.6, 1.0, 1.2])
@pytest.mark.parametrize("scale", [0.8, 1.25])
@pytest.mark.parametrize("wanted", [60, 100, 300, 1000])
def test_a_few_counts_find_the_top(power: float, scale: float, wanted: int) -> None:
    spectrum = Spectrum(30, scale * 100.0 ** (1.0 - power), power)
    plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
    most = wanted + max(4, wanted // 40)
    top = plan.find_top(wanted, most)
    assert wanted <= plan.count(top) <= most
    assert len(spectrum.counted) <= (5 if wanted < 500 else 8), spectrum.counted


def test_slices_have_their_shifts_where_was_counted() -> None:
    spectrum = Spectrum(1, 0.95, 1.0)
    plan = SpectrumPlan(spectrum, SIZES, n_jobs=2)  # type: ignore[arg-type]
    top = plan.find_top(200, 205)
    assert len(spectrum.kept) == 2
    n_counted = len(spectrum.counted)
    slices = list(plan.slices(0.0, top))
    assert len(spectrum.counted) == n_counted, "the border between both was counted with the top"
    assert [interval.shift in spectrum.counted for interval in slices] == [True, True]
    for interval in slices:
        inside = int(0.95 * interval.shift) + 1 - interval.first
        assert 0.25 * interval.n_expected < inside < 0.75 * interval.n_expected
    assert set(spectrum.kept) == {interval.shift for interval in slices}


def test_a_long_run_begins_with_a_small_slice() -> None:
    spectrum = Spectrum(1, 0.95, 1.0)
    sizes = partial(slice_sizes, 1_000_000, early=True)
    plan = SpectrumPlan(spectrum, sizes, n_jobs=2)  # type: ignore[arg-type]
    top = plan.find_top(300, 305)
    small, first, second = plan.slices(0.0, top)
    assert 8 <= small.n_expected <= 25
    assert small.shift == small.high, "its border was counted, and that factor serves it"
    assert small.shift in spectrum.kept
    assert first.shift in spectrum.kept
    assert first.n_expected == pytest.approx(second.n_expected, rel=0.3)
    assert len(spectrum.counted) == len(set(spectrum.counted)) <= 5


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_the_lowest_pairs_come_first_where_they_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, n_jobs: int
) -> None:
    monkeypatch.setattr(cost, "_LONG_RUN", 0.0)
    matrices, exact = torus(60, 40, 3.0, 2.0)
    counts: list[int] = []
    found = solve(
        *matrices,
        120,
        n_jobs=n_jobs,
        early=True,
        on_pairs=lambda pairs: counts.append(len(pairs)),
    )
    np.testing.assert_allclose(found.eigenvalues, exact[:120], rtol=1e-9, atol=1e-9)
    assert found.verify(*matrices).complete
    assert counts[0] == 1, "the constant"
    assert counts[1] - counts[0] < 40 < counts[2] - counts[1]


def test_a_slice_is_shifted_to_the_count_nearest_its_middle() -> None:
    plan = SpectrumPlan(Spectrum(1, 0.95, 1.0), SIZES)  # type: ignore[arg-type]
    knots = [plan.find(count, count + 2) for count in (20, 48, 75, 100)]
    slices = plan.interval(0.0, knots[-1])
    assert slices.shift == knots[1]


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_no_factor_is_made_twice(monkeypatch: pytest.MonkeyPatch, n_jobs: int) -> None:
    shifts: list[float] = []
    kind: Any = factorization.Factor
    make = kind.__init__

    def note(self: Any, ordered: Any, shift: float) -> None:
        shifts.append(shift)
        make(self, ordered, shift)

    monkeypatch.setattr(kind, "__init__", note)
    found = solve(*torus(60, 50, 1.0, 1.3)[0], 120, n_jobs=n_jobs)
    assert found.complete
    # One job keeps the factor of the first slice only, to save memory.
    assert len(shifts) - len(set(shifts)) <= 2 - n_jobs


class Listed:
    """Stand-in for a pencil in elimination order with listed eigenvalues."""

    def __init__(self, values: npt.NDArray[np.float64], n_null: int, blur: float = 0.0) -> None:
        self.values, self.blur = values, blur
        self.pencil = SimpleNamespace(
            n=len(values), n_null=n_null, norm=float(values[-1]), noise=1e-12
        )
        self.kept: dict[float, Any] = {}
        self.made: list[float] = []

    def below(self, value: float) -> int:
        return int(np.searchsorted(self.values, value))

    def factor_at(self, shift: float) -> Any:
        """Return a factor, or None if the shift is an eigenvalue."""
        self.made.append(shift)
        if np.abs(self.values - shift).min() <= 1e-12 * shift:
            return None
        return SimpleNamespace(shift=shift, count_below=self.below(shift), blur=self.blur)

    def factor(self, shift: float, nudge: float) -> Any:
        """Return a factor at the shift or next to it."""
        moved = (shift + move * nudge for move in (0.0, 1e-6, -1e-6, 1e-3))
        return next(filter(None, (self.factor_at(place) for place in moved)))


def listed(seed: int, blur: float = 0.0) -> Listed:
    """Return zeros, then eigenvalues of multiplicity 1 to 40 with a mean spacing of 1."""
    random = np.random.default_rng(seed)
    n_null = int(random.integers(1, 5))
    copies = random.choice([1, 1, 1, 2, 5, 40], size=250)
    distinct = np.cumsum(copies * random.uniform(0.3, 1.7, len(copies)))
    return Listed(np.append(np.zeros(n_null), np.repeat(distinct, copies)), n_null, blur)


def assert_clear(spectrum: Listed, plan: SpectrumPlan, border: float) -> None:
    """Check the count at a border, and that no eigenvalue is too near for a certain count."""
    assert plan.count(border) == spectrum.below(border)
    distance = np.abs(spectrum.values[spectrum.pencil.n_null :] - border).min()
    assert distance > plan._clearance[border] > 0.0
    assert distance > 16.0 * spectrum.blur


@pytest.mark.parametrize("blur", [0.0, 1e-8])
@pytest.mark.parametrize("seed", range(4))
def test_a_border_is_settled_beside_an_eigenvalue_and_nowhere_else(seed: int, blur: float) -> None:
    spectrum = listed(seed, blur)
    random = np.random.default_rng(seed)
    for eigenvalue in random.choice(spectrum.values[10:-60], 12):
        for outward in (1.0, -1.0):
            for wide in (False, True):
                spectrum.made.clear()
                plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
                border = plan.settle(float(eigenvalue), outward, wide=wide)
                assert_clear(spectrum, plan, border)
                assert 0.0 < outward * (border - eigenvalue) < 0.1 * eigenvalue
                n_made = len(spectrum.made)
                assert plan.settle(border) == border
                assert len(spectrum.made) == n_made, "settled once"
                # At most two counts lie beyond the border.
                behind = [place for place in spectrum.made if not outward * (border - place) > 0.0]
                assert len(behind) <= 2
        # A border with room on both sides is not moved, and two counts prove it.
        clear = 0.5 * (eigenvalue + spectrum.values[spectrum.values > eigenvalue][0])
        spectrum.made.clear()
        plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
        border = plan.settle(float(clear))
        assert_clear(spectrum, plan, border)
        if blur == 0.0:
            assert border == clear
            assert len(spectrum.made) == 2


@pytest.mark.parametrize("n_jobs", [1, 2])
@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_slices_share_out_the_spectrum(seed: int, settled: bool, n_jobs: int) -> None:
    spectrum = listed(seed)
    plan = SpectrumPlan(spectrum, SIZES, n_jobs=n_jobs)  # type: ignore[arg-type]
    top = plan.find_top(300, 307)
    assert plan.count(top) >= 300
    assert spectrum.below(top) == plan.count(top)
    slices = list(plan.slices(0.0, top, settled))
    assert [interval.low for interval in slices] == sorted({each.low for each in slices})
    assert slices[0].low < 0.0
    assert slices[-1].high == top
    first = spectrum.pencil.n_null
    for interval, before in zip(slices, [None, *slices], strict=False):
        assert interval.first == first
        assert interval.n_expected == spectrum.below(interval.high) - first > 0
        assert interval.low < interval.shift <= interval.high
        if before is not None:
            # Both slices search the interval in which the count of the border is uncertain.
            overlap = before.high - interval.low
            assert overlap == pytest.approx(0.5 * before.clearance, rel=1e-3)
        first += interval.n_expected
    # Most counts are at multiple eigenvalues, which leave no place for a border.
    assert len(spectrum.made) <= (60 if settled else 48)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("wanted", [1, 7, 60])
def test_pairs_around_a_value_lie_between_its_borders(seed: int, wanted: int) -> None:
    spectrum = listed(seed)
    random = np.random.default_rng(seed)
    for value in random.uniform(0.0, 1.2 * spectrum.values[-1], 6):
        spectrum.made.clear()
        plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
        low, high = plan.around(float(min(value, plan.top)), wanted)
        nearest = spectrum.values[np.argsort(np.abs(spectrum.values - value))[:wanted]]
        assert low <= nearest.min()
        assert nearest.max() < high
        if low > 0.0:
            assert_clear(spectrum, plan, low)
        inside = spectrum.below(high) - spectrum.below(low)
        assert inside <= 1.5 * wanted + 10 + 2 * 40, "but for two sets of copies at the ends"
        assert len(spectrum.made) <= (18 if wanted == 60 else 66)


def test_above_the_largest_the_count_is_known() -> None:
    spectrum = listed(0)
    plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
    border = plan.settle(float(spectrum.values[-1]))
    assert spectrum.values[-1] < border <= plan.top
    assert plan.count(border) == plan.count(plan.top) == len(spectrum.values)


def test_of_several_counts_the_nearest_to_the_middle_is_taken() -> None:
    plan = SpectrumPlan(Spectrum(1, 0.95, 1.0), SIZES)  # type: ignore[arg-type]
    for count in (20, 49, 75):
        plan.find(count, count + 1)
    assert abs(plan.count(plan.find(10, 90)) - 50) <= 2
    assert plan.count(plan.find(70, 90)) in (75, 76)


@pytest.mark.parametrize(("lowest", "n_negative"), [(-1e-7, 0), (-1e-5, 2), (-0.5, 2)])
def test_below_zero_by_more_than_rounding_is_negative(lowest: float, n_negative: int) -> None:
    spectrum = listed(0)
    spectrum.values[:2] = lowest
    plan = SpectrumPlan(spectrum, SIZES)  # type: ignore[arg-type]
    assert plan.negative() == n_negative


def test_where_no_gap_is_there_is_no_border() -> None:
    values = np.append(0.0, 50.0 * np.exp(np.linspace(-0.5, 0.5, 2_000_001)))
    plan = SpectrumPlan(Listed(values, 1, blur=1e-3), SIZES)  # type: ignore[arg-type]
    with pytest.raises(FactorizationError, match="no gap in the spectrum near 50"):
        plan.settle(50.0)

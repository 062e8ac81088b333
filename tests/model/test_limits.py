from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.model.limits import (
    LimitPolicy,
    Limits,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
    automatic_limits,
    beyond_limits,
    logarithmic_limits,
    spans_decades,
)

POLICIES = [
    SymmetricLimits(),
    MinMaxLimits(),
    PercentileLimits(),
    LockedLimits(3.0, 3.0),
    LockedLimits(np.nan, 1.0),
    LockedLimits(0.0, np.inf),
]


@pytest.mark.parametrize("policy", POLICIES, ids=str)
@pytest.mark.parametrize(
    "values",
    [
        np.zeros(5),
        np.full(5, 1e-30),
        np.array([np.nan, np.nan]),
        np.array([np.nan, 1.0, np.inf]),
        np.array([]),
        np.array([-1.0, 2.0], dtype=np.float32),
    ],
    ids=str,
)
def test_limits_are_open_and_finite_for_any_field(policy: LimitPolicy, values: np.ndarray) -> None:
    low, high = policy.limits(values)
    assert np.isfinite(low)
    assert np.isfinite(high)
    assert low < high


def test_policies_do_what_they_say() -> None:
    values = np.array([np.nan, -3.0, 0.0, 5.0])
    assert SymmetricLimits().limits(values) == (-5.0, 5.0)
    assert MinMaxLimits().limits(values) == (-3.0, 5.0)
    assert LockedLimits(0.0, 1.0).limits(values) == (0.0, 1.0)
    assert automatic_limits(signed=True) == SymmetricLimits()
    assert automatic_limits(signed=False) == PercentileLimits()


def test_percentiles_are_taken_over_the_sample() -> None:
    values = np.concatenate([np.linspace(0.0, 1.0, 101), np.full(100, 1e6)])
    assert PercentileLimits(0.0, 100.0).limits(values, np.arange(101)) == (0.0, 1.0)
    assert PercentileLimits(0.0, 100.0).limits(values)[1] == 1e6
    assert MinMaxLimits().limits(values, np.arange(101))[1] == 1e6  # the sample is not used


@pytest.mark.parametrize("outside", [(), (np.nan,), (np.inf,), (-np.inf,), (np.nan, -np.inf)])
def test_percentiles_are_those_of_the_finite_values(outside: tuple[float, ...]) -> None:
    finite = np.random.default_rng(3).standard_normal(501)
    values = np.concatenate([finite[:200], outside, finite[200:]])
    wanted = np.percentile(finite, [5.0, 90.0])
    for sample in (None, np.random.default_rng(4).permutation(len(values))):
        found = PercentileLimits(5.0, 90.0).limits(values, sample)
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


@pytest.mark.parametrize("sample", [None, np.arange(100)])
def test_limits_leave_the_values_as_they_are(
    rng: np.random.Generator, sample: np.ndarray | None
) -> None:
    values = rng.normal(size=100)
    before = values.copy()
    PercentileLimits().limits(values, sample)
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize("outside", [(), (np.nan,), (np.inf,), (-np.inf,), (np.nan, np.inf)])
def test_extremes_are_those_of_the_finite_values(outside: tuple[float, ...]) -> None:
    values = np.array([-2.0, *outside, 7.0, 1.0, -3.0])
    assert MinMaxLimits().limits(values) == (-3.0, 7.0)
    assert SymmetricLimits().limits(values) == (-7.0, 7.0)
    assert SymmetricLimits().limits(-values) == (-7.0, 7.0)


def test_a_constant_field_is_opened_by_a_share_of_its_size() -> None:
    assert MinMaxLimits().limits(np.full(4, -50.0)) == (
        pytest.approx(-50.05),
        pytest.approx(-49.95),
    )
    assert MinMaxLimits().limits(np.zeros(4)) == (-1.0, 1.0)
    assert MinMaxLimits().limits(np.array([1.0, 1.0 + 1e-9])) == (1.0, 1.0 + 1e-9)


def test_percentiles_run_from_1_to_99_where_nobody_chose() -> None:
    policy = PercentileLimits()
    low, high = policy.limits(np.linspace(0.0, 100.0, 1001))
    assert (low, high) == (pytest.approx(1.0), pytest.approx(99.0))


@pytest.mark.parametrize(
    ("low", "high", "serves"),
    [(1e-9, 1e-5, True), (1e-7, 1e-5, False), (0.0, 1e-5, True), (-1e-12, 1e-5, False)],
)
def test_a_log_scale_serves_positive_fields_over_more_than_two_decades(
    low: float, high: float, serves: bool
) -> None:
    values = np.geomspace(max(low, 1e-9), high, 1000).astype(np.float32)
    values[0] = low
    assert spans_decades(PercentileLimits().limits(values), values) == serves


def test_a_log_scale_begins_above_zero() -> None:
    values = np.append(0.0, np.geomspace(1e-3, 1.0, 301))
    low, high, logarithmic = logarithmic_limits(MinMaxLimits().limits(values), values)
    assert (high, logarithmic) == (1.0, True)
    assert 1e-3 <= low < 2e-3
    assert logarithmic_limits((-2.0, -1.0), values) == (-2.0, -1.0, False)
    assert logarithmic_limits((0.0, 1.0), np.zeros(3)) == (0.0, 1.0, False)


def test_values_beyond_the_limits_are_known() -> None:
    assert beyond_limits(Limits(0.0, 1.0), (0.0, 1.0)) == (False, False)
    assert beyond_limits(Limits(0.0, 1.0), (-0.5, 1.5)) == (True, True)


def test_a_share_of_the_colour_bar_is_a_value_and_back() -> None:
    for limits in (Limits(-2.0, 6.0), Limits(1e-8, 1e-2, logarithmic=True)):
        for share in (0.1, 0.5, 0.9):
            assert limits.share_of(limits.at(share)) == pytest.approx(share)
        assert (limits.at(0.0), limits.at(1.0)) == (-np.inf, np.inf)
        assert (limits.share_of(-np.inf), limits.share_of(np.inf)) == (0.0, 1.0)
    assert Limits(1e-8, 1e-2, logarithmic=True).at(0.5) == pytest.approx(1e-5)

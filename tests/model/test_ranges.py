from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature, resolved_from
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.spectral.weyl import Target, required_eigenvalue


def spectrum_of(eigenvalues: np.ndarray, n_vertices: int = 1000) -> Eigenpairs:
    rows = np.zeros((len(eigenvalues), n_vertices))
    return Eigenpairs(eigenvalues, rows, np.zeros(len(eigenvalues)))


TWO_PIECES = spectrum_of(np.array([1e-19, 2e-18, 1.0, 2.0, 4.0, 5.0, 8.0]) * 1e-8)
ZEROS = spectrum_of(np.zeros(4))


def test_zeros_of_several_components_are_left_out() -> None:
    assert first_nonzero(TWO_PIECES) == 2
    assert first_nonzero(ZEROS) == 4
    assert first_nonzero(spectrum_of(np.empty(0))) == 0


def test_automatic_times_are_those_of_sun_2009_and_all_resolved() -> None:
    low, high = HeatKernelSignature().range(TWO_PIECES)
    assert low == pytest.approx(4 * math.log(10) / 8e-8)
    assert high == pytest.approx(4 * math.log(10) / 1e-8)
    assert HeatKernelSignature().time_in(TWO_PIECES) == pytest.approx(math.sqrt(low * high))
    assert low / 3 < resolved_from(TWO_PIECES) < low


def test_range_by_hand_and_the_time_in_it() -> None:
    display = HeatKernelSignature(automatic=False, t_min=10.0, t_max=1000.0)
    assert display.range(TWO_PIECES) == (10.0, 1000.0)
    assert display.time_in(TWO_PIECES) == pytest.approx(100.0)
    display = replace(display, time=200.0)
    assert display.time_in(TWO_PIECES) == 200.0


def test_a_range_is_there_while_all_eigenvalues_are_zero() -> None:
    low, high = HeatKernelSignature().range(ZEROS)
    assert 0.0 < low < high
    low, high = GeometryVectors().range(ZEROS)
    assert low < high
    assert resolved_from(ZEROS) == math.inf


def test_resolved_time_leaves_less_than_one_per_cent_of_the_heat_trace() -> None:
    # a flat torus: its heat trace is A / 4πt, but for terms negligible at these times
    grid = np.arange(-80, 81)
    eigenvalues = np.sort((grid[:, None] ** 2 + grid[None, :] ** 2).ravel().astype(float))
    kept, area = eigenvalues[eigenvalues <= 1600], 4 * math.pi**2
    spectrum = spectrum_of(kept, 25_000)
    time = resolved_from(spectrum)
    assert required_eigenvalue(time) == pytest.approx(kept[-1])
    for t in (time, 0.2 * time):
        missing = 1 - np.exp(-kept * t).sum() / (math.pi / t)
        estimated = spectrum.missing_shares(heat_kernel_bank([t]), area)
        assert estimated == pytest.approx(missing, rel=0.3)
        assert (missing < 0.01) == (t == time)


def test_with_all_pairs_every_time_is_resolved() -> None:
    whole = spectrum_of(np.arange(8.0), 8)
    assert resolved_from(whole) == 0.0
    assert whole.missing_shares(heat_kernel_bank([1e-9]), 1.0) == 0.0


def test_bands_span_the_spectrum_unless_told() -> None:
    assert GeometryVectors().range(TWO_PIECES) == (0.0, 8e-8)
    assert GeometryVectors(automatic=False, high=3e-8).range(TWO_PIECES) == (0.0, 3e-8)


def test_an_end_left_open_by_hand_is_automatic_and_wrong_ends_are_exchanged() -> None:
    low, high = HeatKernelSignature().range(TWO_PIECES)
    middle = math.sqrt(low * high)
    assert HeatKernelSignature(automatic=False).range(TWO_PIECES) == (low, high)
    by_hand = HeatKernelSignature(automatic=False, t_min=middle)
    assert by_hand.range(TWO_PIECES) == (middle, high)
    by_hand = HeatKernelSignature(automatic=False, t_max=middle)
    assert by_hand.range(TWO_PIECES) == (low, middle)
    by_hand = HeatKernelSignature(automatic=False, t_min=1000.0, t_max=10.0)
    assert by_hand.range(TWO_PIECES) == (10.0, 1000.0)
    assert HeatKernelSignature(t_min=5.0, t_max=6.0).range(TWO_PIECES) == (low, high)


def test_bands_by_hand_are_in_order_and_never_empty() -> None:
    by_hand = GeometryVectors(automatic=False, low=2e-8)
    assert by_hand.range(TWO_PIECES) == (2e-8, 8e-8)
    by_hand = GeometryVectors(automatic=False, low=5e-8, high=2e-8)
    assert by_hand.range(TWO_PIECES) == (2e-8, 5e-8)
    by_hand = GeometryVectors(automatic=False, low=2e-8, high=2e-8)
    assert by_hand.range(TWO_PIECES) == (2e-8, 2e-8 + 1.0)
    assert GeometryVectors(low=2e-8, high=3e-8).range(TWO_PIECES) == (0.0, 8e-8)
    assert GeometryVectors().range(ZEROS) == (0.0, 1.0)


@pytest.mark.parametrize(("high", "n_vertices"), [(8e-8, 99), (8.1e-8, 99), (1e-6, 99), (1e-6, 7)])
def test_bands_beyond_the_computed_pairs_need_more_of_them(high: float, n_vertices: int) -> None:
    some = spectrum_of(TWO_PIECES.eigenvalues, n_vertices)
    reading = GeometryVectors(automatic=False, low=0.0, high=high).reading(some, "nm")
    needed = high > 8e-8 and n_vertices > len(some)
    assert reading.sufficient == (Target("max_eigenvalue", high) if needed else None)
    assert ("need more eigenpairs" in reading.warning) is needed


def test_a_spectrum_of_rounding_has_no_times_of_its_own() -> None:
    for values in ([0.0, 0.0], [-1e-9, 1e-19], [], [-1e-20, -1e-20]):
        assert spectrum_of(np.array(values)).time_range == (1.0, 10.0)
    assert spectrum_of(np.array([-1e-18, 1.0])).time_range == (
        pytest.approx(4 * math.log(10)),
        pytest.approx(4 * math.log(10)),
    )


def test_times_that_the_pairs_do_not_resolve_are_told_within_the_range() -> None:
    resolved = resolved_from(TWO_PIECES)

    def unresolved(t_min: float, t_max: float) -> tuple[float, float] | None:
        family = HeatKernelSignature(automatic=False, t_min=t_min, t_max=t_max)
        return family.unresolved(TWO_PIECES)

    low, high = unresolved(resolved / 10.0, resolved * 10.0) or (0.0, 0.0)
    assert (10.0**low, 10.0**high) == pytest.approx((resolved / 10.0, resolved))
    low, high = unresolved(resolved / 10.0, resolved / 2.0) or (0.0, 0.0)
    assert (10.0**low, 10.0**high) == pytest.approx((resolved / 10.0, resolved / 2.0))
    assert unresolved(resolved, resolved * 10.0) is None


def test_a_multiplet_is_the_run_of_equal_eigenvalues_around_an_index() -> None:
    values = np.array([-1e-18, 1e-18, 1.0, 2.0, 2.0 + 1e-7, 2.0 + 2e-7, 3.0, 4.0, 4.0])
    spectrum = spectrum_of(values)
    runs = {0: (0, 1), 1: (0, 1), 3: (3, 5), 4: (3, 5), 5: (3, 5), 7: (7, 8), 8: (7, 8)}
    for index in range(-2, len(values) + 2):
        found = spectrum.multiplet(index)
        assert (None if found is None else (found[0], found[-1])) == runs.get(index)
    assert spectrum_of(np.empty(0)).multiplet(0) is None
    assert spectrum_of(np.ones(1)).multiplet(0) is None


def test_a_spectrum_without_a_preview_is_exact_as_it_is() -> None:
    assert TWO_PIECES.exact is TWO_PIECES
    assert all(TWO_PIECES.is_exact(index) for index in range(7))
    rough = replace(TWO_PIECES, n_exact=4)
    assert [rough.is_exact(index) for index in range(7)] == [True] * 4 + [False] * 3
    np.testing.assert_array_equal(rough.exact.eigenvalues, TWO_PIECES.eigenvalues[:4])
    assert not rough.exact.preview

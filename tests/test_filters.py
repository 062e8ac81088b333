"""Filter banks: shapes, sums and scales."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import shapes
from faults import raises

from meshmash_viewer.features.filter_responses import (
    first_nonzero_eigenvalue,
    hks_time_range,
    hks_times,
)
from meshmash_viewer.features.filters import (
    band_pass_bank,
    bspline_bank,
    construct_bspline_basis,
    construct_bspline_filter,
    gaussian_pyramid_bank,
    get_hks_filter,
    heat_kernel_bank,
    low_pass_bank,
    wave_kernel_bank,
)

SPECTRUM = shapes.sphere_eigenvalues(64) * 1e-8


@pytest.mark.parametrize("n_components", [1, 2, 4, 5, 32])
@pytest.mark.parametrize(("e_min", "e_max"), [(2e-9, 1e-8), (-1.0, 3e4)])
def test_bsplines_sum_to_one_on_the_range_and_vanish_outside(e_min, e_max, n_components):
    bases = construct_bspline_basis(e_min, e_max, n_components)
    assert len(bases) == n_components
    span = e_max - e_min
    inside = np.linspace(e_min, e_max, 1001)
    values = np.stack([basis(inside) for basis in bases])
    np.testing.assert_allclose(values.sum(axis=0), 1.0, atol=1e-12)
    assert values.min() >= 0.0
    outside = np.concatenate(
        [e_min - span * np.geomspace(1e-9, 5), e_max + span * np.array([1e-9, 1, 9])]
    )
    assert all((basis(outside) == 0.0).all() for basis in bases)


def test_bsplines_are_cubic_and_uniform():
    bases = construct_bspline_basis(0.0, 1.0, 12)
    assert all(basis.k == 3 for basis in bases)
    # 12 - 3 equal spans: each inner basis function is a shift of the next.
    at = np.linspace(0.0, 4.0 / 9.0, 50)
    for index in range(3, 8):
        shift = (index - 3) / 9.0
        np.testing.assert_allclose(bases[index](at + shift), bases[3](at), atol=1e-12)
    # Cubic between knots: the fourth difference vanishes, the third does not.
    piece = bases[5](np.linspace(3.0 / 9.0, 4.0 / 9.0, 9))
    assert np.abs(np.diff(piece, 4)).max() < 1e-12
    assert np.abs(np.diff(piece, 3)).min() > 1e-6
    # Smooth across a knot: the second difference scales with the square of the step.
    for step in (1e-3, 1e-4):
        around = bases[5](4.0 / 9.0 + step * np.array([-1.0, 0.0, 1.0]))
        assert abs(np.diff(around, 2)[0]) < 500.0 * step**2


def test_bsplines_are_ordered_and_reach_both_ends():
    bank = bspline_bank(0.0, 2.0, 9)
    coefficients = bank(np.linspace(0.0, 2.0, 301))
    assert (np.diff(coefficients.argmax(axis=1)) > 0).all()
    assert bank([0.0])[:, 0] == pytest.approx(np.eye(9)[0], abs=1e-12)
    for end in (2.0, 2.0 * (1.0 + 1e-12)):  # also if rounding exceeds the end
        assert bank([end])[:, 0] == pytest.approx(np.eye(9)[8], abs=1e-12)
    assert not bank([2.0 * (1.0 + 1e-8)]).any()
    assert (np.diff(bank.parameters) > 0.0).all()
    assert bank.columns[:2] == ("band_00", "band_01")
    assert (bank.parameter_name, bank.parameter_power) == ("λ", -2)


def test_the_documented_filter_is_the_basis_evaluated():
    bases = construct_bspline_basis(0.0, 1e-8, 32)
    coefficients = construct_bspline_filter(0.0, 1e-8, 32)(SPECTRUM)
    np.testing.assert_array_equal(coefficients, [basis(SPECTRUM) for basis in bases])


@pytest.mark.parametrize("ends", [(1.0, 1.0), (-np.inf, 1.0), (0.0, np.inf)])
@pytest.mark.parametrize("count", [0, 2.5, 4])
def test_senseless_bsplines_are_refused(ends, count):
    with raises("bounds-swapped" if count == 4 else "out-of-range"):
        construct_bspline_basis(*ends, count)


def test_automatic_times_are_those_of_the_paper():
    t_min, t_max = hks_time_range(SPECTRUM)
    assert t_min == pytest.approx(4.0 * np.log(10.0) / SPECTRUM[-1])
    assert t_max == pytest.approx(4.0 * np.log(10.0) / SPECTRUM[1])
    many_components = np.concatenate([np.zeros(80), SPECTRUM[1:]])
    assert hks_time_range(many_components) == (t_min, t_max)
    noisy = np.concatenate([[-1e-24, 3e-25, 1e-22], SPECTRUM[1:]])
    assert hks_time_range(noisy) == (t_min, t_max)


def test_given_times_are_kept_and_ascend():
    times = hks_times(SPECTRUM, 1e6, 1e9, 7)
    np.testing.assert_allclose(times, np.geomspace(1e6, 1e9, 7))
    assert hks_times(SPECTRUM, t_min=5.0)[0] == pytest.approx(5.0)
    assert hks_times(SPECTRUM, t_max=1e12)[-1] == pytest.approx(1e12)
    assert len(hks_times(SPECTRUM, n_scales=1)) == 1
    assert hks_times([], 1.0, 2.0, 2).tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        ({"t_min": 2.0, "t_max": 1.0}, "bounds-swapped", "swap"),
        ({"t_min": -1.0}, "out-of-range", "t_min is -1"),
        ({"t_max": 0.0}, "out-of-range", "t_max is 0"),
        ({"t_max": np.nan}, "out-of-range", "t_max is nan"),
        ({"t_min": np.inf}, "out-of-range", "t_min is inf"),
        ({"n_scales": 0}, "out-of-range", "whole number"),
    ],
)
def test_senseless_times_are_refused(arguments, code, word):
    with raises(code, word):
        hks_times(SPECTRUM, **arguments)
    with raises(code, word):
        get_hks_filter(**arguments)


def test_a_bound_beyond_the_automatic_range_asks_for_the_other():
    shortest, longest = hks_time_range(SPECTRUM)
    for make in (lambda **t: hks_times(SPECTRUM, **t), lambda **t: get_hks_filter(**t)(SPECTRUM)):
        with raises("bounds-swapped"):
            make(t_min=1.001 * longest)
        with raises("bounds-swapped"):
            make(t_max=0.999 * shortest)
    assert hks_times(SPECTRUM, t_min=longest, n_scales=2).tolist() == [longest, longest]
    assert hks_times(SPECTRUM, t_max=shortest, n_scales=2).tolist() == [shortest, shortest]
    far = hks_times(SPECTRUM, 2.0 * longest, 4.0 * longest, 3)
    np.testing.assert_allclose(far / longest, [2.0, 2.0**1.5, 4.0])


def test_a_spectrum_of_zeros_has_no_scale():
    for nothing in (np.zeros(3), [], [-1e-20]):
        with raises("no-nonzero-eigenvalue"):
            first_nonzero_eigenvalue(nothing)
        with raises("no-nonzero-eigenvalue", "All eigenvalues are zero"):
            hks_times(nothing)
        # Every time gives the same coefficients.
        assert (get_hks_filter(n_scales=4)(nothing) == np.ones((4, len(nothing)))).all()


def test_the_area_gives_a_spectrum_of_zeros_its_scale():
    times = hks_times(np.zeros(5), n_scales=3, area=4.0 * np.pi)
    # Weyl's eigenvalues of this area are 1, 2, ..., 5
    np.testing.assert_allclose(times[[0, -1]], 4.0 * np.log(10.0) / np.array([5.0, 1.0]))
    np.testing.assert_allclose(hks_times(np.zeros(5), n_scales=3, area=16.0 * np.pi), 4.0 * times)
    np.testing.assert_array_equal(hks_times(SPECTRUM, area=1.0), hks_times(SPECTRUM))


def test_the_documented_hks_filter():
    coefficients = get_hks_filter(t_max=1e9, t_min=1e7, n_scales=5)(SPECTRUM)
    expected = np.exp(-np.outer(np.geomspace(1e7, 1e9, 5), SPECTRUM))
    np.testing.assert_allclose(coefficients, expected)
    single = get_hks_filter(dtype=np.float32)(SPECTRUM)
    assert (single.shape, single.dtype) == ((32, 64), np.float32)
    np.testing.assert_allclose(single[-1, 1], 1e-4, rtol=1e-5)
    np.testing.assert_allclose(single[0, -1], 1e-4, rtol=1e-5)


def test_times_of_a_heat_bank_are_finite_and_not_negative():
    for times in ([1.0, np.inf], [1.0, -1.0], [np.nan]):
        with raises("out-of-range"):
            heat_kernel_bank(times)
    for shapeless in ([], [[1.0]], {}):
        with raises("wrong-shape"):
            heat_kernel_bank(shapeless)


def test_heat_bank_names_its_times_apart():
    assert heat_kernel_bank(0.5).columns == ("hks_t=5.00e-01",)
    bank = heat_kernel_bank([123456.0, 2e6])
    assert bank.columns == ("hks_t=1.23e+05", "hks_t=2.00e+06")
    assert (bank.parameter_name, bank.parameter_power, bank.n_filters) == ("t", 2, 2)
    near = heat_kernel_bank(np.linspace(1.0, 1.001, 50))
    assert len(set(near.columns)) == 50
    with raises("wrong-shape", "at least one"):
        heat_kernel_bank([])


def test_wave_kernel_bands_are_normalised_gaussians_in_log_energy():
    bank = wave_kernel_bank(SPECTRUM, n_energies=20)
    coefficients = bank(SPECTRUM)
    assert coefficients.shape == (20, 64)
    np.testing.assert_allclose(coefficients.sum(axis=1), 1.0)
    assert (coefficients[:, 0] == 0.0).all()
    centres = np.log(bank.parameters)
    step = centres[1] - centres[0]
    np.testing.assert_allclose(np.diff(centres), step)
    # Centres begin two deviations, of seven steps each, inside the range.
    np.testing.assert_allclose(centres[0] - 14.0 * step, np.log(SPECTRUM[1]))
    np.testing.assert_allclose(centres[-1] + 14.0 * step, np.log(SPECTRUM[-1]))
    positive = SPECTRUM[1:]
    band = np.exp(-np.square(centres[4] - np.log(positive)) / (2.0 * (7.0 * step) ** 2))
    np.testing.assert_allclose(coefficients[4, 1:], band / band.sum())


def test_wave_kernel_does_not_depend_on_the_unit():
    metres = wave_kernel_bank(SPECTRUM * 1e18, 10)(SPECTRUM * 1e18)
    np.testing.assert_allclose(metres, wave_kernel_bank(SPECTRUM, 10)(SPECTRUM), rtol=1e-9)
    assert wave_kernel_bank(SPECTRUM, 1)(SPECTRUM).shape == (1, 64)
    with raises("too-few-pairs", "two different"):
        wave_kernel_bank([0.0, 1.0, 1.0])


def test_ready_banks_do_what_their_examples_do():
    cutoff, low = 2e-7, 5e-8
    np.testing.assert_array_equal(low_pass_bank(cutoff)(SPECTRUM), [cutoff > SPECTRUM])
    np.testing.assert_array_equal(
        band_pass_bank(low, cutoff)(SPECTRUM), [(low <= SPECTRUM) & (cutoff >= SPECTRUM)]
    )
    scales = np.geomspace(1e5, 1e8, 8)
    np.testing.assert_allclose(
        gaussian_pyramid_bank(scales)(SPECTRUM), np.exp(-np.outer(scales, SPECTRUM))
    )
    with raises("bounds-swapped", "swap"):
        band_pass_bank(2.0, 1.0)


@pytest.mark.parametrize(
    "bank",
    [
        heat_kernel_bank([1e7, 1e8]),
        bspline_bank(0.0, 1e-6, 6),
        wave_kernel_bank(SPECTRUM, 5),
        low_pass_bank(1e-7),
        band_pass_bank(1e-8, 1e-7),
        gaussian_pyramid_bank([1e7]),
        get_hks_filter(),
    ],
)
def test_banks_travel_to_other_processes(bank):
    copy = pickle.loads(pickle.dumps(bank))
    np.testing.assert_array_equal(copy(SPECTRUM), bank(SPECTRUM))
    with raises("wrong-shape", "1-D"):
        bank(SPECTRUM.reshape(8, 8))


@pytest.mark.parametrize("count", [2, 4, 12])
def test_bands_are_centred_so_that_they_reproduce_the_eigenvalue(count):
    # Splines of degree one and more, weighted by Greville points, reproduce x (Marsden 1970).
    bank = bspline_bank(2.0, 7.0, count)
    values = np.linspace(2.0, 7.0, 41)
    np.testing.assert_allclose(bank.parameters @ bank(values), values, rtol=1e-12)
    assert bspline_bank(2.0, 7.0, 1).parameters == [4.5]


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_the_parameter_of_a_column_has_the_power_of_the_unit_that_is_stated(scale):
    """Parameters scale with their stated power if eigenvalues are divided by ``scale**2``."""

    def banks(unit):
        spectrum, high = SPECTRUM / unit**2, SPECTRUM[-1] / unit**2
        return [
            heat_kernel_bank(hks_times(spectrum, n_scales=4)),
            wave_kernel_bank(spectrum, 4),
            bspline_bank(0.0, high, 4),
            low_pass_bank(0.5 * high),
            band_pass_bank(0.2 * high, 0.5 * high),
            gaussian_pyramid_bank(1.0 / high * np.array([1.0, 4.0])),
        ]

    for bank, scaled in zip(banks(1.0), banks(scale), strict=True):
        wanted = bank.parameters * scale**bank.parameter_power
        np.testing.assert_allclose(scaled.parameters, wanted, rtol=1e-9)
        assert bank.kind == scaled.kind


def _gaussian_bands(spectrum, energies, sigma):
    """Return the paper's normalised Gaussians in log λ over the eigenvalues above zero."""
    values = np.zeros((len(energies), len(spectrum)))
    logs = np.log(spectrum[1:])
    values[:, 1:] = np.exp(-((energies[:, None] - logs) ** 2) / (2.0 * sigma**2))
    return values / values.sum(axis=1, keepdims=True)


def test_wave_kernels_at_energies_that_are_given():
    low, high = np.log(SPECTRUM[1]), np.log(SPECTRUM[-1])
    energies = np.linspace(low, high, 9)
    step = energies[1] - energies[0]
    for how, sigma in (({"sigma": 0.3}, 0.3), ({}, 7.0 * step), ({"width": 2.0}, 2.0 * step)):
        bank = wave_kernel_bank(SPECTRUM, energies=energies, **how)
        np.testing.assert_allclose(
            bank(SPECTRUM), _gaussian_bands(SPECTRUM, energies, sigma), rtol=1e-9, atol=1e-15
        )
        np.testing.assert_allclose(bank.parameters, np.exp(energies))
    one = wave_kernel_bank(SPECTRUM, energies=[low], sigma=0.1)
    assert one(SPECTRUM).shape == (1, len(SPECTRUM))
    backwards = wave_kernel_bank(SPECTRUM, energies=energies[::-1].tolist(), sigma=0.3)
    np.testing.assert_array_equal(
        backwards(SPECTRUM),
        wave_kernel_bank(SPECTRUM, energies=energies, sigma=0.3)(SPECTRUM)[::-1],
    )
    assert len(set(backwards.columns)) == 9


def test_a_deviation_alone_leaves_the_bands_inside_the_range():
    low, high = np.log(SPECTRUM[1]), np.log(SPECTRUM[-1])
    sigma = 0.1 * (high - low)
    bank = wave_kernel_bank(SPECTRUM, 5, sigma=sigma)
    energies = np.linspace(low + 2.0 * sigma, high - 2.0 * sigma, 5)
    np.testing.assert_allclose(bank.parameters, np.exp(energies))
    np.testing.assert_allclose(
        bank(SPECTRUM), _gaussian_bands(SPECTRUM, energies, sigma), rtol=1e-9, atol=1e-15
    )
    default = wave_kernel_bank(SPECTRUM, 5)
    same = wave_kernel_bank(SPECTRUM, 5, sigma=7.0 * (high - low) / (4 + 28))
    np.testing.assert_allclose(same(SPECTRUM), default(SPECTRUM), rtol=1e-9)


@pytest.mark.parametrize(
    ("how", "code", "word"),
    [
        ({"energies": []}, "out-of-range", "at least one natural logarithm"),
        ({"energies": [[1.0, 2.0]]}, "out-of-range", "1-D list"),
        ({"energies": [1.0, np.nan]}, "out-of-range", "natural logarithm"),
        ({"energies": [1.0, np.inf]}, "out-of-range", "natural logarithm"),
        ({"energies": [-800.0, 1.0]}, "out-of-range", "natural logarithm"),
        ({"energies": [1.0, 800.0]}, "out-of-range", "natural logarithm"),
        ({"energies": [1.0, 2.0, 1.0]}, "conflicting-arguments", "each once"),
        ({"energies": ["low"]}, "out-of-range", "1-D list"),
        ({"energies": [1.0]}, "missing-argument", "give sigma"),
        ({"energies": [1.0, 2.0], "sigma": 0.0}, "out-of-range", "positive"),
        ({"energies": [1.0, 2.0], "width": -1.0}, "out-of-range", "positive"),
        ({"sigma": np.nan}, "out-of-range", "positive"),
        ({"sigma": 50.0}, "out-of-range", "less than a quarter"),
    ],
)
def test_energies_that_are_none_get_a_sentence(how, code, word):
    with raises(code, word):
        wave_kernel_bank(SPECTRUM, **how)

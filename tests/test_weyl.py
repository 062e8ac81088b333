"""Weyl's law and the three ways to request a part of a spectrum."""

from __future__ import annotations

import math

import pytest
import shapes
from faults import raises

from meshmash_viewer.spectral.weyl import (
    Target,
    Translation,
    wavelength,
    wavelength_eigenvalue,
    weyl_count,
    weyl_eigenvalue,
)


def test_the_law_holds_on_the_sphere():
    below = shapes.sphere_eigenvalues(10_000)
    assert weyl_count(4.0 * math.pi, below[-1]) == pytest.approx(10_000, rel=0.01)


def test_each_function_undoes_the_other():
    assert weyl_count(3.0, weyl_eigenvalue(3.0, 70)) == pytest.approx(70)
    assert wavelength(wavelength_eigenvalue(250.0)) == pytest.approx(250.0)
    assert wavelength(0.0) == math.inf
    # standing wave on a side of a rectangle: cos(2 π x / a) has wavelength a
    assert wavelength(math.pi**2 * (2 / 1.5) ** 2) == pytest.approx(1.5)


def test_targets_translate_into_each_other():
    area = 5.0
    count = Target("count", 60)
    translation = Translation(area)
    value = Target("max_eigenvalue", translation.eigenvalue(count)[0])
    length = Target("wavelength", translation.wavelength(count)[0])
    for target in (count, value, length):
        assert translation.count(target)[0] == 60
        assert translation.eigenvalue(target)[0] == pytest.approx(48 * math.pi)
        assert translation.wavelength(target)[0] == pytest.approx(length.value)
    assert (count.n_components, count.max_eigenvalue) == (60, None)
    assert (length.n_components, length.max_eigenvalue) == (
        None,
        pytest.approx(48 * math.pi),
    )


@pytest.mark.parametrize(
    ("kind", "value", "code", "word"),
    [
        ("count", 0, "out-of-range", "positive"),
        ("count", 2.5, "out-of-range", "whole"),
        ("max_eigenvalue", -1.0, "out-of-range", "largest eigenvalue is -1"),
        ("wavelength", math.inf, "out-of-range", "positive"),
        ("wavelength", math.nan, "out-of-range", "positive"),
        ("wavelength", 1e-250, "out-of-range", "shortest wavelength is 1e-250"),
        ("length", 1.0, "unknown-name", "no target"),
    ],
)
def test_senseless_targets_are_refused(kind, value, code, word):
    with raises(code, word):
        Target(kind, value)


@pytest.mark.parametrize("scale", [1e-6, 7.0, 1e5])
def test_bounds_go_with_the_size_of_the_mesh(scale: float) -> None:
    low, high = Translation(4.0, n_vertices=500).bounds
    scaled = Translation(4.0 * scale**2, n_vertices=500).bounds
    assert low < weyl_eigenvalue(4.0, 1) < weyl_eigenvalue(4.0, 500) < high
    assert scaled == pytest.approx((low / scale**2, high / scale**2))

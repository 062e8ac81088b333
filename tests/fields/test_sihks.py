"""The scale-invariant heat kernel signature, compared with scaled copies and its definition."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from faults import raises
from scipy.integrate import quad
from solved import spectrum_of
from tiers import slow_but

import meshmash_viewer as mv
from meshmash_viewer.fields.sihks import ScaleInvariantHKS, scale_invariant_hks
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


def solved(mesh: Mesh, count: int) -> Eigenpairs:
    return mv.solve(*mv.cotangent_laplacian(mesh), count)


@pytest.mark.parametrize("factor", slow_but([1e6], [1e-9, 0.3, 2.0, 7.7, 1e6]))
def test_a_copy_of_another_size_has_equal_features(rectangle: Mesh, factor: float) -> None:
    here = scale_invariant_hks(solved(rectangle, 60), 6).values
    copy = Mesh(factor * rectangle.vertices, rectangle.faces)
    there = scale_invariant_hks(solved(copy, 60), 6).values
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-9)
    assert np.ptp(here[:, 1]) > 0.05 * here[:, 1].mean(), "they differ between vertices"


def test_values_are_the_integral(rectangle: Mesh) -> None:
    pairs, vertex = solved(rectangle, 40), 77
    values, squares = pairs.eigenvalues, pairs.rows[:, vertex] ** 2

    def derivative(place: float) -> float:
        rate = np.exp(place) * values
        return float(-(rate * np.exp(-rate)) @ squares / (np.exp(-rate) @ squares))

    found = scale_invariant_hks(pairs, 6).values[vertex]
    for at, value in enumerate(found):
        frequency = 2.0 * np.pi * at / (24.0 * np.log(2.0))
        parts = [
            quad(
                lambda x, by=frequency, wave=wave: derivative(x) * wave(by * x), -20, 5, limit=400
            )[0]
            for wave in (np.cos, np.sin)
        ]
        assert value == pytest.approx(np.hypot(*parts), rel=1e-4)


def test_more_frequencies_leave_the_first_ones(rectangle: Mesh) -> None:
    pairs = solved(rectangle, 40)
    few, many = (scale_invariant_hks(pairs, count).values for count in (6, 40))
    np.testing.assert_allclose(many[:, :6], few, rtol=1e-4)


def test_a_row_is_computed_as_the_field_that_is_shown(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    family = ScaleInvariantHKS(index=2).resolved(spectrum, {})
    table = family.prepare(spectrum, None)
    alone, stored = family.compute(spectrum, None), family.compute(spectrum, table)
    np.testing.assert_array_equal(alone.values, stored.values)
    profile = family.profile(spectrum, "nm")
    places, heights = profile.dots.values(spectrum.rows[:60, 77])
    assert places.tolist() == [0, 1, 2, 3, 4, 5]
    assert heights[2] == pytest.approx(alone.values[77], rel=1e-6)
    assert family.describe(spectrum, "nm").unit("nm") == ""


def test_what_it_cannot_be_made_of_is_said() -> None:
    zeros = Eigenpairs(np.zeros(3), np.ones((3, 5)), np.zeros(3))
    with raises("no-nonzero-eigenvalue", "All eigenvalues are zero"):
        ScaleInvariantHKS().columns(zeros)
    pairs = solved(shapes.icosphere(1), 9)
    with raises("conflicting-arguments", "needs the first pair"):
        ScaleInvariantHKS().compute_features(pairs, shapes.icosphere(1), drop_first=True)

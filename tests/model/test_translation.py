from __future__ import annotations

import numpy as np
import pytest
import shapes
from scipy.linalg import eigh

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.weyl import (
    Target,
    Translation,
    resolved_time,
    wavelength,
    weyl_count,
    weyl_eigenvalue,
)

AREA = 4 * np.pi  # of the unit sphere, where Weyl's law counts λ pairs up to λ


def test_without_eigenpairs_it_is_weyls_law() -> None:
    translation = Translation(AREA)
    assert translation.eigenvalue(Target("count", 50)) == (weyl_eigenvalue(AREA, 50), False)
    count, exact = translation.count(Target("max_eigenvalue", 50.0))
    assert count == round(weyl_count(AREA, 50.0))
    assert not exact


def test_no_eigenvalue_lies_beyond_the_bounds() -> None:
    mesh = shapes.icosphere(3)
    low, high = Translation(mesh.area, n_vertices=mesh.n_vertices).bounds
    stiffness, mass = cotangent_laplacian(mesh)
    values = eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
    assert 0.0 < low < values[1]
    assert values[-1] < high < 1e4 * values[-1]
    assert Translation(0.0).bounds[0] < Translation(0.0).bounds[1]


def test_what_is_asked_for_is_exact() -> None:
    translation = Translation(AREA)
    assert translation.count(Target("count", 7)) == (7, True)
    assert translation.eigenvalue(Target("max_eigenvalue", 3.5)) == (3.5, True)
    assert translation.wavelength(Target("wavelength", 0.5)) == (0.5, True)


def test_known_eigenvalues_are_counted() -> None:
    known = shapes.sphere_eigenvalues(36)  # up to l = 5, λ = 30
    translation = Translation(AREA, known)
    assert translation.count(Target("max_eigenvalue", 12.5)) == (16, True)
    assert translation.eigenvalue(Target("count", 16)) == (12.0, True)
    assert translation.wavelength(Target("count", 16)) == (pytest.approx(wavelength(12.0)), True)
    assert translation.time(Target("count", 16)) == (pytest.approx(resolved_time(12.0)), True)
    assert translation.time(Target("time", 0.3)) == (0.3, True)
    assert translation.time(Target("count", 100)) == (pytest.approx(resolved_time(94.0)), False)


def test_beyond_them_weyls_law_goes_on_from_the_last() -> None:
    known = shapes.sphere_eigenvalues(36)
    translation = Translation(AREA, known)
    value, exact = translation.eigenvalue(Target("count", 100))
    assert not exact
    assert value == pytest.approx(30.0 + 64.0)
    count, exact = translation.count(Target("max_eigenvalue", value))
    assert (count, exact) == (100, False)


def test_zeros_have_no_wavelength_and_rounding_no_sign() -> None:
    translation = Translation(AREA, np.array([-1e-19, 2.0]))
    assert translation.eigenvalue(Target("count", 1)) == (0.0, True)
    assert translation.wavelength(Target("count", 1)) == (np.inf, True)


def test_no_more_pairs_than_vertices() -> None:
    translation = Translation(AREA, n_vertices=40)
    assert translation.count(Target("max_eigenvalue", 1e6)) == (40, False)
    assert translation.count(Target("count", 7000)) == (40, True)
    assert translation.eigenvalue(Target("count", 7000)) == (weyl_eigenvalue(AREA, 40), False)
    whole = Translation(AREA, shapes.sphere_eigenvalues(36), n_vertices=36)
    assert whole.count(Target("max_eigenvalue", 1e6)) == (36, True)
    assert whole.eigenvalue(Target("count", 7000)) == (30.0, True)


def test_up_to_a_proven_threshold_the_count_is_exact() -> None:
    known = shapes.sphere_eigenvalues(36)
    translation = Translation(AREA, known, known_to=35.0)
    assert translation.count(Target("max_eigenvalue", 35.0)) == (36, True)
    assert translation.count(Target("max_eigenvalue", 31.0)) == (36, True)
    # beyond, Weyl's law continues from the threshold
    assert translation.count(Target("max_eigenvalue", 40.0)) == (41, False)


def test_the_last_known_eigenvalue_is_a_bound_that_is_known_no_more() -> None:
    known = np.array([0.0, 2.0, 2.0, 2.0, 6.0])
    translation = Translation(AREA, known)
    for bound, count in ((0.5, 1), (2.0, 4), (5.9, 4)):
        assert translation.count(Target("max_eigenvalue", bound)) == (count, True)
    # The last eigenvalue may have more copies than are known.
    assert translation.count(Target("max_eigenvalue", 6.0)) == (5, False)
    assert translation.count(Target("max_eigenvalue", 7.0)) == (6, False)
    assert translation.count(Target("max_eigenvalue", 6.49)) == (5, False)
    assert translation.eigenvalue(Target("count", 5)) == (6.0, True)
    assert translation.eigenvalue(Target("count", 6)) == (pytest.approx(7.0), False)
    assert Translation(AREA).count(Target("max_eigenvalue", 1e-6)) == (1, False)

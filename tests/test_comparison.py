"""Comparison of two shapes: copies, and known spectra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapes
from faults import raises
from tiers import slow_but

from meshmash_viewer.features.comparison import (
    compare_shapes,
    comparison_remarks,
    match_functions,
    unit_area_spectrum,
)
from meshmash_viewer.features.filter_responses import hks_times
from meshmash_viewer.features.filters import bspline_bank, heat_kernel_bank
from meshmash_viewer.features.shape import distinct_matches
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve


def pairs_of(mesh: Mesh, count: int = 60) -> Eigenpairs:
    return solve(*cotangent_laplacian(mesh, robust=True), count)


@pytest.fixture(scope="module")
def blob() -> Mesh:
    return shapes.blob()


@pytest.fixture(scope="module")
def copy(blob: Mesh) -> tuple[Mesh, np.ndarray]:
    return shapes.moved_copy(blob)


BANKS = {
    "wks": lambda values: None,
    "hks": lambda values: heat_kernel_bank(hks_times(values, n_scales=32)),
    "geometry-vectors": lambda values: bspline_bank(0.0, float(values[-1]), 24),
}


@pytest.mark.parametrize("kind", slow_but(list(BANKS)[:1], BANKS))
def test_a_copy_is_at_no_distance_and_matches_itself(
    blob: Mesh, copy: tuple[Mesh, np.ndarray], kind: str
) -> None:
    first, second = pairs_of(blob), pairs_of(copy[0])
    found = compare_shapes(first, second, BANKS[kind](unit_area_spectrum(first)))
    np.testing.assert_allclose(found.spectra[0], found.spectra[1], rtol=1e-6, atol=1e-6)
    assert found.distance < 1e-6 * np.linalg.norm(found.spectra[0])
    assert (found.forth.indices == copy[1]).mean() > 0.99
    assert found.mutual.mean() > 0.99
    assert found.functions.determined.all()
    assert (found.functions.indices == np.arange(60)).all()


def test_swapped_and_flipped_eigenfunctions_are_told(blob: Mesh) -> None:
    pairs = pairs_of(blob, 20)
    rows = pairs.rows[:20].copy()
    order = np.arange(20)
    order[[5, 6, 11, 12]] = 6, 5, 12, 11
    signs = np.where(np.isin(order, [2, 6, 17]), -1.0, 1.0)
    other = replace(pairs, rows=signs[:, None] * rows[order])
    found = match_functions(pairs, other, np.arange(blob.n_vertices))
    np.testing.assert_array_equal(order[found.indices], np.arange(20))
    np.testing.assert_array_equal(found.signs, signs[found.indices])


@pytest.mark.slow
def test_the_distance_of_rectangles_is_the_closed_form() -> None:
    first, second = shapes.rectangle(80, 60, 2.0, 1.5), shapes.rectangle(80, 60, 2.4, 1.25)
    found = compare_shapes(pairs_of(first, 12), pairs_of(second, 12), warn=False)
    wanted = 3.0 * (
        shapes.rectangle_eigenvalues(12, 2.0, 1.5) - shapes.rectangle_eigenvalues(12, 2.4, 1.25)
    )
    assert found.distance == pytest.approx(np.linalg.norm(wanted), rel=0.01)


def test_spheres_of_any_size_are_one_shape() -> None:
    first, second = shapes.icosphere(3), shapes.icosphere(4, radius=7.0)
    found = compare_shapes(pairs_of(first, 16), pairs_of(second, 16), warn=False)
    assert found.distance < 0.02 * np.linalg.norm(found.spectra[0])


def test_spectra_of_nothing_but_zeros_are_at_no_distance(blob: Mesh) -> None:
    pair = pairs_of(blob, 1)
    found = compare_shapes(pair, pair, heat_kernel_bank([1.0]), warn=False)
    assert found.spectra[0].tolist() == pytest.approx([0.0], abs=1e-9)
    zeros = replace(found, spectra=(np.zeros(1), np.zeros(1)), distance=0.0)
    assert zeros.relative_distance == 0.0
    assert replace(zeros, distance=2.0).relative_distance == np.inf


def test_a_match_by_features_alone_that_is_poor_says_how_to_improve_it(blob: Mesh) -> None:
    wide = Mesh(blob.vertices * [1.0, 1.05, 1.1], blob.faces)
    other, place = shapes.moved_copy(wide)
    first, second = pairs_of(blob, 60), pairs_of(other, 60)
    bank = heat_kernel_bank(hks_times(unit_area_spectrum(first)))
    poor, refined = (
        compare_shapes(first, second, bank, refine=refine, meshes=(blob, other))
        for refine in (False, True)
    )
    assert poor.functions.determined.sum() < 10
    (remark,) = comparison_remarks(blob, other, found=poor)
    assert remark.endswith("by features alone: refine the match by ZoomOut.")
    assert refined.functions.determined.sum() > 50, "as the remark promises"
    assert np.mean(refined.forth.indices == place) > 0.94
    assert comparison_remarks(blob, other, found=refined) == []
    left, right = replace(blob, structure="CortexLeft"), replace(other, structure="CortexRight")
    (remark,) = comparison_remarks(left, right, found=poor)
    assert "pin at least three corresponding places on both meshes, and refine" in remark
    (remark,) = comparison_remarks(
        left, right, found=poor, set_landmarks="give --landmark", refine="give --refine"
    )
    assert remark.endswith("without landmarks is unreliable: give --landmark, and give --refine.")
    assert comparison_remarks(left, right, found=refined) == []
    assert comparison_remarks(blob, blob, found=compare_shapes(first, first, bank)) == []


def test_the_next_best_match_is_somewhere_else() -> None:
    places = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    distances = np.array([5.0, 1.0, 0.0, 1.0, 5.0, 9.0, 2.0, 0.5, 2.0, np.nan])
    assert distinct_matches(distances, places, 1.5).tolist() == [2, 7, 0, 4]
    assert distinct_matches(distances, places, 100.0).tolist() == [2]


def test_vertices_that_do_not_exist_are_one_sentence(blob: Mesh) -> None:
    pairs = pairs_of(blob, 5)
    with raises("vertex-out-of-range"):
        match_functions(pairs, pairs, np.full(blob.n_vertices, blob.n_vertices))

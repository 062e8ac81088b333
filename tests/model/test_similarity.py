from __future__ import annotations

import numpy as np
import pytest
import shapes
from solved import spectrum_of

from meshmash_viewer.features.filters import FilterBank, heat_kernel_bank
from meshmash_viewer.features.shape import feature_distance
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields.kernels import distances
from meshmash_viewer.fields.similarity_table import SimilarityTable, build_similarity_table
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.mesh import Mesh


@pytest.fixture(scope="module")
def specked(rectangle: Mesh) -> Mesh:
    """A plate, a vertex of no face, and specks with features thousands of times larger."""
    small = shapes.icosphere(1)
    vertices, faces = [rectangle.vertices, np.full((1, 3), 9.0)], [rectangle.faces]
    n = rectangle.n_vertices + 1
    for at in range(4):
        vertices.append(1e-3 * (2 + at) * small.vertices + [5.0 + at, 0.0, 0.0])
        faces.append(small.faces + n)
        n += small.n_vertices
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


@pytest.fixture(scope="module")
def spectrum(specked: Mesh) -> Spectrum:
    return spectrum_of(specked, 60)


@pytest.fixture(scope="module")
def bank() -> FilterBank:
    return heat_kernel_bank(np.geomspace(0.01, 1.0, 16))


@pytest.fixture(scope="module")
def table(spectrum: Spectrum, bank: FilterBank) -> SimilarityTable:
    return build_similarity_table(spectrum, bank.response)


@pytest.fixture(scope="module")
def features(spectrum: Spectrum, bank: FilterBank) -> np.ndarray:
    rows = spectrum.rows[: len(spectrum)]
    return accumulate_features(spectrum.eigenvalues, rows, bank(spectrum.eigenvalues))


def test_steps_are_within_their_bound_of_the_direct_distance(
    table: SimilarityTable, features: np.ndarray, rectangle: Mesh
) -> None:
    inside = np.setdiff1d(np.arange(rectangle.n_vertices), table.far)
    assert len(inside) > 0.9 * rectangle.n_vertices
    for vertex in inside[::97]:
        found, wanted = table.from_vertex(vertex), feature_distance(features, vertex)
        typical = np.sqrt(np.mean(np.square(wanted[inside])))
        # what the directions that are left out would have added, and what steps add
        assert 0.0 < table.rounding < 2e-3 * typical
        within = table.rounding + 4.0 * table.error * typical
        assert np.abs(found - wanted)[inside].max() <= within
        assert found[vertex] == 0.0


def test_vertices_that_do_not_fit_into_steps_keep_their_distance(
    table: SimilarityTable, features: np.ndarray, rectangle: Mesh
) -> None:
    specks = np.arange(rectangle.n_vertices + 1, len(features))
    assert np.isin(specks, table.far).all()
    for vertex in (0, specks[0], specks[-1]):
        found, wanted = table.from_vertex(vertex), feature_distance(features, vertex)
        assert wanted[specks].max() > 32767 * table.step
        np.testing.assert_allclose(found[specks], wanted[specks], rtol=2e-3, atol=table.rounding)
        assert found[vertex] == 0.0


def test_a_vertex_without_a_face_is_at_no_distance(table: SimilarityTable, rectangle: Mesh) -> None:
    lonely = rectangle.n_vertices
    assert lonely in table.far
    found = table.from_vertex(0)
    assert np.flatnonzero(np.isnan(found)).tolist() == [lonely]
    assert np.isnan(table.from_vertex(lonely)).all()


@pytest.mark.parametrize("n_rows", [1, 2, 3, 4, 5, 11])
@pytest.mark.parametrize("n", [1, 4095, 4097])
def test_the_compiled_distance_is_the_plain_one(n_rows: int, n: int) -> None:
    rng = np.random.default_rng(n_rows)
    coordinates = rng.integers(-32767, 32768, (n_rows, n)).astype(np.int16)
    here = coordinates[:, n // 2].astype(np.float32)
    found = np.full(n, -1.0, dtype=np.float32)
    distances(coordinates, here, np.float32(0.25), found)
    wanted = 0.25 * np.linalg.norm(coordinates - here[:, None].astype(np.float64), axis=0)
    np.testing.assert_allclose(found, wanted, rtol=1e-6)
    assert found[n // 2] == 0.0


def test_a_feature_that_is_the_same_everywhere_tells_no_two_vertices_apart() -> None:
    spectrum = spectrum_of(shapes.icosphere(2), 9)
    table = build_similarity_table(spectrum, lambda values: np.zeros((3, len(values))))
    assert (table.from_vertex(5) == 0.0).all()

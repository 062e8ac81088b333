from __future__ import annotations

import numpy as np
import pytest
import shapes
from solved import spectrum_of

from meshmash_viewer.features.filters import FilterBank, heat_kernel_bank
from meshmash_viewer.features.shape import feature_distance
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields.similarity import SimilarityTable, build_similarity_table
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@pytest.fixture(scope="module")
def specked(rectangle: Mesh) -> Mesh:
    """A plate, a vertex on no face, and debris with features thousands of times larger."""
    small = shapes.icosphere(1)
    vertices, faces = [rectangle.vertices, np.full((1, 3), 9.0)], [rectangle.faces]
    n = rectangle.n_vertices + 1
    for at in range(4):
        vertices.append(1e-3 * (2 + at) * small.vertices + [5.0 + at, 0.0, 0.0])
        faces.append(small.faces + n)
        n += small.n_vertices
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


@pytest.fixture(scope="module")
def spectrum(specked: Mesh) -> Eigenpairs:
    return spectrum_of(specked, 60)


@pytest.fixture(scope="module")
def bank() -> FilterBank:
    return heat_kernel_bank(np.geomspace(0.01, 1.0, 16))


@pytest.fixture(scope="module")
def table(spectrum: Eigenpairs, bank: FilterBank) -> SimilarityTable:
    return build_similarity_table(spectrum, bank.response)


@pytest.fixture(scope="module")
def features(spectrum: Eigenpairs, bank: FilterBank) -> np.ndarray:
    rows = spectrum.rows[: len(spectrum)]
    return accumulate_features(rows, bank(spectrum.eigenvalues))


def test_distances_are_those_in_feature_space_but_for_what_is_left_out(
    table: SimilarityTable, features: np.ndarray, rectangle: Mesh
) -> None:
    body = slice(0, rectangle.n_vertices)
    for vertex in range(0, rectangle.n_vertices, 97):
        found, wanted = table.from_vertex(vertex), feature_distance(features, vertex)
        typical = np.sqrt(np.mean(np.square(wanted[body])))
        within = 4.0 * table.error * typical + 1e-4 * typical
        assert np.abs(found - wanted)[body].max() <= within
        assert found[vertex] == 0.0


def test_specks_with_huge_features_keep_their_distance(
    table: SimilarityTable, features: np.ndarray, rectangle: Mesh
) -> None:
    specks = np.arange(rectangle.n_vertices + 1, len(features))
    for vertex in (0, specks[0], specks[-1]):
        found, wanted = table.from_vertex(vertex), feature_distance(features, vertex)
        assert wanted[specks].max() > 100.0 * np.median(feature_distance(features, 0)[:99])
        np.testing.assert_allclose(found[specks], wanted[specks], rtol=2e-3, atol=2e-3)
        assert found[vertex] == 0.0


def test_a_vertex_without_a_face_is_at_no_distance(table: SimilarityTable, rectangle: Mesh) -> None:
    lonely = rectangle.n_vertices
    found = table.from_vertex(0)
    assert np.flatnonzero(np.isnan(found)).tolist() == [lonely]
    assert np.isnan(table.from_vertex(lonely)).all()


def test_a_feature_that_is_the_same_everywhere_tells_no_two_vertices_apart() -> None:
    spectrum = spectrum_of(shapes.icosphere(2), 9)
    table = build_similarity_table(spectrum, lambda values: np.zeros((3, len(values))))
    assert (table.from_vertex(5) == 0.0).all()

"""Meshes of many equal components, with multiplicities of several hundred."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from scipy import sparse
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from tiers import slow_but

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import solve


def _joined(*meshes):
    """Return all meshes in one, separated, in rows of thirty."""
    starts = np.cumsum([0, *(each.n_vertices for each in meshes)])
    places = [[4.0 * (i % 30), 4.0 * (i // 30), 0.0] for i in range(len(meshes))]
    vertices = [each.vertices + place for each, place in zip(meshes, places, strict=True)]
    faces = [each.faces + start for each, start in zip(meshes, starts[:-1], strict=True)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def _truth(meshes):
    """Return all eigenvalues, from the dense matrices of each component."""
    found = []
    for mesh in meshes:
        stiffness, mass = cotangent_laplacian(mesh)
        found.append(eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True))
    return np.sort(np.concatenate(found))


def _checked(pairs, stiffness, mass):
    """Check residuals, orthonormality and certificate, and return the eigenvalues."""
    weighted = pairs.rows * mass.diagonal()
    defect = stiffness @ pairs.rows.T - weighted.T * pairs.eigenvalues
    sizes = np.maximum(pairs.eigenvalues, 1e-2 * pairs.eigenvalues[-1])
    residuals = np.linalg.norm(defect, axis=0) / np.linalg.norm(weighted, axis=1) / sizes
    assert residuals.max() < 1e-9
    assert np.abs(weighted @ pairs.rows.T - np.eye(len(pairs.rows))).max() < 1e-10
    assert pairs.complete
    assert pairs.verify(stiffness, mass).complete
    return pairs.eigenvalues


def _renumbered(mesh, rng):
    order = rng.permutation(mesh.n_vertices)
    return Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces])


SOLID = shapes.icosphere(0)
TETRAHEDRON = Mesh(
    [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
)
BALL = shapes.icosphere(2)


def _turned(i):
    return Mesh(SOLID.vertices @ Rotation.random(random_state=i).as_matrix(), SOLID.faces)


#: Meshes to be joined, with a generator of random numbers, and the number of pairs.
KINDS = {
    "500 equal": (lambda rng: [SOLID] * 500, 600),
    "of two sizes": (lambda rng: [SOLID, Mesh(2.0 * SOLID.vertices, SOLID.faces)] * 150, 420),
    "turned": (lambda rng: [_turned(i) for i in range(200)], 260),
    "renumbered": (lambda rng: [_renumbered(SOLID, rng) for _ in range(200)], 260),
    "equal but for a millionth": (
        lambda rng: [Mesh(SOLID.vertices + 1e-6 * rng.random((12, 3)), SOLID.faces)
                     for _ in range(200)], 260),
    "with a large one": (lambda rng: [SOLID] * 150 + [shapes.icosphere(3, radius=1.9)], 300),
    "of two kinds": (lambda rng: [TETRAHEDRON] * 300 + [SOLID] * 200, 900),
    "of 162 vertices": (lambda rng: [BALL] * 20, 100),
    "of 162 vertices, renumbered": (lambda rng: [_renumbered(BALL, rng) for _ in range(24)], 60),
}  # fmt: skip


@pytest.mark.parametrize("kind", slow_but(["with a large one"], KINDS))
def test_pairs_of_many_components_of_one_kind(rng, kind):
    make, count = KINDS[kind]
    meshes = make(rng)
    stiffness, mass = cotangent_laplacian(_joined(*meshes))
    eigenvalues = _checked(solve(stiffness, mass, count), stiffness, mass)
    expected = _truth(meshes)[:count]
    np.testing.assert_allclose(eigenvalues, expected, rtol=1e-9, atol=1e-9 * expected[-1])


@pytest.mark.slow
def test_more_copies_than_pairs_are_no_hindrance():
    # A component has a triple eigenvalue: 3,600 copies, of which 100 are requested.
    stiffness, mass = cotangent_laplacian(_joined(*[TETRAHEDRON] * 1200))
    pairs = solve(stiffness, mass, 1300)
    assert (pairs.n_components, pairs.complete) == (1300, True)
    assert np.ptp(pairs.eigenvalues[1200:]) < 1e-12 * pairs.eigenvalues[-1]


@pytest.fixture(scope="module")
def solids():
    stiffness, mass = cotangent_laplacian(_joined(*[SOLID] * 100))
    return stiffness, mass, _truth([SOLID] * 100)


def test_a_threshold_takes_all_copies_or_none(solids):
    stiffness, mass, truth = solids
    multiple = truth[100]
    for threshold, count in ((multiple, 400), (0.999 * multiple, 100), (1.001 * multiple, 400)):
        eigenvalues = solve(stiffness, mass, max_eigenvalue=threshold).eigenvalues
        np.testing.assert_allclose(eigenvalues, truth[:count], atol=1e-9 * multiple)


def test_pairs_around_a_multiple_eigenvalue(solids):
    stiffness, mass, truth = solids
    for shift in (truth[400], 1.2 * truth[400]):
        eigenvalues = solve(stiffness, mass, 40, sigma=shift).eigenvalues
        nearest = np.sort(np.abs(truth - shift))[:40]
        found = np.sort(np.abs(eigenvalues - shift))
        np.testing.assert_allclose(found, nearest, atol=1e-9 * shift)


def test_copies_that_are_known_are_kept_and_others_found(solids):
    stiffness, mass, truth = solids
    fewer = solve(stiffness, mass, 130)
    more = solve(stiffness, mass, 170, known=fewer)
    np.testing.assert_array_equal(more.rows[:130], fewer.rows)
    np.testing.assert_allclose(_checked(more, stiffness, mass), truth[:170], atol=1e-9)


def test_components_on_springs_have_no_null_space(solids):
    stiffness, mass, truth = solids
    tied = sparse.csc_array(stiffness + 0.01 * mass)
    eigenvalues = _checked(solve(tied, mass, 150), tied, mass)
    np.testing.assert_allclose(eigenvalues, truth[:150] + 0.01, rtol=1e-9)

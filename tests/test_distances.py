"""Distances from a vertex, against dense inverses and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from faults import raises
from scipy.linalg import eigh, expm, pinvh
from tiers import slow, slow_but

from meshmash_viewer.features.distances import (
    biharmonic_distance,
    commute_time_distance,
    diffusion_distance,
    distance_features,
    missing_square,
)
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.surface.geodesics import geodesic_distance


def torus() -> Mesh:
    import trimesh

    made = trimesh.creation.torus(3.0, 1.0, 24, 12)
    return Mesh(made.vertices, made.faces)


MESHES = {"sphere": lambda: shapes.icosphere(2), "torus": torus}


def matrices(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return M^-½ L M^-½ and the diagonal of M^-½."""
    L, M = cotangent_laplacian(mesh)
    half = 1.0 / np.sqrt(M.diagonal())
    return half[:, None] * L.toarray() * half, half


def spectrum(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all eigenvalues and eigenvectors."""
    A, half = matrices(mesh)
    values, vectors = eigh(A)
    values[0] = 0.0
    return values, half[:, None] * vectors


def by_measure(
    values: np.ndarray, phi: np.ndarray, vertex: int, time: float
) -> dict[str, np.ndarray]:
    return {
        "biharmonic": biharmonic_distance(values, phi, vertex),
        "commute": commute_time_distance(values, phi, vertex),
        "diffusion": diffusion_distance(values, phi, vertex, time),
    }


def from_kernel(kernel: np.ndarray, vertex: int) -> np.ndarray:
    """Return distances from a vertex for a kernel of inner products."""
    square = kernel[vertex, vertex] + np.diag(kernel) - 2.0 * kernel[vertex]
    return np.sqrt(np.maximum(square, 0.0))


@pytest.mark.parametrize("name", MESHES)
def test_of_all_pairs_they_are_those_of_dense_inverses(name: str) -> None:
    mesh, vertex = MESHES[name](), 7
    A, half = matrices(mesh)
    inverse = pinvh(A)
    scale, kernels = half[:, None] * half, (inverse @ inverse, inverse, expm(-0.6 * A))
    distances = by_measure(*spectrum(mesh), vertex, 0.3).values()
    for found, kernel in zip(distances, kernels, strict=True):
        wanted = from_kernel(scale * kernel, vertex)
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8 * wanted.max())


@pytest.mark.parametrize(("power", "which"), [(1, "biharmonic"), (0, "commute"), (-1, "diffusion")])
def test_they_scale_as_their_units_say(power: int, which: str) -> None:
    mesh = torus()
    larger = Mesh(5.0 * mesh.vertices, mesh.faces)
    found = []
    for each, time in ((mesh, 0.4), (larger, 10.0)):
        found.append(by_measure(*spectrum(each), 3, time)[which])
    np.testing.assert_allclose(found[1], 5.0**power * found[0], rtol=1e-6, atol=1e-9)


def test_other_components_are_at_no_distance() -> None:
    from meshmash_viewer.decompose import decompose_mesh

    mesh = spheres_and_a_stray()
    n = (mesh.n_vertices - 1) // 2
    values, phi = decompose_mesh(mesh, 20)
    found = biharmonic_distance(values, phi, 3)
    assert np.isfinite(found[:n]).all()
    assert np.isnan(found[n:]).all()
    along = geodesic_distance(mesh, 3)
    assert np.isfinite(along[:n]).all()
    assert np.isnan(along[n:]).all()
    assert np.isnan(geodesic_distance(mesh, 2 * n)).all(), "from a vertex of no face"


def test_a_rigid_motion_and_another_order_change_nothing() -> None:
    mesh, rng = torus(), np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    other = Mesh((mesh.vertices @ turn.T + 4.0)[order], place[mesh.faces])
    found = geodesic_distance(other, int(place[9]))
    np.testing.assert_allclose(found, geodesic_distance(mesh, 9)[order], rtol=1e-3, atol=1e-3)


def test_times_and_shapes_are_checked() -> None:
    with raises("wrong-shape"):
        commute_time_distance([0.0, 1.0, 2.0], np.ones((3, 2)), 0)


@pytest.mark.parametrize(
    ("kind", "within"), [slow("biharmonic", 1.6), ("commute", 1.6), slow("diffusion", 1.6)]
)
def test_what_is_missing_is_about_as_expected(kind: str, within: float) -> None:
    mesh, time = shapes.icosphere(3), 0.02
    values, phi = spectrum(mesh)
    kept = 60
    whole, part = (by_measure(values[:k], phi[:, :k], 5, time)[kind] for k in (None, kept))
    missing = np.median(whole**2 - part**2)
    expected = missing_square(kind, values[:kept], mesh.area, mesh.n_vertices, time)
    assert 1.0 / within < expected / missing < within


@pytest.mark.parametrize("measure", ["biharmonic", "commute", "diffusion"])
@pytest.mark.parametrize("name", slow_but(["stray"], ["sphere", "torus", "neck", "stray"]))
def test_of_all_pairs_nothing_is_missing(measure: str, name: str) -> None:
    made = {
        **MESHES,
        "neck": lambda: Mesh(shapes.icosphere(2).vertices ** 3, shapes.icosphere(2).faces),
        "stray": spheres_and_a_stray,
    }
    mesh = made[name]()
    L, M = cotangent_laplacian(mesh)
    n = int(np.count_nonzero(M.diagonal()))
    for count in (n, n + 5, n - 1):
        pairs = solve(L, M, count)
        found = distance_features(mesh, [0, 1], measure, pairs, 1e-4 * mesh.area)
        assert found.missing == ""
        shares = np.array(found.meta["missing_shares"])
        assert (shares == 0.0).all() if count >= n else (shares < 1e-2).all()


def spheres_and_a_stray() -> Mesh:
    one = shapes.icosphere(2)
    return shapes.together(one, shapes.moved(one, 5.0), np.full((1, 3), 9.0), unit="nm")


@pytest.mark.parametrize("measure", ["geodesic", "biharmonic", "commute", "diffusion"])
def test_columns_are_the_distances_from_each_vertex(measure: str) -> None:
    mesh = spheres_and_a_stray()
    n = mesh.n_vertices // 2
    L, M = cotangent_laplacian(mesh)
    pairs = solve(L, M, 40)
    given = () if measure == "geodesic" else (pairs, 0.3 if measure == "diffusion" else None)
    found = distance_features(mesh, [3, n + 5], measure, *given)
    assert found.columns == (f"{measure}_from_3", f"{measure}_from_{n + 5}")
    assert found.values[3, 0] == found.values[n + 5, 1] == 0.0
    elsewhere = np.isnan(found.values)
    assert elsewhere[n:, 0].all()
    assert not elsewhere[:n, 0].any()
    assert elsewhere[:n, 1].all()
    assert not elsewhere[n:-1, 1].any(), "the last vertex belongs to no face"
    spectral = by_measure(pairs.eigenvalues, pairs.eigenvectors, 3, 0.3)
    wanted = {"geodesic": geodesic_distance(mesh, 3), **spectral}[measure]
    np.testing.assert_allclose(found.values[:n, 0], wanted[:n], rtol=1e-9)
    unit = {"geodesic": "nm", "biharmonic": "nm", "commute": "", "diffusion": "nm⁻¹"}[measure]
    assert (found.unit, found.meta["vertices"]) == (unit, [3, n + 5])


@pytest.mark.parametrize(
    ("vertices", "options", "code", "word"),
    [
        (-1, {}, "vertex-out-of-range", "no vertex -1"),
        (325, {}, "vertex-out-of-range", "no vertex 325"),
        (324, {}, "vertex-unused", "belongs to no face"),
        ([3, 3], {}, "no-vertices", "each once"),
        ([], {}, "no-vertices", "one or more"),
        (3, {"measure": "walk"}, "unknown-name", "no distance 'walk'"),
        (3, {"measure": "commute"}, "no-eigenpairs", "needs pairs"),
        (3, {"measure": "diffusion", "decomposition": "pairs"}, "out-of-range", "time is None"),
        (
            3,
            {"measure": "diffusion", "decomposition": "pairs", "time": 0},
            "out-of-range",
            "time is 0",
        ),
    ],
)
def test_what_there_is_no_distance_from_is_said(
    vertices: object, options: dict[str, object], code: str, word: str
) -> None:
    with raises(code, word) as told:
        distance_features(spheres_and_a_stray(), vertices, **options)
    assert str(told.value).endswith(".")

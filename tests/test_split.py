"""Split, apply, stitch."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import shapes
from faults import raises
from tiers import slow, slow_but

from meshmash_viewer.decompose import compute_hks, spectral_geometry_filter
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.split.partition import Piece, edge_graph, interior_depth
from meshmash_viewer.split.piece_features import PieceFeatures
from meshmash_viewer.split.stitcher import MeshStitcher, PieceError


def coordinates(piece: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    return piece[0]


def heat_kernel(piece: Any, times: np.ndarray) -> np.ndarray:
    """Return the diagonal of the heat kernel from all dense eigenpairs."""
    stiffness, mass = cotangent_laplacian(piece)
    root = np.sqrt(mass.diagonal())
    values, vectors = scipy.linalg.eigh(stiffness.toarray() / np.outer(root, root))
    return (vectors / root[:, None]) ** 2 @ np.exp(-np.outer(values, times))


@pytest.fixture(scope="module")
def fine_sphere() -> Mesh:
    return shapes.icosphere(4)


@pytest.mark.parametrize("threshold", slow_but([333, 100_000], [40, 333, 1000, 100_000]))
@pytest.mark.parametrize("overlap", slow_but([0.15], [0.0, 0.15, 1.0]))
@pytest.mark.parametrize("name", ["fine_sphere", "neuron", "rectangle", "three_spheres"])
def test_pieces_are_small_and_the_identity_is_exact(
    name: str, overlap: float, threshold: int, request: pytest.FixtureRequest
) -> None:
    mesh: Mesh = request.getfixturevalue(name)
    stitcher = MeshStitcher(mesh, n_jobs=1)
    stitcher.split_mesh(threshold, overlap=overlap)

    assert max(len(piece) for piece in stitcher.pieces) <= threshold
    found = stitcher.apply(coordinates)
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found[mesh.referenced], mesh.vertices[mesh.referenced])
    assert np.isnan(found[~mesh.referenced]).all()


@pytest.mark.parametrize("overlap", [0.5, 2.0])
def test_an_overlap_that_would_fill_a_piece_becomes_narrower(
    fine_sphere: Mesh, overlap: float
) -> None:
    stitcher = MeshStitcher(fine_sphere)
    stitcher.split_mesh(300, overlap=overlap)
    sizes = [len(piece) for piece in stitcher.pieces]
    assert max(sizes) <= 300
    # A core is halved only while it is larger than a quarter of a piece.
    assert len(sizes) <= fine_sphere.n_vertices / (0.125 * 300)
    assert min(sizes) == 300


def test_a_piece_is_in_one_part_and_its_faces_in_the_order_of_the_mesh(fine_sphere: Mesh) -> None:
    stitcher = MeshStitcher(fine_sphere)
    stitcher.split_mesh(333, overlap=0.0)
    for number, piece in enumerate(stitcher.pieces):
        faces = stitcher[number][1]
        assert Mesh(fine_sphere.vertices[piece], faces).n_components == 1
        inside = np.isin(fine_sphere.faces, piece).all(axis=1)
        np.testing.assert_array_equal(piece[faces], fine_sphere.faces[inside])


def test_every_face_around_an_owned_vertex_is_in_its_piece(fine_sphere: Mesh) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=1)
    stitcher.split_mesh(300, overlap=0.0)

    def faces_around(piece: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return np.bincount(piece[1].ravel(), minlength=len(piece[0]))

    whole = faces_around((fine_sphere.vertices, fine_sphere.faces))
    np.testing.assert_array_equal(stitcher.apply(faces_around), whole)


def test_each_vertex_takes_the_value_of_the_piece_it_is_deepest_in(fine_sphere: Mesh) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=1)
    stitcher.split_mesh(700)
    graph = edge_graph(fine_sphere)
    depths = np.full((len(stitcher.pieces), fine_sphere.n_vertices), -1.0)
    for number, piece in enumerate(stitcher.pieces):
        depths[number, piece] = interior_depth(graph, piece)
    assert (np.count_nonzero(depths >= 0, axis=0) > 1).any()

    count = iter(range(len(stitcher.pieces)))
    owner = stitcher.apply(lambda piece: np.full(len(piece[0]), next(count)))
    chosen = depths[owner, np.arange(fine_sphere.n_vertices)]
    np.testing.assert_array_equal(chosen, depths.max(axis=0))
    assert chosen.min() > 0.0


def test_vertices_at_one_place_are_neighbours_still() -> None:
    # Two halves of a strip, joined by faces with coincident corners and edges of length zero.
    flat = shapes.rectangle(9, 5)
    seam = np.isclose(flat.vertices[:, 0], np.unique(flat.vertices[:, 0])[4])
    a, b = np.flatnonzero(seam)[:2]
    vertices = flat.vertices.copy()
    vertices[b] = vertices[a]
    mesh = Mesh(vertices, flat.faces)
    graph = edge_graph(mesh)
    assert graph[a, b] > 0.0
    assert graph[a, b] == graph[b, a] < 1e-6 * graph.max()
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = np.unique(sides, axis=0)
    assert graph.nnz == 2 * len(edges)
    # Vertices beyond the seam are reached across it, so depths are finite.
    members = np.flatnonzero(vertices[:, 0] > vertices[:, 0].min() + 1e-9)
    assert np.isfinite(interior_depth(graph, members)).all()


def test_components_are_whole_and_share_pieces(three_spheres: Mesh) -> None:
    stitcher = MeshStitcher(three_spheres, n_jobs=1)
    stitcher.split_mesh(330)
    assert sorted(len(piece) for piece in stitcher.pieces) == [162, 324]
    for piece in stitcher.pieces:
        counts = np.bincount(three_spheres.component_labels[piece])
        assert set(counts) <= {0, 162}


def test_a_long_tube_is_cut_across() -> None:
    line = np.linspace(0.0, 100.0, 400)
    path = np.stack([line, 3.0 * np.sin(line / 9.0), np.zeros(400)], axis=1)
    mesh = Mesh(*shapes.tube(path, np.full((400, 12), 1.0), around=12))
    stitcher = MeshStitcher(mesh, n_jobs=1)
    stitcher.split_mesh(600)
    total = sum(len(piece) for piece in stitcher.pieces)
    assert total < 1.5 * mesh.n_vertices
    for piece in stitcher.pieces:
        # A piece is contiguous along the tube: no ring of vertices is missing within it.
        along = np.sort(mesh.vertices[piece, 0])
        assert np.diff(along).max() < 1.0


def test_the_same_every_time_and_at_every_scale(neuron: Mesh) -> None:
    pieces = []
    for factor in (1.0, 1.0, 2.0**-30):
        stitcher = MeshStitcher((neuron.vertices * factor, neuron.faces), n_jobs=1)
        stitcher.split_mesh(300)
        pieces.append(stitcher.pieces)
    for other in pieces[1:]:
        assert len(other) == len(pieces[0])
        for a, b in zip(pieces[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_renumbered_vertices_get_the_same_values(neuron: Mesh, rng: np.random.Generator) -> None:
    order = rng.permutation(neuron.n_vertices)
    rank = np.argsort(order)
    stitcher = MeshStitcher((neuron.vertices[order], rank[neuron.faces]), n_jobs=1)
    stitcher.split_mesh(250)
    used = neuron.referenced
    np.testing.assert_array_equal(stitcher.apply(coordinates)[rank][used], neuron.vertices[used])


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_a_failure_names_the_piece(sphere: Mesh, n_jobs: int) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=n_jobs)
    stitcher.split_mesh(150)
    assert len(stitcher.pieces) > 4
    third = len(stitcher.pieces[2])
    corner = stitcher[2][0][0]

    def fails(piece: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return 1 / 0 if (piece[0][0] == corner).all() else piece[0]

    seen: list[Progress] = []
    with pytest.raises(
        PieceError, match=rf"piece 3 of \d+ \({third} .*ZeroDivisionError"
    ) as caught:
        stitcher.apply(lambda piece: fails(piece), progress=seen.append)
    assert "in fails" in caught.value.__notes__[0]
    assert len(seen) == 2, "two pieces were done"


def test_one_blas_thread_each(sphere: Mesh) -> None:
    from threadpoolctl import threadpool_info

    stitcher = MeshStitcher(sphere, n_jobs=2)
    stitcher.split_mesh(400)
    for pools in stitcher.apply(
        lambda piece: [pool["num_threads"] for pool in threadpool_info()], stitch=False
    ):
        assert set(pools) <= {1}


def test_one_and_two_dimensions_and_types(sphere: Mesh, neuron: Mesh) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1)
    stitcher.split_mesh(300)
    flat = stitcher.apply(lambda piece: piece[0][:, 0].astype(np.float32))
    assert flat.shape == (sphere.n_vertices,)
    assert flat.dtype == np.float32
    whole = stitcher.apply(lambda piece: np.ones((len(piece[0]), 3), dtype=np.int32))
    assert whole.shape == (sphere.n_vertices, 3)
    assert whole.dtype == np.int32

    assert not neuron.referenced.all()
    stitcher = MeshStitcher(neuron, n_jobs=1)
    # Vertices without a value get NaN, neither 0 nor True.
    for dtype in (np.int32, np.uint8, np.bool_, np.float32, np.complex64):
        marked = stitcher.apply(lambda piece, dtype=dtype: np.ones(len(piece[0]), dtype=dtype))
        np.testing.assert_array_equal(np.isnan(marked), ~neuron.referenced)
        np.testing.assert_array_equal(marked[neuron.referenced], 1)
    whole_ones = MeshStitcher(sphere, n_jobs=1).apply(lambda piece: piece[0][:, 0] > 0.0)
    assert whole_ones.dtype == np.bool_
    np.testing.assert_array_equal(whole_ones, sphere.vertices[:, 0] > 0.0)


def test_progress_and_cancel(sphere: Mesh) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1)
    stitcher.split_mesh(300)
    seen: list[Progress] = []
    stitcher.apply(coordinates, progress=seen.append)
    assert [report.fraction for report in seen] == [
        (i + 1) / len(stitcher.pieces) for i in range(len(stitcher.pieces))
    ]
    seen.clear()
    for n_jobs in (1, 2):
        stitcher.n_jobs = n_jobs
        with pytest.raises(Cancelled):
            # A lambda, because the workers cannot import a test.
            stitcher.apply(
                lambda piece: piece[0], progress=seen.append, cancel=lambda: len(seen) >= 1
            )
        assert 1 <= len(seen) < len(stitcher.pieces)
        seen.clear()


@pytest.mark.parametrize(
    ("returned", "code"),
    [
        (lambda piece: 1.0, "wrong-shape"),
        (lambda piece: piece[0][1:], "wrong-shape"),
        (lambda piece: piece[0][:, : 1 + len(piece[0]) % 2], "wrong-shape"),
        (lambda piece: np.full(len(piece[0]), "a"), "wrong-type"),
    ],
)
def test_what_cannot_be_stitched_is_named(sphere: Mesh, returned: Any, code: str) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1)
    stitcher.split_mesh(301)
    assert len({len(piece) % 2 for piece in stitcher.pieces}) == 2
    with raises(code):
        stitcher.apply(returned)


def test_bad_requests_are_named(sphere: Mesh) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1)
    with raises("piece-too-small", "max_vertex_threshold=2 "):
        stitcher.split_mesh(2)
    with raises("piece-too-small", "has 6 neighbours"):
        stitcher.split_mesh(5)
    with raises("out-of-range", "overlap=-1"):
        stitcher.split_mesh(100, overlap=-1.0)
    with raises("out-of-range", "n_jobs must not be 0"):
        MeshStitcher(sphere, n_jobs=0)
    with raises("conflicting-arguments"):
        stitcher.split_mesh(100, overlap_distance=1.0, t_max=1.0)
    for name in ("overlap_distance", "t_max"):
        for width in (-1.0, math.nan, math.inf, "20 µm"):
            with raises("out-of-range", f"{name}={width!r} is not a width"):
                stitcher.split_mesh(100, **{name: width})
    with raises("missing-argument"):
        stitcher.split_mesh(100, max_overlap_neighbors=10)
    with raises("wrong-type"):
        MeshStitcher(sphere, True)
    stitcher.split_mesh(300)
    with raises("wrong-type"):
        stitcher.apply(coordinates, 0.5)
    with raises("counts-differ", "1 results do not match"):
        stitcher.stitch_features([np.zeros(3)])
    with raises("no-values"):
        stitcher.apply(lambda piece: None)
    with raises("vertex-out-of-range", "from 0 to 641"):
        stitcher.subset_apply(coordinates, [642])
    with raises("wrong-shape", "shape (5, 2) do not match 642 vertices"):
        stitcher.apply_on_features(lambda piece, rows: rows, np.ones((5, 2)))


def test_a_stitcher_is_the_sequence_of_its_pieces(neuron: Mesh) -> None:
    stitcher = MeshStitcher(neuron, n_jobs=1)
    assert len(stitcher) == 0
    submeshes = stitcher.split_mesh(max_vertex_threshold=300)
    assert submeshes is stitcher
    assert len(submeshes) == len(stitcher.pieces) == len(stitcher.submeshes) > 2
    owners = stitcher.submesh_mapping
    np.testing.assert_array_equal(owners >= 0, neuron.referenced)
    assert set(owners[owners >= 0]) == set(range(len(stitcher)))
    for number, (vertices, faces) in enumerate(submeshes):
        indices = stitcher.submesh_overlap_indices[number]
        np.testing.assert_array_equal(vertices, neuron.vertices[indices])
        np.testing.assert_array_equal(faces, stitcher[number][1])
        assert Mesh(vertices, faces).referenced.all()
        assert np.isin(np.flatnonzero(owners == number), indices).all()
    np.testing.assert_array_equal(stitcher[-1][0], stitcher[len(stitcher) - 1][0])
    with pytest.raises(IndexError):
        stitcher[len(stitcher)]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_an_overlap_in_units_of_length_is_kept_whole(fine_sphere: Mesh, scale: float) -> None:
    mesh = Mesh(scale * fine_sphere.vertices, fine_sphere.faces)
    stitcher = MeshStitcher(mesh).split_mesh(300, overlap_distance=0.3 * scale)
    graph = edge_graph(mesh)
    longest = graph.data.max()
    for number, piece in enumerate(stitcher.pieces):
        depth = interior_depth(graph, piece)
        owned = stitcher.submesh_mapping[piece] == number
        # The whole overlap lies between a core and the cut of its piece.
        assert depth[owned].min() > 0.3 * scale - longest
    assert max(map(len, stitcher.pieces)) > 300, "the overlap comes on top"
    assert np.bincount(stitcher.submesh_mapping).max() < 600


def test_the_overlap_may_be_limited_in_vertices(fine_sphere: Mesh) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=1)
    free = stitcher.split_mesh(300, overlap_distance=0.5)
    widest = max(map(len, free.pieces))
    limited = stitcher.split_mesh(300, overlap_distance=0.5, max_overlap_neighbors=150)
    assert max(map(len, limited.pieces)) <= 450 < widest
    np.testing.assert_array_equal(limited.apply(coordinates), fine_sphere.vertices)
    # Neighbours of a core are always in its piece.
    one_ring = stitcher.split_mesh(300, overlap_distance=0.5, max_overlap_neighbors=0)
    np.testing.assert_array_equal(one_ring.apply(coordinates), fine_sphere.vertices)
    (whole,) = stitcher.split_mesh(None)
    np.testing.assert_array_equal(whole[1], fine_sphere.faces)


@pytest.mark.parametrize("scale", [slow(1.0), 1e-3])
def test_the_overlap_follows_the_longest_time(sphere: Mesh, scale: float) -> None:
    times = np.array([0.02, 0.05]) * scale**2
    mesh = Mesh(scale * sphere.vertices, sphere.faces)
    whole = heat_kernel(mesh, times)
    stitcher = MeshStitcher(mesh, n_jobs=1).split_mesh(160, t_max=times[-1])
    results = stitcher.apply(heat_kernel, stitch=False, times=times)
    found = stitcher.stitch_features(results)
    assert np.abs(found / whole - 1.0).max() < 1e-3
    seams = stitcher.seams(results)
    assert len(seams) > 100
    assert seams.max() < 1e-2


def test_small_components_are_left_out_and_filled(three_spheres: Mesh) -> None:
    small = shapes.icosphere(0)
    mesh = shapes.together(shapes.moved(small, 99.0), three_spheres)
    stitcher = MeshStitcher(mesh, n_jobs=1)
    for options in ({}, {"overlap_distance": 0.2}):
        stitcher.split_mesh(200, min_vertex_threshold=100, **options)
        np.testing.assert_array_equal(stitcher.submesh_mapping < 0, np.arange(498) < 12)
        counts = stitcher.apply(lambda piece: np.full(len(piece[0]), 7), fill_value=-1)
        assert (counts.dtype.kind, counts[0], counts[12]) == ("i", -1, 7)
        heights = stitcher.apply(lambda piece: piece[0][:, 2].astype(np.float32))
        assert heights.dtype == np.float32
        np.testing.assert_array_equal(np.isnan(heights), np.arange(498) < 12)
    with raises("no-components"):
        stitcher.split_mesh(200, min_vertex_threshold=163)
    with raises("vertex-unused"):
        stitcher.subset_apply(coordinates, [3, 5])


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_arguments_go_on_to_the_function(fine_sphere: Mesh, n_jobs: int) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=n_jobs).split_mesh(1200)
    assert len(stitcher) > 1
    found = stitcher.apply(
        lambda piece, axis, scale=1.0: scale * piece[0][:, axis], axis=1, scale=2
    )
    np.testing.assert_array_equal(found, 2.0 * fine_sphere.vertices[:, 1])
    rows = fine_sphere.vertices[:, :2]
    found = stitcher.apply_on_features(
        lambda piece, own, shift: piece[0][:, :2] - own + shift, rows, shift=3
    )
    np.testing.assert_array_equal(found, np.full((fine_sphere.n_vertices, 2), 3.0))


def test_pieces_of_some_vertices_only(fine_sphere: Mesh) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=1).split_mesh(300)
    calls: list[int] = []

    def heights(piece: Any) -> np.ndarray:
        calls.append(len(piece[0]))
        return piece[0][:, 2]

    wanted = np.flatnonzero(fine_sphere.vertices[:, 2] > 0.95)
    found = stitcher.subset_apply(heights, wanted, reindex=True)
    np.testing.assert_array_equal(found, fine_sphere.vertices[wanted, 2])
    assert len(calls) < len(stitcher)
    mask = np.isin(np.arange(fine_sphere.n_vertices), wanted)
    everywhere = stitcher.subset_apply(heights, mask, fill_value=-9.0)
    np.testing.assert_array_equal(everywhere[wanted], found)
    kept = np.isin(stitcher.submesh_mapping, stitcher.submesh_mapping[wanted])
    np.testing.assert_array_equal(everywhere != -9.0, kept)
    half = [None if number % 2 else vertices[:, 2] for number, (vertices, _) in enumerate(stitcher)]
    np.testing.assert_array_equal(
        np.isnan(stitcher.stitch_features(half)), stitcher.submesh_mapping % 2 == 1
    )


def test_a_piece_without_values_has_no_seams(fine_sphere: Mesh) -> None:
    def heights(piece: Any, t_max: float) -> np.ndarray | None:
        return None if piece[0][:, 2].max() > 0.9 else piece[0][:, 2]

    stitcher = MeshStitcher(fine_sphere, n_jobs=1).split_mesh(300, t_max=0.01)
    found = stitcher.apply(heights, t_max=0.01)
    known = np.isfinite(found)
    assert 0 < np.count_nonzero(known) < fine_sphere.n_vertices
    np.testing.assert_array_equal(found[known], fine_sphere.vertices[known, 2])
    results = stitcher.apply(heights, stitch=False, t_max=0.01)
    assert any(each is None for each in results)
    seams = stitcher.seams(results)
    assert len(seams) > 0
    assert (seams == 0.0).all()


def test_verbose_says_how_it_goes(fine_sphere: Mesh, capfd: pytest.CaptureFixture[str]) -> None:
    stitcher = MeshStitcher(fine_sphere, n_jobs=1, verbose=True).split_mesh(700)
    assert capfd.readouterr().err == (
        f"{len(stitcher)} pieces of at most {max(map(len, stitcher.pieces))} vertices\n"
    )
    stitcher.apply(coordinates)
    assert f"{len(stitcher)} of {len(stitcher)} pieces" in capfd.readouterr().err
    MeshStitcher(fine_sphere, n_jobs=1).split_mesh(700).apply(coordinates)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("n_jobs", slow_but([1], [1, 2]))
def test_the_first_pair_left_out_is_that_of_the_whole(three_spheres: Mesh, n_jobs: int) -> None:
    """Its share is 1 / area of the component, which is less than 1 / area of a piece."""
    options = {"max_eigenvalue": 400.0, "drop_first": True}
    times = {"t_min": 0.02, "t_max": 0.05, "n_components": 3}
    stitcher = MeshStitcher(three_spheres, n_jobs=n_jobs).split_mesh(60, t_max=0.05)
    assert len(stitcher) > 5
    whole = compute_hks(three_spheres, **options, **times)
    found = stitcher.apply(compute_hks, **options, **times)
    np.testing.assert_allclose(found, whole, rtol=0.02)
    low = {"filter": lambda values: np.exp(-0.05 * values), **options}
    found = stitcher.apply(spectral_geometry_filter, **low)
    np.testing.assert_allclose(found, whole[:, 2:], rtol=0.02)


def small_features() -> PieceFeatures:
    """Return two columns of HKS."""
    bank = heat_kernel_bank(np.array([0.02, 0.05]))
    return PieceFeatures(OperatorOptions(), 300.0, bank, drop_first=False)


def test_features_are_combined_as_they_come(sphere: Mesh) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1).split_mesh(160, t_max=0.05)
    task, alive = small_features(), []

    def computed(piece: Piece) -> np.ndarray:
        assert sum(each() is not None for each in alive) <= 1, "earlier results are kept"
        rows = task(piece)
        alive.append(weakref.ref(rows))
        return rows

    combined = stitcher.stitching()
    for number, rows in stitcher.each(computed):
        combined.add(number, rows[:, :2])
        del rows
    assert len(alive) == len(stitcher) > 2
    results = [task(piece)[:, :2] for piece in stitcher]
    found = task.on(stitcher)
    for values in (combined.values(), found.values):
        np.testing.assert_array_equal(values, stitcher.stitch_features(results))
    np.testing.assert_array_equal(found.seams, stitcher.seams(results))


def test_as_many_processes_as_fit_into_memory(
    sphere: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, seen = small_features(), []
    alone = task.on(MeshStitcher(sphere, n_jobs=1).split_mesh(300, t_max=0.05))
    stitcher = MeshStitcher(sphere, n_jobs=2).split_mesh(300, t_max=0.05)
    monkeypatch.setattr("meshmash_viewer.split.piece_features.free_memory", lambda: 10**6)
    found = task.on(stitcher, progress=lambda each: seen.append(each.message))
    n = len(stitcher)
    assert seen[-1] == f"{n} of {n} pieces, 1 at a time for want of memory"
    np.testing.assert_array_equal(found.values, alone.values)


def test_a_failure_of_the_caller_starts_no_further_piece(sphere: Mesh) -> None:
    stitcher = MeshStitcher(sphere, n_jobs=1).split_mesh(150)
    calls: list[int] = []

    def take() -> None:
        for _ in stitcher.each(lambda piece: calls.append(1)):
            raise ValueError("no room")

    with pytest.raises(ValueError, match="no room"):
        take()
    assert len(calls) <= 2 < len(stitcher)


def test_the_graph_of_edges_has_each_edge_once(three_spheres: Mesh) -> None:
    faces = np.concatenate([three_spheres.faces, [[0, 0, 200]]])  # degenerate, so no edge
    mesh = Mesh(three_spheres.vertices, faces)
    graph = edge_graph(mesh)
    pairs = three_spheres.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    np.testing.assert_array_equal(np.stack(graph.tocoo().coords, axis=1), pairs)
    lengths = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    np.testing.assert_array_equal(graph.data, lengths)

"""Named problems that the eigensolver once solved wrongly.

`EXAMPLES` maps each name to a function that yields problems with their requests. Most problems are
large enough for the solver to slice the spectrum by default.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse as sp
import shapes
from hard_requests import Request
from hard_spectra import (
    Problem,
    globe,
    graph_laplacian,
    grid_edges,
    honeycomb_edges,
    joined,
    matrices_of,
    triangulation,
)

from meshmash_viewer.mesh import Mesh

__all__ = ["EXAMPLES"]

Examples = Iterator[tuple[Problem, Request]]
EXAMPLES: dict[str, Callable[[], Examples]] = {}


def example(name: str) -> Callable[[Callable[[], Examples]], Callable[[], Examples]]:
    """Register a function as an example."""

    def enter(make: Callable[[], Examples]) -> Callable[[], Examples]:
        EXAMPLES[name] = make
        return make

    return enter


def _graph(name: str, edges: np.ndarray, weights: np.ndarray | float = 1.0) -> Problem:
    n = int(edges.max()) + 1
    return Problem(name, name, graph_laplacian(n, edges, weights), np.ones(n))


def _of_mesh(name: str, mesh: Mesh, robust: bool = True) -> Problem:
    stiffness, mass = matrices_of(mesh, robust)
    return Problem(name, name, stiffness, mass)


@example("integer thresholds on a periodic grid")
def _periodic_grid() -> Examples:
    problem = _graph("periodic grid 30 × 40", grid_edges(30, 40, True))
    for threshold in (1.0, 2.0, 3.0, 4.0, 5.0):
        yield problem, Request("threshold on an integer", threshold=threshold, entry="bands")


@example("integer thresholds on other graphs")
def _graphs() -> Examples:
    path = np.stack([np.arange(999), np.arange(1, 1000)], axis=1)
    weights = np.random.default_rng(0).integers(1, 4, len(grid_edges(30, 40))).astype(float)
    for problem in (
        _graph("honeycomb 30 × 40", honeycomb_edges(30, 40)),
        _graph("path of 1000", path),
        _graph("weighted grid 30 × 40", grid_edges(30, 40), weights),
    ):
        for threshold in (1.0, 2.0, 3.0):
            yield problem, Request("threshold on an integer", threshold=threshold)


@example("HKS of a plane of unit cells")
def _plane() -> Examples:
    import pyvista

    plane = pyvista.Plane(i_size=30, j_size=30, i_resolution=30, j_resolution=30).triangulate()
    mesh = Mesh(np.asarray(plane.points, dtype=np.float64), plane.faces.reshape(-1, 4)[:, 1:])
    yield (
        _of_mesh("plane of 30 × 30 unit cells", mesh),
        Request("threshold on an integer", threshold=2.0, entry="hks"),
    )


@example("threshold on a diagonal entry")
def _diagonal() -> Examples:
    mesh = triangulation(np.random.default_rng(4).random((900, 2)))
    problem = _of_mesh("random flat mesh of 900", mesh)
    entries = problem.stiffness.diagonal() / problem.mass
    # the lowest entry, and four with a zero pivot
    for vertex in (int(np.argmin(entries)), 636, 146, 584, 845):
        yield problem, Request("threshold on a diagonal entry", threshold=float(entries[vertex]))


@example("threshold between copies of a multiple eigenvalue")
def _icosahedra() -> Examples:
    import trimesh

    solid = trimesh.creation.icosahedron()
    corners, faces = np.array(solid.vertices), np.array(solid.faces)
    solids = [
        Mesh(corners * (1 + 0.03 * i) + [4 * i * (1 + 0.03 * i), 0, 0], faces) for i in range(59)
    ]
    for robust in (False, True):
        problem = _of_mesh("59 icosahedra", joined(solids), robust)
        yield problem, Request("threshold between copies", threshold=0.5911739745509992)


@example("threshold on each eigenvalue of a torus")
def _torus() -> Examples:
    import trimesh

    torus = trimesh.creation.torus(3, 1, 40, 24)
    problem = _of_mesh("torus of 960", Mesh(np.array(torus.vertices), np.array(torus.faces)))
    for count in range(1, 67):
        yield problem, Request("threshold as solved", count=count, own_threshold=True)


@example("thresholds and shifts above the spectrum")
def _above() -> Examples:
    problem = _of_mesh("sphere of 994", globe(31, 32))
    top = 1.1 * float(np.abs(problem.stiffness).sum(axis=1).max() / problem.mass.min())
    for threshold in (top, 1e3 * top, 1e300):
        yield problem, Request("threshold above all", threshold=threshold)
    yield problem, Request("threshold above all", threshold=1e3 * top, entry="hks")
    for sigma in (top, 1e3 * top, 1e300):
        yield problem, Request("sigma above all", count=5, sigma=sigma)


@example("threshold above the spectrum of a sphere of 2,562 vertices")
def _above_large() -> Examples:
    problem = _of_mesh("icosphere of 2562", shapes.icosphere(4))
    largest = 5177.0
    yield problem, Request("threshold above all", threshold=1.5 * largest)


@example("false zeros on a grid")
def _false_zeros() -> Examples:
    grid = graph_laplacian(1600, grid_edges(40, 40))
    ones = np.ones(1600)

    def problem(factor: float, edges: list[list[int]], c: float) -> Problem:
        stiffness = grid + factor * graph_laplacian(1600, edges) + c * sp.eye_array(1600)
        note = f"grid 40 × 40, {len(edges)} edges of {factor:g}, + {c:g} M"
        return Problem("false zeros", note, sp.csr_array(stiffness), ones)

    request = Request("count", count=6)
    for c in (3e-8, 1e-5, 1e-2):
        yield problem(1e6, [[820, 821]], c), request
    yield problem(1e6, [[820, 821], [100, 140]], 1e-4), request
    yield problem(0.0, [[0, 1]], 3e-8), request
    yield problem(1e8, [[820, 821]], 1.0), request


@example("ten pairs of 8,000 loose triangles")
def _loose_triangles() -> Examples:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.8, 0.0]])
    stiffness, mass = matrices_of(Mesh(corners, np.array([[0, 1, 2]])))
    many = sp.csr_array(sp.block_diag([stiffness] * 8000))
    problem = Problem("triangles", "8000 loose triangles", many, np.tile(mass, 8000))
    # The constants of all components would take 1.5 GB.
    yield problem, Request("count", count=10, most_memory=200e6)


@example("orthonormality of slivers")
def _slivers() -> Examples:
    for seed, flatness in ((1, 1e-5), (1, 1e-6), (2, 1e-5), (2, 1e-6)):
        mesh = triangulation(np.random.default_rng(seed).random((500, 2)))
        mesh = Mesh(mesh.vertices * [1.0, flatness, 1.0], mesh.faces)
        problem = _of_mesh(f"500 points in a strip of {flatness:g}", mesh, robust=False)
        yield problem, Request("count", count=30)


@example("what float64 cannot hold")
def _extremes() -> Examples:
    grid = graph_laplacian(900, grid_edges(30, 30))
    ones = np.ones(900)
    count = Request("count", count=5)

    def problem(note: str, stiffness: sp.csr_array, mass: np.ndarray, refusal: str) -> Problem:
        return Problem("extremes", note, sp.csr_array(stiffness), mass, refusal=refusal)  # type: ignore[arg-type]

    yield problem("minus a grid", -grid, ones, "must"), count
    yield problem("grid - 1e-3 M", grid - 1e-3 * sp.eye_array(900), ones, "must"), count
    yield problem("grid - M", grid - sp.eye_array(900), ones, "must"), count
    edge = 1e16 * graph_laplacian(900, [[450, 451]])
    yield problem("grid with an edge of 1e16", grid + edge, ones, "may"), count
    yield problem("grid with masses of 1e-310", grid, 1e-310 * ones, "may"), count
    light = ones.copy()
    light[450] = 1e-310
    yield problem("grid with one mass of 1e-310", grid, light, "may"), count
    mesh = triangulation(np.random.default_rng(6).random((900, 2)))
    stiffness, mass = matrices_of(mesh)
    for power, refusal in ((150, "may"), (200, "must")):
        with np.errstate(over="ignore"):
            masses = mass * 10.0 ** (2 * power) if power < 154 else mass
        vertices = mesh.vertices * 10.0**power
        yield (
            Problem(
                "extremes",
                f"flat mesh × 1e{power}",
                stiffness,
                masses,
                refusal=refusal,  # type: ignore[arg-type]
                mesh=(vertices, mesh.faces),
            ),
            count,
        )


@example("vertices with mass that L says nothing of")
def _lone_vertex() -> Examples:
    grid = graph_laplacian(1200, grid_edges(30, 40))
    for lone in (1, 3):
        stiffness = sp.csr_array(sp.block_diag([grid, sp.csr_array((lone, lone))]))
        problem = Problem("loners", f"grid and {lone} vertices", stiffness, np.ones(1200 + lone))
        yield problem, Request("count", count=10)
        yield problem, Request("threshold", threshold=0.05)

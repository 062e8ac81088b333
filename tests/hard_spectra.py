"""Difficult eigenproblems, made from seeds.

`make_problem(seed)` returns a pencil of one of the `FAMILIES`, the same at every call.
`hard_requests` chooses a request; `hard_verdict` solves the problem and judges the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import shapes
from scipy.spatial import Delaunay

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh

__all__ = [
    "FAMILIES",
    "Path",
    "Problem",
    "globe",
    "graph_laplacian",
    "grid_edges",
    "honeycomb_edges",
    "joined",
    "make_problem",
    "matrices_of",
    "triangulation",
]

FloatArray = npt.NDArray[np.float64]
Random = np.random.Generator
#: L, and the diagonal of M.
Matrices = tuple[Any, FloatArray]
#: Method: the choice of the package; slices of the spectrum even if the package would choose dense
#: `eigh`; or slices of few pairs, which have many borders.
Path = Literal["as built", "sliced", "thin slices"]


@dataclass(frozen=True, eq=False)
class Problem:
    """Pencil and method of solution.

    Parameters
    ----------
    family : str
    note : str
        Short description.
    stiffness : sparse array, shape (n, n)
    mass : ndarray, shape (n,)
    path : {"as built", "sliced", "thin slices"}
    seed : int
    refusal : {"", "may", "must"}
        Whether a refusal is as good an answer as eigenpairs, or the only right answer.
    mesh : tuple of vertices and faces, optional
        Mesh of these matrices. The solve computes them again, which changes the rounding.
    robust : bool
        Whether `mesh` gets the robust operator.
    """

    family: str
    note: str
    stiffness: Any
    mass: FloatArray
    path: Path = "as built"
    seed: int = -1
    refusal: Literal["", "may", "must"] = ""
    mesh: tuple[FloatArray, npt.NDArray[np.int64]] | None = None
    robust: bool = True


# Matrices ----------------------------------------------------------------------------------------


def graph_laplacian(n: int, edges: npt.ArrayLike, weights: npt.ArrayLike = 1.0) -> Any:
    """Return the Laplacian of a weighted graph; edges of shape (m, 2)."""
    ends = np.asarray(edges, dtype=np.int64).reshape(-1, 2)
    weight = np.broadcast_to(np.asarray(weights), len(ends))
    i, j = np.concatenate([ends, ends[:, ::-1]]).T
    across: Any = sp.coo_array((np.concatenate([weight, weight]), (i, j)), shape=(n, n)).tocsr()
    degrees = np.asarray(across.sum(axis=1)).ravel()
    return sp.csr_array(sp.diags_array(degrees.astype(np.float64)) - across)


def grid_edges(rows: int, columns: int, periodic: bool = False) -> npt.NDArray[np.int64]:
    """Return the edges of a rectangular grid; periodic grids need three rows and columns."""
    index = np.arange(rows * columns).reshape(rows, columns)
    if periodic:
        right = np.stack([index, np.roll(index, -1, axis=1)], axis=2).reshape(-1, 2)
        down = np.stack([index, np.roll(index, -1, axis=0)], axis=2).reshape(-1, 2)
    else:
        right = np.stack([index[:, :-1], index[:, 1:]], axis=2).reshape(-1, 2)
        down = np.stack([index[:-1], index[1:]], axis=2).reshape(-1, 2)
    return np.concatenate([right, down])


def honeycomb_edges(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return the edges of a sheet of hexagons, as a brick wall."""
    index = np.arange(rows * columns).reshape(rows, columns)
    right = np.stack([index[:, :-1], index[:, 1:]], axis=2).reshape(-1, 2)
    down = np.stack([index[:-1], index[1:]], axis=2)
    bonded = (np.add.outer(np.arange(rows - 1), np.arange(columns)) % 2) == 0
    return np.concatenate([right, down[bonded]])


def tree_edges(random: Random, n: int) -> npt.NDArray[np.int64]:
    """Return the edges of a random tree, a binary tree, a star, or a comb."""
    child = np.arange(1, n)
    shape = random.integers(4)
    if shape == 0:
        parent = (random.random(n - 1) * child).astype(np.int64)
    elif shape == 1:
        parent = (child - 1) // 2
    elif shape == 2:
        parent = np.zeros(n - 1, dtype=np.int64)
    else:
        half = max(n // 2, 1)
        parent = np.where(child < half, child - 1, child - half)
    return np.stack([parent, child], axis=1)


def triangulation(points: FloatArray) -> Mesh:
    """Return a flat mesh of points in the plane, shape (n, 2)."""
    faces = Delaunay(points).simplices
    used = np.unique(faces)
    renamed = np.searchsorted(used, faces)
    return Mesh(np.column_stack([points[used], np.zeros(len(used))]), renamed)


def torus_mesh(rows: int, columns: int, thickness: float = 0.4) -> Mesh:
    """Return a torus of radius 1 whose grid is as symmetric as its triangles allow."""
    u, v = np.meshgrid(
        2.0 * np.pi * np.arange(rows) / rows, 2.0 * np.pi * np.arange(columns) / columns
    )
    u, v = u.T.ravel(), v.T.ravel()
    ring = 1.0 + thickness * np.cos(v)
    vertices = np.column_stack([ring * np.cos(u), ring * np.sin(u), thickness * np.sin(v)])
    index = np.arange(rows * columns).reshape(rows, columns)
    right, down = np.roll(index, -1, axis=1), np.roll(index, -1, axis=0)
    across = np.roll(right, -1, axis=0)
    faces = [
        np.stack(f, axis=-1).reshape(-1, 3) for f in ((index, down, across), (index, across, right))
    ]
    return Mesh(vertices, np.concatenate(faces))


def globe(rows: int, columns: int) -> Mesh:
    """Return a sphere of circles of latitude, with slender triangles at its poles."""
    theta = np.pi * np.arange(1, rows + 1) / (rows + 1)
    phi = 2.0 * np.pi * np.arange(columns) / columns
    ring = np.stack(
        [
            np.outer(np.sin(theta), np.cos(phi)),
            np.outer(np.sin(theta), np.sin(phi)),
            np.outer(np.cos(theta), np.ones(columns)),
        ],
        axis=2,
    ).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(index, -1, axis=1)
    north, south = rows * columns, rows * columns + 1
    faces = [
        np.stack([index[:-1], index[1:], right[1:]], axis=2).reshape(-1, 3),
        np.stack([index[:-1], right[1:], right[:-1]], axis=2).reshape(-1, 3),
        np.column_stack([np.full(columns, north), index[0], right[0]]),
        np.column_stack([np.full(columns, south), right[-1], index[-1]]),
    ]
    return Mesh(np.concatenate([ring, [[0, 0, 1], [0, 0, -1]]]), np.concatenate(faces))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return meshes side by side as one."""
    starts = np.cumsum([0, *(m.n_vertices for m in meshes[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)]),
    )


def matrices_of(mesh: Mesh, robust: bool = True) -> Matrices:
    """Return L and the diagonal of M of a mesh."""
    stiffness, mass = cotangent_laplacian(mesh, robust=robust)
    return stiffness, mass.diagonal()


def _arrays(mesh: Mesh) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    return mesh.vertices, mesh.faces


def side_by_side(parts: list[Matrices]) -> Matrices:
    """Return the block-diagonal pencil of several."""
    stiffness = sp.block_diag([part[0] for part in parts], format="csr")
    return sp.csr_array(stiffness), np.concatenate([part[1] for part in parts])


# Families ----------------------------------------------------------------------------------------

#: Result of a family: matrices, a note, and fields of `Problem` other than the defaults.
Made = tuple[Matrices, str, dict[str, Any]]
FAMILIES: dict[str, Callable[[Random, int], Made]] = {}
#: Relative frequency and maximum number of vertices of each family.
_SHARES: dict[str, tuple[float, int]] = {}


def family(
    name: str, share: float = 1.0, largest: int = 3000
) -> Callable[[Callable[[Random, int], Made]], Callable[[Random, int], Made]]:
    """Register a function of a random generator and a requested vertex count as a family."""

    def enter(make: Callable[[Random, int], Made]) -> Callable[[Random, int], Made]:
        FAMILIES[name] = make
        _SHARES[name] = share, largest
        return make

    return enter


def _sides(random: Random, n: int, least: int = 1) -> tuple[int, int]:
    """Return two sides whose product is about n."""
    side = max(least, round(np.sqrt(n) * random.uniform(0.4, 1.0)))
    return side, max(least, round(n / side))


def _ones(stiffness: Any) -> Matrices:
    return stiffness, np.ones(stiffness.shape[0])


@family("grid")
def _grid(random: Random, n: int) -> Made:
    a, b = _sides(random, n)
    return _ones(graph_laplacian(a * b, grid_edges(a, b))), f"grid {a} × {b}", {}


@family("periodic grid", share=1.5)
def _periodic_grid(random: Random, n: int) -> Made:
    a, b = _sides(random, n, least=3)
    return _ones(graph_laplacian(a * b, grid_edges(a, b, True))), f"periodic grid {a} × {b}", {}


@family("weighted grid")
def _weighted_grid(random: Random, n: int) -> Made:
    a, b = _sides(random, n)
    edges = grid_edges(a, b, periodic=a > 2 and b > 2 and bool(random.integers(2)))
    kind = random.integers(3)
    if kind == 0:
        weights = random.choice([1.0, 2.0, 4.0], len(edges))
    elif kind == 1:
        weights = random.choice([1.0, 1.0 / 3.0, 0.1], len(edges))
    else:
        weights = random.random(len(edges)) + 0.01
    masses = random.choice([0.5, 1.0, 2.0], a * b) if random.integers(2) else np.ones(a * b)
    return (graph_laplacian(a * b, edges, weights), masses), f"weighted grid {a} × {b}", {}


@family("honeycomb")
def _honeycomb(random: Random, n: int) -> Made:
    a, b = _sides(random, n, least=2)
    return _ones(graph_laplacian(a * b, honeycomb_edges(a, b))), f"honeycomb {a} × {b}", {}


@family("path")
def _path(random: Random, n: int) -> Made:
    edges = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    closed = n > 2 and bool(random.integers(2))
    if closed:
        edges = np.concatenate([edges, [[n - 1, 0]]])
    note = f"{'cycle' if closed else 'path'} of {n}"
    return _ones(graph_laplacian(n, edges)), note, {}


@family("tree")
def _tree(random: Random, n: int) -> Made:
    return _ones(graph_laplacian(n, tree_edges(random, n))), f"tree of {n}", {}


@family("integer weights")
def _integers(random: Random, n: int) -> Made:
    edges = tree_edges(random, n)
    more = random.integers(0, n, (random.integers(1, 2 * n + 1), 2))
    edges = np.concatenate([edges, more[more[:, 0] != more[:, 1]]])
    stiffness = graph_laplacian(n, edges, random.integers(1, 4, len(edges))).astype(np.int64)
    masses = random.integers(1, 3, n).astype(np.float64) if random.integers(2) else np.ones(n)
    return (stiffness, masses), f"random graph of {n} with integer weights", {}


@family("dense multiplicity", largest=260)
def _multiplicity(random: Random, n: int) -> Made:
    kind = random.integers(3)
    if kind == 0:
        n = max(n, 2)
        edges = np.argwhere(np.triu(np.ones((n, n)), 1))
        return _ones(graph_laplacian(n, edges)), f"complete graph of {n}", {}
    if kind == 1:
        bits = max(1, round(np.log2(n)))
        index = np.arange(2**bits)
        edges = np.concatenate([np.stack([index, index ^ (1 << b)], axis=1) for b in range(bits)])
        edges = edges[edges[:, 0] < edges[:, 1]]
        return _ones(graph_laplacian(2**bits, edges)), f"hypercube of {2**bits}", {}
    a = max(1, n // 3)
    edges = np.argwhere(np.ones((a, n - a))) + np.array([0, a]) if n > a else np.zeros((0, 2))
    return _ones(graph_laplacian(n, edges)), f"complete bipartite graph {a}, {n - a}", {}


@family("torus")
def _torus(random: Random, n: int) -> Made:
    a, b = _sides(random, n, least=3)
    mesh = torus_mesh(b, a, random.uniform(0.2, 0.6))
    return matrices_of(mesh), f"torus {b} × {a}", {"mesh": _arrays(mesh)}


@family("sphere")
def _sphere(random: Random, n: int) -> Made:
    if random.integers(2):
        a, b = _sides(random, n, least=3)
        mesh, note = globe(a, b), f"globe {a} × {b}"
    else:
        level = int(np.clip(round(np.log(max(n, 12) / 10) / np.log(4)), 0, 4))
        mesh = shapes.icosphere(level, float(10.0 ** random.uniform(-6, 6)))
        note = f"icosphere of {mesh.n_vertices}"
    robust = bool(random.integers(2))
    return matrices_of(mesh, robust), note, {"mesh": _arrays(mesh), "robust": robust}


@family("flat mesh")
def _flat_mesh(random: Random, n: int) -> Made:
    mesh = triangulation(random.random((max(n, 3), 2)) * 10.0 ** random.uniform(-5, 5))
    return matrices_of(mesh), f"random flat mesh of {mesh.n_vertices}", {"mesh": _arrays(mesh)}


def _any_base(random: Random, n: int) -> tuple[Matrices, str]:
    """Return a pencil of a random basic family."""
    names = ["grid", "periodic grid", "weighted grid", "honeycomb", "path", "tree", "flat mesh",
             "torus", "sphere", "integer weights"]  # fmt: skip
    matrices, note, _ = FAMILIES[names[random.integers(len(names))]](random, n)
    return matrices, note


@family("soup")
def _soup(random: Random, n: int) -> Made:
    triangles = max(1, n // 3)
    corners = random.random((triangles, 3, 2)) + 3.0 * np.arange(triangles)[:, None, None]
    kind = random.integers(3)
    if kind == 0:
        corners[:] = corners[0] - 0.0
    elif kind == 1:
        corners *= 10.0 ** random.uniform(-3, 3, (triangles, 1, 1))
    vertices = np.concatenate([corners.reshape(-1, 2), np.zeros((3 * triangles, 1))], axis=1)
    mesh = Mesh(vertices, np.arange(3 * triangles).reshape(-1, 3))
    return matrices_of(mesh), f"{triangles} loose triangles", {"mesh": _arrays(mesh)}


@family("slivers", largest=130)
def _slivers(random: Random, n: int) -> Made:
    flatness = float(10.0 ** random.uniform(-6, -2))
    mesh = triangulation(random.random((max(n, 4), 2)))
    mesh = Mesh(mesh.vertices * [1.0, flatness, 1.0], mesh.faces)
    robust = bool(random.integers(3) == 0)
    note = f"slivers 1 : {flatness:.0e}, {'robust' if robust else 'plain'} operator"
    return matrices_of(mesh, robust), note, {"mesh": _arrays(mesh), "robust": robust}


@family("scales", largest=120)
def _scales(random: Random, n: int) -> Made:
    if random.integers(2):
        radius = 10.0 ** random.uniform(-6, 0, n + 3)
        angle = random.uniform(0, 2 * np.pi, n + 3)
        mesh = triangulation(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
        note = "one mesh refined to 1e-6"
    else:
        first = triangulation(random.random((max(n // 2, 3), 2)))
        second = triangulation(random.random((max(n // 2, 3), 2)) * 1e-6)
        mesh, note = joined([first, second]), "two meshes, 1 : 1e6"
    return matrices_of(mesh), note, {"mesh": _arrays(mesh)}


def _with_stiff_edges(random: Random, stiffness: Any, factor: float) -> Any:
    edges = np.argwhere(sp.triu(stiffness, 1).toarray() != 0.0)
    if len(edges) == 0:
        return stiffness
    some = edges[random.integers(0, len(edges), random.integers(1, 4))]
    return sp.csr_array(
        stiffness + factor * graph_laplacian(stiffness.shape[0], np.unique(some, axis=0))
    )


def _shift(random: Random, stiffness: Any, mass: FloatArray) -> tuple[Any, float]:
    """Return L + cM and a random c."""
    c = float(10.0 ** random.uniform(-11, 0))
    return sp.csr_array(stiffness + sp.diags_array(c * mass)), c


@family("stiff edges", share=2.0, largest=130)
def _stiff(random: Random, n: int) -> Made:
    (stiffness, mass), note = _any_base(random, n)
    factor = float(random.choice([1e6, 1e8, 1e16], p=[0.45, 0.45, 0.1]))
    stiffness = _with_stiff_edges(random, stiffness, factor)
    note = f"{note}, edges of {factor:.0e}"
    if random.integers(2):
        stiffness, c = _shift(random, stiffness, mass)
        note = f"{note}, + {c:.2g} M"
    return (stiffness, mass), note, {"refusal": "may"} if factor > 1e12 else {}


@family("springs", largest=130)
def _springs(random: Random, n: int) -> Made:
    """Return two parts joined by a weak spring, and maybe one to the ground."""
    (first, mass), note = _any_base(random, max(n // 2, 1))
    (second, other), _ = _any_base(random, max(n // 2, 1))
    weak = float(10.0 ** random.uniform(-10, -3))
    stiffness, masses = side_by_side([(first, mass), (second, other)])
    a, b = random.integers(len(mass)), len(mass) + random.integers(len(other))
    spring = graph_laplacian(len(masses), [[a, b]], weak)
    stiffness = sp.csr_array(stiffness + spring)
    if random.integers(2):
        ground = np.zeros(len(masses))
        ground[random.integers(len(masses))] = weak
        stiffness = sp.csr_array(stiffness + sp.diags_array(ground))
        note = f"{note} and another on springs of {weak:.1e}, one to the ground"
    else:
        note = f"{note} on a spring of {weak:.1e} to another"
    return (stiffness, masses), note, {}


@family("shifted", share=2.0, largest=700)
def _shifted(random: Random, n: int) -> Made:
    (stiffness, mass), note = _any_base(random, n)
    stiffness, c = _shift(random, stiffness, mass)
    return (stiffness, mass), f"{note}, + {c:.2g} M", {}


@family("copies", share=2.5)
def _copies(random: Random, n: int) -> Made:
    """Return equal components, or components that differ a little in size."""
    size = int(np.clip(round(2.0 ** random.uniform(1, 6)), 1, n))
    if random.integers(2):
        mesh = shapes.icosphere(0)
        part, note = matrices_of(mesh, False), "icosahedra"
    else:
        part, note = _any_base(random, size)
    copies = max(1, n // len(part[1]))
    step = float(random.choice([0.0, 1e-11, 1e-9, 1e-6, 1e-3, 0.03]))
    scales = 1.0 + step * np.arange(copies)
    matrices = side_by_side([(part[0], part[1] * scale**2) for scale in scales])
    return matrices, f"{copies} of {note}, {step:g} apart", {}


@family("loners", share=1.5)
def _loners(random: Random, n: int) -> Made:
    """Return a pencil with loose vertices, some without mass."""
    (stiffness, mass), note = _any_base(random, max(n * 2 // 3, 1))
    loose = max(1, n - len(mass))
    masses = np.where(random.random(loose) < 0.5, 0.0, random.choice([1.0, 0.5], loose))
    if random.integers(3) == 0:
        masses[:] = 1.0
    matrices = side_by_side([(stiffness, mass), (sp.csr_array((loose, loose)), masses)])
    order = random.permutation(len(matrices[1]))
    matrices = sp.csr_array(matrices[0][order][:, order]), matrices[1][order]
    return matrices, f"{note} with {loose} vertices that L says nothing of", {}


@family("few among many", share=0.4)
def _few_among_many(random: Random, n: int) -> Made:
    """Return too many vertices for a dense matrix, with a null space of nearly full dimension."""
    (stiffness, mass), note = _any_base(random, int(random.integers(70, 400)))
    loose = int(random.integers(2550, 3000)) - len(mass)
    if random.integers(2):
        rest: Any = sp.csr_array((loose, loose))
    else:
        rest = graph_laplacian(
            loose, np.arange(loose // 2 * 2).reshape(-1, 2)[: random.integers(60)]
        )
    matrices = side_by_side([(stiffness, mass), (rest, np.ones(loose))])
    return matrices, f"{note} beside {loose} vertices", {"path": "as built"}


@family("not semidefinite", largest=300)
def _indefinite(random: Random, n: int) -> Made:
    (stiffness, mass), note = _any_base(random, max(n, 3))
    kind = random.integers(3)
    if kind == 0:
        matrices, note = (sp.csr_array(-1.0 * stiffness), mass), f"minus {note}"
    elif kind == 1:
        size = float(np.max(stiffness.diagonal() / mass))
        c = size * float(10.0 ** random.uniform(-6, 0))
        matrices = sp.csr_array(stiffness - sp.diags_array(c * mass)), mass
        note = f"{note}, - {c:.2g} M"
    else:
        i, j = random.choice(len(mass), 2, replace=False)
        weight = -2.0 * float(stiffness.diagonal().max())
        matrices = sp.csr_array(stiffness + graph_laplacian(len(mass), [[i, j]], weight)), mass
        note = f"{note} with a negative edge"
    return matrices, note, {"refusal": "must"}


@family("denormal", share=0.6, largest=300)
def _denormal(random: Random, n: int) -> Made:
    """Return masses below 1e-308: all of them, all with L scaled alike, or one."""
    a, b = _sides(random, n)
    stiffness = graph_laplacian(a * b, grid_edges(a, b))
    masses = random.integers(1, 5, a * b).astype(np.float64)
    kind = random.integers(3)
    if kind == 0:
        return (stiffness, masses * 1e-310), "grid with masses of 1e-310", {"refusal": "may"}
    if kind == 1:
        tiny = 2.0**-1065
        both = sp.csr_array(stiffness * tiny), masses * tiny
        return both, "grid with L and M of 1e-320", {"refusal": "may"}
    masses[random.integers(a * b)] = 1e-310
    return (stiffness, masses), "grid with one mass of 1e-310", {"refusal": "may"}


@family("extreme units", largest=400)
def _extreme(random: Random, n: int) -> Made:
    """Return a mesh in units so extreme that areas exceed float64's range, or nearly."""
    unit_mesh = triangulation(random.random((max(n, 3), 2)))
    power = float(random.choice([-200, -150, -100, -60, 60, 100, 150, 200]))
    mesh = unit_mesh.vertices * 10.0**power, unit_mesh.faces
    stiffness, mass = matrices_of(unit_mesh)
    with np.errstate(over="ignore", under="ignore"):
        masses = mass * 10.0 ** (2.0 * power) if abs(power) < 154 else mass
    refusal = "must" if abs(power) > 154 else "may" if abs(power) > 75 else ""
    fields = {"mesh": mesh, "refusal": refusal}
    return (stiffness, masses), f"flat mesh × 1e{power:.0f}", fields


def make_problem(seed: int) -> Problem:
    """Return the problem of a seed."""
    random = np.random.default_rng([seed, 0])
    names = list(FAMILIES)
    shares = np.array([_SHARES[name][0] for name in names])
    name = names[int(random.choice(len(names), p=shares / shares.sum()))]
    path: Path = ("as built", "sliced", "thin slices")[random.integers(3)]
    n = min(_size(random, path), _SHARES[name][1])
    (stiffness, mass), note, fields = FAMILIES[name](random, n)
    scalable = "mesh" not in fields and "refusal" not in fields and stiffness.dtype.kind == "f"
    if scalable and random.integers(4) == 0:
        # Change the units of weights and masses.
        stiffness = sp.csr_array(stiffness * 10.0 ** random.uniform(-6, 6))
        mass = mass * 10.0 ** random.uniform(-9, 9)
        note = f"{note}, other units"
    made = Problem(name, note, stiffness, mass, path, seed)
    return replace(made, **fields)


def _size(random: Random, path: Path) -> int:
    """Return a random vertex count up to 3,000, mostly small for a cheap reference."""
    draw = random.random()
    if draw < 0.005:
        return int(random.integers(1500, 3001))
    if draw < 0.02:
        return int(random.integers(700, 1501))
    if path == "as built" and draw < 0.3:
        return int(random.integers(1, 20))
    least = 20 if path == "as built" else 110
    return round(float(np.exp(random.uniform(np.log(least), np.log(400)))))

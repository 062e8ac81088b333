"""Contestants of the benchmark of the eigensolver; each runs in a process of its own.

    python benchmarks/contestants.py NAME FOLDER PAIRS

FOLDER contains the matrices. Prints "start" when the matrices are read and the libraries loaded,
"stop" when the pairs are computed, and then the quality of the pairs as one line of JSON. All
results are judged by the same matrices: residuals, orthonormality, and the number of missing
pairs, by a count that does not depend on the contestant.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["NAMES", "OURS", "PEERS"]

OURS = ("slices-2", "slices-1")
PEERS = ("eigsh", "bands", "lapy")
NAMES = (*OURS, *PEERS, "limit")

#: Shift and tolerance of the peers, and number of pairs in a band.
SIGMA, TOLERANCE, BAND = -1e-10, 1e-10, 50


def read_matrices(folder: Path) -> tuple[Any, Any]:
    """Return L and M as the parent process stored them."""
    import scipy.sparse as sp

    return sp.load_npz(folder / "stiffness.npz").tocsc(), sp.load_npz(folder / "mass.npz").tocsc()


def begin() -> None:
    """Report to the parent process that loading has ended."""
    print("start", flush=True)


def run_slices(folder: Path, k: int, jobs: int) -> dict[str, Any]:
    """Solve with this package, `jobs` slices at a time."""
    from meshmash_viewer.spectral.eigensolver import solve

    stiffness, mass = read_matrices(folder)
    solve(stiffness[:1200][:, :1200], mass[:1200][:, :1200], 5)  # loads kernels
    begin()
    decomposition = solve(stiffness, mass, k, n_jobs=jobs)
    times = ", ".join(
        f"{name} {seconds:.2f}"
        for name, seconds in decomposition.timings.items()
        if name != "total"
    )
    proof = "certified" if decomposition.complete else "NOT CERTIFIED"
    return {
        "values": decomposition.eigenvalues,
        "rows": decomposition.rows,
        "note": f"{proof}; {times}",
    }


def run_eigsh(folder: Path, k: int) -> dict[str, Any]:
    """Solve with SciPy's ARPACK in one shift-invert run."""
    from scipy.sparse.linalg import eigsh

    stiffness, mass = read_matrices(folder)
    begin()
    values, columns = eigsh(stiffness, k, mass, sigma=SIGMA, tol=TOLERANCE)
    return {"values": values, "rows": columns.T}


def run_bands(folder: Path, k: int) -> dict[str, Any]:
    """Solve with ARPACK in bands of 50 pairs, each overlapping the previous band."""
    from scipy.sparse.linalg import eigsh

    stiffness, mass = read_matrices(folder)
    begin()
    values, columns = eigsh(stiffness, BAND, mass, sigma=SIGMA, tol=TOLERANCE)
    width = values[-1] - values[0]
    reach = 0.4
    barren = 0
    while len(values) < k:
        sigma = values[-1] + reach * width
        more, vectors = eigsh(stiffness, BAND, mass, sigma=sigma, tol=TOLERANCE)
        order = np.argsort(more)
        more, vectors = more[order], vectors[:, order]
        new = more > values[-1] * (1.0 + 1e-9)
        if more[0] > values[-1] or not new.any():  # no overlap, perhaps a gap; or no new pairs
            reach *= 0.7 if more[0] > values[-1] else 1.5
            barren += 1
            if barren > 12:
                raise ArithmeticError(f"the bands do not meet after {len(values)} pairs")
            continue
        barren = 0
        width = more[-1] - more[0]
        values = np.concatenate([values, more[new]])
        columns = np.concatenate([columns, vectors[:, new]], axis=1)
    return {"values": values[:k], "rows": columns[:, :k].T}


def run_lapy(folder: Path, k: int) -> dict[str, Any]:
    """Solve with LaPy, on the same matrices as the other contestants."""
    from lapy import Solver, TriaMesh

    with np.load(folder / "mesh.npz") as mesh:
        triangles = TriaMesh(mesh["vertices"], mesh["faces"])
    solver = Solver(triangles, lump=True)
    solver.stiffness, solver.mass = read_matrices(folder)
    begin()
    values, columns = solver.eigs(k=k)
    return {"values": values, "rows": columns.T}


def run_limit(folder: Path, k: int) -> dict[str, Any]:
    """Return seconds of the steps that shift-invert needs, each at its best, in one thread."""
    from threadpoolctl import threadpool_limits

    from meshmash_viewer.spectral.engine.factorization import order_pencil
    from meshmash_viewer.spectral.engine.pencil import reduce_pencil

    pencil = reduce_pencil(*read_matrices(folder))
    with threadpool_limits(1):
        order_pencil(pencil)  # loads kernels
        order = best(lambda: order_pencil(pencil), 2)
        ordered = order_pencil(pencil)
        factor = ordered.factor(0.5 * k, 0.1)
        factored = best(lambda: ordered.factor(0.5 * k, 0.1), 3)
        block = np.random.default_rng(0).standard_normal((pencil.n, 8))
        column = best(lambda: factor.solve(block), 5) / 8.0
        rates = []
        for rows, inner in ((300, 20_000), (1000, 4000), (2000, 2000)):
            one, two = np.ones((rows, inner)), np.ones((inner, rows))
            seconds = best(lambda one=one, two=two: one @ two, 5)
            rates.append(2.0 * rows * rows * inner / seconds)
    orthogonal = 2.0 * pencil.n * k * k / max(rates)
    return {
        "order": order,
        "rest": factored + 2 * k * column + orthogonal,
        "note": f"order {order:.2f}, factor {factored:.2f}, {2 * k} columns of "
        f"{1e3 * column:.2f} ms, {orthogonal:.2f} at {max(rates) / 1e9:.0f} GF/s",
    }


def best(work: Callable[[], object], times: int) -> float:
    """Return the shortest time of some runs in seconds."""
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return min(spent)


def quality(folder: Path, values: Any, rows: Any) -> dict[str, Any]:
    """Return worst residual, worst orthonormality of a sample, and number of missing pairs.

    Residuals are ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``, of all pairs above a hundredth of Weyl's spacing.
    The number of eigenvalues below the last one is the number of negative pivots of a factor.
    """
    from meshmash_viewer.spectral.engine.factorization import order_pencil
    from meshmash_viewer.spectral.engine.pencil import reduce_pencil

    stiffness, matrix = read_matrices(folder)
    mass = matrix.diagonal()
    weighted = mass[:, None]
    worst = 0.0
    floor = 1e-2 * 4.0 * np.pi / mass.sum()
    for start in range(0, len(values), 50):
        columns = np.asarray(rows[start : start + 50], dtype=np.float64).T
        part = values[start : start + 50]
        defect = stiffness @ columns - weighted * columns * part
        size = np.linalg.norm(weighted * columns, axis=0) * np.abs(part)
        relative = np.linalg.norm(defect, axis=0) / size
        worst = max(worst, float(relative[part > floor].max(initial=0.0)))
    some = np.unique(np.linspace(0, len(values) - 1, 200).astype(int))
    sample = np.asarray(rows[some], dtype=np.float64)
    gram = (sample * mass) @ sample.T - np.eye(len(some))
    pencil = reduce_pencil(stiffness, matrix)
    end = float(values[-1]) * (1.0 - 1e-6)
    factor = order_pencil(pencil).factor(
        end / pencil.unit, -1e-9 * end / pencil.unit, np.zeros(1, dtype=np.uint8)
    )
    found = int(np.count_nonzero(values < factor.shift * pencil.unit))
    return {
        "residual": worst,
        "orthonormality": float(np.abs(gram).max()),
        "missing": factor.count_below - found,
    }


def main() -> None:
    """Run one contestant."""
    contestant, folder, k = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    name, _, jobs = contestant.partition("-")
    if name == "limit":
        print(json.dumps(run_limit(folder, k)), flush=True)
        return
    runners = {"eigsh": run_eigsh, "bands": run_bands, "lapy": run_lapy}
    found = run_slices(folder, k, int(jobs)) if jobs else runners[name](folder, k)
    print("stop", flush=True)
    answer = {"note": found.get("note", ""), **quality(folder, found["values"], found["rows"])}
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()

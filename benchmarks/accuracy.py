"""Accuracy of the eigensolver on meshes given by path.

    python benchmarks/accuracy.py MESH[:SUBDIVISIONS] ... [--pairs 50 200]

Prints a table with a line for each mesh and number of pairs:

residual        largest ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``
within, across  largest entry of ``|ΦᵀMΦ - I|`` within and across slices of the spectrum
quotient        largest relative difference of λ from the Rayleigh quotient of φ, in extended
                precision; it is the error of λ, as the quotient's error is of second order in φ
count, threshold, interior
                largest relative difference from dense `eigh`, for the lowest pairs by number and
                by threshold, and for pairs nearest an interior value; up to 12,000 vertices
dense           largest relative difference of dense `eigh` from the quotients, for the lowest
                pairs: its rounding is relative to the largest eigenvalue, and limits the three
                columns before
null            largest residual of the constant functions of the components, relative to Weyl's
                spacing 4π / area: the functions are exact, so it is the rounding of row sums of L

Values beyond the limits of this file are printed in bold, and again at the end.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
from contestants import read_matrices
from eigensolver import prepare
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve

#: Largest number of vertices of problems that are solved densely, too.
_DENSE_VERTICES = 12_000
#: Promised limits, by column.
LIMITS = {
    "residual": 1e-9,
    "within": 1e-12,
    "across": 1e-10,
    "quotient": 1e-9,
    "count": 1e-9,
    "threshold": 1e-9,
    "interior": 1e-9,
}


@dataclass
class Problem:
    """Matrices of a mesh, and all eigenvalues by a dense solver if the mesh is small."""

    stiffness: Any
    mass: Any
    dense: Any = field(init=False)

    def __post_init__(self) -> None:
        self.dense = None
        if len(self.mass) <= _DENSE_VERTICES:
            scale = 1.0 / np.sqrt(self.mass)
            matrix = self.stiffness.toarray()
            matrix *= scale
            matrix *= scale[:, None]
            matrix += matrix.T
            matrix *= 0.5
            self.dense = scipy.linalg.eigh(
                matrix, eigvals_only=True, overwrite_a=True, check_finite=False, driver="evd"
            )
            self.dense[: self.components] = 0.0

    @property
    def spacing(self) -> float:
        """Mean distance of the eigenvalues by Weyl's law."""
        return float(4.0 * np.pi / self.mass.sum())

    @property
    def dense_error(self) -> float:
        """Relative rounding error of dense `eigh` at the lowest nonzero eigenvalue."""
        if self.dense is None:
            return 0.0
        return float(0.25 * np.finfo(np.float64).eps * self.dense[-1] / self.dense[self.components])

    @property
    def components(self) -> int:
        """Number of components of the mesh, each of which has a zero eigenvalue."""
        return int(connected_components(self.stiffness, directed=False)[0])

    def difference(self, values: Any, exact: Any) -> float:
        """Return the largest relative difference; infinite if the lengths differ."""
        if len(values) != len(exact):
            return float("inf")
        size = np.where(np.abs(exact) > 1e-6 * self.spacing, np.abs(exact), self.spacing)
        return float((np.abs(values - exact) / size).max(initial=0.0))

    def residual(self, values: Any, rows: Any) -> float:
        """Return the largest relative residual of pairs."""
        worst = 0.0
        for row, value in zip(rows, values, strict=True):
            defect = np.linalg.norm(self.stiffness @ row - value * self.mass * row)
            size = value if value > 1e-6 * self.spacing else self.spacing
            worst = max(worst, defect / (size * np.linalg.norm(self.mass * row)))
        return worst

    def quotients(self, rows: Any) -> Any:
        """Return the Rayleigh quotients, computed in extended precision."""
        pattern = self.stiffness.tocoo()
        entries = pattern.data.astype(np.longdouble)
        weights = self.mass.astype(np.longdouble)
        result = np.zeros(len(rows))
        for i, given in enumerate(rows):
            row = given.astype(np.longdouble)
            energy = (entries * row[pattern.row] * row[pattern.col]).sum()
            result[i] = float(energy / (weights * row * row).sum())
        return result

    def gram(self, rows: Any) -> Any:
        """Return ``|ΦᵀMΦ - I|``."""
        products = np.zeros((len(rows), len(rows)))
        for start in range(0, rows.shape[1], 20_000):
            part = rows[:, start : start + 20_000]
            products += (part * self.mass[start : start + 20_000]) @ part.T
        return np.abs(products - np.eye(len(rows)))


def measure(problem: Problem, k: int, jobs: int | None) -> dict[str, float | str]:
    """Return the columns of the table for the lowest k pairs."""
    borders: list[int] = []
    found = solve(
        problem.stiffness,
        problem.mass,
        k,
        n_jobs=jobs,
        on_pairs=lambda pairs: borders.append(len(pairs)),
    )
    gram = problem.gram(found.rows)
    slice_of = np.searchsorted(np.array(borders), np.arange(found.n_components), side="right")
    same = slice_of[:, None] == slice_of
    values, quotients = found.eigenvalues, problem.quotients(found.rows)
    null = min(problem.components, len(values))
    result: dict[str, float | str] = {
        "certified": "yes" if found.complete else "NO",
        "slices": str(len(set(borders))),
        "residual": problem.residual(values[null:], found.rows[null:]),
        "null": problem.residual(values[:null], found.rows[:null]),
        "within": float(gram[same].max()),
        "across": float(gram[~same].max(initial=0.0)),
        "quotient": problem.difference(values[null:], quotients[null:]),
    }
    if problem.dense is not None:
        exact = problem.dense
        result["count"] = problem.difference(values, exact[: len(values)])
        result["threshold"] = by_threshold(problem, k, jobs)
        result["interior"] = by_interior(problem, k, jobs)
        result["dense"] = problem.difference(exact[null : len(values)], quotients[null:])
    return result


def by_threshold(problem: Problem, k: int, jobs: int | None) -> float:
    """Return the difference from dense for all pairs up to the widest gap near the k-th."""
    exact = problem.dense
    first = max(problem.components, min(k, len(exact) - 1) - 10)
    gaps = np.diff(exact[first - 1 : max(first, k) + 10])
    last = first + int(np.argmax(gaps))
    found = solve(
        problem.stiffness,
        problem.mass,
        max_eigenvalue=float(0.5 * (exact[last - 1] + exact[last])),
        n_jobs=jobs,
    )
    return proven(problem, found, exact[:last])


def by_interior(problem: Problem, k: int, jobs: int | None) -> float:
    """Return the difference from dense for the k / 4 pairs nearest the k-th eigenvalue."""
    exact = problem.dense
    sigma = float(exact[min(k, len(exact) - 1)]) * 1.0001
    wanted = max(10, k // 4)
    found = solve(problem.stiffness, problem.mass, wanted, sigma=sigma, n_jobs=jobs)
    nearest = np.argsort(np.abs(exact - sigma), kind="stable")[:wanted]
    return proven(problem, found, np.sort(exact[nearest]))


def proven(problem: Problem, found: Eigenpairs, exact: Any) -> float:
    """Return the difference from dense; infinite if the result is not certified."""
    return problem.difference(found.eigenvalues, exact) if found.complete else float("inf")


def main() -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("meshes", nargs="+", metavar="MESH[:SUBDIVISIONS]")
    parser.add_argument("--pairs", type=int, nargs="+", default=[50, 200])
    parser.add_argument("--jobs", type=int, help="slices at a time")
    options = parser.parse_args()
    columns = ("certified", "slices", *LIMITS, "dense", "null")
    print("| mesh | n | components | k | " + " | ".join(columns) + " |")
    print("|---|--:|--:|--:|" + "--:|" * len(columns), flush=True)
    beyond = []
    for mesh in options.meshes:
        with tempfile.TemporaryDirectory() as name:
            n = prepare(mesh, Path(name))
            stiffness, mass = read_matrices(Path(name))
        problem = Problem(stiffness, mass.diagonal())
        for k in options.pairs:
            result = measure(problem, k, options.jobs)
            cells = []
            for column in columns:
                value = result.get(column, "")
                cells.append(value if isinstance(value, str) else f"{value:.0e}")
                limit = LIMITS.get(column, np.inf)
                if column in ("count", "threshold"):
                    limit = max(limit, problem.dense_error)
                if isinstance(value, float) and value > limit:
                    beyond.append(f"{Path(mesh).name} {k}: {column} {value:.1e}")
                    cells[-1] = f"**{cells[-1]}**"
            start = f"| {Path(mesh).name} | {n} | {problem.components} | {k} | "
            print(start + " | ".join(cells) + " |", flush=True)
    print("\n" + ("\n".join(f"- {fault}" for fault in beyond) or "All within the limits."))


if __name__ == "__main__":
    main()

"""Comparison of the robust operator with ``robust_laplacian``, on meshes given by path.

    python benchmarks/operators.py MESH ... [--rounds 7]

The two operators are computed in turn from the same arrays. Printed for each mesh: the largest
differences of L and M, relative to the largest entries, at vertices with faces; the median
processor times in seconds, and their ratio.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import robust_laplacian

from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.laplacian import cotangent_laplacian


def timed(compute: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call in seconds, and its result."""
    start = time.process_time()
    result = compute()
    return time.process_time() - start, result


def difference(ours: Any, theirs: Any, used: np.ndarray) -> float:
    """Return the largest difference of two matrices at some vertices, over the largest entry."""
    first, second = (matrix.tocsc()[used][:, used] for matrix in (ours, theirs))
    return float(abs(first - second).max() / abs(second).max())


def main() -> None:
    """Compare each mesh and print a line for it."""
    parser = argparse.ArgumentParser(description="The robust operator against robust_laplacian")
    parser.add_argument("mesh", nargs="+")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print(f"{'mesh':28} {'vertices':>9} {'L':>8} {'M':>8} {'ours':>8} {'theirs':>8} {'ratio':>6}")
    for path in options.mesh:
        mesh = read_mesh(path)
        arrays = mesh.vertices, mesh.faces
        times = np.zeros((options.rounds, 2))
        for row in times:
            row[0], ours = timed(lambda given=arrays: cotangent_laplacian(given, robust=True))
            row[1], theirs = timed(lambda given=arrays: robust_laplacian.mesh_laplacian(*given))
        used = np.flatnonzero(mesh.referenced)
        stiffness, mass = (difference(*pair, used) for pair in zip(ours, theirs, strict=True))
        first, second = np.median(times, axis=0)
        print(
            f"{mesh.name:28} {mesh.n_vertices:9,} {stiffness:8.1e} {mass:8.1e} {first:8.4f} "
            f"{second:8.4f} {first / second:6.2f}"
        )


if __name__ == "__main__":
    main()

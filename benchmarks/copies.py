"""Time of eigenpairs of many equal components, compared with different components.

    python benchmarks/copies.py [--copies 500] [--pairs 600] [--subdivisions 0]

Each component is an icosphere; vertices of different components are moved by 5 % at random. Prints
the processor seconds of the two cases, and their ratio.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import trimesh

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigensolver import solve


def row_of_balls(copies: int, subdivisions: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of icospheres in a row, with noise of `spread` times the radius."""
    ball = trimesh.creation.icosphere(subdivisions)
    n, random = len(ball.vertices), np.random.default_rng(0)
    moves = spread * random.standard_normal((copies, n, 3))
    moves[:, :, 0] += 3.0 * np.arange(copies)[:, np.newaxis]
    faces = ball.faces + n * np.arange(copies)[:, np.newaxis, np.newaxis]
    return (ball.vertices + moves).reshape(-1, 3), faces.reshape(-1, 3)


def seconds(mesh: Any, pairs: int) -> float:
    """Return the processor time in seconds of `pairs` eigenpairs, all certified."""
    matrices = cotangent_laplacian(mesh)
    start = time.process_time()
    assert solve(*matrices, pairs).complete
    return time.process_time() - start


def main() -> None:
    """Compare the two cases, after a first run that compiles the kernels."""
    parser = argparse.ArgumentParser(description="Pairs of many equal components")
    parser.add_argument("--copies", type=int, default=500)
    parser.add_argument("--pairs", type=int, default=600)
    parser.add_argument("--subdivisions", type=int, default=0)
    options = parser.parse_args()
    seconds(row_of_balls(2, 4, 0.01), 20)
    different, equal = (
        seconds(row_of_balls(options.copies, options.subdivisions, spread), options.pairs)
        for spread in (0.05, 0.0)
    )
    print(f"different {different:.2f} s, equal {equal:.2f} s, ratio {equal / different:.2f}")


if __name__ == "__main__":
    main()

"""Bound and estimate of truncation errors against dense spectra, on meshes given by path.

    python benchmarks/truncation.py MESH[@UNIT] ... [--shares 0.05 0.2 0.6] [--no-robust]

All eigenpairs of each mesh are computed by SciPy's dense solver, which shares no code with this
package. Features of 5, 20 and 60 % of the pairs are compared with features of all pairs. Printed
for each kind of feature:

bound / error        smallest ratio over vertices and columns; errors below rounding are left out
within 3             number of columns whose estimate is within a factor of 3 of their median error,
                     of the columns with a relative error above 1e-6
flagged              number of flagged columns, of the columns with a relative error above 1 %, and
                     of columns flagged needlessly
tail                 median error of HKS with tail="weyl" over the error without, at the first time
                     and at the last time with an error above 1 %
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from meshmash_viewer.features.filters import (
    FilterBank,
    bspline_bank,
    heat_kernel_bank,
    low_pass_bank,
    wave_kernel_bank,
)
from meshmash_viewer.features.sums import truncated_features
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigensolver import Decomposition

#: Times of HKS in units of 1 / λ_K: from nearly everything missing to nothing missing.
_TIMES = np.geomspace(0.3, 9.0, 32)


def whole_spectrum(mesh: Any, robust: bool) -> Decomposition:
    """Return all pairs of a mesh by a dense solver."""
    stiffness, mass = cotangent_laplacian(mesh, robust=robust)
    diagonal = np.asarray(mass.diagonal())
    root = np.sqrt(diagonal)
    dense = stiffness.toarray() / np.outer(root, root)
    values, vectors = scipy.linalg.eigh(dense, overwrite_a=True, driver="evd")
    values = np.maximum(values, 0.0)
    rows = np.ascontiguousarray((vectors / root[:, np.newaxis]).T)
    proof = Certificate("dense", len(values), len(values))
    return Decomposition(values, rows, np.zeros(len(values)), proof, mass=diagonal)


def banks_of(eigenvalues: np.ndarray) -> dict[str, FilterBank]:
    """Return the banks by kind, each with weights beyond the last eigenvalue."""
    last = float(eigenvalues[-1])
    return {
        "HKS": heat_kernel_bank(_TIMES / last),
        "WKS": wave_kernel_bank(eigenvalues, 32),
        "geometry vectors": bspline_bank(0.0, 2.0 * last, 32),
        "step": low_pass_bank(1.5 * last),
    }


def compare(whole: Decomposition, count: int, bank: FilterBank) -> dict[str, Any]:
    """Compare features of `count` pairs with features of all pairs."""
    part = replace(whole, eigenvalues=whole.eigenvalues[:count], rows=whole.rows[:count])
    features = truncated_features(part, bank)
    truth = truncated_features(whole, bank).values
    error = np.abs(truth - features.values)
    estimate, bound = features.truncation_at_vertices()
    # Differences within the rounding of float64 sums are not counted as errors.
    rounding = 1e-12 * np.maximum(np.abs(truth), 1e-3 / whole.mass[:, np.newaxis])
    seen = error > rounding
    smallest = float((bound[seen] / error[seen]).min(initial=np.inf))
    medians = np.median(error, axis=0), np.median(estimate, axis=0)
    relative = medians[0] / np.maximum(np.median(np.abs(truth), axis=0), 1e-300)
    counted = relative > 1e-6
    ratio = medians[1][counted] / medians[0][counted]
    assert features.truncation is not None
    flagged = np.zeros(len(relative), dtype=bool)
    flagged[features.truncation.flagged] = True
    result = {
        "smallest": smallest,
        "within": int(((ratio > 1 / 3) & (ratio < 3)).sum()),
        "counted": int(counted.sum()),
        "range": (float(ratio.min(initial=np.inf)), float(ratio.max(initial=0.0))),
        "flagged": (int((flagged & (relative > 0.01)).sum()), int((relative > 0.01).sum())),
        "needless": int((flagged & (relative <= 0.01)).sum()),
    }
    if bank.kind == "hks":
        left = np.median(np.abs(error - estimate), axis=0) / medians[0]
        result["tail"] = (left, relative)
    return result


def print_mesh(name: str, whole: Decomposition, shares: list[float]) -> dict[str, list[int]]:
    """Print the table of a mesh; return "within" and "counted" of each kind."""
    totals: dict[str, list[int]] = {}
    n = whole.n_components
    for share in shares:
        count = max(int(share * n), 2)
        for kind, bank in banks_of(whole.eigenvalues[:count]).items():
            found = compare(whole, count, bank)
            low, high = found["range"]
            line = (
                f"{name:18} {share:4.0%} {kind:17} bound / error {found['smallest']:6.3f}   "
                f"within 3: {found['within']:2} of {found['counted']:2} "
                f"({low:.2f} to {high:.3g})   flagged {found['flagged'][0]:2} of "
                f"{found['flagged'][1]:2}, {found['needless']} needlessly"
            )
            if "tail" in found:
                left, relative = found["tail"]
                worse = int((left[relative > 0.01] > 1.0).sum())
                line += (
                    f"   tail leaves {left[0]:.2f} (missing {relative[0]:.0%}) to "
                    f"{left[relative > 0.01][-1]:.2f} (missing 1 %); "
                    f"farther off in {worse} of {int((relative > 0.01).sum())}"
                )
            print(line, flush=True)
            total = totals.setdefault(kind, [0, 0])
            total[0] += found["within"]
            total[1] += found["counted"]
    return totals


def main() -> None:
    """Compare the meshes, and print the results."""
    parser = argparse.ArgumentParser(description="Truncation error against dense spectra.")
    parser.add_argument("mesh", nargs="+", help="path, or path@unit")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.05, 0.2, 0.6])
    parser.add_argument("--no-robust", action="store_true", help="plain cotangent Laplacian")
    options = parser.parse_args()
    sums: dict[str, list[int]] = {}
    for given in options.mesh:
        path, _, unit = given.partition("@")
        # Vertices without faces have no eigenpairs.
        mesh = repair_mesh(read_mesh(Path(path), unit or None), "drop_unreferenced_vertices")
        began = time.perf_counter()
        whole = whole_spectrum(mesh, not options.no_robust)
        print(f"{mesh.name}: {whole.n_components} pairs in {time.perf_counter() - began:.0f} s")
        for kind, found in print_mesh(mesh.name, whole, options.shares).items():
            total = sums.setdefault(kind, [0, 0])
            total[0] += found[0]
            total[1] += found[1]
    for kind, (within, counted) in sums.items():
        print(f"{kind}: the estimate within a factor of 3 in {within} of {counted} columns")


if __name__ == "__main__":
    main()

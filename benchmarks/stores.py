"""Random faults of stored eigenpairs, each of which must be detected before a pair is used.

    python benchmarks/stores.py [--corruptions 100] [--sizes 3000 50000 500000] [--seed 0]

After each fault (a bit, a page, a truncation, files of another mesh, edited text, ...) the pairs
that can still be read are compared with the original pairs, and the damaged pairs are computed
again, which must write nothing else; see `tests/fuzz/store_faults.py`. Up to `--solve-up-to`
vertices the pairs are eigenpairs and are solved for again; above, they are noise.
"""

from __future__ import annotations

import argparse
import collections
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.fuzz.store_faults import Mutator, blanket, examine, make_store, mend


def main() -> None:
    """Try all sizes; exit with 1 if a fault was overlooked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--corruptions", type=int, default=100, help="of each size")
    parser.add_argument("--sizes", type=int, nargs="+", default=[3000, 50_000, 500_000])
    parser.add_argument("--solve-up-to", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    failed = False
    for size in options.sizes:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            failed |= try_size(size, options)
    sys.exit(failed)


def try_size(size: int, options: argparse.Namespace) -> bool:
    """Print the results of the faults at a size; return whether one was overlooked."""
    solved = size <= options.solve_up_to
    n_pairs = 60 if solved else 24
    truth = make_store(blanket(size), n_pairs, 3 if solved else 6, solved)
    other = make_store(blanket(size, seed=1), n_pairs, 3 if solved else 6, solved, seed=1)
    mutator = Mutator(truth, other, options.seed)
    kinds: collections.Counter[str] = collections.Counter()
    finding = []
    wrong = 0
    for number in range(options.corruptions):
        fault = mutator.inflict()
        kinds[fault.kind] += 1
        began = time.perf_counter()
        try:
            examine(mutator.truth, fault)
            finding.append(time.perf_counter() - began)
            mutator.truth = mend(mutator.truth, fault)
        except Exception as defect:  # noqa: BLE001  the next fault follows any error
            wrong += 1
            print(f"  {number}: {fault.kind}, {fault.what} -> {type(defect).__name__}: {defect}")
            shutil.rmtree(truth.store.folder, ignore_errors=True)
            mutator.truth = make_store(truth.mesh, n_pairs, 3 if solved else 6, solved)
    print(
        f"{truth.mesh.n_vertices} vertices, {n_pairs} pairs ({'solved' if solved else 'noise'}): "
        f"{options.corruptions} faults, {wrong} overlooked or mended wrongly; "
        f"{np.median(finding) * 1e3:.0f} ms to look at all pairs (median)"
    )
    print("  " + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())), flush=True)
    return wrong > 0


if __name__ == "__main__":
    main()

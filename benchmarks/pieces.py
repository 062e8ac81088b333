"""Heat kernel signatures in overlapping pieces and of the whole mesh: time, memory, seams.

    python benchmarks/pieces.py MESH [--unit 8 nm] [--subdivisions 4 5] [--truth 3] [--jobs 16]

Each triangle is divided into four `--subdivisions` times, which keeps the shape. The whole mesh is
solved with `--truth` subdivisions; its vertices are the first vertices of all larger sizes.
``--truth -1`` omits it. Every size runs in a process of its own, after the kernels have been
compiled. Printed for each size:

time      seconds of splitting, and in total
memory    peak of the main process and of its largest child (ru_maxrss), and of all processes
          together with shared pages counted once (Linux)
marked    number of columns of which, by the estimate, more than 1 % is missing: too few eigenpairs
seams     relative differences at seams in columns that are not marked: the largest median of a
          column, and the largest difference
error     relative differences from the whole mesh at its vertices, likewise

and, with --columns, seams and error of each column. The window and its packages are not needed;
without an installation set ``PYTHONPATH`` to the repository.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from joblib.externals.loky import reusable_executor

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.split.piece_features import PieceFeatures
from meshmash_viewer.split.stitcher import MeshStitcher

#: Unit of ru_maxrss in bytes.
_RSS = 1 if sys.platform == "darwin" else 1024


def subdivided(vertices: FloatArray, faces: np.ndarray, times: int) -> Mesh:
    """Divide each triangle into four at the midpoints of its edges; given vertices stay first."""
    for _ in range(times):
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        codes, place = np.unique(sides[:, 0] * len(vertices) + sides[:, 1], return_inverse=True)
        a, b = np.divmod(codes, len(vertices))
        ab, bc, ca = (len(vertices) + place.reshape(-1, 3)).T
        vertices = np.concatenate([vertices, 0.5 * (vertices[a] + vertices[b])])
        i, j, k = faces.T
        corners = [(i, ab, ca), (ab, j, bc), (ca, bc, k), (ab, bc, ca)]
        faces = np.concatenate([np.stack(each, axis=1) for each in corners])
    return Mesh(vertices, faces)


class Memory:
    """Peak memory of this process and descendants, shared pages counted once; 0 without /proc."""

    def __init__(self) -> None:
        self.peak = 0
        self._over = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while not self._over.wait(0.5):
            self.peak = max(self.peak, sum(map(_proportional, _with_descendants("self"))))


def _with_descendants(pid: str) -> list[str]:
    """Return the ids of a process and its descendants."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    try:
        children = [child for each in lists for child in each.read_text().split()]
    except OSError:  # the process has ended
        return []
    return [pid, *(found for child in children for found in _with_descendants(child))]


def _proportional(pid: str) -> int:
    """Return the memory of a process in bytes, with its part of shared pages."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


def run(options: argparse.Namespace, times: int, whole: bool, folder: Path) -> dict[str, Any]:
    """Compute the mesh of one size, whole or in pieces."""
    bank = heat_kernel_bank(np.geomspace(options.t_min, options.t_max, options.times))
    warm_up(bank)
    given = repair_mesh(read_mesh(options.mesh), "drop_duplicate_faces")
    given = repair_mesh(given, "drop_unreferenced_vertices")
    mesh = subdivided(options.unit * given.vertices, given.faces, times)
    memory, began = Memory(), time.perf_counter()
    found = (compute_whole if whole else compute_pieces)(options, mesh, bank, folder)
    if (executor := reusable_executor._executor) is not None:
        executor.shutdown(wait=True)  # only children that have ended are counted
    peaks = [
        resource.getrusage(who).ru_maxrss * _RSS
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return {
        "vertices": mesh.n_vertices,
        "seconds": time.perf_counter() - began,
        "bytes": [*peaks, memory.peak],
        "modules": third_party(),
        **found,
    }


def warm_up(bank: Any) -> None:
    """Compile the kernels and store them for processes started later."""
    tetrahedron = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    ball = subdivided(tetrahedron, faces, 6)
    stitcher = MeshStitcher(ball, n_jobs=1).split_mesh(6000, t_max=0.01)
    stitcher.apply(PieceFeatures(OperatorOptions(), 4000.0, bank, drop_first=False))


def compute_whole(
    options: argparse.Namespace, mesh: Mesh, bank: Any, folder: Path
) -> dict[str, Any]:
    """Solve the whole mesh and store its signature as the truth."""
    stiffness, mass = cotangent_laplacian(mesh, robust=True)
    pairs = solve(stiffness, mass, max_eigenvalue=options.max_eigenvalue)
    assert pairs.complete
    values = accumulate_features(pairs.rows, bank(pairs.eigenvalues))
    np.save(folder / "truth.npy", values)
    return {"pairs": pairs.n_components}


def compute_pieces(
    options: argparse.Namespace, mesh: Mesh, bank: Any, folder: Path
) -> dict[str, Any]:
    """Split, solve the pieces and stitch; compare with the truth if there is one."""
    began = time.perf_counter()
    stitcher = MeshStitcher(mesh, n_jobs=options.jobs)
    most = options.widest * options.core
    stitcher.split_mesh(options.core, t_max=options.t_max, max_overlap_neighbors=most)
    split = time.perf_counter() - began
    task = PieceFeatures(OperatorOptions(), options.max_eigenvalue, bank, drop_first=False)
    values, truncation, seams, median = task.on(stitcher)
    assert truncation is not None
    sizes = [len(piece) for piece in stitcher.pieces]
    found: dict[str, Any] = {
        "split": split,
        "pieces": len(sizes),
        "largest": max(sizes),
        "repeated": sum(sizes) / mesh.n_vertices,
        "flagged": [int(at) for at in truncation.flagged],
        "seam_median": median.tolist(),
        "seam_largest": np.max(seams, axis=0, initial=0.0).tolist(),
    }
    path = folder / "truth.npy"
    if path.exists() and len(truth := np.load(path)) <= len(values):
        error = np.abs(values[: len(truth)] - truth) / np.abs(truth)
        found["error_median"] = np.nanmedian(error, axis=0).tolist()
        found["error_largest"] = np.nanmax(error, axis=0).tolist()
    return found


def third_party() -> list[str]:
    """Return the imported packages that are not part of Python."""
    names = {name.partition(".")[0] for name in sys.modules}
    return sorted(
        name
        for name in names - {"meshmash_viewer"}
        if "site-packages" in str(getattr(sys.modules.get(name), "__file__", ""))
    )


def described(found: dict[str, Any], columns: bool) -> str:
    """Return the results of a size as lines of text."""
    own, child, together = (size / 1e9 for size in found["bytes"])
    line = (
        f"{found['vertices']:9,} vertices   {found['seconds']:7.1f} s   "
        f"{own:.2f} GB, child {child:.2f} GB, together {together:.2f} GB   "
    )
    if "pieces" not in found:
        return f"{line}whole, {found['pairs']} pairs"
    kept = np.setdiff1d(np.arange(len(found["seam_median"])), found["flagged"])
    line += (
        f"{found['pieces']} pieces of at most {found['largest']:,}, {found['repeated']:.2f} times"
        f" the vertices, split in {found['split']:.1f} s   marked {len(found['flagged'])} of"
        f" {len(found['seam_median'])}"
    )
    for kind in ("seam", "error"):
        if f"{kind}_median" in found and len(kept):
            median, largest = (np.array(found[f"{kind}_{of}"]) for of in ("median", "largest"))
            line += f"   {kind} {median[kept].max():.3%}, at most {largest[kept].max():.2%}"
            if columns:
                rows = zip(median, largest, strict=True)
                line += "".join(
                    f"\n    {kind} {at:2} {one:10.4%} {most:10.3%}"
                    + ("  marked" if at in found["flagged"] else "")
                    for at, (one, most) in enumerate(rows)
                )
    return line


def main() -> None:
    """Run each size in a process of its own, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("mesh", help="path")
    parser.add_argument("--unit", type=float, default=8.0, help="nm of the unit of its file")
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 4, 5])
    parser.add_argument("--truth", type=int, default=3, help="subdivisions of the whole")
    parser.add_argument("--core", type=int, default=20_000, help="vertices without the overlap")
    parser.add_argument("--widest", type=int, default=11, help="times a core, an overlap at most")
    parser.add_argument("--t-min", type=float, default=2e5, help="nm²")
    parser.add_argument("--t-max", type=float, default=2e6, help="nm²")
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--max-eigenvalue", type=float, default=5e-6, help="per nm²")
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--columns", action="store_true", help="figures of each column")
    parser.add_argument("--keep", help="folder of the truth; it is not computed again")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        times, whole, folder = json.loads(options.one)
        print(json.dumps(run(options, times, whole, Path(folder))))
        return
    with tempfile.TemporaryDirectory() as place:
        folder = Path(options.keep or place)
        folder.mkdir(parents=True, exist_ok=True)
        runs = [(times, False) for times in options.subdivisions]
        if options.truth >= 0 and not (folder / "truth.npy").exists():
            runs.insert(0, (options.truth, True))
        modules: set[str] = set()
        for times, whole in runs:
            given = json.dumps([times, whole, str(folder)])
            command = [sys.executable, __file__, *sys.argv[1:], f"--one={given}"]
            done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
            if done.returncode:
                print(f"{times} subdivisions: ended with {done.returncode}", flush=True)
                continue
            found = json.loads(done.stdout.splitlines()[-1])
            modules |= set(found["modules"])
            print(described(found, options.columns), flush=True)
        print("imported:", ", ".join(sorted(modules)))


if __name__ == "__main__":
    main()

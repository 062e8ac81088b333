"""Comparison of the eigensolver with its peers and with a lower limit, on meshes given by path.

    python benchmarks/eigensolver.py MESH[:SUBDIVISIONS] ... [--pairs 100 300 1000]

Prints one table per mesh. Every run is a process of its own. Contestants take turns, so that other
load of the machine affects all of them. Times are medians; memory is the peak of the whole process
tree beyond the memory of the interpreter with its libraries and the matrices. Before each run,
a process writes to some memory, so that every run finds pages that were used recently.

slices-2, slices-1   this package, two and one slice at a time
eigsh                SciPy's ARPACK in shift-invert mode, SuperLU, sigma = -1e-10, tol = 1e-10
bands                eigsh in bands of 50 pairs with a moving shift (Vallet & Lévy 2008)
lapy                 LaPy's solver on the same matrices
limit                order + factor + 2 k columns solved in blocks + one orthogonalisation of k
                     vectors at the best rate of matrix products, divided by slices at a time

Peers run with one and with two threads for linear algebra (or --threads), and the faster run
counts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median
from typing import Any

import contestants
import numpy as np

#: Seconds of a run above which it is not repeated.
_LONG = 60.0


class Runner:
    """Runner of contestants on the matrices in a folder."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        self.folder, self.limit, self.threads = folder, options.limit, options.threads
        self.touched = options.touch * 1e9

    def run(self, contestant: str, k: int, threads: int) -> dict[str, Any]:
        """Run a contestant in a process, record its memory, and end it at the time limit."""
        import psutil

        print(f"{contestant}, {k} pairs, {threads} threads", file=sys.stderr, flush=True)
        touch_memory(self.touched)
        script = Path(contestants.__file__)
        environment = dict(os.environ)
        if contestant in contestants.PEERS:
            for library in ("OMP", "OPENBLAS", "MKL", "VECLIB"):
                environment[f"{library}_NUM_THREADS"] = str(threads)
        with tempfile.TemporaryFile() as errors:
            process = subprocess.Popen(
                [sys.executable, str(script), contestant, str(self.folder), str(k)],
                stdout=subprocess.PIPE,
                stderr=errors,
                env=environment,
                text=True,
            )
            tree = _Tree(psutil.Process(process.pid))
            timer = threading.Timer(self.limit, tree.kill)
            timer.start()
            began = ended = time.perf_counter()
            answer: dict[str, Any] = {}
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith("start"):
                    tree.begin()
                    began = time.perf_counter()
                elif line.startswith("stop"):
                    ended = time.perf_counter()
                    timer.cancel()
                    tree.over.set()
                elif line.startswith("{"):
                    answer = json.loads(line)
            timer.cancel()
            tree.over.set()
            if process.wait() == 0:
                return {
                    "seconds": ended - began,
                    "memory": tree.grown,
                    "threads": threads,
                    **answer,
                }
            errors.seek(0)
            last = errors.read().decode(errors="replace").strip().splitlines()[-1:]
        if tree.killed:
            return {"fault": f"not finished in {self.limit:.0f} s", "threads": threads}
        reason = last[0] if last else f"ended with {process.returncode}"
        return {"fault": reason[:100].replace("|", "/"), "threads": threads}


def touch_memory(size: float) -> None:
    """Write to `size` bytes of memory in a process that ends.

    In a virtual machine the host has to provide pages that were not used lately, which takes ten
    times as long or more: the first run would be slower than the others.
    """
    import psutil

    size = min(size, 0.5 * psutil.virtual_memory().available)
    program = f"import numpy; numpy.empty({int(size) // 8})[::512] = 1"
    subprocess.run([sys.executable, "-c", program], check=True)


class _Tree:
    """Memory of a process and all its descendants, measured ten times per second."""

    def __init__(self, root: Any) -> None:
        self.root = root
        self.over = threading.Event()
        self.killed = False
        self._base = self._peak = 0
        threading.Thread(target=self._watch, daemon=True).start()

    @property
    def grown(self) -> int:
        """Largest growth of the memory since `begin`, in bytes."""
        return self._peak - self._base

    def begin(self) -> None:
        """Measure the growth from now on."""
        self._base = self._peak = self._resident()

    def kill(self) -> None:
        """End all processes."""
        import psutil

        self.killed = True
        for process in [*self.root.children(recursive=True), self.root]:
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue

    def _resident(self) -> int:
        import psutil

        total = 0
        try:
            for process in [self.root, *self.root.children(recursive=True)]:
                total += process.memory_info().rss
        except psutil.NoSuchProcess:  # the process has just ended
            return 0
        return total

    def _watch(self) -> None:
        while not self.over.wait(0.1):
            self._peak = max(self._peak, self._resident())


def prepare(mesh: str, folder: Path) -> int:
    """Read and subdivide a mesh, store its matrices, and return its number of vertices."""
    import robust_laplacian
    import scipy.sparse as sp
    from trimesh.remesh import subdivide

    from meshmash_viewer.io.read import read_mesh

    path, _, times = mesh.partition(":")
    given = read_mesh(path)
    vertices, faces = given.vertices, given.faces
    for _ in range(int(times or 0)):
        vertices, faces = subdivide(vertices, faces)
    used = np.unique(faces)
    place = np.zeros(len(vertices), dtype=int)
    place[used] = np.arange(len(used))
    vertices, faces = vertices[used], place[faces]
    stiffness, mass = robust_laplacian.mesh_laplacian(vertices, faces)
    sp.save_npz(folder / "stiffness.npz", stiffness.tocsc(), compressed=False)
    sp.save_npz(folder / "mass.npz", mass.tocsc(), compressed=False)
    np.savez(folder / "mesh.npz", vertices=vertices, faces=faces)
    return len(vertices)


def compete(runner: Runner, names: list[str], k: int, repeats: int) -> dict[str, dict[str, Any]]:
    """Run contestants in turns; return a typical run of each."""
    runs: dict[str, list[dict[str, Any]]] = {}
    for name in names:
        counts = runner.threads if name in contestants.PEERS else [1]
        tries = [runner.run(name, k, count) for count in counts]
        runs[name] = [min(tries, key=lambda run: run.get("seconds", np.inf))]
    for _ in range(repeats - 1):
        for name, done in runs.items():
            if name != "limit" and done[0].get("seconds", np.inf) < _LONG:
                done.append(runner.run(name, k, done[0]["threads"]))
    typical = {}
    for name, done in runs.items():
        failed = [run for run in done if "fault" in run]
        by_time = sorted(done, key=lambda run: run.get("seconds", np.inf))
        typical[name] = dict((failed or by_time[len(by_time) // 2 :])[0])
        if not failed:
            typical[name]["seconds"] = median(run["seconds"] for run in done)
            typical[name]["memory"] = max(run["memory"] for run in done)
            typical[name]["runs"] = len(done)
    return typical


def rows_of_table(results: dict[str, dict[str, Any]], k: int) -> list[str]:
    """Return the rows of the table for k pairs, one for each contestant."""
    rows = []
    ours = results.get("slices-2", {}).get("seconds")
    for name, run in results.items():
        if "fault" in run:
            rows.append(f"| {k} | {name} | – | | | | | | {run['fault']} |")
        elif name == "limit":
            rows += rows_of_limit(run, results, k)
        else:
            times = f"{run['seconds'] / ours:.1f}" if ours else ""
            note = run["note"]
            if name in contestants.PEERS:
                note = f"{run['threads']} thread" + "s" * (run["threads"] > 1)
            rows.append(
                f"| {k} | {name} | {run['seconds']:.2f} | {times} | {run['memory'] / 1e6:.0f} "
                f"| {run['residual']:.0e} | {run['orthonormality']:.0e} | {run['missing']} "
                f"| {note}; {run['runs']} run" + "s" * (run["runs"] > 1) + " |"
            )
    return rows


def rows_of_limit(run: dict[str, Any], results: dict[str, dict[str, Any]], k: int) -> list[str]:
    """Return rows of the limit for two slices and one at a time, with the ratios of our times."""
    rows = []
    for jobs in (2, 1):
        least = (run["order"] + run["rest"]) / jobs
        with_order = run["order"] + run["rest"] / jobs
        notes = []
        ours = results.get(f"slices-{jobs}", {}).get("seconds")
        if ours:
            notes.append(f"slices-{jobs} takes {ours / least:.2f} times this")
        if ours and jobs > 1:
            notes.append(f"{ours / with_order:.2f} times the {with_order:.2f} s of a whole order")
        if jobs == 1:
            notes.append(run["note"])
        rows.append(
            f"| {k} | limit, {jobs} at a time | {least:.2f} | | | | | | {'; '.join(notes)} |"
        )
    return rows


def report(mesh: str, options: argparse.Namespace) -> None:
    """Print the table of one mesh."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        n = prepare(mesh, folder)
        runner = Runner(folder, options)
        path, _, times = mesh.partition(":")
        title = Path(path).name + (f", subdivided {times} times" if times else "")
        print(f"\n### {title}: {n} vertices\n")
        print("| pairs | who | seconds | times ours | MB | residual | ΦᵀMΦ − I | missing | note |")
        print("|--:|---|--:|--:|--:|--:|--:|--:|---|", flush=True)
        for k in options.pairs:
            results = compete(runner, list(options.contestants), k, options.repeats)
            for row in rows_of_table(results, k):
                print(row, flush=True)


def main() -> None:
    """Read the command line and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("meshes", nargs="+", metavar="MESH[:SUBDIVISIONS]")
    parser.add_argument("--pairs", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--repeats", type=int, default=3, help="runs of those under a minute")
    parser.add_argument(
        "--contestants", nargs="+", default=list(contestants.NAMES), choices=contestants.NAMES
    )
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds a run may take")
    parser.add_argument(
        "--threads", type=int, nargs="+", default=[1, 2], help="threads that peers are tried with"
    )
    parser.add_argument(
        "--touch", type=float, default=2.0, metavar="GB", help="memory touched before each run"
    )
    options = parser.parse_args()
    for mesh in options.meshes:
        report(mesh, options)


if __name__ == "__main__":
    main()

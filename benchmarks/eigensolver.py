"""The eigensolver against its peers and against the machine, on meshes given by path.

    python benchmarks/eigensolver.py MESH[:SUBDIVISIONS] ... [--pairs 100 300 1000] [--repeats 3]

Every run is a process of its own. Contestants take turns, so that whatever else the machine does
hits all of them; times are medians, memory is the peak of the whole process tree beyond what the
interpreter with its libraries and the matrices take. Contestants:

slices-2, slices-1   this package, two and one slice at a time
eigsh                SciPy's ARPACK in shift-invert mode, SuperLU, sigma = -1e-10, tol = 1e-10
bands                the same by bands of 50 with a moving shift (Vallet & Lévy 2008)
lapy                 LaPy's solver
primme               PRIMME with a given inverse, where it is installed
limit                order + factor + 2 k columns solved in blocks + one orthogonalisation of k
                     vectors at the best matrix product, divided by two
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

CONTESTANTS = ("slices-2", "slices-1", "eigsh", "bands", "lapy", "primme", "limit")


def read_matrices(folder: Path) -> tuple[Any, Any]:
    """(L, M) as the parent stored them."""
    import scipy.sparse as sp

    return sp.load_npz(folder / "stiffness.npz").tocsc(), sp.load_npz(folder / "mass.npz").tocsc()


def run_slices(folder: Path, k: int, jobs: int) -> dict[str, Any]:
    """This package, so many slices at a time."""
    from meshmash_viewer.eigensolver import solve

    stiffness, mass = read_matrices(folder)
    solve(stiffness[:1200][:, :1200], mass[:1200][:, :1200], 5)  # loads what is loaded late
    yield_start()
    decomposition = solve(stiffness, mass, k, n_jobs=jobs)
    return {
        "values": decomposition.eigenvalues,
        "rows": decomposition.rows,
        "note": decomposition.certificate if decomposition.complete else "NOT COMPLETE",
    }


def run_eigsh(folder: Path, k: int) -> dict[str, Any]:
    """The whole request in one shift-invert run."""
    from scipy.sparse.linalg import eigsh

    stiffness, mass = read_matrices(folder)
    yield_start()
    values, columns = eigsh(stiffness, k, mass, sigma=-1e-10, tol=1e-10)
    return {"values": values, "rows": columns.T}


def run_bands(folder: Path, k: int) -> dict[str, Any]:
    """Bands of 50, each overlapping the one before."""
    from scipy.sparse.linalg import eigsh

    stiffness, mass = read_matrices(folder)
    yield_start()
    values, columns = eigsh(stiffness, 50, mass, sigma=-1e-10, tol=1e-10)
    width = values[-1] - values[0]
    reach = 0.4
    while len(values) < k:
        sigma = values[-1] + reach * width
        more, vectors = eigsh(stiffness, 50, mass, sigma=sigma, tol=1e-10)
        order = np.argsort(more)
        more, vectors = more[order], vectors[:, order]
        if more[0] > values[-1]:  # no overlap: there may be a gap
            reach *= 0.7
            if reach < 0.01:
                raise ArithmeticError("bands do not meet")
            continue
        new = more > values[-1] * (1.0 + 1e-9)
        if not new.any():
            reach *= 1.5
            continue
        width = more[-1] - more[0]
        values = np.concatenate([values, more[new]])
        columns = np.concatenate([columns, vectors[:, new]], axis=1)
    return {"values": values[:k], "rows": columns[:, :k].T}


def run_lapy(folder: Path, k: int) -> dict[str, Any]:
    """LaPy on its own finite elements, with lumped mass."""
    from lapy import Solver, TriaMesh

    with np.load(folder / "mesh.npz") as mesh:
        triangles = TriaMesh(mesh["vertices"], mesh["faces"])
    solver = Solver(triangles, lump=True)
    yield_start()
    values, columns = solver.eigs(k=k)
    return {"values": values, "rows": columns.T, "matrices": (solver.stiffness, solver.mass)}


def run_primme(folder: Path, k: int) -> dict[str, Any]:
    """PRIMME, preconditioned by a factor just below zero."""
    import primme
    from scipy.sparse.linalg import LinearOperator, splu

    stiffness, mass = read_matrices(folder)
    yield_start()
    scale = 4.0 * np.pi / mass.diagonal().sum()
    factor = splu(
        (stiffness + scale * mass).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    inverse = LinearOperator(stiffness.shape, matvec=factor.solve, matmat=factor.solve)
    values, columns = primme.eigsh(
        stiffness, k, mass, which="SA", tol=1e-10, OPinv=inverse, maxBlockSize=8
    )
    order = np.argsort(values)
    return {"values": values[order], "rows": columns[:, order].T}


def run_limit(folder: Path, k: int) -> dict[str, Any]:
    """What the machine would need for the unavoidable parts, on two cores."""
    from threadpoolctl import threadpool_limits

    from meshmash_viewer.engine.factorization import order_pencil
    from meshmash_viewer.engine.pencil import reduce_pencil

    stop = np.zeros(1, dtype=np.uint8)
    pencil = reduce_pencil(*read_matrices(folder))
    order_pencil(pencil)
    with threadpool_limits(1):
        began = time.perf_counter()
        ordered = order_pencil(pencil)
        order = time.perf_counter() - began
        ordered.factor(0.5 * k, 0.1, stop)
        began = time.perf_counter()
        factor = ordered.factor(0.5 * k, 0.1, stop)
        factored = time.perf_counter() - began
        block = np.random.default_rng(0).standard_normal((pencil.n, 8))
        solves = []
        for _ in range(5):
            began = time.perf_counter()
            factor.solve(block)
            solves.append((time.perf_counter() - began) / 8.0)
        one, two = np.ones((300, 20_000)), np.ones((20_000, 300))
        products = []
        for _ in range(5):
            began = time.perf_counter()
            one @ two
            products.append(2.0 * 300 * 300 * 20_000 / (time.perf_counter() - began))
    seconds = order + (factored + 2 * k * min(solves) + 2.0 * pencil.n * k * k / max(products)) / 2
    note = (
        f"order {order:.2f} s, factor {factored:.2f} s, {1e3 * min(solves):.2f} ms a column, "
        f"{max(products) / 1e9:.0f} GF/s"
    )
    return {"seconds": seconds, "note": note}


def yield_start() -> None:
    """Tell the parent that loading is over."""
    print("start", flush=True)


def child(contestant: str, folder: Path, k: int) -> None:
    """Run one contestant and print what it found as JSON."""
    name, _, jobs = contestant.partition("-")
    runners = {"eigsh": run_eigsh, "bands": run_bands, "lapy": run_lapy, "primme": run_primme}
    runners["limit"] = run_limit
    if name == "slices":
        found = run_slices(folder, k, int(jobs))
    else:
        found = runners[name](folder, k)
    print("stop", flush=True)
    answer: dict[str, Any] = {"note": found.get("note", "")}
    if "seconds" in found:
        answer["seconds"] = found["seconds"]
    else:
        stiffness, mass = found.get("matrices") or read_matrices(folder)
        answer.update(quality(stiffness, mass.diagonal(), found["values"], found["rows"]))
    print(json.dumps(answer), flush=True)


def quality(stiffness: Any, mass: Any, values: Any, rows: Any) -> dict[str, Any]:
    """Worst residual, worst orthonormality of a sample of pairs, last eigenvalue."""
    weighted = mass[:, None]
    worst = 0.0
    floor = 1e-2 * 4.0 * np.pi / mass.sum()
    for start in range(0, len(values), 50):
        columns = np.asarray(rows[start : start + 50]).T
        part = values[start : start + 50]
        defect = stiffness @ columns - weighted * columns * part
        size = np.linalg.norm(weighted * columns, axis=0) * np.abs(part)
        relative = np.linalg.norm(defect, axis=0) / size
        worst = max(worst, float(relative[part > floor].max(initial=0.0)))
    some = np.unique(np.linspace(0, len(values) - 1, 200).astype(int))
    sample = np.asarray(rows[some])
    gram = (sample * mass) @ sample.T - np.eye(len(some))
    return {
        "residual": worst,
        "orthonormality": float(np.abs(gram).max()),
        "last": float(values[-1]),
        "sum": float(np.sum(values)),
    }


def measure(contestant: str, folder: Path, k: int, limit: float) -> dict[str, Any]:
    """Run a contestant in a process and watch its memory."""
    import psutil

    command = [sys.executable, __file__, "--child", contestant, str(folder), str(k)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    watched = psutil.Process(process.pid)
    memory = {"now": 0, "peak": 0, "base": 0}
    over = threading.Event()

    def resident() -> int:
        total = 0
        try:
            for part in [watched, *watched.children(recursive=True)]:
                total += part.memory_info().rss
        except psutil.Error:
            return memory["now"]
        return total

    def watch() -> None:
        while not over.wait(0.02):
            memory["now"] = resident()
            memory["peak"] = max(memory["peak"], memory["now"])

    threading.Thread(target=watch, daemon=True).start()
    timer = threading.Timer(limit, process.kill)
    timer.start()
    began = ended = time.perf_counter()
    answer: dict[str, Any] = {}
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("start"):
            began = time.perf_counter()
            memory["base"] = memory["peak"] = resident()
        elif line.startswith("stop"):
            ended = time.perf_counter()
            over.set()
        elif line.startswith("{"):
            answer = json.loads(line)
    over.set()
    timer.cancel()
    assert process.stderr is not None
    errors = process.stderr.read().strip().splitlines()
    if process.wait() != 0:
        slow = time.perf_counter() - began > limit - 5
        fault = f"over {limit:.0f} s" if slow else (errors[-1] if errors else "died")
        return {"fault": fault[:90]}
    answer.setdefault("seconds", ended - began)
    answer["memory"] = memory["peak"] - memory["base"]
    return answer


def prepare(mesh: str, folder: Path) -> int:
    """Read a mesh, subdivide it as asked, and store matrices for the children."""
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
    sp.save_npz(folder / "stiffness.npz", stiffness.tocsc())
    sp.save_npz(folder / "mass.npz", mass.tocsc())
    np.savez(folder / "mesh.npz", vertices=vertices, faces=faces)
    return len(vertices)


def main() -> None:
    """Read the command line and run it all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", metavar="MESH[:SUBDIVISIONS]")
    parser.add_argument("--pairs", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--repeats", type=int, default=3, help="runs of those under a minute")
    parser.add_argument("--only", nargs="+", default=list(CONTESTANTS), choices=CONTESTANTS)
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds a run may take")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child[0], Path(options.child[1]), int(options.child[2]))
        return
    for mesh in options.meshes:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            n = prepare(mesh, folder)
            for k in options.pairs:
                print(f"\n{Path(mesh).name}, {n} vertices, {k} pairs")
                report(folder, k, options)


def report(folder: Path, k: int, options: argparse.Namespace) -> None:
    """Run the contestants in turns and print a table."""
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in options.only}
    for turn in range(options.repeats):
        for name, done in runs.items():
            if turn and ("fault" in done[0] or done[0]["seconds"] > 60.0):
                continue
            done.append(measure(name, folder, k, options.limit))
    typical = {
        name: median(run["seconds"] for run in done)
        for name, done in runs.items()
        if "fault" not in done[0] and all("seconds" in run for run in done)
    }
    ours = typical.get("slices-2", float("nan"))
    print(f"  {'':9} {'seconds':>8} {'ratio':>6} {'MB':>6} {'residual':>9} {'ortho':>7}  note")
    for name, done in runs.items():
        if name not in typical:
            print(f"  {name:9} {done[0].get('fault', 'failed')}")
            continue
        first = done[0]
        line = f"  {name:9} {typical[name]:8.2f} {typical[name] / ours:6.2f}"
        if "residual" in first:
            megabytes = max(run["memory"] for run in done) / 1e6
            line += f" {megabytes:6.0f} {first['residual']:9.1e} {first['orthonormality']:7.0e}"
            reference = runs.get("slices-2", [{}])[0].get("sum")
            if reference and name in ("eigsh", "bands", "primme"):
                difference = abs(first["sum"] - reference) / reference
                line += f"  sum of λ differs by {difference:.0e}"
        print(f"{line}  {first['note']}", flush=True)


if __name__ == "__main__":
    main()

"""How the real window answers on large meshes: ticks, gaps of its event loop, memory.

    xvfb-run -a -s "-screen 0 1600x1000x24" python benchmarks/interaction.py MESH
        [--sizes 100000 500000 1000000] [--pairs 300] [--solve-up-to 150000]
        [--decompose MESH:PAIRS] [--trace]

MESH is refined to exactly the given numbers of vertices by splitting its longest edges. Up to
`--solve-up-to` vertices the eigenpairs are solved for; above, they are SYNTHETIC: smooth random
waves with eigenvalues after Weyl's law, in a store like any other, which cost the window the same
to map, read, sum and draw. Columns of the table say which.

Each size is run twice, each time in a process of its own with an empty cache: once with the
software OpenGL of this machine, and once with Mesa's no-op driver (GALLIUM_NOOP), in which
drawing costs nothing and what remains is the processor's side. Gaps are the time between two ticks
of a timer of 5 ms, less the time in which the thread was ready to run but the processors were taken
(as Linux counts it), so that a busy machine does not blur them; "less drawing" has the time inside
VTK's Render and Frame taken off, too. Times are medians unless said otherwise.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.mesh import Mesh

HERE = Path(__file__).parent

#: What the table shows: key of a result, text, and how it is written.
ROWS = (
    ("pairs", "eigenpairs", "{}"),
    ("step_noop", "eigenfunction step, processor's side (ms)", "{:.1f}"),
    ("hks_noop", "HKS tick, processor's side (ms)", "{:.1f}"),
    ("band_noop", "band tick, processor's side (ms)", "{:.1f}"),
    ("similarity_noop", "similarity tick, processor's side (ms)", "{:.1f}"),
    ("floor", "floor: writing 4 n bytes (ms)", "{:.2f}"),
    ("hks_table", "HKS of a time from the table (ms)", "{:.1f}"),
    ("hks_direct", "the same by the direct sum (ms)", "{:.0f}"),
    ("hks_ratio", "direct sum / table", "{:.0f}×"),
    ("hks_error", "largest error, of the field's range", "{:.0e}"),
    ("readd", "scene made again with pyvista's add_mesh (ms)", "{:.0f}"),
    ("readd_ratio", "add_mesh / eigenfunction step", "{:.0f}×"),
    ("step_soft", "eigenfunction step on the screen, software OpenGL (ms)", "{:.0f}"),
    ("gap_noop", "largest gap, no-op driver, all included (ms)", "{:.0f}"),
    ("p99_noop", "99 % of gaps, no-op driver (ms)", "{:.1f}"),
    ("gap_noop_less", "largest gap, no-op driver, less drawing (ms)", "{:.0f}"),
    ("gap_soft_less", "largest gap, software OpenGL, less drawing (ms)", "{:.0f}"),
    ("p99_soft_less", "99 % of gaps, software OpenGL, less drawing (ms)", "{:.1f}"),
    ("gap_soft", "largest gap, software OpenGL, all included (ms)", "{:.0f}"),
    ("private", "private memory beyond the empty window (MB)", "{:.0f}"),
    ("trimmed", "the same without what the C library keeps for later (MB)", "{:.0f}"),
    ("tables", "live tables in it (MB)", "{:.0f}"),
    ("formula", "formula: mesh, surface, tables, fields (MB)", "{:.0f}"),
    ("private_ratio", "memory / formula", "{:.2f}"),
)


def refined(mesh: Mesh, n_vertices: int) -> Mesh:
    """The same surface with exactly that many vertices: longest edges are split in the middle."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(vertices) < n_vertices:
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        keys, of_side = np.unique(sides @ [len(vertices), 1], return_inverse=True)
        edges = np.stack(np.divmod(keys, len(vertices)), axis=1)
        lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        split = np.argsort(-lengths, kind="stable")[: n_vertices - len(vertices)]
        new = np.full(len(edges), -1)
        new[split] = len(vertices) + np.arange(len(split))
        vertices = np.concatenate([vertices, vertices[edges[split]].mean(axis=1)])
        faces = _split_faces(faces, new[of_side.reshape(-1, 3)])
    return Mesh(vertices, faces, mesh.unit, mesh.name)


def _split_faces(faces: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Faces after a new vertex (or -1) in the middle of each side (ab, bc, ca)."""
    count = (middles >= 0).sum(axis=1)
    parts = [faces[count == 0]]
    for number in (1, 2, 3):
        for first in range(3):
            order = [first, (first + 1) % 3, (first + 2) % 3]
            a, b, c = faces[:, order].T
            ab, bc, ca = middles[:, order].T
            if number == 1:
                chosen = (count == 1) & (ab >= 0)
                new = [(a, ab, c), (ab, b, c)]
            elif number == 2:
                chosen = (count == 2) & (ca < 0)
                new = [(ab, b, bc), (a, ab, c), (ab, bc, c)]
            elif first == 0:
                chosen = count == 3
                new = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
            else:
                continue
            parts += [np.stack(face, axis=1)[chosen] for face in new]
    return np.concatenate(parts)


def prepare_store(mesh: Mesh, n_pairs: int, solved: bool) -> None:
    """Fill the cache with eigenpairs of a mesh, real or synthetic."""
    from meshmash_viewer.eigensolver import Decomposition, solve
    from meshmash_viewer.io.store import EigenpairStore
    from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian

    operator = OperatorOptions()
    store = EigenpairStore.open_or_create(mesh, operator)
    if solved:
        stiffness, mass = cotangent_laplacian(mesh, robust=True)
        found = solve(stiffness, mass, n_pairs, allocate=store.allocate, on_pairs=store.append)
        store.finish(found)
        return
    rows = store.allocate(n_pairs)
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    place = (mesh.vertices - (low + high) / 2) / np.linalg.norm(high - low)
    for index in range(n_pairs):
        direction = rng.standard_normal(3)
        wave = 2.0 * np.pi * np.sqrt(index) * direction / np.linalg.norm(direction)
        rows[index] = np.cos(place @ wave + 2.0 * np.pi * rng.random() * (index > 0))
        rows[index] /= np.sqrt((rows[index] ** 2).mean() * mesh.area)
    values = 4.0 * np.pi / mesh.area * np.arange(n_pairs)
    found = Decomposition(
        values, rows, np.full(n_pairs, 1e-12), 0.1, True, "synthetic rows for timing",
        mass=np.full(mesh.n_vertices, mesh.area / mesh.n_vertices),
    )  # fmt: skip
    store.append(0, values, found.residuals)
    store.finish(found)


def run_window(what: str, options: dict[str, Any], *, noop: bool, trace: bool) -> dict[str, Any]:
    """What a window of its own process measures."""
    environment = {**os.environ, "GALLIUM_NOOP": "1" if noop else "0"}
    if not noop:
        environment.pop("GALLIUM_NOOP")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        order = json.dumps({"what": what, "result": str(path), "trace": trace, **options})
        command = [sys.executable, str(HERE / "interaction_window.py"), order]
        subprocess.run(command, env=environment, check=True)
        return dict(json.loads(path.read_text()))


def measure_size(path: Path, mesh: Mesh, n_pairs: int, solved: bool, trace: bool) -> dict[str, Any]:
    """One column of the table."""
    options = {"mesh": str(path), "pairs": n_pairs, "vertices": mesh.n_vertices}
    noop = run_window("session", options, noop=True, trace=trace)
    soft = run_window("session", options, noop=False, trace=trace)
    ticks = noop["ticks"]
    print_phases(f"{mesh.n_vertices:,} vertices", noop, soft)
    return {
        "pairs": f"{n_pairs} {'solved' if solved else 'SYNTHETIC'}",
        "step_noop": ticks["step"],
        "hks_noop": ticks["hks"],
        "band_noop": ticks["band"],
        "similarity_noop": ticks["similarity"],
        "floor": noop["floor"],
        **noop["compressed"],
        "hks_ratio": noop["compressed"]["hks_direct"] / noop["compressed"]["hks_table"],
        "readd": noop["readd"],
        "readd_ratio": noop["readd"] / ticks["step"],
        "step_soft": soft["ticks"]["step"],
        "gap_noop": noop["gaps"]["largest"],
        "p99_noop": noop["gaps"]["p99"],
        "gap_noop_less": noop["gaps"]["largest_less"],
        "gap_soft_less": soft["gaps"]["largest_less"],
        "p99_soft_less": soft["gaps"]["p99_less"],
        "gap_soft": soft["gaps"]["largest"],
        **{key: soft[key] for key in ("private", "trimmed", "tables", "formula")},
        "private_ratio": soft["private"] / soft["formula"],
    }


def print_phases(title: str, *runs: dict[str, Any]) -> None:
    """Largest gaps by what was done meanwhile."""
    print(f"\n{title}: largest gap in ms, all included / less drawing; 99 % less drawing")
    for name in runs[0]["phases"]:
        cells = []
        for run in runs:
            phase = run["phases"].get(name)
            if phase:
                cells.append(
                    f"{run['driver']}: {phase['largest']:6.0f} / {phase['largest_less']:4.0f};"
                    f" {phase['p99_less']:5.1f}"
                )
        print(f"  {name:28s} {'    '.join(cells)}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, nargs="?")
    parser.add_argument("--sizes", type=int, nargs="*", default=[100_000, 500_000, 1_000_000])
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--solve-up-to", type=int, default=150_000)
    parser.add_argument("--decompose", nargs="*", default=[], metavar="MESH:PAIRS")
    parser.add_argument("--trace", action="store_true", help="say what ran during long gaps")
    arguments = parser.parse_args()

    from meshmash_viewer.io.read import read_mesh

    columns = {}
    for size in arguments.sizes if arguments.mesh else []:
        # A cache of its own, for this process and the windows it starts.
        with tempfile.TemporaryDirectory(prefix="interaction-") as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            mesh = refined(read_mesh(arguments.mesh), size)
            path = Path(folder) / f"{arguments.mesh.stem}.npz"
            np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
            solved = mesh.n_vertices <= arguments.solve_up_to
            prepare_store(mesh, arguments.pairs, solved)
            columns[size] = measure_size(path, mesh, arguments.pairs, solved, arguments.trace)
    if columns:
        print(f"\n| {arguments.mesh.stem} | " + " | ".join(f"{n:,}" for n in columns) + " |")
        print("|---|" + "---|" * len(columns))
        for key, text, form in ROWS:
            cells = [form.format(column[key]) for column in columns.values()]
            print(f"| {text} | " + " | ".join(cells) + " |")
    for text in arguments.decompose:
        name, _, pairs = text.rpartition(":")
        with tempfile.TemporaryDirectory(prefix="interaction-") as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            options = {"mesh": str(Path(name).absolute()), "pairs": int(pairs)}
            runs = [
                run_window("decompose", options, noop=noop, trace=arguments.trace)
                for noop in (True, False)
            ]
            print_phases(f"{Path(name).stem} decomposed, {pairs} pairs", *runs)


if __name__ == "__main__":
    main()

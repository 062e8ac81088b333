"""Response of the real window to large meshes: ticks, gaps, memory, first pictures.

    xvfb-run -a -s "-screen 0 1600x1000x24" python benchmarks/interaction.py MESH
        [--sizes 100000 500000 1000000] [--parts window pair solve start]
        [--drivers no-op software] [--pairs 300] [--solve-up-to 150000] [--first-pairs 100]
        [--folder DIR]

MESH is refined to exactly the given numbers of vertices by splitting its longest edges. A full run
takes most of an hour. With `--folder`, meshes, eigenpairs and results are kept in DIR, so that
parts can be run one at a time; the table shows all results so far.

window  a scripted minute in a window of its own process: open a mesh with stored eigenpairs,
        scroll, turn, drag, pin, export, save a picture; then ticks, one at a time. It runs once
        with Mesa's no-op driver (GALLIUM_NOOP), in which drawing costs nothing and only the work
        of the processor remains, and once with the software OpenGL of this machine. Up to
        `--solve-up-to` vertices the stored pairs are eigenpairs; above, they are SYNTHETIC: smooth
        random waves with eigenvalues by Weyl's law, which take as long to map, sum and draw.
pair    ticks of two renders, with the mesh opened next to itself, until both renders show their
        fields. The stored pairs must be eigenpairs.
solve   a window opens a mesh without stored results, and computes at once: time from the end of
        reading to the first preview, the first 20 and all exact pairs on the screen.
start   time from the start of the process until the window is painted, and until it is complete.

A tick is the time from a change of the model to the frame that shows it; the field is uploaded
before VTK's Render, into the buffer of the previous field. Ticks are measured in rounds of 40,
at most 25, until the host of a virtual machine withholds less than 1 % of a processor ("steal")
during a round; the round with the least steal counts. The processor time of a tick is that of the
interface thread, including plots and texts after the frame; it separates the cost from waiting for
a busy processor. A gap is the time between two ticks of a 5 ms timer, less the longer of two
delays: the thread waited for a processor used by other programs (as Linux counts), or the host
withheld the processor (as detected by `interaction_bystander.py`). "Less drawing" also excludes the
time in VTK's Render and Frame. Times are medians unless stated otherwise.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate

HERE = Path(__file__).parent
PARTS = ("window", "pair", "solve", "start")
DRIVERS = ("no-op", "software")
TICKS = {
    "step": "eigenfunction step",
    "leap": "leap to any eigenfunction",
    "hks": "HKS tick",
    "band": "band tick",
    "filter": "filter tick, exp(-t*x)",
    "filter_edges": "filter tick, a sharp band",
    "similarity": "similarity tick",
    "wks": "WKS tick",
    "diffusion": "tick of the diffusion time",
    "map_pairs": "a map from one pair more",
    "map_filter": "a map filtered, exp(-t*x)",
}


def refined(mesh: Mesh, n_vertices: int) -> Mesh:
    """Return the same surface with exactly `n_vertices` vertices, by halving the longest edges."""
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
    """Return the faces with a new vertex, or -1 for none, in the middle of sides ab, bc, ca."""
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
    """Fill the cache with eigenpairs of a mesh, solved for or synthetic."""
    from meshmash_viewer.io.store import EigenpairStore
    from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
    from meshmash_viewer.spectral.eigenpairs import Eigenpairs
    from meshmash_viewer.spectral.eigensolver import solve
    from meshmash_viewer.spectral.weyl import Target

    operator = OperatorOptions()
    store = EigenpairStore(mesh, operator, Target("count", n_pairs))
    if solved:
        stiffness, mass = cotangent_laplacian(mesh, robust=True)
        options = {"allocate": store.allocate, "on_pairs": store.append}
        store.append(solve(stiffness, mass, n_pairs, **options))
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
    found = Eigenpairs(
        values, rows, np.full(n_pairs, 1e-12),
        Certificate("dense", orthonormality=0.1, remark="synthetic rows for timing"),
        mass=np.full(mesh.n_vertices, mesh.area / mesh.n_vertices),
    )  # fmt: skip
    store.append(found)


def run_window(what: str, options: dict[str, Any], driver: str, folder: Path) -> dict[str, Any]:
    """Return the measurements of a window in a process of its own."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), "GALLIUM_NOOP": "1"}
    environment["PYTHONPATH"] = str(HERE.parent)  # this tree, not an installed package
    if driver != "no-op":
        del environment["GALLIUM_NOOP"]
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "result.json"
        order = json.dumps({"what": what, "result": str(path), **options})
        command = [sys.executable, str(HERE / "interaction_window.py"), order]
        subprocess.run(command, env=environment, check=True)
        return dict(json.loads(path.read_text()))


def run_start(folder: Path) -> dict[str, Any]:
    """Return the seconds until the window is painted, and complete, at its second start."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder)}
    for _ in range(2):
        command = [sys.executable, str(HERE / "interaction_start.py"), str(time.time())]
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


class Column:
    """Results for one size, kept in a file so that parts can be run one at a time."""

    def __init__(self, folder: Path, source: Path, size: int) -> None:
        self.folder = folder
        self.mesh = folder / f"{source.stem}-{size}.npz"
        self.results = folder / f"{source.stem}-{size}.json"
        if not self.mesh.exists():
            from meshmash_viewer.io.read import read_mesh

            mesh = refined(read_mesh(source), size)
            np.savez(self.mesh, vertices=mesh.vertices, faces=mesh.faces)
        self.known: dict[str, Any] = {}
        if self.results.exists():
            self.known = json.loads(self.results.read_text())

    def keep(self, what: str, result: dict[str, Any]) -> None:
        """Store a result."""
        self.known[what] = result
        self.results.write_text(json.dumps(self.known, indent=1))

    def measure(self, part: str, options: argparse.Namespace) -> None:
        """Run a part and store its result."""
        if part == "start":
            self.keep(part, run_start(self.folder))
        elif part == "solve":
            # An empty cache, so that no results are stored.
            with tempfile.TemporaryDirectory(prefix="interaction-", dir=self.folder) as cache:
                order = {"mesh": str(self.mesh), "pairs": options.first_pairs}
                found = run_window(part, order, options.drivers[-1], Path(cache))
            self.keep(part, found)
            print_phases("first pictures", found)
        elif part == "pair":
            order, stored = self._order(options)
            self.keep(part, run_window(part, order, options.drivers[0], stored))
        else:
            self.measure_window(options)

    def measure_window(self, options: argparse.Namespace) -> None:
        """Run the scripted minute and the ticks with each driver."""
        order, stored = self._order(options)
        for driver in options.drivers:
            found = run_window("session", order, driver, stored)
            # in another process: the no-op driver never frees the memory of uploads
            ticks = run_window("ticks", order, driver, stored)
            new = ("ticks", "ticks_p95", "ticks_in_render", "ticks_thread", "ticks_rounds")
            found |= {key: ticks[key] for key in new}
            solved = order["vertices"] <= options.solve_up_to
            found["pairs"] = f"{options.pairs} {'solved' if solved else 'SYNTHETIC'}"
            self.keep(driver, found)
            print_phases(f"{order['vertices']:,} vertices", found)

    def _order(self, options: argparse.Namespace) -> tuple[dict[str, Any], Path]:
        """Return the arguments of a window, and the cache with the eigenpairs of its mesh."""
        from meshmash_viewer.io.read import read_mesh

        mesh = read_mesh(self.mesh)
        stored = self.folder / f"{self.mesh.stem}-{options.pairs}"
        if not stored.exists():
            os.environ["XDG_CACHE_HOME"] = str(stored)
            prepare_store(mesh, options.pairs, mesh.n_vertices <= options.solve_up_to)
        return {
            "mesh": str(self.mesh), "pairs": options.pairs, "vertices": mesh.n_vertices
        }, stored  # fmt: skip


def print_phases(title: str, run: dict[str, Any]) -> None:
    """Print the largest gaps in each phase of the script."""
    print(
        f"\n{title}, {run['driver']}: largest gap in ms, all included / less drawing;"
        " 99 % less; largest less without looking at the machine"
    )
    for name, phase in run["phases"].items():
        print(
            f"  {name:28s} {phase['largest']:6.0f} / {phase['largest_less']:4.0f};"
            f" {phase['p99_less']:5.1f}; {phase['largest_raw']:4.0f}",
            flush=True,
        )


def rows(known: dict[str, Any]) -> dict[str, str]:
    """Return a column of the table: results by the text of their row."""
    lines: dict[str, str] = {}

    def put(text: str, form: str, *path: str, times: float = 1.0) -> float | None:
        value: Any = known
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        number = isinstance(value, int | float)
        lines[text] = "" if value is None else form.format(value * times if number else value)
        return value if number else None

    put("eigenpairs of the ticks", "{}", "no-op", "pairs")
    for key, text in TICKS.items():
        put(f"{text}, no-op driver (ms)", "{:.1f}", "no-op", "ticks", key)
        put(f"  {text}, 95 % within (ms)", "{:.1f}", "no-op", "ticks_p95", key)
        put(f"  {text}, rounds until the host took nothing", "{:.0f}", "no-op", "ticks_rounds", key)
        put(f"  {text}, of it in VTK's Render (ms)", "{:.1f}", "no-op", "ticks_in_render", key)
        put(f"  {text}, the thread's processor time (ms)", "{:.1f}", "no-op", "ticks_thread", key)
        put(f"{text}, software OpenGL (ms)", "{:.0f}", "software", "ticks", key)
    for key, text in TICKS.items():
        put(f"{text}, two meshes (ms)", "{:.1f}", "pair", "ticks", key)
        put(f"  {text}, two meshes, 95 % within (ms)", "{:.1f}", "pair", "ticks_p95", key)
    for driver in DRIVERS:
        put(f"largest gap, {driver}, all included (ms)", "{:.0f}", driver, "gaps", "largest")
        put(f"largest gap, {driver}, less drawing (ms)", "{:.0f}", driver, "gaps", "largest_less")
        put(f"99 % of gaps, {driver}, all included (ms)", "{:.1f}", driver, "gaps", "p99")
        put(f"99 % of gaps, {driver}, less drawing (ms)", "{:.1f}", driver, "gaps", "p99_less")
        put(f"200 notches of the wheel, {driver}", "{}", driver, "wheel")
        put(f"known mesh: first field after the mesh, {driver} (ms)", "{:.0f}",
            driver, "moments", "field", times=1e3)  # fmt: skip
    formula = put("formula: mesh, surface, tables, fields (MB)", "{:.0f}", "no-op", "formula")
    put("  live tables in it (MB)", "{:.0f}", "no-op", "tables")
    # Software OpenGL adds the memory of the driver: its copy of the mesh, and lists of triangles of
    # up to 36 MB each, whose number depends on the timing of its threads.
    for driver in DRIVERS:
        held = put(f"private memory beyond the empty window, {driver} (MB)", "{:.0f}",
                   driver, "private")  # fmt: skip
        lines[f"memory / formula, {driver}"] = f"{held / formula:.2f}" if held and formula else ""
    put("window painted after the start (s)", "{:.2f}", "start", "visible")
    put("window complete after the start (s)", "{:.2f}", "start", "complete")
    put("first preview after the file is read (s)", "{:.1f}", "solve", "moments", "field")
    put("first 20 exact pairs (s)", "{:.1f}", "solve", "moments", "pairs_20")
    put("all 100 exact pairs (s)", "{:.1f}", "solve", "moments", "pairs_all")
    put("largest gap meanwhile, less drawing (ms)", "{:.0f}", "solve", "gaps", "largest_less")
    return lines


def print_table(title: str, columns: dict[int, dict[str, Any]]) -> None:
    """Print all results as a table of Markdown."""
    cells = [rows(known) for known in columns.values()]
    print(f"\n| {title} | " + " | ".join(f"{size:,}" for size in columns) + " |")
    print("|---|" + "---|" * len(columns))
    for text in max(cells, key=len):
        values = [column.get(text, "") for column in cells]
        if any(values):
            print(f"| {text} | " + " | ".join(values) + " |")


def main() -> None:
    """Run the parts and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--sizes", type=int, nargs="*", default=[100_000, 500_000, 1_000_000])
    parser.add_argument("--parts", nargs="*", choices=PARTS, default=PARTS, help="none: table only")
    parser.add_argument("--drivers", nargs="+", choices=DRIVERS, default=DRIVERS)
    parser.add_argument("--pairs", type=int, default=300, help="stored for the scripted minute")
    parser.add_argument("--solve-up-to", type=int, default=150_000)
    parser.add_argument("--first-pairs", type=int, default=100, help="computed by `solve`")
    parser.add_argument("--folder", type=Path, help="where to keep meshes, pairs and results")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="interaction-") as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        columns = {}
        for size in options.sizes:
            column = Column(folder, options.mesh, size)
            for part in options.parts:
                column.measure(part, options)
            columns[size] = column.known
    print_table(options.mesh.stem, columns)


if __name__ == "__main__":
    main()

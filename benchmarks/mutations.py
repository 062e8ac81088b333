"""Single small faults in the package, chosen by seed, and whether the tests detect them.

    ./dev bench mutations [--count 200] [--seed 11] [--first 0] [--tree DIR] [--slow]

A fault reverses a comparison, exchanges + and - or `and` and `or`, adds one to a number, or negates
a returned condition. Each fault is put into a temporary copy of the tree. The tests named like the
module run first, then files that import it, then those of its folder, each file until its first
failure; a test that fails without the fault as well does not count. A line is printed for each
fault, and the shares at the end. Tests of windows need a display.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
COMPARISONS = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
EXCHANGED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.And: ast.Or, ast.Or: ast.And}
#: Largest number of files of tests that run because they import the module, the shortest first.
IMPORTING = 8
#: Tests of each folder of the package, quick tests first; the longest prefix counts.
TESTS = {
    "": "test_mesh test_health test_units test_public_api test_cli",
    "app": "app/test_session_end_to_end app/test_main_window app/test_use_cases",
    "app/dialogs": "app/test_dialogs app/test_gallery app/test_movie_dialog app/test_scene_dialog",
    "app/panels": "app/test_spectrum_panel app/test_profile_panel app/test_main_window",
    "app/tabs": "app/test_field_panel app/test_typing app/test_map_tab",
    "app/view": "app/view/test_ticks app/view/test_picture app/view/test_mesh_view",
    "cli": "test_cli test_cli_series test_cli_numbers test_streams",
    "features": "test_features test_filters test_truncation test_comparison test_decompose",
    "fields": "fields/test_families fields/test_maps model/test_live model/test_script",
    "io": "io/test_store io/test_write io/test_read io/test_session model/test_decomposition",
    "io/formats": "io/test_read io/test_ply io/test_off io/test_stl io/test_gltf io/test_vtk_maps",
    "learn": "test_classes test_smoothing test_cli_classes app/test_classes",
    "model": "model/test_document model/test_document_history model/test_live model/test_pair"
    " app/test_tasks model/test_script",
    "spectral": "test_preview model/test_previews test_eigensolver test_proof",
    "split": "test_split test_cli",
    "surface": "test_curvature test_distances test_clustering test_rays test_laplacian",
}


def faults(node: ast.AST) -> Iterator[tuple[Any, str]]:
    """Yield nodes of a module, each with the text of its replacement, without annotations."""
    changed: ast.AST | None = None
    match node:
        case ast.Compare(ops=[operator]) if type(operator) in COMPARISONS:
            changed = ast.Compare(node.left, [COMPARISONS[type(operator)]()], node.comparators)
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            changed = ast.BinOp(node.left, EXCHANGED[type(node.op)](), node.right)
        case ast.BoolOp():
            changed = ast.BoolOp(EXCHANGED[type(node.op)](), node.values)
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            changed = ast.Constant(number + 1)
        case ast.Return(value=ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()) as value):
            changed = ast.Return(ast.UnaryOp(ast.Not(), value))
    if changed is not None:
        text = ast.unparse(ast.fix_missing_locations(changed))
        yield node, text if isinstance(node, ast.Return) else f"({text})"
    for name, child in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for each in child if isinstance(child, list) else [child]:
                if isinstance(each, ast.AST) and not isinstance(each, ast.JoinedStr):
                    yield from faults(each)


def all_faults(tree: Path) -> list[tuple[str, int, str, str, bytes]]:
    """Return name, line, old text, new text and whole changed module of each fault."""
    found = []
    for path in sorted((tree / "meshmash_viewer").rglob("*.py")):
        source = path.read_bytes()
        lines = source.splitlines(keepends=True)
        starts = [sum(map(len, lines[:number])) for number in range(len(lines) + 1)]
        for node, text in faults(ast.parse(source)):
            start = starts[node.lineno - 1] + node.col_offset
            stop = starts[node.end_lineno - 1] + node.end_col_offset
            module = source[:start] + text.encode() + source[stop:]
            before = " ".join(source[start:stop].decode().split())
            name = path.relative_to(tree / "meshmash_viewer").as_posix()
            found.append((name, node.lineno, before, text, module))
    return found


def tests_of(tree: Path, module: str) -> list[str]:
    """Return the test files of a module."""
    folder, stem = module.rpartition("/")[0], Path(module).stem
    same = [str(each.relative_to(tree)) for each in (tree / "tests").rglob(f"test_{stem}.py")]
    dotted = "meshmash_viewer." + module.removesuffix(".py").replace("/", ".")
    files = sorted((tree / "tests").rglob("test_*.py"), key=lambda each: each.stat().st_size)
    importing = (each for each in files if f"{dotted} import" in each.read_text())
    same += [str(each.relative_to(tree)) for each in islice(importing, IMPORTING)]
    while folder not in TESTS:
        folder = folder.rpartition("/")[0]
    table = [f"tests/{name}.py" for name in TESTS[folder].split()]
    return list(dict.fromkeys([*same, *(name for name in table if (tree / name).exists())]))


class Trials:
    """Runs of tests in a copy of a tree, with one module changed."""

    def __init__(self, copy: Path, options: argparse.Namespace) -> None:
        self._copy, self._patience = copy, options.patience
        self._chosen = [] if options.slow else ["-m", "not slow"]
        self._broken: list[str] = []  # tests that fail without a fault

    def outcome(self, name: str, module: bytes) -> str:
        """Return the test that detects a changed module, or "survived"."""
        path = self._copy / "meshmash_viewer" / name
        whole = path.read_bytes()
        for file in tests_of(self._copy, name):
            while True:
                path.write_bytes(module)
                found = self._failing(file)
                path.write_bytes(whole)
                if found is None:
                    break
                if "::" not in found or self._failing(found) is None:
                    return f"killed: {found}"
                self._broken.append(found)
        return "survived"

    def _failing(self, tests: str) -> str | None:
        """Return the first test of a file that fails or takes too long; None if all pass."""
        if tests.startswith("tests/app/") and not os.environ.get("DISPLAY"):
            return None
        command = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider", *self._chosen]
        command += [f"--deselect={name}" for name in self._broken]
        environment = {**os.environ, "PYTHONPATH": str(self._copy)}
        try:
            done = subprocess.run(
                [*command, tests],
                cwd=self._copy,
                env=environment,
                capture_output=True,
                timeout=self._patience,
            )
        except subprocess.TimeoutExpired:
            return f"{tests} (timeout)"
        if done.returncode in (0, 5):  # 5: no test was selected
            return None
        lines = done.stdout.decode(errors="replace").splitlines()
        failed = [line.split(" - ")[0] for line in lines if line.startswith("FAILED ")]
        return failed[0].removeprefix("FAILED ") if failed else tests


def main() -> None:
    """Make one fault after the other, run the tests, and print which test detects it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="faults that are chosen")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--first", type=int, default=0, help="go on from this one")
    parser.add_argument("--tree", type=Path, default=ROOT, help="a checkout")
    parser.add_argument("--patience", type=float, default=240, help="seconds for a file of tests")
    parser.add_argument("--slow", action="store_true", help="run slow tests as well")
    options = parser.parse_args()
    chosen = random.Random(options.seed).sample(all_faults(options.tree), options.count)
    shares: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        left_out = shutil.ignore_patterns(".*", "build", "dist", "shots")
        shutil.copytree(options.tree, copy, ignore=left_out)
        trials = Trials(copy, options)
        for number in range(options.first, len(chosen)):
            name, line, before, text, module = chosen[number]
            began = time.monotonic()
            found = trials.outcome(name, module)
            shares["timeout" if found.endswith("(timeout)") else found.partition(":")[0]] += 1
            seconds = round(time.monotonic() - began)
            print(f"{number} {name}:{line}: {before} → {text}: {found} ({seconds} s)", flush=True)
    print(dict(shares))


if __name__ == "__main__":
    main()

"""Single small faults in the package, chosen by seed, and whether the tests detect them.

    ./dev bench mutations [--count 200] [--seed 11] [--first 0] [--tree DIR] [--record DIR]

A fault reverses a comparison, exchanges + and - or `and` and `or`, adds one to a number, or negates
a returned condition. The quick tests first run once under coverage.py, which records the lines that
each test executes. Then each fault is put into a temporary copy of the tree, where tests that
execute the changed line run until one fails. It must fail twice with the fault, and pass without.
Lines outside functions, compiled functions, child processes and threads of Qt are not recorded. If
no recorded test executes a line, tests that execute or import its module run. `--record` keeps the
recording.
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
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from typing import Any

import pytest

try:
    import coverage
except ImportError:
    sys.exit("mutations: coverage is missing; install it with: .venv/bin/pip install coverage")

ROOT = Path(__file__).resolve().parent.parent
COMPARISONS = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
EXCHANGED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.And: ast.Or, ast.Or: ast.And}
#: Largest number of tests that run for a fault, and the sum of their recorded seconds.
MOST, SECONDS = 40, 60
#: Seconds after which tests that have not ended count as failed.
PATIENCE = 300


def faults(node: ast.AST, statement: int = 0, inside: bool = False) -> Iterator[Any]:
    """Yield nodes of a module, each with the text of its replacement, without annotations.

    The third value is the first line of the statement. It is 0 in code that is outside functions or
    in a compiled function.
    """
    if inside and isinstance(node, ast.stmt):
        statement = node.lineno
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
        case ast.FunctionDef():
            decorators = " ".join(map(ast.unparse, node.decorator_list))
            inside = "jit" not in decorators and "compiled(" not in decorators
        case ast.Lambda():
            statement = statement or node.lineno
    if changed is not None:
        text = ast.unparse(ast.fix_missing_locations(changed))
        yield node, text if isinstance(node, ast.Return) else f"({text})", statement
    for name, child in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for each in child if isinstance(child, list) else [child]:
                if isinstance(each, ast.AST) and not isinstance(each, ast.JoinedStr):
                    yield from faults(each, statement, inside)


def all_faults(tree: Path) -> list[tuple[str, int, int, str, str, bytes]]:
    """Return module, line, line of the statement, old, new text and whole module of each fault."""
    found = []
    for path in sorted((tree / "meshmash_viewer").rglob("*.py")):
        source = path.read_bytes()
        lines = source.splitlines(keepends=True)
        starts = [sum(map(len, lines[:number])) for number in range(len(lines) + 1)]
        for node, text, statement in faults(ast.parse(source)):
            start = starts[node.lineno - 1] + node.col_offset
            stop = starts[node.end_lineno - 1] + node.end_col_offset
            module = source[:start] + text.encode() + source[stop:]
            before = " ".join(source[start:stop].decode().split())
            name = path.relative_to(tree / "meshmash_viewer").as_posix()
            found.append((name, node.lineno, statement, before, text, module))
    return found


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Record the lines that a test executes, and its seconds if it passes."""
    recorder = coverage.Coverage.current()
    recorder.switch_context(item.nodeid)
    failed, began = item.session.testsfailed, time.monotonic()
    result = yield
    if item.session.testsfailed == failed:
        with Path(recorder.get_option("run:data_file")).with_name("seconds").open("a") as file:
            file.write(f"{time.monotonic() - began:.3f} {item.nodeid}\n")
    return result


class Trials:
    """Runs of tests in a copy of a tree, with one module changed."""

    def __init__(self, copy: Path, record: Path, tests: list[str]) -> None:
        self._copy = copy
        self._environment = {
            **os.environ,
            "PYTHONPATH": f"{copy}{os.pathsep}{Path(__file__).parent}",
        }
        self._broken: set[str] = set()  # tests that fail without a fault
        if not (record / "seconds").exists():
            self._record(record, tests)
        lines = [line.split(" ", 1) for line in (record / "seconds").read_text().splitlines()]
        self._seconds = {test: float(seconds) for seconds, test in lines}
        self._data = coverage.CoverageData(record / "lines")
        self._data.read()

    def _record(self, record: Path, tests: list[str]) -> None:
        """Run the quick tests, and write what they execute to a folder."""
        record.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "coverage", "run", f"--data-file={record / 'lines'}"]
        command += [f"--include={self._copy}/meshmash_viewer/*", "-m", "pytest", "-q"]
        command += ["-o", "faulthandler_timeout=0", "-p", "mutations", "-m", "not slow", *tests]
        subprocess.run(command, cwd=self._copy, env=self._environment)

    def tests_of(self, name: str, line: int, statement: int) -> tuple[list[str], int, bool]:
        """Return tests to run, the number that execute a line, and whether it is never executed.

        Tests whose file imports the module come first, then those that take the least time.
        The first case of a parametrized test comes before the second case of any test.
        """
        ending = f"/meshmash_viewer/{name}"
        file = next((file for file in self._data.measured_files() if file.endswith(ending)), "")
        executed = self._data.contexts_by_lineno(file)
        contexts = {*executed.get(line, executed.get(statement, ()))} if statement else {""}
        executing = contexts & self._seconds.keys()
        module = "meshmash_viewer." + name.removesuffix(".py").replace("/", ".")
        importing = {
            path.relative_to(self._copy).as_posix()
            for path in (self._copy / "tests").rglob("test_*.py")
            if f"{module} import" in path.read_text()
        }
        related = {test for tests in executed.values() for test in tests}
        related |= {test for test in self._seconds if test.partition("::")[0] in importing}
        candidates = (executing or related & self._seconds.keys()) - self._broken
        cases: Counter[str] = Counter()
        ranked = []
        for test in sorted(candidates, key=self._seconds.__getitem__):
            function = test.partition("[")[0]
            ranked.append((test.partition("::")[0] not in importing, cases[function], test))
            cases[function] += 1
        tests = [test for *_, test in sorted(ranked, key=itemgetter(0, 1))[:MOST]]
        started = accumulate((self._seconds[test] for test in tests), initial=0.0)
        chosen = [test for test, start in zip(tests, started, strict=False) if start < SECONDS]
        return chosen, len(executing), not contexts

    def outcome(self, name: str, module: bytes, tests: list[str]) -> str:
        """Return the test that detects a changed module, or "survived"."""
        path = self._copy / "meshmash_viewer" / name
        whole = path.read_bytes()
        compiles = b"@compiled" in module or b"@numba" in module
        while tests:
            with tempfile.TemporaryDirectory() as kernels:
                path.write_bytes(module)
                cache = {"NUMBA_CACHE_DIR": kernels} if compiles else {}
                failed = self._failing(tests, **cache)
                again = failed and self._failing(failed, **cache)
                path.write_bytes(whole)
            if not failed:
                break
            if broken := self._failing(failed):
                self._broken.update(broken)
            elif again:
                return f"detected by {again[0]}"
            tests = [test for test in tests if test not in failed]
        return "survived"

    def _failing(self, tests: list[str], **environment: str) -> list[str]:
        """Return the first test that fails, or all tests if pytest ends early or takes too long."""
        command = [sys.executable, "-m", "pytest", "-qx", "-o", "faulthandler_timeout=0", *tests]
        environment = {**self._environment, "PYTHONDONTWRITEBYTECODE": "1", **environment}
        options: Any = {"cwd": self._copy, "env": environment, "capture_output": True}
        try:
            done = subprocess.run(command, timeout=PATIENCE, **options)
        except subprocess.TimeoutExpired:
            return tests
        if done.returncode == 0:
            return []
        lines = done.stdout.decode(errors="replace").splitlines()
        lines = [f"{line} " for line in lines if line.startswith(("FAILED ", "ERROR "))]
        return [test for test in tests if any(f" {test} " in line for line in lines)] or tests


def main() -> None:
    """Make one fault after the other, run tests, and print which test detects it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tests", nargs="*", help="tests that are recorded, all by default")
    parser.add_argument("--count", type=int, default=200, help="faults that are chosen")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--first", type=int, default=0, help="go on from this one")
    parser.add_argument("--tree", type=Path, default=ROOT, help="a checkout")
    parser.add_argument("--record", type=Path, help="folder of a recording, made if it is missing")
    options = parser.parse_args()
    chosen = random.Random(options.seed).sample(all_faults(options.tree), options.count)
    shares: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        left_out = shutil.ignore_patterns(".*", "build", "dist", "shots")
        shutil.copytree(options.tree, copy, ignore=left_out)
        trials = Trials(copy, (options.record or Path(folder) / "record").absolute(), options.tests)
        for number in range(options.first, len(chosen)):
            name, line, statement, before, text, module = chosen[number]
            began = time.monotonic()
            tests, executing, never = trials.tests_of(name, line, statement)
            found = trials.outcome(name, module, tests)
            where = "never executed" if never else "executed"
            shares[where] += 1
            shares[f"{where}, detected"] += found != "survived"
            seconds = round(time.monotonic() - began)
            print(
                f"{number} {name}:{line}: {before} → {text}: {found}"
                f" ({executing} tests execute the line, {len(tests)} chosen, {seconds} s)",
                flush=True,
            )
    for where in ("executed", "never executed"):
        print(f"{where}: {shares[f'{where}, detected']} of {shares[where]} detected")


if __name__ == "__main__":
    main()

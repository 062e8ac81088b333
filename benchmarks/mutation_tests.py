"""Which tests notice what: each test's functions, recorded once, and runs of chosen tests.

A run is a fork of a process that has imported what is slow to import and nothing of the package,
in a copy of the tree of its own, so that processes which tests start see the fault too.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from mutation_operators import Mutation

__all__ = ["Reach", "Run", "Tests", "copy_tree", "import_what_is_slow", "noticed_by"]

#: Bytes that a test may take of the machine, should a fault make it ask for terabytes.
_MEMORY = 12 << 30
#: Exit statuses of a run: pytest's, and one beside.
PASSED, FAILED, NO_TESTS, OUT_OF_TIME = 0, 1, 5, -signal.SIGALRM
_SLOW_IMPORTS = (
    "joblib",
    "matplotlib.colors",
    "nibabel",
    "numba",
    "platformdirs",
    "psutil",
    "psygnal",
    "pyarrow.parquet",
    "PySide6.QtTest",
    "PySide6.QtWidgets",
    "pyvista",
    "robust_laplacian",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "scipy.sparse.linalg",
    "scipy.spatial",
    "threadpoolctl",
    "tqdm",
    "trimesh",
)


def import_what_is_slow() -> None:
    """Import what every run needs, but for the package itself, with one thread a process."""
    # Before anything that counts cores.
    for name in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR", "NUMBA"):
        os.environ[f"{name}_NUM_THREADS"] = "1"
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    for name in _SLOW_IMPORTS:
        import_module(name)


def copy_tree(root: Path, copy: Path) -> None:
    """Copy what git knows or would add, with its times, which compiled kernels go by.

    Over an older copy, whose test files that have gone go too.
    """
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    for old in (copy / "tests").rglob("test_*.py"):
        old.unlink()
    for name in filter(None, listed.split("\0")):
        source = root / name
        if source.is_file() and not source.is_symlink():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy / name)


@dataclass(frozen=True)
class Reach:
    """What a test ran.

    Parameters
    ----------
    test : str
        As pytest names it.
    seconds : float
    functions : frozenset of str
        ``path:name`` of all functions of the package that it entered, in its own process.
    """

    test: str
    seconds: float
    functions: frozenset[str]

    @cached_property
    def modules(self) -> frozenset[str]:
        """Modules of these functions."""
        return frozenset(function.partition(":")[0] for function in self.functions)


class _Chosen:
    """Runs chosen tests in the order given, each for so many seconds at most."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._rank = {test: rank for rank, test in enumerate(seconds)}
        self._seconds = seconds

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self._rank),
            key=lambda item: self._rank[item.nodeid],
        )

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        signal.alarm(int(self._seconds[item.nodeid]))  # ends the process, whatever it is at
        try:
            return (yield)
        finally:
            signal.alarm(0)


class _Recorder:
    """Writes down which functions each test enters, and how long it takes."""

    def __init__(self, tree: Path, record: Path) -> None:
        self._package = str(tree / "meshmash_viewer") + os.sep
        self._tree = tree
        self._codes: set[Any] = set()
        self._sink = record.open("w")
        self._seconds = 0.0
        self._passed = True

    def _trace(self, frame: Any, event: str, argument: Any) -> None:
        self._codes.add(frame.f_code)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        self._codes, self._seconds, self._passed = set(), 0.0, True
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]
            functions = sorted(
                f"{Path(code.co_filename).relative_to(self._tree)}:{_plain(code.co_qualname)}"
                for code in self._codes
                if code.co_filename.startswith(self._package)
            )
            line = [item.nodeid, self._seconds, self._passed, functions]
            print(json.dumps(line), file=self._sink, flush=True)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self._seconds += report.duration
        self._passed &= report.outcome == "passed"


def _plain(name: str) -> str:
    """Qualified name as mutations have it: without what lies between a function and its own."""
    names = [part for part in name.split(".") if not part.startswith("<")]
    return ".".join(names) or "<module>"


class Run:
    """Tests at work in a process of their own.

    Parameters
    ----------
    tree : Path
        A copy of the tree.
    tests : sequence of str
        Files, or tests of them.
    seconds : float
        What they may take.
    plugin : object
        Of pytest.
    first_failure : bool
        Whether the first failure ends it.
    """

    def __init__(
        self, tree: Path, tests: Sequence[str], seconds: float, plugin: Any, first_failure: bool
    ) -> None:
        self.log = tree.parent / f"{tree.name}.log"
        self._end = time.monotonic() + seconds
        self._child = os.fork()
        if self._child == 0:
            status = 70
            try:
                status = _run(tree, tests, self.log, plugin, first_failure)
            except BaseException:  # noqa: BLE001 - the parent's stack is not to be unwound here
                traceback.print_exc()
            finally:
                os._exit(status)

    def status(self) -> int | None:
        """How it ended, as pytest says it or `OUT_OF_TIME`; None while it runs."""
        done, code = os.waitpid(self._child, os.WNOHANG)
        if done:
            _end(self._child)
            return os.waitstatus_to_exitcode(code)
        if time.monotonic() < self._end:
            return None
        _end(self._child)
        os.waitpid(self._child, 0)
        return OUT_OF_TIME


def _end(group: int) -> None:
    """End a run and whatever it has started and left behind."""
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return


def _run(tree: Path, tests: Sequence[str], log: Path, plugin: Any, first_failure: bool) -> int:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    temporary = tree.parent / f"{tree.name}-temporary"
    temporary.mkdir(exist_ok=True)
    os.environ.update(
        PYTHONPATH=str(tree), HOME=str(temporary), TMPDIR=str(temporary), PYTHONHASHSEED="0"
    )
    os.chdir(tree)
    # In the place of the folder of this script, whose modules have names that tests use too.
    sys.path[0] = str(tree)
    files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
    options = ["-q", "-p", "no:cacheprovider", "--tb=line", f"--basetemp={temporary}/pytest"]
    if first_failure:
        options.append("-x")
    return int(pytest.main([*options, *files], plugins=[plugin]))


class Tests:
    """The tests of a tree that has no fault, and what each reaches.

    Parameters
    ----------
    tree : Path
        A copy of the tree, where kernels have been compiled.
    reaches : list of Reach
        Of tests that passed.
    """

    def __init__(self, tree: Path, reaches: list[Reach]) -> None:
        self._tree = tree
        self._reaches = reaches
        self._importers = _importers(tree)

    @classmethod
    def recorded(cls, tree: Path, record: Path, say: Callable[[str], None]) -> Tests:
        """Run the tests of every file that has changed since, and write down what each reaches.

        What fails here is left out.
        """
        files = {
            str(path.relative_to(tree)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted((tree / "tests").rglob("test_*.py"))
            if "app" not in path.parts
        }
        known = json.loads(record.read_text()) if record.exists() else {}
        known = {file: entry for file, entry in known.items() if entry["digest"] == files.get(file)}
        if missing := [file for file in files if file not in known]:
            say(f"recording which functions the tests of {len(missing)} files enter")
            for file in missing:
                known[file] = {"digest": files[file], "tests": []}
            for test, *found in _record(tree, missing):
                known[test.partition("::")[0]]["tests"].append([test, *found])
            record.write_text(json.dumps(known))
        reaches = []
        for test, seconds, passed, functions in (
            found for entry in known.values() for found in entry["tests"]
        ):
            if passed:
                reaches.append(Reach(test, seconds, frozenset(functions)))
            else:
                say(f"left out, it does not pass here: {test}")
        return cls(tree, reaches)

    def noticing(self, mutation: Mutation, seconds: float, first: str = "") -> list[Reach]:
        """Tests that enter what a fault changes: those named like the module, then the quick ones.

        Then those that enter its module, or bear its name: what runs in another process is not
        seen to be entered.

        Parameters
        ----------
        mutation : Mutation
        seconds : float
            What they may take together, as they were recorded.
        first : str
            The test that noticed it in an earlier run.
        """
        entering = set(self._entering(mutation))
        own = f"test_{Path(mutation.path).stem}"
        named = {reach for reach in self._reaches if Path(_file(reach)).stem == own}
        beside = {reach for reach in self._reaches if mutation.path in reach.modules}
        chosen, spent = [], 0.0

        def rank(reach: Reach) -> tuple[bool, bool, bool, float, str]:
            entered = reach in entering or reach in named
            return reach.test != first, not entered, reach not in named, reach.seconds, reach.test

        for reach in sorted(entering | named | beside, key=rank):
            if spent + reach.seconds <= seconds or not chosen:
                chosen.append(reach)
                spent += reach.seconds
        return chosen

    def _entering(self, mutation: Mutation) -> list[Reach]:
        whole = f"{mutation.path}:"
        # A nested function, a closure, the function, its class: as near as a test comes. Kernels
        # enter nothing when they run, and child processes are not seen.
        parts = mutation.place.split(".")
        for length in range(len(parts), 0, -1):
            name = whole + ".".join(parts[:length])
            found = [r for r in self._reaches if name in r.functions]
            if found:
                return found
        importers = self._importers.get(mutation.path, [])
        names, users = {parts[0]}, set()
        while (
            more := {user.split(".")[0] for user in _users(self._tree / mutation.path, names)}
            - names
        ):
            names |= more
        for module in (mutation.path, *importers):
            users |= {f"{module}:{user}" for user in _users(self._tree / module, names)}
        found = [reach for reach in self._reaches if reach.functions & users]
        for modules in ([mutation.path], importers):
            found = found or [reach for reach in self._reaches if reach.modules & set(modules)]
        return found

    def start(self, mutation: Mutation, tests: Sequence[Reach], copy: Path, patience: float) -> Run:
        """Put a fault into a new copy of the tree and run tests there.

        Parameters
        ----------
        mutation : Mutation
        tests : sequence of Reach
        copy : Path
            Made here; removed by the caller.
        patience : float
            Seconds that each may take beyond ten times what it took without the fault.
        """
        shutil.copytree(self._tree, copy)
        module = copy / mutation.path
        source = module.read_bytes()
        module.write_bytes(mutation.applied(source))
        if b"numba" in source or b"compiled(" in source:
            self._forget_kernels(copy, mutation.path)
        seconds = {reach.test: patience + 10.0 * reach.seconds for reach in tests}
        return Run(copy, list(seconds), sum(seconds.values()), _Chosen(seconds), first_failure=True)

    def _forget_kernels(self, copy: Path, path: str) -> None:
        """Compiled kernels hold what they call: numba looks at their own file only."""
        for other in (path, *self._importers.get(path, ())):
            cache = (copy / other).parent / "__pycache__"
            for pattern in ("*.nbi", "*.nbc"):
                for kernel in cache.glob(f"{Path(other).stem}.{pattern}"):
                    kernel.unlink()


def noticed_by(run: Run, status: int) -> str | None:
    """The test that failed, or how else the run ended; None where all passed."""
    if status == PASSED:
        return None
    if status == OUT_OF_TIME:
        return "out of time"
    lines = run.log.read_text(errors="replace").splitlines()
    if status == NO_TESTS:
        raise RuntimeError(f"no test was found: {lines[-5:]}")
    named = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return named[0].split(" - ")[0] if named else f"exit status {status}"


def _record(tree: Path, files: Sequence[str]) -> list[Any]:
    """Tests of some files: name, seconds, whether it passed, functions entered."""
    record = tree.parent / "record.txt"
    run = Run(tree, files, 3600.0, _Recorder(tree, record), first_failure=False)
    while (status := run.status()) is None:
        time.sleep(0.1)
    if status not in (PASSED, FAILED):
        raise SystemExit(f"the tests ended with {status}: see {run.log}")
    return [json.loads(line) for line in record.read_text().splitlines()]


def _file(reach: Reach) -> str:
    return reach.test.partition("::")[0]


def _users(module: Path, names: set[str]) -> set[str]:
    """Functions and methods of a module that mention one of some names."""
    found = set()
    tree = ast.parse(module.read_bytes())
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    for prefix, owner in [("", tree), *((f"{node.name}.", node) for node in classes)]:
        for node in owner.body:
            if isinstance(node, ast.FunctionDef) and any(
                getattr(part, "id", getattr(part, "attr", None)) in names for part in ast.walk(node)
            ):
                found.add(prefix + node.name)
    return found


def _importers(tree: Path) -> dict[str, list[str]]:
    """For each module of the package, those that import from it."""
    found: dict[str, list[str]] = {}
    texts = {
        str(path.relative_to(tree)): path.read_text()
        for path in (tree / "meshmash_viewer").rglob("*.py")
    }
    for path in texts:
        dotted = path.removesuffix(".py").replace("/", ".")
        package, _, name = dotted.rpartition(".")
        found[path] = [
            other
            for other, text in texts.items()
            if other != path
            and (f"from {dotted} import" in text or f"from {package} import {name}" in text)
        ]
    return found

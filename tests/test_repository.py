"""Nothing in the repository depends on the machine it was written on."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@cache
def text_files() -> list[Path]:
    """Files under version control, or, without git, what is not made by tools."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
        ).stdout.split("\0")
        paths = [ROOT / name for name in listed if name]
    except (OSError, subprocess.CalledProcessError):
        made = {".venv", ".git", "build", "dist", "shots", "__pycache__"}
        paths = [path for path in ROOT.rglob("*") if not made & set(path.parts)]
    texts = []
    for path in paths:
        if path.is_file():
            content = path.read_bytes()
            if b"\0" not in content[:8192]:
                texts.append(path)
    return texts


@pytest.mark.parametrize(
    ("what", "pattern"),
    [
        ("a path of somebody's machine", r"(?<![\w.])/(?:home|Users|work|root|mnt)/[\w.]"),
        ("a drive of somebody's machine", r"\b[A-Z]:\\\\?(?:Users|work)"),
        ("a temporary folder", r"(?<![\w.}])/tmp/\w"),
        (
            "a package index",
            r"--(?:extra-)?index-url|--find-links|--trusted-host|files\.pythonhosted",
        ),
        ("an address of a package", r"^[\w.-]+\s*@\s*\w+://"),
    ],
)
def test_no_file_names(what: str, pattern: str) -> None:
    found = []
    for path in text_files():
        if path == Path(__file__).resolve():
            continue
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            if re.search(pattern, line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, f"{what}: " + "; ".join(found)


def test_constraints_are_names_and_versions() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert line.startswith("#") or re.fullmatch(r"[\w.-]+==[\w.]+", line), line


def test_the_samples_are_small() -> None:
    samples = list((ROOT / "meshmash_viewer" / "samples").glob("*.npz"))
    assert samples
    assert sum(path.stat().st_size for path in samples) < 1.5e6


def test_the_page_on_the_architecture_names_files_that_exist() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_/]+(?:\.py|/))`", page)) - {"meshmash_viewer/"}
    assert len(named) > 40
    package = ROOT / "meshmash_viewer"
    missing = {
        name for name in named if not any((place / name).exists() for place in (package, ROOT))
    }
    assert not missing


#: What only POSIX has: a test file that names one while it is imported is of no use elsewhere.
_POSIX = {
    "os": {"fork", "geteuid", "getpgid", "killpg", "mkfifo", "seteuid", "uname"},
    "signal": {"SIGALRM", "SIGHUP", "SIGKILL", "SIGPROF", "SIGUSR1", "setitimer"},
}
_POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
#: Imported by tests of Linux alone, after they have been skipped elsewhere.
_OF_LINUX = {"tests/fuzz/trials.py"}


def at_import(node: ast.AST) -> Iterator[ast.AST]:
    """What is evaluated when a module is imported: all but the bodies of functions."""
    for child in ast.iter_child_nodes(node):
        yield child
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            for part in (*child.decorator_list, child.args):
                yield part
                yield from at_import(part)
        elif not isinstance(child, ast.Lambda):
            yield from at_import(child)


def posix_only(node: ast.AST) -> str:
    """What a node names that only POSIX has; empty for all others."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        if node.attr in _POSIX.get(node.value.id, ()):
            return f"{node.value.id}.{node.attr}"
    elif isinstance(node, ast.Import):
        return ", ".join({alias.name for alias in node.names} & _POSIX_MODULES)
    elif isinstance(node, ast.ImportFrom) and node.module in _POSIX_MODULES:
        return str(node.module)
    elif isinstance(node, ast.Constant) and node.value in ("bash", "sh"):
        return str(node.value)
    return ""


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """The test files, parsed."""
    return {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in (ROOT / "tests").rglob("*.py")
    }


@pytest.mark.slow
def test_test_files_can_be_imported_on_windows(trees: dict[str, ast.Module]) -> None:
    found = [
        f"{path}:{node.lineno}: {name}"
        for path, tree in trees.items()
        if path not in _OF_LINUX
        for node in at_import(tree)
        if (name := posix_only(node))
    ]
    assert found == []


@pytest.mark.slow
def test_no_test_needs_a_shell(trees: dict[str, ast.Module]) -> None:
    shells = [
        f"{path}:{node.lineno}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.List) and node.elts and posix_only(node.elts[0]) in ("bash", "sh")
    ]
    assert shells == []

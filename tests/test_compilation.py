"""Cache folder of compiled kernels, tested in separate interpreters."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from faults import raises
from tiers import slow_but

from meshmash_viewer.spectral.engine import compiler

CODE = """
import os
{patch}
from meshmash_viewer.spectral.engine import kernels
from numba.core import config
print(config.CACHE_DIR)
assert not config.CACHE_DIR or os.path.isdir(config.CACHE_DIR)
"""


def place(patch: str) -> str:
    environment = {key: text for key, text in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    run = [sys.executable, "-c", CODE.format(patch=patch)]
    return subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
def test_numba_finds_its_own_place_where_it_can() -> None:
    assert place("").strip() == ""
    # One writable folder of two is enough.
    unwritable = "real = os.access; os.access = lambda path, mode: 'engine' not in str(path) and "
    assert place(f"{unwritable} real(path, mode)").strip() == ""


@pytest.mark.slow
def test_an_account_that_can_write_nowhere_gets_a_place_that_goes_with_the_process() -> None:
    folder = place("os.access = lambda *_: False").strip()
    assert "meshmash-kernels-" in folder
    assert not Path(folder).exists()


@pytest.mark.slow
def test_a_place_of_the_users_own_is_kept(tmp_path: Path) -> None:
    own = f"os.environ['NUMBA_CACHE_DIR'] = {str(tmp_path)!r}"
    assert place(own).strip() == str(tmp_path)
    assert place(f"{own}; os.access = lambda *_: False").strip() == str(tmp_path)


WITHOUT = """
import sys
sys.modules["numba"] = None
import meshmash_viewer as mv
from meshmash_viewer.errors import InputError
mesh = mv.Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2]])
L, M = mv.cotangent_laplacian(mesh)
def preview():
    from meshmash_viewer.spectral.preview import preview_eigenpairs
    preview_eigenpairs(mesh, 4)
"""
SENTENCE = "numba, which compiles the eigensolver, is missing: install it"


def without_compiler(code: str) -> subprocess.CompletedProcess[str]:
    run = [sys.executable, "-c", WITHOUT + code]
    return subprocess.run(run, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "work",
    slow_but(
        ["mv.solve(L, M, 2)"],
        [
            "mv.solve(L, M, 2)",
            "mv.compute_hks(mesh, max_eigenvalue=1.0)",
            "preview()",
            "mv.view(mesh)",
        ],
    ),
)
def test_without_a_compiler_what_needs_it_says_so_at_once(work: str) -> None:
    ended = without_compiler(f"try:\n    {work}\nexcept InputError as fault:\n    print(fault)")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith(SENTENCE)
    assert len(ended.stdout.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", slow_but([], [["info", "a.ply"], ["features", "a.ply", "-o", "b"], []])
)
def test_without_a_compiler_the_command_ends_at_its_start(arguments: list[str]) -> None:
    ended = without_compiler(
        f"from meshmash_viewer.cli.main import main\nsys.exit(main({arguments}))"
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"meshmash-viewer: {SENTENCE}")
    assert len(ended.stderr.splitlines()) == 1
    # Commands that need no compiler still work.
    ended = without_compiler("from meshmash_viewer.cli.main import main\nmain(['--help'])")
    assert ended.returncode == 0
    assert "usage" in ended.stdout


def test_a_compiler_that_does_not_work_beside_what_is_installed_says_why(tmp_path: Path) -> None:
    (tmp_path / "numba.py").write_text("raise ImportError('Numba needs NumPy 2.2 or less')")
    code = "try:\n    from meshmash_viewer.spectral.engine import kernels\n"
    code += "except InputError as fault:\n    print(fault)"
    header = WITHOUT.replace(
        'sys.modules["numba"] = None', f"sys.path.insert(0, {str(tmp_path)!r})"
    )
    run = [sys.executable, "-c", header + code]
    printed = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    assert "does not work here (Numba needs NumPy 2.2 or less): install it" in printed


def test_a_missing_compiler_is_said_before_it_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiler, "find_spec", lambda _: None)
    with raises("package-missing", SENTENCE):
        compiler.import_compiler()

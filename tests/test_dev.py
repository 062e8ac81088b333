"""The script `dev` of a clone: its commands, and features that exist on Linux alone."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / "dev.py"


@pytest.fixture
def dev() -> ModuleType:
    spec = importlib.util.spec_from_file_location("dev", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("words", "status"), [(["help"], 0), ([], 0), (["tset"], 2)])
def test_help_lists_every_command(dev: ModuleType, words: list[str], status: int) -> None:
    run = subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True)
    assert run.returncode == status
    assert all(f"dev.py {name} " in run.stdout for name in dev.COMMANDS)


@pytest.mark.parametrize("arguments", [(), ("tests/test_units.py",)])
def test_every_step_runs_though_one_fails_and_none_asks_for_a_screen_elsewhere(
    dev: ModuleType, arguments: tuple[str], monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    calls: list[tuple[str, ...]] = []

    def call(*command: object, **_: str) -> int:
        calls.append(tuple(map(str, command)))
        return int("mypy" in command)

    monkeypatch.setattr(dev, "LINUX", False)
    monkeypatch.setattr(dev, "prepare", lambda: None)
    monkeypatch.setattr(dev.os, "environ", dict(os.environ))
    monkeypatch.setattr(dev, "call", call)
    assert dev.main("test", *arguments) == 1
    assert {command[0] for command in calls} == {str(dev.PYTHON)}
    assert any("pytest" in command for command in calls)
    printed = capfd.readouterr().out
    assert printed.count("FAILED  mypy (0 s)") == 1
    assert printed.count("passed") == len(calls) - 1 == 4


ONCE = """
from pathlib import Path
import os

def test_passes():
    pass

def test_once():
    been = Path(__file__).with_name("been")
    if not been.exists():
        been.touch()
        {fault}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "status"),
    [("assert False", 0), ("os._exit(3)", 0), ("been.unlink(); assert False", 1)],
    ids=["once", "crash", "always"],
)
def test_what_failed_in_parallel_is_repeated_alone(
    dev: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fault: str, status: int
) -> None:
    (tmp_path / "test_it.py").write_text(ONCE.format(fault=fault))
    monkeypatch.setattr(dev, "HERE", tmp_path)
    monkeypatch.setattr(dev, "PYTHON", sys.executable)
    monkeypatch.setattr(dev, "LINUX", False)
    passed_alone: list[str] = []
    assert dev.repeating(passed_alone, "-n", "2") == status
    assert passed_alone == ([] if status else ["test_it.py::test_once"])

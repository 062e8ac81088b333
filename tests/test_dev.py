"""The script `dev` of a clone: its commands, and features that exist on Linux alone."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

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
    shown = run.stderr if status else run.stdout
    assert all(f"dev.py {name} " in shown for name in dev.COMMANDS)


@pytest.mark.parametrize("arguments", [[], ["tests/test_units.py"]])
def test_no_virtual_screen_is_asked_for_elsewhere(
    dev: ModuleType, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        calls.append([str(word) for word in command])
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(dev, "LINUX", False)
    monkeypatch.setattr(dev, "STAMP", SCRIPT.parent / "none")
    monkeypatch.setattr(dev, "make_environment", lambda: None)
    monkeypatch.setattr(dev, "one_thread_each", lambda: None)
    monkeypatch.setattr(dev.subprocess, "run", run)
    monkeypatch.setattr(dev, "begin", lambda *command: run(list(command)))
    monkeypatch.setattr(dev, "finish", lambda done: done.returncode)
    assert dev.main(["test", *arguments]) == 0
    assert {command[0] for command in calls} == {str(dev.PYTHON)}
    assert any("pytest" in command for command in calls)


def test_one_failed_step_fails_the_test_and_ends_no_other(
    dev: ModuleType, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    real_begin = dev.begin
    monkeypatch.setattr(dev, "make_environment", lambda: None)
    monkeypatch.setattr(dev, "install_system_libraries", lambda: None)
    monkeypatch.setattr(dev, "one_thread_each", lambda: None)
    monkeypatch.setattr(dev, "with_windows", lambda *command: 0)
    monkeypatch.setattr(dev, "call", lambda *command: 0)
    monkeypatch.setattr(
        dev, "begin", lambda *_: real_begin(sys.executable, "-c", "print('a fault'); exit(1)")
    )
    assert dev.main(["test"]) == 1
    printed = capfd.readouterr().out
    assert "FAILED  mypy" in printed
    assert "a fault" in printed
    assert printed.count("passed") == 4


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
    monkeypatch.setattr(dev, "with_windows", dev.call)
    passed_alone: list[str] = []
    assert dev.run_in_parallel(["-n", "2"], passed_alone) == status
    assert passed_alone == ([] if status else ["test_it.py::test_once"])

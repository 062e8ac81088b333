"""Child processes: limits of readers, launchers as on Windows, and termination."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from long_readers import CORNERS, filling, honest, many, refusing, spinning
from tiers import slow

from meshmash_viewer import work as process
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import LimitExceeded, RawMesh, ReadLimits, read_guarded
from meshmash_viewer.model import worker
from meshmash_viewer.work import ProcessTree, call_in_child, end_group, start_child

pytestmark = pytest.mark.skipif(os.name != "posix", reason="makes programs of scripts")

#: Script that starts another process and waits for it, as the Windows launcher does.
LAUNCHER = """#!{python} -S
import subprocess, sys
sys.exit(subprocess.call([{program!r}, *sys.argv[1:]]))
"""


@pytest.fixture
def depth(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Put launchers in front of the interpreter, one by default; return their number."""
    program, n_launchers = sys.executable, getattr(request, "param", 1)
    for at in range(n_launchers):
        launcher = tmp_path / f"python{at}"
        text = LAUNCHER.format(python=Path(sys.executable).resolve(), program=program)
        launcher.write_text(text, encoding="utf-8")
        launcher.chmod(0o755)
        program = str(launcher)
    monkeypatch.setattr(sys, "executable", program)
    return int(n_launchers)


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    before = set(psutil.Process().children(recursive=True))
    monkeypatch.setenv("STARTED_BY", str(tmp_path))
    yield
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        left = {each for each in psutil.process_iter() if is_started(each, str(tmp_path))}
        left |= set(psutil.Process().children(recursive=True)) - before
        if not left:
            return
        time.sleep(0.02)
    pytest.fail(f"still there: {left}")


def is_started(found: psutil.Process, test: str) -> bool:
    with contextlib.suppress(psutil.Error):
        own = found.pid == os.getpid() or found.status() == psutil.STATUS_ZOMBIE
        return not own and found.environ().get("STARTED_BY") == test
    return False


@pytest.fixture
def mesh_file(tmp_path: Path) -> Path:
    path = tmp_path / "mesh.any"
    path.touch()
    return path


@pytest.mark.parametrize(
    ("reader", "limits", "clause"),
    [
        (spinning, ReadLimits(0.6, 1e12), "takes longer than"),
        (many, ReadLimits(0.6, 1e12), "takes longer than"),
        (filling, ReadLimits(100.0, 4e8), "MB of memory"),
    ],
)
def test_limits_hold_for_what_a_launcher_starts(
    reader: Callable[[Path], RawMesh], limits: ReadLimits, clause: str, depth: int, mesh_file: Path
) -> None:
    began = time.monotonic()
    with pytest.raises(LimitExceeded, match=clause):
        read_guarded(reader, mesh_file, limits)
    assert time.monotonic() - began < 90.0


def test_memory_is_limited_where_the_system_cannot(
    tmp_path: Path, mesh_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit also holds without the module ``resource``, as on Windows."""
    (tmp_path / "lacking").mkdir()
    (tmp_path / "lacking" / "resource.py").write_text("raise ImportError", encoding="ascii")
    monkeypatch.syspath_prepend(str(tmp_path / "lacking"))
    with pytest.raises(LimitExceeded, match="MB of memory"):
        read_guarded(filling, mesh_file, ReadLimits(100.0, 4e8))


@pytest.mark.parametrize("depth", [slow(1), 2], indirect=True)
def test_what_a_launcher_starts_answers(depth: int, mesh_file: Path) -> None:
    found = read_guarded(honest, mesh_file)
    np.testing.assert_array_equal(found.vertices, CORNERS)
    with pytest.raises(InputError, match="is no mesh"):
        read_guarded(refusing, mesh_file)


def test_large_arguments_reach_a_child_that_starts_slowly() -> None:
    sent = np.arange(3_000_000.0)
    np.testing.assert_array_equal(call_in_child(np.negative, sent), -sent)


def test_an_interrupt_ends_all_of_them(
    depth: int, mesh_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> bytes:
        time.sleep(1.0)  # until the launcher has started the interpreter
        raise KeyboardInterrupt

    monkeypatch.setattr(ProcessTree, "measured", interrupt)
    with pytest.raises(KeyboardInterrupt):
        read_guarded(spinning, mesh_file)


# The computing process ------------------------------------------------------------------------

FAMILY = """
import subprocess, sys
code = "import time; time.sleep(600)"
child = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
print(child.pid, flush=True)
child.wait()
"""


def gone(found: psutil.Process, timeout: float = 60.0) -> bool:
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if not found.is_running() or found.status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.01)
    return False


def test_where_there_are_no_groups_the_tree_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    leader = subprocess.Popen([sys.executable, "-c", FAMILY], stdout=subprocess.PIPE, text=True)
    assert leader.stdout is not None
    child = psutil.Process(int(leader.stdout.readline()))
    leader.stdout.close()
    with monkeypatch.context() as patch:
        patch.setattr(sys, "platform", "win32")
        end_group(leader.pid, 1.0)
    leader.wait(60)
    assert gone(child)


def test_ending_what_has_ended_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as child:
        child.wait()
        monkeypatch.setattr(sys, "platform", "win32")
        end_group(child.pid, 1.0)
        tree = ProcessTree(child.pid)
        assert tree.measured() == (0.0, 0.0)
        tree.end()


def test_the_time_of_processes_that_have_ended_is_counted() -> None:
    code = "import subprocess, sys, time\n"
    code += "work = 'import time\\nwhile time.process_time() < 0.4: pass'\n"
    code += "subprocess.run([sys.executable, '-c', work]); print(flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as child:
        tree = ProcessTree(child.pid)
        assert child.stdout is not None
        os.set_blocking(child.stdout.fileno(), False)
        while child.stdout.read() is None:
            tree.measured()
            time.sleep(0.02)
        seconds, memory = tree.measured()
        tree.end()
    assert seconds > 0.3
    assert memory > 1e6


def test_priority_is_lowered_on_windows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[object] = []

    class OfWindows:
        def nice(self, value: object) -> None:
            given.append(value)
            raise psutil.AccessDenied(1)

    with monkeypatch.context() as patch:
        patch.setattr(sys, "platform", "win32")
        patch.setattr(psutil, "Process", OfWindows)
        patch.setattr(psutil, "BELOW_NORMAL_PRIORITY_CLASS", "below", raising=False)
        patch.setattr(Path, "write_text", lambda *_, **__: 0)
        worker._lower_priority()
    assert given == ["below"]


@pytest.mark.parametrize("platform", ["darwin", "linux", "win32"])
@pytest.mark.parametrize("own", [None, "4"])
def test_children_on_macos_have_one_thread_of_accelerate(
    platform: str, own: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.delenv("VECLIB_MAXIMUM_THREADS", raising=False)
    if own is not None:
        monkeypatch.setenv("VECLIB_MAXIMUM_THREADS", own)
    wanted = own or ("1" if platform == "darwin" else None)
    given: dict[str, Any] = {}
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **options: given.update(options))
    start_child(process.answer, env={"OF_ITS_OWN": "1"})
    environment = given["env"]
    assert environment.get("VECLIB_MAXIMUM_THREADS") == wanted
    assert environment.items() >= {"PATH": os.environ["PATH"], "OF_ITS_OWN": "1"}.items()


def test_errors_of_the_system_are_not_swallowed(
    mesh_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EAGAIN, "no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    with pytest.raises(OSError, match="no more processes"):
        read_guarded(honest, mesh_file)


_CLEANS_UP = """
import pathlib, signal, sys, time
def clean(*_):
    time.sleep(0.2)
    pathlib.Path(sys.argv[1]).touch()
    sys.exit()
signal.signal(signal.SIGTERM, clean)
print("ready", flush=True)
time.sleep(60)
"""
_STUBBORN = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("patience", [0.0, 20.0])
def test_a_process_that_is_ended_may_clean_up(patience: float, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _CLEANS_UP, str(tmp_path / "cleaned")],
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        end_group(child.pid, patience)
    assert (tmp_path / "cleaned").exists()


def test_a_process_that_does_not_listen_is_killed() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _STUBBORN], stdout=subprocess.PIPE, start_new_session=True
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        end_group(child.pid, 0.1)
    assert child.returncode == -signal.SIGKILL

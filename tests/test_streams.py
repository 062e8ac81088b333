"""Output in every encoding, into closed pipes, and without streams."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from tiers import slow_but

from meshmash_viewer.cli import main as cli
from meshmash_viewer.cli.parser import COMMANDS
from meshmash_viewer.cli.streams import answer
from meshmash_viewer.progress import Progress, ProgressBar

#: Encodings of terminals and redirected output: POSIX, DOS, Windows, mainframes.
ENCODINGS = (
    *("ascii", "cp437", "cp850", "cp1252", "latin-1", "iso8859-15", "utf-8", "utf-16", "cp1250"),
    *("cp1251", "cp1253", "koi8-r", "cp932", "gbk", "cp949", "big5", "iso2022_jp", "mac_roman"),
    "cp037",
)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    mesh = shapes.icosphere(2)
    path = tmp_path / "Kügelchen λ.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


def redirected(
    monkeypatch: pytest.MonkeyPatch, encoding: str, *arguments: object
) -> tuple[int, str, str]:
    """Run a command with streams of an encoding; return status, output and messages."""
    streams = {}
    for name, errors in (("stdout", "strict"), ("stderr", "backslashreplace")):
        streams[name] = io.TextIOWrapper(io.BytesIO(), encoding, errors)
        monkeypatch.setattr(sys, name, streams[name])
    try:
        status = cli.main([str(each) for each in arguments])
    except SystemExit as end:
        status = int(end.code or 0)
    said = []
    for stream in streams.values():
        stream.flush()
        said.append(stream.buffer.getvalue().decode(encoding))
    return status, said[0], said[1]


@pytest.mark.parametrize("encoding", slow_but(["ascii", "cp437", "utf-16"], ENCODINGS))
def test_commands_end_well_in_every_encoding(
    encoding: str, ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    status, out, err = redirected(monkeypatch, encoding, "info", ball, "--unit", "um")
    assert (status, err) == (0, "")
    assert "vertices               162" in out
    assert "?" not in out
    chosen = ("--kind", "hks", "--count", 20, "--t-min", 0.01, "-o", tmp_path / "λ.npz")
    status, out, err = redirected(monkeypatch, encoding, "features", ball, *chosen)
    assert (status, "?" in out + err) == (0, False), err
    assert "20 pairs" in out
    assert err.startswith("meshmash-viewer: "), "a remark on truncation"
    status, out, err = redirected(monkeypatch, encoding, "info", tmp_path / "π.ply", "--json")
    assert (status, out) == (2, "")
    assert "does not exist" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("encoding", slow_but(["ascii"], ["ascii", "cp437", "cp1252", "latin-1"]))
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_readable_in_every_encoding(
    encoding: str, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = (command, "--help") if command else ("--help",)
    status, out, err = redirected(monkeypatch, encoding, *arguments)
    assert (status, err) == (0, "")
    assert out.startswith("usage: meshmash-viewer")
    assert "?" not in out.replace('"*.ply"', "")
    wrong = redirected(monkeypatch, encoding, *filter(None, (command,)), "--größer")
    assert wrong[0] == 2


# Missing and closed streams ------------------------------------------------------------------


@pytest.mark.parametrize("missing", [("stdout",), ("stderr",), ("stdout", "stderr")])
def test_without_streams_the_work_is_done(
    missing: tuple[str, ...], ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``pythonw`` starts programs without streams."""
    for name in missing:
        monkeypatch.setattr(sys, name, None)
    out = tmp_path / "out.npz"
    assert cli.main(["features", str(ball), "--count", "20", "-o", str(out)]) == 0
    opened = [getattr(sys, name) for name in missing]
    assert out.exists()
    assert cli.main(["info", str(tmp_path / "none.ply")]) == 2
    with pytest.raises(SystemExit) as end:
        cli.main(["info", "--help"])
    assert end.value.code == 0
    with ProgressBar("bar") as bar:
        bar(Progress("eigenpairs", 0.5))
    warnings.showwarning("a warning", UserWarning, "", 0)
    for stream in opened:
        stream.close()


class Gone(io.StringIO):
    """Stream into a closed pipe, with the error number of an operating system."""

    def __init__(self, number: int, at: str) -> None:
        super().__init__()
        self._number, self._at = number, at

    def write(self, text: str) -> int:
        self._fail("write")
        return super().write(text)

    def flush(self) -> None:
        self._fail("flush")

    def _fail(self, at: str) -> None:
        if at == self._at and (at == "write" or self.getvalue()):
            raise OSError(self._number, os.strerror(self._number))


@pytest.mark.parametrize("at", ["write", "flush"])
@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL])
def test_a_closed_pipe_is_no_fault(
    number: int, at: str, ball: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(sys, "stdout", Gone(number, at))
    assert cli.main(["info", str(ball), str(ball)]) == 0
    assert capsys.readouterr().err == ""
    with pytest.raises(BrokenPipeError):
        answer("a result")


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL, errno.ENOSPC])
def test_messages_that_cannot_be_written_stop_nothing(
    number: int, ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Gone(number, "write"))
    out = tmp_path / "out.npz"
    arguments = ["features", str(ball), str(ball.with_name("none.ply")), "--count", "20"]
    assert cli.main([*arguments, "-o", str(tmp_path / "{name}.npz")]) == 2
    assert (tmp_path / "none.npz").exists() is out.exists() is False
    assert (tmp_path / f"{ball.stem}.npz").exists()


def test_a_full_disk_is_said(
    ball: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", Gone(errno.ENOSPC, "flush"))
    assert cli.main(["info", str(ball)]) == 2
    assert "No space left on device" in capsys.readouterr().err


def test_invalid_names_are_no_closed_pipe(
    ball: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """EINVAL with a file name, as for ``a|b.ply`` on Windows, is not taken for a closed pipe."""

    def refuse(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path))

    monkeypatch.setattr("meshmash_viewer.cli.batch.read_mesh", refuse)
    assert cli.main(["info", str(ball)]) == 2
    assert "Invalid argument" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough(ball: Path) -> None:
    """Help is still in the buffer when the program ends."""
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-m", "meshmash_viewer", "--help"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


@pytest.mark.skipif(os.name != "posix", reason="closes streams by their numbers")
@pytest.mark.parametrize("closed", slow_but([(0, 1, 2)], [(1,), (0, 1, 2)]))
def test_streams_closed_by_the_shell(closed: tuple[int, ...], ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.npz"
    code = f"import os, sys\nfor n in {closed}: os.close(n)\nos.execv(sys.executable, sys.argv[1:])"
    command = [sys.executable, "-m", "meshmash_viewer", "features", str(ball), "--count", "20"]
    done = subprocess.run(
        [sys.executable, "-c", code, *command, "-o", str(out)], capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    with np.load(out) as written:  # no printed text is in the file
        assert written["features"].shape == (162, 32)


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["nowhere"], 2, "There is neither a command nor a file nowhere: the commands are"),
        (["*.nothing"], 2, "No file matches *.nothing"),
        (["--size"], 2, "unrecognized arguments: --size"),
        (["info", "nowhere.ply"], 2, "nowhere.ply does not exist"),
        (["--help"], 0, ""),
    ],
)
def test_without_a_console_faults_are_in_a_box(
    arguments: list[str], status: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setattr("meshmash_viewer.app.run.show_message", shown.append)
    monkeypatch.setattr(sys, "argv", ["meshmash-viewer-window", *arguments])
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        monkeypatch.setattr(sys, "stdout", nothing)
        monkeypatch.setattr(sys, "stderr", None)
        assert cli.open_window() == status
    assert len(shown) == bool(said)
    assert all(text.startswith(said) and "\n" not in text for text in shown)

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from meshmash_viewer.io.atomic import remove_abandoned, scratch_prefix


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_folder_is_there_until_it_is_removed() -> None:
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as folder:
        (Path(folder) / "array").write_bytes(b"numbers")
        remove_abandoned()
        assert (Path(folder) / "array").exists()
    assert not Path(folder).exists()


def test_the_folder_of_a_killed_process_goes_when_the_next_one_starts(temporary: Path) -> None:
    code = (
        "import sys, tempfile\n"
        "from pathlib import Path\n"
        "from meshmash_viewer.io.atomic import scratch_prefix\n"
        "folder = Path(tempfile.mkdtemp(prefix=scratch_prefix()))\n"
        "(folder / 'array').write_bytes(b'numbers')\n"
        "print(folder, flush=True)\n"
        "sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(temporary)},
    ) as process:
        assert process.stdout is not None
        folder = Path(process.stdout.readline().strip())
        remove_abandoned()
        assert (folder / "array").exists(), "its process is alive"
        process.kill()
    assert folder.exists()
    remove_abandoned()
    assert not folder.exists()


@pytest.mark.parametrize(("days", "goes"), [(0, False), (2, True)])
def test_a_folder_of_nobody_knows_whom_goes_when_it_is_old(
    temporary: Path, days: int, goes: bool
) -> None:
    folder = temporary / "meshmash-viewer-abc"
    folder.mkdir()
    then = time.time() - 86_400 * days
    os.utime(folder, (then, then))
    remove_abandoned()
    assert folder.exists() is not goes


def test_what_is_not_ours_stays(temporary: Path) -> None:
    other, file = temporary / "other-abc", temporary / "meshmash-viewer-file"
    other.mkdir()
    file.touch()
    for each in (other, file):
        os.utime(each, (0, 0))
    remove_abandoned()
    assert other.exists()
    assert file.exists()

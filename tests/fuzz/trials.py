"""Trials of the mesh readers with broken files.

A trial must give a mesh or a one-sentence error, within 20 s and 1 GB for a file below 1 MB;
anything else is a fault of the program.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from meshmash_viewer import work as process
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.read import read_mesh
from tests.fuzz.mutators import bomb, broken
from tests.fuzz.seeds import Seed, sound_files

MOST_SECONDS, MOST_BYTES = 20.0, 1e9
#: One input in this many is a bomb, which takes a hundred times longer than other inputs.
BOMB_EVERY = 1000

#: Relative frequency of each format; VTK files take ten times as long as others.
_WEIGHTS = dict.fromkeys(("obj", "ply", "npz", "gltf", "gifti"), 3)
_WEIGHTS |= dict.fromkeys(("off", "stl", "freesurfer", "gzip"), 2)
_WEIGHTS |= dict.fromkeys(("vtk", "vtp"), 1)


@dataclass(frozen=True)
class Trial:
    """Result of a trial.

    Parameters
    ----------
    number, kind, name
        Number, format and file name of the input.
    seconds, memory : float
        Processor time (s), and peak memory of any process (bytes).
    sentence : str
        Error message; empty if a mesh was read.
    fault : str
        Fault of the program; empty if there is none.
    """

    number: int
    kind: str
    name: str
    seconds: float
    memory: float
    sentence: str
    fault: str


@cache
def _sound() -> dict[str, list[Seed]]:
    return sound_files()


def input_of(number: int) -> tuple[str, Seed]:
    """Return format, name and content of an input, equal at every call and on every machine."""
    rng = random.Random(number)
    if number % BOMB_EVERY == BOMB_EVERY - 1:
        return bomb(rng)
    kind = rng.choices(list(_WEIGHTS), list(_WEIGHTS.values()))[0]
    seeds = _sound()[kind]
    others = seeds if rng.random() < 0.7 else _sound()[rng.choice(list(_WEIGHTS))]
    return kind, broken(rng, rng.choice(seeds), others)


def try_input(number: int, folder: Path) -> Trial:
    """Write an input into a folder, read it as a mesh, and return the result."""
    kind, (name, content) = input_of(number)
    path = folder / name
    path.write_bytes(content)
    _forget_peak()
    began, computed = time.perf_counter(), sum(os.times()[:4])
    sentence = fault = ""
    try:
        mesh = read_mesh(path)
        if not mesh.n_faces:
            fault = "a mesh without faces"
    except InputError as told:
        sentence = str(told)
        fault = _wrong_with(sentence, path)
    except Exception as other:  # noqa: BLE001  any exception is a fault
        fault = f"{type(other).__name__}: {other}"
    # Elapsed time depends on other processes, so its limit only detects readers that hang.
    seconds, waited = sum(os.times()[:4]) - computed, time.perf_counter() - began
    memory = max(_peak(), Forked.peak)
    path.unlink(missing_ok=True)
    if not fault and (seconds > MOST_SECONDS or waited > 5.0 * MOST_SECONDS):
        fault = f"{seconds:.1f} s of computing, {waited:.1f} s of waiting"
    if not fault and memory > MOST_BYTES:
        fault = f"{memory / 1e6:.0f} MB"
    return Trial(number, kind, name, seconds, memory, sentence.removeprefix(str(path)), fault)


def _wrong_with(sentence: str, path: Path) -> str:
    told = sentence.removeprefix(str(path))
    if told == sentence:
        return f"a sentence that does not name its file: {sentence}"
    if not told.isprintable() or not told.endswith(".") or len(told) > 400:
        return f"not one sentence: {told!r}"
    if "more memory than this machine has" in told:
        return "all memory that there was"
    return ""


# Memory and processes of Linux -----------------------------------------------------------------


def _forget_peak() -> None:
    Forked.peak = 0.0
    Path("/proc/self/clear_refs").write_text("5")


def _peak() -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return 1024.0 * int(line.split()[1])
    return 0.0


class Forked:
    """Fork of this process in place of the reader's child process, which takes 0.5 s to start."""

    peak = 0.0

    def __init__(self, *_: Any, **__: Any) -> None:
        reading, writing = os.pipe()
        source, given = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            status = 1
            try:
                os.close(reading)
                os.close(given)
                quiet = os.open(os.devnull, os.O_WRONLY)
                os.dup2(quiet, 1)
                os.dup2(quiet, 2)
                process.answer(os.fdopen(source, "rb"), os.fdopen(writing, "wb"))
                status = 0
            finally:
                os._exit(status)
        os.close(writing)
        os.close(source)
        self._said, self._pipe = b"", reading
        self.stdin: Any = os.fdopen(given, "wb")
        self.returncode: int | None = None

    def __enter__(self) -> Forked:
        return self

    def __exit__(self, *_: object) -> None:
        self._wait()

    def communicate(self, timeout: float) -> tuple[bytes, None]:
        ends = time.monotonic() + timeout
        while select.select([self._pipe], [], [], max(ends - time.monotonic(), 0.0))[0]:
            part = os.read(self._pipe, 65536)
            if not part:
                self._wait()
                return self._said, None
            self._said += part
        raise subprocess.TimeoutExpired("", timeout)

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)

    def _wait(self) -> None:
        if self.returncode is None:
            _, status, used = os.wait4(self.pid, 0)
            self.returncode = os.waitstatus_to_exitcode(status)
            Forked.peak = max(Forked.peak, 1024.0 * used.ru_maxrss)
            os.close(self._pipe)


@contextlib.contextmanager
def forking() -> Iterator[None]:
    """Read in forks of this process instead of new child processes."""
    import nibabel.gifti  # noqa: F401  imported once, before all forks
    import psutil  # noqa: F401
    import trimesh  # noqa: F401

    from meshmash_viewer.io.formats.vtk import read_legacy_vtk, read_vtk_xml

    with tempfile.TemporaryDirectory() as folder:
        for name, content in (*_sound()["vtk"], *_sound()["vtp"]):
            path = Path(folder) / name
            path.write_bytes(content)
            (read_vtk_xml if path.suffix == ".vtp" else read_legacy_vtk)(path)
    before = process.start_child
    process.start_child = Forked  # type: ignore[misc, assignment]
    # More memory is a fault anyway, and would slow down other processes.
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (int(3 * MOST_BYTES), limits[1]))
    try:
        yield
    finally:
        process.start_child = before
        resource.setrlimit(resource.RLIMIT_DATA, limits)

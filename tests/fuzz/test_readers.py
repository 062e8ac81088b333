"""Broken files of all formats, each of which must give a mesh or one sentence.

A file below 1 MB takes at most 20 s and 3 GB; more is a fault of the program.
"""

from __future__ import annotations

import gzip
import random
import re
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mesh_files import WRITERS

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.read import read_mesh

_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = (
    *(b"0", b"-1", b"1", b"3", b"255", b"65536", b"2147483648", b"4294967296", b"9" * 30),
    *(b"1e38", b"1e308", b"1e400", b"1e-320", b"nan", b"-inf", b"", b"x", b"1_000", b"9" * 5000),
)
_LIES = (0, 1, 3, 255, 2**15, 2**16 - 1, 2**20, 2**24 - 1, 2**31 - 1, 2**31, 2**32 - 1)


def flip_bits(rng: random.Random, data: bytes) -> bytes:
    broken = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 16))):
        broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
    return bytes(broken)


def truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(1, len(data) + 1)]


def move_parts(rng: random.Random, data: bytes) -> bytes:
    """Remove or repeat a part, or exchange two parts."""
    a, b, c = sorted(rng.randrange(len(data) + 1) for _ in range(3))
    exchanged = data[:a] + data[b:c] + data[a:b] + data[c:]
    return rng.choice((data[:a] + data[b:], data[:b] + data[a:b] * 20 + data[b:], exchanged))


def change_numbers(rng: random.Random, data: bytes) -> bytes:
    """Replace a number that is written as text."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return flip_bits(rng, data)
    # Half of the changes affect the first 12 numbers, which include the counts in headers.
    number = rng.choice(found[:12] if rng.random() < 0.5 else found)
    return data[: number.start()] + rng.choice(_NUMBERS) + data[number.end() :]


def lie(rng: random.Random, data: bytes) -> bytes:
    """Overwrite bytes with a binary integer, as used for counts and lengths."""
    value = struct.pack(rng.choice("<>") + "I", rng.choice((*_LIES, len(data), 10 * len(data))))
    place = rng.randrange(min(len(data), 200) if rng.random() < 0.5 else len(data))
    return data[:place] + value + data[place + 4 :]


MUTATORS: tuple[Callable[[random.Random, bytes], bytes], ...] = (
    flip_bits, truncate, move_parts, change_numbers, change_numbers, lie,
)  # fmt: skip


def fault_of(path: Path) -> str:
    """Read a file; return the fault of the program, or an empty string."""
    began = time.process_time()
    try:
        if not read_mesh(path).n_faces:
            return "a mesh without faces"
    except InputError as told:
        said = str(told).removeprefix(str(path))
        if said == str(told) or not said.isprintable() or not said.endswith("."):
            return f"not one sentence that begins with the file: {told}"
        if len(said) > 400 or "more memory than this machine has" in said:
            return said
    except Exception as other:  # noqa: BLE001  any exception is a fault
        return f"{type(other).__name__}: {other}"
    seconds = time.process_time() - began
    return f"{seconds:.1f} s" if seconds > 20.0 else ""


@pytest.fixture
def little_memory() -> Iterator[None]:
    """Limit the memory of this process, which reads, and of the processes that it starts."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (6_000_000_000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, limits)


@pytest.mark.slow
@pytest.mark.usefixtures("little_memory")
@pytest.mark.filterwarnings("ignore::meshmash_viewer.errors.MeshWarning")
# NumPy leaves the file of a damaged archive open until it is collected.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_broken_files_give_a_mesh_or_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    whole = path.read_bytes()
    # VTK may end its process, so its files are read in others, which takes 0.5 s each.
    monkeypatch.setattr("meshmash_viewer.io.raw._watched", not path.suffix.startswith(".vt"))
    for seed in range(4 if path.suffix.startswith(".vt") else 40):
        rng, content = random.Random(f"{name} {seed}"), whole
        for _ in range(rng.choice((1, 1, 3))):
            content = rng.choice(MUTATORS)(rng, content) or b"\0"
        packed = seed % 8 == 7 and path.suffix in (".obj", ".off", ".ply", ".stl")
        broken = path.with_name(f"{name}.gz") if packed else path
        broken.write_bytes(gzip.compress(content) if packed else content)
        assert fault_of(broken) == "", (seed, content[:2000])

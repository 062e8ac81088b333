from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

_HOLDS_AFTER_FREEING = """
import ctypes
from pathlib import Path
from meshmash_viewer.app import heap

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.malloc.argtypes = [ctypes.c_size_t]
libc.free.argtypes = [ctypes.c_void_p]

def held():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon:")).split()[1]) / 1024

size, small = 8 << 20, 64 << 10
libc.free(libc.malloc(size))  # glibc now takes such blocks from its heap
before = held()
blocks = []
for _ in range(12):
    blocks.append(libc.malloc(size))
    ctypes.memset(blocks[-1], 1, size)
    ctypes.memset(libc.malloc(small), 1, small)
for block in blocks:
    libc.free(block)
print(held() - before, end=" ")
heap.give_back()
print(held() - before)
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux") or not hasattr(ctypes.CDLL(None), "malloc_trim"),
    reason="about glibc",
)
def test_what_was_freed_goes_back_to_the_system() -> None:
    program = [sys.executable, "-c", _HOLDS_AFTER_FREEING]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    kept, given_back = (float(word) for word in done.stdout.split())
    assert kept > 60  # what the module is for
    assert given_back < 10

"""Readers of files as `read_guarded` calls them: without end, and honest ones."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import RawMesh

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def spinning(_: Path) -> RawMesh:
    """Compute for ever."""
    while True:
        pass


def filling(_: Path) -> RawMesh:
    """Take memory for ever, slowly enough to be seen."""
    held = []
    while True:
        held.append(np.ones(1 << 20))
        time.sleep(0.005)


def many(_: Path) -> RawMesh:
    """Leave the work to processes of its own."""
    command = [sys.executable, "-c", "while True: pass"]
    for child in [subprocess.Popen(command) for _ in range(2)]:
        child.wait()
    raise AssertionError


def honest(_: Path) -> RawMesh:
    """Read a triangle."""
    return RawMesh(CORNERS, np.array([[0, 1, 2]]))


def refusing(_: Path) -> RawMesh:
    """Say what is wrong."""
    raise InputError("is no mesh")

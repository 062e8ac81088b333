"""Readers for `read_guarded`: endless, failing and working ones."""

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
    """Compute forever."""
    while True:
        pass


def filling(_: Path) -> RawMesh:
    """Allocate memory forever, slowly enough to be observed."""
    held = []
    while True:
        held.append(np.ones(1 << 20))
        time.sleep(0.005)


def many(_: Path) -> RawMesh:
    """Start child processes that compute forever."""
    command = [sys.executable, "-c", "while True: pass"]
    for child in [subprocess.Popen(command) for _ in range(2)]:
        child.wait()
    raise AssertionError


def honest(_: Path) -> RawMesh:
    """Return a triangle."""
    return RawMesh(CORNERS, np.array([[0, 1, 2]]))


def refusing(_: Path) -> RawMesh:
    """Raise an `InputError`."""
    raise InputError("is no mesh")

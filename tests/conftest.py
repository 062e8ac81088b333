"""Virtual screens, cache folders and meshes shared by the tests."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh

#: Cache of Mesa's shaders, matplotlib's fonts and others on Linux, shared by all tests and runs.
SHARED_CACHE = Path(__file__).resolve().parent.parent / "build" / "cache"


def pytest_configure(config: pytest.Config) -> None:
    """Set the cache of other libraries, and a virtual screen for each process of a parallel run.

    Windows on a common screen would take the focus from each other.
    """
    os.environ["XDG_CACHE_HOME"] = str(SHARED_CACHE)
    gc.disable()  # while modules are imported and tests are collected
    if not hasattr(config, "workerinput") or not sys.platform.startswith("linux"):
        return
    if not shutil.which("Xvfb"):
        return
    answer, number = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(number), "-screen", "0", "1920x1200x24", "-nolisten", "tcp"],
        pass_fds=[number],
        stderr=subprocess.DEVNULL,
    )
    os.close(number)
    with os.fdopen(answer) as file:
        os.environ["DISPLAY"] = f":{file.readline().strip()}"

    def end() -> None:
        screen.terminate()
        screen.wait()

    config.add_cleanup(end)


def pytest_collection_finish() -> None:
    """Exclude the objects that exist after collection from later garbage collections."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240229)


@pytest.fixture(scope="session")
def sphere() -> Mesh:
    """Return an icosphere of 642 vertices, radius 1."""
    return shapes.icosphere(3)


@pytest.fixture(scope="session")
def rectangle() -> Mesh:
    """Return a rectangle of 2 × 1.5 with 1200 vertices."""
    return shapes.rectangle()


@pytest.fixture(scope="session")
def three_spheres() -> Mesh:
    """Return three icospheres of 162 vertices each."""
    return shapes.three_spheres()


@pytest.fixture(scope="session")
def neuron() -> Mesh:
    """Return a faulty dendrite in nm of about 1500 vertices (see `shapes.neuron`)."""
    return shapes.neuron()


@pytest.fixture(scope="session")
def caches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return paths of new folders; unlike pytest, list no existing folders to number them."""
    folder = tmp_path_factory.mktemp("caches")
    return (folder / str(number) for number in count())


@pytest.fixture(autouse=True)
def own_cache(caches: Iterator[Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set a new cache folder of our own for a test and its child processes."""
    folder = next(caches)
    folder.mkdir()
    monkeypatch.setenv("MESHMASH_CACHE", str(folder))
    return folder


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read files in the test's process: a separate reader process takes 0.5 s to start."""
    monkeypatch.setattr("meshmash_viewer.io.raw._watched", True)

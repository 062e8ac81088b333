"""Shapes that many tests share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240229)


@pytest.fixture(scope="session")
def sphere() -> Mesh:
    """Icosphere of 642 vertices, radius 1."""
    return shapes.icosphere(3)


@pytest.fixture(scope="session")
def rectangle() -> Mesh:
    """Rectangle of 2 × 1.5, 1200 vertices."""
    return shapes.rectangle()


@pytest.fixture(scope="session")
def three_spheres() -> Mesh:
    """Three icospheres of 162 vertices each."""
    return shapes.three_spheres()


@pytest.fixture(scope="session")
def neuron() -> Mesh:
    """Dirty dendrite in nm of about 1500 vertices (see `shapes.neuron`)."""
    return shapes.neuron()


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep the user's folders out of the tests, those of child processes included."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("MESHMASH_CACHE", str(folder))
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))  # of Mesa, and of numba, on Linux
    return folder

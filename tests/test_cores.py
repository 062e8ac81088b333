"""Number of cores that a computation may use."""

from __future__ import annotations

from types import SimpleNamespace

import joblib
import psutil
import pytest
from test_eigensolver import torus

from meshmash_viewer.spectral.cost import core_count, worker_count
from meshmash_viewer.spectral.engine.factorization import order_pencil
from meshmash_viewer.spectral.engine.pencil import reduce_pencil


def test_cores_are_all_of_the_machine_but_one_where_they_are_shared() -> None:
    assert core_count() == joblib.cpu_count()
    with joblib.parallel_config(backend="sequential"):
        assert core_count() == 1


def test_slices_at_a_time_are_as_many_as_cores_and_memory_allow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ordered = order_pencil(reduce_pencil(*torus(40, 30, 1.0, 1.2)[0]))
    assert worker_count(ordered, 3, 300) == 3
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=0))
    assert worker_count(ordered, 3, 300) == 1

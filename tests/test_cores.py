"""How many cores a computation may plan for."""

from __future__ import annotations

import joblib

from meshmash_viewer.spectral.engine.cores import core_count


def test_cores_are_all_of_the_machine_but_one_where_they_are_shared() -> None:
    assert core_count() == joblib.cpu_count()
    with joblib.parallel_config(backend="sequential"):
        assert core_count() == 1

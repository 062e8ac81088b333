"""Kills at a few random moments; the module `kills` describes the checks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.kills import kill_once, prepare


@pytest.mark.slow
def test_a_kill_loses_nothing_and_leaves_nothing(tmp_path: Path) -> None:
    undisturbed = prepare(tmp_path, 2500)
    rng = np.random.default_rng(3)
    for number in range(5):
        kill_once(undisturbed, tmp_path / str(number), rng)

"""The place of compiled kernels, in interpreters of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CODE = """
import os
{patch}
from meshmash_viewer.engine import compilation
from numba.core import config
print(config.CACHE_DIR)
assert not config.CACHE_DIR or os.path.isdir(config.CACHE_DIR)
"""


def place(patch: str) -> str:
    environment = {key: text for key, text in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    run = [sys.executable, "-c", CODE.format(patch=patch)]
    return subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout


def test_numba_finds_its_own_place_where_it_can() -> None:
    assert place("").strip() == ""


def test_an_account_that_can_write_nowhere_gets_a_place_that_goes_with_the_process() -> None:
    folder = place("os.access = lambda *_: False").strip()
    assert "meshmash-kernels-" in folder
    assert not Path(folder).exists()

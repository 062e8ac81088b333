"""Example scripts, which write the files that their page names."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| `(\w+\.py)` \| (.*?) \|", PAGE, re.M))


def test_the_page_names_every_script() -> None:
    assert set(ROWS) == {path.name for path in (ROOT / "examples").glob("*.py")}
    for name in ROWS:
        lines = (ROOT / "examples" / name).read_text(encoding="utf-8").splitlines()
        assert 10 <= len(lines) <= 40


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_an_example_makes_what_its_page_says(name: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", ROOT / "examples" / name],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    wanted = set(re.findall(r"`(.*?)`", ROWS[name]))
    made = {path.name for path in tmp_path.iterdir() if path.stat().st_size > 1000}
    assert wanted <= made
    # A JSON file next to a table has its options.
    assert {each for each in made - wanted if not each.endswith(".json")} == set()

"""Changes lost when the program is killed: at most those of the last second."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz.window_kills import KilledWindows


@pytest.mark.slow
def test_a_killed_window_loses_at_most_a_second(tmp_path: Path) -> None:
    windows, kills = KilledWindows(tmp_path), 12
    for _ in range(kills + 1):
        windows.kill_once()
    lost = windows.lost
    figures = f"{kills} kills after {windows.changes} changes, lost up to {max(lost):.2f} s"
    assert windows.changes > kills, figures
    # the pause of 0.3 s, a frame and the writing took 2.4 s on a busy machine
    assert max(lost) < 4.0, figures

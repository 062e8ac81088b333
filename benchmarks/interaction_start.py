"""Time until the window is shown; run by `interaction.py` with the time of its start."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

SPAWNED = float(sys.argv[1])


def main() -> None:
    """Open the window as the command does, and close it once it is complete."""
    from PySide6.QtCore import QTimer

    from meshmash_viewer.app import main_window, run

    found: dict[str, float] = {}
    windows: list[Any] = []

    class Watched(main_window.MainWindow):
        def paintEvent(self, event: Any) -> None:
            super().paintEvent(event)
            found.setdefault("visible", time.time() - SPAWNED)

        def load(self) -> None:
            super().load()
            windows.append(self)
            found.setdefault("complete", time.time() - SPAWNED)
            QTimer.singleShot(100, self.close)

    main_window.MainWindow = Watched
    run.run_app(fresh=True)
    print(json.dumps(found))


if __name__ == "__main__":
    main()

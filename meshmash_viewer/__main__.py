"""``python -m meshmash_viewer`` is the command ``meshmash-viewer``."""

from __future__ import annotations

from meshmash_viewer.cli import main

if __name__ == "__main__":
    raise SystemExit(main())

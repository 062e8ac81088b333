"""Entry point of ``python -m meshmash_viewer``, the command ``meshmash-viewer``."""

from __future__ import annotations

from meshmash_viewer.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())

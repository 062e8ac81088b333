"""Random actions in the window, with a report of faults and of growing memory.

    python benchmarks/walk.py --seed 1 --actions 10000

Needs a display; ``./dev bench walk`` uses a virtual display. Settings, meshes and stored eigenpairs
are temporary; those of the user are neither read nor changed. The exit status is 1 if there was an
exception, a warning of Qt or Python, or a notice of a defect.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
# replaces this folder, whose fuzz.py would hide tests/fuzz
sys.path[:1] = [str(HERE.parent), str(HERE.parent / "tests")]


def main() -> int:
    """Read the command line and run the actions."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--actions", type=int, default=1000)
    parser.add_argument("--every", type=int, default=1000, help="actions between two weights")
    parser.add_argument("--log", type=Path, help="file that every action is written to first")
    options = parser.parse_args()
    faulthandler.enable()
    with tempfile.TemporaryDirectory(prefix="meshmash-viewer-walk-") as folder:
        os.environ["XDG_CACHE_HOME"] = str(Path(folder) / "cache")
        os.environ["XDG_CONFIG_HOME"] = str(Path(folder) / "config")
        return _walk(Path(folder), options)


def _walk(folder: Path, options: argparse.Namespace) -> int:
    from fuzz.walk import Walk, Weight

    from meshmash_viewer.app.run import application

    application()
    walk = Walk(folder, options.seed, options.log)
    print(f"seed {options.seed}")
    print(Weight.header(), flush=True)
    started, told = time.monotonic(), 0
    with walk.watched():
        walk.begin()
        print(walk.measure().row(), flush=True)
        while walk.actions < options.actions:
            walk.walk(min(options.every, options.actions - walk.actions))
            print(walk.measure().row(), flush=True)
            for fault in walk.faults[told:]:
                print(f"FAULT {fault}", flush=True)
            told = len(walk.faults)
        walk.close()
    for fault in walk.faults[told:]:
        print(f"FAULT {fault}")
    took = time.monotonic() - started
    print(f"{walk.actions} actions, {len(walk.faults)} faults, {took:.0f} s")
    print(f"slowest: {walk.slowest[0]:.1f} s, {walk.slowest[1]}")
    return 1 if walk.faults else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Test of killed processes: certified pairs and finished files stay, and nothing else.

    python benchmarks/kills.py [--kills 50] [--kinds window] [--disk-full 0] [--seed 0]

The command line, the worker process of a window or a window itself are killed at random moments
with SIGKILL, SIGTERM and SIGINT, starting from an empty store or from 60 certified pairs;
`tests/fuzz/kills.py` lists the conditions. `--disk-full` fills the disk of the cache, of the result
or of temporary files at random moments instead; it mounts a tmpfs and must run as root.
"""

from __future__ import annotations

import argparse
import collections
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.fuzz.kills import fill_once, kill_once, prepare


def main() -> None:
    """Run the trials and print the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--disk-full", type=int, default=0)
    parser.add_argument("--vertices", type=int, default=4000)
    parser.add_argument(
        "--kinds", nargs="+", default=["command line", "worker"], help="also: window"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        undisturbed = prepare(folder, options.vertices, options.kinds)
        print("undisturbed:", {k: f"{v:.1f} s" for k, v in undisturbed.seconds.items()}, flush=True)
        lost = 0
        for title, trial, count in (
            ("kills", kill_once, options.kills),
            ("disks filled", fill_once, options.disk_full),
        ):
            began = time.perf_counter()
            failed = 0
            outcomes: collections.Counter[str] = collections.Counter()
            number = 0
            while outcomes.total() + failed < count:
                number += 1
                try:
                    what = trial(undisturbed, folder / f"{title} {number}", rng)
                    if what:  # "" if the process had already ended
                        outcomes[what.split(", at")[0]] += 1
                except Exception as defect:  # noqa: BLE001  the next trial follows any error
                    failed += 1
                    print(f"  {title} {number}: {type(defect).__name__}: {defect}", flush=True)
            if count:
                took = time.perf_counter() - began
                print(f"{count} {title} in {took:.0f} s, {failed} with a loss or a left-over")
                lost += failed
                for what, times in sorted(outcomes.items()):
                    print(f"  {times:4d} {what}", flush=True)
    sys.exit(lost > 0)


if __name__ == "__main__":
    main()

"""Do the tests notice? Single small faults, made by seed, and the tests that should see them.

    ./dev bench mutations --count 200 --seed 1

Each fault is put into a copy of the tree, where the tests that enter the function it lies in are
run until the first fails; a run past its time counts as caught. Printed are a table by module and
the faults that survived. Those that change nothing a caller could see are listed with the reason in
`mutations_equivalent.toml`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from fnmatch import fnmatchcase
from pathlib import Path

from mutation_operators import Mutation, mutations_of
from mutation_tests import Run, Tests, copy_tree, import_what_is_slow, noticed_by

HERE = Path(__file__).parent
ROOT = HERE.parent
EQUIVALENT = HERE / "mutations_equivalent.toml"
#: What a like share of the faults goes to: modules and folders of the package, the first that fits.
AREAS = {
    "engine": ("spectral/engine/*",),
    "io": ("io/*",),
    "model": ("model/*", "fields/*"),
    "numerics": (
        *("mesh.py", "health.py", "defects.py", "laplacian.py", "decompose.py"),
        *("spectral/*", "features/*", "split/*", "surface/*"),
    ),
}


def main() -> int:
    """Make faults, run tests, print a table; exit status 1 where fewer were caught than asked."""
    options = _options()
    source = {path: (ROOT / path).read_bytes() for path in _modules()}
    chosen = _choose(source, options)
    equivalent = _equivalent()
    reasons = {mutation: _reason(mutation, equivalent) for mutation in chosen}
    if options.list:
        for mutation in chosen:
            print(f"{'=' if reasons[mutation] else ' '} {mutation}")
        return 0
    import_what_is_slow()
    base = _base()
    tests = Tests.recorded(base / "tree", base / "reach.json", _say)
    outcome = _try_all(
        [mutation for mutation in chosen if reasons[mutation] is None], tests, base, options
    )
    return _report(chosen, outcome, reasons, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="faults in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="*", help="modules, such as 'io/*' or weyl.py")
    parser.add_argument("--but", default="", help="modules to leave out, separated by commas")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time")
    parser.add_argument("--seconds", type=float, default=60.0, help="of tests for each fault")
    parser.add_argument("--list", action="store_true", help="print the faults, run nothing")
    parser.add_argument("--least", type=float, default=90.0, help="per cent that must be caught")
    return parser.parse_args()


def _modules() -> list[str]:
    """Modules of the areas, below the root."""
    found = [str(path.relative_to(ROOT)) for path in (ROOT / "meshmash_viewer").rglob("*.py")]
    return sorted(path for path in found if _area(path) is not None)


def _area(path: str) -> str | None:
    """The area that a module belongs to; None if its faults are none of those made here."""
    for area, patterns in AREAS.items():
        if any(fnmatchcase(_short(path), pattern) for pattern in patterns):
            return area
    return None


def _short(path: str) -> str:
    return path.removeprefix("meshmash_viewer/")


def _choose(source: dict[str, bytes], options: argparse.Namespace) -> list[Mutation]:
    """Faults by seed: a like share for every area, for modules by their length, any kind alike."""
    chance = random.Random(options.seed)
    left_out = [pattern.strip() for pattern in options.but.split(",")]
    areas: dict[str | None, dict[str, dict[str, list[Mutation]]]] = {}
    for path, text in source.items():
        if not fnmatchcase(_short(path), options.only) or any(
            fnmatchcase(_short(path), pattern) for pattern in left_out
        ):
            continue
        kinds: dict[str, list[Mutation]] = defaultdict(list)
        for mutation in mutations_of(path, text):
            kinds[mutation.kind].append(mutation)
        if kinds:
            areas.setdefault(_area(path), {})[path] = kinds
    chosen: dict[tuple[str, int, int], Mutation] = {}
    names = [area for area in AREAS if area in areas]
    for turn in range(100 * options.count):
        if len(chosen) == options.count or not names:
            break
        modules = areas[names[turn % len(names)]]
        path = chance.choices(list(modules), [len(source[module]) for module in modules])[0]
        kind = chance.choice(sorted(modules[path]))
        mutation = chance.choice(modules[path][kind])
        chosen.setdefault((path, mutation.start, mutation.stop), mutation)
    return sorted(chosen.values(), key=lambda mutation: (mutation.path, mutation.start))


def _equivalent() -> list[dict[str, str]]:
    entries: list[dict[str, str]] = tomllib.loads(EQUIVALENT.read_text())["equivalent"]
    return entries


def _reason(mutation: Mutation, equivalent: list[dict[str, str]]) -> str | None:
    """Why a fault changes nothing a caller could see; None if it is not known to."""
    before, after = (" ".join(text.split()) for text in (mutation.before, mutation.after))
    for entry in equivalent:
        if (
            fnmatchcase(_short(mutation.path), entry["module"])
            and fnmatchcase(mutation.place, entry.get("place", "*"))
            and entry.get("before", before) == before
            and entry.get("after", after) == after
        ):
            return entry["reason"]
    return None


def _base() -> Path:
    """A copy of the tree, kernels compiled and tests recorded, kept until a module changes."""
    digest = hashlib.sha256()
    tests = [path for path in (ROOT / "tests").rglob("*.py") if not path.stem.startswith("test_")]
    for path in sorted([*tests, *(ROOT / "meshmash_viewer").rglob("*.py")]):
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    base = Path(tempfile.gettempdir()) / f"meshmash-mutations-{digest.hexdigest()[:16]}"
    copy_tree(ROOT, base / "tree")
    return base


def _try_all(
    mutations: list[Mutation], tests: Tests, base: Path, options: argparse.Namespace
) -> dict[Mutation, str | None]:
    """What noticed each fault; None for those that survived."""
    began = time.perf_counter()
    copies = Path(tempfile.mkdtemp(prefix="meshmash-mutants-"))
    outcome: dict[Mutation, str | None] = {}
    remembered = base / "noticed.json"
    noticed = json.loads(remembered.read_text()) if remembered.exists() else {}

    waiting = list(enumerate(mutations))[::-1]
    running: dict[Mutation, tuple[Run, Path, int]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < options.jobs:
                number, mutation = waiting.pop()
                chosen = tests.noticing(mutation, options.seconds, noticed.get(str(mutation), ""))
                if not chosen:
                    outcome[mutation] = None
                    _say(f"{len(outcome)} of {len(mutations)}: {mutation}: entered by no test")
                    continue
                copy = copies / str(number)
                run = tests.start(mutation, chosen, copy, patience=20.0)
                running[mutation] = run, copy, len(chosen)
            time.sleep(0.02)
            for mutation, (run, copy, n_tests) in list(running.items()):
                status = run.status()
                if status is None:
                    continue
                outcome[mutation] = noticed_by(run, status)
                del running[mutation]
                noticed[str(mutation)] = (outcome[mutation] or "").removeprefix("FAILED ")
                # Not waited for: a fault may have left a million files.
                subprocess.Popen(["rm", "-rf", str(copy), f"{copy}-temporary"])
                said = outcome[mutation] or f"SURVIVED {n_tests} tests"
                now = f"{time.perf_counter() - began:.0f} s"
                _say(f"{len(outcome)} of {len(mutations)}, {now}: {mutation}: {said}")
    finally:
        remembered.write_text(json.dumps(noticed))
        shutil.rmtree(copies, ignore_errors=True)
    return outcome


def _report(
    chosen: list[Mutation],
    outcome: dict[Mutation, str | None],
    reasons: dict[Mutation, str | None],
    options: argparse.Namespace,
) -> int:
    made: Counter[str] = Counter()
    caught: Counter[str] = Counter()
    same: Counter[str] = Counter()
    for mutation in chosen:
        for row in (_short(mutation.path), f"{_area(mutation.path)} ", "in all"):
            made[row] += 1
            same[row] += reasons[mutation] is not None
            caught[row] += outcome.get(mutation) is not None
    print(f"{'module':32}{'faults':>8}{'caught':>8}{'survived':>10}{'equivalent':>12}{'caught':>9}")
    for row in sorted(made, key=lambda row: (row == "in all", row.endswith(" "), row)):
        real = made[row] - same[row]
        share = f"{100.0 * caught[row] / real:.0f} %" if real else ""
        print(
            f"{row:32}{made[row]:8}{caught[row]:8}{real - caught[row]:10}{same[row]:12}{share:>9}"
        )
    survivors = [mutation for mutation in chosen if outcome.get(mutation, "") is None]
    if survivors:
        print("\nsurvived:")
    for mutation in survivors:
        print(f"  {mutation}")
    if any(reasons.values()):
        print("\nequivalent:")
    for mutation, reason in reasons.items():
        if reason is not None:
            print(f"  {mutation}\n      {reason}")
    real = made["in all"] - same["in all"]
    return int(100.0 * caught["in all"] < options.least * real)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())

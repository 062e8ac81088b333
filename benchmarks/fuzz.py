"""Test of readers with broken files of all formats: each must give a mesh or one sentence.

    ./dev bench fuzz --inputs 100000 [--first N] [--jobs J] [--record FILE]
    ./dev bench fuzz --show N          what input N is, and what comes of it
    ./dev bench fuzz --formulas 100000 [--first N]      lines for formulas of filters in their place

Inputs are numbered; an input is the same on every machine. With --record, results are stored in
FILE, and the next run omits the recorded inputs. Needs Linux.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT)]
sys.path = [place for place in sys.path if Path(place).resolve() != Path(__file__).parent]

#: Number of inputs that one process tries and that are recorded together.
CHUNK = 1000
#: Seconds without progress after which a worker is ended.
SILENT = 600.0


def main() -> int:
    """Try the requested inputs; return 1 if there was a fault."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--record", type=Path)
    parser.add_argument("--show", type=int, metavar="N")
    parser.add_argument("--formulas", type=int, metavar="N")
    parser.add_argument("--work", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(int(options.work[0]), Path(options.work[1]), json.loads(options.work[2]))
        return 0
    if options.show is not None:
        show(options.show)
        return 0
    if options.formulas is not None:
        return 1 if break_formulas(options.first, options.formulas) else 0
    first = options.first // CHUNK
    wanted = range(first, first + -(-options.inputs // CHUNK))
    done = recorded(options.record)
    chunks = [chunk for chunk in wanted if chunk not in done]
    began = time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        for count, report in enumerate(pool.map(try_chunk, chunks), 1):
            done[report["chunk"]] = report
            if options.record:
                with options.record.open("a") as file:
                    file.write(json.dumps(report) + "\n")
            for fault in report["faults"]:
                print("FAULT", json.dumps(fault), flush=True)
            if count % 20 == 0 or count == len(chunks):
                rate = count * CHUNK / (time.monotonic() - began)
                print(f"{count * CHUNK} of {len(chunks) * CHUNK}, {rate:.0f} a second", flush=True)
    faults = summarise([done[chunk] for chunk in wanted if chunk in done])
    return 1 if faults else 0


def break_formulas(first: int, count: int) -> int:
    """Try `count` lines as formulas, print the results, and return the number of faults."""
    from tests.fuzz.formulas import formula, outcome, watched

    came: Counter[str] = Counter()
    slowest = 0.0, first
    with watched() as forbidden:
        for number in range(first, first + count):
            began = time.perf_counter()
            try:
                came[outcome(number)] += 1
            except Exception as fault:  # noqa: BLE001  any exception is a fault
                came["fault"] += 1
                print(f"FAULT {number} {formula(number)!r}: {type(fault).__name__}: {fault}")
            slowest = max(slowest, (time.perf_counter() - began, number))
    print(f"{count:,} formulas: {came['computed']:,} computed, {came['refused']:,} refused")
    print(f"slowest {1e3 * slowest[0]:.1f} ms (formula {slowest[1]})")
    print(f"files, imports, code and attributes: {forbidden or 'none'}")
    print(f"faults: {came['fault']}")
    return came["fault"] + len(forbidden)


def recorded(record: Path | None) -> dict[int, dict[str, Any]]:
    """Return the reports of earlier runs, by chunk."""
    if record is None or not record.exists():
        return {}
    reports = [json.loads(line) for line in record.read_text().splitlines()]
    return {report["chunk"]: report for report in reports}


def try_chunk(chunk: int) -> dict[str, Any]:
    """Try a chunk in a process, and again without each input that ended the process."""
    skip: list[int] = []
    faults: list[dict[str, Any]] = []
    while True:
        with tempfile.TemporaryDirectory(prefix="fuzz-", dir=memory_folder()) as folder:
            place = Path(folder) / "place"
            place.write_bytes(bytes(8))
            command = [sys.executable, __file__, "--work", str(chunk), folder, json.dumps(skip)]
            environment = os.environ | {
                "TMPDIR": folder,
                "PYTHONPATH": str(ROOT),
                **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
            }
            worker = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment)
            fault = watched(worker, place)
            assert worker.stdout is not None
            said = worker.stdout.read()
            if not fault:
                report: dict[str, Any] = json.loads(said)
                report["faults"] += faults
                return report
            number = int.from_bytes(place.read_bytes(), "little")
            faults.append({"number": number, "fault": fault})
            skip.append(number)


def watched(worker: subprocess.Popen[bytes], place: Path) -> str:
    """Wait for a worker; return how it failed, or ""."""
    last, since = b"", time.monotonic()
    while True:
        try:
            status = worker.wait(1.0)
            return "" if status == 0 else f"the process ended with {status}"
        except subprocess.TimeoutExpired:
            now = place.read_bytes()
            if now != last:
                last, since = now, time.monotonic()
            elif time.monotonic() - since > SILENT:
                worker.kill()
                worker.wait()
                return f"nothing for {SILENT:.0f} s"


def memory_folder() -> str | None:
    """Return a folder in memory, or None for the default temporary folder."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def work(chunk: int, folder: Path, skip: list[int]) -> None:
    """Try the inputs of a chunk and print a report as JSON."""
    from tests.fuzz.trials import forking, try_input

    report: dict[str, Any] = {"chunk": chunk, "tried": {}, "faults": [], "clauses": {}}
    clauses: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    trials = []
    with forking(), (folder / "place").open("r+b") as file, mmap.mmap(file.fileno(), 8) as place:
        for number in range(chunk * CHUNK, (chunk + 1) * CHUNK):
            place[:] = number.to_bytes(8, "little")
            if number in skip:
                continue
            trial = try_input(number, folder)
            trials.append(trial)
            came = "fault" if trial.fault else "sentence" if trial.sentence else "mesh"
            tried[f"{trial.kind} {came}"] += 1
            if trial.sentence:
                clauses[" ".join(trial.sentence.split()[:4])] += 1
            if trial.fault:
                about = {"number": number, "kind": trial.kind, "name": trial.name}
                report["faults"].append({**about, "fault": trial.fault[:300]})
    slowest = max(trials, key=lambda trial: trial.seconds)
    largest = max(trials, key=lambda trial: trial.memory)
    report["slowest"] = [round(slowest.seconds, 2), slowest.number, slowest.name]
    report["largest"] = [round(largest.memory / 1e6), largest.number, largest.name]
    report["tried"], report["clauses"] = dict(tried), dict(clauses)
    print(json.dumps(report), flush=True)


def show(number: int) -> None:
    """Try one input, print the result and keep the file."""
    from tests.fuzz.trials import forking, input_of, try_input

    kind, (name, content) = input_of(number)
    print(kind, name, len(content), "bytes:", content[:300])
    with tempfile.TemporaryDirectory() as folder, forking():
        (Path(tempfile.gettempdir()) / name).write_bytes(content)
        print(try_input(number, Path(folder)))
    print("kept as", Path(tempfile.gettempdir()) / name)


def summarise(reports: list[dict[str, Any]]) -> int:
    """Print the results of all inputs; return the number of faults."""
    tried: Counter[str] = Counter()
    clauses: Counter[str] = Counter()
    for report in reports:
        tried.update(report["tried"])
        clauses.update(report["clauses"])
    kinds = sorted({key.split()[0] for key in tried})
    print(f"\n{'format':12}{'inputs':>10}{'meshes':>10}{'sentences':>10}{'faults':>8}")
    for kind in [*kinds, "all"]:
        counts = [
            sum(n for key, n in tried.items() if key in (f"{kind} {came}", *_all(kind, key, came)))
            for came in ("mesh", "sentence", "fault")
        ]
        print(f"{kind:12}{sum(counts):>10}{counts[0]:>10}{counts[1]:>10}{counts[2]:>8}")
    faults = [fault for report in reports for fault in report["faults"]]
    slowest = max(report["slowest"] for report in reports)
    largest = max(report["largest"] for report in reports)
    told = sum(clauses.values())
    library = sum(n for clause, n in clauses.items() if "not readable" in clause)
    print(f"slowest {slowest[0]} s (input {slowest[1]}, {slowest[2]})")
    print(f"largest {largest[0]} MB (input {largest[1]}, {largest[2]})")
    print(f"a library's words in {library} of {told} sentences ({library / max(told, 1):.1%})")
    print(f"faults: {len(faults)}")
    for fault in faults[:50]:
        print("  ", fault)
    return len(faults)


def _all(kind: str, key: str, came: str) -> tuple[str, ...]:
    return (key,) if kind == "all" and key.endswith(came) else ()


if __name__ == "__main__":
    sys.exit(main())

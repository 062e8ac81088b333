"""Hard eigenproblems from seeds, solved and judged against dense references.

    ./dev bench hard [--problems 300] [--seed 0] [--jobs 1] [--only SEED ...] [--examples]

Prints how many problems of each family were right, refused and wrong, the messages of refusals and
errors with examples, and the slowest problem. The seed identifies a problem: ``--only 17`` solves
problem 17 again and prints its details. `--examples` solves the problems of
tests/hard_examples.py instead.

right     the requested eigenvalues, none missing, none twice, and residuals as reported
refused   an error message of the package, or pairs marked as not certified; "needed" if a reason
          is known: the matrix is invalid, or float64 has too few digits
wrong     any other result

The exit status is 1 if a result was wrong.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
#: Seconds on one problem after which its process is ended.
_PATIENCE = 150.0
#: Number of examples printed for each kind of answer.
_SHOWN = 3


def summary(verdict: Any) -> dict[str, Any]:
    """Return a verdict as plain data that can be sent through a pipe."""
    return {
        "seed": verdict.problem.seed,
        "family": verdict.problem.family,
        "problem": f"{verdict.problem.note}, n = {len(verdict.problem.mass)}",
        "path": verdict.problem.path,
        "request": str(verdict.request),
        "state": verdict.state,
        "needed": verdict.needed,
        "sentence": verdict.sentence,
        "kind": verdict.kind,
        "seconds": verdict.seconds,
    }


def serve(pipe: Connection) -> None:
    """Judge the seeds received from a pipe until None is received."""
    from hard_verdict import judge_seed

    while (seed := pipe.recv()) is not None:
        pipe.send(summary(judge_seed(seed)))


class Worker:
    """Process that judges one seed at a time."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other,), daemon=True)
        self.process.start()
        other.close()
        self.seed, self.since = -1, 0.0

    def give(self, seed: int) -> None:
        """Start to judge a seed."""
        self.seed, self.since = seed, time.perf_counter()
        self.pipe.send(seed)

    def take(self) -> dict[str, Any]:
        """Return the answer, which is "wrong" if the process has ended."""
        try:
            return dict(self.pipe.recv())
        except EOFError:
            self.process.join()
            return self.lost(f"the process ended with status {self.process.exitcode}")

    def lost(self, sentence: str) -> dict[str, Any]:
        """Return the answer for a seed whose process gave no verdict."""
        from hard_spectra import make_problem

        problem = make_problem(self.seed)
        return {
            "seed": self.seed,
            "family": problem.family,
            "problem": f"{problem.note}, n = {len(problem.mass)}",
            "path": problem.path,
            "request": "?",
            "state": "wrong",
            "needed": False,
            "sentence": sentence,
            "kind": sentence,
            "seconds": time.perf_counter() - self.since,
        }


def judged(seeds: list[int], jobs: int) -> Iterator[dict[str, Any]]:
    """Yield the answers for seeds from several processes, in the order of completion."""
    waiting = iter(seeds)
    idle = [Worker() for _ in range(min(jobs, len(seeds)))]
    busy: dict[Connection, Worker] = {}
    while True:
        while idle and (seed := next(waiting, None)) is not None:
            worker = idle.pop()
            if not worker.process.is_alive():
                worker = Worker()
            worker.give(seed)
            busy[worker.pipe] = worker
        if not busy:
            break
        for pipe in wait(list(busy), timeout=1.0):
            worker = busy.pop(pipe)  # type: ignore[index]
            yield worker.take()
            idle.append(worker)
        now = time.perf_counter()
        for pipe, worker in list(busy.items()):
            if now - worker.since > _PATIENCE:
                worker.process.terminate()
                worker.process.join()
                yield busy.pop(pipe).lost(f"no answer in {_PATIENCE:g} s")
                idle.append(worker)
    for worker in idle:
        if worker.process.is_alive():
            worker.pipe.send(None)
            worker.process.join()


def examples() -> Iterator[dict[str, Any]]:
    """Yield the answers for the problems that were once solved wrongly."""
    from hard_examples import EXAMPLES
    from hard_reference import scale_pencil, spectrum_of
    from hard_verdict import judge

    for name, make in EXAMPLES.items():
        solved = None
        for problem, request in make():
            if solved is not problem:
                pencil = scale_pencil(problem.stiffness, problem.mass)
                spectrum, solved = spectrum_of(pencil), problem
            yield {
                **summary(judge(problem, request, pencil, spectrum, limit=100.0)),
                "family": name,
            }


def table(answers: list[dict[str, Any]]) -> None:
    """Print the number of answers of each state by family."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for answer in answers:
        state = "needed" if answer["needed"] else answer["state"]
        for family in (answer["family"], "all"):
            counts[family][state] += 1
    width = max(map(len, counts))
    print(f"{'':{width}}  {'problems':>8} {'right':>7} {'refused':>8} {'(needed)':>9} {'wrong':>6}")
    for family in [*sorted(counts.keys() - {"all"}), "all"]:
        count = counts[family]
        refused = count["refused"] + count["needed"]
        print(
            f"{family:{width}}  {count.total():8} {count['right']:7} {refused:8} "
            f"{count['needed']:9} {count['wrong']:6}"
        )


def sentences(answers: list[dict[str, Any]]) -> None:
    """Print the messages of refusals and errors, grouped by kind."""
    groups: dict[tuple[str, bool, str], list[dict[str, Any]]] = defaultdict(list)
    for answer in answers:
        if answer["state"] != "right":
            groups[answer["state"], answer["needed"], answer["kind"]].append(answer)
    for (state, needed, _), group in sorted(
        groups.items(), key=lambda item: (item[0][0] != "wrong", item[0][1], -len(item[1]))
    ):
        families = Counter(answer["family"] for answer in group)
        shown = ", ".join(f"{family} {count}" for family, count in families.most_common(6))
        print(f"\n{state}{' (needed)' if needed else ''}, {len(group)} times: {shown}")
        for answer in sorted(group, key=lambda answer: len(answer["problem"]))[:_SHOWN]:
            print(f"  {answer['sentence'][:300]}")
            seed = f"--only {answer['seed']}: " if answer["seed"] >= 0 else ""
            print(f"    {seed}{answer['problem']} [{answer['path']}]: {answer['request']}")


def main() -> int:
    """Judge the problems named on the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problems", type=int, default=300, help="how many (default 300)")
    parser.add_argument("--seed", type=int, default=0, help="the first of their seeds")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--only", type=int, nargs="+", default=[], help="these seeds alone")
    parser.add_argument("--examples", action="store_true", help="those of hard_examples.py")
    options = parser.parse_args()
    for library in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMBA"):
        os.environ[f"{library}_NUM_THREADS".replace("MAXIMUM_NUM", "MAXIMUM")] = "1"
    seeds = options.only or list(range(options.seed, options.seed + options.problems))
    began = time.perf_counter()
    answers = []
    source = examples() if options.examples else judged(seeds, options.jobs)
    for answer in source:
        answers.append(answer)
        if options.only:
            print(answer["problem"], f"[{answer['path']}]:", answer["request"])
            print(f"  {answer['state']} {answer['sentence']} ({answer['seconds']:.2f} s)")
        elif sys.stderr.isatty():
            print(f"\r{len(answers)} of {len(seeds)}", end="", file=sys.stderr)
    seconds = time.perf_counter() - began
    if not options.only:
        if sys.stderr.isatty():
            print(file=sys.stderr)
        table(answers)
        sentences(answers)
        slowest = max(answers, key=lambda answer: float(answer["seconds"]))
        print(f"\n{len(answers)} problems in {seconds:.0f} s, references included")
        print(
            f"slowest: {slowest['seconds']:.1f} s, --only {slowest['seed']}: "
            f"{slowest['problem']}: {slowest['request']}"
        )
    return int(any(answer["state"] == "wrong" for answer in answers))


if __name__ == "__main__":
    sys.exit(main())

"""Hard eigenproblems from seeds, and problems once solved wrongly (see `hard_spectra`)."""

from __future__ import annotations

import signal
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import hard_verdict
import numpy as np
import pytest
import scipy.sparse as sp
from hard_examples import EXAMPLES
from hard_reference import scale_pencil, spectrum_of
from hard_requests import Request
from hard_spectra import Problem, graph_laplacian, grid_edges, matrices_of
from hard_verdict import Verdict, judge, judge_seed
from shapes import icosphere

from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve

#: Problems solved at every change, problems solved in a full run, and problems per test.
_QUICK, _PROBLEMS, _CHUNK = 10, 300, 10
#: Number of examples in a series above which only every third is solved.
_MANY = 20


def complaint(verdict: Verdict) -> str:
    """Return the error, or the unjustified refusal, of a verdict; else an empty string."""
    if verdict.state == "right" or verdict.needed:
        return ""
    name = f"seed {verdict.problem.seed}: " if verdict.problem.seed >= 0 else ""
    return f"{name}{verdict.problem.note}: {verdict.request}: {verdict.state}: {verdict.sentence}"


@pytest.mark.parametrize(
    "first",
    [
        pytest.param(first, marks=pytest.mark.slow if first >= _QUICK else ())
        for first in range(0, _PROBLEMS, _CHUNK)
    ],
)
def test_problems_from_seeds(first: int) -> None:
    complaints = [complaint(judge_seed(seed)) for seed in range(first, first + _CHUNK)]
    assert not list(filter(None, complaints))


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(1359, id="lowest pairs of a star"),
        pytest.param(14401, id="pairs of a star around a shift far above", marks=pytest.mark.slow),
        pytest.param(12271, id="signs after slices were made orthogonal"),
        pytest.param(16434, id="orthonormality after rows gave way to a refined one"),
        pytest.param(12930, id="an eigenvalue next to what counts as zero"),
        pytest.param(8697, id="copies told apart by their residuals alone, verified"),
        pytest.param(9332, id="nothing below 0 where rounding is more, verified"),
        pytest.param(1598, id="nearly all of one component among thousands of vertices"),
        pytest.param(9159, id="zeros left out around a shift, verified"),
        pytest.param(10784, id="several slices within a millionth of an eigenvalue"),
        pytest.param(10540, id="residual of constants on slivers"),
    ],
)
def test_seeds_that_once_went_wrong(seed: int) -> None:
    assert not complaint(judge_seed(seed))


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_example(name: str) -> None:
    asked = list(EXAMPLES[name]())
    complaints, before = [], None
    for problem, request in asked[:: 3 if len(asked) > _MANY else 1]:
        if problem is not before:
            pencil = scale_pencil(problem.stiffness, problem.mass)
            spectrum, before = spectrum_of(pencil), problem
        complaints.append(complaint(judge(problem, request, pencil, spectrum)))
    assert not list(filter(None, complaints))


# The judge -------------------------------------------------------------------------------------

Spoil = Callable[[Eigenpairs], Eigenpairs]


def sphere_problem() -> Problem:
    """Return a problem with multiplicities 1, 3, 5, 3 + 4, ..."""
    return Problem("sphere", "icosphere of 162", *matrices_of(icosphere(2)))


def shifted_problem() -> Problem:
    """Return a problem with lowest eigenvalue 1e-6."""
    stiffness = graph_laplacian(120, grid_edges(10, 12)) + 1e-6 * sp.eye_array(120)
    return Problem("shifted", "grid + 1e-6 M", sp.csr_array(stiffness), np.ones(120))


def spoilt(
    monkeypatch: pytest.MonkeyPatch, problem: Problem, request: Request, spoil: Spoil
) -> Verdict:
    """Return the verdict on an answer changed by `spoil`."""

    def solve_and_spoil(*given: Any, **options: Any) -> Eigenpairs:
        return spoil(solve(*given, **options))

    monkeypatch.setattr(hard_verdict, "solve", solve_and_spoil)
    return judge(problem, request, limit=hard_verdict.LIMIT)


def without(found: Eigenpairs, i: int) -> Eigenpairs:
    """Return an answer without pair i."""
    return replace(
        found,
        eigenvalues=np.delete(found.eigenvalues, i),
        rows=np.delete(found.rows, i, axis=0),
        residuals=np.delete(found.residuals, i),
    )


def with_eigenvalue(found: Eigenpairs, i: int, value: float) -> Eigenpairs:
    values = found.eigenvalues.copy()
    values[i] = value
    return replace(found, eigenvalues=values)


def with_row(found: Eigenpairs, i: int, row: Any) -> Eigenpairs:
    rows = found.rows.copy()
    rows[i] = row
    return replace(found, rows=rows)


def doubled(found: Eigenpairs) -> Eigenpairs:
    """Return an answer with a copy of pair 4 in place of pair 5."""
    return with_row(with_eigenvalue(found, 5, float(found.eigenvalues[4])), 5, found.rows[4])


THRESHOLD = Request("threshold", threshold=20.0)


@pytest.mark.parametrize("lost", [0, 4, -1])
def test_judge_misses_a_lost_pair(monkeypatch: pytest.MonkeyPatch, lost: int) -> None:
    verdict = spoilt(monkeypatch, sphere_problem(), THRESHOLD, lambda found: without(found, lost))
    assert verdict.state == "wrong"
    assert "pairs below" in verdict.sentence or "multiple" in verdict.sentence


def test_judge_misses_a_pair_that_another_stands_for(monkeypatch: pytest.MonkeyPatch) -> None:
    request = Request("count", count=12)

    def spoil(found: Eigenpairs) -> Eigenpairs:
        return without(solve(*matrices_of(icosphere(2)), 13), 3)

    verdict = spoilt(monkeypatch, sphere_problem(), request, spoil)
    assert verdict.state == "wrong"
    assert "lost" in verdict.sentence


def test_judge_sees_a_multiple_eigenvalue_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    values = solve(*matrices_of(icosphere(2)), 9).eigenvalues
    request = Request("threshold", threshold=float(values[5]) * (1.0 + 1e-13))

    def spoil(found: Eigenpairs) -> Eigenpairs:
        return without(found, -1)

    verdict = spoilt(monkeypatch, sphere_problem(), request, spoil)
    assert verdict.state == "wrong"


@pytest.mark.parametrize(
    "spoil",
    [
        doubled,
        lambda found: with_eigenvalue(found, 6, float(found.eigenvalues[6]) * (1 + 1e-7)),
        lambda found: with_row(found, 6, found.rows[6] * 1.001),
        lambda found: with_row(found, 6, found.rows[6] + 1e-6 * found.rows[0]),
        lambda found: with_row(found, 6, -found.rows[6]),
        lambda found: with_row(found, 6, np.nan),
        lambda found: replace(found, rows=found.rows.astype(np.float32)),
        lambda found: replace(found, eigenvalues=found.eigenvalues[::-1].copy()),
        lambda found: replace(found, rows=found.rows * (1.0 + 1e-10)),
    ],
)
def test_judge_sees_a_spoilt_answer(monkeypatch: pytest.MonkeyPatch, spoil: Spoil) -> None:
    assert spoilt(monkeypatch, sphere_problem(), THRESHOLD, lambda found: found).state == "right"
    assert spoilt(monkeypatch, sphere_problem(), THRESHOLD, spoil).state == "wrong"


def test_judge_measures_residuals_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    stray = np.random.default_rng(0).standard_normal(162)

    def spoil(found: Eigenpairs) -> Eigenpairs:
        mass = found.mass
        off = stray - found.rows.T @ (found.rows @ (mass * stray))
        row = found.rows[6] + 1e-9 * off
        return with_row(found, 6, row / np.sqrt(row @ (mass * row)))

    verdict = spoilt(monkeypatch, sphere_problem(), THRESHOLD, spoil)
    assert verdict.state == "wrong"
    assert "reported as" in verdict.sentence


def test_judge_tells_a_small_eigenvalue_from_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    request = Request("count", count=4)

    def spoil(found: Eigenpairs) -> Eigenpairs:
        assert found.complete
        return replace(with_eigenvalue(found, 0, 0.0), residuals=np.full(4, 1e-3))

    verdict = spoilt(monkeypatch, shifted_problem(), request, spoil)
    assert verdict.state == "wrong"


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="nothing ends a solver that hangs")
def test_judge_waits_for_no_answer_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    def turn(found: Eigenpairs) -> Eigenpairs:
        while True:
            time.process_time()

    monkeypatch.setattr(hard_verdict, "LIMIT", 0.1)
    verdict = spoilt(monkeypatch, sphere_problem(), THRESHOLD, turn)
    assert verdict.sentence == "no answer in 0.1 s"


def test_judge_takes_no_other_exception_and_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(found: Eigenpairs) -> Eigenpairs:
        raise ArithmeticError("11 of 12 eigenvalues found")

    def warn(found: Eigenpairs) -> Eigenpairs:
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
        return found

    for spoil, word in ((fail, "ArithmeticError"), (warn, "overflow")):
        verdict = spoilt(monkeypatch, sphere_problem(), THRESHOLD, spoil)
        assert verdict.state == "wrong"
        assert word in verdict.sentence


def test_pairs_that_say_they_are_not_proven_are_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(found: Eigenpairs) -> Eigenpairs:
        return replace(found, certificate=replace(found.certificate, method="none"))

    verdict = spoilt(monkeypatch, sphere_problem(), THRESHOLD, spoil)
    assert (verdict.state, verdict.needed) == ("refused", False)


def test_judge_sees_that_what_has_no_answer_was_accepted() -> None:
    problem = replace(sphere_problem(), refusal="must")
    assert judge(problem, THRESHOLD).state == "wrong"

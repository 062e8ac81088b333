"""Requests for hard eigenproblems: a count, a threshold, or the neighbours of a shift.

Thresholds and shifts lie at difficult places: on an eigenvalue to the last bit, next to it, between
copies of a multiple eigenvalue, on a diagonal entry, at zero, or beyond the spectrum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from hard_reference import Spectrum
from hard_spectra import Problem

__all__ = ["Request", "make_request"]

Random = np.random.Generator


@dataclass(frozen=True)
class Request:
    """Request to solve a problem.

    Parameters
    ----------
    kind : str
        Difficulty of the request.
    count : int, optional
    threshold : float, optional
    sigma : float, optional
    single : bool
        Whether eigenvectors come in float32.
    entry : {"solve", "bands", "hks"}
        `eigensolver.solve`, `decompose_laplacian_by_bands` or `compute_hks`.
    own_threshold : bool
        Whether the threshold is the last eigenvalue of a first solve for `count`.
    jobs : int
    """

    kind: str
    count: int | None = None
    threshold: float | None = None
    sigma: float | None = None
    single: bool = False
    entry: Literal["solve", "bands", "hks"] = "solve"
    own_threshold: bool = False
    jobs: int = 1
    most_memory: float = np.inf

    def __str__(self) -> str:
        asked = []
        if self.own_threshold:
            asked.append(f"max_eigenvalue=solve(count={self.count}).eigenvalues[-1]")
        elif self.count is not None:
            asked.append(f"n_components={self.count}")
        if self.threshold is not None:
            asked.append(f"max_eigenvalue={self.threshold!r}")
        if self.sigma is not None:
            asked.append(f"sigma={self.sigma!r}")
        if self.single:
            asked.append("float32")
        if self.jobs != 1:
            asked.append(f"n_jobs={self.jobs}")
        return f"{self.entry}({', '.join(asked)}) [{self.kind}]"


def make_request(problem: Problem, spectrum: Spectrum) -> Request:
    """Return the request for the problem of a seed, given its eigenvalues."""
    random = np.random.default_rng([problem.seed, 1])
    if problem.refusal == "must":
        # The eigenvalues are meaningless.
        return (
            _count(random, spectrum) if random.integers(2) else Request("threshold", threshold=1.0)
        )
    draw = random.random()
    if draw < 0.3:
        request = _count(random, spectrum)
    elif draw < 0.8:
        request = _threshold(random, problem, spectrum)
    else:
        request = _interior(random, problem, spectrum)
    draw = random.random()
    if draw < 0.1:
        request = replace(request, single=True)
    elif request.threshold is not None and draw < 0.25:
        request = replace(request, entry="bands")
    elif request.threshold is not None and draw < 0.3 and _is_level(spectrum):
        request = replace(request, entry="hks")
    if random.random() < 0.05 and request.entry == "solve":
        request = replace(request, jobs=2)
    return request


def _is_level(spectrum: Spectrum) -> bool:
    """Return whether the eigenvectors of dense `eigh` are accurate to many digits."""
    positive = spectrum.values[spectrum.values > spectrum.copies]
    return spectrum.n < 800 and 1e-8 * positive.max(initial=0.0) < positive.min(initial=np.inf)


def _most(spectrum: Spectrum) -> int:
    """Return the maximum count: many pairs of a large problem take long."""
    return spectrum.n if spectrum.n < 500 else min(spectrum.n, 200)


def _few(random: Random, most: int) -> int:
    return int(np.clip(round(float(np.exp(random.uniform(0.0, np.log(most + 1))))), 1, most))


def _count(random: Random, spectrum: Spectrum) -> Request:
    draw = random.random()
    if draw < 0.1 and spectrum.n <= 500:
        return Request("all, or more than there are", count=spectrum.n + int(random.integers(0, 7)))
    if draw < 0.3:
        # End the count within a multiple eigenvalue, if any.
        values, copies = spectrum.values[: _most(spectrum)], spectrum.copies[: _most(spectrum)]
        near = values[1:] - copies[1:] <= values[:-1]
        if near.any():
            return Request(
                "count within copies", count=1 + int(random.choice(np.flatnonzero(near)))
            )
    return Request("count", count=_few(random, _most(spectrum)))


def _eigenvalue(random: Random, spectrum: Spectrum) -> float:
    return float(spectrum.values[_few(random, _most(spectrum)) - 1])


def _threshold(random: Random, problem: Problem, spectrum: Spectrum) -> Request:
    kinds: list[tuple[str, Callable[[], float]]] = [
        ("threshold", lambda: _eigenvalue(random, spectrum) * random.uniform(0.7, 1.3)),
        ("threshold on an eigenvalue", lambda: _eigenvalue(random, spectrum)),
        (
            "threshold beside an eigenvalue",
            lambda: float(
                np.nextafter(_eigenvalue(random, spectrum), random.choice([-np.inf, np.inf]))
            ),
        ),
        (
            "threshold near an eigenvalue",
            lambda: (
                _eigenvalue(random, spectrum)
                * (1.0 + float(random.choice([-1, 1])) * 10.0 ** random.uniform(-15, -5))
            ),
        ),
        ("threshold on a diagonal entry", lambda: _diagonal_entry(random, problem)),
        ("threshold on an integer", lambda: float(random.integers(1, 10))),
        ("threshold 0", lambda: 0.0),
        ("threshold next to 0", lambda: float(10.0 ** random.uniform(-300, -12))),
        ("threshold above all", lambda: float(spectrum.values[-1]) * random.uniform(1.0, 3.0)),
        ("threshold far above all", lambda: float(10.0 ** random.uniform(10, 300))),
    ]
    shares = np.array([1.5, 2.0, 1.5, 1.5, 1.5, 1.0, 0.4, 0.3, 0.6, 0.4])
    if random.random() < 0.15:
        return Request(
            "threshold on an eigenvalue as solved",
            count=_few(random, _most(spectrum)),
            own_threshold=True,
        )
    kind, make = kinds[int(random.choice(len(kinds), p=shares / shares.sum()))]
    value = float(np.clip(make(), 0.0, 1e300))
    if value > spectrum.values[_most(spectrum) - 1] and spectrum.n > 600:
        # So many pairs would take too long.
        return Request("threshold on an eigenvalue", threshold=_eigenvalue(random, spectrum))
    return Request(kind, threshold=value)


def _diagonal_entry(random: Random, problem: Problem) -> float:
    used = np.flatnonzero(problem.mass > 0.0)
    i = int(random.choice(used))
    with np.errstate(over="ignore"):
        return float(problem.stiffness.diagonal()[i] / problem.mass[i])


def _interior(random: Random, problem: Problem, spectrum: Spectrum) -> Request:
    top = float(spectrum.values[-1])
    kinds: list[tuple[str, Callable[[], float]]] = [
        ("sigma", lambda: random.uniform(0.0, 1.0) * top),
        ("sigma", lambda: _eigenvalue(random, spectrum) * random.uniform(0.8, 1.2)),
        ("sigma on an eigenvalue", lambda: _eigenvalue(random, spectrum)),
        ("sigma on a diagonal entry", lambda: _diagonal_entry(random, problem)),
        ("sigma on an integer", lambda: float(random.integers(1, 10))),
        ("sigma above all", lambda: top * random.uniform(1.0, 3.0)),
        ("sigma far above all", lambda: float(10.0 ** random.uniform(10, 300))),
        ("sigma next to 0", lambda: float(10.0 ** random.uniform(-300, -10))),
        ("sigma below 0", lambda: -float(10.0 ** random.uniform(-10, 3))),
    ]
    kind, make = kinds[int(random.integers(len(kinds)))]
    most = max(1, min(_most(spectrum), spectrum.n // 6))
    sigma = float(np.clip(make(), -1e300, 1e300))
    return Request(kind, count=_few(random, most), sigma=sigma)

"""Solution of hard problems, judged against the reference.

An answer is *right* if it has the requested eigenvalues, none lost or duplicated, and if its
reported residuals and orthonormality agree with the measurements here. It is *refused* if the
package raises one of its own errors or reports eigenpairs as not proven. It is *wrong* otherwise:
another exception, an unexpected warning, a false proof, or no answer in time.
"""

from __future__ import annotations

import re
import signal
import threading
import time
import tracemalloc
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp
from hard_reference import EPS, FINE, ROUNDING, Scaled, Spectrum, scale_pencil, spectrum_of
from hard_requests import Request, make_request
from hard_spectra import Problem, make_problem

from meshmash_viewer import errors
from meshmash_viewer.decompose import compute_hks, decompose_laplacian_by_bands
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral import cost
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine import computation

__all__ = ["Verdict", "judge", "judge_seed", "through"]

FloatArray = npt.NDArray[np.float64]

#: Maximum processor time of an answer, in seconds.
LIMIT = 30.0
#: Tolerances of a proof: largest residual relative to λ, and error of orthonormality.
_RESIDUAL = {"float64": 1e-6, "float32": 1e-3}
_ORTHONORMALITY = {"float64": 1e-8, "float32": 1e-4}
#: Relative errors of eigenvalues that the solver's tolerance allows.
_RELATIVE = {"float64": 1e-9, "float32": 3e-7}
#: Warnings that do not concern the accuracy of eigenpairs.
_OF_OTHER_THINGS = (errors.ConstantFeaturesWarning, errors.TruncationWarning)
#: Relative margin above a threshold within which eigenvalues are kept.
_MARGIN = 2e-11


class _OutOfTime(BaseException):
    """Interruption of a solve at its time limit."""


class _NotRight(Exception):
    """Exception with the error of an answer."""


@dataclass(frozen=True)
class Verdict:
    """Result of a request.

    Parameters
    ----------
    state : {"right", "refused", "wrong"}
    sentence : str
        The refusal, or the error of the answer.
    needed : bool
        Whether `_excuse` finds a reason for the refusal.
    seconds : float
        Processor time of the solver alone, summed over all cores.
    problem, request
    """

    state: Literal["right", "refused", "wrong"]
    sentence: str
    needed: bool
    seconds: float
    problem: Problem
    request: Request

    @property
    def kind(self) -> str:
        """The sentence with numbers replaced by #, to count similar sentences."""
        return re.sub(r"[-+]?(\d[\d,]*\.?\d*(e[-+]?\d+)?|inf|nan)\b", "#", self.sentence)


@dataclass
class _Answer:
    """Eigenpairs as the package returns them."""

    eigenvalues: FloatArray
    rows: npt.NDArray[np.floating[Any]]
    residuals: FloatArray | None = None
    orthonormality: float | None = None
    proven: bool | None = None
    sentence: str = ""
    verified: Certificate | None = None


# Asking ----------------------------------------------------------------------------------------


@contextmanager
def through(path: str) -> Iterator[None]:
    """Solve through slices of the spectrum even if dense `eigh` would be faster.

    "sliced" slices every problem large enough for the Lanczos iteration; by default, the package
    slices above some 700 vertices. "thin slices" also limits slices to a few pairs, so that a small
    spectrum has many borders. "as built" changes nothing.
    """
    if path == "as built":
        yield
        return

    def is_dense(n: int, n_null: int, wanted: int) -> bool:
        free, owed = n - n_null, max(wanted - n_null, 0)
        return free < 80 or 2.3 * owed + 72.0 > free

    changed: list[tuple[Any, str, Any]] = [
        (computation, "is_dense", is_dense),
        (cost, "is_dense", is_dense),
    ]
    if path == "thin slices":
        changed += [
            (cost, "_INDIVISIBLE", 8),
            (cost, "_SLICE_PAIRS", 12),
            (cost, "_LEAN_SLICE_PAIRS", 6),
        ]
    before = [(module, name, getattr(module, name)) for module, name, _ in changed]
    try:
        for module, name, value in changed:
            setattr(module, name, value)
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Raise `_OutOfTime` after so many seconds of processor time, if the system can."""
    here = threading.current_thread() is threading.main_thread()
    if not (here and hasattr(signal, "setitimer")):
        yield
        return

    def ring(*_: object) -> None:
        raise _OutOfTime

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@contextmanager
def _memory(most: float) -> Iterator[None]:
    """Raise `_NotRight` if arrays take more bytes than `most` at once."""
    if most == np.inf:
        yield
        return
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    if peak > most:
        raise _NotRight(f"{peak / 1e6:.0f} MB, allowed are {most / 1e6:.0f}")


def _matrices(problem: Problem) -> tuple[Any, Any]:
    if problem.mesh is None:
        return problem.stiffness, problem.mass
    return cotangent_laplacian(Mesh(*problem.mesh), robust=problem.robust)


def _ask(problem: Problem, request: Request, limit: float) -> tuple[Request, _Answer | FloatArray]:
    """Return the request, with its final threshold, and the answer."""
    end = time.process_time() + limit

    def cancel() -> bool:
        return time.process_time() > end

    stiffness, mass = _matrices(problem)
    dtype = np.float32 if request.single else np.float64
    count, threshold = request.count, request.threshold
    if request.own_threshold:
        first = solve(stiffness, mass, count, n_jobs=request.jobs, cancel=cancel)
        threshold, count = float(first.eigenvalues[-1]), None
        request = Request(request.kind, threshold=threshold, single=request.single)
    if request.entry == "hks":
        assert threshold is not None
        pencil = (sp.csc_array(stiffness), mass if sp.issparse(mass) else sp.diags_array(mass))
        times = _hks_times(threshold)
        return request, compute_hks(
            pencil,
            threshold,
            *times[::-1],
            n_components=3,
            decomposition_dtype=dtype,
            cancel=cancel,
        )
    if request.entry == "bands":
        assert threshold is not None
        found = decompose_laplacian_by_bands(
            stiffness,
            mass if sp.issparse(mass) else sp.diags_array(mass),
            max_eigenvalue=threshold,
            cancel=cancel,
        )
        return request, _Answer(found[0], found[1].T)
    result = solve(
        stiffness,
        mass,
        count,
        max_eigenvalue=threshold,
        sigma=request.sigma,
        dtype=dtype,
        n_jobs=request.jobs,
        cancel=cancel,
    )
    return request, _Answer(
        result.eigenvalues,
        result.rows,
        result.residuals,
        result.orthonormality,
        result.complete,
        result.proof(),
        result.verify(stiffness, mass),
    )


def _hks_times(threshold: float) -> tuple[float, float]:
    """Return the shortest and longest time of a requested HKS."""
    scale = min(max(threshold, 1e-200), 1e200)
    return 0.5 / scale, 20.0 / scale


# Judging ---------------------------------------------------------------------------------------


def judge_seed(seed: int, limit: float = LIMIT) -> Verdict:
    """Make, solve and judge the problem of a seed."""
    problem = make_problem(seed)
    pencil = scale_pencil(problem.stiffness, problem.mass)
    spectrum = spectrum_of(pencil)
    return judge(problem, make_request(problem, spectrum), pencil, spectrum, limit)


def judge(
    problem: Problem,
    request: Request,
    pencil: Scaled | None = None,
    spectrum: Spectrum | None = None,
    limit: float = LIMIT,
) -> Verdict:
    """Solve a problem and judge the answer."""
    if pencil is None or spectrum is None:
        pencil = scale_pencil(problem.stiffness, problem.mass)
        spectrum = spectrum_of(pencil)
    began = time.process_time()
    state: Literal["right", "refused", "wrong"] = "right"
    sentence = ""
    asked, answer = request, None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with through(problem.path), _alarm(2.0 * limit), _memory(request.most_memory):
                asked, answer = _ask(problem, request, limit)
        except _NotRight as fault:
            state, sentence = "wrong", str(fault)
        except (Cancelled, _OutOfTime) as fault:
            state, sentence = "wrong", f"no answer in {limit:g} s"
            if time.process_time() - began < limit:
                sentence = f"{type(fault).__name__}, though nobody asked: {fault}"
        except Exception as fault:  # noqa: BLE001 - any exception is judged
            state, sentence = "wrong", f"{type(fault).__name__}: {fault}"
            if type(fault).__module__ == errors.__name__:
                state, sentence = "refused", str(fault)
    seconds = time.process_time() - began
    own = [w for w in caught if w.category.__module__ == errors.__name__]
    leaked = [w for w in caught if w not in own]
    said = [w for w in own if w.category not in _OF_OTHER_THINGS]
    if leaked and state != "wrong":
        state = "wrong"
        sentence = f"leaked {leaked[0].category.__name__}: {leaked[0].message}"
    elif answer is not None and state != "wrong":
        try:
            sentence = _fault_or_doubt(problem, asked, answer, pencil, spectrum)
            state = "refused" if sentence else "right"
        except _NotRight as fault:
            state, sentence = "wrong", str(fault)
            if said:
                state, sentence = "refused", str(said[0].message)
    needed = state == "refused" and bool(_excuse(problem, asked, pencil, spectrum))
    return Verdict(state, sentence, needed, seconds, problem, asked)


def _excuse(problem: Problem, request: Request, pencil: Scaled, spectrum: Spectrum) -> str:
    """Return a reason for a refusal, or an empty string."""
    if problem.refusal:
        return "the problem has no answer that float64 can hold"
    roots = np.sqrt(problem.mass[problem.mass > 0.0])
    if request.single and not 1e-30 < roots.min() <= roots.max() < 1e30:
        return "eigenvectors have entries that float32 cannot hold"
    values = np.abs(spectrum.values)
    norm = float(values.max(initial=0.0))
    count = len(values) if request.count is None or request.sigma is not None else request.count
    small = values[:count][values[:count] > spectrum.copies[:count]]
    if len(small) and EPS * norm > 1e-8 * float(small.min()):
        return "the smallest and the largest eigenvalue leave no digits between them"
    if EPS * norm > 1e-8 * np.ldexp(_spacings(pencil).min(initial=np.inf), pencil.exponent):
        return "zeros cannot be told from noise"
    matrix = pencil.stiffness
    sums, sizes = matrix.sum(axis=1), abs(matrix).sum(axis=1)
    shifted = bool((np.abs(sums) > ROUNDING * EPS * sizes).any())
    shift = np.ldexp(abs(float(sums.sum() / pencil.mass.sum())), pencil.exponent)
    if shifted and EPS * norm > 1e-8 * shift:
        return "next to zero, and not zero"
    if request.threshold is not None and request.threshold < max(spectrum.low[0], 0.0):
        return "nothing lies below the threshold"
    return ""


def _spacings(pencil: Scaled) -> FloatArray:
    """Return Weyl's spacing 4π / area of each component."""
    return np.asarray(4.0 * np.pi / np.bincount(pencil.labels, weights=pencil.mass))


def _fault_or_doubt(
    problem: Problem,
    request: Request,
    answer: _Answer | FloatArray,
    pencil: Scaled,
    spectrum: Spectrum,
) -> str:
    """Raise `_NotRight`, or return the answer's reason why it is not proven, if any."""
    if problem.refusal == "must":
        raise _NotRight("accepted what has no answer")
    if not isinstance(answer, _Answer):
        _check_hks(problem, request, answer, pencil, spectrum)
        return ""
    _check_shapes(request, answer, pencil, len(problem.mass))
    measures = _Measures(answer, pencil)
    precision = "float32" if request.single else "float64"
    if answer.residuals is not None:
        _check_reports(answer, measures, precision)
        if not answer.proven:
            return answer.sentence
    if measures.orthonormality > 2.0 * _ORTHONORMALITY[precision]:
        raise _NotRight(f"orthonormality {measures.orthonormality:.0e}, and not a word of it")
    allowed = np.full(len(answer.eigenvalues), 2.0 * _RESIDUAL[precision])
    if request.single:
        allowed += measures.floor
    if not answer.proven:
        # Unproven answers may have the error of a backward stable computation.
        allowed = np.maximum(allowed, measures.backward)
    bad = measures.residuals > allowed
    if bad.any():
        worst = float(measures.residuals[bad].max())
        raise _NotRight(f"a residual of {worst:.0e}, and not a word of it")
    _check_eigenvalues(request, answer, measures, pencil, spectrum)
    descent = -np.diff(answer.eigenvalues, append=np.inf).min(initial=0.0)
    if descent > 0.0:
        raise _NotRight(f"eigenvalues that do not ascend, by {descent:.0e}")
    verified = answer.verified
    if verified is not None and verified.residual < 2.0 * _RESIDUAL[precision]:
        # Two measurements of a residual may lie on different sides of its tolerance.
        verified = replace(verified, residual=min(verified.residual, 0.5 * _RESIDUAL[precision]))
    if verified is not None and not verified.complete:
        raise _NotRight(f"right, but verify says: {', '.join(verified.lacks)}")
    return ""


def _check_shapes(request: Request, answer: _Answer, pencil: Scaled, n_all: int) -> None:
    k = len(answer.eigenvalues)
    if answer.rows.shape != (k, n_all):
        raise _NotRight(f"rows of shape {answer.rows.shape} for {k} eigenvalues")
    if answer.rows.dtype != (np.float32 if request.single else np.float64):
        raise _NotRight(f"rows of {answer.rows.dtype}")
    if not np.isfinite(answer.eigenvalues).all():
        raise _NotRight("an eigenvalue that is not finite")
    idle = np.ones(n_all, dtype=np.bool_)
    idle[pencil.active] = False
    if not (np.isnan(answer.rows[:, idle]).all() and np.isfinite(answer.rows[:, ~idle]).all()):
        raise _NotRight("NaN at vertices with mass, or none at vertices without")
    rows = answer.rows[:, pencil.active]
    if k and (rows.max(axis=1) < (1.0 - 1e-5) * np.abs(rows).max(axis=1)).any():
        raise _NotRight("an eigenvector whose largest entry is negative")


class _Measures:
    """Residuals and orthonormality of an answer, measured again.

    Attributes
    ----------
    residuals : ndarray, shape (k,)
        ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``, for values next to zero relative to 4π / area.
    floor : ndarray, shape (k,)
        Residual that the rounding of φ alone causes.
    backward : ndarray, shape (k,)
        Residual of a computation that is exact for a matrix next to L.
    errors : ndarray, shape (k,)
        The residual in the norm that bounds the error of λ, absolute, in the unit of the problem.
    orthonormality : float
    """

    def __init__(self, answer: _Answer, pencil: Scaled) -> None:
        rows = answer.rows[:, pencil.active].astype(np.float64)
        rows = np.ldexp(rows, pencil.mass_exponent // 2)
        values = np.ldexp(answer.eigenvalues, -pencil.exponent)
        columns = rows.T.astype(np.longdouble)
        mass = pencil.mass.astype(np.longdouble)[:, None]
        matrix: Any = pencil.stiffness.astype(np.longdouble)
        weighted = mass * columns
        defect = matrix @ columns - values * weighted
        sizes = abs(matrix) @ np.abs(columns) + np.abs(values) * np.abs(weighted)
        length = _norms(weighted)
        spacing = _spacings(pencil)
        share = np.zeros((len(spacing), len(values)))
        np.add.at(share, pencil.labels, (rows.T**2) * pencil.mass[:, None])
        near_zero = np.where(share > 1e-6, spacing[:, None], 0.0).max(axis=0, initial=0.0)
        norm = float(abs(pencil.stiffness / pencil.mass[:, None]).sum(axis=1).max(initial=0.0))
        null = (values <= 1e-8 * near_zero) | (values <= 256.0 * EPS * norm)
        unit = np.where(null, np.maximum(values, near_zero), values)
        self.residuals = (_norms(defect) / (unit * length)).astype(np.float64)
        self.floor = (EPS_OF[answer.rows.dtype] * _norms(sizes) / (unit * length)).astype(
            np.float64
        )
        self.floor *= 4.0
        self.backward = 64.0 * EPS * norm / np.asarray(unit, dtype=np.float64)
        root = np.sqrt(mass)
        errors = _norms(defect / root) / _norms(columns * root)
        self.errors = np.ldexp(errors.astype(np.float64), pencil.exponent)
        gram = (rows * pencil.mass) @ rows.T
        self.orthonormality = float(np.abs(gram - np.eye(len(rows))).max(initial=0.0))


EPS_OF = {np.dtype(kind): float(np.finfo(kind).eps) for kind in (np.float32, np.float64)}


def _norms(columns: Any) -> Any:
    return np.sqrt((columns * columns).sum(axis=0))


def _check_reports(answer: _Answer, measures: _Measures, precision: str) -> None:
    """Check the reported residuals and orthonormality against the measured ones."""
    assert answer.residuals is not None
    assert answer.orthonormality is not None
    said = np.asarray(answer.residuals, dtype=np.float64)
    if said.shape != measures.residuals.shape:
        raise _NotRight(f"{said.shape} residuals for {measures.residuals.shape} pairs")
    # Residuals far below the tolerance of the solver need no accurate digit.
    slack = 1.5 * measures.floor + 1e-11
    if not answer.proven:
        # Residuals of unproven answers have the rounding of float64.
        slack = slack + measures.backward
    hidden = ~(said >= 0.4 * measures.residuals - slack)
    if hidden.any():
        i = int(np.argmax(np.where(hidden, measures.residuals, 0.0)))
        raise _NotRight(
            f"residual {measures.residuals[i]:.0e} (pair {i}), reported as {said[i]:.0e}"
        )
    noise = 1e-12 if precision == "float64" else 1e-5
    if not answer.orthonormality >= measures.orthonormality / 5.0 - noise:
        raise _NotRight(
            f"orthonormality {measures.orthonormality:.0e}, reported as {answer.orthonormality:.0e}"
        )


def _check_eigenvalues(
    request: Request, answer: _Answer, measures: _Measures, pencil: Scaled, spectrum: Spectrum
) -> None:
    """Check that the answer has all requested eigenvalues and no others."""
    found = np.sort(answer.eigenvalues)
    k = len(found)
    precision = "float32" if request.single else "float64"
    # An eigenvalue may be wrong by its residual, up to the tolerance of a proof.
    size = np.maximum(np.abs(found), 0.0)
    room = np.maximum(
        _RELATIVE[precision] * size, np.minimum(measures.errors, _RESIDUAL[precision] * size)
    )
    room += FINE * size
    if request.threshold is not None:
        noise = min(float(measures.errors.max(initial=0.0)), 16.0 * EPS * spectrum.values[-1])
        _check_threshold(request.threshold, found, noise, spectrum)
        _check_run(found, room, spectrum, 0)
        return
    assert request.count is not None
    if k != min(request.count, spectrum.n):
        raise _NotRight(f"{k} pairs, not {min(request.count, spectrum.n)}")
    if request.sigma is None or request.sigma <= 0.0:
        _check_run(found, room, spectrum, 0)
        return
    _check_nearest(request.sigma, found, room, spectrum)


def _check_run(found: FloatArray, room: FloatArray, spectrum: Spectrum, start: int) -> None:
    """Compare eigenvalues with the reference from index `start` on."""
    k = len(found)
    low, high = spectrum.low[start : start + k], spectrum.high[start : start + k]
    off = (found < low - room) | (found > high + room)
    if off.any():
        i = int(np.argmax(off))
        wanted = spectrum.values[start + i]
        lost = k - i > 1 and found[i] > high[i] + room[i]
        raise _NotRight(
            f"eigenvalue {i} is {found[i]:.17g}, should be {wanted:.17g}"
            f"{' (one before it may be lost)' if lost else ''}"
        )


def _check_threshold(threshold: float, found: FloatArray, noise: float, spectrum: Spectrum) -> None:
    """Check the number of pairs up to a threshold, with multiple eigenvalues whole.

    Eigenvalues within `noise` of the threshold may lie on either side.
    """
    k = len(found)
    if k and found[-1] > threshold:
        raise _NotRight(f"eigenvalue {found[-1]!r} above the threshold {threshold!r}")
    margin = _MARGIN * threshold + noise
    least = int(np.searchsorted(spectrum.high, threshold - margin))
    most = int(np.searchsorted(spectrum.low, threshold + margin, side="right"))
    if not least <= k <= most:
        between = f"{least} to {most}" if most > least else str(least)
        raise _NotRight(f"{k} pairs below {threshold:.17g}, should be {between}")
    if 0 < k < spectrum.n:
        gap = spectrum.values[k] - spectrum.values[k - 1]
        copies = max(spectrum.copies[k], spectrum.copies[k - 1])
        # With stiff edges, eigenvalues equal up to rounding may differ for the exact entries.
        plain = ROUNDING * EPS * spectrum.values[-1] < 1e-9 * spectrum.values[k]
        if plain and gap <= copies:
            same = np.abs(spectrum.values - spectrum.values[k - 1]) <= 2.0 * copies
            raise _NotRight(
                f"{k} pairs cut a multiple eigenvalue ({int(same.sum())} copies of "
                f"{spectrum.values[k]:.17g})"
            )


def _check_nearest(sigma: float, found: FloatArray, room: FloatArray, spectrum: Spectrum) -> None:
    k = len(found)
    distance = np.abs(spectrum.values - sigma)
    slack = 0.5 * (spectrum.high - spectrum.low).max(initial=0.0)
    reach = np.sort(distance)[k - 1]
    reach += 2.0 * (room.max(initial=0.0) + slack) + 4.0 * EPS * sigma
    fault: _NotRight | None = None
    for start in range(spectrum.n - k + 1):
        if max(distance[start], distance[start + k - 1]) > reach:
            continue
        try:
            _check_run(found, room, spectrum, start)
        except _NotRight as misfit:
            fault = fault or misfit
        else:
            return
    raise _NotRight(f"not the {k} nearest {sigma!r}: {fault}")


def _check_hks(
    problem: Problem, request: Request, found: FloatArray, pencil: Scaled, spectrum: Spectrum
) -> None:
    """Check heat kernel signatures against a dense solution."""
    assert request.threshold is not None
    times = np.geomspace(*_hks_times(request.threshold), 3)
    n_all = len(problem.mass)
    if found.shape != (n_all, 3):
        raise _NotRight(f"features of shape {found.shape}")
    found = found[pencil.active].astype(np.float64)
    margin = _MARGIN * request.threshold
    least = int(np.searchsorted(spectrum.high, request.threshold - margin))
    most = int(np.searchsorted(spectrum.low, request.threshold + margin, side="right"))
    if not np.isfinite(found).all():
        raise _NotRight("features that are not finite")
    root = np.sqrt(pencil.mass)
    dense = pencil.stiffness.toarray() / root[:, None] / root
    values, vectors = scipy.linalg.eigh(dense)
    values = np.ldexp(np.where(values > 64.0 * EPS * values[-1], values, 0.0), pencil.exponent)
    squares = (vectors / root[:, None]) ** 2 * 2.0 ** -float(pencil.mass_exponent)
    relative = 1e-2 if request.single else 1e-5
    for k in {least, most}:
        wanted = squares[:, :k] @ np.exp(-np.outer(values[:k], times))
        if np.allclose(found, wanted, rtol=relative, atol=1e-9 * float(wanted.max(initial=0.0))):
            return
    off = float(np.abs(found / np.maximum(wanted, 1e-300) - 1.0).max())
    raise _NotRight(f"HKS off by {off:.0e}")

"""Truncation error: the contribution to features of eigenpairs that were not computed.

With lumped masses ``Σ_k φ_k(v)² = 1 / m_v`` over all pairs, so the remainder after K pairs is
``r(v) = 1 / m_v - Σ_{k≤K} φ_k(v)²`` at vertex v. The error with a filter h is at most
``sup_{λ>λ_K} |h(λ)| r(v)``: the *bound*, valid for every mesh. The bound is pessimistic, since it
assumes that the whole remainder is at one eigenvalue.

The *estimate* distributes the remainder by the local Weyl law: on a surface ``Σ φ_k(v)²`` grows by
``dλ / 4π`` at every vertex, so the remainder extends from λ_K to ``λ_K + 4π r(v)``, and the error
is about ``∫ h(λ) dλ / 4π`` over this range. The estimate never exceeds the bound. It is too high on
very uneven meshes (by a factor of 3 to 4 on a machined part of long thin triangles), and too low on
a boundary.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError, TruncationWarning, of_mesh, unknown
from meshmash_viewer.spectral.weyl import (
    TOLERANCE,
    Target,
    required_eigenvalue,
    weyl_count,
    weyl_eigenvalue,
)
from meshmash_viewer.units import format_share

if TYPE_CHECKING:
    from meshmash_viewer.features.filter_responses import TailedResponse
    from meshmash_viewer.features.filters import FilterBank


#: Relative margin below the last eigenvalue, whose eigenspace may be incomplete.
_COPIES = 1e-9
#: Rounding error of ``m_v Σ φ_k(v)²``, which is at most 1, in units of the precision of φ.
_ROUNDINGS = 64.0
#: Vertices processed at a time: 32 columns take 4 MB.
_VERTICES = 16384


@dataclass(frozen=True, eq=False)
class Remainder:
    """Remainder of a truncated sum at every vertex."""

    #: Shape (n,): ``1 / m_v - Σ_k φ_k(v)²``, at least 0; NaN at vertices without mass.
    left: FloatArray
    #: All pairs up to this eigenvalue were included; the other `n_left` pairs were not.
    known_to: float
    n_left: int
    #: Sum of all masses, in squared unit.
    area: float
    #: The filters without normalisation.
    tail: TailedResponse
    #: Shape (f,): divisors; they depend on the number of pairs if `normalised`.
    totals: FloatArray
    normalised: bool

    def estimate(self, values: npt.NDArray[np.floating[Any]]) -> FloatArray:
        """Estimate the truncation error by the local Weyl law, shape (n, f), not negative.

        `values`, shape (n, f), are the truncated features; only normalised filters use them.
        """
        result = np.empty((len(self.left), len(self.totals)))
        for part in blocks(len(result), _VERTICES):
            result[part] = self._estimate(self.left[part], values[part])
        return result

    def bound(self, values: npt.NDArray[np.floating[Any]]) -> FloatArray:
        """Compute an upper bound of the truncation error, shape (n, f); see `estimate`."""
        supremum = self.tail.supremum(self.known_to)
        highest = self._divided(self.left[:, np.newaxis] * supremum, self.totals)
        if not self.normalised:
            return highest
        # The larger of two extremes: the whole remainder is in the divisor, or in the sum.
        more = self.n_left * supremum
        above = np.abs(values) * self._divided(more, self.totals + more)
        return np.asarray(np.maximum(highest, above), dtype=np.float64)

    def _estimate(self, left: FloatArray, values: npt.NDArray[Any]) -> FloatArray:
        with np.errstate(invalid="ignore"):
            missing = self._integral(left)
            if self.normalised:
                # The divisor grows too: the error is (A + a) / (C + c) - A / C.
                more = self._integral(np.array([self.n_left / self.area])) * self.area
                missing = np.abs(missing - values * more)
                return self._divided(missing, self.totals + more[0])
        return self._divided(missing, self.totals)

    def _integral(self, left: FloatArray) -> FloatArray:
        """Compute ``∫ h dλ / 4π`` over the range of the remainder, shape (n, f)."""
        ends = self.known_to + 4.0 * math.pi * left
        area = self.tail.integral(self.known_to, ends) / (4.0 * math.pi)
        # The bound limits the rounding error of the ends of the range.
        highest = left[:, np.newaxis] * self.tail.supremum(self.known_to)
        return np.asarray(np.minimum(area, highest))

    @staticmethod
    def _divided(missing: FloatArray, totals: FloatArray) -> FloatArray:
        # A filter without pairs in its band has the divisor 0, and is missing entirely.
        divisor = np.where(totals > 0.0, totals, 1.0)
        return np.asarray(missing / divisor, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Truncation:
    """Relative truncation errors of feature columns.

    Errors are relative to the typical size of a column: the median of its magnitudes over the
    vertices plus the median of the estimate.

    Parameters
    ----------
    columns : tuple of str
        Names of the f columns.
    estimate, largest_estimate : ndarray of float64, shape (f,)
        Median and largest estimate over the vertices, by the local Weyl law.
    bound, largest_bound : ndarray of float64, shape (f,)
        Median and largest upper bound over the vertices.
    known_to : float
        All pairs up to this eigenvalue were included, per squared unit.
    n_left : int
        Number of pairs of the mesh that were not included.
    added : bool
        Whether the estimate has been added to the features (``tail="weyl"``).
    remainder : Remainder
        Remainder, from which errors at every vertex are computed.

    Examples
    --------
    >>> hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.1, 1.0]), warn=False)
    >>> bool(hks.truncation.estimate[0] > 0.01 > hks.truncation.estimate[1])
    True
    """

    columns: tuple[str, ...]
    estimate: FloatArray
    largest_estimate: FloatArray
    bound: FloatArray
    largest_bound: FloatArray
    known_to: float
    n_left: int
    added: bool
    remainder: Remainder

    @property
    def flagged(self) -> npt.NDArray[np.int64]:
        """Indices of the columns whose estimated error exceeds `TOLERANCE`."""
        return np.flatnonzero(self.estimate > TOLERANCE)

    def sentence(self) -> str:
        """Return a sentence on the error without its full stop; empty if no column is flagged.

        "7 of 32 columns miss more than 1 % for want of eigenpairs, hks_t=5.00e+04 about 95 %".
        """
        return missing_sentence(self.columns, self.estimate, added=self.added)

    def as_dict(self) -> dict[str, Any]:
        """Return the errors of each column as a dictionary for JSON."""
        return {
            "known_to": self.known_to,
            "n_left_out": self.n_left,
            "tolerance": TOLERANCE,
            "columns": list(self.columns),
            "flagged": [self.columns[at] for at in self.flagged],
            "estimate": self.estimate.tolist(),
            "largest_estimate": self.largest_estimate.tolist(),
            "bound": self.bound.tolist(),
            "largest_bound": self.largest_bound.tolist(),
            "estimate_added": self.added,
        }


def measure_truncation(
    values: npt.NDArray[np.floating[Any]],
    bank: FilterBank,
    eigenvalues: FloatArray,
    density: FloatArray,
    mass: FloatArray,
    *,
    precision: npt.DTypeLike = np.float64,
    drop_first: bool = False,
    known_to: float | None = None,
) -> Truncation | None:
    """Compute the truncation error of values, shape (n, f); None if the filters have no `tail`.

    `eigenvalues`, shape (k,), are the lowest of the mesh, complete up to `known_to` (None: up to
    the largest). `density`, shape (n,), is ``Σ_k φ_k(v)²`` over their eigenvectors, whose type is
    `precision`. `mass` is the diagonal of M. With `drop_first`, the omitted first pair is not
    part of the error.
    """
    tail = bank.tail
    if tail is None:
        return None
    used = mass > 0.0
    n_left = int(used.sum()) - len(eigenvalues)
    left = np.full(len(mass), np.nan)
    if n_left > 0:
        # The remainder is at least the rounding error; it is zero if all pairs are included.
        rounding = _ROUNDINGS * float(np.finfo(precision).eps)
        left[used] = np.maximum(1.0 / mass[used] - density[used], rounding / mass[used])
    else:
        left[used] = 0.0
    last = float(eigenvalues[-1]) * (1.0 - _COPIES)
    start = last if known_to is None else max(last, known_to)
    totals = bank.totals(bank.response(eigenvalues[1:] if drop_first else eigenvalues))
    area = float(mass[used].sum())
    remainder = Remainder(left, start, max(n_left, 0), area, tail, totals, bank.normalised)

    rest = left[used]
    typical = np.array([np.median(np.abs(column[used])) for column in values.T])
    if bank.normalised:
        errors = (remainder.estimate(values)[used], remainder.bound(values)[used])
        medians, largest = ([f(e, axis=0) for e in errors] for f in (np.median, np.max))
    else:
        # Errors increase with the remainder: compute them at its median and maximum.
        extremes = replace(remainder, left=np.array([np.median(rest), rest.max()]))
        none = np.zeros((2, 0))
        both = (extremes.estimate(none), extremes.bound(none))
        medians, largest = ([error[at] for error in both] for at in (0, 1))
    whole = typical + medians[0]
    shares = [
        np.divide(error, whole, out=(error > 0.0).astype(np.float64), where=whole > 0.0)
        for error in (medians[0], largest[0], medians[1], largest[1])
    ]
    estimate, largest_estimate, bound, largest_bound = shares
    # A column without pairs in its filter is missing entirely, unless its bound is zero.
    estimate[(typical == 0.0) & (bound > 0.0)] = 1.0
    return Truncation(
        bank.columns,
        estimate,
        largest_estimate,
        bound,
        largest_bound,
        known_to=start,
        n_left=remainder.n_left,
        added=False,
        remainder=remainder,
    )


def mean_shares(
    bank: FilterBank,
    eigenvalues: FloatArray,
    area: float,
    n_vertices: int,
    known_to: float | None = None,
) -> FloatArray:
    """Estimate the missing share of each column from the lowest k eigenvalues alone, shape (f,).

    The mean of ``φ_k²`` over the surface is one over its area, so the mean of a column and its
    estimated remainder need no eigenvectors. For normalised filters, the result is the missing
    share of the sum of each filter. For `known_to` see `measure_truncation`.
    """
    tail = bank.tail
    n_left = n_vertices - len(eigenvalues)
    if tail is None or n_left <= 0:
        return np.zeros(bank.n_filters)
    start = max(float(eigenvalues[-1]) * (1.0 - _COPIES), known_to or 0.0)
    end = start + weyl_eigenvalue(area, n_left)
    missing = weyl_count(area, 1.0) * tail.integral(start, np.array([end]))[0]
    whole = np.abs(bank.response(eigenvalues)).sum(axis=1) + missing
    shares: FloatArray = np.divide(missing, whole, out=np.zeros(len(whole)), where=whole > 0.0)
    return shares


def sufficient_target(time: float, area: float, n_vertices: int) -> Target:
    """Return the part of the spectrum required for HKS at `time` and longer times.

    It ends at `required_eigenvalue`, or contains all pairs if Weyl's law predicts as many or more.
    `time` and `area` are in squared unit of the mesh.
    """
    eigenvalue = required_eigenvalue(time)
    if weyl_count(area, eigenvalue) >= n_vertices:
        return Target("count", n_vertices)
    return Target("max_eigenvalue", eigenvalue)


def asked_target(target: Target, area: float, n_vertices: int) -> Target:
    """Return a target as the largest eigenvalue, or as a count of at most `n_vertices` pairs."""
    if target.kind == "time":
        target = sufficient_target(target.value, area, n_vertices)
    if target.max_eigenvalue is not None:
        return Target("max_eigenvalue", target.max_eigenvalue)
    return Target("count", min(target.value, max(n_vertices, 1)))


def missing_sentence(columns: tuple[str, ...], shares: FloatArray, *, added: bool = False) -> str:
    """Return a sentence on columns with errors above `TOLERANCE`; see `Truncation.sentence`."""
    count, worst = int((shares > TOLERANCE).sum()), int(shares.argmax())
    if not count:
        return ""
    several = "are by more than 1 % an estimate" if added else "miss more than 1 %"
    single = "is by more than 1 % an estimate" if added else "misses more than 1 %"
    return (
        f"{count} of {len(columns)} columns {single if count == 1 else several} for want of "
        f"eigenpairs, {columns[worst]} about {percent(float(shares[worst]))}"
    )


def percent(share: float) -> str:
    """Format a share with two significant digits: "95 %", "1.4 %"."""
    return format_share(share, 2) if share < 0.995 else format_share(share, 3)


def check_tail(tail: str | None, kind: str) -> None:
    """Raise `InputError` for an unknown `tail`, or a `tail` for features other than HKS."""
    if tail not in (None, "weyl"):
        raise unknown("tail", tail, ('"weyl"', None))
    if tail is not None and kind != "hks":
        fault = f'tail="weyl" is for heat kernel signatures, not for {kind}'
        raise InputError("conflicting-arguments", fault)


def warn_of_truncation(
    truncation: Truncation | None, stacklevel: int = 3, *, name: str = "", limit: str = ""
) -> None:
    """Issue a warning if columns are flagged.

    `name` is the name of the mesh, and `limit` the sentence `Eigenpairs.exhausted`.
    """
    if truncation is not None and (sentence := truncation.sentence()):
        remedy = (
            f". {limit}" if limit else ": go further up the spectrum, or see Features.truncation."
        )
        warnings.warn(
            f"{of_mesh(name)}{sentence}{remedy}", TruncationWarning, stacklevel=stacklevel
        )


def warn_of_open_end(
    coefficients: FloatArray, eigenvalues: FloatArray, stacklevel: int = 3, *, name: str = ""
) -> None:
    """Warn of filters, shape (f, k), that are not small at the last computed eigenvalue."""
    if not len(eigenvalues):
        return
    largest, last = np.abs(coefficients).max(axis=1), np.abs(coefficients[:, -1])
    shares = np.divide(last, largest, out=np.zeros(len(last)), where=largest > 0.0)
    count = int((shares > TOLERANCE).sum())
    if count:
        filters = "1 filter is" if count == 1 else f"{count} filters are"
        if len(shares) > count:
            filters = f"{count} of {len(shares)} filters {'is' if count == 1 else 'are'}"
        warnings.warn(
            f"{of_mesh(name)}{filters} not small at the last eigenvalue, {eigenvalues[-1]:.4g}, "
            f"but up to {percent(float(shares.max()))} of the largest value: what "
            "lies beyond is missing, how much is not known; compute more of the spectrum.",
            TruncationWarning,
            stacklevel=stacklevel,
        )

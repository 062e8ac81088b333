"""Certificates: evidence that eigenpairs are accurate and that none is missing.

`verify_pairs` recomputes a certificate independently of the solver: residuals and inner products
with SciPy's products, and counts from another factorization (SuperLU, in another order) or the
dense matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError
from meshmash_viewer.units import counted, format_number, format_quantity, format_range

#: How eigenvalues were counted: by the signs of a factorization (Sylvester's law of inertia), from
#: the dense matrix, as one zero for each connected component, or not at all.
Method = Literal["inertia", "dense", "null space", "none"]

#: Largest residual and orthonormality defect of proven pairs.
_TOLERANCES = {"float64": (1e-6, 1e-8), "float32": (1e-3, 1e-4)}
#: Relative gap above which neighbouring eigenvalues are not copies of one eigenvalue.
_COPIES = 1e-6


@dataclass(frozen=True, slots=True)
class Certificate:
    """Counts and errors of eigenpairs, and the verdict that they imply."""

    #: Method by which eigenvalues were counted, independently of the iteration.
    method: Method
    #: Number of eigenvalues of the matrix up to `bound` (from `low`).
    counted: int = 0
    #: Number of these eigenvalues that were found; the pairs of a decomposition are the lowest of
    #: them, or the nearest to a shift.
    found: int = 0
    #: Upper end of the counted interval; None if it is unbounded.
    bound: float | None = None
    #: Lower end of the counted interval, for pairs around a shift; None for the lowest pairs.
    low: float | None = None
    #: The worst ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``; for zeros, relative to 4π / area.
    residual: float = 0.0
    #: Index of the pair with that residual.
    residual_index: int = 0
    #: Largest entry of ``|ΦᵀMΦ - I|``.
    orthonormality: float = 0.0
    #: Type of the eigenvectors, which sets the tolerances of `residual` and `orthonormality`.
    precision: Literal["float64", "float32"] = "float64"
    #: Further information, such as that the threshold is an eigenvalue; without a full stop.
    remark: str = ""

    @property
    def lacks(self) -> tuple[str, ...]:
        """Reasons why the pairs are not proven; empty if they are."""
        residual, orthonormality = _TOLERANCES[self.precision]
        lacks = []
        if self.method == "none":
            lacks.append("no count")
        elif self.found != self.counted:
            lacks.append(f"{self.found} found of {self.counted} counted")
        # `not` makes NaN fail too.
        if not self.residual <= residual:
            lacks.append(
                f"a residual of {_short(self.residual)} (pair {self.residual_index}) above "
                f"{_short(residual)}"
            )
        if not self.orthonormality <= orthonormality:
            lacks.append(
                f"an orthonormality of {_short(self.orthonormality)} above {_short(orthonormality)}"
            )
        return tuple(lacks)

    @property
    def complete(self) -> bool:
        """Whether as many pairs were found as counted, with errors within tolerance."""
        return not self.lacks

    def of_first(self, count: int, values: FloatArray, residuals: FloatArray) -> Certificate:
        """Return the certificate of the lowest `count` of all pairs, which have `values`.

        If none is missing, the pairs below a gap are as many as the eigenvalues below it. The
        orthonormality remains that of all pairs, an upper bound.
        """
        worst = int(np.argmax(residuals[:count])) if len(residuals[:count]) else 0
        first = replace(self, residual=float(residuals[:count].max(initial=0.0)))
        first = replace(first, residual_index=worst)
        gaps = np.diff(values)[max(count - 1, 0) :]
        wide = np.flatnonzero(gaps > _COPIES * np.abs(values[max(count, 1) :]))
        if self.method != "inertia" or self.low is not None or not self.complete or not len(wide):
            return first
        last = max(count, 1) + int(wide[0])
        bound = 0.5 * float(values[last - 1] + values[last])
        return replace(first, counted=last, found=last, bound=bound)

    def count_sentence(self, unit: str = "") -> str:
        """Describe how many eigenvalues were counted and how; lengths are in `unit`."""
        if self.method == "none":
            return "no count"
        if self.method == "dense":
            return f"all {counted(self.counted, 'eigenvalue')} computed"
        if self.method == "null space":
            return "one zero for each connected component"
        assert self.bound is not None  # a count by inertia has an upper end
        found = counted(self.counted, "eigenvalue")
        if self.low is not None:
            between = format_range(self.low, self.bound, unit, -2, word="to", digits=4)
            return f"{found} counted from {between}"
        return f"{found} counted below {format_quantity(self.bound, unit, -2, 4)}"

    def sentence(self, n_pairs: int, unit: str = "") -> str:
        """Describe in one line the number of pairs, their count and errors; lengths are in `unit`.

        "200 pairs · complete (201 eigenvalues counted below 11.35 µm⁻²) · worst residual 3×10⁻¹⁰
        · orthonormality 3×10⁻¹³".
        """
        state = "complete" if self.complete else f"not proven complete: {', '.join(self.lacks)}"
        errors: tuple[str, ...] = ()
        if self.method != "none":
            state += f" ({self.count_sentence(unit)})"
            residual, orthonormality = map(_short, (self.residual, self.orthonormality))
            errors = f"worst residual {residual}", f"orthonormality {orthonormality}"
        return " · ".join(filter(None, (counted(n_pairs, "pair"), state, *errors, self.remark)))


def _short(error: float) -> str:
    return format_number(error, 1)


#: Eigenvectors in rows, shape (k, n), NaN at vertices without mass.
Rows = npt.NDArray[np.floating[Any]]

#: Up to this many vertices eigenvalues are counted with the dense matrix.
_DENSE = 1500
#: Rows processed at a time.
_ROWS = 64
#: Smallest gap, relative to the larger of 4π / area and the eigenvalue, for a reliable count.
_GAP = 1e-7
#: Number of pairs at the upper end among which a gap is searched.
_TAIL = 64


def verify_pairs(
    values: FloatArray, rows: Rows, given: Certificate, stiffness: Any, mass: Any
) -> Certificate:
    """Recompute a certificate; see `Eigenpairs.verify`."""
    import scipy.sparse as sp

    n = rows.shape[1]
    matrix: Any = sp.csr_array(stiffness).astype(np.float64)
    given_mass: Any = mass
    sparse = sp.issparse(mass) or np.ndim(mass) == 2
    diagonal = np.asarray(given_mass.diagonal() if sparse else given_mass, dtype=np.float64)
    if matrix.shape != (n, n) or diagonal.shape != (n,):
        fault = f"Matrices of shapes {matrix.shape} and {np.shape(mass)} do not fit {n:,} vertices"
        raise InputError("other-mesh", fault, "give the matrices that were decomposed")
    used = np.flatnonzero(diagonal > 0.0)
    matrix, diagonal = sp.csr_array(matrix[used][:, used]), diagonal[used]
    # A power of two, as in the solver, so that both treat the same eigenvalues as zero.
    spacing = float(np.exp2(np.round(np.log2(4.0 * np.pi / float(diagonal.sum())))))
    defects = _residuals(values, rows, matrix, diagonal, used)
    residuals = defects / np.where(values > 1e-9 * spacing, values, spacing)
    worst = int(np.argmax(residuals)) if len(residuals) else 0
    single = rows.dtype == np.float32
    counted, found, bound, low = _count(values, defects, given, matrix, diagonal, spacing)
    return Certificate(
        "dense" if bound is None else "inertia",
        counted,
        found,
        bound,
        low,
        residual=float(residuals[worst]) if len(residuals) else 0.0,
        residual_index=worst,
        orthonormality=_orthonormality(rows, diagonal, used),
        precision="float32" if single else "float64",
        remark=given.remark,
    )


def _residuals(
    values: FloatArray, rows: Rows, matrix: Any, diagonal: FloatArray, used: npt.NDArray[np.intp]
) -> FloatArray:
    """Compute ‖Lφ - λMφ‖ / ‖Mφ‖ of every pair, in extended precision if the platform has it.

    For float32 rows the error due to their rounding is subtracted.
    """
    exact = matrix.astype(np.longdouble)
    residuals = np.empty(len(values))
    for part in blocks(len(values), _ROWS):
        some = np.asarray(rows[part][:, used], dtype=np.longdouble)
        weighted = some * diagonal
        defect = (exact @ some.T).T - values[part, None] * weighted
        norms = _norms(defect)
        if rows.dtype == np.float32:
            rounded = (abs(exact) @ np.abs(some).T).T
            explained = np.finfo(np.float32).eps * _norms(rounded)
            norms = np.maximum(norms - explained, 0.0)
        residuals[part] = norms / _norms(weighted)
    return residuals


def _norms(rows: npt.NDArray[np.longdouble]) -> npt.NDArray[np.longdouble]:
    """Compute norms of rows, scaled so that squares neither underflow nor overflow."""
    largest = np.abs(rows).max(axis=1)
    largest[largest == 0.0] = 1.0
    scaled = np.asarray(rows / largest[:, None], dtype=np.float64)
    return np.asarray(np.linalg.norm(scaled, axis=1) * largest)


def _orthonormality(rows: Rows, diagonal: FloatArray, used: npt.NDArray[np.intp]) -> float:
    k, worst = len(rows), 0.0
    for part in blocks(k, _ROWS):
        weighted = np.asarray(rows[part][:, used], dtype=np.float64) * diagonal
        for other in blocks(part.stop, _ROWS):
            gram = weighted @ np.asarray(rows[other][:, used], dtype=np.float64).T
            if other == part:
                gram -= np.eye(len(gram))
            worst = max(worst, float(np.abs(gram).max()))
    return worst


def _count(
    values: FloatArray,
    defects: FloatArray,
    given: Certificate,
    matrix: Any,
    diagonal: FloatArray,
    spacing: float,
) -> tuple[int, int, float | None, float | None]:
    """Return the numbers of eigenvalues counted and found, and upper and lower end of the count."""
    if len(values) == len(diagonal):
        return len(diagonal), len(values), None, None
    # The error of an eigenvalue is at most its residual.
    gap = np.maximum(_GAP * np.maximum(np.abs(values), spacing), defects)
    wide = np.flatnonzero(np.diff(values) > 2.0 * np.maximum(gap[1:], gap[:-1]))
    norm = float((abs(matrix).sum(axis=1) / diagonal).max(initial=0.0))
    noise = 64.0 * np.finfo(np.float64).eps * norm
    low, first = None, 0
    if given.low is not None:
        if not len(wide):
            # All pairs have one multiple eigenvalue; some copies may not have been requested.
            ends = float(values[0] - gap[0]), float(values[-1] + gap[-1])
            below, upto = (_below(matrix, diagonal, end, spacing) for end in ends)
            copies = upto - below
            return copies, copies if copies >= len(values) else len(values), ends[1], ends[0]
        first = int(wide[0]) + 1
        low = 0.5 * float(values[first - 1] + values[first])
    elif len(wide) and given.found > len(values):
        # More pairs were found than kept: pairs equal to the lowest kept one, such as zeros, may
        # have been left out.
        above = int(wide[0]) + 1
        edge = 0.5 * float(values[above - 1] + values[above])
        left_out = _below(matrix, diagonal, edge, spacing) - above
        if 0 < left_out <= given.found - len(values):
            low, first = edge, above
    # The bound of the given certificate if all pairs below it are given, else the highest gap
    # between the given pairs.
    last, bound = len(values), given.bound
    if bound is None or given.found != len(values):
        within = wide[wide >= max(len(values) - _TAIL, first)]
        if not len(within):
            within = wide[-1:]
        if not len(within):
            # Below all pairs, by more than the rounding of zeros.
            bound, last = float(values[0] - max(gap[0], noise)) if len(values) else -noise, 0
        else:
            last = int(within[-1]) + 1
            bound = 0.5 * float(values[last - 1] + values[last])
    elif not len(values) and bound <= noise:
        bound = -noise
    below = 0 if low is None else _below(matrix, diagonal, low, spacing)
    return _below(matrix, diagonal, bound, spacing) - below, last - first, bound, low


def _below(matrix: Any, diagonal: FloatArray, bound: float, spacing: float) -> int:
    """Count eigenvalues below a bound by Sylvester's law of inertia."""
    import scipy.sparse as sp
    from scipy.linalg import eigvalsh
    from scipy.sparse.linalg import splu

    if len(diagonal) <= _DENSE:
        root = np.sqrt(diagonal)
        reduced = matrix.toarray() / root[:, None] / root
        rounding = np.finfo(np.float64).eps * np.abs(reduced).sum(axis=0).max()
        if rounding < 1e-2 * _GAP * max(abs(bound), spacing):
            return int(np.count_nonzero(eigvalsh(reduced) < bound))
    for move in (0.0, 1e-9, -1e-9, 1e-8, -1e-8):
        shift = bound + move * max(abs(bound), spacing)
        shifted = sp.csc_array(matrix - sp.diags_array(shift * diagonal))
        try:
            factor = splu(
                shifted,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # an exactly zero pivot
            continue
        if np.array_equal(factor.perm_r, factor.perm_c):
            return int(np.count_nonzero(factor.U.diagonal() < 0.0))
    raise InputError("not-provable", f"The eigenvalues below {bound:.6g} cannot be counted again")

"""Reference eigenvalues of a small pencil L φ = λ M φ, with their uncertainty.

Connected components are solved separately, equal components once: by dense `eigh`, and in twice the
precision if its rounding, relative to the largest eigenvalue, is too large for the small ones.

Each eigenvalue comes with the rounding of the problem: the change of λ when the last digits of L
and M change. To first order the change is ``eps · |φ|ᵀ |L| |φ|``, far less than ``eps · ‖L‖`` if φ
is small at stiff edges and small triangles. No float64 computation can be more accurate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import fsum
from typing import Any

import double_double
import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

__all__ = ["EPS", "FINE", "ROUNDING", "Scaled", "Spectrum", "scale_pencil", "spectrum_of"]

FloatArray = npt.NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)
#: Tolerated rounding in units of the last digit. The sum of a dozen entries of a row decides
#: whether an eigenvalue is zero.
ROUNDING = 128.0
#: Negligible relative error of a reference value.
FINE = 1e-11
#: Maximum vertices of a solve in twice the precision, and of a solve with eigenvectors.
_PRECISE_VERTICES, _VECTOR_VERTICES = 260, 700
#: Vertices whose ratio L[i, i] / M[i, i] exceeds the median this many times are condensed.
_MASSLESS = 1e100
#: Absolute power of two above which a pencil is scaled before the computation.
_EXTREME = 200


@dataclass(frozen=True, eq=False)
class Scaled:
    """Pencil of the vertices with mass, with extreme entries scaled to near 1.

    ``λ = ldexp(scaled λ, exponent)`` is exact unless λ exceeds the range of float64.

    Parameters
    ----------
    stiffness : csr_array, shape (n, n)
        Symmetric, without stored zeros.
    mass : ndarray, shape (n,)
    exponent : int
    mass_exponent : int
        Even: ``M = ldexp(mass, mass_exponent)``.
    active : ndarray of int, shape (n,)
        Vertices with mass.
    labels : ndarray of int, shape (n,)
        Connected component of each active vertex.
    """

    stiffness: Any
    mass: FloatArray
    exponent: int
    mass_exponent: int
    active: npt.NDArray[np.int64]
    labels: npt.NDArray[np.int64]

    @property
    def n(self) -> int:
        """Number of vertices with mass."""
        return len(self.active)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """All eigenvalues, ascending, in the unit of the problem.

    Parameters
    ----------
    values : ndarray, shape (n,)
    low, high : ndarray, shape (n,)
        Bounds of the i-th eigenvalue, including the rounding of the problem.
    copies : ndarray of float, shape (n,)
        Distance within which another eigenvalue counts as a copy.
    doubt : float
        Largest uncertainty of the reference, relative to the larger of λ and its rounding.
    """

    values: FloatArray
    low: FloatArray
    high: FloatArray
    copies: FloatArray
    doubt: float

    @property
    def n(self) -> int:
        """Number of eigenvalues."""
        return len(self.values)


def scale_pencil(stiffness: Any, mass: Any) -> Scaled:
    """Scale L, shape (n, n), and the diagonal M, a matrix or vector."""
    matrix: Any = sp.csr_array(sp.coo_array(stiffness).astype(np.float64))
    matrix.sum_duplicates()
    diagonal = np.asarray(mass.diagonal() if sp.issparse(mass) else mass, dtype=np.float64)
    if diagonal.ndim == 2:
        diagonal = np.diagonal(diagonal)
    active = np.flatnonzero(diagonal > 0.0)
    matrix = sp.csr_array(matrix[active][:, active])
    matrix.eliminate_zeros()
    up = _exponent(matrix.data)
    mass_up = _exponent(diagonal[active])
    mass_up += mass_up % 2
    matrix.data = np.ldexp(matrix.data, -up)
    matrix = sp.csr_array(0.5 * (matrix + matrix.T))
    labels = connected_components(matrix, directed=False)[1].astype(np.int64)
    scaled = np.ldexp(diagonal[active], -mass_up)
    return Scaled(matrix, scaled, up - mass_up, mass_up, active, labels)


def _exponent(values: FloatArray) -> int:
    """Return the power of two of the largest absolute value if it is extreme, else 0."""
    power = int(np.frexp(float(np.abs(values).max(initial=0.0)) or 1.0)[1])
    return power if abs(power) > _EXTREME else 0


def spectrum_of(pencil: Scaled) -> Spectrum:
    """Compute all eigenvalues with their uncertainty."""
    parts = []
    order = np.argsort(pencil.labels, kind="stable")
    bounds = np.flatnonzero(np.diff(pencil.labels[order], prepend=-1, append=-1))
    sorted_matrix: Any = sp.csr_array(pencil.stiffness[order][:, order])
    for start, stop in pairwise(bounds):
        block = sorted_matrix[start:stop, start:stop].toarray()
        masses = pencil.mass[order[start:stop]]
        parts.append(_component(block.tobytes(), masses.tobytes()))
    values, slack, doubt = (np.concatenate([part[i] for part in parts]) for i in range(3))
    with np.errstate(over="ignore"):
        values, slack, doubt = (np.ldexp(x, pencil.exponent) for x in (values, slack, doubt))
    order = np.argsort(values, kind="stable")
    whole = np.where(np.isfinite(values), slack + doubt, 0.0)
    relative = np.where(np.isfinite(values), doubt, 0.0)
    relative /= np.maximum(np.maximum(np.abs(values), slack), 1e-300)
    return Spectrum(
        values[order],
        np.sort(values - whole),
        np.sort(values + whole),
        slack[order],
        float(relative.max(initial=0.0)),
    )


@lru_cache(maxsize=64)
def _component(entries: bytes, masses: bytes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return eigenvalues of a dense component, their rounding and their uncertainty."""
    mass = np.frombuffer(masses)
    n = len(mass)
    stiffness = np.frombuffer(entries).reshape(n, n)
    with np.errstate(over="ignore"):
        ratio = np.abs(np.diagonal(stiffness)) / mass
    usual = np.median(ratio[np.isfinite(ratio)]) if np.isfinite(ratio).any() else 0.0
    light = ratio > _MASSLESS * max(float(usual), 1e-300)
    if light.any() and not light.all():
        return _with_light_vertices(stiffness, mass, light)
    root = np.sqrt(mass)
    matrix = stiffness / root[:, None] / root
    if n > _VECTOR_VERTICES:
        values = scipy.linalg.eigvalsh(matrix)
        norm = float(np.abs(values).max(initial=0.0))
        slack, doubt = (
            np.full(n, ROUNDING * EPS * norm),
            np.full(n, max(8.0, np.sqrt(n)) * EPS * norm),
        )
        lowest = _of_constants(stiffness, mass, float(values[1]), float(doubt[0]))
        if lowest is not None:
            values[0], doubt[0] = lowest
            slack[0] = ROUNDING * EPS * float(np.abs(stiffness).sum() / mass.sum())
        return values, slack, doubt
    # LAPACK's default driver sometimes fails for multiple eigenvalues.
    values, vectors = scipy.linalg.eigh(matrix, driver="evd")
    norm = float(np.abs(values).max(initial=0.0))
    sizes = np.abs(vectors)
    energy = np.einsum("ij,ij->j", sizes, np.abs(matrix) @ sizes)
    noise = max(8.0, np.sqrt(n)) * EPS * norm
    # Eigenvalues inseparable by dense `eigh` share the largest rounding.
    first = np.searchsorted(values, values - noise)
    last = np.searchsorted(values, values + noise, side="right")
    slack = np.array([energy[a:b].max() for a, b in zip(first, last, strict=True)])
    slack = ROUNDING * EPS * slack
    doubt = np.full(n, noise)
    lowest = _of_constants(stiffness, mass, float(values[1]) if n > 1 else np.inf, noise)
    if lowest is not None:
        values[0], doubt[0] = lowest
    small = np.maximum(FINE * np.abs(values), 0.1 * slack)
    if (doubt <= 10.0 * small).all() or n > _PRECISE_VERTICES:
        return values, slack, doubt
    exact = double_double.reduced_matrix(stiffness, mass)
    values, error = double_double.eigenvalues(exact, np.sort(values), 4.0 * noise, small)
    return values, slack, np.full(n, error)


def _of_constants(
    stiffness: FloatArray, mass: FloatArray, second: float, noise: float
) -> tuple[float, float] | None:
    """Return the eigenvalue of constants, with its uncertainty, if it is the lowest, else None.

    The error of a Rayleigh quotient is at most its squared residual over the gap.
    """
    sums = np.array([fsum(row) for row in stiffness])
    area = fsum(mass)
    value = fsum(sums) / area
    residual = float(np.linalg.norm((sums - value * mass) / np.sqrt(mass))) / np.sqrt(area)
    gap = second - value - noise
    if gap <= 4.0 * max(noise, residual):
        return None
    return value, residual**2 / gap


def _with_light_vertices(
    stiffness: FloatArray, mass: FloatArray, light: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solve a component with its light vertices condensed; their eigenvalues are far above."""
    heavy = ~light
    inner = stiffness[np.ix_(light, light)]
    across = stiffness[np.ix_(light, heavy)]
    condensed = stiffness[np.ix_(heavy, heavy)] - across.T @ np.linalg.solve(inner, across)
    condensed = 0.5 * (condensed + condensed.T)
    low = _component(condensed.tobytes(), mass[heavy].tobytes())
    top = np.minimum(mass[light], 1.0)
    with np.errstate(over="ignore"):
        own = np.minimum(np.diagonal(inner) / top, 1e300)
    # The coupling of light vertices is ignored: no request reaches their eigenvalues.
    return (
        np.concatenate([low[0], own]),
        np.concatenate([low[1] * 4.0, own]),
        np.concatenate([low[2], np.zeros(len(own))]),
    )

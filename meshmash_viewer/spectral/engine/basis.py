"""Block Krylov basis of the deflated inverse of a shifted matrix, and its Ritz pairs.

Rounding makes the basis lose orthogonality along the Ritz vectors nearest the shift, which the
inverse magnifies most: each solve adds a share of about 1e-10 of them. So these few vectors are
projected out of every new block (selective orthogonalisation, Parlett & Scott 1979). The remaining
loss is so slow that the whole basis has to be orthogonalised only every few steps, when inner
products with random sums of its rows exceed a limit (partial reorthogonalisation, Simon 1984).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.factorization import Factor, OrderedPencil

#: Columns processed at a time, few enough to stay in the cache.
_CHUNK = 4096
#: Largest deviation of the Gram matrix of orthonormal rows from the identity.
_NORMAL = 1e-13
#: Smallest share of the norm of an independent row that is orthogonal to the rows before it.
_INDEPENDENT = 0.3


def multiply_in_place(weights: FloatArray, rows: FloatArray, result: FloatArray) -> None:
    """Write weights · rows into `result`, shape (m, n), which may be the start of `rows`."""
    for part in blocks(rows.shape[1], _CHUNK):
        result[:, part] = weights @ rows[:, part]


def subtract(
    target: FloatArray,
    sources: Sequence[tuple[FloatArray, FloatArray]],
    against: Sequence[FloatArray],
) -> list[FloatArray]:
    """Subtract weights · rows of each source from a target; return target · rowsᵀ for `against`.

    `target`, shape (b, n), is changed in place and read from memory only once.
    """
    products = [np.zeros((len(target), len(rows))) for rows in against]
    for part in blocks(target.shape[1], _CHUNK):
        own = target[:, part]
        for weights, rows in sources:
            own -= weights @ rows[:, part]
        for product, rows in zip(products, against, strict=True):
            product += own @ rows[:, part].T
    return products


def project_out(target: FloatArray, against: FloatArray) -> FloatArray:
    """Project orthonormal rows (m, n) out of the rows of `target` (b, n), in place.

    The inner products before the projection are returned, shape (b, m).
    """
    overlap = np.asarray(target @ against.T)
    subtract(target, [(overlap, against)], [])
    return overlap


def orthonormalise(rows: FloatArray) -> float:
    """Make nearly orthonormal rows (p, n) orthonormal, in place, by Cholesky's QR.

    The largest remaining defect of the inner products is returned. `ArithmeticError` is raised if
    the rows are far from independent.
    """
    for _ in range(3):
        gram = rows @ rows.T
        defect = float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))
        if defect < _NORMAL:
            break
        inverse: FloatArray = np.asarray(np.linalg.inv(_independent_factor(gram)))
        multiply_in_place(inverse, rows, rows)
    return defect


def independent_gram(rows: FloatArray) -> FloatArray:
    """Compute the Gram matrix of rows (p, n).

    `ArithmeticError` is raised if the rows are far from independent.
    """
    gram: FloatArray = np.asarray(rows @ rows.T)
    _independent_factor(gram)
    return gram


def _independent_factor(gram: FloatArray) -> FloatArray:
    """Compute the Cholesky factor of a Gram matrix; raise if rows are far from independent."""
    try:
        lower: FloatArray = np.asarray(np.linalg.cholesky(gram))
    except np.linalg.LinAlgError:
        lower = np.zeros((1, 1))
    if not np.diagonal(lower).min() > _INDEPENDENT:
        raise ArithmeticError("the same eigenvector was found twice")
    return lower


def orthonormalise_block(
    block: FloatArray, gram: FloatArray | None = None
) -> tuple[FloatArray, bool]:
    """Orthonormalise rows (8, n) by Cholesky QR, up to twice, in place.

    Returns the factor with old block = lower · new block, and whether the block has full rank.
    `gram` is block · blockᵀ, if known.
    """
    total = np.eye(len(block))
    if gram is None:
        gram = block @ block.T
    for _ in range(2):
        try:
            lower = np.asarray(np.linalg.cholesky(gram))
        except np.linalg.LinAlgError:
            return total, False
        if not np.diagonal(lower).min() ** 2 > 1e-13 * np.trace(gram):
            return total, False
        multiply_in_place(np.linalg.inv(lower), block, block)
        total = total @ lower
        gram = block @ block.T
        if np.abs(gram - np.eye(len(gram))).max() < _NORMAL:
            break
    return total, True


#: Number of vectors in a block.
BLOCK = 8
#: Maximum number of Ritz vectors nearest the shift that are projected out of every new block.
_NEAREST = 24
#: Smallest size of the basis at which these Ritz vectors are computed.
_FIRST_LOOK = 5 * BLOCK
#: Largest allowed inner product between blocks; its square is the error of the projection T.
_SEMIORTHOGONAL = 1e-7
#: Number of random sums of all rows and known vectors, with which orthogonality is monitored.
_MIXTURES = 4


class RitzPairs:
    """Ritz pairs of the inverse from a basis of m rows.

    `mu`, shape (m,), are the Ritz values of the inverse, ascending; the columns of `weights` are
    the coordinates of the Ritz vectors; `errors` are the norms of the residuals.
    """

    def __init__(self, projection: FloatArray, coupling: FloatArray) -> None:
        mu, self.weights = np.linalg.eigh(projection, UPLO="L")
        self.errors = np.linalg.norm(coupling.T @ self.weights[-BLOCK:], axis=0)
        self.mu = np.where(np.abs(mu) < 1e-100, 1e-100, mu)
        self.coupling = coupling


def _relative(shared: FloatArray, gram: FloatArray) -> float:
    """Estimate the largest inner product of a block, once orthonormal, with the basis.

    `shared`, shape (8, m), are inner products of the block with random sums of all rows, rarely
    much smaller than the norm of all inner products; `gram`, shape (8, 8), is its Gram matrix.
    """
    try:
        shared = np.linalg.solve(np.linalg.cholesky(gram), shared)
    except np.linalg.LinAlgError:
        return float("inf")
    return float(np.abs(shared).max())


class KrylovBasis:
    """A block Krylov basis, extended block by block from a random start.

    The basis is orthogonal to `found`, orthonormal rows of shape (f, n), and has at most `capacity`
    rows. If `careful`, every block is orthogonalised against the whole basis. All rows are zero on
    `left_out`, a mask of the vertices of some components.
    """

    def __init__(
        self,
        ordered: OrderedPencil,
        factor: Factor,
        found: FloatArray,
        capacity: int,
        seed: tuple[int, ...],
        careful: bool = False,
        left_out: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        self._left_out = left_out
        self._ordered, self._factor, self._found = ordered, factor, found
        self._n = ordered.pencil.n
        self._allowed = 0.0 if careful else _SEMIORTHOGONAL
        self._random = np.random.default_rng(seed)
        self._columns = np.empty((self._n, BLOCK))
        self._nearest = np.zeros((0, self._n))
        self._nearest_at = 0
        self._mixture = self._mix_known()
        self._coupling = np.zeros((BLOCK, BLOCK))
        self.capacity = capacity
        self._projection = np.zeros((capacity + 2 * BLOCK, capacity + 2 * BLOCK))
        self.size = 0
        self.rows = np.empty((capacity + 2 * BLOCK, self._n))
        first = self.rows[:BLOCK]
        # The inverse does not mix components: rows stay zero on left-out components.
        self._apply(self._without(self._random.random((BLOCK, self._n)) - 0.5), first)
        if not orthonormalise_block(first)[1]:
            first[:] = np.linalg.qr(first.T)[0].T

    def _without(self, rows: FloatArray) -> FloatArray:
        if self._left_out is not None:
            rows[:, self._left_out] = 0.0
        return rows

    def _apply(self, block: FloatArray, result: FloatArray) -> None:
        """Apply the deflated inverse to rows of shape (8, n)."""
        if self._ordered.stop[0]:
            raise Cancelled("stopped inside a slice")
        columns = self._columns
        columns[:] = block.T
        self._factor.solve(columns)
        self._ordered.remove_null(columns)
        self._ordered.steps += 1
        self._ordered.fill_rows(columns, result)
        if len(self._found):
            project_out(result, self._found)

    def extend(self) -> None:
        """Perform one Lanczos step: append a block of rows, and a block column of T.

        The projections computed in one pass over the vectors are subtracted in the next pass.
        """
        b, rows, size = BLOCK, self.rows, self.size
        nearest = self._nearest
        this, new = rows[size : size + b], rows[size + b : size + 2 * b]
        before = rows[max(size - b, 0) : size]
        local = rows[max(size - b, 0) : size + b]
        self._apply(this, new)
        diagonal, near = subtract(
            new, [(self._coupling.T, before)] if size else [], [this, nearest]
        )
        (shared,) = subtract(new, [(diagonal, this), (near, nearest)], [local])
        diagonal += shared[:, -b:]
        gram, drift = subtract(new, [(shared, local)], [new, self._mixture])
        if _relative(drift, gram) > self._allowed:
            both = rows[size : size + 2 * b]
            self._project_known_out(both)
            project_out(both, rows[:size])
            orthonormalise_block(this)
            (shared,) = subtract(new, [], [this])
            diagonal += shared
            (gram,) = subtract(new, [(shared, this)], [new])
            few = len(self._nearest) < _NEAREST and size >= _FIRST_LOOK
            if few and size >= self._nearest_at + 2 * b:
                self._find_nearest(size)
        at, after = slice(size, size + b), slice(size + b, size + 2 * b)
        self._projection[at, at] = 0.5 * (diagonal + diagonal.T)
        following, independent = orthonormalise_block(new, gram)
        if not independent:
            following = following @ self._replace_lost(new, size + b)
        self._projection[after, at] = following.T
        self._coupling = following
        signs = self._random.choice([-1.0, 1.0], size=(_MIXTURES, b))
        self._mixture += signs @ this
        self.size = size + b

    def _mix_known(self) -> FloatArray:
        """Return random sums of the null space and of the pairs found before, shape (4, n)."""
        pencil, random = self._ordered.pencil, self._random
        signs = random.choice([-1.0, 1.0], size=(_MIXTURES, pencil.n_null + 1))
        # Vertices outside of null components have direction 0 and label -1.
        mixture = signs[:, pencil.labels] * pencil.null_direction
        signs = random.choice([-1.0, 1.0], size=(_MIXTURES, len(self._found)))
        return np.asarray(mixture + signs @ self._found)

    def _project_known_out(self, new: FloatArray) -> None:
        """Project the null space and the pairs found before out of rows, in place."""
        pencil = self._ordered.pencil
        if pencil.n_null == 1:  # the usual case: one product instead of two transposes
            project_out(new, pencil.null_direction[None])
        else:
            for part in blocks(len(new), BLOCK):
                self._columns[:] = new[part].T
                self._ordered.remove_null(self._columns)
                self._ordered.fill_rows(self._columns, new[part])
        if len(self._found):
            project_out(new, self._found)

    def _find_nearest(self, size: int) -> None:
        """Compute the nearly converged Ritz vectors with the largest Ritz values of the inverse."""
        pairs = RitzPairs(self._projection[:size, :size], self._coupling)
        largest = np.argsort(-np.abs(pairs.mu), kind="stable")[:_NEAREST]
        settled = pairs.errors[largest] < _SEMIORTHOGONAL * np.abs(pairs.mu).max()
        count = _NEAREST if settled.all() else int(np.argmin(settled)) // 4 * 4
        if count > len(self._nearest):
            self._nearest = pairs.weights[:, largest[:count]].T @ self.rows[:size]
        self._nearest_at = size

    def _replace_lost(self, new: FloatArray, size: int) -> FloatArray:
        """Replace linearly dependent directions of a block by random ones, uncoupled from T."""
        from scipy.linalg import qr

        scale = max(float(np.abs(np.diagonal(self._projection)[:size]).max()), 1e-300)
        # Pivoting moves the lost directions to the end, so that no part of other columns is lost.
        directions, triangle, pivots = qr(new.T, mode="economic", pivoting=True)
        following = np.empty((BLOCK, BLOCK))
        following[pivots] = triangle.T
        lost = np.abs(np.diagonal(triangle)) < 1e-10 * scale
        following[:, lost] = 0.0
        new[:] = directions.T
        new[lost] = self._without(self._random.standard_normal((int(lost.sum()), self._n)))
        for _ in range(3):
            self._project_known_out(new)
            project_out(new, self.rows[:size])
            directions, triangle = np.linalg.qr(new.T)
            new[:] = (directions * np.sign(np.diagonal(triangle))).T
        return following

    def ritz(self) -> RitzPairs:
        """Return the Ritz pairs of the present basis."""
        return RitzPairs(self._projection[: self.size, : self.size], self._coupling)

    def vectors(self, pairs: RitzPairs, chosen: npt.NDArray[np.int64]) -> FloatArray:
        """Compute vectors of the chosen pairs, after one more implicit application of the inverse.

        The vectors are nearly orthonormal, shape (p, n). They reuse the memory of the basis, which
        is invalid afterwards; the rest of that memory is freed.
        """
        size = self.size
        weights = np.empty((len(chosen), size + BLOCK))
        weights[:, :size] = pairs.weights[:, chosen].T
        last = pairs.coupling.T @ pairs.weights[size - BLOCK :, chosen]
        weights[:, size:] = last.T / pairs.mu[chosen, None]
        # Rows of the basis are orthonormal, so normalised weights give normalised rows.
        weights /= np.linalg.norm(weights, axis=1)[:, None]
        rows, self.rows = self.rows, np.zeros((0, self._n))
        multiply_in_place(weights, rows[: size + BLOCK], rows[: len(chosen)])
        # No view of `rows` exists any more.
        rows.resize((len(chosen), self._n), refcheck=False)
        return rows

"""Feature columns: a filter bank applied to eigenpairs.

Column f at vertex v is ``F[v, f] = Σ_k coefficients[f, k] φ_k(v)²``. Squares are independent of the
sign of an eigenvector and, summed over a multiple eigenvalue, of the choice of its basis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError, package_missing, wrong_shape
from meshmash_viewer.features.filter_responses import wrong_filter
from meshmash_viewer.features.truncation import (
    Truncation,
    check_tail,
    measure_truncation,
    missing_sentence,
    warn_of_open_end,
    warn_of_truncation,
)
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.alignment import ShownRows
from meshmash_viewer.spectral.cost import check_columns
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike, as_eigenpairs
from meshmash_viewer.units import counted, power_unit
from meshmash_viewer.vertex_map import named_apart

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank
    from meshmash_viewer.mesh import Mesh


#: Multiple of the typical value above which values of small components are reported.
_STRANGE = 1000.0
#: Pairs and vertices whose squares are computed at a time: 4 MB, which fit into the cache.
_ROWS, _VERTICES = 128, 4096
#: Vertices of a slice for a thread: enough that the time to start a slice is negligible.
_PART = 131072
#: Pairs are not read if their coefficients are below this share of the largest.
_NEGLIGIBLE = 1e-13


@dataclass(frozen=True, eq=False)
class Features:
    """Named columns of numbers, with a row for each vertex.

    NumPy, pandas and scikit-learn accept the object as an array of values. Indexing returns values
    by row and column, or a column by its name.

    Parameters
    ----------
    values : ndarray, shape (n, f)
        NaN at unreferenced vertices.
    columns : tuple of str
        Name of each column.
    unit : str
        Unit of the values, such as "nm⁻²"; "" for no or an unknown unit.
    kind : str
        Kind of the features: "hks", "geometry-vectors", ...
    meta : dict
        Parameters of the computation, for JSON.
    truncation : Truncation, optional
        Truncation error, from the pairs that were not computed; None if the filters have no `tail`,
        or for pairs around a shift.

    Examples
    --------
    >>> hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.5, 1.0]), unit="mm")
    >>> hks.columns, hks.unit, hks.values.shape
    (('hks_t=5.00e-01', 'hks_t=1.00e+00'), 'mm⁻²', (642, 2))
    >>> np.log(hks).shape, hks[:10, 0].shape, hks["hks_t=1.00e+00"].shape
    ((642, 2), (10,), (642,))
    """

    values: npt.NDArray[np.floating[Any]]
    columns: tuple[str, ...]
    unit: str = ""
    kind: str = "features"
    meta: dict[str, Any] = field(default_factory=dict)
    truncation: Truncation | None = None

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.columns):
            raise wrong_shape("Features", self.values.shape, f"{len(self.columns)} columns")

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the values, (n, f)."""
        n, f = self.values.shape
        return n, f

    @property
    def ndim(self) -> int:
        """Number of dimensions of the values, 2."""
        return self.values.ndim

    @property
    def dtype(self) -> np.dtype[np.floating[Any]]:
        """Type of the values."""
        return self.values.dtype

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        return iter(self.values)

    def __getitem__(self, index: Any) -> Any:
        """Return values by row and column, as for an array, or a column by its name."""
        if not isinstance(index, str):
            return self.values[index]
        if index not in self.columns:
            raise KeyError(f"{index!r} is not a column; columns are {', '.join(self.columns)}")
        return self.values[:, self.columns.index(index)]

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        return np.array(self.values, dtype=dtype, copy=copy)

    def to_frame(self) -> Any:
        """Make a pandas ``DataFrame`` of the values, with unit and kind in its `attrs`.

        `InputError` is raised if pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError:
            raise package_missing("A DataFrame needs", "pandas") from None
        frame = pandas.DataFrame(self.values.copy(), columns=list(self.columns))
        frame.attrs.update(unit=self.unit, kind=self.kind)
        return frame

    @property
    def missing(self) -> str:
        """Sentence on the truncation error without its full stop; empty if the error is small."""
        if self.truncation is not None:
            return self.truncation.sentence()
        shares = np.asarray(self.meta.get("missing_shares", ()), dtype=np.float64)
        return missing_sentence(self.columns[: len(shares)], shares) if len(shares) else ""

    def truncation_at_vertices(self) -> tuple[FloatArray, FloatArray]:
        """Compute an estimate and an upper bound of the truncation error of every value.

        `InputError` is raised if the truncation error is not known (`truncation` is None).

        Returns
        -------
        estimate, bound : ndarray of float64, shape (n, f)
            Errors in `unit`, not relative; NaN at unreferenced vertices. The bound is for the sum
            without the estimate, even if the estimate was added to it (``tail="weyl"``).
        """
        if self.truncation is None:
            fault = "The truncation error of these filters or pairs is not known"
            raise InputError("no-estimate", fault, "use other filters, and the lowest pairs")
        remainder = self.truncation.remainder
        values = self.values[:, : len(self.truncation.columns)]
        return remainder.estimate(values), remainder.bound(values)

    def on_file(self, mesh: Mesh) -> Features:
        """Return features of all vertices of the file of a repaired mesh, see `Mesh.on_file`."""
        truncation = self.truncation
        if truncation is not None:
            left = mesh.on_file(truncation.remainder.left)
            truncation = replace(truncation, remainder=replace(truncation.remainder, left=left))
        return replace(self, values=mesh.on_file(self.values), truncation=truncation)

    def with_components(self, mesh: Mesh) -> Features:
        """Append a column "component", the connected component of each vertex of `mesh`."""
        return self._with_columns(("component",), mesh.component_labels[:, np.newaxis])

    def with_maps(self, mesh: Mesh) -> Features:
        """Append the maps of `mesh` as columns; labels are numbers.

        ``meta["maps"]`` contains the units of the maps, and the names and colours of labels.
        """
        if not mesh.maps:
            return self
        described = {
            each.name: {
                "unit": each.unit,
                "file": each.path,
                "labels": [[label.key, label.name, label.color] for label in each.labels],
            }
            for each in named_apart(mesh.maps, self.columns)
        }
        values = np.stack([each.values for each in mesh.maps], axis=1)
        found = self._with_columns(tuple(described), values)
        return replace(found, meta={**self.meta, "maps": described})

    def _with_columns(self, names: tuple[str, ...], values: npt.NDArray[Any]) -> Features:
        values = np.concatenate([self.values, values], axis=1, dtype=self.values.dtype)
        return replace(self, values=values, columns=(*self.columns, *names))

    def remarks(self, mesh: Mesh, *, masked: bool = False) -> list[str]:
        """Return sentences on defects of a mesh, or its part in a mask, that affect its features.

        Defects are unreferenced vertices and small components. On a small component, normalised
        eigenfunctions are nearly constant, and thousands of times larger than elsewhere.
        """
        said = []
        if count := len(mesh.unreferenced):
            why = (
                "in no face of the mask."
                if masked
                else "that no face uses: the repair drop_unreferenced_vertices leaves them out."
            )
            said.append(f"rows of NaN stand for {counted(count, 'vertex')} {why}")
        labels = mesh.component_labels
        sizes = np.bincount(labels[labels >= 0])
        on_largest = labels == int(sizes.argmax())
        typical = np.median(np.abs(self.values[on_largest]), axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.where(typical > 0.0, np.abs(self.values) / typical, 0.0).max(axis=1)
        strange = (times > _STRANGE) & ~on_largest & (labels >= 0)
        if strange.any():
            small = np.unique(labels[strange])
            said.append(
                f"values are up to {times[strange].max():,.0f} times those of the largest "
                f"component on {counted(len(small), 'tiny component')} "
                f"({counted(int(sizes[small].sum()), 'vertex')}): merge components "
                "that touch, or the repair keep_largest_component leaves them out."
            )
        return said


def compute_features(
    decomposition: EigenpairsLike,
    bank: FilterBank,
    *,
    unit: str = "",
    drop_first: bool = False,
    dtype: npt.DTypeLike = np.float64,
    tail: Literal["weyl"] | None = None,
    known_to: float | None = None,
    warn: bool = True,
) -> Features:
    """Apply a filter bank to eigenpairs, and estimate the truncation error.

    `InputError` is raised if `tail` is unknown, or if it is given for features other than HKS.

    Parameters
    ----------
    decomposition : Eigenpairs
        The eigenpairs, the lowest or around a shift; `rows` may be a memory map.
    bank : FilterBank
        The filters; called once, with all eigenvalues used.
    unit : str
        Unit of the mesh. The values have its power -2, because the integral of a squared
        eigenvector is 1.
    drop_first : bool
        Whether to leave out only the first pair.
    dtype : dtype
        Type of the values; sums are computed in float64.
    tail : {None, "weyl"}
        "weyl" adds the estimate of the truncation error to a heat kernel signature, see
        `meshmash_viewer.features.truncation`.
    known_to : float, optional
        Eigenvalue up to which the pairs are complete, such as the threshold of the computation;
        None: the bound of the certificate or, without a certificate, the largest eigenvalue.
    warn : bool
        Whether to warn of the truncation error, which is also in `Features.truncation`.

    Returns
    -------
    Features
        Values of shape (n, f), with their truncation error.

    Warns
    -----
    TruncationWarning
        If the estimated truncation error of a column exceeds 1 %, or if a filter without `tail`
        exceeds 1 % of its largest value at the last eigenvalue.

    Examples
    --------
    >>> hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.5, 1.0]))
    >>> hks.values[0].round(3)
    array([0.189, 0.113])
    """
    decomposition = as_eigenpairs("compute_features(pairs, bank)", decomposition)
    check_tail(tail, bank.kind)
    start = 1 if drop_first else 0
    eigenvalues, rows = decomposition.eigenvalues, decomposition.rows
    coefficients = bank(eigenvalues[start:])
    density = np.zeros(rows.shape[1])
    if drop_first:  # the omitted pair is not part of the truncation error
        np.square(rows[0], out=density, dtype=np.float64)
    values = accumulate_features(rows[start:], coefficients, density=density)
    certificate = decomposition.certificate
    if known_to is None and certificate.complete and certificate.counted == len(eigenvalues):
        known_to = certificate.bound
    truncation = None
    if certificate.low is None:  # around a shift, pairs below it are missing too
        truncation = measure_truncation(
            values,
            bank,
            eigenvalues,
            density,
            decomposition.mass,
            precision=rows.dtype,
            drop_first=drop_first,
            known_to=known_to,
        )
    if tail is not None and truncation is not None:
        values += truncation.remainder.estimate(values)
        truncation = replace(truncation, added=True)
    meta = {
        "kind": bank.kind,
        "parameter": bank.parameter_name,
        "parameter_unit": power_unit(unit, bank.parameter_power),
        "parameters": bank.parameters.tolist(),
        "n_eigenpairs": len(eigenvalues) - start,
        "drop_first": drop_first,
        "truncation": None if truncation is None else truncation.as_dict(),
    }
    if warn:
        warn_of_truncation(truncation, limit=decomposition.exhausted)
        some_left = len(eigenvalues) < np.count_nonzero(decomposition.mass)
        if bank.tail is None and certificate.low is None and some_left:
            warn_of_open_end(coefficients, eigenvalues)
    values = values.astype(dtype, copy=False)
    return Features(values, bank.columns, power_unit(unit, -2), bank.kind, meta, truncation)


#: `compute_features` without the warning, for callers that report the truncation error.
truncated_features = partial(compute_features, warn=False)


def accumulate_features(
    rows: npt.NDArray[np.floating[Any]],
    coefficients: npt.ArrayLike,
    density: FloatArray | None = None,
) -> FloatArray:
    """Sum ``coefficients[f, k] rows[k, v]²`` over k, reading each row once: shape (n, f).

    `rows`, shape (k, n), may be a memory map; a few rows are read at a time. ``Σ_k rows[k, v]²`` is
    added to `density`, shape (n,), if given. `InputError` is raised if the shapes do not agree, or
    the sums take more than the free memory.
    """
    weights = np.asarray(coefficients, dtype=np.float64)
    k = len(rows)
    if weights.ndim != 2 or weights.shape[1] != k:
        raise wrong_filter(f"shape {weights.shape} for {k} eigenvalues")
    check_columns(rows.shape[1], len(weights))
    sums = sum_squares(rows, weights, np.float64, order="F", negligible=0.0, density=density)
    return np.asarray(sums, dtype=np.float64).T


def sum_squares(
    rows: npt.NDArray[np.floating[Any]] | ShownRows,
    coefficients: FloatArray,
    dtype: npt.DTypeLike = np.float32,
    cancel: CancelCallback | None = None,
    *,
    order: Literal["C", "F"] = "C",
    negligible: float = _NEGLIGIBLE,
    density: FloatArray | None = None,
) -> npt.NDArray[np.floating[Any]]:
    """Compute ``Σ_k coefficients[f, k] rows[k]²`` in double precision: shape (f, n).

    `rows`, shape (>= k, n), may be a memory map. Without a `density` (see `accumulate_features`),
    rows are read only if a coefficient exceeds the share `negligible` of the largest.
    `Cancelled` is raised after `cancel` returned True.
    """
    total = np.zeros((len(coefficients), rows.shape[1]), dtype, order)
    size = np.abs(coefficients).max(axis=0, initial=0.0)
    read = size > negligible * size.max(initial=0.0)
    used = np.arange(len(size)) if density is not None else np.flatnonzero(read)
    if not len(used) and len(rows):
        total += 0.0 * rows[0]  # keeps NaN

    def add(band: npt.NDArray[np.intp], whole: slice) -> None:
        # contiguous rows are read without a copy
        together = band[-1] - band[0] + 1 == len(band)
        which = slice(int(band[0]), int(band[-1]) + 1) if together else band
        for part in blocks(whole.stop, _VERTICES, whole.start):
            check_cancelled(cancel)
            squares = np.square(rows[which, part], dtype=np.float64)
            total[:, part] += coefficients[:, band] @ squares
            if density is not None:
                density[part] += squares.sum(axis=0)

    for some in blocks(len(used), _ROWS):
        fill_in_parts(rows.shape[1], partial(add, used[some]))
    return total


def fill_in_parts(n_vertices: int, fill: Callable[[slice], object]) -> None:
    """Call a function with slices that cover all vertices, in two threads.

    Two threads use nearly twice the memory bandwidth of one. New threads are started each time:
    Linux wakes a sleeping thread on the core of its caller, so the two would share a core.
    """
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(fill, blocks(n_vertices, _PART)))

"""Parallel calls of a function on the pieces of a mesh, and stitching of their results."""

from __future__ import annotations

import traceback
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import nullcontext
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from threadpoolctl import threadpool_limits

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import ConstantFeaturesWarning, InputError
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.progress import CancelCallback, Cancelled
from meshmash_viewer.spectral.weyl import TOLERANCE
from meshmash_viewer.units import counted


class Stitched:
    """Values of a mesh, combined from its pieces; see `MeshStitcher.stitch_features`.

    `owners` is the piece of each vertex, -1 for none.
    """

    def __init__(
        self, pieces: Sequence[IntArray], owners: IntArray, fill_value: float = np.nan
    ) -> None:
        self._pieces, self._owners, self._fill = pieces, owners, fill_value
        self._known = np.zeros(len(pieces) + 1, dtype=np.bool_)
        self._whole: npt.NDArray[Any] | None = None

    def add(self, number: int, result: Any) -> None:
        """Copy the values of a piece at the vertices assigned to it; None if it has no values."""
        if result is None:
            return
        array, piece, whole = np.asarray(result), self._pieces[number], self._whole
        first = array if whole is None else whole
        _check(array, first, len(piece), f"piece {number + 1} of {len(self._pieces)}")
        if whole is None:
            whole = np.zeros((len(self._owners), *array.shape[1:]), array.dtype)
        own = self._owners[piece] == number
        self._whole = whole = whole.astype(np.result_type(whole, array), copy=False)
        whole[piece[own]] = array[own]
        self._known[number] = True

    def values(self) -> npt.NDArray[Any]:
        """Return the values of all vertices; vertices without a value get the fill value."""
        if self._whole is None:
            raise InputError("no-values", "There is nothing to stitch: no piece has values")
        if self._known[:-1].all() and self._owners.min() >= 0:
            return self._whole
        dtype, fill = self._whole.dtype, np.min_scalar_type(self._fill)
        # a floating-point fill value converts integers to float64
        widened = dtype.kind in "biu" and fill.kind == "f"
        dtype = np.dtype(np.float64) if widened else np.result_type(dtype, fill)
        whole = self._whole.astype(dtype, copy=False)
        whole[~self._known[self._owners]] = self._fill
        return whole


def _check(array: npt.NDArray[Any], first: npt.NDArray[Any], size: int, name: str) -> None:
    """Raise `InputError` for a result that does not match its piece or the first result."""
    if array.ndim not in (1, 2) or len(array) != size:
        what = f"The function returned shape {array.shape} for {name}"
        remedy = f"return ({size},) or ({size}, f) to stitch, or ask for stitch=False"
        raise InputError("wrong-shape", what, remedy)
    if array.shape[1:] != first.shape[1:]:
        raise InputError(
            "wrong-shape",
            f"The function returned shape {array.shape} for {name} but {first.shape} for the first",
            "return the same columns for every piece, or ask for stitch=False",
        )
    if array.dtype.kind not in "biufc":
        fault = f"The function returned {array.dtype} for {name}"
        raise InputError("wrong-type", fault, "return numbers to stitch, or ask for stitch=False")


class Seams:
    """Values of pieces at vertices next to seams, for `MeshStitcher.seams`."""

    def __init__(self, pieces: Sequence[IntArray], owners: IntArray, faces: IntArray) -> None:
        faces = faces[np.ptp(owners[faces], axis=1) > 0]
        tails, tips = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        vertices = np.append(tails, tips)
        first, second = owners[vertices], owners[np.append(tips, tails)]
        sides = np.stack([first, second, vertices])[:, (first != second) & (first >= 0)]
        # columns: the piece of a vertex next to a seam, the piece of a neighbour, and the vertex
        self._sides = np.unique(sides[:, sides[1] >= 0], axis=1)
        near = np.zeros(len(owners), dtype=np.bool_)
        near[self._sides[2]] = True
        self._at = [np.flatnonzero(near[piece]) for piece in pieces]
        self._pieces, self._n = pieces, len(owners)
        #: Keys ``piece * n + vertex``, ascending, and the rows of values.
        self._keys: list[IntArray] = []
        self._rows: list[npt.NDArray[Any]] = []

    def add(self, number: int, result: Any) -> None:
        """Store the values of a piece, if it has any, at vertices next to seams; pieces ascend."""
        if result is None:
            return
        rows, at = np.asarray(result), self._at[number]
        self._keys.append(number * self._n + self._pieces[number][at])
        self._rows.append(rows.reshape(len(rows), -1)[at])

    def differences(self) -> FloatArray:
        """Compute the relative differences along all seams, shape (s, f)."""
        keys, rows = np.concatenate(self._keys), np.concatenate(self._rows)
        wanted = self._sides[:2] * self._n + self._sides[2]
        places = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        here, there = rows[places[:, (keys[places] == wanted).all(axis=0)]]
        largest = np.maximum(np.abs(here), np.abs(there))
        found = np.zeros(here.shape)
        np.divide(np.abs(here - there), largest, out=found, where=largest > 0.0)
        return found


def seam_sentence(names: Sequence[str], median: FloatArray, remedy: str) -> str:
    """Return a sentence that names the columns whose median difference at seams exceeds 1 %.

    The sentence is empty if there are no such columns.
    """
    flagged = np.flatnonzero(median > TOLERANCE).tolist()
    if not flagged:
        return ""
    differ = "differs" if len(flagged) == 1 else "differ"
    return (
        f"{len(flagged)} of {counted(len(median), 'column')}"
        f" ({', '.join(names[at] for at in flagged)}) {differ} by more than 1 % in the median where"
        f" pieces meet, the worst by {percent(float(median.max()))}: {remedy}"
    )


class PieceError(RuntimeError):
    """Failure of a function on a piece; the message names the piece and the error."""


def results_of_calls(
    function: Callable[..., Any],
    calls: Iterable[tuple[str, tuple[Any, ...]]],
    n_jobs: int | None,
    cancel: CancelCallback | None,
    client: Any = None,
) -> Generator[Any, None, None]:
    """Call a function with the arguments of each of `calls`, and yield the results in order.

    A call is its name, for messages, and the arguments. `PieceError` is raised if the function
    fails, and `Cancelled` if `cancel`, which is called between results, returns True. In both cases
    no further call is started, and running calls are awaited, because aborting them would kill
    workers that other programs may share. `n_jobs` is the number of processes as in joblib; with
    the client of a Dask scheduler, its workers are used.
    """
    alone = client is None and effective_n_jobs(n_jobs) == 1
    stopped = cancel is not None and cancel()
    outcome: Exception | None = Cancelled() if stopped else None

    def tasks() -> Iterator[tuple[Any, ...]]:
        for name, arguments in calls:
            if outcome is not None:
                return
            yield function, arguments, name, alone

    if client is not None:
        found = _on_cluster(client, tasks())
    else:
        # max_nbytes=None: the function receives its own arrays, not read-only memory maps.
        parallel = Parallel(
            n_jobs=n_jobs, return_as="generator", max_nbytes=None, pre_dispatch="n_jobs"
        )
        found = parallel(delayed(_call)(*each) for each in tasks())
    try:
        for result in found:
            if outcome is None and isinstance(result, PieceError):
                outcome = result
            elif outcome is None:
                yield result
                outcome = Cancelled() if cancel is not None and cancel() else None
    except GeneratorExit:  # closed by the caller
        outcome = Cancelled()
        deque(found, maxlen=0)
        raise
    if outcome is not None:
        raise outcome


def _on_cluster(client: Any, tasks: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    """Yield results of `_call` on a Dask cluster, with a limited number of tasks at a time."""
    waiting: deque[Any] = deque()
    for each in tasks:
        with warnings.catch_warnings():
            # the caller chooses the size of pieces, so the size needs no warning
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            waiting.append(client.submit(_call, *each, pure=False))
        if len(waiting) > 2 * max(sum(client.ncores().values()), 1):
            yield _result(waiting.popleft())
    yield from map(_result, waiting)


def _result(task: Any) -> Any:
    try:
        return task.result()
    except (Exception, CancelledError) as fault:
        raise fault_of_task(fault) from fault


def fault_of_task(fault: BaseException) -> BaseException:
    """Return the exception of a task on a cluster; an `InputError` if the cluster caused it."""
    from distributed.scheduler import KilledWorker

    if isinstance(fault, KilledWorker):
        what = "Its worker ended each time that it was tried, as happens where memory runs out"
        return InputError("worker-lost", what, "give each worker more memory, or compute in pieces")
    if isinstance(fault, CancelledError):
        what = "The connection to the scheduler was lost"
        return InputError("worker-lost", what, "start it, and this again")
    if isinstance(fault, ImportError):
        what = f"The workers have another version of this program, or none ({fault})"
        return InputError("worker-lost", what, "install the same there")
    return fault


def _call(function: Callable[..., Any], given: tuple[Any, ...], name: str, alone: bool) -> Any:
    """Call the function with one BLAS thread, and return a failure as `PieceError`.

    Unless `alone`, the function may use one core only.
    """
    one_core = nullcontext() if alone else parallel_config(backend="sequential")
    try:
        with one_core, threadpool_limits(limits=1), warnings.catch_warnings():
            # expected: features are constant on a piece of small components
            warnings.simplefilter("ignore", ConstantFeaturesWarning)
            return function(*given)
    except Exception as failure:  # noqa: BLE001  (returned, and raised by the caller)
        error = PieceError(f"The function failed on {name}: {type(failure).__name__}: {failure}")
        # a note is sent from another process, a cause is not
        error.add_note(traceback.format_exc())
        return error

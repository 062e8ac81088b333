"""Calls of a function on pieces of a mesh, in parallel, each with one core."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from typing import Any

from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from threadpoolctl import threadpool_limits

from meshmash_viewer.errors import ConstantFeaturesWarning
from meshmash_viewer.progress import CancelCallback, Cancelled


class PieceError(RuntimeError):
    """The function failed on a piece; the message names the piece and the failure."""


def results_of_calls(
    function: Callable[..., Any],
    calls: Iterable[tuple[str, tuple[Any, ...]]],
    n_jobs: int | None,
    cancel: CancelCallback | None,
) -> Iterator[Any]:
    """Yield the results of calls, given by their names and arguments, in their order.

    `PieceError` is raised if the function failed, and `Cancelled` after `cancel`, called between
    calls, returned True. No further call is then started, and running ones are awaited: aborting
    them would kill workers shared with others. `n_jobs` is the number of processes as in joblib.
    """
    alone = effective_n_jobs(n_jobs) == 1
    stopped = cancel is not None and cancel()
    outcome: Exception | None = Cancelled() if stopped else None

    def tasks() -> Iterator[Any]:
        for name, arguments in calls:
            if outcome is not None:
                return
            yield delayed(_call)(function, arguments, name, alone)

    # max_nbytes=None: the function receives its own arrays, not read-only memory maps.
    parallel = Parallel(
        n_jobs=n_jobs, return_as="generator", max_nbytes=None, pre_dispatch="n_jobs"
    )
    for result in parallel(tasks()):
        if outcome is not None:
            continue
        if isinstance(result, PieceError):
            outcome = result
            continue
        yield result
        if cancel is not None and cancel():
            outcome = Cancelled()
    if outcome is not None:
        raise outcome


def _call(function: Callable[..., Any], given: tuple[Any, ...], name: str, alone: bool) -> Any:
    """Call the function in the worker, with one BLAS thread; return failures as `PieceError`.

    Unless `alone`, the function is limited to one core.
    """
    share = nullcontext() if alone else parallel_config(backend="sequential")
    try:
        with share, threadpool_limits(limits=1), warnings.catch_warnings():
            # Constant features are expected on a piece of small components.
            warnings.simplefilter("ignore", ConstantFeaturesWarning)
            return function(*given)
    except Exception as failure:  # noqa: BLE001  (returned, and raised by the caller)
        error = PieceError(f"The function failed on {name}: {type(failure).__name__}: {failure}")
        # Unlike a note, a cause is not transferred between processes.
        error.add_note(traceback.format_exc())
        return error

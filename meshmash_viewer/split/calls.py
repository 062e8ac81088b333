"""Calls of a function on pieces of a mesh, in parallel, each with one core."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any

from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from threadpoolctl import threadpool_limits

from meshmash_viewer.errors import ConstantFeaturesWarning
from meshmash_viewer.progress import CancelCallback, Cancelled

__all__ = ["PieceError", "results_of_calls"]


class PieceError(RuntimeError):
    """The function failed on a piece; the message names the piece and the failure."""


def results_of_calls(
    function: Callable[..., Any],
    calls: Sequence[tuple[str, Callable[[], tuple[Any, ...]]]],
    n_jobs: int | None,
    cancel: CancelCallback | None,
) -> Iterator[Any]:
    """Yield the results in the order of the calls, as they come.

    After a failure or a cancel no further call is handed out, and those that are being worked on
    are waited for: to abort them would kill workers that others may share.

    Parameters
    ----------
    function : callable
    calls : sequence of (str, callable)
        What each is called in a message, and what makes its arguments when they are needed.
    n_jobs : int, optional
        As joblib counts them.
    cancel : callable, optional
        Asked between calls.

    Raises
    ------
    PieceError
        If the function failed.
    Cancelled
        If `cancel` returned True.
    """
    alone = effective_n_jobs(n_jobs) == 1
    stopped = cancel is not None and cancel()
    outcome: Exception | None = Cancelled() if stopped else None

    def tasks() -> Iterator[Any]:
        for name, arguments in calls:
            if outcome is not None:
                return
            yield delayed(_call)(function, arguments(), name, alone)

    # max_nbytes=None: the function gets arrays of its own, not read-only maps of a file.
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
    """Run in the worker, with one BLAS thread; a failure comes back as a `PieceError`.

    Unless alone, the worker has one core, and what it calls must not plan for those of the others.
    """
    share = nullcontext() if alone else parallel_config(backend="sequential")
    try:
        with share, threadpool_limits(limits=1), warnings.catch_warnings():
            # A piece that gathers small components has nothing but constants to offer.
            warnings.simplefilter("ignore", ConstantFeaturesWarning)
            return function(*given)
    except Exception as failure:  # noqa: BLE001  (returned, and raised by the caller)
        error = PieceError(f"The function failed on {name}: {type(failure).__name__}: {failure}")
        # A cause does not survive the way between processes; a note does.
        error.add_note(traceback.format_exc())
        return error

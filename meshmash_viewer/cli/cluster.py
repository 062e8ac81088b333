"""Tasks on a Dask scheduler: the connection, and results in the order of arrival.

The scheduler repeats the task of a lost worker on another worker.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from meshmash_viewer.cli.streams import PROGRAM, say
from meshmash_viewer.errors import InputError, package_missing, printable
from meshmash_viewer.units import counted

#: Prefix of ``--scheduler`` for processes of this machine, which end with the command.
LOCAL = "local:"
#: Settings for processes of this machine. Without the profiler and with fewer measurements, an idle
#: process takes less than the default tenth of a core. Workers have no timeout, since they do not
#: answer while they compute. Dask's MALLOC_TRIM_THRESHOLD_ is not set, since it causes memory to be
#: released and requested repeatedly.
_QUIET = {
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.nanny.pre-spawn-environ": {
        "OMP_NUM_THREADS": 1,
        "MKL_NUM_THREADS": 1,
        "OPENBLAS_NUM_THREADS": 1,
    },
}
#: Modules imported once for all processes: Dask, the program, and compiled kernels.
_PRELOADED = [
    "distributed",
    "meshmash_viewer.cli.features",
    "meshmash_viewer.spectral.engine.computation",
    "meshmash_viewer.spectral.engine.multifrontal",
]
#: Timeout of the connection, in seconds.
_ANSWER = 10.0
#: Lock of a task, which changes the working directory and standard error of its process.
_ONE = threading.Lock()
#: Index of a task, and its result or fault.
Answer = tuple[int, Any]


@contextlib.contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """Yield a client of the scheduler at an address, or of a new scheduler for ``local:N``.

    `InputError` is raised if no scheduler answers, or `distributed` is not installed.
    """
    try:
        import dask
        import distributed
        from distributed.comm.addressing import resolve_address
    except ModuleNotFoundError as fault:
        raise package_missing("--scheduler needs", "distributed", "cluster") from fault
    # the command reports faults; Dask would also warn about workers that run C code
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        place: Any = scheduler
        if scheduler.startswith(LOCAL):
            stack.enter_context(dask.config.set(_QUIET))
            if sys.platform == "linux":
                # one process imports the program; the others are forked from it, each with the
                # present environment
                forked = {
                    "distributed.worker.multiprocessing-method": "forkserver",
                    "distributed.nanny.environ": dict(os.environ),
                }
                stack.enter_context(dask.config.set(forked))
                distributed.utils.get_mp_context().set_forkserver_preload(_PRELOADED)
            place = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=int(scheduler.removeprefix(LOCAL)),
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
        try:
            if place is scheduler:
                resolve_address(place)  # an error at once; a client waits for a while
            client: Any = distributed.Client(place, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError, TypeError) as fault:
            raise InputError(
                "no-scheduler",
                f"No Dask scheduler answers at {printable(scheduler)}",
                "give the address that `dask scheduler` prints, such as tcp://HOST:8786, or"
                f" {LOCAL}2",
            ) from fault
        known = stack.enter_context(client).scheduler_info(n_workers=-1)
        waits = "" if known["workers"] else "; it has no workers yet"
        seen = f"; dashboard: {client.dashboard_link}" if known["services"] else ""
        say(f"{counted(len(known['workers']), 'worker')} of {known['address']}{waits}{seen}")
        yield client


def results_of_tasks(
    client: Any, function: Callable[[int], Any], numbers: Sequence[int]
) -> Iterator[list[Answer]]:
    """Call a function with each number in a task; yield results in batches as they arrive.

    A fault is yielded in place of a result. The function runs in the folder of this command, which
    also prints its standard error. `InputError` is raised if the connection ends.
    """
    from distributed import as_completed

    from meshmash_viewer.split.stitching import fault_of_task

    # as a result of a task, the function is sent once to each worker, and recomputed if lost
    shared = client.submit(_same, function, pure=False)
    tasks = client.map(_in_worker, numbers, folder=os.getcwd(), function=shared, pure=False)
    asked = {task.key: number for task, number in zip(tasks, numbers, strict=True)}
    arriving = as_completed(tasks, loop=client.loop, with_results=True, raise_errors=False)
    del tasks  # without references, results are freed after arrival
    for batch in arriving.batches():
        answers: list[Answer] = []
        for task, result in batch:
            if isinstance(result, CancelledError):
                yield answers
                raise InputError(
                    "scheduler-lost",
                    f"The scheduler was lost after {len(numbers) - len(asked)} of"
                    f" {counted(len(numbers), 'mesh')}",
                    "start it, and this command again with --resume",
                )
            result, said = (fault_of_task(result[1]), "") if task.status == "error" else result
            for line in said.splitlines():
                print(line if line.startswith(PROGRAM) else f"{PROGRAM}: {line}", file=sys.stderr)
            answers.append((asked.pop(task.key), result))
        yield answers


def _same(function: Callable[[int], Any]) -> Callable[[int], Any]:
    return function


def _in_worker(number: int, folder: str, function: Callable[[int], Any]) -> tuple[Any, str]:
    """Call the function in the folder of the command; return its result and its messages."""
    said = io.StringIO()
    with _ONE, contextlib.redirect_stderr(said), warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: say(str(message))
        before = os.getcwd()
        try:
            os.chdir(folder)
        except OSError:
            return InputError(
                "folder-not-found",
                f"Its worker has no folder {folder}",
                "workers need the files of this computer",
            ), ""
        try:
            return function(number), said.getvalue()
        finally:
            os.chdir(before)

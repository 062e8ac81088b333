"""Tasks on a Dask scheduler: the connection, and results as they come.

The scheduler starts a task again whose worker is lost, so that this costs the task only.
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
from meshmash_viewer.errors import InputError, not_installed, printable
from meshmash_viewer.units import counted

#: Begins the name of a scheduler that runs during the command, with processes of this machine.
LOCAL = "local:"
#: Settings of that scheduler: no profiler and fewer looks at memory and time, which take a tenth of
#: a core by default. A process that does not answer is not a lost one: it computes. Without the
#: MALLOC_TRIM_THRESHOLD_ that Dask sets, freed memory is not given back and taken again.
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
#: Seconds until a scheduler has to answer.
_ANSWER = 10.0
#: One mesh at a time in a process: the working directory and standard error are the process's.
_ONE = threading.Lock()
#: Number of a task, and its result or fault.
Answer = tuple[int, Any]


@contextlib.contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """Yield a client of the scheduler at an address, or of one with N processes for ``local:N``.

    `InputError` is raised if there is none, or `distributed` is not installed.
    """
    try:
        import dask
        import distributed
        from distributed.comm.addressing import resolve_address
    except ModuleNotFoundError as fault:
        raise InputError(f"--scheduler needs {not_installed('distributed', 'cluster')}.") from fault
    # faults are sentences of this command, and a processor of C code is not a lost worker
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        if scheduler.startswith(LOCAL):
            stack.enter_context(dask.config.set(_QUIET))
            place: Any = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=int(scheduler.removeprefix(LOCAL)),
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
        else:
            place = scheduler
        try:
            if place is scheduler:
                resolve_address(place)  # a client takes long to refuse what is no address
            client: Any = distributed.Client(place, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError, TypeError) as fault:
            raise InputError(
                f"No Dask scheduler answers at {printable(scheduler)}: give the address that `dask"
                f" scheduler` prints, such as tcp://HOST:8786, or {LOCAL}2."
            ) from fault
        with client:
            known = client.scheduler_info(n_workers=-1)
            waits = "" if known["workers"] else "; it has no workers yet"
            seen = f"; dashboard: {client.dashboard_link}" if known["services"] else ""
            say(f"{counted(len(known['workers']), 'worker')} of {known['address']}{waits}{seen}")
            yield client


def results_of_tasks(
    client: Any, function: Callable[[int], Any], numbers: Sequence[int]
) -> Iterator[list[Answer]]:
    """Call a function with numbers, one a task; yield results in batches as they come.

    A fault is yielded in place of a result. The function runs in the folder of this command, and
    what it prints on standard error is repeated here. `InputError` is raised if the connection
    ends.
    """
    from distributed import as_completed

    from meshmash_viewer.split.stitching import fault_of_task

    # a task of its own, which is not sent once for each number, and is found again if it is lost
    shared = client.submit(_same, function, pure=False)
    tasks = client.map(_in_worker, numbers, folder=os.getcwd(), function=shared, pure=False)
    asked = {task.key: number for task, number in zip(tasks, numbers, strict=True)}
    arriving = as_completed(tasks, loop=client.loop, with_results=True, raise_errors=False)
    del tasks  # results are forgotten when they have come
    for batch in arriving.batches():
        answers: list[Answer] = []
        for task, result in batch:
            if isinstance(result, CancelledError):
                yield answers
                raise InputError(
                    f"The scheduler was lost after {len(numbers) - len(asked)} of"
                    f" {counted(len(numbers), 'mesh')}: start it, and this command again with"
                    " --resume."
                )
            result, said = (fault_of_task(result[1]), "") if task.status == "error" else result
            for line in said.splitlines():
                print(line if line.startswith(PROGRAM) else f"{PROGRAM}: {line}", file=sys.stderr)
            answers.append((asked.pop(task.key), result))
        yield answers


def _same(function: Callable[[int], Any]) -> Callable[[int], Any]:
    return function


def _in_worker(number: int, folder: str, function: Callable[[int], Any]) -> tuple[Any, str]:
    """Call the function in the folder of the command; return its result and what it printed."""
    said = io.StringIO()
    with _ONE, contextlib.redirect_stderr(said), warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: say(str(message))
        before = os.getcwd()
        try:
            os.chdir(folder)
        except OSError:
            return InputError(
                f"Its worker has no folder {folder}: workers need the files of this computer."
            ), ""
        try:
            return function(number), said.getvalue()
        finally:
            os.chdir(before)

"""Does nothing but sleep, on one processor, and prints when that was withheld from this machine.

Started by `interaction_window.py`, once for each processor. A virtual machine has its processors
taken away now and then, some tens of milliseconds at a time; whatever runs there stands still, and
nothing in the program can help it. Each line is the beginning and the end of such a time, as
`time.perf_counter` counts (the same for all processes of Linux).
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from functools import cache

#: Seconds between two ticks.
TICK = 0.005
#: Seconds later than due that a sleep may end without a reason.
LATE = 0.003


@cache
def _schedule(process: int) -> int:
    """Where the kernel says how long the main thread of a process waited; -1 where it does not."""
    try:
        return os.open(f"/proc/{process}/schedstat", os.O_RDONLY)
    except OSError:
        return -1


def seconds_waited() -> float:
    """Seconds that the main thread was ready and other programs had the processors."""
    # Kept open: it is asked for several times a frame, and opening it takes a tenth of a
    # millisecond.
    place = _schedule(os.getpid())
    return int(os.pread(place, 200, 0).split()[1]) * 1e-9 if place >= 0 else 0.0


def main() -> None:
    """Sleep until the program that started it is gone."""
    os.sched_setaffinity(0, {int(sys.argv[1])})
    # Before all other programs, where that is permitted: while one of them has the processor, this
    # one could not tell that it is withheld from both.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    parent = os.getppid()
    now, waited = time.perf_counter(), seconds_waited()
    while os.getppid() == parent:
        time.sleep(TICK)
        # Tick by tick without a break, awake or asleep: a processor goes when it is just awake,
        # too.
        due, before = now + TICK, waited
        now, waited = time.perf_counter(), seconds_waited()
        # Less the time in which another program had the processor.
        end = now - (waited - before)
        if end > due + LATE:
            print(due, end, flush=True)


if __name__ == "__main__":
    main()

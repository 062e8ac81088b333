"""Process that sleeps on one processor, and prints when the host withheld the processor.

Started by `interaction_window.py`, once for each processor. The host of a virtual machine withholds
processors now and then, for some tens of milliseconds; every program on the processor then stops,
which no program can prevent. Each printed line is the beginning and the end of such an interval, by
`time.perf_counter` (the same clock in all processes of Linux).
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from functools import cache

#: Seconds between two ticks.
TICK = 0.005
#: Seconds by which a sleep may end late without being printed.
LATE = 0.003


@cache
def _schedule(process: int) -> int:
    """Open the kernel's record of waiting times of a process; return -1 if there is none."""
    try:
        return os.open(f"/proc/{process}/schedstat", os.O_RDONLY)
    except OSError:
        return -1


def seconds_waited() -> float:
    """Return the seconds for which the main thread was ready, but other programs ran."""
    # The file is kept open: it is read several times per frame, and opening it takes 0.1 ms.
    place = _schedule(os.getpid())
    return int(os.pread(place, 200, 0).split()[1]) * 1e-9 if place >= 0 else 0.0


def main() -> None:
    """Sleep until the parent process has ended."""
    os.sched_setaffinity(0, {int(sys.argv[1])})
    # With priority over other programs, if permitted: while another program runs, this process
    # cannot detect that the processor is withheld from both.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    parent = os.getppid()
    now, waited = time.perf_counter(), seconds_waited()
    while os.getppid() == parent:
        time.sleep(TICK)
        # The ticks have no gaps: the processor is also withheld while this process is awake.
        due, before = now + TICK, waited
        now, waited = time.perf_counter(), seconds_waited()
        # Less the time in which another program had the processor.
        end = now - (waited - before)
        if end > due + LATE:
            print(due, end, flush=True)


if __name__ == "__main__":
    main()

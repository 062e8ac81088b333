"""A process with all that it has started: what they take, and how they end.

The process that was started need not be the one that works: in a virtual environment of Windows
``python.exe`` starts the real interpreter and waits for it, and so do other launchers.
"""

from __future__ import annotations

import contextlib
import os
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

#: Seconds between two searches for new processes, which read the table of all processes.
_SEARCH = 0.5
#: Part of the command line of a process that only deletes what others leave, then ends by itself.
_TRACKER = "resource_tracker"


class ProcessTree:
    """A process and its descendants, which are remembered when their parent ends.

    Parameters
    ----------
    root : int
        Process id of the first.
    """

    def __init__(self, root: int) -> None:
        import psutil

        self._processes: list[psutil.Process] = []
        with contextlib.suppress(psutil.Error):  # it has just ended
            self._processes.append(psutil.Process(root))
        #: Processor time of each, those that have ended included.
        self._seconds: dict[psutil.Process, float] = {}
        self._searched = -_SEARCH

    def measured(self) -> tuple[float, float]:
        """Processor time that all have taken (s), and memory that they have in use (bytes)."""
        import psutil

        if time.monotonic() - self._searched >= _SEARCH:
            self._search()
        memory = with_children = 0.0
        for process in self._processes:
            with contextlib.suppress(psutil.Error):  # it has just ended
                spent = process.cpu_times()
                self._seconds[process] = spent.user + spent.system
                with_children += sum(spent[:4])
                memory += process.memory_info().rss
        return max(sum(self._seconds.values()), with_children), memory

    def end(self, patience: float = 0.0) -> None:
        """Kill all of them, this process last if it is among them.

        Parameters
        ----------
        patience : float
            Seconds that processes have which only delete what others leave, as those of
            multiprocessing; 0 leaves them to end by themselves.
        """
        import psutil

        self._search()
        others = [each for each in self._processes if each.pid != os.getpid()]
        for process in others:
            if not _only_deletes(process):
                _kill(process)
        if patience:
            for process in psutil.wait_procs(others, timeout=patience)[1]:
                _kill(process)
        for process in self._processes:
            if process not in others:
                _kill(process)

    def _search(self) -> None:
        """Add processes that have been started since."""
        import psutil

        for process in list(self._processes):
            with contextlib.suppress(psutil.Error):
                started = process.children(recursive=True)
                self._processes += [each for each in started if each not in self._processes]
        self._searched = time.monotonic()


def _kill(process: psutil.Process) -> None:
    import psutil

    with contextlib.suppress(psutil.Error):
        process.kill()


def _only_deletes(process: psutil.Process) -> bool:
    import psutil

    with contextlib.suppress(psutil.Error):
        return any(_TRACKER in part for part in process.cmdline())
    return False

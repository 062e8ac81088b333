"""Fill-reducing orders by METIS, of large graphs in processes of their own.

METIS takes seconds from half a million vertices on, holds the interpreter lock all that time and
can't be stopped. In processes it can, and they order parts of the graph side by side: the cuts
between the parts are METIS's own, so the order is as good as its order of the whole.
"""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from queue import Queue

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from meshmash_viewer.spectral.engine import dissection_process
from meshmash_viewer.spectral.engine.cores import core_count
from meshmash_viewer.spectral.engine.dissection_process import HALVE, ORDER
from meshmash_viewer.spectral.engine.waiting import wait_for

__all__ = ["DissectionCrew", "nested_dissection"]

IndexArray = npt.NDArray[np.int32]
Ask = Callable[[int, sp.csr_array], IndexArray]

#: From so many vertices on METIS takes longer than processes take to start: halves, quarters.
#: How often a graph is cut depends on nothing else, or results would depend on the machine.
_VERTICES_TO_HALVE, _VERTICES_TO_QUARTER = 100_000, 600_000


class DissectionCrew:
    """Processes for METIS, which start while what they will be asked is prepared.

    Parameters
    ----------
    n_vertices : int
        Of the graph that is expected; where that is ordered here there are none.
    """

    def __init__(self, n_vertices: int) -> None:
        self._processes: list[_Process] = []
        self._idle: Queue[_Process] = Queue()
        self._abandoned = False
        cuts = _cuts(n_vertices)
        # Inside another program the interpreter has no name to be started by.
        if cuts == 0 or not sys.executable or find_spec("pymetis") is None:
            return
        for _ in range(min(2**cuts, core_count())):
            self._processes.append(_Process())
            self._idle.put(self._processes[-1])

    def __bool__(self) -> bool:
        return bool(self._processes)

    def ask(self, question: int, part: sp.csr_array) -> IndexArray:
        """Have the next idle process answer, or METIS here if that dies over it."""
        process = self._idle.get()
        try:
            process.ask(question, part)
            return process.answer()
        except ChildProcessError:
            if self._abandoned:
                raise
            return _ask_here(question, part)
        finally:
            self._idle.put(process)

    def abandon(self) -> None:
        """End the processes, whatever they are at."""
        self._abandoned = True
        for process in self._processes:
            process.kill()

    def close(self) -> None:
        """End the processes when nobody asks them any more."""
        for process in self._processes:
            process.close()


def _cuts(n: int) -> int:
    """How often a graph of n vertices is cut in two."""
    return int(n >= _VERTICES_TO_HALVE) + int(n >= _VERTICES_TO_QUARTER)


def nested_dissection(
    graph: sp.csr_array, poll: Callable[[], None] | None, crew: DissectionCrew | None = None
) -> IndexArray:
    """Order the vertices of a graph, given by its adjacency without a diagonal.

    Parameters
    ----------
    graph : csr_array
        Of which only the pattern counts.
    poll : callable, optional
        Asked while processes work; what it raises ends them.
    crew : DissectionCrew, optional
        Closed here; without it one is started.
    """
    n = graph.shape[0]
    cuts = _cuts(n)
    crew = DissectionCrew(n) if crew is None else crew
    try:
        if cuts == 0 or not crew:
            return _dissect(graph, cuts, _ask_here)
        return wait_for(lambda: _dissect(graph, cuts, crew.ask), poll, crew.abandon)
    finally:
        crew.close()


def _dissect(graph: sp.csr_array, cuts: int, ask: Ask) -> IndexArray:
    """Order a graph that is cut in two so many times: its parts, then what separates them."""
    if cuts == 0:
        return ask(ORDER, graph)
    half = ask(HALVE, graph)
    row = np.repeat(np.arange(graph.shape[0], dtype=np.int32), np.diff(graph.indptr))
    cut = half[row] != half[graph.indices]
    borders = [np.unique(row[cut & (half[row] == side)]) for side in (0, 1)]
    separator = min(borders, key=len)
    half[separator] = 2
    places = [np.flatnonzero(half == side).astype(np.int32) for side in (0, 1)]
    parts = [graph[place][:, place] for place in places]
    with ThreadPoolExecutor(2) as pool:
        orders = pool.map(lambda part: _dissect(part, cuts - 1, ask), parts)
        ordered = [place[order] for place, order in zip(places, orders, strict=True)]
    return np.concatenate([*ordered, separator])


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        with suppress(BrokenPipeError):  # a killed process leaves some of its question unread
            pipe.close()


def _ask_here(question: int, graph: sp.csr_array) -> IndexArray:
    return dissection_process.answer(
        question, graph.indptr.astype(np.int32), graph.indices.astype(np.int32)
    )


class _Process:
    """A process that answers questions about graphs, one at a time."""

    def __init__(self) -> None:
        # With -P the script does not see its own folder, whose modules have common names.
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(Path(dissection_process.__file__))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        # Called by the interpreter where a crew was never asked nor closed.
        self.close = weakref.finalize(self, _end, self._process)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def ask(self, question: int, graph: sp.csr_array) -> None:
        """Give it a graph to answer a question about."""
        sink = self._process.stdin
        assert sink is not None
        self._n = graph.shape[0]
        with suppress(BrokenPipeError):  # the answer will show it
            sink.write(np.array([question, self._n, graph.nnz], np.int64).tobytes())
            sink.write(graph.indptr.astype(np.int32).data)
            sink.write(graph.indices.astype(np.int32).data)
            sink.flush()

    def answer(self) -> IndexArray:
        """What it has to say, when it has found it."""
        source = self._process.stdout
        assert source is not None
        answer = source.read(4 * self._n)
        if len(answer) < 4 * self._n:
            raise ChildProcessError(f"METIS ended with {self._process.wait()}")
        return np.frombuffer(answer, np.int32).copy()

"""Fill-reducing orders by METIS, of large graphs in processes of their own.

METIS takes seconds from half a million vertices on, holds the interpreter lock all that time and
can't be stopped. In processes it can, and they order parts of the graph side by side: the cuts
between the parts are METIS's own, so the order is as good as its order of the whole.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from queue import Queue

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from meshmash_viewer.engine import dissection_process
from meshmash_viewer.engine.dissection_process import HALVE, ORDER
from meshmash_viewer.engine.waiting import wait_for

__all__ = ["nested_dissection"]

IndexArray = npt.NDArray[np.int32]
Ask = Callable[[int, sp.csr_array], IndexArray]

#: From so many vertices on METIS takes longer than processes take to start: halves, quarters.
#: How often a graph is cut depends on nothing else, or results would depend on the machine.
_VERTICES_TO_HALVE, _VERTICES_TO_QUARTER = 150_000, 600_000


def nested_dissection(graph: sp.csr_array, poll: Callable[[], None] | None) -> IndexArray:
    """Order the vertices of a graph, given by its adjacency without a diagonal.

    Parameters
    ----------
    graph : csr_array
        Of which only the pattern counts.
    poll : callable, optional
        Asked while processes work; what it raises ends them.
    """
    n = graph.shape[0]
    cuts = int(n >= _VERTICES_TO_HALVE) + int(n >= _VERTICES_TO_QUARTER)
    if cuts == 0:
        return _ask_here(ORDER, graph)
    if not sys.executable:  # an interpreter inside another program
        return _dissect(graph, cuts, _ask_here)
    from joblib import cpu_count

    with ExitStack() as stack:
        crew = [stack.enter_context(_Process()) for _ in range(min(2**cuts, int(cpu_count())))]
        idle: Queue[_Process] = Queue()
        for process in crew:
            idle.put(process)

        def ask(question: int, part: sp.csr_array) -> IndexArray:
            process = idle.get()
            try:
                return process.ask(question, part)
            finally:
                idle.put(process)

        def abandon() -> None:
            for process in crew:
                process.kill()

        return wait_for(lambda: _dissect(graph, cuts, ask), poll, abandon)


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

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):  # a killed process leaves some of its question unread
                pipe.close()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def ask(self, question: int, graph: sp.csr_array) -> IndexArray:
        source, sink = self._process.stdin, self._process.stdout
        assert source is not None
        assert sink is not None
        n = graph.shape[0]
        answer = b""
        # A process that dies while it reads the question shows by an answer that is too short.
        with suppress(BrokenPipeError):
            source.write(np.array([question, n, graph.nnz], np.int64).tobytes())
            source.write(graph.indptr.astype(np.int32).data)
            source.write(graph.indices.astype(np.int32).data)
            source.flush()
            answer = sink.read(4 * n)
        if len(answer) < 4 * n:
            raise ChildProcessError(f"METIS ended with {self._process.wait()}")
        return np.frombuffer(answer, np.int32).copy()

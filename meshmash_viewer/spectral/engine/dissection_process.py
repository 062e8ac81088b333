"""METIS behind a pipe: a script for a process that nothing but METIS runs in.

Reads requests from its standard input until that closes, and answers each on its standard output.
Imports nothing of the package, so that it starts fast.
"""

from __future__ import annotations

import signal
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["HALVE", "ORDER", "answer"]

IndexArray = npt.NDArray[np.int32]

#: What can be asked for: the fill-reducing order of a graph, or which half each vertex is in.
ORDER, HALVE = 0, 1


def answer(question: int, starts: IndexArray, neighbours: IndexArray) -> IndexArray:
    """Ask METIS about a graph: int32, shape (n,). The same graph gives the same answer."""
    import pymetis

    graph = pymetis.CSRAdjacency(starts, neighbours)
    if question == ORDER:
        return np.asarray(pymetis.nested_dissection(graph)[0], dtype=np.int32)
    return np.asarray(pymetis.part_graph(2, graph)[1], dtype=np.int32)


def _serve(source: Any, sink: Any) -> None:
    while header := source.read(24):
        question, n, n_neighbours = (int(number) for number in np.frombuffer(header, np.int64))
        starts = np.frombuffer(source.read(4 * (n + 1)), np.int32)
        neighbours = np.frombuffer(source.read(4 * n_neighbours), np.int32)
        sink.write(answer(question, starts, neighbours).tobytes())
        sink.flush()


if __name__ == "__main__":
    # A key press that interrupts reaches the whole family; the parent decides what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _serve(sys.stdin.buffer, sys.stdout.buffer)

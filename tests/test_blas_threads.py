"""Limit of BLAS threads during overlapping solves."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest
import shapes
from threadpoolctl import threadpool_info

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigensolver import solve


def blas_threads() -> set[int]:
    return {int(pool["num_threads"]) for pool in threadpool_info() if pool["user_api"] == "blas"}


def in_thread(work: object) -> threading.Thread:
    thread = threading.Thread(target=work)  # type: ignore[arg-type]
    thread.start()
    return thread


OVERLAP = """
import threading
import shapes
from test_blas_threads import blas_threads, in_thread
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.compiler import one_blas_thread
solve(*cotangent_laplacian(shapes.icosphere(1)), 5)  # loads BLAS
entered, first_gone = threading.Event(), threading.Event()
def second():
    with one_blas_thread():
        entered.set()
        first_gone.wait(60.0)
        print(blas_threads())
print(blas_threads())
first = one_blas_thread()
first.__enter__()
thread = in_thread(second)
assert entered.wait(60.0)
print(blas_threads())
first.__exit__(None, None, None)
first_gone.set()
thread.join()
print(blas_threads())
"""


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core has one thread anyway")
def test_overlapping_users_leave_the_limit_as_it_was() -> None:
    """Overlapping solves restore the limit of two BLAS threads."""
    two = {name: "2" for name in os.environ if name.endswith("_NUM_THREADS")}
    environment = {**os.environ, **two, "OPENBLAS_NUM_THREADS": "2"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    run = [sys.executable, "-c", OVERLAP]
    said = subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout
    assert said.splitlines() == ["{2}", "{1}", "{1}", "{2}"]


def test_a_solve_in_a_thread_of_its_own_is_limited_too() -> None:
    inside: list[set[int]] = []
    matrices = cotangent_laplacian(shapes.icosphere(1))

    def work() -> None:
        solve(*matrices, 5, on_pairs=lambda *_: inside.append(blas_threads()))

    in_thread(work).join()
    assert inside == [{1}]

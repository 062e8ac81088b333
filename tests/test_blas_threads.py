"""The limit of BLAS threads while two solves overlap."""

from __future__ import annotations

import threading

import shapes
from threadpoolctl import threadpool_info, threadpool_limits

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.blas_threads import one_blas_thread


def blas_threads() -> set[int]:
    return {int(pool["num_threads"]) for pool in threadpool_info() if pool["user_api"] == "blas"}


def in_thread(work: object) -> threading.Thread:
    thread = threading.Thread(target=work)  # type: ignore[arg-type]
    thread.start()
    return thread


def test_overlapping_users_leave_the_limit_as_it_was() -> None:
    solve(*cotangent_laplacian(shapes.icosphere(1)), 5)  # loads BLAS
    entered, first_gone = threading.Event(), threading.Event()
    seen: list[set[int]] = []

    def second() -> None:
        with one_blas_thread():
            entered.set()
            first_gone.wait(10.0)
            seen.append(blas_threads())

    with threadpool_limits(2, user_api="blas"):
        pass  # leaves no owner behind
    before = blas_threads()
    first = one_blas_thread()
    first.__enter__()
    thread = in_thread(second)
    assert entered.wait(10.0)
    assert blas_threads() == {1}
    first.__exit__(None, None, None)
    first_gone.set()
    thread.join()
    assert seen == [{1}]
    assert blas_threads() == before


def test_a_solve_in_a_thread_of_its_own_is_limited_too() -> None:
    inside: list[set[int]] = []
    matrices = cotangent_laplacian(shapes.icosphere(1))

    def work() -> None:
        solve(*matrices, 5, on_pairs=lambda *_: inside.append(blas_threads()))

    in_thread(work).join()
    assert inside == [{1}]

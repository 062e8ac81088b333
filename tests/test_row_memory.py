"""Memory of bases: what is let go goes back to the system, and nothing else does."""

from __future__ import annotations

import mmap

import numpy as np
import psutil
import pytest

from meshmash_viewer.spectral.engine.row_memory import CAN_LET_GO, allocate, let_go


def resident() -> int:
    return int(psutil.Process().memory_info().rss)


@pytest.mark.skipif(not CAN_LET_GO, reason="only Linux takes pages back")
def test_what_is_let_go_goes_back_and_the_rest_stays() -> None:
    n = 1_000_003  # rows begin anywhere in a page
    rows = allocate(10 * n + 77)[: 10 * n].reshape(10, n)
    rows[:] = np.arange(10.0)[:, None]
    before = resident()
    let_go(rows[3:])
    assert before - resident() > 0.9 * 7 * 8 * n
    assert (rows[:3] == np.arange(3.0)[:, None]).all()
    rows[3:] = 5.0  # it can be written again
    assert (rows[3:] == 5.0).all()


def test_little_is_let_go_without_harm_to_its_neighbours() -> None:
    rows = allocate(4 * 100).reshape(4, 100)
    rows[:] = 1.0
    for part in (rows[2:3], rows[4:], rows[:0]):
        let_go(part)
    assert (rows[:2] == 1.0).all()
    assert (rows[3] == 1.0).all()


def test_memory_that_came_from_elsewhere_is_left_alone() -> None:
    rows = np.ones((4, 100_000))
    let_go(rows[1:])
    assert (rows == 1.0).all()
    assert allocate(0).shape == (0,)


def test_memory_that_there_is_not_is_a_memory_error() -> None:
    with pytest.raises(MemoryError):
        allocate(1 << 50)


@pytest.mark.skipif(not CAN_LET_GO, reason="only Linux is asked for large pages")
def test_a_kernel_without_large_pages_still_gives_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mmap, "MADV_HUGEPAGE", 9999)  # a hint that no kernel knows
    rows = allocate(3000).reshape(3, 1000)
    rows[:] = 2.0
    assert (rows == 2.0).all()

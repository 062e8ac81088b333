"""The structure of the factor, against the fill that elimination makes when it is carried out."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
from test_eigensolver import random_mesh, torus
from test_eigensolver_hard import icosphere

from meshmash_viewer.spectral.engine.symbolic import analyse, elimination_order


def filled(matrix: Any) -> npt.NDArray[np.bool_]:
    """Where the factor of a symmetric matrix has entries, column by column."""
    entries: npt.NDArray[np.bool_] = matrix.toarray() != 0.0
    for column in range(len(entries)):
        below = column + 1 + np.flatnonzero(entries[column + 1 :, column])
        entries[np.ix_(below, below)] = True
    return np.tril(entries)


def ordered(matrix: Any) -> Any:
    order = elimination_order(sp.csc_array(matrix))
    result = sp.csc_array(sp.csc_array(matrix)[order][:, order])
    result.sort_indices()
    return result


@pytest.mark.parametrize(
    "matrix",
    [
        pytest.param(lambda: torus(20, 18, 1.0, 1.0)[0][0], id="torus"),
        pytest.param(lambda: random_mesh(1)[0], id="irregular"),
        pytest.param(lambda: icosphere(3)[0], id="sphere"),
        pytest.param(lambda: sp.block_diag([icosphere(1)[0]] * 9), id="nine spheres"),
    ],
)
def test_blocks_hold_the_fill_and_little_more(matrix: Any) -> None:
    entries = filled(given := ordered(matrix()))
    found = analyse(given)
    n, n_blocks = len(entries), len(found.first) - 1
    stored = np.zeros_like(entries)
    held = []
    for block in range(n_blocks):
        columns = np.arange(found.first[block], found.first[block + 1])
        rows = found.rows[found.row_start[block] : found.row_start[block + 1]]
        np.testing.assert_array_equal(rows[: len(columns)], columns)
        assert (np.diff(rows) > 0).all()
        stored[np.ix_(rows, columns)] = True
        held.append(len(rows))
    assert not (entries & ~stored).any()
    assert np.tril(stored).sum() < 1.7 * entries.sum()
    assert n_blocks < 0.31 * n
    assert found.n_entries == int(np.diff(found.first) @ held)
    assert found.front_size == max(held)


def test_a_full_matrix_is_one_block() -> None:
    found = analyse(sp.csc_array(np.ones((30, 30))))
    assert (len(found.first), found.n_entries, found.stack_size) == (2, 900, 0)

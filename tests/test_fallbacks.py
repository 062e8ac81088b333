"""Fallbacks of the eigensolver: wrong input from the caller must not give wrong results."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
from faults import raises
from scipy.sparse.linalg import LinearOperator, splu
from test_eigensolver import Matrices, check, dense, random_mesh
from tiers import slow

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve


@pytest.fixture(scope="module")
def matrices() -> Matrices:
    return random_mesh(31)


@pytest.fixture(scope="module")
def exact(matrices: Matrices) -> npt.NDArray[np.float64]:
    values = dense(matrices)
    values[0] = 0.0
    return values


@pytest.fixture(scope="module")
def whole(matrices: Matrices) -> Eigenpairs:
    return solve(*matrices, 60)


def test_an_inverse_that_is_blind_to_a_pair_does_not_hide_it(
    matrices: Matrices, exact: npt.NDArray[np.float64], whole: Eigenpairs
) -> None:
    stiffness, mass = matrices
    sigma = -0.01 * exact[1]
    factor = splu(sp.csc_matrix(stiffness - sigma * mass))
    missed = whole.rows[7]

    def blind(column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        answer = np.asarray(factor.solve(column)).ravel()
        return answer - missed * (missed @ (mass @ answer))

    inverse = LinearOperator(stiffness.shape, matvec=blind, dtype=np.float64)
    check(solve(stiffness, mass, 20, sigma=sigma, op_inv=inverse), exact[:20])


@pytest.mark.parametrize("size", [1e-2, 1e-5, 1e-8])
def test_one_entry_of_an_asymmetric_matrix_is_enough_to_refuse_it(
    matrices: Matrices, size: float
) -> None:
    stiffness, mass = matrices
    wrong = sp.lil_array(stiffness)
    row, column = (int(ends[3]) for ends in sp.triu(stiffness, k=1).nonzero())
    wrong[row, column] += size * abs(stiffness).max()
    with raises("not-symmetric", "not symmetric"):
        solve(sp.csc_array(wrong), mass, 5)


def test_rounding_in_a_symmetric_matrix_is_none(
    matrices: Matrices, exact: npt.NDArray[np.float64]
) -> None:
    stiffness, mass = matrices
    other = sp.csc_array(stiffness, copy=True)
    other.data *= 1.0 + 1e-15 * np.arange(other.nnz) % 3e-15
    assert abs(other - other.T).max() > 0.0
    check(solve(other, mass, 20), exact[:20])


@pytest.mark.parametrize(
    "spoiled",
    [
        pytest.param(lambda rows, i: np.delete(rows, i, axis=0), id="a gap"),
        pytest.param(lambda rows, i: _with_row(rows, i, rows[i - 1]), id="one twice"),
        pytest.param(lambda rows, i: _with_row(rows, i, rows[i] + 0.5 * rows[i + 1]), id="mixed"),
        pytest.param(lambda rows, i: _with_row(rows, i, np.nan * rows[i]), id="not finite"),
    ],
)
@pytest.mark.parametrize("i", [12, slow(38)])
def test_known_pairs_that_are_not_the_lowest_are_not_built_on(
    matrices: Matrices,
    exact: npt.NDArray[np.float64],
    whole: Eigenpairs,
    spoiled: Any,
    i: int,
) -> None:
    rows = spoiled(whole.rows[:40], i)
    kept = np.delete(np.arange(40), i) if len(rows) < 40 else np.arange(40)
    known = replace(
        whole, eigenvalues=whole.eigenvalues[kept], rows=rows, residuals=whole.residuals[kept]
    )
    check(solve(*matrices, 60, known=known), exact[:60])


@pytest.mark.parametrize("off", [slow(-1e-5), 1e-5])
@pytest.mark.parametrize("n_components", [60, 700])  # in slices, and dense
def test_known_eigenvalues_that_are_not_those_of_their_vectors_are_not_believed(
    matrices: Matrices,
    exact: npt.NDArray[np.float64],
    whole: Eigenpairs,
    n_components: int,
    off: float,
) -> None:
    eigenvalues = whole.eigenvalues.copy()
    eigenvalues[20] *= 1.0 + off
    known = replace(whole, eigenvalues=eigenvalues)
    check(solve(*matrices, n_components, known=known), exact[:n_components])


def _with_row(rows: npt.NDArray[Any], i: int, row: npt.NDArray[Any]) -> npt.NDArray[Any]:
    rows = rows.copy()
    rows[i] = row
    return rows


def test_a_cancelled_run_does_not_run_on() -> None:
    found: list[int] = []

    def on_pairs(pairs: Eigenpairs) -> None:
        found.append(len(pairs))

    # In float32 a slice has 50 pairs. Of the ten slices, only the next few may have begun.
    with pytest.raises(Cancelled):
        solve(
            *random_mesh(32, copies=2), 500, dtype=np.float32, n_jobs=1, on_pairs=on_pairs,
            cancel=lambda: len(found) > 1,
        )  # fmt: skip
    assert found[-1] < 400
    assert not [thread for thread in threading.enumerate() if thread.name == "eigenpairs"]

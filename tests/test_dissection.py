"""Orders of elimination, which reduce fill with METIS and without."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from test_eigensolver import check, torus

from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.factorization import order_pencil
from meshmash_viewer.spectral.engine.pencil import reduce_pencil
from meshmash_viewer.spectral.engine.symbolic import elimination_order

pytest.importorskip("pymetis")


def grid(nx: int, ny: int) -> Any:
    """Return the adjacency of a rectangular grid."""
    chain = [sp.diags_array([np.ones(n - 1)] * 2, offsets=[-1, 1]) for n in (nx, ny)]
    graph = sp.kron(chain[0], sp.eye_array(ny)) + sp.kron(sp.eye_array(nx), chain[1])
    graph = sp.csr_array(graph)
    graph.sort_indices()
    return graph


def fill(graph: Any, order: Any) -> int:
    """Count the entries of the factor for an order of elimination."""
    from scipy.sparse.linalg import splu

    matrix = sp.csc_array(6.0 * sp.eye_array(graph.shape[0]) - graph)[order][:, order]
    options = {"SymmetricMode": True}
    factor = splu(
        sp.csc_array(matrix), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options
    )
    return int(factor.L.nnz)


def test_without_metis_the_pairs_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    matrices, exact = torus(45, 40, 1.0, 1.2)
    assert exact[79] - exact[78] > 1.0  # The 79th pair ends a multiplet.
    with_metis = solve(*matrices, 79)
    monkeypatch.setitem(sys.modules, "pymetis", None)
    found = solve(*matrices, 79)
    check(found, exact[:79])
    np.testing.assert_allclose(found.eigenvalues, with_metis.eigenvalues, rtol=1e-11, atol=1e-9)
    # Another order of elimination rounds differently: the spaces agree, but not the bits.
    assert found.rows.tobytes() != with_metis.rows.tobytes()
    mass = matrices[1].diagonal()
    cosines = scipy.linalg.svdvals((found.rows * mass) @ with_metis.rows.T)
    assert cosines.min() > 1.0 - 1e-9


def test_without_metis_the_order_still_saves_fill(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = grid(40, 30)
    laplacian = sp.csc_array(6.0 * sp.eye_array(graph.shape[0]) - graph)
    with_metis = fill(graph, elimination_order(laplacian))
    monkeypatch.setitem(sys.modules, "pymetis", None)
    order = elimination_order(laplacian)
    np.testing.assert_array_equal(np.sort(order), np.arange(graph.shape[0]))
    assert fill(graph, order) < 1.5 * with_metis < 0.7 * fill(graph, np.arange(graph.shape[0]))


def test_the_factor_stores_few_zeros() -> None:
    neighbours = grid(60, 50)
    laplacian = sp.diags_array(neighbours.sum(axis=1)) - neighbours
    ordered = order_pencil(reduce_pencil(laplacian, np.ones(3000)))
    matrix = abs(ordered.pencil.matrix)
    matrix.setdiag(0.0)
    graph = sp.csr_array(matrix / matrix.max())
    n_entries = fill(graph, np.arange(3000))
    assert n_entries <= ordered.structure.n_entries < 2 * n_entries

"""Cost of a solve, counted rather than timed: factors, block solves, Ritz problems.

Faults in the plan of a solve, its initial estimates and its fallbacks mostly cost time or memory
and leave the eigenpairs correct. These tests detect such faults.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pytest
import scipy.sparse as sp
from hard_verdict import judge_seed
from scipy.sparse.linalg import LinearOperator, splu
from test_eigensolver import dense, random_mesh, torus
from test_eigensolver_hard import icosphere, strip
from tiers import slow

from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine import refinement
from meshmash_viewer.spectral.engine.basis import KrylovBasis, RitzPairs
from meshmash_viewer.spectral.engine.factorization import Factor

#: Counted calls: factorizations, new bases, solves of blocks of eight, passes over a whole basis,
#: searches for the eigenvalues nearest the shift, Ritz problems, refinements.
_COUNTED: dict[str, tuple[Any, str]] = {
    "factors": (Factor, "__init__"),
    "bases": (KrylovBasis, "__init__"),
    "blocks": (KrylovBasis, "_apply"),
    "passes": (KrylovBasis, "_project_known_out"),
    "searches": (KrylovBasis, "_find_nearest"),
    "looks": (RitzPairs, "__init__"),
    "refined": (refinement, "_polish"),
}
#: Tolerated factor over the counts of one machine, as rounding differs between machines. Counts
#: that depend on the moment of convergence may be larger by one.
_MARGIN = 1.12
_AT_THE_END = ("blocks", "passes", "searches", "looks")

#: Additional pairs requested from an inverse.
_BESIDE = 6

Ask: TypeAlias = Callable[[], Eigenpairs]


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the calls of each counted function."""
    counts: Counter[str] = Counter()

    def counting(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **options: Any) -> Any:
            counts[name] += 1
            return real(*given, **options)

        return call

    for name, (owner, method) in _COUNTED.items():
        monkeypatch.setattr(owner, method, counting(name, getattr(owner, method)))
    return counts


def assert_no_more(taken: Counter[str], most: tuple[int, ...]) -> None:
    found = {name: taken[name] for name in _COUNTED}
    for name, count in zip(_COUNTED, most, strict=True):
        spare = 1 if name in _AT_THE_END else 0
        assert found[name] <= _MARGIN * count + spare, f"{name}: {found} for {most}"


def plate() -> Any:
    return torus(60, 50, 1.0, 1.3)[0]


def twice() -> Any:
    """Return a pencil with every eigenvalue twice."""
    return random_mesh(8, copies=2)


@pytest.fixture(scope="module")
def known() -> Eigenpairs:
    return solve(*twice(), 140)


def spheres(copies: int) -> Any:
    stiffness, mass = icosphere(1)
    return sp.block_diag([stiffness] * copies).tocsc(), np.tile(mass.diagonal(), copies)


@pytest.mark.parametrize(
    ("ask", "most"),
    [
        pytest.param(
            lambda: solve(*plate(), 120, n_jobs=1),
            (7, 2, 61, 10, 7, 16, 0),
            id="two slices",
        ),
        pytest.param(
            lambda: solve(*random_mesh(2, 2), 30, n_jobs=1),
            (4, 1, 18, 3, 3, 6, 0),
            id="one slice",
        ),
        pytest.param(
            lambda: solve(*random_mesh(2, 2), 300, n_jobs=1),
            (9, 2, 111, 18, 5, 18, 0),
            id="of many pairs",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            lambda: solve(*twice(), 200, dtype="f4", n_jobs=1),
            (11, 4, 102, 15, 12, 27, 0),
            id="float32",
        ),
        pytest.param(
            lambda: solve(*twice(), 3, n_jobs=1),
            (9, 1, 10, 1, 1, 2, 0),
            id="one pair",
        ),
        pytest.param(
            lambda: solve(*icosphere(4), 225, n_jobs=1),
            (5, 2, 86, 12, 5, 17, 0),
            id="multiplets",
        ),
        pytest.param(
            lambda: solve(*spheres(18), 60, n_jobs=1),
            (49, 1, 45, 11, 4, 21, 1),
            id="many copies",
        ),
        pytest.param(
            lambda: solve(*strip(1500, 1e-9), 120, n_jobs=1),
            (6, 2, 56, 8, 6, 14, 0),
            id="close pairs",
        ),
        pytest.param(
            lambda: solve(*plate(), 60, sigma=3000.0, n_jobs=1),
            (19, 2, 50, 7, 7, 13, 0),
            id="around",
        ),
    ],
)
def test_a_solve_takes_no_more_than_it_needs(
    taken: Counter[str], ask: Ask, most: tuple[int, ...]
) -> None:
    assert ask().complete
    assert_no_more(taken, most)


@pytest.mark.parametrize(
    ("place", "most"),
    [("at", (37, 2, 51, 7, 6, 15, 0)), ("above", (5, 2, 52, 8, 7, 15, 0))],
)
def test_a_threshold_takes_no_more_than_it_needs(
    known: Eigenpairs, taken: Counter[str], place: str, most: tuple[int, ...]
) -> None:
    threshold = float(known.eigenvalues[100]) * (1.0 if place == "at" else 1.001)
    assert solve(*twice(), max_eigenvalue=threshold, n_jobs=1).complete
    assert_no_more(taken, most)


@pytest.mark.parametrize(
    ("wanted", "kept", "most"),
    [
        (200, 140, (18, 2, 51, 7, 7, 15, 0)),
        (140, 125, (18, 1, 37, 5, 3, 7, 0)),  # the slices are those of a run without known pairs
        (100, 140, (18, 0, 0, 0, 0, 0, 0)),
    ],
)
def test_what_is_known_is_not_found_again(
    known: Eigenpairs,
    taken: Counter[str],
    wanted: int,
    kept: int,
    most: tuple[int, ...],
) -> None:
    assert solve(*twice(), wanted, known=known.first(kept), n_jobs=1).complete
    assert_no_more(taken, most)


@pytest.mark.parametrize("lift", [0.0, 1.0])  # with a null space, and without
@pytest.mark.parametrize("place", [-1, slow(0), slow(7), 60])
def test_what_a_given_inverse_has_found_is_counted_and_not_found_again(
    taken: Counter[str], place: int, lift: float
) -> None:
    stiffness, mass = random_mesh(8)
    exact = dense((stiffness, mass))
    stiffness, exact = stiffness + lift * exact[1] * mass, exact + lift * exact[1]
    # below all eigenvalues, or between two
    shift = -exact[1] if place < 0 else 0.5 * float(exact[place] + exact[place + 1])
    solver = splu(sp.csc_matrix(stiffness - shift * mass)).solve
    inverse = LinearOperator(stiffness.shape, matvec=solver, dtype=np.float64)
    found = solve(stiffness, mass, 20, sigma=shift, op_inv=inverse, n_jobs=1)
    nearest = np.sort(np.argsort(np.abs(exact - max(shift, 0.0)), kind="stable")[:20])
    np.testing.assert_allclose(found.eigenvalues, exact[nearest], rtol=1e-9, atol=1e-9 * exact[1])
    assert found.complete
    low = found.certificate.low
    assert (low is None) == (nearest[0] == 0)
    if low is not None:
        assert exact[nearest[0] - 1 - _BESIDE] < low < exact[nearest[0]]
    assert_no_more(taken, (4, 0, 0, 0, 0, 0, 0))


@pytest.mark.parametrize(
    ("seed", "most"),
    [
        pytest.param(118, (14, 12, 228, 75, 37, 109, 0), id="a negative eigenvalue"),
        pytest.param(
            121, (25, 21, 215, 90, 23, 48, 0), id="two weak springs", marks=pytest.mark.slow
        ),
        pytest.param(
            412, (37, 10, 134, 38, 11, 31, 1), id="a float32 threshold beside an eigenvalue"
        ),
        pytest.param(
            514,
            (48, 19, 245, 82, 23, 62, 0),
            id="a threshold on the lowest",
            marks=pytest.mark.slow,
        ),
        pytest.param(12271, (77, 3, 82, 21, 18, 35, 0), id="a shifted sphere"),
        pytest.param(
            10784,
            (58, 6, 245, 39, 32, 97, 3),
            id="copies a millionth apart",
            marks=pytest.mark.slow,
        ),
        pytest.param(16434, (3, 1, 10, 1, 1, 2, 3), id="edges of 1e16"),
    ],
)
def test_trouble_has_an_end(taken: Counter[str], seed: int, most: tuple[int, ...]) -> None:
    verdict = judge_seed(seed)
    assert verdict.state == "right" or verdict.needed
    assert_no_more(taken, most)

from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.spectral.alignment import Alignment, ShownRows, align


@pytest.fixture
def mass(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.5, 1.5, size=200)


@pytest.fixture
def rows(rng: np.random.Generator, mass: np.ndarray) -> np.ndarray:
    """Eight M-orthonormal rows."""
    columns, _ = np.linalg.qr(rng.normal(size=(200, 8)))
    return columns.T / np.sqrt(mass)


VALUES = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 5.0])


def shown(rows: np.ndarray, alignment: Alignment, n_exact: int = 8) -> np.ndarray:
    return ShownRows(rows, n_exact, None, alignment)[:]


def test_signs_follow_what_was_shown(rows: np.ndarray, mass: np.ndarray) -> None:
    before = rows * np.array([1, -1, 1, 1, 1, -1, 1, -1])[:, None]
    alignment = align(before, rows, np.arange(8.0), mass)
    np.testing.assert_allclose(shown(rows, alignment), before)
    assert [alignment.sign(i) for i in range(8)] == [1, -1, 1, 1, 1, -1, 1, -1]


def test_multiplets_are_rotated_to_what_was_shown(
    rows: np.ndarray, mass: np.ndarray, rng: np.random.Generator
) -> None:
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    before = rows.copy()
    before[2:5] = rotation @ rows[2:5]
    alignment = align(before, rows, VALUES, mass)
    np.testing.assert_allclose(shown(rows, alignment), before, atol=1e-7)
    assert alignment.sign(3) is None
    assert alignment.sign(6) == 1.0


def test_rough_preview_is_enough_and_what_is_drawn_stays_orthonormal(
    rows: np.ndarray, mass: np.ndarray, rng: np.random.Generator
) -> None:
    before = -rows + 0.03 * rng.normal(size=rows.shape)
    before[:, 7] = np.nan
    drawn = shown(rows, align(before.astype(np.float32), rows, VALUES, mass))
    np.testing.assert_allclose(drawn @ (drawn * mass).T, np.eye(8), atol=1e-12)
    assert np.all(np.sum(drawn * -rows * mass, axis=1)[[0, 1, 5, 6, 7]] > 0.99)


def test_alignment_grows_with_the_exact_rows(rows: np.ndarray, mass: np.ndarray) -> None:
    before = -rows
    early = align(before, rows, VALUES[:4], mass)  # ends within the multiplet
    late = align(before, rows, VALUES, mass, early)
    np.testing.assert_allclose(shown(rows, late), before)
    assert [start for start, _ in late.blocks] == [0, 1, 2, 5, 6, 7]


def test_nothing_in_common_turns_nothing(mass: np.ndarray, rows: np.ndarray) -> None:
    alignment = align(np.zeros_like(rows), rows, VALUES, mass)
    np.testing.assert_allclose(shown(rows, alignment), rows)


def test_rows_read_like_an_array(rows: np.ndarray, rng: np.random.Generator) -> None:
    preview = rng.normal(size=(10, 200))
    flip = Alignment(((0, np.array([[-1.0]])), (2, np.array([[0.0, 1.0], [-1.0, 0.0]]))))
    whole = np.concatenate([rows[:6], preview[6:]])
    whole[0] *= -1.0
    whole[2:4] = np.array([[0.0, 1.0], [-1.0, 0.0]]) @ rows[2:4]
    spliced = ShownRows(rows, 6, preview, flip)
    assert spliced.shape == (10, 200)
    assert len(spliced) == 10
    for key in (3, -1, slice(1, 8), np.array([0, 9, 2]), (slice(0, 8), 17), (2, slice(5, 50))):
        np.testing.assert_allclose(spliced[key], whole[key])
    np.testing.assert_allclose(
        spliced[np.array([1, 7]), slice(10, 20)], whole[np.array([1, 7]), 10:20]
    )
    assert spliced[5:5].shape == (0, 200)
    assert spliced.dtype == whole.dtype
    assert np.asarray(spliced[:]).dtype == whole.dtype

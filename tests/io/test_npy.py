"""NPY files that grow while they are mapped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshmash_viewer.io.npy import create_rows, grow_rows, map_rows


@pytest.mark.parametrize("fill", [None, 7.0])
def test_rows_are_added_behind_those_that_are_there(fill: float | None, tmp_path: Path) -> None:
    path = tmp_path / "rows.npy"
    create_rows(path, (2, 5), np.float64, fill)
    before = map_rows(path, "r+", (2, 5))
    np.testing.assert_array_equal(before, fill or 0.0)
    before[:] = np.arange(10.0).reshape(2, 5)
    before.flush()
    grow_rows(path, 4, fill)
    after = map_rows(path, "r", (None, 5))
    assert after.shape == (4, 5)
    np.testing.assert_array_equal(after[:2], np.arange(10.0).reshape(2, 5))
    np.testing.assert_array_equal(after[2:], fill or 0.0)
    np.testing.assert_array_equal(before, after[:2])
    content = path.read_bytes()
    for fewer in (4, 1):
        grow_rows(path, fewer, fill)
        assert path.read_bytes() == content
    np.testing.assert_array_equal(np.load(path), after)


@pytest.mark.parametrize("shape", [(2, 4), (3, 5), (None, 4), (1, None), (2,), (2, 5, 1), (None,)])
def test_another_shape_is_refused(shape: tuple[int | None, ...], tmp_path: Path) -> None:
    path = tmp_path / "rows.npy"
    create_rows(path, (2, 5), np.float32)
    assert map_rows(path, "r", (None, None)).dtype == np.float32
    with pytest.raises(ValueError, match=r"has shape \(2, 5\)"):
        map_rows(path, "r", shape)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.npy"
    path.touch()
    with pytest.raises(ValueError, match="is empty"):
        map_rows(path, "r", (None,))
    np.save(path, np.asfortranarray(np.zeros((3, 4))))
    with pytest.raises(ValueError, match="not an array of rows"):
        grow_rows(path, 5)
    np.save(path, np.float64(3.0))
    with pytest.raises(ValueError, match="not an array of rows"):
        grow_rows(path, 5)

"""Work in stretches: every vertex once, whatever the number of processors."""

from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.model import stretches
from meshmash_viewer.model.stretches import extremes, in_stretches


@pytest.mark.parametrize("processors", [1, 2, 3, 4])
@pytest.mark.parametrize("count", [0, 1, 149_999, 300_000, 1_000_003])
def test_stretches_make_up_all_vertices(count, processors, monkeypatch) -> None:
    monkeypatch.setattr(stretches, "_processors", lambda: processors)
    touched = np.zeros(count, dtype=np.int64)

    def touch(part: slice) -> int:
        touched[part] += 1
        return part.stop - part.start

    lengths = in_stretches(count, touch)
    assert (touched == 1).all()
    assert sum(lengths) == count
    assert 1 <= len(lengths) <= processors


def test_a_fault_in_any_stretch_is_raised(monkeypatch) -> None:
    monkeypatch.setattr(stretches, "_processors", lambda: 3)

    def fail(part: slice) -> None:
        if part.start:
            raise ArithmeticError("in a later stretch")

    with pytest.raises(ArithmeticError, match="later stretch"):
        in_stretches(900_000, fail)


@pytest.mark.parametrize("place", [0, 450_000, 899_999])
def test_extremes_of_all_stretches_count(place, monkeypatch) -> None:
    monkeypatch.setattr(stretches, "_processors", lambda: 3)
    values = np.random.default_rng(0).random(900_000).astype(np.float32)
    values[place] = -2.0
    assert extremes(values) == (-2.0, values.max())
    values[place] = 3.0
    assert extremes(values) == (values.min(), 3.0)
    values[place] = np.nan
    assert np.isnan(extremes(values)).all()


@pytest.mark.parametrize("processors", [1, 3])
def test_values_are_written_before_they_are_looked_at(processors, monkeypatch) -> None:
    monkeypatch.setattr(stretches, "_processors", lambda: processors)
    row = np.random.default_rng(1).standard_normal(700_000)
    values = np.full(len(row), np.nan, dtype=np.float32)

    def write(part: slice) -> None:
        values[part] = row[part]

    assert extremes(values, write) == (np.float32(row.min()), np.float32(row.max()))
    np.testing.assert_array_equal(values, row.astype(np.float32))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_extremes_of_values_of_one_sign(sign) -> None:
    values = sign * np.linspace(2.0, 3.0, 200_001)
    assert extremes(values) == (values.min(), values.max())

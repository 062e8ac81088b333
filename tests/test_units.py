from __future__ import annotations

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import LENGTH_UNITS, NO_VOXEL, Voxel, parse_unit, written_unit


@pytest.mark.parametrize(
    ("text", "voxel", "unit", "written"),
    [
        ("nm", NO_VOXEL, "nm", "nm"),
        (" none ", NO_VOXEL, "", "none"),
        ("", NO_VOXEL, "", "none"),
        ("um", NO_VOXEL, "µm", "µm"),
        ("8 nm", (8.0, 8.0, 8.0), "nm", "8 nm"),
        ("1e-3mm", (1e-3, 1e-3, 1e-3), "mm", "0.001 mm"),
        ("1 nm", NO_VOXEL, "nm", "nm"),
        ("4 x 4 x 40 nm", (4.0, 4.0, 40.0), "nm", "4 × 4 × 40 nm"),
        ("4×4×40 nm", (4.0, 4.0, 40.0), "nm", "4 × 4 × 40 nm"),
        ("4,4,40nm", (4.0, 4.0, 40.0), "nm", "4 × 4 × 40 nm"),
        (".5 , 1e1 x 3.25 μm", (0.5, 10.0, 3.25), "µm", "0.5 × 10 × 3.25 µm"),
        ("8 x 8 x 8 nm", (8.0, 8.0, 8.0), "nm", "8 nm"),
    ],
)
def test_a_unit_is_read_and_written(text: str, voxel: Voxel, unit: str, written: str) -> None:
    assert parse_unit(text) == (voxel, unit)
    assert written_unit(unit, voxel) == written
    assert parse_unit(written) == (voxel, unit)


@pytest.mark.parametrize(
    "text",
    [
        "furlong", "8", "8 none", "0 nm", "-8 nm", "1e999 nm", "8 8 nm", "4 x 40 nm", "4,4,40",
        "4 x 4 x 0 nm", "4 x 4 x 4 x 4 nm", "4 x 4 x nm", "x nm", "4..2 nm", "4 nm x 4 nm", "8 nm!",
    ],
)  # fmt: skip
def test_what_is_no_unit_is_refused_with_what_is(text: str) -> None:
    with pytest.raises(InputError) as fault:
        parse_unit(text)
    assert repr(text) in str(fault.value)
    assert all(unit in str(fault.value) for unit in LENGTH_UNITS)
    assert "4 x 4 x 40 nm" in str(fault.value)

"""The wave kernel signature at one energy, compared with its definition."""

from __future__ import annotations

import numpy as np
import pytest
from solved import spectrum_of

from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import format_number, format_quantity


def test_values_are_those_of_aubry_2011(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    values, rows = spectrum.eigenvalues[1:], spectrum.rows[1:60]
    logs, width = np.log(values), 7.0
    step = (logs[-1] - logs[0]) / (10 - 1 + 4 * width)
    energy = logs[0] + step * (2 * width + 3)
    weights = np.exp(-((energy - logs) ** 2) / (2 * (width * step) ** 2))
    wanted = weights / weights.sum() @ rows**2
    chosen = WaveKernelSignature(index=3, count=10).resolved(spectrum, {})
    found = chosen.compute(spectrum, None)
    assert found is not None
    np.testing.assert_allclose(found.values, wanted, rtol=1e-5)
    assert chosen.place(spectrum) == pytest.approx(energy)
    assert chosen.quantity(spectrum, "nm") == (
        f"ln λ = {format_number(energy)} (λ = {format_quantity(np.exp(energy), 'nm', -2)})"
    )
    within = np.count_nonzero(np.abs(logs - energy) < width * step)
    reading = chosen.reading(spectrum, "nm")
    assert reading.facts[2:] == (format_number(width * step, 3), f"{within}")
    described = chosen.describe(spectrum, "nm")
    assert (described.title, described.unit("nm")) == ("Wave kernel signature", "nm⁻²")


def test_without_two_eigenvalues_above_zero_there_is_no_response() -> None:
    for values in ([0.0], [0.0, 2.0], [0.0, 2.0, 2.0]):
        rows = np.ones((len(values), 4))
        few = Eigenpairs(np.array(values), rows, np.zeros(len(values)))
        assert WaveKernelSignature().response(few, np.linspace(0.0, 2.0, 9)) is None
    more = Eigenpairs(np.array([0.0, 1.0, 2.0]), np.ones((3, 4)), np.zeros(3))
    assert WaveKernelSignature().response(more, np.linspace(0.0, 2.0, 9)) is not None

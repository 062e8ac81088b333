"""Filter fields: approximate while a slider moves, exact when it rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solved import spectrum_of

import meshmash_viewer as mv
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.fields.live_tables import build_pair_table
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import FieldRequest, LiveFeatures
from meshmash_viewer.spectral import eigenpairs as spectra
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: One colour step, relative to the maximum of a field.
_STEP = 4e-3


@pytest.fixture(scope="module")
def spectrum(rectangle: Mesh) -> Eigenpairs:
    return spectrum_of(rectangle, 200)


def dense(spectrum: Eigenpairs, weights: np.ndarray) -> np.ndarray:
    return accumulate_features(np.asarray(spectrum.rows[: len(spectrum)]), weights[None])[:, 0]


def filters_of(spectrum: Eigenpairs) -> dict[str, np.ndarray]:
    values = spectrum.eigenvalues
    first, last = float(values[1]), float(values[-1])
    found = {f"exp {t:.3g}": np.exp(-t * values) for t in np.geomspace(1 / last, 10 / first, 20)}
    found |= {f"below {at}": np.arange(200) < at for at in (1, 3, 17, 50, 131, 198)}
    found |= {f"band {a}-{b}": np.clip(values, values[a], values[b]) == values
              for a, b in ((3, 5), (20, 40), (99, 108))}  # fmt: skip
    near = np.log(np.maximum(values, 1e-9))
    found |= {f"wave {at}": np.exp(-np.square(near - near[at]) / 2) for at in (1, 20, 150)}
    found["smooth step"] = 1.0 / (1.0 + (values / values[77]) ** 8)
    found["one pair"] = np.eye(200)[120]
    found["none"] = np.zeros(200)
    return {name: np.asarray(weights, dtype=np.float64) for name, weights in found.items()}


def test_a_table_tells_any_filter_within_a_step_of_colour(spectrum: Eigenpairs) -> None:
    table = build_pair_table(spectrum)
    assert len(table.columns) <= 52
    for name, weights in filters_of(spectrum).items():
        wanted = dense(spectrum, weights)
        error = np.abs(table.at(weights, spectrum.rows) - wanted)
        # next to the two edges of a sharp band, more pairs differ than are added one by one
        allowed = (8.0 if name.startswith("band") else 1.0) * _STEP * wanted.max()
        assert error.max() <= allowed, name
        assert np.median(error) <= allowed / 4.0, name


def test_equal_eigenvalues_and_vertices_without_values(spectrum: Eigenpairs) -> None:
    rows = np.array(spectrum.rows[:6])
    rows[:, 7] = np.nan
    few = Eigenpairs(np.array([0.0, 0.0, 0.0, 2.0, 2.0, 5.0]), rows, np.zeros(6))
    table = build_pair_table(few)
    for weights in (np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.1]), np.zeros(6)):
        found = table.at(weights, rows)
        assert np.flatnonzero(np.isnan(found)).tolist() == [7]
        np.testing.assert_allclose(
            np.delete(found, 7), np.delete(dense(few, weights), 7), rtol=1e-5, atol=1e-6
        )


def test_a_large_mesh_is_near_while_it_moves_and_right_where_it_rests(
    spectrum: Eigenpairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spectra, "_SMALL", 0)
    live, columns = LiveFeatures(), None

    def asked(time: float) -> FieldRequest:
        chosen = Filters("exp(-t*x)").with_values(t=time)
        return FieldRequest(spectrum, "nm", chosen.resolved(spectrum, {}))

    for time in (0.01, 0.02, 0.05):
        request = asked(time)
        wanted = dense(spectrum, np.exp(-time * spectrum.eigenvalues))
        found = live.compute(request)
        assert found is not None
        assert found.draft == (columns is not None), "without a table there is the sum alone"
        assert not live.prepared(request)
        np.testing.assert_allclose(found.values, wanted, atol=_STEP * wanted.max())
        live.prepare(request)
        assert live.prepared(request)
        found = live.compute(request)
        assert found is not None
        assert not found.draft
        np.testing.assert_allclose(found.values, wanted, rtol=1e-6)
        table = live.tables.get("filter")
        assert table is not None
        assert columns is None or table.content.columns is columns, "it is built once"
        columns = table.content.columns
    more = replace(spectrum, eigenvalues=spectrum.eigenvalues[:150])
    found = live.compute(FieldRequest(more, "nm", asked(0.1).family))
    assert found is not None
    assert not found.draft, "the table is of other pairs"
    weights = np.exp(-0.1 * more.eigenvalues)
    np.testing.assert_allclose(found.values, dense(more, weights), rtol=1e-6)


def test_a_response_is_drawn_wherever_it_is_a_number(spectrum: Eigenpairs) -> None:
    along = np.linspace(0.0, float(spectrum.eigenvalues[-1]), 101)
    response = Filters("12 / abs(x - c)").with_values(c=float(along[50])).response(spectrum, along)
    heights = response.curve[1]
    assert np.flatnonzero(np.isnan(heights)).tolist() == [50]
    assert np.nanmax(heights) == 1.0
    assert "÷" in response.legend
    plain = Filters("exp(-t*x)").response(spectrum, along)
    assert "÷" not in plain.legend


def test_a_narrow_band_is_drawn(spectrum: Eigenpairs) -> None:
    along = np.linspace(0.0, float(spectrum.eigenvalues[-1]), 11)
    width = 1e-3 * along[1]
    low, high = along[3] + width, along[3] + 2.0 * width
    chosen = Filters(READY["Band-pass"]).with_values(a=low, b=high)
    places, heights = chosen.response(spectrum, along).curve
    assert heights.max() == 1.0
    assert np.trapezoid(heights, places) == pytest.approx(width, rel=1e-3)


@pytest.mark.parametrize("name", READY)
def test_every_ready_filter_says_what_truncation_costs_it(spectrum: Eigenpairs, name: str) -> None:
    family = Filters(READY[name]).resolved(spectrum, {})
    bank = family.bank(spectrum.eigenvalues)
    assert bank.tail is not None
    assert (bank(spectrum.eigenvalues) >= 0.0).all()
    assert len(spectrum.missing_shares(bank, 3.0)) == 1


def test_the_script_of_many_columns_makes_the_bank_of_the_export(spectrum: Eigenpairs) -> None:
    family = Filters(text="exp(-t*x)", automatic=False, low=0.01, high=3.0, count=5)
    made = eval(family.bank_script(), {"mv": mv, "np": np})
    wanted = np.exp(-np.geomspace(0.01, 3.0, 5)[:, None] * spectrum.eigenvalues)
    np.testing.assert_allclose(made(spectrum.eigenvalues), wanted, rtol=1e-12)
    np.testing.assert_allclose(family.bank(spectrum.eigenvalues)(spectrum.eigenvalues), wanted)

"""Spectrum of a map: Parseval, eigenfunctions and wavelengths."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.features.map_spectrum import MapSpectrum, band_edges
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@pytest.fixture(scope="module")
def mesh() -> mv.Mesh:
    return shapes.icosphere(2)


@pytest.fixture(scope="module")
def every_pair(mesh: mv.Mesh) -> Eigenpairs:
    L, M = mv.cotangent_laplacian(mesh, robust=True)
    return mv.solve(L, M, n_components=mesh.n_vertices)


def test_all_pairs_hold_all_of_the_energy(mesh, every_pair, rng) -> None:
    f = rng.standard_normal(mesh.n_vertices)
    found = mv.map_spectrum(every_pair, f)
    assert np.sum(found.coefficients**2) == pytest.approx(found.energy, rel=1e-10)
    assert found.energy == pytest.approx(np.sum(every_pair.mass * f**2), rel=1e-12)
    assert found.share(mesh.n_vertices) == pytest.approx(1.0, rel=1e-10)
    for k in (1, 10, 100):
        left = f - mv.reconstruct(every_pair.eigenvectors, found.coefficients[:k])
        norm = np.sqrt(np.sum(every_pair.mass * left**2) / found.energy)
        assert found.residual(k) == pytest.approx(norm, rel=1e-9)


@pytest.mark.parametrize("index", [0, 1, 17])
def test_an_eigenfunction_has_one_line(every_pair, index: int) -> None:
    found = mv.map_spectrum(every_pair, -3.0 * every_pair.eigenvectors[:, index])
    line = np.zeros(len(found))
    line[index] = -3.0
    np.testing.assert_allclose(found.coefficients, line, atol=1e-9)
    assert found.energy == pytest.approx(9.0)
    assert found.share(index) == pytest.approx(0.0, abs=1e-12)
    assert found.share(index + 1) == pytest.approx(1.0)
    assert found.residual(index + 1) < 1e-7
    if index:
        assert found.varying_share(index) == pytest.approx(0.0, abs=1e-12)
    assert found.varying_share(index + 1) == pytest.approx(1.0)


def test_the_mean_is_not_what_varies(every_pair) -> None:
    """Ten pairs have almost all of a map with a large mean, but half of its variation."""
    f = 10.0 + every_pair.eigenvectors[:, 5] + every_pair.eigenvectors[:, 50]
    found = mv.map_spectrum(every_pair, f)
    assert found.share(10) > 0.99
    assert found.varying_share(10) == pytest.approx(0.5)
    assert mv.map_spectrum(every_pair, np.full(len(f), 3.0)).varying_share(1) == 1.0


def test_where_there_is_no_value_the_mean_stands(mesh, every_pair) -> None:
    f = mesh.vertices[:, 0] + 2.0
    hole = mesh.vertices[:, 2] > 0.8
    mean = np.average(f[~hole], weights=every_pair.mass[~hole])
    wanted = mv.map_spectrum(every_pair, np.where(hole, mean, f))
    with pytest.warns(mv.MissingValuesWarning, match="no weight"):
        found = mv.map_spectrum(every_pair, np.where(hole, np.nan, f))
    np.testing.assert_allclose(found.coefficients, wanted.coefficients, atol=1e-12)


def test_stray_vertices_are_left_out(mesh) -> None:
    vertices = np.vstack([mesh.vertices, [5.0, 5.0, 5.0]])
    stray = mv.Mesh(vertices, mesh.faces)
    pairs = mv.solve(*mv.cotangent_laplacian(stray, robust=True), n_components=9)
    found = mv.map_spectrum(pairs, np.append(mesh.vertices[:, 0], 1e6))
    assert found.share(4) == pytest.approx(1.0, abs=1e-3), "x is one of the first three waves"
    assert mv.dominant_bands(found, pairs.rows)[-1] == -1
    with raises("wrong-shape", "one number per vertex"):
        mv.map_spectrum(pairs, np.ones(3))


def test_the_dominant_band_is_that_of_the_stronger_wave(every_pair) -> None:
    values = every_pair.eigenvalues
    edges = band_edges(values)
    assert edges[0] <= values[1] < edges[1]
    np.testing.assert_allclose(edges[1:] / edges[:-1], 2.0)
    assert edges[-2] <= values[-1] < edges[-1]
    long, short = (each * every_pair.eigenvectors[:, k] for each, k in ((2.0, 2), (2.0, 60)))
    found = mv.map_spectrum(every_pair, 7.0 + long + short)
    wanted = np.where(np.abs(long) > np.abs(short), *(np.searchsorted(edges, values[[2, 60]]) - 1))
    assert 0.2 < np.mean(wanted == wanted.max()) < 0.8
    clear = np.maximum(np.abs(long), np.abs(short)) > 1e-9  # not where both vanish
    bands = mv.dominant_bands(found, every_pair.rows)
    np.testing.assert_array_equal(bands[clear], wanted[clear])
    going_on = mv.dominant_bands(found, every_pair.rows, cancel=lambda: False)
    np.testing.assert_array_equal(going_on, bands)
    with pytest.raises(Cancelled):
        mv.dominant_bands(found, every_pair.rows, cancel=lambda: True)


def test_zeros_alone_have_no_bands(mesh) -> None:
    zeros = MapSpectrum(np.zeros(2), np.ones(2), 2.0)
    assert len(band_edges(zeros.eigenvalues)) == 0
    assert (mv.dominant_bands(zeros, np.ones((2, 5))) == -1).all()


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".npz"])
def test_coefficients_are_written(mesh, every_pair, tmp_path: Path, ending: str) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    errors = np.linspace(0.0, 0.1, every_pair.n_components)
    found = mv.map_spectrum(replace(every_pair, mesh_errors=errors), mesh.vertices[:, 2])
    path = tmp_path / f"made{ending}"
    mv.write_map_spectrum(path, found, mesh, "height")
    if ending == ".npz":
        with np.load(path) as archive:
            content = dict(archive)
        about = json.loads(str(content["meta"]))
    else:
        read = {".csv": pyarrow.csv.read_csv, ".parquet": pyarrow.parquet.read_table}[ending]
        table = read(path)
        content = {name: table[name].to_numpy() for name in table.column_names}
        if ending == ".csv":
            about = json.loads(path.with_name(path.name + ".json").read_text())
        else:
            about = json.loads(table.schema.metadata[b"meshmash-viewer"])
    np.testing.assert_allclose(content["coefficient"], found.coefficients, atol=1e-12)
    np.testing.assert_allclose(content["eigenvalue"], found.eigenvalues, atol=1e-12)
    np.testing.assert_allclose(content["mesh_error"], errors)
    assert content["pair"].tolist() == list(range(len(found)))
    assert content["share"][3] == pytest.approx(found.share(4))
    assert about["options"]["map_name"] == "height"
    assert about["options"]["energy"] == pytest.approx(found.energy)
    with raises("unknown-ending", "made.vtp"):
        mv.write_map_spectrum(tmp_path / "made.vtp", found, mesh)

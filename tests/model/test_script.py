from __future__ import annotations

import contextlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from listeners import Listener
from solved import spectrum_of

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.laplacian import OperatorOptions, compute_vertex_areas
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import LiveFeatures, compute_field, request_of
from meshmash_viewer.model.jobs import InspectJob, ReadJob, RepairJob, ScaleJob
from meshmash_viewer.model.script import reproduction_script
from meshmash_viewer.spectral.alignment import Alignment, ShownRows

VOXEL = (4.0, 4.0, 40.0)


@pytest.fixture
def document(neuron: Mesh, tmp_path: Path) -> Document:
    """A neuron that was read in voxels and repaired, with the pairs of what came out."""
    path = tmp_path / "my neuron.npz"
    np.savez(path, vertices=neuron.vertices, faces=neuron.faces)
    document = Document()
    document.accept_mesh(ReadJob(path, "none").run(Listener(tmp_path)))
    before = document.ready
    scaled = ScaleJob(before.mesh, VOXEL, "nm", before.path).run(Listener(tmp_path))
    document.accept_mesh(scaled)
    repair = RepairJob(document.mesh, "keep_largest_component", document.path)
    document.accept_mesh(repair.run(Listener(tmp_path)))
    spectrum = spectrum_of(document.mesh, 30)
    areas = compute_vertex_areas(document.mesh, robust=True)
    document.accept_spectrum(replace(spectrum, operator=OperatorOptions(), mass=areas))
    return document


@pytest.mark.parametrize("kind", list(FAMILIES))
def test_script_makes_the_field_again(document: Document, tmp_path: Path, kind: str) -> None:
    document.display.kind = kind
    document.display.change(Eigenfunctions, index=4)
    document.display.change(Eigenfunctions, flipped=frozenset({4}))
    document.display.change(Similarity, vertex=11)
    document.display.change(Similarity, basis="hks")
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    shown = compute_field(request, live).values
    code = reproduction_script(document) + "\nnp.save('values.npy', values)\n"
    if "import numpy" not in code:
        code = "import numpy as np\n" + code
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert ("complete" in done.stdout) == ("mv.solve" in code), "a map as it is needs no pairs"
    made = np.load(tmp_path / "values.npy")
    np.testing.assert_allclose(shown, made, atol=3e-3 * np.nanmax(np.abs(made)))
    assert len(list(tmp_path.glob("my neuron_*"))) == 1


@pytest.mark.parametrize("view", ["map", "pairs", "band"])
def test_script_reads_the_maps_that_were_added(
    document: Document, tmp_path: Path, view: str
) -> None:
    path, mesh = tmp_path / "depth.npy", document.mesh
    np.save(path, mesh.vertices[:, 0])
    document.accept_maps(mesh, read_maps(path, mesh))
    document.display.change(OwnMaps, view=view, pairs=7)
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    shown = compute_field(request, live).values
    code = reproduction_script(document)
    made: dict[str, object] = {}
    with contextlib.chdir(tmp_path):
        exec(code, made)
    values = np.asarray(made["values"], dtype=np.float64)
    if view == "band":
        assert np.mean(values == shown) > 0.98
    else:
        np.testing.assert_allclose(shown, values, atol=3e-3 * np.nanmax(np.abs(values)))
    document.remove_map("depth.npy")
    assert "read_maps" not in reproduction_script(document)


def test_unit_text_is_what_opens_the_file_again(document: Document, tmp_path: Path) -> None:
    assert document.unit_text == "4 × 4 × 40 nm"
    again = ReadJob(document.path, document.unit_text).run(Listener(tmp_path))
    assert again.mesh.voxel == VOXEL
    assert again.mesh.unit == "nm"
    repair = RepairJob(again.mesh, "keep_largest_component").run(Listener(tmp_path))
    assert repair.mesh.content_hash == document.mesh.content_hash
    assert Document().unit_text == ""


def test_mesh_in_memory_leaves_a_line_to_fill_in(sphere: Mesh, tmp_path: Path) -> None:
    document = Document()
    assert reproduction_script(document) == "import meshmash_viewer as mv\n"
    document.accept_mesh(InspectJob(sphere).run(Listener(tmp_path)))
    script = reproduction_script(document)
    assert "in memory" in script
    compile(script, "script", "exec")


def test_signs_that_follow_a_preview_are_in_the_script(document: Document) -> None:
    document.display.change(Eigenfunctions, index=4)
    plain = reproduction_script(document)
    spectrum = document.spectrum
    turn = Alignment(((4, np.array([[-1.0]])), (5, np.eye(2))))
    shown = ShownRows(spectrum.rows, len(spectrum), None, turn)
    document.accept_spectrum(replace(spectrum, shown=shown))
    turned = reproduction_script(document)
    assert "-decomposition" not in plain
    assert "-decomposition" in turned
    document.flip()
    assert reproduction_script(document) == plain
    document.display.change(Eigenfunctions, index=5)
    assert "multiplet" in reproduction_script(document)


@pytest.mark.parametrize("measure", ["geodesic", "biharmonic", "commute", "diffusion"])
def test_script_measures_from_the_pin_and_writes_what_is_exported(
    document: Document, tmp_path: Path, measure: str
) -> None:
    document.display.kind = "distance"
    document.display.change(Distances, vertex=11, measure=measure)
    if measure == "diffusion":
        low, high = document.spectrum.time_range
        document.display.change(Distances, time=0.3 * low + 0.7 * high)
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    shown = compute_field(request, live).values
    code = reproduction_script(document)
    assert ("mv.solve" in code) == (measure != "geodesic"), "along the surface it needs no pairs"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "my neuron_distance.npz") as file:
        assert file["columns"].tolist() == [f"{measure}_from_11"]
        made = file["features"][:, 0]
    np.testing.assert_allclose(shown, made, atol=5e-3 * np.nanmax(made))


def test_a_script_of_a_map_that_also_rebuilds_the_shape_decomposes_once(
    document: Document, tmp_path: Path
) -> None:
    document.display.kind = "map"
    document.display.shape = replace(document.display.shape, shown=True, pairs=10)
    code = reproduction_script(document)
    assert code.count("\ndecomposition =") == 1
    with contextlib.chdir(tmp_path):
        exec(code, {})

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from listeners import Listener
from solved import spectrum_of
from tiers import slow, slow_but

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.io.write import unused_path
from meshmash_viewer.laplacian import OperatorOptions, compute_vertex_areas, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import Export
from meshmash_viewer.model.field import LiveFeatures, compute_field, request_of
from meshmash_viewer.model.jobs import prepare
from meshmash_viewer.model.script import Exported, reproduction_script, script_output
from meshmash_viewer.spectral.alignment import Alignment
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.units import written_unit
from meshmash_viewer.vertex_map import VertexMap

pytestmark = pytest.mark.usefixtures("read_here")
VOXEL = (4.0, 4.0, 40.0)
LARGEST = "keep_largest_component"


@pytest.fixture
def document(neuron: Mesh, tmp_path: Path) -> Document:
    """A neuron read in voxels and repaired, with the pairs of the repaired mesh."""
    path = tmp_path / "my neuron.npz"
    np.savez(path, vertices=neuron.vertices, faces=neuron.faces)
    document = Document()
    document.accept_mesh(prepare(path, Listener(tmp_path), unit="none").content)
    before = document.ready
    scaled = prepare(
        before.mesh, Listener(tmp_path), unit=written_unit("nm", VOXEL), path=path
    ).content
    document.accept_mesh(scaled)
    repaired = prepare(document.mesh, Listener(tmp_path), path=path, repairs=(LARGEST,))
    document.accept_mesh(repaired.content)
    spectrum = spectrum_of(document.mesh, 30)
    areas = compute_vertex_areas(document.mesh, robust=True)
    document.accept_spectrum(replace(spectrum, operator=OperatorOptions(), mass=areas))
    return document


@pytest.mark.parametrize(
    "kind", slow_but(["eigenfunction", "hks", "similarity", "distance", "map"], FAMILIES)
)
@pytest.mark.filterwarnings("ignore::meshmash_viewer.errors.TruncationWarning")
def test_script_makes_the_field_again(
    document: Document, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    document.display.kind = kind
    document.display.change(Eigenfunctions, index=4)
    document.display.change(Eigenfunctions, flipped=frozenset({4}))
    document.display.change(Similarity, vertex=11)
    document.display.change(Similarity, basis="hks")
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    shown = compute_field(request, live).values
    code = reproduction_script(document)
    variables: dict[str, object] = {}
    with contextlib.chdir(tmp_path):
        exec(code, variables)
    printed = capsys.readouterr().out
    assert ("complete" in printed) == ("mv.solve" in code), "a map as it is needs no pairs"
    made = np.asarray(variables["values"], dtype=np.float64)
    np.testing.assert_allclose(shown, made, atol=3e-3 * np.nanmax(np.abs(made)))
    assert len(list(tmp_path.glob("my neuron_*"))) == 1


def test_a_script_rotates_within_a_multiplet(sphere: Mesh) -> None:
    spectrum = spectrum_of(sphere, 10)
    chosen = Eigenfunctions(index=5, flipped=frozenset({5}), rotation=(5, 7, 40))
    described = chosen.describe(spectrum, "").quantity
    assert described.endswith(" · rotated by 40° towards φ₇ in the space of 5")
    assert "without the rotation shown" in chosen.exported_columns(spectrum, "")[1]
    assert "a space of at least 4" in chosen.describe(spectrum_of(sphere, 8), "").quantity
    shown = chosen.compute(spectrum, None).values
    variables = {"np": np, "decomposition": spectrum}
    exec("\n".join(chosen.script(spectrum)), variables)
    np.testing.assert_allclose(shown, variables["values"], atol=1e-6)


@pytest.mark.slow
def test_a_script_runs_by_itself(document: Document, tmp_path: Path) -> None:
    """A new interpreter runs the script without warnings."""
    done = subprocess.run(
        [sys.executable, "-c", reproduction_script(document)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "complete" in done.stdout
    assert len(list(tmp_path.glob("my neuron_*"))) == 1


@pytest.mark.parametrize("view", ["map", "pairs", "band"])
def test_script_reads_the_maps_that_were_added(
    document: Document, tmp_path: Path, view: str
) -> None:
    path, mesh = tmp_path / "depth.npy", document.mesh
    np.save(path, mesh.vertices[:, 0])
    with contextlib.chdir(tmp_path):
        document.maps.add(mesh, read_maps(path.name, mesh))
    document.display.change(OwnMaps, view=view, pairs=7)
    live, request = LiveFeatures(), request_of(document)
    live.prepare(request)
    shown = compute_field(request, live).values
    code = reproduction_script(document)
    for named in re.findall(r"read_(?:mesh|maps)\('([^']*)'", code):
        assert Path(named).is_absolute(), named
    assert code.count("unused_path(") == code.count("unused_path(folder / ")
    assert repr(str(path)) in code
    made: dict[str, object] = {}
    with contextlib.chdir(tmp_path):
        exec(code.replace("folder = Path()", f"folder = Path({str(tmp_path)!r})"), made)
    assert len(list(tmp_path.glob("my neuron_*"))) == 1
    values = np.asarray(made["values"], dtype=np.float64)
    if view == "band":
        assert np.mean(values == shown) > 0.98
    else:
        np.testing.assert_allclose(shown, values, atol=3e-3 * np.nanmax(np.abs(values)))
    document.maps.remove("depth.npy")
    assert "read_maps" not in reproduction_script(document)


def test_a_map_that_is_in_no_file_is_exported_and_read_as_the_script_says(
    document: Document, tmp_path: Path
) -> None:
    mesh = document.mesh
    assert "in no file" not in reproduction_script(document)
    document.maps.add(mesh, [VertexMap("soma depth", mesh.vertices[:, 0])])
    code = reproduction_script(document)
    assert "# The map 'soma depth' is in no file as shown. Export it (File, Export," in code
    compile(code, "script", "exec")
    path = tmp_path / "maps.npz"
    Export(document.mesh, OperatorOptions(), path, None, 30)(Listener(tmp_path))
    made: dict[str, object] = {}
    with contextlib.chdir(tmp_path):
        exec(code.replace("# mesh = mesh.with", "mesh = mesh.with"), made)
    np.testing.assert_allclose(made["values"], mesh.vertices[:, 0], rtol=1e-6)
    document.display.kind = "eigenfunction"
    assert "in no file" not in reproduction_script(document), "it is not used"


def test_unit_text_is_what_opens_the_file_again(document: Document, tmp_path: Path) -> None:
    assert document.unit_text == "4 × 4 × 40 nm"
    again = prepare(document.path, Listener(tmp_path), unit=document.unit_text).content
    assert again.mesh.voxel == VOXEL
    assert again.mesh.unit == "nm"
    repair = prepare(again.mesh, Listener(tmp_path), repairs=(LARGEST,)).content
    assert repair.mesh.content_hash == document.mesh.content_hash
    assert Document().unit_text == ""


def test_mesh_in_memory_leaves_a_line_to_fill_in(sphere: Mesh, tmp_path: Path) -> None:
    document = Document()
    assert reproduction_script(document) == "import meshmash_viewer as mv\n"
    document.accept_mesh(prepare(sphere, Listener(tmp_path)).content)
    script = reproduction_script(document)
    assert "in memory" in script
    compile(script, "script", "exec")


def test_signs_that_follow_a_preview_are_in_the_script(document: Document) -> None:
    document.display.change(Eigenfunctions, index=4)
    plain = reproduction_script(document)
    spectrum = document.spectrum
    turn = Alignment(((4, np.array([[-1.0]])), (5, np.eye(2))))
    document.accept_spectrum(replace(spectrum, alignment=turn))
    turned = reproduction_script(document)
    assert "-decomposition" not in plain
    assert "-decomposition" in turned
    document.flip()
    assert reproduction_script(document) == plain
    document.display.change(Eigenfunctions, index=5)
    assert "multiplet" in reproduction_script(document)


@pytest.mark.parametrize("measure", ["geodesic", slow("biharmonic"), slow("commute"), "diffusion"])
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
    with contextlib.chdir(tmp_path):
        exec(code, {})
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


#: Families with exported columns and various parameters, and whether with a map.
EXPORTED = (
    slow(HeatKernelSignature(scales=1), False),
    (HeatKernelSignature(scales=7), True),
    slow(GeometryVectors(count=5), False),
    slow(WaveKernelSignature(count=6), False),
    *(
        pytest.param(Filters(text, count=count), False, marks=pytest.mark.slow if number else ())
        for number, text in enumerate(READY.values())
        for count in (1, 4)
    ),
    (Distances(measure="geodesic"), True),
    (Distances(measure="biharmonic"), False),
)


@pytest.mark.parametrize(("family", "mapped"), EXPORTED)
@pytest.mark.filterwarnings("ignore::meshmash_viewer.errors.TruncationWarning")
def test_script_writes_the_columns_of_the_export_and_overwrites_nothing(
    document: Document, tmp_path: Path, family: Family, mapped: bool
) -> None:
    for vertex in (11, 40, 7):
        document.pins.toggle(vertex)
    if mapped:
        path, mesh = tmp_path / "depth.npy", document.mesh
        np.save(path, mesh.vertices[:, 0])
        document.maps.add(mesh, read_maps(path, mesh))
    if isinstance(family, Distances):
        family = replace(family, vertex=40)
    document.display.show(family)
    output = tmp_path / script_output(document)
    assert output.name == f"my neuron_{family.export}.npz"
    output.write_text("a table of last week")
    mesh, spectrum = document.mesh, document.spectrum
    pairs = solve(*cotangent_laplacian(mesh, robust=True), len(spectrum))
    shown = family.measured_from([11, 40, 7]).resolved(spectrum, document.display.fields)
    expected = shown.compute_features(pairs, mesh)
    expected = expected.with_maps(mesh) if mapped else expected
    code = reproduction_script(document)
    with contextlib.chdir(tmp_path):
        for number in (2, 3):
            exec(code, {})
            with np.load(tmp_path / f"my neuron_{family.export}_{number}.npz") as file:
                assert file["columns"].tolist() == list(expected.columns)
                np.testing.assert_allclose(file["features"], expected.values, rtol=1e-5)
    assert output.read_text() == "a table of last week"


@pytest.mark.filterwarnings("ignore::meshmash_viewer.errors.TruncationWarning")
def test_script_writes_the_columns_that_the_dialog_was_asked_for(
    document: Document, tmp_path: Path
) -> None:
    mesh, spectrum = document.mesh, document.spectrum
    document.display.show(HeatKernelSignature(scales=32))
    asked = HeatKernelSignature(scales=5).resolved(spectrum, document.display.fields)
    exported = Exported(mesh.content_hash, asked, len(spectrum), maps=False)
    for known, count in ((exported, 5), (exported._replace(mesh_hash="another"), 32)):
        with contextlib.chdir(tmp_path):
            exec(reproduction_script(document, None, known), {})
        newest = max(tmp_path.glob("my neuron_hks*"), key=lambda path: path.stat().st_mtime_ns)
        with np.load(newest) as file:
            assert len(file["columns"]) == count


def test_a_path_that_is_free(tmp_path: Path) -> None:
    for name in ("a.npz", "a_2.npz", "t=0.5.func.gii", "b.npy.json", "c"):
        (tmp_path / name).write_text("there")
    (tmp_path / "d.npz").symlink_to("gone")
    (tmp_path / "e.npz").mkdir()
    expected = {
        "a.npz": "a_3.npz", "t=0.5.func.gii": "t=0.5_2.func.gii", "b.npy": "b_2.npy", "c": "c_2",
        "d.npz": "d_2.npz", "e.npz": "e_2.npz", "new.npz": "new.npz",
    }  # fmt: skip
    assert {name: unused_path(tmp_path / name).name for name in expected} == expected

"""Progress reports, labels and results of jobs."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
import shapes
from listeners import Listener

import meshmash_viewer.io.spectrum as spectrum
import meshmash_viewer.model.jobs as jobs
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.export import ExportJob
from meshmash_viewer.model.jobs import (
    DecomposeJob,
    InspectJob,
    PreviewJob,
    ReadJob,
    RepairJob,
    ScaleJob,
)
from meshmash_viewer.spectral.weyl import Target

PLAIN = OperatorOptions(robust=False)


@pytest.fixture
def listener(tmp_path: Path) -> Listener:
    return Listener(tmp_path)


@pytest.fixture
def file(sphere: Mesh, tmp_path: Path) -> Path:
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=sphere.vertices, faces=sphere.faces)
    return path


def test_a_mesh_is_read_in_the_unit_given_or_in_that_of_its_file(
    file: Path, sphere: Mesh, listener: Listener, tmp_path: Path
) -> None:
    ready = ReadJob(file).run(listener).content
    assert (ready.mesh.unit, ready.mesh.name, ready.path) == ("", "ball", file)
    assert (ready.repairs, ready.derived) == ((), False)
    assert listener.reports[0].message == "Reading ball.npz"
    assert ReadJob(file, "µm").run(listener).content.mesh.unit == "µm"
    from nibabel.freesurfer import write_geometry

    surface = tmp_path / "lh.pial"
    write_geometry(str(surface), sphere.vertices, sphere.faces, create_stamp="")
    assert ReadJob(surface).run(listener).content.mesh.unit == "mm"
    assert ReadJob(surface, "nm").run(listener).content.mesh.unit == "nm"


def test_other_voxels_and_repairs_are_derived_and_add_up(sphere: Mesh, listener: Listener) -> None:
    path = Path("ball.ply")
    scaled = ScaleJob(sphere, (2.0, 2.0, 4.0), "nm", path, repairs=("one",)).run(listener).content
    np.testing.assert_allclose(scaled.mesh.vertices, sphere.vertices * [2.0, 2.0, 4.0])
    assert (scaled.mesh.unit, scaled.path) == ("nm", path)
    assert (scaled.repairs, scaled.derived) == (("one",), True)
    listener.reports.clear()
    name = "drop_duplicate_faces"
    mended = RepairJob(scaled.mesh, name, path, earlier=("one",)).run(listener).content
    assert (mended.repairs, mended.derived, mended.path) == (("one", name), True, path)
    assert listener.reports[0].message == REPAIRS[name].label


def test_stored_pairs_are_checked_while_the_mesh_is_measured(
    sphere: Mesh, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mesh with many stored pairs is displayed as early as one without."""
    checking, health = threading.Event(), jobs.mesh_health
    find = spectrum.find_eigenpairs

    def checked(*given: object, **options: object) -> object:
        checking.set()
        return find(*given, **options)

    def measured(mesh: Mesh) -> object:
        assert checking.wait(60.0), "the pairs are checked only afterwards"
        return health(mesh)

    DecomposeJob(sphere, PLAIN, Target("count", 8)).run(listener)
    monkeypatch.setattr(spectrum, "find_eigenpairs", checked)
    monkeypatch.setattr(jobs, "mesh_health", measured)
    assert len(InspectJob(sphere, PLAIN).run(listener).content.known) == 8


def test_each_job_looks_for_the_pairs_of_its_own_operator(
    file: Path, sphere: Mesh, listener: Listener
) -> None:
    DecomposeJob(sphere, PLAIN, Target("count", 8)).run(listener)
    name = "drop_duplicate_faces"
    for job in (
        ReadJob(file, operator=PLAIN),
        InspectJob(sphere, PLAIN),
        ScaleJob(sphere, (1.0, 1.0, 1.0), "", operator=PLAIN),
        RepairJob(sphere, name, operator=PLAIN),
    ):
        known = job.run(listener).content.known
        assert known is not None
        assert len(known) == 8
        assert known.operator == PLAIN
    for job in (ReadJob(file), InspectJob(sphere), RepairJob(sphere, name)):
        assert job.operator == OperatorOptions()
        assert job.run(listener).content.known is None


def test_what_is_ready_is_all_that_a_render_needs(neuron: Mesh, listener: Listener) -> None:
    ready = InspectJob(neuron).run(listener).content
    np.testing.assert_array_equal(ready.normals, neuron.vertex_normals)
    np.testing.assert_array_equal(ready.sample, neuron.area_sample())
    assert ready.health.n_components == neuron.n_components


def test_a_preview_is_made_of_large_meshes_alone(
    sphere: Mesh, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    from meshmash_viewer.model import decomposition as previews

    assert PreviewJob(sphere).run(listener).content is None
    monkeypatch.setattr(previews, "FROM_VERTICES", 1000)
    grew = PreviewJob(shapes.rectangle(50, 50), PLAIN).run(listener).content
    assert grew is not None
    assert grew.preview
    assert grew.operator == PLAIN
    assert grew.n_exact == 0
    assert not grew.complete


@pytest.mark.parametrize("mesh_name", ["ball", ""])
def test_jobs_say_what_they_are_at(sphere: Mesh, mesh_name: str) -> None:
    mesh = Mesh(sphere.vertices, sphere.faces, name=mesh_name)
    shown = mesh_name or "the mesh"
    assert ReadJob(Path("folder/ball.ply")).label == "Reading ball.ply"
    assert InspectJob(mesh).label == f"Inspecting {shown}"
    assert ScaleJob(mesh, (1.0, 1.0, 1.0), "").label == f"Scaling {shown}"
    assert RepairJob(mesh, "x").label == f"Repairing {shown}"
    assert PreviewJob(mesh).label == f"Previewing {shown}"
    assert shown in DecomposeJob(mesh, PLAIN, Target()).label
    assert "out.npz" in ExportJob(mesh, PLAIN, Path("out.npz"), Eigenfunctions(), 5).label

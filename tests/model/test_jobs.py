"""Meshes that jobs prepare, and how jobs queue."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from listeners import Listener

import meshmash_viewer.io.spectrum as spectrum
import meshmash_viewer.model.jobs as jobs
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.jobs import Job, Queueing, prepare
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
    ready = prepare(file, listener).content
    assert (ready.mesh.unit, ready.mesh.name, ready.path) == ("", "ball", file)
    assert (ready.repairs, ready.derived) == ((), False)
    assert listener.reports[0].message == "Reading ball.npz"
    assert prepare(file, listener, unit="µm").content.mesh.unit == "µm"
    from nibabel.freesurfer import write_geometry

    surface = tmp_path / "lh.pial"
    write_geometry(str(surface), sphere.vertices, sphere.faces, create_stamp="")
    assert prepare(surface, listener).content.mesh.unit == "mm"
    assert prepare(surface, listener, unit="nm").content.mesh.unit == "nm"


def test_other_voxels_and_repairs_are_derived_and_add_up(sphere: Mesh, listener: Listener) -> None:
    path = Path("ball.ply")
    scaled = prepare(sphere, listener, unit="2 x 2 x 4 nm", path=path, earlier=("one",)).content
    np.testing.assert_allclose(scaled.mesh.vertices, sphere.vertices * [2.0, 2.0, 4.0])
    assert (scaled.mesh.unit, scaled.path) == ("nm", path)
    assert (scaled.repairs, scaled.derived) == (("one",), True)
    listener.reports.clear()
    name = "drop_duplicate_faces"
    repaired = prepare(scaled.mesh, listener, path=path, earlier=("one",), repairs=(name,)).content
    assert (repaired.repairs, repaired.derived, repaired.path) == (("one", name), True, path)
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

    decompose(sphere, PLAIN, Target("count", 8), listener)
    monkeypatch.setattr(spectrum, "find_eigenpairs", checked)
    monkeypatch.setattr(jobs, "mesh_health", measured)
    assert len(prepare(sphere, listener, operator=PLAIN).content.known) == 8


def test_pairs_of_the_own_operator_are_looked_up(
    file: Path, sphere: Mesh, listener: Listener
) -> None:
    decompose(sphere, PLAIN, Target("count", 8), listener)
    repairs = ("drop_duplicate_faces",)
    for source, given in (
        (file, {}), (sphere, {}), (sphere, {"unit": "none"}), (sphere, {"repairs": repairs})
    ):  # fmt: skip
        known = prepare(source, listener, operator=PLAIN, **given).content.known
        assert (len(known), known.operator) == (8, PLAIN)
        assert prepare(source, listener, **given).content.known is None


def test_what_is_ready_is_all_that_a_render_needs(neuron: Mesh, listener: Listener) -> None:
    ready = prepare(neuron, listener).content
    np.testing.assert_array_equal(ready.normals, neuron.vertex_normals)
    np.testing.assert_array_equal(ready.sample, neuron.area_sample())
    assert ready.health.n_components == neuron.n_components


def test_a_job_replaces_all_those_of_its_kind_or_none() -> None:
    """Pairs of running and new job, and whether the new one takes its place."""
    read, repair = (Job(doing, "", print) for doing in ("Reading", "Repairing"))
    preview, solve = (
        Job(doing, "", print, queueing=Queueing.NEWEST) for doing in ("Previewing", "Decomposing")
    )
    export = Job("Writing", "", print, queueing=Queueing.COMPLETE)
    jobs = read, repair, preview, solve, export
    assert [[new.replaces(old) for old in jobs] for new in jobs] == [
        [True, True, True, True, False],
        [True, True, True, True, False],
        [False, False, True, False, False],
        [False, False, False, True, False],
        5 * [False],
    ]
    assert [each.label for each in (read, Job("Writing", "a.npz", print))] == [
        "Reading the mesh", "Writing a.npz",
    ]  # fmt: skip

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import shapes
from listeners import Listener

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import previews
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob, Job, PreviewJob
from meshmash_viewer.model.process import child_command, prepare_preview
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.spectral.weyl import Target


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> Mesh:
    monkeypatch.setattr(previews, "FROM_VERTICES", 1000)
    return shapes.rectangle(60, 60, 1.0, 1.0001)


def test_a_preview_made_early_is_the_one_that_is_asked_for(large: Mesh, tmp_path: Path) -> None:
    early = Listener(tmp_path)
    prepare_preview(large, early, lambda: None)
    assert early.reports == []
    asked = Listener(tmp_path)
    grew = PreviewJob(large).run(asked)
    assert grew is not None
    assert asked.reports == []
    assert np.isfinite(grew.spectrum.rows[3]).all()


def test_it_is_reported_once_it_is_asked_for(large: Mesh, tmp_path: Path) -> None:
    early, same = Listener(tmp_path), Mesh(large.vertices, large.faces)
    job = DecomposeJob(same, OperatorOptions(), Target("count", 10))
    prepare_preview(large, early, lambda: job)
    assert [progress.stage for progress in early.reports] == ["preview"]
    assert previews.open_preview(large, Listener(tmp_path)) is not None


@pytest.mark.parametrize("other", [InspectJob, PreviewJob])
def test_it_gives_way_to_other_jobs(large: Mesh, tmp_path: Path, other: type[Job]) -> None:
    moved = Mesh(large.vertices + 1.0, large.faces)
    prepare_preview(large, Listener(tmp_path), lambda: other(moved))
    assert not list(tmp_path.glob("preview-*.npz"))


@pytest.fixture
def wire(tmp_path: Path) -> Iterator[Wire]:
    """The window's end of a pipe to a process that does jobs."""
    process = subprocess.Popen(
        child_command(tmp_path),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    wire = Wire(cast(Any, process.stdout), cast(Any, process.stdin), tmp_path)
    yield wire
    wire.close()
    process.wait()


def done(wire: Wire, job: Job) -> Any:
    wire.send(("run", job))
    while True:
        how, what = cast(tuple[str, Any], wire.receive())
        if how not in ("progressed", "sent"):
            assert how == "finished", what
            return what


def test_a_mesh_of_the_same_name_is_not_taken_for_the_one_before(wire: Wire, sphere: Mesh) -> None:
    named = Mesh(sphere.vertices, sphere.faces, name="ball")
    other = Mesh(2.0 * sphere.vertices, sphere.faces, name="ball")
    for mesh in (named, other, named.in_unit("nm"), named.in_voxels((3.0, 3.0, 3.0), "nm")):
        ready = done(wire, InspectJob(mesh))
        np.testing.assert_array_equal(ready.mesh.vertices, mesh.vertices)
        assert (ready.mesh.unit, ready.mesh.voxel) == (mesh.unit, mesh.voxel)
        assert ready.health.area == pytest.approx(mesh.area)
    grew = done(wire, DecomposeJob(other, OperatorOptions(), Target("count", 4)))
    np.testing.assert_allclose(grew.eigenvalues[1:], 0.5, rtol=0.02)

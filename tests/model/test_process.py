from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import shapes
from listeners import Listener

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import previews, process
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob, Job, PreviewJob
from meshmash_viewer.model.process import child_command, prepare_preview
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.progress import Progress
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
    child = subprocess.Popen(
        child_command(tmp_path),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    wire = Wire(cast(Any, child.stdout), cast(Any, child.stdin), tmp_path)
    yield wire
    wire.close()
    with child:
        assert child.stderr is not None
        assert child.stderr.read() == b"", "what it prepares beside the jobs works"


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


class Kept:
    """Stands for a wire."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.send = self.sent.append


def test_reports_are_thinned_but_for_the_first_of_a_stage(tmp_path: Path) -> None:
    wire = Kept()
    channel = process._PipeChannel(cast(Wire, wire), threading.Event(), tmp_path)
    for stage in ("a", "b"):
        for _ in range(1000):
            channel.report(Progress(stage))
    stages = [progress.stage for _, progress in wire.sent]
    assert stages == sorted(stages)
    assert set(stages) == {"a", "b"}
    assert len(stages) < 1000

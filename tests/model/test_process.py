from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import process
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob, Job
from meshmash_viewer.model.process import child_command, end_group
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.weyl import Target


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
    np.testing.assert_allclose(grew.summary.eigenvalues[1:], 0.5, rtol=0.02)


_CLEANS_UP = """
import pathlib, signal, sys, time
def clean(*_):
    time.sleep(0.2)
    pathlib.Path(sys.argv[1]).touch()
    sys.exit()
signal.signal(signal.SIGTERM, clean)
print("ready", flush=True)
time.sleep(60)
"""
_STUBBORN = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(os.name != "posix", reason="groups of processes")
@pytest.mark.parametrize("patience", [0.0, 20.0])
def test_a_process_that_is_ended_may_clean_up(patience: float, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _CLEANS_UP, str(tmp_path / "cleaned")],
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        end_group(child.pid, patience)
    assert (tmp_path / "cleaned").exists()


@pytest.mark.skipif(os.name != "posix", reason="groups of processes")
def test_a_process_that_does_not_listen_is_killed() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _STUBBORN], stdout=subprocess.PIPE, start_new_session=True
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        end_group(child.pid, 0.1)
    assert child.returncode == -signal.SIGKILL


class Kept:
    """Stands for a wire."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.send = self.sent.append


def test_reports_are_thinned_but_for_the_first_of_a_stage(tmp_path: Path) -> None:
    wire = Kept()
    channel = process._JobChannel(wire.send, lambda: False, tmp_path)
    for stage in ("a", "b"):
        for _ in range(1000):
            channel.report(Progress(stage))
    stages = [progress.stage for _, progress in wire.sent]
    assert stages == sorted(stages)
    assert set(stages) == {"a", "b"}
    assert len(stages) < 1000

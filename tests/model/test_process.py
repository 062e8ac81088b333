from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob, Job
from meshmash_viewer.model.process import child_command
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.spectral.weyl import Target


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

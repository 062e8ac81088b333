"""Long work as data: what to do, with what, and what comes back.

A job is a frozen, picklable description; `Job.run` is executed in a process of its own and speaks
only through the `Channel` it is given, so the window can be closed, cancelled or starved of memory
without harm.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Protocol

from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.export import ExportJob
from meshmash_viewer.model.results import MeshReady, SpectrumGrew, Written
from meshmash_viewer.model.transport import Channel
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import Voxel

__all__ = [
    "Channel",
    "DecomposeJob",
    "ExportJob",
    "InspectJob",
    "Job",
    "JobState",
    "MeshReady",
    "PreviewJob",
    "ReadJob",
    "RepairJob",
    "ScaleJob",
    "SpectrumGrew",
    "Written",
]


class Job(Protocol):
    """A frozen, picklable description of long work."""

    @property
    def label(self) -> str:
        """What the work is, as shown beside the progress bar: "Decomposing bunny"."""
        ...

    def run(self, channel: Channel) -> object:
        """Do the work in this process; what is returned is sent to the window."""
        ...


@dataclass(frozen=True)
class ReadJob:
    """Read a mesh file; returns `MeshReady`, with the stored eigenpairs of the operator.

    `unit` is as `units.parse_unit` takes it; empty for what the format states.
    """

    path: Path
    unit: str = ""
    operator: OperatorOptions = field(default_factory=OperatorOptions)

    @property
    def label(self) -> str:
        return f"Reading {self.path.name}"

    def run(self, channel: Channel) -> MeshReady:
        from meshmash_viewer.io.read import read_mesh

        channel.report(Progress("reading", message=f"Reading {self.path.name}"))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", MeshWarning)
            mesh = read_mesh(self.path, self.unit or None)
        ready = _inspect(mesh, self.operator, channel, path=self.path)
        remarks = []
        for each in caught:
            if each.category is MeshWarning:
                remarks.append(str(each.message))
            else:
                warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
        return replace(ready, remark=" ".join(filter(None, [*remarks, ready.remark])))


@dataclass(frozen=True, eq=False)
class _OnMesh:
    """Of every job on a mesh that is there."""

    mesh: Mesh
    doing: ClassVar[str]

    @property
    def label(self) -> str:
        return f"{self.doing} {self.mesh.name or 'the mesh'}"


@dataclass(frozen=True, eq=False)
class InspectJob(_OnMesh):
    """Take a mesh handed over in memory; returns `MeshReady`."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)

    doing: ClassVar[str] = "Inspecting"

    def run(self, channel: Channel) -> MeshReady:
        return _inspect(self.mesh, self.operator, channel)


@dataclass(frozen=True, eq=False)
class ScaleJob(_OnMesh):
    """Give the voxels another size, as `Mesh.in_voxels`; returns `MeshReady`.

    `repairs` are those that have been made on `mesh`.
    """

    voxel: Voxel
    unit: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    repairs: tuple[str, ...] = ()

    doing: ClassVar[str] = "Scaling"

    def run(self, channel: Channel) -> MeshReady:
        scaled = self.mesh.in_voxels(self.voxel, self.unit)
        ready = _inspect(scaled, self.operator, channel, path=self.path)
        return replace(ready, repairs=self.repairs, derived=True)


@dataclass(frozen=True, eq=False)
class RepairJob(_OnMesh):
    """Apply one repair of `health.REPAIRS`, after others; returns `MeshReady`."""

    repair: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    earlier: tuple[str, ...] = ()

    doing: ClassVar[str] = "Repairing"

    def run(self, channel: Channel) -> MeshReady:
        from meshmash_viewer.health import REPAIRS

        repair = REPAIRS[self.repair]
        channel.report(Progress("repairing", message=repair.label))
        mesh = repair.apply(self.mesh)
        ready = _inspect(mesh, self.operator, channel, path=self.path)
        return replace(ready, repairs=(*self.earlier, self.repair), derived=True)


@dataclass(frozen=True, eq=False)
class PreviewJob(_OnMesh):
    """Approximate the first eigenfunctions within seconds; returns `SpectrumGrew` or None."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)

    doing: ClassVar[str] = "Previewing"

    def run(self, channel: Channel) -> SpectrumGrew | None:
        from meshmash_viewer.model.previews import open_preview

        return open_preview(self.mesh, self.operator, channel)


@dataclass(frozen=True, eq=False)
class DecomposeJob(_OnMesh):
    """Solve the eigenproblem into the store; sends `SpectrumGrew`, returns the last of them."""

    operator: OperatorOptions
    target: Target

    doing: ClassVar[str] = "Decomposing"

    def run(self, channel: Channel) -> SpectrumGrew:
        from meshmash_viewer.model.decomposition import decompose

        return decompose(self.mesh, self.operator, self.target, channel)


@dataclass(frozen=True)
class JobState:
    """The job that runs now, since when, and how many seconds it was expected to take."""

    job: Job
    progress: Progress
    cancelling: bool = False
    began: float = 0.0
    expected: float | None = None

    def progressed(self, progress: Progress) -> JobState:
        """The job farther on; as long as it does not know what is left, the expectation says so."""
        if progress.remaining is None and self.expected is not None:
            left = self.began + self.expected - time.monotonic()
            progress = replace(progress, remaining=left if left > 0.0 else None)
        return replace(self, progress=progress)


def _inspect(
    mesh: Mesh,
    operator: OperatorOptions,
    channel: Channel,
    *,
    path: Path | None = None,
) -> MeshReady:
    """Measure a mesh, and look for its eigenpairs in the store."""
    from meshmash_viewer.health import mesh_health
    from meshmash_viewer.model.decomposition import find_known

    channel.report(Progress("inspecting", message="Looking for faults of the mesh"))
    health = mesh_health(mesh)
    channel.report(Progress("preparing", message="Preparing the render"))
    normals = mesh.vertex_normals
    known, remark = find_known(mesh, operator)
    sample = mesh.area_sample()
    return MeshReady(mesh, health, normals, path, known=known, remark=remark, sample=sample)

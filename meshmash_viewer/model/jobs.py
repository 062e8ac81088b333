"""Jobs: inputs and results of long computations.

A job is frozen and picklable. `Job.run` is executed in a separate process and communicates only
through a `Channel`, so that it can be cancelled, or run out of memory, without harm to the window.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.health import REPAIRS, listed_repairs, mesh_health, repair_mesh
from meshmash_viewer.io.links import name_and_place
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.open_mesh import MeshReady, PartReady, RegionsReady
from meshmash_viewer.progress import Progress
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import NO_VOXEL, Voxel
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import Channel, Job


@dataclass(frozen=True)
class ReadJob:
    """Job that reads a mesh file; returns `MeshReady`, with the stored eigenpairs of the operator.

    `unit` is a text for `quantities.parse_unit`; empty for the unit stated in the file. `repairs`
    are applied in this order. If `source`, the hash of the mesh for which they were made, differs
    from the hash of the mesh in the file, they are left out, and a remark reports it. `target` is
    the part of the spectrum to look up, see `last_eigenpairs`.
    """

    path: Path
    unit: str = ""
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    repairs: tuple[str, ...] = ()
    source: str = ""
    target: Target | None = None

    @property
    def label(self) -> str:
        return f"Reading {name_and_place(self.path)[0]}"

    def run(self, channel: Channel) -> MeshReady:
        channel.report(Progress("reading", message=self.label))
        with heard_warnings() as heard:
            mesh, source = _read(self.path, self.unit, channel)
        series, remark = [mesh], ""
        if self.repairs and self.source in ("", source):
            channel.report(Progress("repairing", message="Repairing as before"))
            with heard_warnings() as lost:
                series, remark = _repaired(mesh, self.repairs)
            heard += lost
        elif self.repairs:
            remark = (
                f"{self.path.name} has changed since it was repaired, so it is as it was read;"
                f" the repairs were: {listed_repairs(self.repairs)}."
            )
        *before, mesh = series
        ready = replace(
            _inspect(mesh, self.operator, self.target, channel, path=self.path),
            repairs=self.repairs[: len(before)],
            before=tuple(before),
            source=source,
            unasked=bool(before and self.source),
        )
        return replace(ready, remark=" ".join(filter(None, [remark, *heard, ready.remark])))


@dataclass(frozen=True, eq=False)
class MeshJob:
    """Base of the jobs on a mesh in memory."""

    mesh: Mesh
    doing: ClassVar[str]

    @property
    def label(self) -> str:
        return f"{self.doing} {self.mesh.name or 'the mesh'}"


@dataclass(frozen=True, eq=False)
class InspectJob(MeshJob):
    """Job that inspects a mesh passed in memory; returns `MeshReady`."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)
    target: Target | None = None

    doing: ClassVar[str] = "Inspecting"

    def run(self, channel: Channel) -> MeshReady:
        return _inspect(self.mesh, self.operator, self.target, channel)


@dataclass(frozen=True, eq=False)
class RegionsJob(MeshJob):
    """Job that measures the regions of a label set, see `regions`; returns `RegionsReady`."""

    labels: VertexMap
    maps: tuple[VertexMap, ...] = ()
    whole: bool = False

    doing: ClassVar[str] = "Measuring the regions of"

    def run(self, channel: Channel) -> RegionsReady:
        from meshmash_viewer.features.regions import regions

        channel.report(Progress("regions", message=self.label))
        found = regions(self.mesh, self.labels, self.maps, whole=self.whole)
        return RegionsReady(found.columns, found.rows, found.remarks)


@dataclass(frozen=True, eq=False)
class ScaleJob(MeshJob):
    """Job that changes the voxel size with `Mesh.in_voxels`; returns `MeshReady`.

    `repairs` are the repairs already made on `mesh`.
    """

    voxel: Voxel
    unit: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    repairs: tuple[str, ...] = ()
    target: Target | None = None

    doing: ClassVar[str] = "Scaling"

    def run(self, channel: Channel) -> MeshReady:
        scaled = self.mesh.in_voxels(self.voxel, self.unit)
        ready = _inspect(scaled, self.operator, self.target, channel, path=self.path)
        return replace(ready, repairs=self.repairs, derived=True)


@dataclass(frozen=True, eq=False)
class RepairJob(MeshJob):
    """Job that applies one repair of `health.REPAIRS` after `earlier` ones; returns `MeshReady`."""

    repair: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    earlier: tuple[str, ...] = ()
    target: Target | None = None

    doing: ClassVar[str] = "Repairing"

    def run(self, channel: Channel) -> MeshReady:
        repair = REPAIRS[self.repair]
        channel.report(Progress("repairing", message=repair.label))
        with heard_warnings() as heard:
            mesh = repair.apply(self.mesh)
        ready = _inspect(mesh, self.operator, self.target, channel, path=self.path)
        remark = " ".join(filter(None, [*heard, ready.remark]))
        return replace(ready, repairs=(*self.earlier, self.repair), derived=True, remark=remark)


@dataclass(frozen=True, eq=False)
class PartJob(MeshJob):
    """Job that looks up eigenpairs on a mask of a mesh, or on the whole; returns `PartReady`."""

    #: Shape (n,); None for the whole mesh.
    mask: npt.NDArray[np.bool_] | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    target: Target | None = None

    doing: ClassVar[str] = "Taking a part of"

    def run(self, channel: Channel) -> PartReady:
        if self.mask is None:
            channel.report(Progress("checking", message="Checking the stored eigenpairs"))
            known, remark = _stored(self.mesh, self.operator, self.target, channel)
            return PartReady(None, known, remark)
        part = _inspect(self.mesh.masked(self.mask), self.operator, self.target, channel)
        return PartReady(part, part.known, part.remark)


@dataclass(frozen=True, eq=False)
class PreviewJob(MeshJob):
    """Job that approximates the first eigenfunctions; returns `Eigenpairs` or None in seconds."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)

    doing: ClassVar[str] = "Previewing"

    def run(self, channel: Channel) -> Eigenpairs | None:
        from meshmash_viewer.model.decomposition import open_preview

        return open_preview(self.mesh, self.operator, channel)


@dataclass(frozen=True, eq=False)
class DecomposeJob(MeshJob):
    """Job that computes and stores eigenpairs; sends and returns `Eigenpairs`, see `decompose`."""

    operator: OperatorOptions
    target: Target

    doing: ClassVar[str] = "Decomposing"

    def run(self, channel: Channel) -> Eigenpairs:
        from meshmash_viewer.model.decomposition import decompose

        return decompose(self.mesh, self.operator, self.target, channel)


@dataclass(frozen=True, eq=False)
class ResolutionJob(MeshJob):
    """Job that measures `Eigenpairs.mesh_errors` on a finer mesh; returns those measured, (m,)."""

    pairs: Eigenpairs

    doing: ClassVar[str] = "Measuring the resolution of"

    def run(self, channel: Channel) -> npt.NDArray[np.float64]:
        from meshmash_viewer.io.spectrum import measure_errors
        from meshmash_viewer.model.decomposition import SPARE

        found = measure_errors(
            self.mesh,
            self.pairs,
            spare=channel.folder / SPARE,
            progress=channel.report,
            cancel=channel.cancelled,
        )
        return found.mesh_errors[: found.n_measured]


@dataclass(frozen=True)
class JobState:
    """The running job, its start time, and its expected duration in seconds."""

    job: Job
    progress: Progress
    cancelling: bool = False
    began: float = 0.0
    expected: float | None = None


@contextmanager
def heard_warnings() -> Iterator[list[str]]:
    """Collect the messages of mesh warnings, and issue other warnings again."""
    heard: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MeshWarning)
        yield heard
    for each in caught:
        if each.category is MeshWarning:
            heard.append(str(each.message))
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


def _read(path: Path, unit: str, channel: Channel) -> tuple[Mesh, str]:
    """Return the mesh in a file, and its content hash before scaling by the voxel size."""
    from meshmash_viewer.io.read import read_mesh

    voxel, name = parse_unit(unit)
    scaled = voxel != NO_VOXEL
    numbers = read_mesh(
        path, "none" if scaled else unit or None, progress=channel.report, cancel=channel.cancelled
    )
    if not scaled:
        return numbers, numbers.content_hash
    return numbers.in_voxels(voxel, name), numbers.content_hash


def _repaired(mesh: Mesh, names: Sequence[str]) -> tuple[list[Mesh], str]:
    """Return the mesh before and after each repair, and a sentence about a failed repair."""
    series = [mesh]
    for name in names:
        try:
            series.append(repair_mesh(series[-1], name))
        except InputError as fault:
            return series, f"{listed_repairs([name])} was not made again. {fault}"
    return series, ""


def _inspect(
    mesh: Mesh,
    operator: OperatorOptions,
    target: Target | None,
    channel: Channel,
    *,
    path: Path | None = None,
) -> MeshReady:
    """Measure the health of a mesh, and look up its stored eigenpairs in a second thread.

    For a million vertices, checking the checksums of 300 eigenvectors takes a second, and measuring
    the health several seconds.
    """
    with ThreadPoolExecutor(1) as thread:
        stored = thread.submit(_stored, mesh, operator, target, channel)
        channel.report(Progress("inspecting", message="Looking for faults of the mesh"))
        health = mesh_health(mesh)
        channel.report(Progress("preparing", message="Preparing the render"))
        normals, sample, small = mesh.vertex_normals, mesh.area_sample(), mesh.small_components
        if not stored.done():
            channel.report(Progress("checking", message="Checking the stored eigenpairs"))
        known, remark = stored.result()
    return MeshReady(
        mesh,
        health,
        normals,
        path,
        known=known,
        remark=remark,
        sample=sample,
        small=small if small.any() else None,
    )


def _stored(
    mesh: Mesh, operator: OperatorOptions, target: Target | None, channel: Channel
) -> tuple[Eigenpairs | None, str]:
    from meshmash_viewer.io.spectrum import last_eigenpairs

    return last_eigenpairs(mesh, operator, target, channel.cancelled)


class Work:
    """The running job of a document.

    ``requested`` is emitted with a `Job`; its runner calls `started`, `progressed` and `ended`.
    ``finished`` is emitted with the last `JobState` of a job that has ended.
    """

    changed = Signal()
    requested = Signal(object)
    cancel_requested = Signal()
    finished = Signal(object)

    def __init__(self) -> None:
        self.job: JobState | None = None

    def request(self, job: Job) -> None:
        """Request to run a job, such as an export."""
        self.requested.emit(job)

    def cancel(self) -> None:
        """Request to stop the running job."""
        if self.job is not None:
            self.job = replace(self.job, cancelling=True)
            self.changed.emit()
            self.cancel_requested.emit()

    def started(self, job: Job, expected: float | None = None) -> None:
        """Record the start of a job, and its expected duration in seconds."""
        self.job = JobState(job, Progress("starting"), began=time.monotonic(), expected=expected)
        self.changed.emit()

    def progressed(self, progress: Progress) -> None:
        """Record the progress of the job; a missing remaining time is estimated."""
        job = self.job
        if job is not None:
            if progress.remaining is None and job.expected is not None:
                left = job.began + job.expected - time.monotonic()
                progress = replace(progress, remaining=left if left > 0.0 else None)
            self.job = replace(job, progress=progress)
            self.changed.emit()

    def ended(self) -> None:
        """Record the end of the job."""
        job, self.job = self.job, None
        self.changed.emit()
        if job is not None:
            self.finished.emit(job)

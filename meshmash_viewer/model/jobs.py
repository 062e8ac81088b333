"""Jobs: inputs and results of long computations.

A job is frozen and picklable. `Job.run` is executed in a separate process and communicates only
through a `Channel`, so that it can be cancelled, or run out of memory, without harm to the window.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.health import REPAIRS, listed_repairs, mesh_health, repair_mesh
from meshmash_viewer.io.links import name_and_place
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.progress import Progress
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import NO_VOXEL, Voxel
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import Channel, Job, JobResult, Queueing


@dataclass(frozen=True)
class ReadJob(Job):
    """Job that reads a mesh file; the content is `MeshReady`, with stored eigenpairs.

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

    def run(self, channel: Channel) -> JobResult:
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
        ready, said = _inspect(mesh, self.operator, self.target, channel, path=self.path)
        ready = replace(
            ready,
            repairs=self.repairs[: len(before)],
            before=tuple(before),
            source=source,
            unasked=bool(before and self.source),
        )
        return JobResult(ready, " ".join(filter(None, [remark, *heard, said])))


@dataclass(frozen=True, eq=False)
class MeshJob(Job):
    """Base of the jobs on a mesh in memory."""

    mesh: Mesh
    doing: ClassVar[str]

    @property
    def label(self) -> str:
        return f"{self.doing} {self.mesh.name or 'the mesh'}"


@dataclass(frozen=True, eq=False)
class InspectJob(MeshJob):
    """Job that inspects a mesh passed in memory; the content is `MeshReady`."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)
    target: Target | None = None

    doing: ClassVar[str] = "Inspecting"

    def run(self, channel: Channel) -> JobResult:
        return JobResult(*_inspect(self.mesh, self.operator, self.target, channel))


@dataclass(frozen=True, eq=False)
class RegionsJob(MeshJob):
    """Job that measures the regions of a label set.

    The content is columns, rows and remarks of `Regions`, whose mesh the window has.
    """

    labels: VertexMap
    maps: tuple[VertexMap, ...] = ()
    whole: bool = False

    doing: ClassVar[str] = "Measuring the regions of"
    queueing = Queueing.COMPLETE

    def run(self, channel: Channel) -> JobResult:
        from meshmash_viewer.features.regions import regions

        channel.report(Progress("regions", message=self.label))
        found = regions(self.mesh, self.labels, self.maps, whole=self.whole)
        remark = f"Regions: {' '.join(found.remarks)}" if found.remarks else ""
        return JobResult((found.columns, found.rows, found.remarks), remark)


@dataclass(frozen=True, eq=False)
class ScaleJob(MeshJob):
    """Job that changes the voxel size with `Mesh.in_voxels`; the content is `MeshReady`.

    `repairs` are the repairs already made on `mesh`.
    """

    voxel: Voxel
    unit: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    repairs: tuple[str, ...] = ()
    target: Target | None = None

    doing: ClassVar[str] = "Scaling"

    def run(self, channel: Channel) -> JobResult:
        scaled = self.mesh.in_voxels(self.voxel, self.unit)
        ready, said = _inspect(scaled, self.operator, self.target, channel, path=self.path)
        return JobResult(replace(ready, repairs=self.repairs, derived=True), said)


@dataclass(frozen=True, eq=False)
class RepairJob(MeshJob):
    """Job that makes a repair of `health.REPAIRS` after `earlier` ones, like `ReadJob`."""

    repair: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    earlier: tuple[str, ...] = ()
    target: Target | None = None

    doing: ClassVar[str] = "Repairing"

    def run(self, channel: Channel) -> JobResult:
        repair = REPAIRS[self.repair]
        channel.report(Progress("repairing", message=repair.label))
        with heard_warnings() as heard:
            mesh = repair.apply(self.mesh)
        ready, said = _inspect(mesh, self.operator, self.target, channel, path=self.path)
        ready = replace(ready, repairs=(*self.earlier, self.repair), derived=True)
        return JobResult(ready, " ".join(filter(None, [*heard, said])))


@dataclass(frozen=True, eq=False)
class PartJob(MeshJob):
    """Job that looks up eigenpairs on a mask of a mesh, or on the whole mesh.

    The content is the `MeshReady` of the part, None for the whole, and its stored eigenpairs.
    """

    #: Shape (n,); None for the whole mesh.
    mask: npt.NDArray[np.bool_] | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    target: Target | None = None

    doing: ClassVar[str] = "Taking a part of"

    def run(self, channel: Channel) -> JobResult:
        if self.mask is None:
            channel.report(Progress("checking", message="Checking the stored eigenpairs"))
            known, remark = _stored(self.mesh, self.operator, self.target, channel)
            return JobResult((None, known), remark)
        part, remark = _inspect(self.mesh.masked(self.mask), self.operator, self.target, channel)
        return JobResult((part, part.known), remark)


@dataclass(frozen=True, eq=False)
class PreviewJob(MeshJob):
    """Job that approximates the first eigenfunctions; the content is `Eigenpairs` or None."""

    operator: OperatorOptions = field(default_factory=OperatorOptions)

    doing: ClassVar[str] = "Previewing"
    queueing = Queueing.BRIEF

    def run(self, channel: Channel) -> JobResult:
        from meshmash_viewer.model.decomposition import open_preview

        return JobResult(open_preview(self.mesh, self.operator, channel))


@dataclass(frozen=True, eq=False)
class DecomposeJob(MeshJob):
    """Job that computes, stores and sends `Eigenpairs`, and finally all as the content."""

    operator: OperatorOptions
    target: Target

    doing: ClassVar[str] = "Decomposing"
    queueing = Queueing.ALONE

    def run(self, channel: Channel) -> JobResult:
        from meshmash_viewer.model.decomposition import decompose

        return JobResult(*decompose(self.mesh, self.operator, self.target, channel))


@dataclass(frozen=True, eq=False)
class ResolutionJob(MeshJob):
    """Job that measures `Eigenpairs.mesh_errors` on a finer mesh; the content has shape (m,)."""

    pairs: Eigenpairs

    doing: ClassVar[str] = "Measuring the resolution of"

    def run(self, channel: Channel) -> JobResult:
        from meshmash_viewer.io.spectrum import measure_errors
        from meshmash_viewer.model.decomposition import SPARE

        found = measure_errors(
            self.mesh,
            self.pairs,
            spare=channel.folder / SPARE,
            progress=channel.report,
            cancel=channel.cancelled,
        )
        return JobResult(found.mesh_errors[: found.n_measured])


def _nothing(*_: object) -> str:
    return ""


@dataclass(eq=False)
class Task:
    """A requested job with the functions of its requester, and its state."""

    job: Job
    #: Called with the content of the result, or with a part of it, while the job is `needed`.
    accept: Callable[[Any], object] = _nothing
    receive: Callable[[Any], object] = _nothing
    #: Whether the result can be used; the job is cancelled when the mesh has changed otherwise.
    needed: Callable[[], bool] = lambda: True
    #: Called after the end of the job, which may have failed, or been cancelled or replaced.
    then: Callable[[Task], object] = _nothing
    #: Return the message of the cancelled job, and a sentence to add to that of a failure.
    cancelled: Callable[[], str] = _nothing
    lost: Callable[[], str] = _nothing
    #: Expected duration in seconds, and start time.
    expected: float | None = None
    began: float = 0.0
    progress: Progress = field(default_factory=lambda: Progress("starting"))
    cancelling: bool = False
    #: Whether the result has been accepted.
    succeeded: bool = False

    def again(self, job: Job) -> Task:
        """Return a request of another job by the same requester."""
        functions = self.receive, self.needed, self.then, self.cancelled, self.lost
        return Task(job, self.accept, *functions)

    def take(self, content: object) -> None:
        """Accept the content of the result."""
        if self.needed():
            self.accept(content)
            self.succeeded = True


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
) -> tuple[MeshReady, str]:
    """Measure the health of a mesh, and look up its stored eigenpairs in a second thread.

    Also returns a remark on the stored eigenpairs, or "".
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
    small_or_none = small if small.any() else None
    ready = MeshReady(mesh, health, normals, path, known=known, sample=sample, small=small_or_none)
    return ready, remark


def _stored(
    mesh: Mesh, operator: OperatorOptions, target: Target | None, channel: Channel
) -> tuple[Eigenpairs | None, str]:
    from meshmash_viewer.io.spectrum import last_eigenpairs

    return last_eigenpairs(mesh, operator, target, channel.cancelled)


class Work:
    """The running job of a document.

    ``requested`` is emitted with a `Task`; its runner calls `started`, `progressed` and `ended`.
    """

    changed = Signal()
    requested = Signal(object)
    cancel_requested = Signal()

    def __init__(self) -> None:
        self.job: Task | None = None

    def request(
        self, job: Job, accept: Callable[[Any], object] = _nothing, **functions: Any
    ) -> Task:
        """Request to run a job, such as an export; see the attributes of `Task`."""
        task = Task(job, accept, **functions)
        self.requested.emit(task)
        return task

    def cancel(self) -> None:
        """Request to stop the running job."""
        if self.job is not None:
            self.job.cancelling = True
            self.changed.emit()
            self.cancel_requested.emit()

    def started(self, task: Task) -> None:
        """Record the start of a job."""
        self.job, task.began = task, time.monotonic()
        self.changed.emit()

    def progressed(self, progress: Progress) -> None:
        """Record the progress of the job; a missing remaining time is estimated."""
        job = self.job
        if job is not None:
            if progress.remaining is None and job.expected is not None:
                left = job.began + job.expected - time.monotonic()
                progress = replace(progress, remaining=left if left > 0.0 else None)
            job.progress = progress
            self.changed.emit()

    def ended(self) -> None:
        """Record the end of the job."""
        job, self.job = self.job, None
        self.changed.emit()
        if job is not None:
            job.then(job)

"""Jobs: long work in a separate process, requested by the parts of a document.

A function of a job communicates only through a `Channel`, so that it can be cancelled, or run out
of memory, without harm to the window.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.health import listed_repairs, mesh_health, repair_mesh
from meshmash_viewer.io.links import name_and_place
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.notices import Failure, Notice, notice_of
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.progress import Progress
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import NO_VOXEL
from meshmash_viewer.work import Channel, JobResult


class Queueing(Enum):
    """How a job queues while others run or wait, see `Job.replaces`."""

    #: The job replaces the running one and those that wait.
    REPLACE = auto()
    #: The job waits, and replaces those of its kind.
    NEWEST = auto()
    #: The job waits; it replaces no other, and no other replaces it.
    COMPLETE = auto()


#: The default Laplacian.
_PLAIN = OperatorOptions()


def nothing(*_: object) -> str:
    """Ignore an event of a job."""
    return ""


@dataclass(eq=False)
class Job:
    """Long work in a separate process, what is done with its result, and its state.

    The label next to the progress bar consists of `doing`, the kind of the job, and its `subject`:
    "Decomposing bunny".
    """

    doing: str
    subject: str
    #: Picklable function that is called in the process.
    work: Callable[[Channel], JobResult]
    #: Called with the content of the result, or with a part of it, while the job is `needed`.
    accept: Callable[[Any], object] = nothing
    receive: Callable[[Any], object] = nothing
    queueing: Queueing = Queueing.REPLACE
    #: Whether the result can be used; the job is cancelled when the mesh has changed otherwise.
    needed: Callable[[], bool] = lambda: True
    #: Called after the end of the job, which may have failed, or been cancelled or replaced.
    then: Callable[[Job], object] = nothing
    #: Return the message of the cancelled job; "" for the usual one.
    cancelled: Callable[[], str] = nothing
    #: Return the notice of the failed job.
    failed: Callable[[Failure], Notice] = notice_of
    #: Expected duration in seconds, and start time.
    expected: float | None = None
    began: float = 0.0
    progress: Progress = field(default_factory=lambda: Progress("starting"))
    cancelling: bool = False
    #: Whether the result has been accepted.
    succeeded: bool = False

    @property
    def label(self) -> str:
        return f"{self.doing} {self.subject or 'the mesh'}"

    def replaces(self, other: Job) -> bool:
        """Return whether this job takes the place of another one that runs or waits."""
        if Queueing.COMPLETE in (self.queueing, other.queueing):
            return False
        return self.queueing is Queueing.REPLACE or self.doing == other.doing

    def take(self, content: object) -> None:
        """Accept the content of the result."""
        if self.needed():
            self.accept(content)
            self.succeeded = True


class Work:
    """The running job of a document.

    ``requested`` is emitted with a `Job`; its runner calls `started`, `progressed` and `ended`.
    """

    changed = Signal()
    requested = Signal(object)
    cancel_requested = Signal()

    def __init__(self) -> None:
        self.job: Job | None = None

    def request(self, job: Job) -> Job:
        """Request to run a job, and return it."""
        self.requested.emit(job)
        return job

    def write(self, path: Path, work: Callable[[Channel], JobResult]) -> Job:
        """Request a job that writes a file."""
        return self.request(Job("Writing", path.name, work, queueing=Queueing.COMPLETE))

    def cancel(self) -> None:
        """Request to stop the running job."""
        if self.job is not None:
            self.job.cancelling = True
            self.changed.emit()
            self.cancel_requested.emit()

    def started(self, job: Job) -> None:
        """Record the start of a job."""
        self.job, job.began = job, time.monotonic()
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


# -- in the process -----------------------------------------------------------------------------


def prepare(
    source: Path | Mesh,
    channel: Channel,
    *,
    operator: OperatorOptions = _PLAIN,
    target: Target | None = None,
    unit: str = "",
    repairs: tuple[str, ...] = (),
    hashed: str = "",
    earlier: tuple[str, ...] = (),
    path: Path | None = None,
) -> JobResult:
    """Prepare a mesh in a file or in memory for the window; the content is `MeshReady`.

    `unit` is a text for `quantities.parse_unit`; empty for the unit stated in the file, or that of
    the mesh. `repairs` are applied in this order. For a file, they are left out with a remark if
    `hashed`, the hash of the mesh for which they were made, is not that of the mesh in the file,
    and a failing one is left out with those after it. `earlier` are the repairs made on a mesh in
    memory, which has the file `path`. `target` is the part of the spectrum to look up in the store,
    see `last_eigenpairs`.
    """
    remark, file = "", source if isinstance(source, Path) else None
    with heard_warnings() as heard:
        if isinstance(source, Path):
            channel.report(Progress("reading", message=f"Reading {name_and_place(source)[0]}"))
            mesh, found = _read(source, unit, channel)
        else:
            mesh, found = source.in_voxels(*parse_unit(unit)) if unit else source, ""
        series = [mesh]
        if file is not None and hashed not in ("", found):
            remark = (
                f"{file.name} has changed since it was repaired, so it is as it was read;"
                f" the repairs were: {listed_repairs(repairs)}."
            )
            repairs = ()
        for name in repairs:
            channel.report(Progress("repairing", message=listed_repairs([name])))
            try:
                series.append(repair_mesh(series[-1], name))
            except InputError as fault:
                if file is None:
                    raise
                remark = f"{listed_repairs([name])} was not made again. {fault}"
                break
    ready, said = _inspect(series[-1], operator, target, channel)
    done = repairs[: len(series) - 1]
    ready = replace(
        ready,
        path=file or path,
        repairs=(*earlier, *done),
        before=tuple(series[:-1]) if file is not None else (),
        source=found,
        unasked=bool(file and done and hashed),
        derived=file is None and bool(unit or done),
    )
    return JobResult(ready, " ".join(filter(None, [remark, *heard, said])))


def prepare_part(
    mesh: Mesh,
    mask: npt.NDArray[np.bool_] | None,
    operator: OperatorOptions,
    target: Target | None,
    channel: Channel,
) -> JobResult:
    """Look up eigenpairs on a mask of a mesh, shape (n,), or on the whole mesh (None).

    The content is the `MeshReady` of the part, None for the whole, and its stored eigenpairs.
    """
    if mask is None:
        channel.report(Progress("checking", message="Checking the stored eigenpairs"))
        known, remark = _stored(mesh, operator, target, channel)
        return JobResult((None, known), remark)
    part, remark = _inspect(mesh.masked(mask), operator, target, channel)
    return JobResult((part, part.known), remark)


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


def _inspect(
    mesh: Mesh, operator: OperatorOptions, target: Target | None, channel: Channel
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
    ready = MeshReady(mesh, health, normals, known=known, sample=sample, small=small_or_none)
    return ready, remark


def _stored(
    mesh: Mesh, operator: OperatorOptions, target: Target | None, channel: Channel
) -> tuple[Eigenpairs | None, str]:
    from meshmash_viewer.io.spectrum import last_eigenpairs

    return last_eigenpairs(mesh, operator, target, channel.cancelled)

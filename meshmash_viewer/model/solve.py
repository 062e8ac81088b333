"""The next decomposition of a document: options of its Laplacian, and number of eigenpairs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from psygnal import SignalGroupDescriptor

from meshmash_viewer.features.truncation import asked_target
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.model.decomposition import (
    decompose,
    is_worthwhile,
    measure_resolution,
    preview,
)
from meshmash_viewer.model.jobs import Job, Queueing, Work
from meshmash_viewer.model.open_mesh import MeshReady, OpenMesh
from meshmash_viewer.spectral.cost import decomposition_seconds, measured_rate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.resolution import affordable_pairs
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.units import counted

DEFAULT_TARGET = Target("count", 100)
#: Kind of the job that computes eigenpairs.
_DECOMPOSING = "Decomposing"


@dataclass(eq=False)
class Solve:
    """Options of the next decomposition of the open mesh, with estimates of its size and time."""

    #: Emitted when an option changes.
    changed: ClassVar[SignalGroupDescriptor] = SignalGroupDescriptor()

    _opened: OpenMesh
    _work: Work
    #: Called with computed pairs.
    _accept: Callable[[Eigenpairs], None]
    #: Options of the Laplacian.
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    #: The part of the spectrum to compute.
    target: Target = DEFAULT_TARGET
    #: Seconds per vertex and pair of the last decomposition on this machine, if any.
    seconds_rate: float | None = None

    def stated(self, spectrum: Eigenpairs) -> Target:
        """Return what was asked for a spectrum, if possible as the user states it."""
        asked = spectrum.target or Target("count", max(len(spectrum), 1))
        return self.target if asked == self.asked else asked

    def translation(self) -> Translation:
        """Return the conversion of targets for the open mesh, or for unit area without a mesh."""
        opened = self._opened
        if opened.solved is None:
            return Translation(1.0)
        health = opened.solved.health
        n_vertices = self.n_vertices
        spectrum = None if opened.spectrum is None else opened.spectrum.exact
        if spectrum is None or not len(spectrum) or spectrum.operator != self.operator:
            return Translation(health.area, n_vertices=n_vertices)
        return Translation(
            health.area, spectrum.eigenvalues, n_vertices, known_to=spectrum.known_to
        )

    @property
    def is_computed(self) -> bool:
        """Whether the pairs of the target, no more and no less, are computed and certified."""
        spectrum = self._opened.spectrum
        return (
            spectrum is not None
            and spectrum.complete
            and spectrum.operator == self.operator
            and spectrum.target == self.asked
        )

    @property
    def asked(self) -> Target:
        """The target as `Eigenpairs.target` states it."""
        solved = self._opened.solved
        area = 0.0 if solved is None else solved.health.area
        return asked_target(self.target, area, self.n_vertices)

    @property
    def can_compute(self) -> bool:
        """Whether the mesh has pairs left to compute, and no other job runs."""
        running = self._work.job
        brief = running is not None and running.queueing is Queueing.NEWEST
        waits = running is None or (brief and running.doing != _DECOMPOSING)
        return self._opened.ready is not None and waits and not self.is_computed

    @property
    def n_vertices(self) -> int:
        """Number of vertices with a face, of the mesh or of the part to be decomposed."""
        solved = self._opened.solved
        health = None if solved is None else solved.health
        return 0 if health is None else health.n_vertices - health.unreferenced_vertices

    def compute(self) -> None:
        """Request the decomposition of the open mesh."""
        solved = self._opened.solved
        if solved is not None:
            self._work.request(
                Job(
                    _DECOMPOSING,
                    solved.mesh.name,
                    partial(decompose, solved.mesh, self.operator, self.asked),
                    self._accept,
                    self._accept,
                    Queueing.NEWEST,
                    needed=partial(self._opened.is_solved, solved.mesh),
                    then=self._take_time,
                    cancelled=self._kept,
                    expected=self.expected_seconds(self.asked),
                )
            )

    def preview(self, ready: MeshReady) -> None:
        """Request an approximation of the first pairs, if more than are stored."""
        if is_worthwhile(ready):
            needed = partial(self._opened.is_solved, ready.mesh)
            self._work.request(
                Job(
                    "Previewing",
                    ready.mesh.name,
                    partial(preview, ready.mesh, self.operator),
                    self._accept,
                    queueing=Queueing.NEWEST,
                    needed=needed,
                )
            )

    @property
    def measurable(self) -> int:
        """Number of leading pairs whose error due to the mesh is estimated, but can be measured."""
        spectrum = self._opened.spectrum
        if spectrum is None or not spectrum.complete or self._work.job is not None:
            return 0
        exact = spectrum.exact
        count = affordable_pairs(self.n_vertices, exact.eigenvalues)
        return count if spectrum.n_measured < count else 0

    def measure(self) -> None:
        """Request to measure the errors of eigenvalues that are due to the mesh."""
        solved, spectrum = self._opened.solved, self._opened.spectrum
        if solved is not None and spectrum is not None and self.measurable:
            pairs = replace(spectrum.exact, mesh=None, alignment=None)
            needed = partial(self._opened.is_solved, solved.mesh)
            work, name = partial(measure_resolution, solved.mesh, pairs), solved.mesh.name
            doing = "Measuring the resolution of"
            self._work.request(Job(doing, name, work, self._accept_errors, needed=needed))

    def _accept_errors(self, errors: npt.NDArray[np.float64]) -> None:
        """Take errors of the first eigenvalues, measured on a finer mesh."""
        if self._opened.spectrum is not None:
            self._opened.spectrum = self._opened.spectrum.with_measured(errors)
            self._opened.spectrum_changed.emit()

    def expected_seconds(self, target: Target) -> float:
        """Estimate the seconds that a decomposition of the open mesh takes."""
        pairs = self.translation().count(target)[0]
        return decomposition_seconds(self.n_vertices, pairs, self.seconds_rate)

    def _kept(self) -> str:
        """Return the message of a cancelled decomposition."""
        spectrum = self._opened.spectrum
        if spectrum is None or not len(spectrum.exact):
            return "Cancelled before any eigenpair converged."
        kept = counted(len(spectrum.exact), "eigenpair")
        return f"Cancelled; {kept} that converged before are kept."

    def _take_time(self, job: Job) -> None:
        """Update `seconds_rate` from a decomposition that has ended."""
        spectrum = self._opened.spectrum
        if job.succeeded and spectrum is not None and spectrum.complete:
            took = time.monotonic() - job.began
            rate = measured_rate(spectrum.rows.shape[1], len(spectrum.exact), took)
            self.seconds_rate = rate or self.seconds_rate

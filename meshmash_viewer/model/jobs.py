"""Long work as data: what to do, with what, and what comes back.

A job is a frozen, picklable description; `Job.run` is executed in a process of its own and speaks
only through the `Channel` it is given, so the window can be closed, cancelled or starved of memory
without harm.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from meshmash_viewer.health import Health
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Progress
from meshmash_viewer.weyl import Target

__all__ = [
    "Channel",
    "DecomposeJob",
    "ExportJob",
    "Job",
    "JobState",
    "MeshReady",
    "ReadJob",
    "RepairJob",
    "SpectrumGrew",
    "Written",
]


class Channel(Protocol):
    """The way from a running job to the window."""

    def report(self, progress: Progress) -> None:
        """Say how far the work is."""
        ...

    def send(self, message: object) -> None:
        """Hand over a part of the result (picklable)."""
        ...

    def cancelled(self) -> bool:
        """Whether the person asked to stop."""
        ...


class Job(Protocol):
    """A frozen, picklable description of long work."""

    @property
    def label(self) -> str:
        """What the work is, as shown beside the progress bar: "Decomposing bunny"."""
        ...

    def run(self, channel: Channel) -> object:
        """Do the work in this process; what is returned is sent to the window."""
        ...


@dataclass(frozen=True, eq=False)
class MeshReady:
    """A mesh with all that the window needs to draw it (result of `ReadJob` and `RepairJob`)."""

    mesh: Mesh
    health: Health
    normals: npt.NDArray[np.float32]
    path: Path | None = None
    repair: str = ""


@dataclass(frozen=True, eq=False)
class SpectrumGrew:
    """Eigenpairs 0 .. len(eigenvalues) are final and can be mapped from `folder`."""

    folder: Path
    eigenvalues: npt.NDArray[np.float64]
    residuals: npt.NDArray[np.float64]
    total: int
    complete: bool = False
    proof: str = ""


@dataclass(frozen=True)
class Written:
    """A file that was exported."""

    path: Path
    description: str


@dataclass(frozen=True)
class ReadJob:
    """Read a mesh file, in a unit; returns `MeshReady`."""

    path: Path
    unit: str = ""

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Reading {self.path.name}"


@dataclass(frozen=True, eq=False)
class RepairJob:
    """Apply one repair of `health.REPAIRS`; returns `MeshReady`."""

    mesh: Mesh
    repair: str
    path: Path | None = None


@dataclass(frozen=True, eq=False)
class DecomposeJob:
    """Solve the eigenproblem into the store; sends `SpectrumGrew`, returns the last of them."""

    mesh: Mesh
    operator: OperatorOptions
    target: Target


@dataclass(frozen=True, eq=False)
class ExportJob:
    """Compute features by the direct sum, or take the eigenpairs, and write a file."""

    mesh: Mesh
    operator: OperatorOptions
    path: Path
    kind: str
    n_pairs: int
    parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class JobState:
    """The job that runs now."""

    job: Job
    progress: Progress
    cancelling: bool = False

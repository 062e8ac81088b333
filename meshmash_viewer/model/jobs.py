"""Long work as data: what to do, with what, and what comes back.

A job is a frozen, picklable description; `Job.run` is executed in a process of its own and speaks
only through the `Channel` it is given, so the window can be closed, cancelled or starved of memory
without harm.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from meshmash_viewer.health import Health
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.alignment import Alignment, ShownRows
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.progress import Progress
from meshmash_viewer.units import Voxel
from meshmash_viewer.weyl import Target

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


class Channel(Protocol):
    """The way from a running job to the window."""

    @property
    def folder(self) -> Path:
        """Temporary folder that is deleted when the window closes."""
        ...

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
class SpectrumGrew:
    """The leading eigenpairs are final, and their rows can be mapped from a file.

    Parameters
    ----------
    rows_path : Path, optional
        ``.npy`` file of shape (>= k, n); only the first k rows are to be read.
    eigenvalues, residuals : ndarray of float64, shape (k,)
        Approximate ones included, whose residuals are NaN.
    total, complete, proof, operator
        See `Spectrum`.
    preview_path : Path, optional
        ``.npy`` file with approximate rows, of which those after the exact ones count.
    n_exact : int
        With `preview_path`: how many are exact.
    error : float
        Expected relative error of the approximate eigenvalues.
    alignment : Alignment, optional
        Signs and rotations of the exact rows on the render.
    remark : str
        A sentence for the message bar, where there is something to say.
    """

    rows_path: Path | None
    eigenvalues: npt.NDArray[np.float64]
    residuals: npt.NDArray[np.float64]
    total: int = 0
    complete: bool = False
    proof: str = ""
    operator: OperatorOptions | None = None
    preview_path: Path | None = None
    n_exact: int = 0
    error: float = 0.0
    alignment: Alignment | None = None
    remark: str = ""

    @cached_property
    def spectrum(self) -> Spectrum:
        """The same as the views read it; the first access opens the files."""
        from meshmash_viewer.io.npy import map_rows

        exact, preview = (
            None if path is None else map_rows(path, "r", (None, None))
            for path in (self.rows_path, self.preview_path)
        )
        rows: npt.NDArray[np.floating[Any]] | ShownRows
        shown = None
        if exact is None or (preview is not None and self.n_exact == 0):
            assert preview is not None
            rows = preview
        elif preview is not None:
            rows = ShownRows(exact, self.n_exact, preview, self.alignment or Alignment())
        else:
            rows = exact
            if self.alignment is not None:
                shown = ShownRows(exact, len(self.eigenvalues), None, self.alignment)
        return Spectrum(
            self.eigenvalues,
            rows,
            self.residuals,
            total=self.total,
            complete=self.complete,
            proof=self.proof,
            preview=preview is not None,
            operator=self.operator,
            n_exact=self.n_exact,
            error=self.error,
            shown=shown,
        )


@dataclass(frozen=True, eq=False)
class MeshReady:
    """A mesh with all that the window needs to draw it.

    Parameters
    ----------
    mesh : Mesh
    health : Health
    normals : ndarray of float32, shape (n, 3)
    path : Path, optional
        The file it came from.
    repairs : tuple of str
        Names of the repairs made since it was read, oldest first.
    known : SpectrumGrew, optional
        Eigenpairs found in the store.
    remark : str
        A sentence for the message bar, where there is something to say.
    derived : bool
        Whether it was made from the mesh shown before, by a repair or other voxels.
    sample : ndarray of int64, optional
        `Mesh.area_sample`, for the limits of colours.
    """

    mesh: Mesh
    health: Health
    normals: npt.NDArray[np.float32]
    path: Path | None = None
    repairs: tuple[str, ...] = ()
    known: SpectrumGrew | None = None
    remark: str = ""
    derived: bool = False
    sample: npt.NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Written:
    """A file that was exported."""

    path: Path
    description: str


@dataclass(frozen=True)
class ReadJob:
    """Read a mesh file; returns `MeshReady`.

    Parameters
    ----------
    path : Path
    unit : str
        Of its coordinates, as `units.parse_unit` takes it; empty for what the format states.
    operator : OperatorOptions
        The Laplacian whose stored eigenpairs are looked for.
    """

    path: Path
    unit: str = ""
    operator: OperatorOptions = field(default_factory=OperatorOptions)

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Reading {self.path.name}"

    def run(self, channel: Channel) -> MeshReady:
        """See `Job.run`."""
        from meshmash_viewer.io.read import read_mesh

        channel.report(Progress("reading", message=f"Reading {self.path.name}"))
        mesh = read_mesh(self.path, self.unit or None)
        return _inspect(mesh, self.operator, channel, path=self.path)


@dataclass(frozen=True, eq=False)
class InspectJob:
    """Take a mesh handed over in memory; returns `MeshReady`."""

    mesh: Mesh
    operator: OperatorOptions = field(default_factory=OperatorOptions)

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Inspecting {self.mesh.name or 'the mesh'}"

    def run(self, channel: Channel) -> MeshReady:
        """See `Job.run`."""
        return _inspect(self.mesh, self.operator, channel)


@dataclass(frozen=True, eq=False)
class ScaleJob:
    """Give the voxels another size; returns `MeshReady`.

    Parameters
    ----------
    mesh : Mesh
    voxel, unit : tuple of three floats and str
        See `Mesh.in_voxels`.
    path : Path, optional
        The file it came from.
    operator : OperatorOptions
    repairs : tuple of str
        What has been repaired on `mesh`.
    """

    mesh: Mesh
    voxel: Voxel
    unit: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    repairs: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Scaling {self.mesh.name or 'the mesh'}"

    def run(self, channel: Channel) -> MeshReady:
        """See `Job.run`."""
        scaled = self.mesh.in_voxels(self.voxel, self.unit)
        ready = _inspect(scaled, self.operator, channel, path=self.path)
        return replace(ready, repairs=self.repairs, derived=True)


@dataclass(frozen=True, eq=False)
class RepairJob:
    """Apply one repair of `health.REPAIRS`, after others; returns `MeshReady`."""

    mesh: Mesh
    repair: str
    path: Path | None = None
    operator: OperatorOptions = field(default_factory=OperatorOptions)
    earlier: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Repairing {self.mesh.name or 'the mesh'}"

    def run(self, channel: Channel) -> MeshReady:
        """See `Job.run`."""
        from meshmash_viewer.health import REPAIRS

        repair = REPAIRS[self.repair]
        channel.report(Progress("repairing", message=repair.label))
        mesh = repair.apply(self.mesh)
        ready = _inspect(mesh, self.operator, channel, path=self.path)
        return replace(ready, repairs=(*self.earlier, self.repair), derived=True)


@dataclass(frozen=True, eq=False)
class PreviewJob:
    """Approximate the first eigenfunctions within seconds; returns `SpectrumGrew` or None."""

    mesh: Mesh
    operator: OperatorOptions = field(default_factory=OperatorOptions)

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Previewing {self.mesh.name or 'the mesh'}"

    def run(self, channel: Channel) -> SpectrumGrew | None:
        """See `Job.run`."""
        from meshmash_viewer.model.previews import open_preview

        preview = open_preview(self.mesh, channel)
        return None if preview is None else preview.alone(self.operator)


@dataclass(frozen=True, eq=False)
class DecomposeJob:
    """Solve the eigenproblem into the store; sends `SpectrumGrew`, returns the last of them."""

    mesh: Mesh
    operator: OperatorOptions
    target: Target

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Decomposing {self.mesh.name or 'the mesh'}"

    def run(self, channel: Channel) -> SpectrumGrew:
        """See `Job.run`."""
        from meshmash_viewer.model.decomposition import decompose

        return decompose(self.mesh, self.operator, self.target, channel)


@dataclass(frozen=True, eq=False)
class ExportJob:
    """Compute features by the direct sum, or take the eigenpairs, and write a file.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
        Of the eigenpairs that are looked up in the store.
    path : Path
        Its ending says the format.
    kind : str
        One of `meshmash_viewer.feature_kinds.KINDS`.
    n_pairs : int
        Number of leading eigenpairs to use.
    parameters : dict
        By kind: ``t_min, t_max, n_scales`` (hks), ``e_min, e_max, n_bands``
        (geometry-vectors), ``n_energies`` (wks).
    """

    mesh: Mesh
    operator: OperatorOptions
    path: Path
    kind: str
    n_pairs: int
    parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """See `Job.label`."""
        return f"Writing {self.path.name}"

    def run(self, channel: Channel) -> Written:
        """See `Job.run`."""
        from meshmash_viewer.model.export import export

        return export(self, channel)


@dataclass(frozen=True)
class JobState:
    """The job that runs now."""

    job: Job
    progress: Progress
    cancelling: bool = False


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

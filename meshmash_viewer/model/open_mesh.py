"""The open mesh with its eigenpairs, and the results of jobs on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from meshmash_viewer.health import Health
from meshmash_viewer.mesh import Mesh, mask_text
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.units import written_unit


@dataclass(frozen=True, eq=False)
class MeshReady:
    """A mesh with its health, normals, repairs and stored eigenpairs, ready to be drawn."""

    mesh: Mesh
    health: Health
    #: Shape (n, 3).
    normals: npt.NDArray[np.float32]
    #: The file of the mesh; None for a mesh in memory.
    path: Path | None = None
    #: Names of the repairs made since the mesh was read, oldest first.
    repairs: tuple[str, ...] = ()
    #: Eigenpairs found in the store.
    known: Eigenpairs | None = None
    #: Whether the mesh is the previous mesh after a repair or with another voxel size.
    derived: bool = False
    #: `Mesh.area_sample`, for colour limits.
    sample: npt.NDArray[np.int64] | None = None
    #: `Mesh.small_components`; None if there are none.
    small: npt.NDArray[np.bool_] | None = None
    #: The mesh before each repair that was applied after reading.
    before: tuple[Mesh, ...] = ()
    #: Hash of the mesh as read from the file; repairs are repeated only for the same hash.
    source: str = ""
    #: Whether repairs of the last session were repeated without asking.
    unasked: bool = False
    #: The part (`Mesh.masked`) on which eigenpairs are computed; None for the whole mesh.
    part: MeshReady | None = None


@dataclass(frozen=True, eq=False)
class MapGrew:
    """Values at more vertices of a map that is being computed."""

    name: str
    #: Shape (m,).
    vertices: npt.NDArray[np.int64]
    #: Shape (m,).
    values: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shown:
    """An open mesh with its spectrum, as the history stores it."""

    ready: MeshReady
    spectrum: Eigenpairs | None


class OpenMesh:
    """The open mesh and its eigenpairs, if any."""

    mesh_changed = Signal()
    spectrum_changed = Signal()

    def __init__(self) -> None:
        self.ready: MeshReady | None = None
        #: `Eigenpairs` without any pair, for fields of the open mesh that need no pairs.
        self._bare: Eigenpairs | None = None
        self._spectrum: Eigenpairs | None = None

    @property
    def mesh(self) -> Mesh | None:
        """The open mesh."""
        return self.ready.mesh if self.ready else None

    def named_vertex(self, vertex: int) -> str:
        """Return the name of a vertex of the open mesh, see `Mesh.named_vertex`."""
        return "a vertex" if self.mesh is None else self.mesh.named_vertex(vertex)

    @property
    def unit(self) -> str:
        """The unit of the open mesh; "" without a unit or a mesh."""
        return self.mesh.unit if self.mesh is not None else ""

    @property
    def unit_text(self) -> str:
        """The unit as text for `Document.open_mesh`: "nm", "none", or "8 nm" for voxels."""
        return "" if self.mesh is None else written_unit(self.mesh.unit, self.mesh.voxel)

    @property
    def path(self) -> Path | None:
        """The file of the mesh; None for a mesh passed in memory."""
        return self.ready.path if self.ready else None

    @property
    def repairs(self) -> tuple[str, ...]:
        """Names of the repairs made on the open mesh, oldest first."""
        return self.ready.repairs if self.ready else ()

    @property
    def solved(self) -> MeshReady | None:
        """The mesh that eigenpairs are computed on: the open mesh, or a part of it."""
        return self.ready if self.ready is None or self.ready.part is None else self.ready.part

    @property
    def part_mesh(self) -> Mesh | None:
        """The part of the mesh that eigenpairs are computed on; None for the whole mesh."""
        return None if self.ready is None or self.ready.part is None else self.ready.part.mesh

    def is_shown(self, mesh: Mesh | None) -> bool:
        """Return whether a mesh is the open mesh, possibly with other maps or in another unit."""
        return self.ready is not None and _same(self.ready.mesh, mesh)

    def is_solved(self, mesh: Mesh | None) -> bool:
        """Return whether eigenpairs are computed on a mesh, compared as in `is_shown`."""
        return self.solved is not None and _same(self.solved.mesh, mesh)

    @property
    def spectrum(self) -> Eigenpairs | None:
        """The eigenpairs of the open mesh or its part; None before any is computed."""
        return self._spectrum

    @spectrum.setter
    def spectrum(self, spectrum: Eigenpairs | None) -> None:
        solved = None if self.solved is None else self.solved.mesh
        if spectrum is not None and spectrum.mesh is not solved:
            spectrum = replace(spectrum, mesh=solved)
            if self.part_mesh is not None:
                spectrum = spectrum.on_mask(mask_text(self.part_mesh))
        self._spectrum = spectrum

    @property
    def known(self) -> Eigenpairs | None:
        """The spectrum, with no pairs before the first are computed; None without a mesh."""
        return self._bare if self._spectrum is None else self._spectrum

    @property
    def scaled_spectrum(self) -> Eigenpairs | None:
        """The spectrum if it has a positive eigenvalue, as times and bands require; else None."""
        spectrum = self.spectrum
        if spectrum is None or first_nonzero(spectrum) >= len(spectrum):
            return None
        return spectrum

    @property
    def shown(self) -> Shown | None:
        """The open mesh with its spectrum, as the history stores it."""
        return None if self.ready is None else Shown(self.ready, self.spectrum)

    def take(self, ready: MeshReady, spectrum: Eigenpairs | None) -> None:
        """Replace mesh and spectrum; the caller emits the signals."""
        if ready.part is not None:
            part = replace(ready.part, mesh=ready.part.mesh.like(ready.mesh))
            ready = replace(ready, part=part)
        self.ready = ready
        self._bare = Eigenpairs.without_pairs((ready.part or ready).mesh)
        self.spectrum = spectrum


def _same(mesh: Mesh, other: Mesh | None) -> bool:
    return other is not None and mesh.vertices is other.vertices and mesh.faces is other.faces

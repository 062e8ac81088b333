"""The mesh that is open, with its eigenpairs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from psygnal import Signal

from meshmash_viewer.mesh import Mesh, mask_text
from meshmash_viewer.model.results import MeshReady
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.units import written_unit


@dataclass(frozen=True, eq=False)
class Shown:
    """An open mesh with its spectrum, as the history keeps it."""

    ready: MeshReady
    spectrum: Eigenpairs | None


class OpenMesh:
    """The open mesh and its eigenpairs; there may be neither."""

    mesh_changed = Signal()
    spectrum_changed = Signal()

    def __init__(self) -> None:
        self.ready: MeshReady | None = None
        #: The open mesh without pairs, for fields that need none.
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
        """The unit as `Document.open_mesh` takes it: "nm", "none", or "8 nm" for voxels."""
        return "" if self.mesh is None else written_unit(self.mesh.unit, self.mesh.voxel)

    @property
    def path(self) -> Path | None:
        """The file of the mesh; None for a mesh passed in memory."""
        return self.ready.path if self.ready else None

    @property
    def repairs(self) -> tuple[str, ...]:
        """Names of the repairs in force, oldest first."""
        return self.ready.repairs if self.ready else ()

    @property
    def solved(self) -> MeshReady | None:
        """What eigenpairs are computed on: the open mesh, or a part of it."""
        return self.ready if self.ready is None or self.ready.part is None else self.ready.part

    @property
    def part_mesh(self) -> Mesh | None:
        """The part of the mesh that eigenpairs are computed on; None if that is the whole."""
        return None if self.ready is None or self.ready.part is None else self.ready.part.mesh

    def is_shown(self, mesh: Mesh | None) -> bool:
        """Whether a mesh is the open one, possibly with other maps or in another unit."""
        return self.ready is not None and _same(self.ready.mesh, mesh)

    def is_solved(self, mesh: Mesh | None) -> bool:
        """Whether eigenpairs of a mesh are those that are shown, as `is_shown` compares."""
        return self.solved is not None and _same(self.solved.mesh, mesh)

    @property
    def spectrum(self) -> Eigenpairs | None:
        """The eigenpairs of the open mesh, or of a part of it; None while there are none."""
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
        """The spectrum, or one without pairs while there are none; None without a mesh."""
        return self._bare if self._spectrum is None else self._spectrum

    @property
    def scaled_spectrum(self) -> Eigenpairs | None:
        """The spectrum if it has an eigenvalue above 0, as times and bands need; else None."""
        spectrum = self.spectrum
        return (
            spectrum if spectrum is not None and first_nonzero(spectrum) < len(spectrum) else None
        )

    @property
    def shown(self) -> Shown | None:
        """The open mesh with its spectrum, as the history keeps it."""
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

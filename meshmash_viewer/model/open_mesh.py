"""The mesh that is open, with its eigenpairs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from psygnal import Signal

from meshmash_viewer.mesh import Mesh
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
    def spectrum(self) -> Eigenpairs | None:
        """The eigenpairs of the open mesh; None while there are none."""
        return self._spectrum

    @spectrum.setter
    def spectrum(self, spectrum: Eigenpairs | None) -> None:
        if spectrum is not None and spectrum.mesh is not self.mesh:
            spectrum = replace(spectrum, mesh=self.mesh)
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
        self.ready = ready
        self._bare = Eigenpairs.without_pairs(ready.mesh)
        self.spectrum = spectrum

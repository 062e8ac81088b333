"""Results of jobs: meshes ready to be drawn, maps that grow, written files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.health import Health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@dataclass(frozen=True, eq=False)
class MeshReady:
    """A mesh with everything that the window needs to draw it."""

    mesh: Mesh
    health: Health
    #: Shape (n, 3).
    normals: npt.NDArray[np.float32]
    #: The file of the mesh.
    path: Path | None = None
    #: Names of the repairs made since it was read, oldest first.
    repairs: tuple[str, ...] = ()
    #: Eigenpairs found in the store.
    known: Eigenpairs | None = None
    #: A sentence for the message bar, or "".
    remark: str = ""
    #: Whether it was made from the mesh shown before, by a repair or another voxel size.
    derived: bool = False
    #: `Mesh.area_sample`, for colour limits.
    sample: npt.NDArray[np.int64] | None = None
    #: `Mesh.small_components`; None if there are none.
    small: npt.NDArray[np.bool_] | None = None
    #: The mesh before each repair that was made while the file was read.
    before: tuple[Mesh, ...] = ()
    #: Hash of the numbers in its file; repairs are repeated at opening only for the same hash.
    source: str = ""
    #: Whether its repairs were repeated because they had been made last time.
    unasked: bool = False
    #: The mesh of a part of its vertices (`Mesh.masked`), if eigenpairs are computed on that part.
    part: MeshReady | None = None


@dataclass(frozen=True, eq=False)
class PartReady:
    """The part of a mesh on which eigenpairs are computed, with those in the store."""

    #: The mesh of the part; None for the whole.
    part: MeshReady | None
    known: Eigenpairs | None
    #: A sentence for the message bar, or "".
    remark: str = ""


@dataclass(frozen=True, eq=False)
class MapGrew:
    """Values at more vertices of a map that is being computed."""

    name: str
    #: Shape (m,).
    vertices: npt.NDArray[np.int64]
    #: Shape (m,).
    values: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RegionsReady:
    """What `features.regions.Regions` holds besides its mesh."""

    columns: dict[str, npt.NDArray[Any]]
    #: Shape (n,).
    rows: npt.NDArray[np.int64]
    remarks: tuple[str, ...]

    @property
    def remark(self) -> str:
        """A sentence for the message bar, or ""."""
        return f"Regions: {' '.join(self.remarks)}" if self.remarks else ""


@dataclass(frozen=True)
class Written:
    """An exported file, with a description of its content."""

    path: Path
    description: str
    remark: str = ""
    #: Whether the remark is shown as a warning.
    warns: bool = True

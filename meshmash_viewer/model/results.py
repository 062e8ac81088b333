"""Results of jobs: meshes ready to be drawn, maps that grow, written files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.health import Health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@dataclass(frozen=True, eq=False)
class MeshReady:
    """A mesh with everything that the window needs to draw it.

    Parameters
    ----------
    mesh : Mesh
    health : Health
    normals : ndarray of float32, shape (n, 3)
    path : Path, optional
        The file of the mesh.
    repairs : tuple of str
        Names of the repairs made since it was read, oldest first.
    known : Eigenpairs, optional
        Eigenpairs found in the store.
    remark : str
        A sentence for the message bar, or "".
    derived : bool
        Whether it was made from the mesh shown before, by a repair or another voxel size.
    before : tuple of Mesh
        The mesh before each repair that was made while the file was read.
    source : str
        Hash of the numbers in its file; repairs are repeated at opening only for the same hash.
    unasked : bool
        Whether its repairs were repeated because they had been made last time.
    asked_unit : str
        The unit that was given for the file; "" for the one that the file states.
    sample : ndarray of int64, optional
        `Mesh.area_sample`, for colour limits.
    """

    mesh: Mesh
    health: Health
    normals: npt.NDArray[np.float32]
    path: Path | None = None
    repairs: tuple[str, ...] = ()
    known: Eigenpairs | None = None
    remark: str = ""
    derived: bool = False
    sample: npt.NDArray[np.int64] | None = None
    before: tuple[Mesh, ...] = ()
    source: str = ""
    unasked: bool = False
    asked_unit: str = ""


@dataclass(frozen=True, eq=False)
class MapGrew:
    """Values at more vertices of a map that is being computed.

    Parameters
    ----------
    name : str
    vertices : ndarray of int64, shape (m,)
    values : ndarray of float64, shape (m,)
    """

    name: str
    vertices: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Written:
    """An exported file, with a description of its content."""

    path: Path
    description: str
    remark: str = ""
    #: Whether the remark is shown as a warning.
    warns: bool = True

"""Results of jobs: meshes ready to be drawn, growing spectra, written files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.health import Health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.alignment import Alignment, ShownRows
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Placeholder for rows in a file that is not opened yet.
NO_ROWS = np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class SpectrumGrew:
    """Leading eigenpairs that are final, and whose rows can be mapped from a file.

    Parameters
    ----------
    summary : Eigenpairs
        Without rows, which are in the file `Eigenpairs.stored`; residuals of approximate pairs are
        NaN.
    preview_path : Path, optional
        ``.npy`` file with rows, if these are approximate.
    alignment : Alignment, optional
        Signs and rotations of the displayed rows.
    remark : str
        A sentence for the message bar, or "".
    """

    summary: Eigenpairs
    preview_path: Path | None = None
    alignment: Alignment | None = None
    remark: str = ""

    @cached_property
    def spectrum(self) -> Eigenpairs:
        """The spectrum with rows; the first access opens the files."""
        if self.preview_path is not None:
            return replace(self.summary, rows=np.load(self.preview_path, mmap_mode="r"))
        count = len(self.summary)
        rows, shown = self.summary.stored.map(count), None
        if self.alignment is not None:
            shown = ShownRows(rows, count, None, self.alignment)
        return replace(self.summary, rows=rows, shown=shown, n_exact=count)


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
    known : SpectrumGrew, optional
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
    known: SpectrumGrew | None = None
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

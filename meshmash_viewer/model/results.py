"""What jobs hand over: meshes ready to be drawn, spectra as they grow, files written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.health import Health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.alignment import Alignment, ShownRows

__all__ = ["NO_ROWS", "MapGrew", "MeshReady", "SpectrumGrew", "Written"]

#: Of a spectrum whose rows are in a file that has yet to be opened.
NO_ROWS = np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class SpectrumGrew:
    """The leading eigenpairs are final, and their rows can be mapped from a file.

    Parameters
    ----------
    told : Spectrum
        All of it but the rows, which `Spectrum.stored` names; the residuals of approximate ones
        are NaN.
    preview_path : Path, optional
        ``.npy`` file with approximate rows, where these pairs are.
    alignment : Alignment, optional
        Signs and rotations of the rows on the render.
    remark : str
        A sentence for the message bar, where there is something to say.
    """

    told: Spectrum
    preview_path: Path | None = None
    alignment: Alignment | None = None
    remark: str = ""

    @cached_property
    def spectrum(self) -> Spectrum:
        """The same as the views read it; the first access opens the files."""
        if self.preview_path is not None:
            return replace(self.told, rows=np.load(self.preview_path, mmap_mode="r"))
        count = len(self.told)
        rows, shown = self.told.stored.map(count), None
        if self.alignment is not None:
            shown = ShownRows(rows, count, None, self.alignment)
        return replace(self.told, rows=rows, shown=shown, n_exact=count)


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
    before : tuple of Mesh
        What it was before each of its repairs, of one that was repaired as soon as it was read.
    source : str
        Hash of the numbers in its file, for which repairs are made again when it is opened.
    unasked : bool
        Whether its repairs were made again because they had been made last time.
    asked_unit : str
        The unit that its file was read in; "" for what that states.
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
    """A file that was exported, and what there is to say of what is in it."""

    path: Path
    description: str
    remark: str = ""
    #: Whether the remark is one that a person should not miss.
    warns: bool = True

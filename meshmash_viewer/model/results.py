"""What jobs hand over: meshes ready to be drawn, spectra as they grow, files written."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.health import Health
from meshmash_viewer.io.stored_spectrum import StoredRows
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.alignment import Alignment, ShownRows
from meshmash_viewer.spectral.certificate import Certificate

__all__ = ["MapGrew", "MeshReady", "SpectrumGrew", "Written"]


@dataclass(frozen=True, eq=False)
class SpectrumGrew:
    """The leading eigenpairs are final, and their rows can be mapped from a file.

    Parameters
    ----------
    stored : StoredRows, optional
        Where the rows are, of which the first k are to be read.
    eigenvalues, residuals : ndarray of float64, shape (k,)
        The residuals of approximate ones are NaN.
    total, certificate, operator, known_to, mass
        See `Spectrum`.
    preview_path : Path, optional
        ``.npy`` file with approximate rows, where these pairs are.
    error : float
        Expected relative error of the approximate eigenvalues.
    alignment : Alignment, optional
        Signs and rotations of the rows on the render.
    remark : str
        A sentence for the message bar, where there is something to say.
    """

    stored: StoredRows | None
    eigenvalues: npt.NDArray[np.float64]
    residuals: npt.NDArray[np.float64]
    total: int = 0
    certificate: Certificate | None = None
    operator: OperatorOptions | None = None
    preview_path: Path | None = None
    error: float = 0.0
    alignment: Alignment | None = None
    remark: str = ""
    known_to: float = 0.0
    mass: npt.NDArray[np.float64] | None = None

    @cached_property
    def spectrum(self) -> Spectrum:
        """The same as the views read it; the first access opens the files."""
        count, preview, shown = len(self.eigenvalues), self.preview_path is not None, None
        rows: npt.NDArray[np.floating[Any]]
        if self.preview_path is not None:
            rows = np.load(self.preview_path, mmap_mode="r")
        else:
            assert self.stored is not None
            rows = self.stored.map(count)
            if self.alignment is not None:
                shown = ShownRows(rows, count, None, self.alignment)
        return Spectrum(
            self.eigenvalues,
            rows,
            self.residuals,
            total=self.total,
            certificate=self.certificate,
            preview=preview,
            operator=self.operator,
            n_exact=0 if preview else count,
            error=self.error,
            shown=shown,
            known_to=self.known_to,
            mass=self.mass,
            stored=self.stored,
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

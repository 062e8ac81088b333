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
from meshmash_viewer.io.row_file import StoredRows
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.alignment import Alignment, ShownRows
from meshmash_viewer.spectral.certificate import Certificate

__all__ = ["MeshReady", "SpectrumGrew", "Written"]


@dataclass(frozen=True, eq=False)
class SpectrumGrew:
    """The leading eigenpairs are final, and their rows can be mapped from a file.

    Parameters
    ----------
    stored : StoredRows, optional
        Where the exact rows are; only the first `n_exact` are to be read.
    eigenvalues, residuals : ndarray of float64, shape (k,)
        Approximate ones included, whose residuals are NaN.
    total, certificate, operator, known_to
        See `Spectrum`.
    preview_path : Path, optional
        ``.npy`` file with approximate rows, of which those after the exact ones count.
    n_exact : int
        How many are exact.
    error : float
        Expected relative error of the approximate eigenvalues.
    alignment : Alignment, optional
        Signs and rotations of the exact rows on the render.
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
    n_exact: int = 0
    error: float = 0.0
    alignment: Alignment | None = None
    remark: str = ""
    known_to: float = 0.0

    @cached_property
    def spectrum(self) -> Spectrum:
        """The same as the views read it; the first access opens the files."""
        path = self.preview_path
        preview = None if path is None else np.load(path, mmap_mode="r")
        exact = None
        if self.stored is not None and self.n_exact:
            exact = self.stored.map(self.n_exact)
        rows: npt.NDArray[np.floating[Any]] | ShownRows
        shown = None
        if exact is None:
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
            certificate=self.certificate,
            preview=preview is not None,
            operator=self.operator,
            n_exact=self.n_exact,
            error=self.error,
            shown=shown,
            known_to=self.known_to,
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


@dataclass(frozen=True)
class Written:
    """A file that was exported, and what there is to say of what is in it."""

    path: Path
    description: str
    remark: str = ""

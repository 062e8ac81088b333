"""Stand-in until io/store.py is there (not to be kept)."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np


class Stored:
    def __init__(self, eigenvalues, residuals, rows, complete, proof, mass):
        self.eigenvalues, self.residuals, self.rows = eigenvalues, residuals, rows
        self.complete, self.proof, self.mass = complete, proof, mass


class EigenpairStore:
    def __init__(self, folder):
        self.folder = folder
        self.message = ""

    @classmethod
    def open_or_create(cls, mesh, operator, root=None):
        base = Path(root or Path(tempfile.gettempdir()) / f"mm-interim-{os.getuid()}")
        key = f"{mesh.content_hash[:24]}-{operator.robust}-{operator.mollify_factor:g}"
        folder = base / key
        folder.mkdir(parents=True, exist_ok=True)
        return cls(folder)

    def allocate(self, k, n):
        (self.folder / "eigenvectors.npy").unlink(missing_ok=True)
        self.rows = np.lib.format.open_memmap(
            self.folder / "eigenvectors.npy", "w+", np.float64, (k, n)
        )
        return self.rows

    def append(self, start, eigenvalues, residuals):
        pass

    def finish(self, decomposition):
        self.rows.flush()
        np.savez(
            self.folder / "meta.npz",
            eigenvalues=decomposition.eigenvalues,
            residuals=decomposition.residuals,
            proof=decomposition.proof(),
            mass=decomposition.mass,
            complete=decomposition.complete,
        )

    def load(self):
        if not (self.folder / "meta.npz").exists():
            return None
        with np.load(self.folder / "meta.npz") as meta:
            rows = np.load(self.folder / "eigenvectors.npy", mmap_mode="r")
            return Stored(
                meta["eigenvalues"],
                meta["residuals"],
                rows,
                bool(meta["complete"]),
                str(meta["proof"]),
                meta["mass"],
            )

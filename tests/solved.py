"""Cached spectra of test meshes."""

from __future__ import annotations

from functools import cache

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve


@cache
def spectrum_of(mesh: Mesh, n_pairs: int) -> Eigenpairs:
    """Return the lowest pairs of a mesh under the robust Laplacian, cached for equal calls."""
    found = solve(*cotangent_laplacian(mesh, robust=True), n_pairs)
    return Eigenpairs(
        found.eigenvalues,
        found.rows,
        found.residuals,
        total=n_pairs,
        certificate=found.certificate,
    )

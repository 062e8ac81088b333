"""Rebuilding a mesh from its lowest eigenfunctions, from the command line."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import wavelength
from meshmash_viewer.units import counted, format_quantity

if TYPE_CHECKING:
    from meshmash_viewer.cli.commands import Solver

__all__ = ["described_reconstruction", "write_reconstruction"]


def write_reconstruction(
    mesh: Mesh, path: Path, solver: Solver, repairs: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Rebuild the coordinates of a mesh from its eigenpairs, and write the smoothed mesh.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        Its ending says the format, see `meshmash_viewer.io.write.MESH_WRITERS`.
    solver : Solver
        All of its eigenpairs are used.
    repairs : tuple of str
        What has been done to the mesh, for the file to say.

    Returns
    -------
    dict
        JSON-able report. ``rms_distance`` is the root mean square distance of a point of the
        surface from where it was, ``largest_distance`` that of the farthest vertex, in ``unit``.

    Raises
    ------
    InputError
        If all eigenpairs are constants, the ending is unknown, or the system refuses.
    """
    from meshmash_viewer.features.shape import low_pass_vertices
    from meshmash_viewer.io.provenance import export_options, provenance
    from meshmash_viewer.io.write import write_mesh

    began = time.perf_counter()
    pairs = solver(mesh)
    if not pairs.eigenvalues[-1] > 0.0:
        raise InputError(
            f"{mesh.name}: all {counted(pairs.n_components, 'eigenpair')} are constants of its"
            f" {counted(mesh.n_components, 'component')}, from which each would be a point: take"
            " more pairs (--count, --max-eigenvalue, --wavelength), or --largest-component."
        )
    vertices = low_pass_vertices(mesh, pairs, pairs.n_components)
    used = pairs.mass > 0.0
    distances = np.linalg.norm(vertices - mesh.vertices, axis=1)[used]
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(path),
        "unit": mesh.unit,
        "n_eigenpairs": pairs.n_components,
        "max_eigenvalue": float(pairs.eigenvalues[-1]),
        "wavelength": wavelength(float(pairs.eigenvalues[-1])),
        "rms_distance": float(np.sqrt(np.average(distances**2, weights=pairs.mass[used]))),
        "largest_distance": float(distances.max()),
        "proof": pairs.proof(mesh.unit),
    }
    options = export_options(
        "reconstruction", solver.operator, solver.target, report["proof"], repairs
    )
    options["rms_distance"] = report["rms_distance"]
    write_mesh(path, replace(mesh, vertices=vertices), provenance(mesh, options))
    report["seconds"] = round(time.perf_counter() - began, 3)
    return report


def described_reconstruction(report: dict[str, Any]) -> str:
    """A report in a sentence."""
    typical, most = (
        format_quantity(report[name], report["unit"])
        for name in ("rms_distance", "largest_distance")
    )
    return (
        f"{report['output']}: rebuilt from {counted(report['n_eigenpairs'], 'eigenpair')};"
        f" vertices are {typical} from where they were (root mean square), {most} at most"
    )

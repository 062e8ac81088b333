"""Comparing two meshes from the command line."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import Target

if TYPE_CHECKING:
    from meshmash_viewer.cli.commands import Solver
    from meshmash_viewer.fields.family import Family

__all__ = ["described_comparison", "write_comparison"]


def write_comparison(
    meshes: tuple[Mesh, Mesh], family: Family, solver: Solver, path: Path | None
) -> dict[str, Any]:
    """Compare two meshes, and write which vertex of the second each of the first looks like.

    Parameters
    ----------
    meshes : tuple of two Mesh
    family : Family
        In whose exported columns vertices are matched.
    solver : Solver
        Of the first; the second is decomposed up to the same eigenvalue times area.
    path : Path, optional
        Where the match goes, one row for each vertex of the first; its ending says the format.

    Returns
    -------
    dict
        JSON-able report.

    Raises
    ------
    InputError
        If a mesh has too few vertices for that.
    """
    from meshmash_viewer.features.comparison import (
        check_comparable,
        compare_shapes,
        comparison_remarks,
        matched_top,
        unit_area_spectrum,
    )
    from meshmash_viewer.io.provenance import export_options
    from meshmash_viewer.io.write import write_features

    began = time.perf_counter()
    first_mesh, second_mesh = meshes
    first = solver(first_mesh)
    asked = solver.target
    top = matched_top(first, second_mesh.area)
    # as far up the spectrum of the second, where it has one that far
    solver.target = Target("max_eigenvalue", top) if top > 0.0 else asked
    second = solver(second_mesh)
    for mesh, pairs in zip(meshes, (first, second), strict=True):
        check_comparable(mesh.name, mesh.n_vertices, pairs.eigenvalues)
    found = compare_shapes(first, second, family.bank(unit_area_spectrum(first)))
    told = found.functions.told
    report: dict[str, Any] = {
        "meshes": [mesh.name for mesh in meshes],
        "kind": family.export,
        "n_eigenpairs": [first.n_components, second.n_components],
        "compared": len(found.spectra[0]),
        "complete": first.complete and second.complete,
        "spectral_distance": found.distance,
        "relative_distance": found.relative_distance,
        "mutual_share": found.mutual_share,
        "median_score": float(np.nanmedian(found.forth.scores)),
        "eigenfunctions": [
            {"first": int(index), "second": int(found.functions.indices[index]),
             "sign": int(found.functions.signs[index]),
             "correlation": float(found.functions.correlations[index])}
            for index in np.flatnonzero(told)
        ],
        "remarks": comparison_remarks(*meshes),
        "output": None if path is None else str(path),
    }  # fmt: skip
    if path is not None:
        proof = f"{first.proof(first_mesh.unit)}; {second.proof(second_mesh.unit)}"
        options = export_options("match", solver.operator, asked, proof)
        options["matched_in"] = family.export
        write_features(path, found.match_table(second_mesh.name), first_mesh, meta=options)
    report["seconds"] = round(time.perf_counter() - began, 3)
    return report


def described_comparison(report: dict[str, Any]) -> str:
    """The figures of a comparison for people."""
    first, second = (name or "mesh" for name in report["meshes"])
    told = report["eigenfunctions"]
    flipped = sum(1 for each in told if each["sign"] < 0)
    moved = sum(1 for each in told if each["first"] != each["second"])
    compared = report["compared"]
    rows = [
        ("eigenvalues compared", f"{compared:,}, times area"),
        (
            "spectral distance",
            f"{report['spectral_distance']:.4g} ({100 * report['relative_distance']:.2g} % of the"
            " spectrum)",
        ),
        ("mutual matches", f"{100 * report['mutual_share']:.1f} % of the vertices of {first}"),
        (
            "eigenfunctions told",
            f"{len(told)} of {compared}, {flipped} of them flipped, {moved} at another index",
        ),
    ]
    width = max(len(name) for name, _ in rows)
    title = f"{first} and {second}, matched in {report['kind']}"
    lines = [title, *(f"  {name:<{width}}  {value}" for name, value in rows)]
    return "\n".join([*lines, *([f"  {report['output']}"] if report["output"] else [])])

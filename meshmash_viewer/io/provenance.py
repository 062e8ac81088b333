"""How a file was made: what every export says of itself."""

from __future__ import annotations

import datetime
import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from typing import TYPE_CHECKING, Any

from meshmash_viewer.errors import printable
from meshmash_viewer.units import LENGTH_UNITS

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.weyl import Target

#: The packages whose numbers end up in a file.
_PACKAGES = ("numpy", "scipy", "robust_laplacian")


def provenance(mesh: Mesh, options: dict[str, Any] | None = None) -> dict[str, Any]:
    """Describe a mesh, what was done to it, by which versions, and when.

    Parameters
    ----------
    mesh : Mesh
    options : dict, optional
        JSON-able choices that led to the result, with their units.

    Returns
    -------
    dict
        JSON-able: ``program``, ``created`` (ISO 8601, UTC), ``mesh`` (name, SHA-256 of its
        content, unit, voxel, brain structure if known, counts; of a repaired one the number of
        vertices of its file), ``options``, ``versions``.
    """
    versions = {package: metadata.version(package) for package in _PACKAGES}
    return {
        "program": f"meshmash-viewer {metadata.version('meshmash-viewer')}",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "mesh": {
            "name": mesh.name,
            "hash": mesh.content_hash,
            "unit": mesh.unit,
            "voxel": mesh.voxel,
            **({"structure": mesh.structure} if mesh.structure else {}),
            "n_vertices": mesh.n_vertices,
            "n_faces": mesh.n_faces,
            **({} if mesh.numbering is None else {"n_file_vertices": mesh.n_file_vertices}),
        },
        "options": dict(options or {}),
        "versions": {"python": platform.python_version(), **versions},
    }


def export_options(
    kind: str,
    operator: OperatorOptions,
    target: Target,
    proof: str,
    repairs: Sequence[str] = (),
    *,
    whole_mesh: bool = False,
) -> dict[str, Any]:
    """The choices that led to exported features or eigenpairs, for `provenance`.

    Parameters
    ----------
    kind : str
        What was exported: "hks", "eigenpairs", ...
    operator : OperatorOptions
        Of the Laplacian.
    target : Target
        How much of the spectrum was used.
    proof : str
        What the eigenpairs have been shown to be; "" where none took part.
    repairs : sequence of str
        What had been done to the mesh.
    whole_mesh : bool
        Whether the results are written at all vertices of the mesh before the repairs.

    Returns
    -------
    dict
        JSON-able: ``kind``, ``repairs``, ``whole_mesh`` where there are some, and of eigenpairs
        ``operator``, ``target``, ``proof``.
    """
    options: dict[str, Any] = {"kind": kind}
    if proof:
        options |= {"operator": asdict(operator), "target": asdict(target), "proof": proof}
    if repairs:
        options |= {"repairs": list(repairs), "whole_mesh": whole_mesh}
    return options


def stated_unit(meta: str) -> str | None:
    """The unit of the mesh in the JSON text of `provenance`; None in another program's text."""
    unit = _stated_of_mesh(meta).get("unit")
    return unit if unit in LENGTH_UNITS else None


def stated_structure(meta: str) -> str:
    """The brain structure in the JSON text of `provenance`; "" if there is none."""
    structure = _stated_of_mesh(meta).get("structure")
    return printable(structure, 60) if isinstance(structure, str) else ""


def _stated_of_mesh(meta: str) -> dict[str, Any]:
    try:
        about = json.loads(meta)["mesh"]
    except (ValueError, KeyError, TypeError):
        return {}
    return about if isinstance(about, dict) else {}

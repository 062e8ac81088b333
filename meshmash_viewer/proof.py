"""The unit in the line that says how far eigenpairs can be trusted."""

from __future__ import annotations

import re

from meshmash_viewer.units import power_unit

__all__ = ["proof_in_unit"]

#: The eigenvalue that a count goes to; an eigensolver knows matrices, and so no unit.
_BOUND = re.compile(r"\b(?:below|to) [-+.0-9e]*[0-9]")


def proof_in_unit(proof: str, unit: str) -> str:
    """Give the eigenvalue up to which a proof counts the unit that it has on a mesh.

    Parameters
    ----------
    proof : str
        As `Decomposition.proof` writes it for matrices: "(inertia 203 below 2.663e+04)".
    unit : str
        Length unit of the mesh; "" where it has none.

    Returns
    -------
    str
        "(inertia 203 below 2.663e+04 mm⁻²)".
    """
    written = power_unit(unit, -2)
    return _BOUND.sub(lambda bound: f"{bound[0]} {written}", proof) if written else proof

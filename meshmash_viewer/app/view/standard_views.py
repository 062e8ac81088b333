"""Six views along the axes; of a brain surface they are lateral, medial, and so on.

Coordinates of brains are those of FreeSurfer: x to the right, y to the front, z up.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.app.view.camera import upright_axis
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.structures import brain_side

#: Axis and side from which each view is seen, on a right hemisphere and on other meshes.
DIRECTIONS = {
    "lateral": (0, 1.0),
    "medial": (0, -1.0),
    "anterior": (1, 1.0),
    "posterior": (1, -1.0),
    "dorsal": (2, 1.0),
    "ventral": (2, -1.0),
}


def view_label(name: str, mesh: Mesh | None) -> str:
    """The name of one of `DIRECTIONS` for a mesh: "Lateral" of a hemisphere, else "From +x"."""
    side = None if mesh is None else brain_side(mesh.structure, mesh.name)
    axis, sign = DIRECTIONS[name]
    if side is None:
        return f"From {'+' if sign > 0.0 else '-'}{'xyz'[axis]}"
    if side == "" and axis == 0:
        return "From the right" if sign > 0.0 else "From the left"
    return name.capitalize()


def view_axes(name: str, mesh: Mesh) -> FloatArray:
    """Right, up and eye directions of one of `DIRECTIONS`, as rows, shape (3, 3)."""
    side = brain_side(mesh.structure, mesh.name)
    axis, sign = DIRECTIONS[name]
    if side == "left" and axis == 0:
        sign = -sign
    upright = 2 if side is not None else upright_axis(mesh, np.ptp(mesh.bounds, axis=0))
    eye = sign * np.eye(3)[axis]
    up = np.eye(3)[upright if axis != upright else 1]
    if axis == upright == 1:
        up = -sign * np.eye(3)[2]  # from above, the front is below
    return np.array([np.cross(up, eye), up, eye])

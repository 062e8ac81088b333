"""Time of the peer to its first picture: all pairs by SciPy's ARPACK, then a pyvista scene.

Started by `interaction.py` as ``python interaction_peer.py MESH.npz PAIRS``; prints JSON. The
steps are those of a script without a viewer: robust Laplacian, `eigsh` in shift-invert mode around
-1e-10 with a tolerance of 1e-10, `add_mesh` of the first function that is not constant, one frame.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
import pyvista as pv
from robust_laplacian import mesh_laplacian
from scipy.sparse.linalg import eigsh


def main() -> None:
    """Solve, draw, and print the times in seconds."""
    with np.load(sys.argv[1]) as archive:
        vertices, faces = archive["vertices"], archive["faces"]
    n_pairs = int(sys.argv[2])
    started = time.perf_counter()
    stiffness, mass = mesh_laplacian(vertices, faces)
    values, vectors = eigsh(stiffness, n_pairs, mass, sigma=-1e-10, tol=1e-10)
    solved = time.perf_counter()
    plotter = pv.Plotter(off_screen=True, window_size=(900, 600))
    surface = pv.PolyData.from_regular_faces(vertices, faces)
    surface.point_data["field"] = vectors[:, int(np.argsort(values)[1])]
    plotter.add_mesh(surface, scalars="field", smooth_shading=True)
    plotter.render()
    drawn = time.perf_counter()
    plotter.close()
    print(json.dumps({"solve": solved - started, "picture": drawn - started}))


if __name__ == "__main__":
    main()

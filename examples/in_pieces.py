"""Features of a large mesh, computed in overlapping pieces and stitched."""

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

TIMES = {"t_min": 3e5, "t_max": 4e5}  # each piece has its own spectrum: give the times

mesh = mv.read_mesh(sample_path("dendrite"))
stitcher = mv.MeshStitcher(mesh, n_jobs=1)
stitcher.split_mesh(max_vertex_threshold=8000, t_max=TIMES["t_max"])
values = stitcher.apply(mv.compute_hks, max_eigenvalue=1.7e-5, n_components=4, **TIMES)
print(f"{len(stitcher.pieces)} pieces, {values.shape}, {np.isnan(values).any(axis=1).sum()} NaN")
np.save("hks_in_pieces.npy", values)

"""Eigenfunctions on a pyvista mesh; in a notebook `mv.view(mesh, block=False)` opens the window."""

import pyvista as pv

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

surface = mv.mesh_to_poly(mv.read_mesh(sample_path("dendrite")))
eigenvalues, eigenvectors = mv.decompose_mesh(surface, n_components=10)
for index in (1, 2, 5):
    surface[f"phi_{index}"] = eigenvectors[:, index]
surface.save("eigenfunctions.vtp")

plotter = pv.Plotter(off_screen=True, window_size=(800, 600))
plotter.add_mesh(surface, scalars="phi_5", cmap="RdBu_r")
plotter.screenshot("phi_5.png")

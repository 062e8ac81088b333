"""Distances of all vertices from one vertex, and the mesh from its lowest eigenfunctions."""

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.features.shape import low_pass_vertices
from meshmash_viewer.samples import sample_path

mesh = mv.read_mesh(sample_path("dendrite"))
pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=100)

far = mv.biharmonic_distance(pairs.eigenvalues, pairs.eigenvectors, 100)
print(f"farthest from vertex 100: vertex {far.argmax()}")

for count in (10, 30, 100):
    places = low_pass_vertices(mesh, pairs, count)
    moved = np.linalg.norm(places - mesh.vertices, axis=1)
    print(f"{count} eigenfunctions: vertices move by {np.median(moved):.0f} nm in the median")
smooth = mv.Mesh(places, mesh.faces, mesh.unit, "smooth")
mv.mesh_to_poly(smooth).save("smooth.ply")

"""Matching vertices of two meshes, here of a mesh and its rotated, renumbered copy."""

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

first = mv.read_mesh(sample_path("dendrite"))
order = np.random.default_rng(0).permutation(first.n_vertices)
number = np.empty_like(order)
number[order] = np.arange(len(order))
second = mv.Mesh(first.vertices[order][:, [1, 2, 0]], number[first.faces], first.unit)

one, other = (
    mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=30)
    for mesh in (first, second)
)
found = mv.compare_shapes(one, other)
right = (number == found.forth.indices).mean()
print(f"spectral distance {found.distance:.1e}, {right:.0%} of the vertices found")
print("functions that are the same:", np.flatnonzero(found.functions.correlations > 0.9))
np.savetxt("match.csv", found.forth.indices, fmt="%d", header="second", comments="")

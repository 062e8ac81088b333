"""Spectrum of your own map, here the mean curvature, and the map smoothed by heat flow."""

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

mesh = mv.read_mesh(sample_path("dendrite"))
bend = mv.mean_curvature(mesh)  # or mv.read_maps("values.csv", mesh)[0].values
pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=80)

spectrum = mv.map_spectrum(pairs, bend)
mv.write_map_spectrum("bend_spectrum.csv", spectrum, mesh, "bend")
for count in (10, 40, 80):
    print(f"{count} pairs hold {spectrum.varying_share(count):.1%} of what varies")

smooth = mv.filter_map(pairs, bend, mv.formula_bank("exp(-t*x)", t=1e6))
print(f"standard deviation {bend.std():.2e}, smoothed {smooth.std():.2e} nm⁻¹")
np.save("bend_smooth.npy", smooth)

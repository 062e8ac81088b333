"""Features of filters given by formulas in λ: a pyramid of Gaussians, and one band."""

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

mesh = mv.read_mesh(sample_path("dendrite"))
pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=80)

pyramid = mv.formula_bank("exp(-s*x)", s=np.geomspace(1e6, 1e8, 6))
middle = pairs.eigenvalues[40]
band = mv.formula_bank("exp(-((x - c) / w)**2)", c=middle, w=0.2 * middle)

for name, bank in (("pyramid", pyramid), ("band", band)):
    features = mv.compute_features(pairs, bank, unit=mesh.unit, warn=False)
    mv.write_features(f"{name}.npz", features, mesh, eigenvalues=pairs.eigenvalues)
    print(f"{name}: {', '.join(features.columns)} in {features.unit}")

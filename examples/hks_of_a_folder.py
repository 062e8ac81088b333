"""Heat kernel signatures of all meshes of a folder, at the same times, one NPZ file each.

python hks_of_a_folder.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import meshmash_viewer as mv
from meshmash_viewer.samples import sample_path

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else sample_path().parent
bank = mv.heat_kernel_bank(np.geomspace(1e6, 1e8, 16))  # nm², so that columns of all meshes agree

for path in sorted(folder.glob("*.npz")):
    if path.stem.endswith("_labels"):
        continue
    mesh = mv.repair_mesh(mv.read_mesh(path), "drop_unreferenced_vertices")
    if mesh.unit != "nm":
        continue
    pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=60)
    features = mv.compute_features(pairs, bank, unit=mesh.unit, warn=False)
    mv.write_features(f"{mesh.name}_hks.npz", features, mesh)
    print(f"{mesh.name}: {features.values.shape}. {features.missing}")

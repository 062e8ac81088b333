"""MeshMash Viewer: Laplacian eigenfunctions, heat kernel signatures and spectral bands of meshes.

`__init__.pyi` lists the public names. Each is imported from its module at its first use, so that
importing the package loads neither Qt nor VTK. A mesh is ``(vertices, faces)``, any object with
these two attributes, a pyvista ``PolyData`` or a `Mesh`.

>>> import meshmash_viewer as mv
>>> from meshmash_viewer.samples import sample_path
>>> mesh = mv.read_mesh(sample_path("neuron"))
>>> eigenvalues, eigenvectors = mv.decompose_mesh(mesh, n_components=100)
>>> hks = mv.compute_hks(mesh, max_eigenvalue=eigenvalues[-1], n_components=32)
>>> window = mv.view(mesh)

Examples of functions also assume ``import numpy as np``, ``import trimesh``, a `folder` for files,
and 16 eigenpairs of a sphere: ``ball = trimesh.creation.icosphere(3)``,
``L, M = mv.cotangent_laplacian(ball)`` and ``pairs = mv.solve(L, M, 16)``.
"""

from __future__ import annotations

import lazy_loader

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

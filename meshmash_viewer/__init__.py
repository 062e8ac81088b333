"""MeshMash Viewer: Laplacian eigenfunctions, heat kernel signatures and spectral bands of meshes.

`__init__.pyi` lists the public names. Each is imported from its module at its first use, so that
importing the package loads neither Qt nor VTK. A mesh is ``(vertices, faces)``, any object with
these two attributes, a pyvista ``PolyData`` or a `Mesh`.

>>> import meshmash_viewer as mv
>>> mesh = mv.read_mesh("neuron.ply", unit="nm")
>>> eigenvalues, eigenvectors = mv.decompose_mesh(mesh, n_components=100)
>>> hks = mv.compute_hks(mesh, max_eigenvalue=eigenvalues[-1], n_components=32)
>>> mv.view(mesh)

Examples of functions also assume ``import numpy as np``, ``import trimesh``, a `folder` for files,
and 16 eigenpairs of a sphere: ``ball = trimesh.creation.icosphere(3)``,
``L, M = mv.cotangent_laplacian(ball)`` and ``pairs = mv.solve(L, M, 16)``.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

#: Module of each public name, from the list that type checkers read.
_MODULE_OF = {
    alias.name: str(node.module)
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

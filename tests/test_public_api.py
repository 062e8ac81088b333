"""Public names of the package: complete, and imported lazily."""

from __future__ import annotations

import subprocess
import sys
from inspect import signature

import numpy as np
import pytest

import meshmash_viewer
import meshmash_viewer as mv
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.comparison import match_functions
from meshmash_viewer.features.shape import low_pass_vertices


def test_every_public_name_is_there_and_no_other_is_shown():
    assert all(getattr(meshmash_viewer, name).__name__ for name in mv.__all__)
    assert sorted(mv.__all__) == dir(meshmash_viewer)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="attribute nothing"):
        _ = meshmash_viewer.nothing


def test_the_documented_places_to_import_from():
    from meshmash_viewer import decompose, laplacian

    for name in (
        "decompose_laplacian",
        "decompose_mesh",
        "decompose_laplacian_by_bands",
        "spectral_geometry_filter",
        "compute_hks",
        "compute_geometry_vectors",
        "get_hks_filter",
        "construct_bspline_basis",
        "construct_bspline_filter",
    ):
        assert getattr(meshmash_viewer, name) is getattr(decompose, name)
    for name in ("cotangent_laplacian", "area_matrix", "compute_vertex_areas"):
        assert getattr(meshmash_viewer, name) is getattr(laplacian, name)


def test_importing_loads_nothing_heavy():
    script = (
        "import sys, meshmash_viewer, meshmash_viewer.decompose\n"
        "heavy = ('PySide6', 'pyvista', 'vtkmodules', 'vtk', 'trimesh', 'robust_laplacian',\n"
        "         'pyqtgraph', 'matplotlib', 'pandas', 'pyarrow', 'nibabel', 'joblib', 'tqdm')\n"
        "print([name for name in heavy if name in sys.modules])\n"
    )
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (shown.stdout.strip(), shown.stderr) == ("[]", "")


SIGMA = {"sigma": -1e-10, "tol": 1e-10}
ROBUST = {"robust": True, "mollify_factor": 1e-5}
FEATURES = {"max_eigenvalue": 1e-8, "n_components": 32, "band_size": 50, "verbose": False}
DEFAULTS = {
    "cotangent_laplacian": {"robust": False, "mollify_factor": 1e-5},
    "compute_vertex_areas": {"robust": False, "mollify_factor": 1e-5},
    "decompose_laplacian": {"n_components": 100, "op_inv": None, **SIGMA, "ncv": None},
    "decompose_mesh": {"n_components": 100, "op_inv": None, **SIGMA, **ROBUST, "prefactor": None},
    "decompose_laplacian_by_bands": {
        "max_eigenvalue": 1e-9,
        "band_size": 50,
        "truncate_extra": True,
        "verbose": False,
    },
    "spectral_geometry_filter": {
        "filter": None,
        "max_eigenvalue": 1e-8,
        "band_size": 50,
        "truncate_extra": True,
        "drop_first": True,
        **ROBUST,
    },
    "compute_hks": {**FEATURES, **ROBUST, "truncate_extra": False, "drop_first": False},
    "compute_geometry_vectors": {**FEATURES, **ROBUST, "truncate_extra": False},
    "get_hks_filter": {"t_max": None, "t_min": None, "n_scales": 32},
}


@pytest.mark.parametrize("name", DEFAULTS)
def test_documented_defaults(name):
    found = signature(getattr(meshmash_viewer, name)).parameters
    for parameter, default in DEFAULTS[name].items():
        assert found[parameter].default == default, parameter


@pytest.mark.parametrize(
    "call",
    [
        lambda pairs, sphere, folder: mv.compare_shapes(pairs, pairs),
        lambda pairs, sphere, folder: mv.compute_features(pairs, mv.heat_kernel_bank([1.0])),
        lambda pairs, sphere, folder: mv.distance_features(sphere, 0, "biharmonic", pairs),
        lambda pairs, sphere, folder: mv.filter_map(pairs, np.ones(642), lambda x: x),
        lambda pairs, sphere, folder: mv.functional_map(pairs, pairs),
        lambda pairs, sphere, folder: low_pass_vertices(sphere, pairs, 3),
        lambda pairs, sphere, folder: mv.map_spectrum(pairs, np.ones(642)),
        lambda pairs, sphere, folder: match_functions(pairs, pairs, range(642)),
        lambda pairs, sphere, folder: mv.write_eigenpairs(folder / "pairs.npz", pairs, sphere),
        lambda pairs, sphere, folder: mv.zoomout(pairs, pairs, None),
    ],
)
def test_values_and_vectors_without_areas_are_no_eigenpairs(call, sphere, tmp_path):
    """`decompose_mesh` returns eigenvalues and eigenvectors without the mass matrix."""
    pairs = np.zeros(8), np.ones((sphere.n_vertices, 8))
    with pytest.raises(InputError, match=r"takes eigenpairs as solve returns them, not .* tuple"):
        call(pairs, sphere, tmp_path)
    assert not list(tmp_path.iterdir())


def test_few_public_names():
    assert len(mv.__all__) <= 75

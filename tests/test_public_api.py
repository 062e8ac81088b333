"""Public names of the package: complete, and imported lazily."""

from __future__ import annotations

import subprocess
import sys
from inspect import signature

import pytest

import meshmash_viewer
import meshmash_viewer as mv


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


def test_few_public_names():
    assert len(mv.__all__) <= 75

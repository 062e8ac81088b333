"""MeshMash Viewer: Laplacian eigenfunctions, heat kernel signatures and spectral bands of meshes.

The names below are the public API, each loaded from its module when it is first used, so that
importing the package costs nothing and loads neither Qt nor VTK. A mesh is ``(vertices, faces)``,
any object with these two attributes, a pyvista ``PolyData`` or a `Mesh`.

>>> import meshmash_viewer as mv
>>> mesh = mv.read_mesh("neuron.ply", unit="nm")
>>> eigenvalues, eigenvectors = mv.decompose_mesh(mesh, n_components=100)
>>> hks = mv.compute_hks(mesh, max_eigenvalue=eigenvalues[-1], n_components=32)
>>> mv.view(mesh)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshmash_viewer.app.run import view as view
    from meshmash_viewer.decompose import (
        compute_geometry_vectors as compute_geometry_vectors,
    )
    from meshmash_viewer.decompose import compute_hks as compute_hks
    from meshmash_viewer.decompose import decompose_laplacian as decompose_laplacian
    from meshmash_viewer.decompose import (
        decompose_laplacian_by_bands as decompose_laplacian_by_bands,
    )
    from meshmash_viewer.decompose import decompose_mesh as decompose_mesh
    from meshmash_viewer.decompose import spectral_geometry_filter as spectral_geometry_filter
    from meshmash_viewer.errors import InputError as InputError
    from meshmash_viewer.errors import TruncationWarning as TruncationWarning
    from meshmash_viewer.features.comparison import Comparison as Comparison
    from meshmash_viewer.features.comparison import FunctionMatches as FunctionMatches
    from meshmash_viewer.features.comparison import compare_shapes as compare_shapes
    from meshmash_viewer.features.comparison import distinct_matches as distinct_matches
    from meshmash_viewer.features.comparison import match_functions as match_functions
    from meshmash_viewer.features.distances import GeodesicSolver as GeodesicSolver
    from meshmash_viewer.features.distances import biharmonic_distance as biharmonic_distance
    from meshmash_viewer.features.distances import commute_time_distance as commute_time_distance
    from meshmash_viewer.features.distances import diffusion_distance as diffusion_distance
    from meshmash_viewer.features.distances import distance_features as distance_features
    from meshmash_viewer.features.distances import geodesic_distance as geodesic_distance
    from meshmash_viewer.features.filters import FilterBank as FilterBank
    from meshmash_viewer.features.filters import band_pass_bank as band_pass_bank
    from meshmash_viewer.features.filters import bspline_bank as bspline_bank
    from meshmash_viewer.features.filters import construct_bspline_basis as construct_bspline_basis
    from meshmash_viewer.features.filters import (
        construct_bspline_filter as construct_bspline_filter,
    )
    from meshmash_viewer.features.filters import gaussian_pyramid_bank as gaussian_pyramid_bank
    from meshmash_viewer.features.filters import get_hks_filter as get_hks_filter
    from meshmash_viewer.features.filters import heat_kernel_bank as heat_kernel_bank
    from meshmash_viewer.features.filters import hks_times as hks_times
    from meshmash_viewer.features.filters import low_pass_bank as low_pass_bank
    from meshmash_viewer.features.filters import wave_kernel_bank as wave_kernel_bank
    from meshmash_viewer.features.formula import formula_bank as formula_bank
    from meshmash_viewer.features.map_spectrum import MapSpectrum as MapSpectrum
    from meshmash_viewer.features.map_spectrum import dominant_bands as dominant_bands
    from meshmash_viewer.features.map_spectrum import map_spectrum as map_spectrum
    from meshmash_viewer.features.shape import feature_distance as feature_distance
    from meshmash_viewer.features.shape import low_pass_vertices as low_pass_vertices
    from meshmash_viewer.features.shape import match_features as match_features
    from meshmash_viewer.features.shape import reconstruct as reconstruct
    from meshmash_viewer.features.shape import spectral_coefficients as spectral_coefficients
    from meshmash_viewer.features.shape import spectral_distance as spectral_distance
    from meshmash_viewer.features.smoothing import filter_map as filter_map
    from meshmash_viewer.features.sums import Features as Features
    from meshmash_viewer.features.sums import compute_features as compute_features
    from meshmash_viewer.features.truncation import Truncation as Truncation
    from meshmash_viewer.health import largest_component as largest_component
    from meshmash_viewer.health import mesh_health as mesh_health
    from meshmash_viewer.health import repair_mesh as repair_mesh
    from meshmash_viewer.io.maps import read_maps as read_maps
    from meshmash_viewer.io.napari import to_napari as to_napari
    from meshmash_viewer.io.read import read_mesh as read_mesh
    from meshmash_viewer.io.write import write_eigenpairs as write_eigenpairs
    from meshmash_viewer.io.write import write_features as write_features
    from meshmash_viewer.io.write import write_map_spectrum as write_map_spectrum
    from meshmash_viewer.laplacian import area_matrix as area_matrix
    from meshmash_viewer.laplacian import compute_vertex_areas as compute_vertex_areas
    from meshmash_viewer.laplacian import cotangent_laplacian as cotangent_laplacian
    from meshmash_viewer.mesh import Mesh as Mesh
    from meshmash_viewer.mesh import mesh_to_poly as mesh_to_poly
    from meshmash_viewer.spectral.eigensolver import Decomposition as Decomposition
    from meshmash_viewer.spectral.eigensolver import iterate as iterate
    from meshmash_viewer.spectral.eigensolver import solve as solve
    from meshmash_viewer.spectral.weyl import weyl_count as weyl_count
    from meshmash_viewer.spectral.weyl import weyl_eigenvalue as weyl_eigenvalue
    from meshmash_viewer.split.stitcher import MeshStitcher as MeshStitcher
    from meshmash_viewer.surface.curvature import gaussian_curvature as gaussian_curvature
    from meshmash_viewer.surface.curvature import mean_curvature as mean_curvature
    from meshmash_viewer.vertex_map import Label as Label
    from meshmash_viewer.vertex_map import VertexMap as VertexMap

__version__ = "0.1.0"

#: Module of each public name, in the order in which work goes.
_CONTENTS = {
    # Meshes: what they are, what is wrong with them, files
    "mesh": ("Mesh", "mesh_to_poly"),
    "health": ("largest_component", "mesh_health", "repair_mesh"),
    "vertex_map": ("Label", "VertexMap"),
    "io.read": ("read_mesh",),
    "io.maps": ("read_maps",),
    "io.napari": ("to_napari",),
    "io.write": ("write_eigenpairs", "write_features", "write_map_spectrum"),
    "errors": ("InputError", "TruncationWarning"),
    "surface.curvature": ("gaussian_curvature", "mean_curvature"),
    # Operators
    "laplacian": ("area_matrix", "compute_vertex_areas", "cotangent_laplacian"),
    # Eigenpairs
    "spectral.weyl": ("weyl_count", "weyl_eigenvalue"),
    "spectral.eigensolver": ("Decomposition", "iterate", "solve"),
    "decompose": (
        "decompose_laplacian",
        "decompose_laplacian_by_bands",
        "decompose_mesh",
        # and features in one call
        "compute_geometry_vectors",
        "compute_hks",
        "spectral_geometry_filter",
    ),
    # Filter banks, and features in two steps
    "features.filters": (
        "FilterBank",
        "band_pass_bank",
        "bspline_bank",
        "construct_bspline_basis",
        "construct_bspline_filter",
        "gaussian_pyramid_bank",
        "get_hks_filter",
        "heat_kernel_bank",
        "hks_times",
        "low_pass_bank",
        "wave_kernel_bank",
    ),
    "features.formula": ("formula_bank",),
    "features.sums": ("Features", "compute_features"),
    "features.truncation": ("Truncation",),
    # Maps through a filter, and on eigenfunctions
    "features.smoothing": ("filter_map",),
    "features.map_spectrum": ("MapSpectrum", "dominant_bands", "map_spectrum"),
    # Comparing shapes
    "features.shape": (
        "feature_distance",
        "low_pass_vertices",
        "match_features",
        "reconstruct",
        "spectral_coefficients",
        "spectral_distance",
    ),
    "features.comparison": (
        "Comparison",
        "FunctionMatches",
        "compare_shapes",
        "distinct_matches",
        "match_functions",
    ),
    # Distances from a vertex
    "features.distances": (
        "GeodesicSolver",
        "biharmonic_distance",
        "commute_time_distance",
        "diffusion_distance",
        "distance_features",
        "geodesic_distance",
    ),
    # Meshes too large for one go
    "split.stitcher": ("MeshStitcher",),
    # The window
    "app.run": ("view",),
}
_MODULE_OF = {name: module for module, names in _CONTENTS.items() for name in names}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

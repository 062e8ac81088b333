"""The public names, each from its module, in the order in which work goes."""

# Meshes: what they are, what is wrong with them, files
from .errors import InputError as InputError
from .errors import MeshWarning as MeshWarning
from .errors import MissingValuesWarning as MissingValuesWarning
from .errors import TruncationWarning as TruncationWarning
from .features.points import project_points as project_points
from .features.regions import regions as regions
from .health import largest_component as largest_component
from .health import mesh_health as mesh_health
from .health import repair_mesh as repair_mesh
from .io.maps import read_labels as read_labels
from .io.maps import read_maps as read_maps
from .io.maps import read_mask as read_mask
from .io.points import read_points as read_points
from .io.points import write_points as write_points
from .io.read import read_mesh as read_mesh
from .io.write import to_napari as to_napari
from .io.write import write_eigenpairs as write_eigenpairs
from .io.write import write_features as write_features
from .io.write import write_map_spectrum as write_map_spectrum
from .io.write_labels import write_labels as write_labels
from .mesh import Mesh as Mesh
from .mesh import mesh_to_poly as mesh_to_poly
from .surface.curvature import gaussian_curvature as gaussian_curvature
from .surface.curvature import mean_curvature as mean_curvature
from .vertex_map import Label as Label
from .vertex_map import VertexMap as VertexMap

# isort: split
# Operators
from .laplacian import area_matrix as area_matrix
from .laplacian import compute_vertex_areas as compute_vertex_areas
from .laplacian import cotangent_laplacian as cotangent_laplacian

# isort: split
# Eigenpairs
from .decompose import compute_geometry_vectors as compute_geometry_vectors
from .decompose import compute_hks as compute_hks
from .decompose import decompose_laplacian as decompose_laplacian
from .decompose import decompose_laplacian_by_bands as decompose_laplacian_by_bands
from .decompose import decompose_mesh as decompose_mesh
from .decompose import spectral_geometry_filter as spectral_geometry_filter
from .spectral.eigensolver import solve as solve
from .spectral.resolution import resolution_error as resolution_error

# isort: split
# Filter banks, and features in two steps
from .features.filters import FilterBank as FilterBank
from .features.filters import band_pass_bank as band_pass_bank
from .features.filters import bspline_bank as bspline_bank
from .features.filters import construct_bspline_basis as construct_bspline_basis
from .features.filters import construct_bspline_filter as construct_bspline_filter
from .features.filters import gaussian_pyramid_bank as gaussian_pyramid_bank
from .features.filters import get_hks_filter as get_hks_filter
from .features.filters import heat_kernel_bank as heat_kernel_bank
from .features.filters import low_pass_bank as low_pass_bank
from .features.filters import wave_kernel_bank as wave_kernel_bank
from .features.formula import formula_bank as formula_bank
from .features.sums import Features as Features
from .features.sums import compute_features as compute_features

# isort: split
# Maps through a filter, and on eigenfunctions
from .features.map_spectrum import dominant_bands as dominant_bands
from .features.map_spectrum import map_spectrum as map_spectrum
from .features.maps import filter_map as filter_map
from .features.maps import reconstruct as reconstruct
from .features.maps import spectral_coefficients as spectral_coefficients

# isort: split
# Comparing shapes
from .features.comparison import compare_shapes as compare_shapes
from .features.comparison import corresponding_vertices as corresponding_vertices
from .features.functional_map import functional_map as functional_map
from .features.functional_map import zoomout as zoomout
from .features.shape import feature_distance as feature_distance

# isort: split
# Classes learned from labels
from .io.models import read_classes as read_classes
from .io.models import write_classes as write_classes
from .learn.classes import predict_classes as predict_classes
from .learn.classes import train_classes as train_classes
from .learn.columns import ClassColumns as ClassColumns

# isort: split
# Distances from a vertex
from .features.distances import biharmonic_distance as biharmonic_distance
from .features.distances import commute_time_distance as commute_time_distance
from .features.distances import diffusion_distance as diffusion_distance
from .features.distances import distance_features as distance_features
from .surface.geodesics import GeodesicSolver as GeodesicSolver
from .surface.geodesics import geodesic_distance as geodesic_distance
from .surface.geodesics import nearest_distance as nearest_distance

# isort: split
# Meshes too large for one go
from .split.stitcher import MeshStitcher as MeshStitcher

# isort: split
# Domains, and their files
from .split.condensed import condensed_hks_pipeline as condensed_hks_pipeline

# isort: split
# The window
from .app.run import view as view

__version__: str
__all__: list[str]

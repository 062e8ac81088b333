"""The public names, each from its module, in the order in which work goes."""

# Meshes: what they are, what is wrong with them, files
from meshmash_viewer.errors import InputError as InputError
from meshmash_viewer.errors import MeshWarning as MeshWarning
from meshmash_viewer.errors import MissingValuesWarning as MissingValuesWarning
from meshmash_viewer.errors import TruncationWarning as TruncationWarning
from meshmash_viewer.features.points import Points as Points
from meshmash_viewer.features.points import ProjectedPoints as ProjectedPoints
from meshmash_viewer.features.points import project_points as project_points
from meshmash_viewer.features.regions import Regions as Regions
from meshmash_viewer.features.regions import regions as regions
from meshmash_viewer.health import largest_component as largest_component
from meshmash_viewer.health import mesh_health as mesh_health
from meshmash_viewer.health import repair_mesh as repair_mesh
from meshmash_viewer.io.maps import read_labels as read_labels
from meshmash_viewer.io.maps import read_maps as read_maps
from meshmash_viewer.io.maps import read_mask as read_mask
from meshmash_viewer.io.points import read_points as read_points
from meshmash_viewer.io.points import write_points as write_points
from meshmash_viewer.io.read import read_mesh as read_mesh
from meshmash_viewer.io.write import to_napari as to_napari
from meshmash_viewer.io.write import unused_path as unused_path
from meshmash_viewer.io.write import write_eigenpairs as write_eigenpairs
from meshmash_viewer.io.write import write_features as write_features
from meshmash_viewer.io.write import write_map_spectrum as write_map_spectrum
from meshmash_viewer.io.write_labels import write_labels as write_labels
from meshmash_viewer.io.write_labels import write_regions as write_regions
from meshmash_viewer.mesh import Mesh as Mesh
from meshmash_viewer.mesh import mesh_to_poly as mesh_to_poly
from meshmash_viewer.surface.curvature import gaussian_curvature as gaussian_curvature
from meshmash_viewer.surface.curvature import mean_curvature as mean_curvature
from meshmash_viewer.surface.curvature import mixed_areas as mixed_areas
from meshmash_viewer.vertex_map import Label as Label
from meshmash_viewer.vertex_map import VertexMap as VertexMap

# isort: split
# Operators
from meshmash_viewer.laplacian import area_matrix as area_matrix
from meshmash_viewer.laplacian import compute_vertex_areas as compute_vertex_areas
from meshmash_viewer.laplacian import cotangent_laplacian as cotangent_laplacian

# isort: split
# Eigenpairs
from meshmash_viewer.decompose import compute_geometry_vectors as compute_geometry_vectors
from meshmash_viewer.decompose import compute_hks as compute_hks
from meshmash_viewer.decompose import decompose_laplacian as decompose_laplacian
from meshmash_viewer.decompose import decompose_laplacian_by_bands as decompose_laplacian_by_bands
from meshmash_viewer.decompose import decompose_mesh as decompose_mesh
from meshmash_viewer.decompose import spectral_geometry_filter as spectral_geometry_filter
from meshmash_viewer.spectral.eigensolver import Decomposition as Decomposition
from meshmash_viewer.spectral.eigensolver import iterate as iterate
from meshmash_viewer.spectral.eigensolver import solve as solve
from meshmash_viewer.spectral.weyl import weyl_count as weyl_count
from meshmash_viewer.spectral.weyl import weyl_eigenvalue as weyl_eigenvalue

# isort: split
# Filter banks, and features in two steps
from meshmash_viewer.features.filter_responses import hks_times as hks_times
from meshmash_viewer.features.filters import FilterBank as FilterBank
from meshmash_viewer.features.filters import band_pass_bank as band_pass_bank
from meshmash_viewer.features.filters import bspline_bank as bspline_bank
from meshmash_viewer.features.filters import construct_bspline_basis as construct_bspline_basis
from meshmash_viewer.features.filters import construct_bspline_filter as construct_bspline_filter
from meshmash_viewer.features.filters import gaussian_pyramid_bank as gaussian_pyramid_bank
from meshmash_viewer.features.filters import get_hks_filter as get_hks_filter
from meshmash_viewer.features.filters import heat_kernel_bank as heat_kernel_bank
from meshmash_viewer.features.filters import low_pass_bank as low_pass_bank
from meshmash_viewer.features.filters import wave_kernel_bank as wave_kernel_bank
from meshmash_viewer.features.formula import formula_bank as formula_bank
from meshmash_viewer.features.sums import Features as Features
from meshmash_viewer.features.sums import compute_features as compute_features
from meshmash_viewer.features.truncation import Truncation as Truncation

# isort: split
# Maps through a filter, and on eigenfunctions
from meshmash_viewer.features.map_spectrum import MapSpectrum as MapSpectrum
from meshmash_viewer.features.map_spectrum import dominant_bands as dominant_bands
from meshmash_viewer.features.map_spectrum import map_spectrum as map_spectrum
from meshmash_viewer.features.maps import filter_map as filter_map
from meshmash_viewer.features.maps import reconstruct as reconstruct
from meshmash_viewer.features.maps import spectral_coefficients as spectral_coefficients

# isort: split
# Comparing shapes
from meshmash_viewer.features.comparison import Comparison as Comparison
from meshmash_viewer.features.comparison import FunctionMatches as FunctionMatches
from meshmash_viewer.features.comparison import compare_shapes as compare_shapes
from meshmash_viewer.features.comparison import corresponding_vertices as corresponding_vertices
from meshmash_viewer.features.comparison import match_functions as match_functions
from meshmash_viewer.features.functional_map import FunctionalMap as FunctionalMap
from meshmash_viewer.features.functional_map import functional_map as functional_map
from meshmash_viewer.features.functional_map import zoomout as zoomout
from meshmash_viewer.features.shape import distinct_matches as distinct_matches
from meshmash_viewer.features.shape import feature_distance as feature_distance
from meshmash_viewer.features.shape import low_pass_vertices as low_pass_vertices
from meshmash_viewer.features.shape import match_features as match_features
from meshmash_viewer.features.shape import spectral_distance as spectral_distance

# isort: split
# Classes learned from labels
from meshmash_viewer.io.models import read_classes as read_classes
from meshmash_viewer.io.models import write_classes as write_classes
from meshmash_viewer.learn.classes import ClassModel as ClassModel
from meshmash_viewer.learn.classes import ClassPrediction as ClassPrediction
from meshmash_viewer.learn.classes import predict_classes as predict_classes
from meshmash_viewer.learn.classes import train_classes as train_classes
from meshmash_viewer.learn.columns import ClassColumns as ClassColumns
from meshmash_viewer.learn.training import ClassScores as ClassScores

# isort: split
# Distances from a vertex
from meshmash_viewer.features.distances import GeodesicSolver as GeodesicSolver
from meshmash_viewer.features.distances import biharmonic_distance as biharmonic_distance
from meshmash_viewer.features.distances import commute_time_distance as commute_time_distance
from meshmash_viewer.features.distances import diffusion_distance as diffusion_distance
from meshmash_viewer.features.distances import distance_features as distance_features
from meshmash_viewer.features.distances import geodesic_distance as geodesic_distance

# isort: split
# Meshes too large for one go
from meshmash_viewer.split.stitcher import MeshStitcher as MeshStitcher

# isort: split
# Domains, and their files
from meshmash_viewer.features.domains import aggregate_features as aggregate_features
from meshmash_viewer.features.domains import condense_mesh_to_graph as condense_mesh_to_graph
from meshmash_viewer.features.domains import expand_features as expand_features
from meshmash_viewer.io.condensed import read_condensed_features as read_condensed_features
from meshmash_viewer.io.condensed import read_condensed_graph as read_condensed_graph
from meshmash_viewer.io.condensed import read_id_map as read_id_map
from meshmash_viewer.io.condensed import write_condensed_features as write_condensed_features
from meshmash_viewer.io.condensed import write_condensed_graph as write_condensed_graph
from meshmash_viewer.io.condensed import write_id_map as write_id_map
from meshmash_viewer.split.condensed import CondensedHKS as CondensedHKS
from meshmash_viewer.split.condensed import condensed_hks_pipeline as condensed_hks_pipeline

# isort: split
# The window
from meshmash_viewer.app.run import view as view

__version__: str
__all__: list[str]

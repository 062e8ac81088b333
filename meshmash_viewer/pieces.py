"""Domains of large meshes and the files of condensed neurons, by public name.

>>> from meshmash_viewer import pieces
>>> pieces.expand_features([10.0, 20.0], [0, 1, -1, 1]).tolist()
[10.0, 20.0, nan, 20.0]
"""

from meshmash_viewer.features.domains import (
    aggregate_features,
    condense_mesh_to_graph,
    expand_features,
)
from meshmash_viewer.io.condensed import (
    read_condensed_features,
    read_condensed_graph,
    read_id_map,
    write_condensed_features,
    write_condensed_graph,
    write_id_map,
)
from meshmash_viewer.split.condensed import CondensedHKS, condensed_hks_pipeline

__all__ = [
    "CondensedHKS",
    "aggregate_features",
    "condense_mesh_to_graph",
    "condensed_hks_pipeline",
    "expand_features",
    "read_condensed_features",
    "read_condensed_graph",
    "read_id_map",
    "write_condensed_features",
    "write_condensed_graph",
    "write_id_map",
]

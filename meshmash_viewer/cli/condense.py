"""The command condense: features and graphs of domains, in the formats of meshmash."""

from __future__ import annotations

import contextlib
import warnings
from argparse import Namespace
from pathlib import Path

import numpy as np

from meshmash_viewer.cli.batch import Report, for_each, watched
from meshmash_viewer.cli.outputs import folder_of, output_paths
from meshmash_viewer.errors import InputError, TruncationWarning, unknown_ending
from meshmash_viewer.features.domains import require
from meshmash_viewer.io.condensed import write_condensed_features, write_condensed_graph
from meshmash_viewer.io.write import check_output
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.split.condensed import condensed_hks_pipeline, nm_of
from meshmash_viewer.units import counted

#: Arguments of the pipeline that are options, and the power of length in their units.
_ARGUMENTS = {
    "n_components": 0, "t_min": 2, "t_max": 2, "max_eigenvalue": -2,
    "simplify_target_reduction": 0, "distance_threshold": 0, "min_vertex_threshold": 0,
    "nuc_point": 0,
}  # fmt: skip


def condense(options: Namespace) -> int:
    """Divide meshes into domains, and write the features and the graph of the domains."""
    require("fast_simplification", "sklearn", "pandas")
    outputs, graphs = (
        output_paths(options.mesh, given, kind, ".npz") if given is not None else []
        for given, kind in ((options.output, "domains"), (options.graphs, "graph"))
    )
    if same := set(outputs) & set(graphs):
        fault = f"{min(same)} would be both features and graph"
        raise InputError("same-file", fault, "give --graphs another folder")

    def work(mesh: Mesh, at: int, own: Namespace) -> Report:
        return _write(mesh, outputs[at], graphs[at] if graphs else None, own)

    with contextlib.ExitStack() as folders:
        for given in filter(None, (options.output, options.graphs)):
            folders.enter_context(folder_of(given))
        for path in (*outputs, *graphs):
            if path.suffix.lower() != ".npz":
                raise unknown_ending(path, [".npz"])
            check_output(path)
        return for_each(options, work, outputs=outputs, others=graphs)


def _write(mesh: Mesh, path: Path, graph: Path | None, options: Namespace) -> Report:
    scale = nm_of(mesh)
    arguments = {
        name: value * scale**power if power else value
        for name, power in _ARGUMENTS.items()
        if (value := getattr(options, name)) is not None
    }
    # the remarks of the report include the warnings
    ignored = warnings.catch_warnings(action="ignore", category=TruncationWarning)
    with watched(mesh) as callbacks, ignored:
        found = condensed_hks_pipeline(mesh, **arguments, n_jobs=options.jobs or -1, **callbacks)
    labels = np.full(mesh.n_file_vertices, -1, dtype=np.int64)
    labels[mesh.file_indices] = found.labels
    write_condensed_features(path, found.condensed_features, labels)
    if graph is not None:
        write_condensed_graph(graph, found.condensed_nodes, found.condensed_edges)
    report = {
        "mesh": mesh.name,
        "output": str(path),
        "graph": None if graph is None else str(graph),
        "n_domains": found.n_domains,
        "n_vertices": len(labels),
        "n_dropped": int(np.count_nonzero(labels < 0)),
        "n_simple_vertices": found.simple_mesh.n_vertices,
        "pieces": len(found.stitcher),
        "truncation": found.truncation.as_dict(),
        "seam_median": found.seams.tolist(),
        "remarks": [f"{each}." for each in found.remarks],
    }
    of_all = f"of {counted(found.simple_mesh.n_vertices, 'vertex')} after decimation"
    return report, f"{path}: {counted(found.n_domains, 'domain')} {of_all}"

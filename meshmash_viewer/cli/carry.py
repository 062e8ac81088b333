"""The command carry: transfer of maps and label sets from one mesh to others."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.cli.arguments import in_unit, made_with
from meshmash_viewer.cli.batch import (
    SET_LANDMARKS,
    Report,
    for_each,
    given_landmarks,
    masked_options,
    prepared,
    read,
    solved,
    with_maps,
)
from meshmash_viewer.cli.outputs import map_outputs, output_remarks, write_maps
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.comparison import (
    check_comparable,
    compare_shapes,
    comparison_remarks,
    corresponding_vertices,
    matched_top,
)
from meshmash_viewer.io.maps import read_labels
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted, format_share
from meshmash_viewer.vertex_map import VertexMap


def carry(options: Namespace) -> int:
    """Transfer maps and label sets of the first mesh to the others, and write them."""
    if len(options.mesh) < 2:
        fault = "carry takes the mesh with the maps, followed by the meshes that receive them"
        raise InputError("missing-argument", fault)
    with map_outputs(options, options.mesh[1:], "maps") as outputs:
        return _carry_to(outputs, options)


def _carry_to(outputs: list[Path], options: Namespace) -> int:
    own_of = masked_options(options)
    first = prepared(read(options.mesh[0], options), own_of[0])
    maps = _maps_of(first, options)
    pairs = solved(first, in_unit(own_of[0], first.unit), options.target)
    check_comparable(first.name, first.n_vertices, pairs.eigenvalues)

    def work(raw: Mesh, at: int, own: Namespace) -> Report:
        own.mask = own_of[at + 1].mask
        mesh = prepared(raw, own)
        top = matched_top(pairs, mesh.area)
        found = solved(mesh, own, Target("max_eigenvalue", top) if top > 0.0 else own.target)
        check_comparable(mesh.name, mesh.n_vertices, found.eigenvalues)
        landmarks = [(there, here) for here, there in given_landmarks(options, first, mesh)]
        matched = compare_shapes(
            found, pairs, vertices=corresponding_vertices(mesh, first), refine=True,
            landmarks=landmarks, meshes=(mesh, first), warn=False,
        )  # fmt: skip
        remarks = comparison_remarks(mesh, first, found=matched, set_landmarks=SET_LANDMARKS)
        if matched.doubt:
            doubts = "; ".join(each.removesuffix(".") for each in remarks)
            raise InputError("match-in-doubt", doubts)
        proof = f"{found.proof(mesh.unit)}; {pairs.proof(first.unit)}"
        made = made_with(own, "carried maps", own.target, proof)
        made["carried_from"] = {"mesh": first.name, "hash": first.content_hash}
        whole = raw if own.whole_mesh else None
        write_maps(outputs[at], matched.carried(maps), mesh, whole, made)
        report: dict[str, Any] = {
            "mesh": mesh.name,
            "output": str(outputs[at]),
            "maps": [each.name for each in maps],
            "same_vertices": matched.given,
            "mutual_share": matched.mutual_share,
            "median_score": float(np.nanmedian(matched.forth.scores)),
            "remarks": remarks + output_remarks(outputs[at], mesh),
        }
        mutual = f"{format_share(matched.mutual_share)} of the vertices matched mutually"
        how = "by index: the faces are the same" if matched.given else mutual
        said = f"{outputs[at]}: {counted(len(maps), 'map')} from {first.name or 'mesh'}, {how}"
        return report, said

    others = Namespace(**{**vars(options), "mesh": options.mesh[1:]})
    return for_each(others, work, repaired=False)  # --whole-mesh needs the mesh before repairs


def _maps_of(mesh: Mesh, options: Namespace) -> tuple[VertexMap, ...]:
    """Return the maps and labels named by the options, by default the maps of the mesh."""
    maps = with_maps(mesh, options.map).maps
    maps = maps[len(mesh.maps) :] if options.map or options.labels else maps
    if options.labels:
        maps = (read_labels(options.labels, mesh), *maps)
    if not maps:
        fault = f"{mesh.name} has no maps"
        raise InputError("no-maps", fault, "name a file of them with --labels or --map")
    return maps

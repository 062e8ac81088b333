"""The command points: nearest vertices of points, and their labels and features."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

from meshmash_viewer.cli.arguments import family_of, options_of, refuse_others
from meshmash_viewer.cli.batch import Report, for_each, with_maps
from meshmash_viewer.cli.features import computed_features, solved_target
from meshmash_viewer.errors import InputError, unknown_ending
from meshmash_viewer.features.points import ProjectedPoints, project_points
from meshmash_viewer.features.sums import Features
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.io.maps import read_labels
from meshmash_viewer.io.points import read_points, write_points
from meshmash_viewer.io.write import check_output
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.units import counted, format_quantity, written_unit
from meshmash_viewer.vertex_map import VertexMap


def projected(mesh: Mesh, options: Namespace) -> ProjectedPoints:
    """Read the points named by the options, and project them onto a mesh."""
    unit = options.points_unit
    if options.voxel is not None:
        voxel, own = options.voxel
        if not (own or mesh.unit):
            fault = "--voxel is in the unit of the mesh, which states none"
            raise InputError("no-unit", fault, "give --unit")
        unit = written_unit(own or mesh.unit, voxel)
    points = read_points(options.points, unit, options.position)
    return project_points(mesh, points, options.max_distance)


def points(options: Namespace) -> int:
    """Project points onto a mesh, and write them with labels and features at their vertices."""
    if options.output.suffix.lower() == ".npz":
        raise unknown_ending(options.output, [".csv", ".parquet", "or give --id-map"])
    check_output(options.output, "points")
    if options.id_map is not None:
        if options.id_map.suffix.lower() != ".npz":
            raise unknown_ending(options.id_map, [".npz"])
        check_output(options.id_map, "points")
    families = [EXPORTS[kind] for kind in options.kind]
    own = [each.option for family in families for each in options_of(family).values()]
    refuse_others(options, EXPORTS, own)
    more = [] if options.id_map is None else [options.id_map]
    return for_each(
        options, lambda mesh, _, own: _write(mesh, own), outputs=[options.output], others=more
    )


def _write(mesh: Mesh, options: Namespace) -> Report:
    found = projected(mesh, options)
    remarks = list(found.remarks)
    maps: list[VertexMap] = list(with_maps(mesh, options.map).maps[len(mesh.maps) :])
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(options.output),
        "unit": mesh.unit,
        "n_points": len(found),
        "n_near": found.n_near,
        "max_distance": found.max_distance,
        "remarks": remarks,
    }
    within = format_quantity(found.max_distance, mesh.unit)
    of = f"{found.n_near:,} of {counted(len(found), 'point')}"
    said = f"{options.output}: {of} within {within} of a vertex"
    if options.labels:
        labels = read_labels(options.labels, mesh)
        maps.insert(0, replace(labels, name="label"))
        columns = {name: values.tolist() for name, values in found.per_label(labels).items()}
        report["labels"] = columns
        counts = zip(columns["label"], columns["points"], strict=True)
        said += "; " + ", ".join(f"{name} {count:,}" for name, count in counts)
    features = [_features(mesh, kind, options, remarks) for kind in dict.fromkeys(options.kind)]
    made = {"features": list(options.kind), "repairs": list(options.repair)}
    made |= {"labels": options.labels, "mask": options.mask}
    write_points(options.output, found, *maps, *features, meta=made)
    if options.id_map is not None:
        write_points(options.id_map, found, meta=made)
    return report, said


def _features(mesh: Mesh, kind: str, options: Namespace, remarks: list[str]) -> Features:
    """Compute the features of a kind, and append remarks on them."""
    family = family_of(options, EXPORTS[kind]).at_vertices(mesh.vertex_of)
    family.check_mesh(mesh)
    said: list[str] = []
    mesh = mesh.with_only_maps()
    pairs, target = solved_target(mesh, family, options, said)
    found = computed_features(mesh, family, pairs, target, options, {"remarks": said})
    remarks += [f"{kind}: {each}" for each in said]
    return found

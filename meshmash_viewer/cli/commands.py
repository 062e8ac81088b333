"""The commands info, compare, reconstruct and regions."""

from __future__ import annotations

import time
from argparse import Namespace
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from meshmash_viewer.cli.arguments import made_with
from meshmash_viewer.cli.batch import (
    SET_LANDMARKS,
    Report,
    finite,
    for_each,
    given_landmarks,
    masked_options,
    pairs_report,
    prepared,
    print_report,
    read,
    solved,
    titled_rows,
    with_maps,
)
from meshmash_viewer.cli.points import projected
from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.features import MATCHED_COLUMNS
from meshmash_viewer.features.comparison import (
    check_comparable,
    compare_shapes,
    comparison_remarks,
    corresponding_vertices,
    matched_top,
    unit_area_spectrum,
)
from meshmash_viewer.features.regions import regions as measured_regions
from meshmash_viewer.features.shape import low_pass_vertices
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.health import first_repair, median_edge_length, mesh_health
from meshmash_viewer.io.maps import read_labels
from meshmash_viewer.io.provenance import provenance
from meshmash_viewer.io.spectrum import stored_answer
from meshmash_viewer.io.write import check_output, write_features, write_mesh
from meshmash_viewer.io.write_labels import write_regions
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.units import (
    NO_VOXEL,
    counted,
    format_lengths,
    format_number,
    format_quantity,
    format_share,
    written_unit,
)

# info -----------------------------------------------------------------------------------------


def info(options: Namespace) -> int:
    """Print health, size and spectrum of meshes."""

    def work(mesh: Mesh, index: int, own: Namespace) -> Report:
        about = {"path": str(own.mesh[index]), **_facts(mesh, own.target)}
        return about, _described_facts(about)

    return for_each(options, work)


def _facts(mesh: Mesh, target: Target) -> dict[str, Any]:
    """Return health, size, and the part of the spectrum that a target selects.

    Lengths are in ``unit``, eigenvalues in its inverse square. Entries of ``weyl`` are estimates by
    Weyl's law, except entries named in ``exact``: the target, and values from stored eigenpairs of
    the default Laplacian. ``merge_first`` is the repair that joins components that touch, if any.
    """
    health = mesh_health(mesh)
    first = first_repair("keep_largest_component", health)
    low, high = mesh.bounds
    n = health.n_vertices - health.unreferenced_vertices
    translation = Translation(health.area, n_vertices=n)
    request = Request(target.n_components, target.max_eigenvalue)
    if (known := stored_answer(mesh, OperatorOptions(), request)) is not None:
        translation = replace(translation, eigenvalues=known.eigenvalues, known_to=known.known_to)
    resolution = "" if known is None else known.resolution
    reached = {
        "n_eigenpairs": translation.count(target),
        "max_eigenvalue": translation.eigenvalue(target),
        "wavelength": translation.wavelength(target),
    }
    return {
        "name": mesh.name,
        "unit": mesh.unit,
        "voxel": mesh.voxel,
        "structure": mesh.structure,
        "hash": mesh.content_hash,
        **asdict(health),
        "merge_first": "" if first == "keep_largest_component" else first,
        "bounds": [low.tolist(), high.tolist()],
        "median_edge": median_edge_length(mesh),
        "resolution": resolution,
        "weyl": {
            "target": target.kind,
            **{name: finite(value) for name, (value, _) in reached.items()},
            "exact": [name for name, (_, exact) in reached.items() if exact],
        },
    }


def _described_facts(about: dict[str, Any]) -> str:
    unit, weyl = about["unit"], about["weyl"]
    extent = [high - low for low, high in zip(*about["bounds"], strict=True)]
    signs = {name: "" if name in weyl["exact"] else "≈ " for name in weyl}
    top = format_quantity(weyl["max_eigenvalue"], unit, -2)
    ambiguous, disagreeing = f"{about['ambiguous_edges']:,}", f"{about['disagreeing_edges']:,}"
    if about["ambiguous_edges"]:
        remedy = "; the repair drop_duplicate_faces removes most of them"
        ambiguous += " (the robust Laplacian depends on the order of faces there"
        ambiguous += f"{remedy if about['duplicate_faces'] else ''})"
    if about["disagreeing_edges"]:
        remedy = "the repair orient_faces turns faces until they agree"
        disagreeing += (
            f" ({remedy if about['reversed_faces'] else 'the surface has one side only'})"
        )
    share = format_share(about["largest_area"] / about["area"])
    components = f"{about['n_components']:,} (largest {about['largest_component']:,}"
    components += f", {share} of the area)" if about["n_components"] > 1 else ")"
    if about["merge_first"]:
        left = f"leaves {about['untouching_components']:,}"
        components += f"; they touch: the repair {about['merge_first']} {left}"
    rows = [
        ("vertices", f"{about['n_vertices']:,}"),
        ("triangles", f"{about['n_faces']:,}"),
        ("extent", format_lengths(extent, unit, 4)),
        ("area", format_quantity(about["area"], unit, 2, 4)),
        *([("voxel", written_unit(unit, about["voxel"]))] if about["voxel"] != NO_VOXEL else []),
        *([("structure", about["structure"])] if about["structure"] else []),
        ("components", components),
        ("boundary edges", f"{about['boundary_edges']:,}"),
        ("non-manifold edges", f"{about['nonmanifold_edges']:,}"),
        ("ambiguous edges", ambiguous),
        ("degenerate triangles", f"{about['degenerate_faces']:,}"),
        ("duplicate triangles", f"{about['duplicate_faces']:,}"),
        ("unreferenced vertices", f"{about['unreferenced_vertices']:,}"),
        ("disagreeing edges", disagreeing),
        ("vertices on seams", f"{about['seam_vertices']:,}"),
        ("coincident vertices", f"{about['coincident_vertices']:,}"),
        ("median edge", format_quantity(about["median_edge"], unit)),
        ("eigenpairs", f"{signs['n_eigenpairs']}{weyl['n_eigenpairs']:,.0f}"),
        ("  up to eigenvalue", signs["max_eigenvalue"] + top),
        ("  down to wavelength", signs["wavelength"] + format_quantity(weyl["wavelength"], unit)),
        *([("", about["resolution"])] if about["resolution"] else []),
    ]
    return titled_rows(f"{about['name']} ({unit or 'no unit stated'})", rows)


# compare --------------------------------------------------------------------------------------


def compare(options: Namespace) -> int:
    """Compare two meshes, and write the vertex of the second that matches each of the first."""
    if options.output is not None:
        check_output(options.output, "features")
    if options.landmark and not options.refine:
        raise conflicting("--landmark is used by --refine alone", "give --refine, too")
    began, target = time.perf_counter(), options.target
    family = next(each for each in FEATURES.values() if each.export == options.kind).exported(
        options.n_components or MATCHED_COLUMNS
    )
    read_as = [read(path, options) for path in options.mesh]
    own = masked_options(options)
    meshes = [prepared(*each) for each in zip(read_as, own, strict=True)]
    landmarks = given_landmarks(options, meshes[0], meshes[1])
    first = solved(meshes[0], own[0], target)
    # the second mesh is solved up to the same eigenvalue times area
    top = matched_top(first, meshes[1].area)
    second = solved(meshes[1], own[1], Target("max_eigenvalue", top) if top > 0.0 else target)
    for mesh, pairs in zip(meshes, (first, second), strict=True):
        check_comparable(mesh.name, mesh.n_vertices, pairs.eigenvalues)
    bank, vertices = family.bank(unit_area_spectrum(first)), corresponding_vertices(*meshes)
    found = compare_shapes(
        first, second, bank, vertices=vertices, refine=options.refine, landmarks=landmarks,
        meshes=(meshes[0], meshes[1]), warn=False,
    )  # fmt: skip
    report: dict[str, Any] = {
        "meshes": [mesh.name for mesh in meshes],
        "kind": family.export,
        "n_eigenpairs": [first.n_components, second.n_components],
        "compared": len(found.spectra[0]),
        "complete": first.complete and second.complete,
        "spectral_distance": found.distance,
        "relative_distance": found.relative_distance,
        "same_vertices": found.given,
        "refined": found.functional is not None,
        "moved_copy": found.is_moved_copy,
        "mutual_share": found.mutual_share,
        "reliable": not found.doubt,
        "median_score": float(np.nanmedian(found.forth.scores)),
        "eigenfunctions": [
            {
                "first": int(index),
                "second": int(found.functions.indices[index]),
                "sign": int(found.functions.signs[index]),
                "correlation": float(found.functions.correlations[index]),
            }
            for index in np.flatnonzero(found.functions.determined)
        ],
        "remarks": comparison_remarks(
            *meshes,
            found=found,
            set_landmarks=SET_LANDMARKS,
            refine="refine the match by ZoomOut (--refine)",
        ),
        "output": None if options.output is None else str(options.output),
    }
    if options.output is not None:
        proof = f"{first.proof(meshes[0].unit)}; {second.proof(meshes[1].unit)}"
        whole, made = options.whole_mesh, made_with(own[0], "match", target, proof)
        if own[1].mask is not None:
            made["second_mask"] = own[1].mask
        made["matched_in"] = family.export
        if found.functional is not None:
            made["refined"] = {"landmarks": len(landmarks)}
        table = found.match_table(meshes[1].name, meshes[1])
        table = table.on_file(meshes[0]) if whole else table
        write_features(options.output, table, read_as[0] if whole else meshes[0], meta=made)
    report["seconds"] = round(time.perf_counter() - began, 3)
    print_report(options, options.mesh[0], report, _described_comparison(report))
    return 0


def _described_comparison(report: dict[str, Any]) -> str:
    first, second = (name or "mesh" for name in report["meshes"])
    matched, compared = report["eigenfunctions"], report["compared"]
    flipped = sum(1 for each in matched if each["sign"] < 0)
    moved = sum(1 for each in matched if each["first"] != each["second"])
    distance = format_number(report["spectral_distance"])
    share = f"{format_share(report['relative_distance'], 2)} of the spectrum"
    vertices = "by index: the faces are the same"
    if not report["same_vertices"]:
        mutual = format_share(report["mutual_share"])
        how = ", refined by ZoomOut" if report["refined"] else ""
        how = ", as a moved copy" if report["moved_copy"] else how
        vertices = f"matched in {report['kind']}{how}, {mutual} of {first} mutually"
    rows = [
        ("eigenvalues compared", f"{compared:,}, times area"),
        ("spectral distance", f"{distance} ({share})"),
        ("vertices", vertices),
        (
            "eigenfunctions matched",
            f"{len(matched)} of {compared}, {flipped} of them flipped, {moved} at another index",
        ),
    ]
    said = titled_rows(f"{first} and {second}", rows)
    return f"{said}\n  {report['output']}" if report["output"] else said


# reconstruct ----------------------------------------------------------------------------------


def reconstruct(options: Namespace) -> int:
    """Rebuild the coordinates of a mesh from its eigenpairs, and write the smoothed mesh."""
    check_output(options.output, "mesh")
    return for_each(options, lambda mesh, _, own: _write_rebuilt(mesh, own))


def _write_rebuilt(mesh: Mesh, options: Namespace) -> Report:
    """Write the rebuilt mesh.

    In the report, ``rms_distance`` is the area-weighted root mean square displacement of the
    vertices, ``largest_distance`` the largest displacement, both in ``unit``.
    """
    path = options.output
    pairs = solved(mesh, options, options.target)
    if not pairs.eigenvalues[-1] > 0.0:
        raise InputError(
            "too-few-pairs",
            f"{mesh.name}: all {counted(pairs.n_components, 'eigenpair')} are constant on its"
            f" {counted(mesh.n_components, 'component')}, so each component would become a point",
            "take more pairs (--count, --max-eigenvalue, --wavelength), merge components that touch"
            " (see info), or give --largest-component",
        )
    vertices = low_pass_vertices(mesh, pairs, pairs.n_components)
    used = pairs.mass > 0.0
    distances = np.linalg.norm(vertices - mesh.vertices, axis=1)[used]
    typical = float(np.sqrt(np.average(distances**2, weights=pairs.mass[used])))
    most = float(distances.max())
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(path),
        "unit": mesh.unit,
        **pairs_report(pairs, mesh),
        "rms_distance": typical,
        "largest_distance": most,
    }
    made = made_with(options, "reconstruction", options.target, report["proof"])
    made["rms_distance"] = typical
    write_mesh(path, replace(mesh, vertices=vertices), provenance(mesh, made))
    return report, (
        f"{path}: rebuilt from {counted(pairs.n_components, 'eigenpair')}; vertices are"
        f" {format_quantity(typical, mesh.unit)} from where they were (root mean square),"
        f" {format_quantity(most, mesh.unit)} at most"
    )


# regions --------------------------------------------------------------------------------------


def regions(options: Namespace) -> int:
    """Measure the connected regions of labels, and write them as a table."""
    check_output(options.output, "regions")
    return for_each(options, lambda mesh, _, own: _write_measured(mesh, own))


def _write_measured(mesh: Mesh, options: Namespace) -> Report:
    path = options.output
    labels = read_labels(options.labels, mesh)
    maps = with_maps(mesh, options.map).maps[len(mesh.maps) :]
    table = measured_regions(mesh, labels, maps, whole=options.whole_labels)
    if options.points is not None:
        table = table.with_points(projected(mesh, options))
    made: dict[str, Any] = {"labels": options.labels, "repairs": list(options.repair)}
    if options.points is not None:
        made["points"] = str(options.points)
    write_regions(path, table, {**made, **({"mask": options.mask} if options.mask else {})})
    n_labels = len(set(table["label"].tolist()))
    report = {
        "mesh": mesh.name,
        "output": str(path),
        "unit": mesh.unit,
        "n_regions": len(table),
        "n_labels": n_labels,
        "remarks": list(table.remarks),
    }
    said = f"{path}: {counted(len(table), 'region')} of {counted(n_labels, 'label')}"
    said += ", means weighted by area" if maps else ""
    return report, said

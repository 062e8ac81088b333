"""The command features: columns or eigenpairs of meshes, written to files."""

from __future__ import annotations

import time
from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import Any

from meshmash_viewer.cli.arguments import (
    MAPS,
    chosen_family,
    chosen_operator,
    in_unit,
    made_with,
    refuse_others,
)
from meshmash_viewer.cli.batch import (
    Report,
    for_each,
    more_pairs,
    pairs_report,
    prepared,
    reach,
    solved,
    watched,
    with_maps,
)
from meshmash_viewer.cli.outputs import folder_of, output_paths, output_remarks
from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.features.sums import Features
from meshmash_viewer.features.truncation import sufficient_target
from meshmash_viewer.fields import EXPORTS, FEATURES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.io.write import check_output
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.export import maps_alone, write_results
from meshmash_viewer.model.pieces import Pieces, described_seams
from meshmash_viewer.spectral.cost import check_columns
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.resolution import resolved_pairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted


def features(options: Namespace) -> int:
    """Compute features of meshes, or eigenpairs, and write them."""
    if options.kind == MAPS:
        refuse_others(options, EXPORTS, ())
        featured = True
    else:
        featured = chosen_family(in_unit(options), EXPORTS).makes_features()
    _check_combination(options)
    outputs = output_paths(options.mesh, options.output, options.kind, f".{options.format}")

    def write(mesh: Mesh, at: int, own: Namespace) -> Report:
        if options.kind == MAPS:
            return _write_maps(mesh, outputs[at], own)
        write = _write_whole if options.pieces is None else _write_in_pieces
        return write(mesh, outputs[at], chosen_family(own, EXPORTS), own)

    with folder_of(options.output):
        for path in outputs:
            check_output(path, "features" if featured else "eigenpairs")
        # --whole-mesh needs the mesh before repairs
        return for_each(options, write, repaired=False, outputs=outputs)


def _check_combination(options: Namespace) -> None:
    """Raise `InputError` for options that exclude each other."""
    if options.target is None and options.t_min is None:
        fault = "--count auto takes as many eigenpairs as the shortest time of --kind hks needs"
        raise InputError("missing-argument", fault, "give --t-min, or a number")
    if options.accept_seams and options.pieces is None:
        raise conflicting("--accept-seams is for features in pieces", "give --pieces, or omit it")
    if options.map and len(options.mesh) > 1:
        raise conflicting(
            "--map is for one mesh",
            "give one, or store the values in the mesh files",
        )
    family = EXPORTS.get(options.kind)  # None for maps alone
    if (options.map or options.maps) and family is not None and not family.makes_features():
        raise conflicting(f"--map and --maps add columns to features, not to {options.kind}")
    of_whole_meshes = {
        "--tail": options.tail is not None,
        "--resolution": options.resolution,
        "--count auto": options.target is None,
        "--component-column": options.component_column,
        f"--kind {options.kind}": family not in FEATURES.values(),
    }
    for name, given in of_whole_meshes.items():
        if given and options.pieces is not None:
            raise conflicting(f"{name} needs the whole mesh", "omit it, or omit --pieces")


def _write_in_pieces(raw: Mesh, path: Path, family: Family, options: Namespace) -> Report:
    mesh = prepared(raw, options)
    _check_room(mesh, family)
    job = Pieces(
        mesh,
        path,
        family,
        options.pieces,
        options.target,
        chosen_operator(options),
        options.repair,
        raw if options.whole_mesh else None,
        options.drop_first,
        options.jobs or -1,
        getattr(options, "client", None),
        options.accept_seams,
    )
    with watched(mesh) as callbacks:
        try:
            report = job.write(**callbacks)
        except InputError as fault:
            if fault.code != "seams-differ":
                raise
            raise InputError(fault.code, f"{fault.fault} (--accept-seams)") from None
    return report, f"{path}: {described_seams(report)}"


def _write_maps(raw: Mesh, path: Path, options: Namespace) -> Report:
    """Write the maps of a mesh and of files, without features."""
    mesh = with_maps(prepared(raw, options), options.map)
    if not mesh.maps:
        raise InputError("no-maps", f"{mesh.name} has no maps", "name files of them with --map")
    found = maps_alone(mesh)
    if options.component_column:
        found = found.with_components(mesh)
    whole, made = options.whole_mesh, made_with(options, MAPS, options.target, "")
    write_results(path, found, mesh, raw if whole else None, None, made)
    report = {
        "mesh": mesh.name,
        "output": str(path),
        "kind": MAPS,
        "n_vertices": mesh.n_file_vertices if whole else mesh.n_vertices,
        "n_features": len(found.columns),
        "remarks": output_remarks(path, mesh),
    }
    return report, f"{path}: {counted(len(found.columns), 'column')}"


def _write_whole(raw: Mesh, path: Path, family: Family, options: Namespace) -> Report:
    """Compute one kind of features, or the eigenpairs, and write them."""
    began = time.perf_counter()
    remarks: list[str] = []
    mesh = _with_chosen_maps(prepared(raw, options), family, options, remarks)
    family = family.at_vertices(mesh.vertex_of)
    family.check_mesh(mesh)
    pairs, target = solved_target(mesh, family, options, remarks)
    seconds = time.perf_counter() - began
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(path),
        "kind": family.export,
        "n_vertices": mesh.n_file_vertices if options.whole_mesh else mesh.n_vertices,
        "remarks": remarks,
    }
    if pairs is not None:
        report |= {**pairs_report(pairs, mesh), "seconds_eigenpairs": round(seconds, 3)}
    results: Features | Eigenpairs | None = pairs
    if family.makes_features():
        results = computed_features(mesh, family, pairs, target, options, report)
    assert results is not None
    made = made_with(options, family.export, target, report.get("proof", ""))
    write_results(path, results, mesh, raw if options.whole_mesh else None, pairs, made)
    remarks += output_remarks(path, mesh)
    if pairs is None:
        return report, f"{path}: {counted(report['n_features'], 'column')}"
    return report, f"{path}: {report['proof']} · {reach(report, mesh)}"


def _with_chosen_maps(mesh: Mesh, family: Family, options: Namespace, remarks: list[str]) -> Mesh:
    """Return the mesh with the maps that become columns; add a remark on other maps."""
    if mesh.maps and not options.maps:
        names = ", ".join(each.name for each in mesh.maps)
        if family.makes_features():
            remarks.append(f"left out: {names}; --maps adds them as columns.")
        mesh = mesh.with_only_maps()
    return with_maps(mesh, options.map)


def solved_target(
    mesh: Mesh, family: Family, options: Namespace, remarks: list[str]
) -> tuple[Eigenpairs | None, Target]:
    """Return the eigenpairs of a mesh, None if the family needs none, and the target."""
    _check_room(mesh, family)
    n, target = mesh.n_vertices - len(mesh.unreferenced), options.target
    if target is None:  # --count auto
        needed = sufficient_target(options.t_min, mesh.area, n)
        pairs, limit = resolved_pairs(needed, mesh.area, n, partial(solved, mesh, options))
        remarks += [limit] if limit else []
        assert pairs.target is not None
        return pairs, pairs.target
    if not family.of_pairs:
        return None, target
    if (target.n_components or 0) > n:
        remarks.append(
            f"{target.n_components:,} eigenpairs were asked for; the mesh has {n:,}, and all of"
            " them are used."
        )
    return solved(mesh, options, target), target


def _check_room(mesh: Mesh, family: Family) -> None:
    """Raise `InputError` if the columns of a family take more than the free memory."""
    if family.counted:
        check_columns(mesh.n_vertices, getattr(family, family.counted))


def computed_features(
    mesh: Mesh,
    family: Family,
    pairs: Eigenpairs | None,
    target: Target,
    options: Namespace,
    report: dict[str, Any],
) -> Features:
    """Return the features of a family and the maps of the mesh as columns; complete the report."""
    bound, remarks = target.max_eigenvalue, report["remarks"]
    found = family.compute_features(
        pairs,
        mesh,
        bound,
        drop_first=options.drop_first,
        tail=options.tail,
        known_to=bound if pairs is not None and pairs.complete else None,
    )
    if pairs is not None and not (pairs.eigenvalues > 0.0).any():
        remarks.append(
            "all computed eigenvalues are zero, one for each connected component, so the features"
            " are constant on each component: compute more of the spectrum (a larger --count or"
            " --max-eigenvalue, a shorter --wavelength)."
        )
    if pairs is not None and (assumed := family.assumed(pairs, mesh.unit)):
        remarks.append(f"{assumed}, from the spectrum: give other values with --set; x is λ.")
    missing = found.truncation
    report["truncation"] = None if missing is None else missing.as_dict()
    if found.missing:
        remedy = more_pairs(pairs, family) if options.target is not None else ""
        remarks.append(f"{found.missing}{remedy}.")
    remarks += found.remarks(mesh, masked=options.mask is not None)
    found = found.with_maps(mesh)
    if options.component_column:
        found = found.with_components(mesh)
    report["n_features"] = len(found.columns)
    return found

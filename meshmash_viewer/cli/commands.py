"""The commands that measure and write: info, features, compare and reconstruct."""

from __future__ import annotations

import contextlib
import time
from argparse import Namespace
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.cli.arguments import chosen_family, chosen_operator
from meshmash_viewer.cli.batch import (
    finite,
    for_each,
    pairs_report,
    prepared,
    print_report,
    progress_bar,
    reach,
    read,
    solved,
    titled_rows,
    until_interrupted,
    with_maps,
)
from meshmash_viewer.cli.numbers import in_unit
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.comparison import (
    check_comparable,
    compare_shapes,
    comparison_remarks,
    corresponding_vertices,
    matched_top,
    unit_area_spectrum,
)
from meshmash_viewer.features.shape import low_pass_vertices
from meshmash_viewer.features.sums import Features
from meshmash_viewer.features.truncation import mesh_limit, sufficient_target
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.family import Family
from meshmash_viewer.health import median_edge_length, mesh_health
from meshmash_viewer.io.atomic import made_folder
from meshmash_viewer.io.provenance import export_options, provenance
from meshmash_viewer.io.read import mesh_name
from meshmash_viewer.io.spectrum import find_eigenpairs
from meshmash_viewer.io.write import check_output, write_eigenpairs, write_features, write_mesh
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.pieces import described_seams, write_in_pieces
from meshmash_viewer.spectral.eigensolver import Decomposition
from meshmash_viewer.spectral.weyl import Target, Translation, required_eigenvalue, wavelength
from meshmash_viewer.units import NO_VOXEL, counted, format_quantity, written_unit

# info -----------------------------------------------------------------------------------------


def info(options: Namespace) -> int:
    """Print health, size and spectrum of meshes."""

    def work(mesh: Mesh, index: int, own: Namespace) -> tuple[dict[str, Any], str]:
        about = {"path": str(own.mesh[index]), **_facts(mesh, own.target)}
        return about, _described_facts(about)

    return for_each(options, work)


def _facts(mesh: Mesh, target: Target) -> dict[str, Any]:
    """Report health, size, and the part of the spectrum that a target selects.

    Lengths are in ``unit``, eigenvalues in its inverse square; the entries of ``weyl`` are
    estimates by Weyl's law, except those that its ``exact`` names: what was asked for, and what the
    store of eigenpairs knows of the default Laplacian.
    """
    health = mesh_health(mesh)
    low, high = mesh.bounds
    n = health.n_vertices - health.unreferenced_vertices
    translation = Translation(health.area, n_vertices=n)
    stored = find_eigenpairs(mesh, OperatorOptions())
    count = None if stored is None else stored.covers(target)
    if stored is not None and count is not None:
        bound = target.max_eigenvalue or 0.0
        known = stored.eigenvalues[:count]
        translation = replace(translation, eigenvalues=known, known_to=bound)
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
        "bounds": [low.tolist(), high.tolist()],
        "median_edge": median_edge_length(mesh),
        "weyl": {
            "target": target.kind,
            **{name: finite(value) for name, (value, _) in reached.items()},
            "exact": [name for name, (_, exact) in reached.items() if exact],
        },
    }


def _described_facts(about: dict[str, Any]) -> str:
    unit, weyl = about["unit"], about["weyl"]
    extent = [high - low for low, high in zip(*about["bounds"], strict=True)]
    sizes = " × ".join(f"{side:.4g}" for side in extent)
    signs = {name: "" if name in weyl["exact"] else "≈ " for name in weyl}
    top = format_quantity(weyl["max_eigenvalue"], unit, -2)
    rows = [
        ("vertices", f"{about['n_vertices']:,}"),
        ("triangles", f"{about['n_faces']:,}"),
        ("extent", f"{sizes} {unit}".rstrip()),
        ("area", format_quantity(about["area"], unit, 2)),
        *([("voxel", written_unit(unit, about["voxel"]))] if about["voxel"] != NO_VOXEL else []),
        *([("structure", about["structure"])] if about["structure"] else []),
        ("components", f"{about['n_components']:,} (largest {about['largest_component']:,})"),
        ("boundary edges", f"{about['boundary_edges']:,}"),
        ("non-manifold edges", f"{about['nonmanifold_edges']:,}"),
        ("ambiguous edges", _ambiguous(about)),
        ("degenerate triangles", f"{about['degenerate_faces']:,}"),
        ("duplicate triangles", f"{about['duplicate_faces']:,}"),
        ("unreferenced vertices", f"{about['unreferenced_vertices']:,}"),
        ("disagreeing edges", _disagreeing(about)),
        ("vertices on seams", f"{about['seam_vertices']:,}"),
        ("coincident vertices", f"{about['coincident_vertices']:,}"),
        ("median edge", format_quantity(about["median_edge"], unit)),
        ("eigenpairs", f"{signs['n_eigenpairs']}{weyl['n_eigenpairs']:,.0f}"),
        ("  up to eigenvalue", signs["max_eigenvalue"] + top),
        ("  down to wavelength", signs["wavelength"] + format_quantity(weyl["wavelength"], unit)),
    ]
    return titled_rows(f"{about['name']} ({unit or 'no unit stated'})", rows)


def _ambiguous(about: dict[str, Any]) -> str:
    """Describe the count of these edges, and its consequence."""
    count, duplicates = about["ambiguous_edges"], about["duplicate_faces"]
    if not count:
        return "0"
    remedy = "; the repair drop_duplicate_faces removes most of them" if duplicates else ""
    return f"{count:,} (the robust Laplacian depends on the order of faces there{remedy})"


def _disagreeing(about: dict[str, Any]) -> str:
    """Describe the count of these edges, and the remedy."""
    count = about["disagreeing_edges"]
    if not count:
        return "0"
    remedy = "the repair orient_faces turns faces until they agree"
    return f"{count:,} ({remedy if about['reversed_faces'] else 'the surface has one side only'})"


# features -------------------------------------------------------------------------------------


def features(options: Namespace) -> int:
    """Compute features of meshes, or eigenpairs, and write them."""
    family = chosen_family(in_unit(options), EXPORTS)
    if options.target is None and options.t_min is None:
        raise InputError(
            "--count auto takes as many eigenpairs as the shortest time of --kind hks needs: give"
            " --t-min, or a number."
        )
    outputs = output_paths(options.mesh, options.output, options.kind, f".{options.format}")
    if options.pieces is not None:
        _check_pieces(options)
    if options.map and len(options.mesh) > 1:
        raise InputError("--map is of one mesh: name one, or put the values into the mesh files.")
    write = _write_whole if options.pieces is None else _write_in_pieces
    folder = Path(options.output) if _is_folder(options.output) else None
    with made_folder(folder) if folder else contextlib.nullcontext():
        for path in outputs:
            check_output(path, "features" if family.makes_features() else "eigenpairs")
        return for_each(
            options,
            lambda mesh, at, own: write(mesh, outputs[at], chosen_family(own, EXPORTS), own),
            repaired=False,  # both are needed to write results at all vertices
        )


def _is_folder(output: str) -> bool:
    """Whether results are written to a folder, which may not exist yet."""
    return "{" not in output and (output.endswith(("/", "\\")) or Path(output).is_dir())


def output_paths(meshes: list[Path], output: str, kind: str, ending: str) -> list[Path]:
    """Return the output file of each mesh.

    Parameters
    ----------
    meshes : list of Path
        Input files.
    output : str
        A file (for one mesh), a folder, or a template such as "out/{name}_{kind}.csv".
    kind : str
        Goes in place of ``{kind}``.
    ending : str
        Of the files in a folder, with its dot.

    Raises
    ------
    InputError
        If two results would go to one file, or one over a mesh.
    """
    literal = output.replace("{", "{{").replace("}", "}}")
    if "{" in output:
        template = output
    elif _is_folder(output):
        template = f"{Path(literal).as_posix()}/{{name}}{ending}"
    elif len(meshes) == 1:
        template = literal
    else:
        raise InputError(
            f"{len(meshes)} meshes cannot all go to {output}; name a folder (with a slash at its"
            ' end) or a template such as "{name}_{kind}.npz".'
        )
    try:
        paths = [Path(template.format(name=mesh_name(mesh), kind=kind)) for mesh in meshes]
    except (KeyError, IndexError, ValueError, AttributeError) as fault:
        raise InputError(
            f"The template {output} is not one; it may hold {{name}} and {{kind}}."
        ) from fault
    taken: dict[Path, Path] = {mesh.resolve(): mesh for mesh in meshes}
    for mesh, path in zip(meshes, paths, strict=True):
        other = taken.get(path.resolve())
        if other is not None:
            raise InputError(
                f"{path}, the result of {mesh}, would go over that of {other} or over"
                " the mesh itself; choose another name."
            )
        taken[path.resolve()] = mesh
    return paths


def _check_pieces(options: Namespace) -> None:
    """Raise for options that cannot be combined with pieces."""
    wrong = {
        "--tail": options.tail is not None,
        "--count auto": options.target is None,
        "--component-column": options.component_column,
        f"--kind {options.kind}": not EXPORTS[options.kind].counted,
    }
    for name, given in wrong.items():
        if given:
            raise InputError(f"{name} is of the whole mesh; leave it out, or --pieces.")


def _write_in_pieces(
    raw: Mesh, path: Path, family: Family, options: Namespace
) -> tuple[dict[str, Any], str]:
    mesh = prepared(raw, options)
    with progress_bar(mesh) as bar, until_interrupted() as cancel:
        report = write_in_pieces(
            mesh,
            path,
            family,
            options.pieces,
            options.target,
            chosen_operator(options),
            repairs=options.repair,
            file_mesh=raw if options.whole_mesh else None,
            drop_first=options.drop_first,
            n_jobs=options.jobs,
            progress=bar,
            cancel=cancel,
        )
    return report, f"{path}: {described_seams(report)}"


def _write_whole(
    raw: Mesh, path: Path, family: Family, options: Namespace
) -> tuple[dict[str, Any], str]:
    """Compute one kind of features, or the eigenpairs, and write them."""
    began = time.perf_counter()
    whole, kind = options.whole_mesh, family.export
    mesh, remarks = _with_chosen_maps(prepared(raw, options), family, options)
    family = family.at_vertices(mesh.vertex_of)
    family.check_mesh(mesh)
    pairs, target, about_target = _solved_target(mesh, family, options)
    seconds = time.perf_counter() - began
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(path),
        "kind": kind,
        "n_vertices": mesh.n_file_vertices if whole else mesh.n_vertices,
        "remarks": remarks + about_target,
    }
    if pairs is not None:
        report |= {
            **pairs_report(pairs, mesh),
            "complete": pairs.complete,
            "worst_residual": float(pairs.residuals.max(initial=0.0)),
            "orthonormality": float(pairs.orthonormality),
            "seconds_eigenpairs": round(seconds, 3),
        }
    proof = report.get("proof", "")
    made = export_options(
        kind, chosen_operator(options), target, proof, options.repair, whole_mesh=whole
    )
    if family.makes_features():
        found = _computed_features(mesh, family, pairs, target, options, report)
        values = None if pairs is None else pairs.eigenvalues
        found = found.on_file(mesh) if whole else found
        write_features(path, found, raw if whole else mesh, eigenvalues=values, meta=made)
    else:
        assert pairs is not None
        pairs = pairs.on_file(mesh) if whole else pairs
        write_eigenpairs(path, pairs, raw if whole else mesh, made)
    report["seconds"] = round(time.perf_counter() - began, 3)
    if pairs is None:
        return report, f"{path}: {counted(report['n_features'], 'column')}"
    return report, f"{path}: {proof} · {reach(report, mesh)}"


def _with_chosen_maps(mesh: Mesh, family: Family, options: Namespace) -> tuple[Mesh, list[str]]:
    """Return the mesh with the maps that become columns, and remarks on those left out."""
    remarks: list[str] = []
    if (options.map or options.maps) and not family.makes_features():
        raise InputError(f"--map and --maps are columns of features; {family.export} have none.")
    if mesh.maps and not options.maps:
        names = ", ".join(each.name for each in mesh.maps)
        if family.makes_features():
            remarks.append(f"left out: {names}; --maps adds them as columns.")
        for each in mesh.maps:
            mesh = mesh.without_map(each.name)
    return with_maps(mesh, options.map), remarks


def _solved_target(
    mesh: Mesh, family: Family, options: Namespace
) -> tuple[Decomposition | None, Target, list[str]]:
    """Return the eigenpairs that a family needs, the target they were solved for, and remarks."""
    n, target = mesh.n_vertices - len(mesh.unreferenced), options.target
    shortest = getattr(family, "t_min", None) if target is None else None
    if shortest is None:
        pairs = solved(mesh, options, target) if family.of_pairs else None
        wanted = target.n_components
        if pairs is None or wanted is None or wanted <= n:
            return pairs, target, []
        remark = (
            f"{wanted:,} eigenpairs were asked for; the mesh has {n:,}, and all of them are used."
        )
        return pairs, target, [remark]
    target, edge = sufficient_target(shortest, mesh.area, n), median_edge_length(mesh)
    limit = mesh_limit(shortest, mesh.area, n, mesh.unit, edge)
    try:
        pairs = solved(mesh, options, target) if family.of_pairs else None
    except InputError as fault:
        raise InputError(f"{fault} {limit}") from fault
    too_short = wavelength(required_eigenvalue(shortest)) < 2.0 * edge
    return pairs, target, [limit] if too_short else []


def _computed_features(
    mesh: Mesh,
    family: Family,
    pairs: Decomposition | None,
    target: Target,
    options: Namespace,
    report: dict[str, Any],
) -> Features:
    """Return the features of a family with the maps of the mesh, and complete the report."""
    bound, remarks = target.max_eigenvalue, report["remarks"]
    found = family.compute_features(
        pairs,
        mesh,
        mesh.area,
        bound,
        drop_first=options.drop_first,
        tail=options.tail,
        known_to=bound if pairs is not None and pairs.complete else None,
    )
    if pairs is not None and not (pairs.eigenvalues > 0.0).any():
        remarks.append(
            f"all {pairs.n_components} eigenvalues are zero, one for each connected component,"
            " so the features are the same all over a component: go further up the spectrum"
            " (a larger --count or --max-eigenvalue, a shorter --wavelength)."
        )
    missing = found.truncation
    report["truncation"] = None if missing is None else missing.as_dict()
    if found.missing:
        remarks.append(f"{found.missing}{more_pairs(getattr(family, 't_min', None))}.")
    remarks += found.remarks(mesh)
    found = found.with_maps(mesh)
    if options.component_column:
        found = found.with_components(mesh)
    report["n_features"] = len(found.columns)
    return found


def more_pairs(t_min: float | None = None) -> str:
    """Return the remedy for a truncated column."""
    if t_min is not None:
        return ": --count auto takes as many as it needs"
    return ": take more of them (--count, --max-eigenvalue, --wavelength)"


# compare --------------------------------------------------------------------------------------


def compare(options: Namespace) -> int:
    """Compare two meshes, and write the match of each vertex of the first on the second."""
    if options.output is not None:
        check_output(options.output, "features")
    began, target = time.perf_counter(), options.target
    family = EXPORTS[options.kind].exported(options.n_components)
    read_as = [read(path, options) for path in options.mesh]
    meshes = [prepared(mesh, options) for mesh in read_as]
    first = solved(meshes[0], options, target)
    # as far up the spectrum of the second, where it has one that far
    top = matched_top(first, meshes[1].area)
    second = solved(meshes[1], options, Target("max_eigenvalue", top) if top > 0.0 else target)
    for mesh, pairs in zip(meshes, (first, second), strict=True):
        check_comparable(mesh.name, mesh.n_vertices, pairs.eigenvalues)
    bank, vertices = family.bank(unit_area_spectrum(first)), corresponding_vertices(*meshes)
    found = compare_shapes(first, second, bank, vertices=vertices)
    report: dict[str, Any] = {
        "meshes": [mesh.name for mesh in meshes],
        "kind": family.export,
        "n_eigenpairs": [first.n_components, second.n_components],
        "compared": len(found.spectra[0]),
        "complete": first.complete and second.complete,
        "spectral_distance": found.distance,
        "relative_distance": found.relative_distance,
        "same_vertices": found.given,
        "mutual_share": found.mutual_share,
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
        "remarks": comparison_remarks(*meshes),
        "output": None if options.output is None else str(options.output),
    }
    if options.output is not None:
        proof = f"{first.proof(meshes[0].unit)}; {second.proof(meshes[1].unit)}"
        whole, operator = options.whole_mesh, chosen_operator(options)
        made = export_options("match", operator, target, proof, options.repair, whole_mesh=whole)
        made["matched_in"] = family.export
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
    distance = f"{report['spectral_distance']:.4g}"
    share = f"{100 * report['relative_distance']:.2g} % of the spectrum"
    vertices = "by index: the faces are the same"
    if not report["same_vertices"]:
        mutual = f"{100 * report['mutual_share']:.1f} %"
        vertices = f"matched in {report['kind']}, {mutual} of {first} mutually"
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


def _write_rebuilt(mesh: Mesh, options: Namespace) -> tuple[dict[str, Any], str]:
    """Of the report, ``rms_distance`` is the root mean square distance of a point of the surface
    from where it was, ``largest_distance`` that of the farthest vertex, in ``unit``.
    """
    began, path = time.perf_counter(), options.output
    pairs = solved(mesh, options, options.target)
    if not pairs.eigenvalues[-1] > 0.0:
        raise InputError(
            f"{mesh.name}: all {counted(pairs.n_components, 'eigenpair')} are constants of its"
            f" {counted(mesh.n_components, 'component')}, from which each would be a point: take"
            " more pairs (--count, --max-eigenvalue, --wavelength), or --largest-component."
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
    operator, proof = chosen_operator(options), report["proof"]
    made = export_options("reconstruction", operator, options.target, proof, options.repair)
    made["rms_distance"] = typical
    write_mesh(path, replace(mesh, vertices=vertices), provenance(mesh, made))
    report["seconds"] = round(time.perf_counter() - began, 3)
    return report, (
        f"{path}: rebuilt from {counted(pairs.n_components, 'eigenpair')}; vertices are"
        f" {format_quantity(typical, mesh.unit)} from where they were (root mean square),"
        f" {format_quantity(most, mesh.unit)} at most"
    )

"""What the command line does, apart from speaking: one function a command.

Each takes a mesh and plain options and returns a result or writes a file, so it works from a
script as well.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import Target, Translation, required_eigenvalue, wavelength

if TYPE_CHECKING:
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.model.field import Field
    from meshmash_viewer.progress import CancelCallback, ProgressCallback
    from meshmash_viewer.spectral.eigensolver import Decomposition

__all__ = [
    "Solver",
    "describe",
    "is_folder",
    "output_paths",
    "with_maps",
    "write_kind",
    "write_render",
]


@dataclass
class Solver:
    """How eigenpairs are to be had.

    Parameters
    ----------
    target : Target
        How many.
    operator : OperatorOptions
        Of which Laplacian.
    use_cache : bool
        Whether to look into the user's store of eigenpairs and add to it.
    n_jobs : int, optional
        Processes; None for as many as cores and memory allow.
    progress : callable, optional
        As for `meshmash_viewer.spectral.eigensolver.solve`.
    interruptible : callable
        Makes the context in which the eigenpairs are computed; it gives the solver's `cancel`.

    Attributes
    ----------
    remark : str
        A sentence for the user about the store, or empty.
    """

    target: Target
    operator: OperatorOptions
    use_cache: bool = True
    n_jobs: int | None = None
    progress: ProgressCallback | None = None
    interruptible: Callable[[], AbstractContextManager[CancelCallback | None]] = nullcontext
    remark: str = ""

    def __call__(self, mesh: Mesh) -> Decomposition:
        """Eigenpairs of a mesh, from the store or computed."""
        from meshmash_viewer.io.spectrum import obtain_eigenpairs
        from meshmash_viewer.model.decomposition import free_memory, refuse_what_cannot_fit

        free = free_memory()
        with self.interruptible() as cancel:
            found = obtain_eigenpairs(
                mesh,
                self.operator,
                self.target,
                use_cache=self.use_cache,
                progress=self.progress,
                cancel=cancel,
                check=lambda n, nnz, k: refuse_what_cannot_fit(n, nnz, k, free, mesh.n_components),
                n_jobs=self.n_jobs,
            )
        self.remark = found.remark
        return found.decomposition


def describe(mesh: Mesh, target: Target) -> dict[str, Any]:
    """Health, size and the length of spectrum that a request comes to.

    Returns
    -------
    dict
        JSON-able. Lengths are in ``unit``, eigenvalues in its inverse square; the entries of
        ``weyl`` are estimates by Weyl's law, except those that its ``exact`` names: what was asked
        for, and what the store of eigenpairs knows of the default Laplacian.
    """
    from meshmash_viewer.health import median_edge_length, mesh_health
    from meshmash_viewer.io.spectrum import find_eigenpairs

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
    reach = {
        "n_eigenpairs": translation.count(target),
        "max_eigenvalue": translation.eigenvalue(target),
        "wavelength": translation.wavelength(target),
    }
    return {
        "name": mesh.name,
        "unit": mesh.unit,
        "voxel": mesh.voxel,
        "hash": mesh.content_hash,
        **asdict(health),
        "bounds": [low.tolist(), high.tolist()],
        "median_edge": median_edge_length(mesh),
        "weyl": {
            "target": target.kind,
            **{name: _finite(value) for name, (value, _) in reach.items()},
            "exact": [name for name, (_, exact) in reach.items() if exact],
        },
    }


def _finite(value: float) -> float | None:
    """A number as JSON has it: the wavelength of a constant is none."""
    return value if math.isfinite(value) else None


def is_folder(output: str) -> bool:
    """Whether results go into a folder, which may still have to be made."""
    return "{" not in output and (output.endswith(("/", "\\")) or Path(output).is_dir())


def output_paths(meshes: list[Path], output: str, kind: str, ending: str) -> list[Path]:
    """Where the result of each mesh goes.

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
    from meshmash_viewer.io.read import mesh_name

    if "{" in output:
        template = output
    elif is_folder(output):
        template = (
            f"{Path(output).as_posix().replace('{', '{{').replace('}', '}}')}/{{name}}{ending}"
        )
    elif len(meshes) == 1:
        template = output.replace("{", "{{").replace("}", "}}")
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


def write_kind(
    mesh: Mesh,
    path: Path,
    family: Family,
    solver: Solver,
    *,
    drop_first: bool = False,
    tail: Literal["weyl"] | None = None,
    automatic: bool = False,
    component_column: bool = False,
    maps: Sequence[Path] = (),
    own_maps: bool = False,
    repairs: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Compute one kind of features, or the eigenpairs, and write them.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        Its ending says the format.
    family : Family
        One of `meshmash_viewer.fields.EXPORTS`, with its parameters.
    solver : Solver
    drop_first : bool
        Whether to leave out the first pair.
    tail : {None, "weyl"}
        See `meshmash_viewer.features.sums.compute_features`.
    automatic : bool
        Whether to take as many pairs as the family's shortest time needs, in place of the solver's
        target.
    component_column : bool
        Whether to add the connected component of each vertex as a column.
    maps : sequence of Path
        Files with values per vertex to add as columns.
    own_maps : bool
        Whether to add those that came with the mesh.
    repairs : tuple of str
        What has been done to the mesh, for the file to say.

    Returns
    -------
    dict
        JSON-able report.
    """
    from meshmash_viewer.features.truncation import mesh_limit, sufficient_target
    from meshmash_viewer.health import median_edge_length
    from meshmash_viewer.io.provenance import export_options
    from meshmash_viewer.io.write import write_eigenpairs, write_features

    kind, t_min = family.export, getattr(family, "t_min", None)
    began = time.perf_counter()
    n = mesh.n_vertices - len(mesh.unreferenced)
    remarks: list[str] = []
    if (maps or own_maps) and not family.makes_features():
        raise InputError(f"--map and --maps are columns of features; {kind} have none.")
    if mesh.maps and not own_maps:
        names = ", ".join(each.name for each in mesh.maps)
        if family.makes_features():
            remarks.append(f"left out: {names}; --maps adds them as columns.")
        for each in mesh.maps:
            mesh = mesh.without_map(each.name)
    mesh = with_maps(mesh, maps)
    family.check_mesh(mesh)
    features: Features | None = None
    if automatic:
        assert t_min is not None
        solver.target = sufficient_target(t_min, mesh.area, n)
    pairs: Decomposition | None = None
    try:
        pairs = solver(mesh) if family.of_pairs else None
    except InputError as fault:
        if not automatic or t_min is None:
            raise
        reach = mesh_limit(t_min, mesh.area, n, mesh.unit, median_edge_length(mesh))
        raise InputError(f"{fault} {reach}") from fault
    solved = time.perf_counter()
    bound = solver.target.max_eigenvalue
    if family.makes_features():
        features = family.compute_features(
            pairs,
            mesh,
            mesh.area,
            bound,
            drop_first=drop_first,
            tail=tail,
            known_to=bound if pairs is not None and pairs.complete else None,
        )

    proof = "" if pairs is None else pairs.proof(mesh.unit)
    options = export_options(kind, solver.operator, solver.target, proof, repairs)
    report: dict[str, Any] = {
        "mesh": mesh.name,
        "output": str(path),
        "kind": kind,
        "n_vertices": mesh.n_vertices,
        "remarks": remarks,
    }
    if pairs is not None:
        largest = float(pairs.eigenvalues[-1])
        report |= {
            "n_eigenpairs": pairs.n_components,
            "max_eigenvalue": largest,
            "wavelength": _finite(wavelength(largest)),
            "complete": pairs.complete,
            "worst_residual": float(pairs.residuals.max(initial=0.0)),
            "orthonormality": float(pairs.orthonormality),
            "proof": proof,
            "seconds_eigenpairs": round(solved - began, 3),
        }
    wanted = solver.target.n_components
    if automatic and t_min is not None:
        edge = median_edge_length(mesh)
        if wavelength(required_eigenvalue(t_min)) < 2.0 * edge:
            remarks.append(mesh_limit(t_min, mesh.area, n, mesh.unit, edge))
    elif pairs is not None and wanted is not None and wanted > n:
        remarks.append(
            f"{wanted:,} eigenpairs were asked for; the mesh has {n:,}, and all of them are used."
        )
    if features is None:
        assert pairs is not None
        write_eigenpairs(path, pairs, mesh, options)
    else:
        if pairs is not None and not (pairs.eigenvalues > 0.0).any():
            remarks.append(
                f"all {pairs.n_components} eigenvalues are zero, one for each connected component,"
                " so the features are the same all over a component: go further up the spectrum"
                " (a larger --count or --max-eigenvalue, a shorter --wavelength)."
            )
        missing = features.truncation
        report["truncation"] = None if missing is None else missing.as_dict()
        if features.missing:
            remarks.append(f"{features.missing}{_more_pairs(t_min)}.")
        remarks += features.remarks(mesh)
        features = features.with_maps(mesh)
        if component_column:
            features = features.with_components(mesh)
        report["n_features"] = len(features.columns)
        values = None if pairs is None else pairs.eigenvalues
        write_features(path, features, mesh, eigenvalues=values, meta=options)
    report["seconds"] = round(time.perf_counter() - began, 3)
    return report


def _more_pairs(t_min: float | None) -> str:
    """The way out of a truncated column."""
    if t_min is not None:
        return ": --count auto takes as many as it needs"
    return ": take more of them (--count, --max-eigenvalue, --wavelength)"


def with_maps(mesh: Mesh, paths: Sequence[Path]) -> Mesh:
    """A mesh with the maps in files, besides its own."""
    from meshmash_viewer.io.maps import read_maps

    for path in paths:
        mesh = mesh.with_maps(*read_maps(path, mesh))
    return mesh


def _shown_map(mesh: Mesh, paths: Sequence[Path], name: str) -> Field:
    """A map of a mesh or of files, as the window shows it."""
    from meshmash_viewer.fields.maps import CURVATURES, OwnMaps
    from meshmash_viewer.fields.spectrum import Spectrum
    from meshmash_viewer.model.field import FieldRequest, LiveFeatures, compute_field

    n_own = len(mesh.maps)
    mesh = with_maps(mesh, paths)
    if paths and not name:
        name = mesh.maps[n_own].name
    names = [*(each.name for each in mesh.maps), *CURVATURES]
    if name and name not in names:
        raise InputError(f"{mesh.name} has no map {name!r}; its maps are {', '.join(names)}.")
    bare = Spectrum.without_pairs(mesh)
    family = OwnMaps(chosen=name).resolved(bare, {})
    request = FieldRequest(bare, mesh.unit, family, mesh.area_sample())
    field = compute_field(request, LiveFeatures())
    assert field is not None, "without pairs a map is shown at once"
    return field


def write_render(
    mesh: Mesh,
    path: Path,
    field: str | None,
    solver: Solver,
    *,
    index: int | None = None,
    diffusion_time: float | None = None,
    n_components: int = 32,
    maps: Sequence[Path] = (),
    map_name: str = "",
    colormap: str | tuple[str, ...] | None = None,
    limits: tuple[float, float] | None = None,
    **picture: Any,
) -> dict[str, Any]:
    """Draw a field on a mesh, without a window.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        Ends in ".png".
    field : str, optional
        "hks", "eigenfunction", "band", "map" or "none"; None for a map if one is named, else HKS.
    solver : Solver
        Not asked for the bare mesh and for a map.
    index : int, optional
        Which eigenfunction or band; None takes the first that is not constant.
    diffusion_time : float, optional
        Of the heat kernel signature, in squared unit; None the middle of its range.
    n_components : int
        Number of bands that `index` counts in.
    maps : sequence of Path
        Files with more maps of the mesh.
    map_name : str
        One of the maps of the mesh, or a curvature; "" for the first, those of files before others.
    colormap, limits, **picture
        See `meshmash_viewer.app.view.picture.render_picture`; None takes what suits the field.

    Returns
    -------
    dict
        JSON-able report.
    """
    from meshmash_viewer.app.view.picture import render_picture
    from meshmash_viewer.features.filters import bspline_bank, heat_kernel_bank, hks_times
    from meshmash_viewer.features.sums import truncated_features
    from meshmash_viewer.model.limits import PercentileLimits
    from meshmash_viewer.units import format_quantity, power_unit

    if field is None:
        field = "map" if maps or map_name else "hks"
    elif (maps or map_name) and field != "map":
        raise InputError(f"--map and --map-name are of --field map, not of {field}.")
    report: dict[str, Any] = {"mesh": mesh.name, "output": str(path), "field": field}
    if limits is not None and not limits[0] < limits[1]:
        raise InputError(f"The limits {limits[0]:g} and {limits[1]:g} leave no range: swap them.")
    values, quantity, unit = None, "", ""
    if field == "map":
        shown = _shown_map(mesh, maps, map_name)
        values, quantity, unit = shown.values, f"{shown.title}: {shown.quantity}", shown.unit
        if shown.labels:
            colormap = tuple(label.color for label in shown.labels)
        colormap = colormap or ("RdBu_r" if shown.signed else "viridis")
        limits = shown.limits(None) if limits is None or shown.labels else limits
        report["map"] = shown.title
        report["limits"] = list(limits)
    elif field != "none":
        pairs = solver(mesh)
        report["proof"] = pairs.proof(mesh.unit)
        spectrum = pairs.eigenvalues
        report["max_eigenvalue"] = float(spectrum[-1])
        report["wavelength"] = _finite(wavelength(float(spectrum[-1])))
        if field == "eigenfunction":
            if index is None:
                zeros = int(np.count_nonzero(spectrum <= 1e-10 * spectrum[-1]))
                index = min(zeros, pairs.n_components - 1)
            if not 0 <= index < pairs.n_components:
                raise InputError(
                    f"There is no eigenfunction {index} among {pairs.n_components}; raise --count"
                    " or lower --index."
                )
            values, unit = pairs.rows[index], power_unit(mesh.unit, -1)
            quantity = (
                f"eigenfunction {index}, λ = {format_quantity(spectrum[index], mesh.unit, -2)}"
            )
        elif field == "hks":
            times = hks_times(spectrum, None, None, 3)
            moment = float(times[1]) if diffusion_time is None else diffusion_time
            bank = heat_kernel_bank([moment])
            quantity = f"HKS, t = {format_quantity(moment, mesh.unit, 2)}"
        else:
            index = 1 if index is None else index
            if not 0 <= index < n_components:
                raise InputError(f"There is no band {index} among {n_components}; lower --index.")
            bank = bspline_bank(0.0, float(spectrum[-1]), n_components)
            quantity = f"band {index} of {n_components}"
        if values is None:
            features = truncated_features(pairs, bank, unit=mesh.unit)
            values = features.values[:, index if field == "band" and index is not None else 0]
            unit = features.unit
            if features.truncation is not None and (said := features.truncation.sentence()):
                report["remarks"] = [f"{said}{_more_pairs(None)}."]
            colormap = colormap or "viridis"
            # A few tips of the surface would otherwise take the whole colour bar.
            limits = limits or PercentileLimits().limits(values, mesh.area_sample())
        report["limits"] = None if limits is None else list(limits)
    render_picture(
        mesh,
        values,
        path,
        colormap=colormap or "RdBu_r",
        limits=limits,
        title=mesh.name,
        quantity=quantity,
        unit=unit,
        **picture,
    )
    return report

"""Export of eigenpairs, and of features computed by the direct sum over the stored pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.sums import Features
from meshmash_viewer.fields.family import Family
from meshmash_viewer.health import listed_repairs
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh, mask_text
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.structures import unstated_structure
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import named_apart
from meshmash_viewer.work import Channel, JobResult


def write_results(
    path: Path,
    results: Features | Eigenpairs,
    mesh: Mesh,
    file_mesh: Mesh | None,
    pairs: Eigenpairs | None,
    meta: dict[str, Any],
) -> None:
    """Write features with the eigenvalues of their `pairs`, or write eigenpairs.

    With `file_mesh`, the mesh before its repairs, rows are its vertices; removed ones are NaN.
    """
    from meshmash_viewer.io.write import write_eigenpairs, write_features

    if file_mesh is not None:
        results = results.on_file(mesh)
    if isinstance(results, Features):
        known = pairs or Eigenpairs.without_pairs(mesh)
        write_features(
            path,
            results,
            file_mesh or mesh,
            eigenvalues=known.eigenvalues,
            mesh_errors=known.mesh_errors,
            meta=meta,
        )
    else:
        write_eigenpairs(path, results, file_mesh or mesh, meta)


def written(path: Path, description: str, remark: str, *, warns: bool) -> JobResult:
    """Return the result of a job that has written a file, with a remark without a full stop."""
    text = f"{description} written to {path}." + (f" {remark}." if remark else "")
    return JobResult(remark=text, warns=warns and bool(remark), path=path)


@dataclass(frozen=True, eq=False)
class Export:
    """Export of features, computed by the direct sum, or of eigenpairs; the work of a job."""

    mesh: Mesh
    #: Operator of the eigenpairs in the store.
    operator: OperatorOptions
    #: Path of the file, whose ending determines the format.
    path: Path
    #: Family to write, with resolved parameters; None to write only maps.
    family: Family | None
    #: Number of leading eigenpairs to use.
    n_pairs: int
    #: What was asked for when the pairs were computed, by default as many as are used.
    target: Target | None = None
    repairs: tuple[str, ...] = ()
    #: Whether the maps of the mesh are added as columns.
    maps: bool = False
    #: The mesh before its repairs, to write all its vertices as rows; removed ones are NaN.
    file_mesh: Mesh | None = None
    #: The part of the mesh that was decomposed, None for the whole; other vertices are NaN.
    part: Mesh | None = None

    def __call__(self, channel: Channel) -> JobResult:
        """Write the file.

        `InputError` is raised if the stored eigenpairs are missing or damaged, or the file cannot
        be written; `Cancelled` if the user cancelled.
        """
        pairs, proof, known_to = None, "", None
        solved = self.part or self.mesh
        if self.family is None:
            return self._write(maps_alone(self.mesh), None, "", "maps")
        if self.family.of_pairs:
            pairs = stored_pairs(solved, self.operator, self.target, self.n_pairs, channel)
            named = pairs.on_mask(self._mask)
            proof, known_to = named.proof(self.mesh.unit), pairs.known_to or None
        results: Features | Eigenpairs | None = pairs
        if self.family.makes_features():
            channel.report(Progress("features", message="Computing features"))
            results = self.family.compute_features(pairs, solved, known_to=known_to)
            if channel.cancelled():
                raise Cancelled
            if self.maps:
                results = results.with_maps(self.mesh)
        assert results is not None
        channel.report(Progress("writing", message=f"Writing {self.path.name}"))
        return self._write(results, pairs, proof, self.family.export)

    @property
    def _mask(self) -> str:
        """Description of the part that was decomposed; "" for the whole mesh."""
        return "" if self.part is None else mask_text(self.part)

    def _write(
        self, results: Features | Eigenpairs, pairs: Eigenpairs | None, proof: str, kind: str
    ) -> JobResult:
        from meshmash_viewer.io.provenance import export_options

        description, missing = counted(self.n_pairs, "eigenpair"), ""
        if isinstance(results, Features):
            columns, missing = counted(len(results.columns), "column"), results.missing
            label = "Maps" if self.family is None else self.family.label
            description = f"{label}, {columns},"
        target = self.target or Target("count", self.n_pairs)
        if pairs is not None and pairs.target is not None and pairs.target.kind == "count":
            target = pairs.target  # which may be fewer
        meta = export_options(
            kind,
            self.operator,
            target,
            proof,
            self.repairs,
            whole_mesh=self.file_mesh is not None,
            mask=self._mask,
        )
        file_mesh = self.file_mesh
        if file_mesh is not None:
            file_mesh = file_mesh.in_voxels(self.mesh.voxel, self.mesh.unit)
            count = counted(file_mesh.n_vertices, "vertex")
            description = f"{description.rstrip(',')} at all {count} of the mesh file,"
        write_results(self.path, results, self.mesh, file_mesh, pairs, meta)
        repairs = f"Repaired before: {listed_repairs(self.repairs)}" if self.repairs else ""
        structure = unstated_structure(self.path.name, self.mesh.structure)
        if structure:
            structure += ": name the file of the mesh lh.… or rh.…"
        remark = ". ".join(filter(None, (missing, repairs, structure)))
        return written(self.path, description, remark, warns=bool(missing))


def maps_alone(mesh: Mesh) -> Features:
    """Return the maps of a mesh as columns, without features."""
    return Features(np.empty((mesh.n_vertices, 0)), (), kind="maps").with_maps(mesh)


def stored_pairs(
    mesh: Mesh, operator: OperatorOptions, target: Target | None, count: int, channel: Channel
) -> Eigenpairs:
    """Return the leading `count` of the stored eigenpairs of a target, by default of this count.

    `InputError` is raised if they are missing or damaged.
    """
    from meshmash_viewer.io.spectrum import find_eigenpairs
    from meshmash_viewer.model.decomposition import SPARE

    channel.report(Progress("reading", message="Reading eigenpairs"))
    target, spare = target or Target("count", count), channel.folder / SPARE
    pairs, damage = find_eigenpairs(
        mesh, operator, target, spare, count=count, cancel=channel.cancelled
    )
    if pairs is not None and len(pairs) == count:
        return pairs
    what = "damaged on the disk" if damage else "no longer in the cache"
    raise InputError("no-eigenpairs", f"Eigenpairs of this mesh are {what}", "compute them again")


@dataclass(frozen=True, eq=False)
class PinExport:
    """Export of a table with features at each pin; the work of a job."""

    mesh: Mesh
    operator: OperatorOptions
    path: Path
    pins: tuple[Pin, ...]
    #: Families whose columns are written, with resolved parameters.
    families: tuple[Family, ...]
    n_pairs: int
    #: The part of the mesh that was decomposed; None for the whole.
    part: Mesh | None = None
    #: What was asked for when the pairs were computed, by default as many as are used.
    target: Target | None = None

    def __call__(self, channel: Channel) -> JobResult:
        """Write the file.

        `InputError` is raised if the stored eigenpairs are missing or damaged, a column cannot be
        computed, or the file cannot be written; `Cancelled` if the user cancelled.
        """
        from meshmash_viewer.io.pins import write_pins

        mesh, pairs, missing = self.mesh, None, []
        vertices = [pin.vertex for pin in self.pins]
        places = mesh.vertices[vertices]
        columns: dict[str, Sequence[object]] = {
            "index": [mesh.file_index(vertex) for vertex in vertices],
            **{axis: places[:, at].tolist() for at, axis in enumerate("xyz")},
            "unit": [mesh.unit] * len(vertices),
            "name": [pin.name for pin in self.pins],
            "color": [pin.color for pin in self.pins],
        }
        for each in named_apart(mesh.maps, tuple(columns)):
            columns[each.name] = each.values[vertices].tolist()
            if each.labels:
                names = [*(label.name for label in each.labels), ""]
                at = np.nan_to_num(each.shown[vertices], nan=-1.0).astype(int)
                columns[f"{each.name} name"] = [names[place] for place in at]
        if any(family.of_pairs for family in self.families):
            solved = self.part or mesh
            pairs = stored_pairs(solved, self.operator, self.target, self.n_pairs, channel)
        for family in self.families:
            channel.report(Progress("features", message=f"Computing {family.label}"))
            known_to = {} if pairs is None else {"known_to": pairs.known_to or None}
            features = family.compute_features(pairs, self.part or mesh, **known_to)
            columns |= zip(features.columns, features.values[vertices].T.tolist(), strict=True)
            missing += [features.missing] if features.missing else []
            if channel.cancelled():
                raise Cancelled
        channel.report(Progress("writing", message=f"Writing {self.path.name}"))
        write_pins(self.path, columns)
        description = f"{counted(len(vertices), 'pin')}, {counted(len(columns), 'column')},"
        return written(self.path, description, ". ".join(missing), warns=bool(missing))

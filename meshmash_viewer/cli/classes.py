"""The commands train and predict: classes of vertices from labels."""

from __future__ import annotations

import functools
import time
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.cli.arguments import chosen_operator, in_unit
from meshmash_viewer.cli.batch import (
    Report,
    for_each,
    pairs_report,
    prepared,
    print_report,
    read,
    solved,
    titled_rows,
    watched,
)
from meshmash_viewer.cli.outputs import map_outputs, output_remarks, write_maps
from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.features.regions import label_map
from meshmash_viewer.io.condensed import read_condensed_features
from meshmash_viewer.io.maps import read_labels
from meshmash_viewer.io.models import check_model_path, model_card, read_classes, write_classes
from meshmash_viewer.io.read import mesh_name
from meshmash_viewer.learn.classes import ClassModel, predict_classes, train_classes
from meshmash_viewer.learn.columns import ClassColumns
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.labels import label_sizes
from meshmash_viewer.spectral.cost import check_columns
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted, format_quantity, format_share
from meshmash_viewer.vertex_map import VertexMap


def train(options: Namespace) -> int:
    """Train a model from labelled meshes, and write it."""
    began = time.perf_counter()
    check_model_path(options.output)
    if len(options.labels) != len(options.mesh):
        what = f"There are {counted(len(options.mesh), 'mesh')} and {len(options.labels)} --labels"
        raise InputError("counts-differ", what, "give each mesh its own, in the same order")
    if options.mask and len(options.mesh) > 1:
        raise conflicting("--mask applies to a single mesh", "train on one mesh, or without a mask")
    meshes, labels, tables = [], [], []
    columns: ClassColumns | None = None
    for path, given in zip(options.mesh, options.labels, strict=True):
        mesh = read(path, options)
        own = in_unit(options, mesh.unit)
        mesh = prepared(mesh, options)
        found = read_labels(given, mesh)
        try:
            known = label_map(found)
        except InputError as fault:
            raise fault.of(given) from fault
        if columns is None:
            check_columns(mesh.n_vertices, own.n_components or 32)
            pairs = solved(mesh, own, own.target)
            columns = _columns(mesh, pairs, own)
        else:
            columns.check_unit(mesh)
            pairs = solved(mesh, own, Target("max_eigenvalue", columns.limit(mesh)))
        with watched(mesh) as callbacks:
            tables.append(columns.compute(mesh, pairs, **callbacks))
        meshes.append(mesh)
        labels.append(known)
    assert columns is not None
    smoothing = in_unit(options, columns.unit).smoothing
    with watched(meshes[0]) as callbacks:
        model = train_classes(
            meshes, labels, columns, options.classifier,
            smoothing=smoothing, features=tables, **callbacks,
        )  # fmt: skip
    about = {"repairs": list(options.repair), "mask": options.mask, "labels": options.labels}
    write_classes(options.output, replace(model, about=about))
    report = {
        **model_card(model),
        "output": str(options.output),
        "remarks": [model.unscored] if model.unscored else [],
        "seconds": round(time.perf_counter() - began, 3),
    }
    print_report(options, options.output, report, _described(model, options.output))
    return 0


def _columns(mesh: Mesh, pairs: Eigenpairs, options: Namespace) -> ClassColumns:
    return ClassColumns.chosen(
        mesh,
        pairs,
        options.t_min,
        options.t_max,
        kinds=tuple(dict.fromkeys(options.kind or ["hks"])),
        n_times=options.n_components or 32,
        drop_first=options.drop_first,
        operator=chosen_operator(options),
    )


def _described(model: ClassModel, path: Path) -> str:
    """Describe a model: classes, scores on data left out, and number of columns."""
    n_labelled = sum(each["n_labelled"] for each in model.meshes)
    title = (
        f"{path}: {counted(len(model.classes), 'class')} from"
        f" {counted(n_labelled, 'vertex')} with labels of {counted(len(model.meshes), 'mesh')}"
    )
    scores, rows = model.scores, []
    if scores is not None:
        said = f"{scores.weighted_f1:.3f}, by area, with whole {scores.left_out} left out"
        rows.append(("F1", said))
        for name, f1, areas in zip(model.names, scores.f1, scores.confusion, strict=True):
            size = format_quantity(float(areas.sum()), model.columns.unit, 2, 4)
            wrong = [
                f", {format_share(area / areas.sum())} taken for {other}"
                for other, area in zip(model.names, areas, strict=True)
                if other != name and area > 0.0
            ]
            rows.append((f"  {name}", f"{f1:.3f} of {size}{''.join(wrong)}"))
    rows.append(("columns", f"{len(model.columns.names)}"))
    return titled_rows(title, rows)


def predict(options: Namespace) -> int:
    """Predict classes of vertices by a model, and write classes and probabilities."""
    model = _read_once(options.model)
    operator = model.columns.operator
    options.no_robust, options.mollify_factor = not operator.robust, operator.mollify_factor
    with map_outputs(options, options.mesh, "classes") as outputs:
        return for_each(
            options,
            lambda mesh, at, own: _write_predicted(mesh, at, outputs[at], own),
            repaired=False,  # --whole-mesh needs the mesh before repairs
            outputs=outputs,
        )


def _domains(mesh: Mesh, given: Path, mesh_file: Path) -> IntArray:
    """Read the domain of each vertex from a file, or from the file of the mesh in a folder."""
    path = given / f"{mesh_name(mesh_file)}.npz" if given.is_dir() else given
    labels = VertexMap(str(path), read_condensed_features(path)[1])
    return mesh.with_only_maps(labels).maps[0].values.astype(np.int64)


def _read_once(path: Path) -> ClassModel:
    """Read a model, which may be large; keep it in a worker until the file changes."""
    return _model_of(path, path.absolute(), path.stat().st_mtime_ns if path.is_file() else 0)


@functools.lru_cache(maxsize=1)
def _model_of(path: Path, _place: Path, _modified: int) -> ClassModel:
    return read_classes(path)


def _write_predicted(raw: Mesh, at: int, path: Path, options: Namespace) -> Report:
    mesh, model = prepared(raw, options), _read_once(options.model)
    model.check_mesh(mesh)
    pairs = solved(mesh, options, Target("max_eigenvalue", model.columns.limit(mesh)))
    given = options.domains
    domains = None if given is None else _domains(mesh, Path(given), options.mesh[at])
    with watched(mesh) as callbacks:
        found = predict_classes(mesh, model, pairs=pairs, domains=domains, warn=False, **callbacks)
    about = {
        "kind": "classes",
        "model": str(options.model),
        "columns": model.columns.plain(),
        "repairs": list(options.repair),
        "mask": options.mask,
    }
    write_maps(path, found.maps, mesh, raw if options.whole_mesh else None, about)
    areas = label_sizes(mesh, found.labels).areas.tolist()
    uncertainty = np.nan_to_num(found.uncertainty.values)
    uncertain = float(np.average(uncertainty, weights=mesh.vertex_areas))
    report = {
        "mesh": mesh.name,
        "output": str(path),
        "unit": mesh.unit,
        **pairs_report(pairs, mesh),
        "areas": dict(zip(model.names, areas, strict=True)),
        "mean_uncertainty": uncertain,
        "remarks": [*found.remarks, *output_remarks(path, mesh)],
    }
    said = (f"{name} {format_share(area / mesh.area)}" for name, area in report["areas"].items())
    return report, f"{path}: {', '.join(said)}; mean uncertainty {uncertain:.2f}"

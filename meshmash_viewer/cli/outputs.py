"""Output files of commands: their paths, and maps in all formats."""

from __future__ import annotations

import contextlib
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import made_folder
from meshmash_viewer.io.read import mesh_name
from meshmash_viewer.io.write import check_output
from meshmash_viewer.io.write_labels import write_labels
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.export import maps_alone, write_results
from meshmash_viewer.structures import unstated_structure
from meshmash_viewer.vertex_map import VertexMap


def is_folder(output: str) -> bool:
    """Whether the output is a folder, which may not exist yet."""
    return "{" not in output and (output.endswith(("/", "\\")) or Path(output).is_dir())


def output_paths(meshes: list[Path], output: str, kind: str, ending: str) -> list[Path]:
    """Return the output file of each mesh.

    `output` is a file (for one mesh), a folder, whose files have the given ending, or a template
    such as "out/{name}_{kind}.csv". Meshes of the same name in different folders are distinguished
    by a folder: "sub-01_lh.white".

    `InputError` is raised if two results have the same file, or a result would replace a mesh.
    """
    literal = output.replace("{", "{{").replace("}", "}}")
    if "{" in output:
        template = output
    elif is_folder(output):
        template = f"{Path(literal).as_posix()}/{{name}}{ending}"
    elif len(meshes) == 1:
        template = literal
    else:
        wrong = f"{len(meshes)} meshes cannot all be written to {output}"
        remedy = 'give a folder (ending in a slash) or a template such as "{name}_{kind}.npz"'
        raise InputError("same-file", wrong, remedy)
    try:
        paths = [Path(template.format(name=name, kind=kind)) for name in _names(meshes)]
    except (KeyError, IndexError, ValueError, AttributeError) as fault:
        what = f"The template {output} is not valid"
        raise InputError("wrong-template", what, "it may contain {name} and {kind} only") from fault
    taken: dict[Path, Path] = {mesh.resolve(): mesh for mesh in meshes}
    for mesh, path in zip(meshes, paths, strict=True):
        other = taken.setdefault(path.resolve(), mesh)
        if other is not mesh or path.resolve() == mesh.resolve():
            raise InputError(
                "same-file",
                f"{path}, the result of {mesh}, would overwrite the result of {other} or the mesh"
                " itself",
                "choose another name",
            )
    return paths


def _names(meshes: list[Path]) -> list[str]:
    """Return the names of meshes; equal names are prefixed by the nearest folder that differs."""
    names = [mesh_name(mesh) for mesh in meshes]
    for name in {name for name in names if names.count(name) > 1}:
        alike = [at for at, each in enumerate(names) if each == name]
        for folders in zip(*(meshes[at].resolve().parents for at in alike), strict=False):
            if len({folder.name for folder in folders}) == len(alike):
                for at, folder in zip(alike, folders, strict=True):
                    names[at] = f"{folder.name}_{name}"
                break
    return names


def folder_of(output: str) -> contextlib.AbstractContextManager[Any]:
    """Return a context that creates the output folder, if the output is a folder."""
    return made_folder(Path(output)) if is_folder(output) else contextlib.nullcontext()


@contextlib.contextmanager
def map_outputs(options: Namespace, meshes: list[Path], kind: str) -> Iterator[list[Path]]:
    """Yield the files for the maps of each mesh, in a folder that is created if needed.

    `InputError` is raised as by `output_paths`, or if maps cannot be written to one of the files.
    """
    paths = output_paths(meshes, options.output, kind, f".{options.format}")
    with folder_of(options.output):
        for path in paths:
            check_output(path, "labels" if _of_labels(path) else "features")
        yield paths


def write_maps(
    path: Path, maps: Sequence[VertexMap], mesh: Mesh, file_mesh: Mesh | None, about: dict[str, Any]
) -> None:
    """Write maps as columns, or the first map with labels to a file of labels.

    If `file_mesh`, the mesh before repairs, is given, values are written at all its vertices.
    """
    if not _of_labels(path):
        write_results(
            path, maps_alone(replace(mesh, maps=tuple(maps))), mesh, file_mesh, None, about
        )
        return
    labels = next((each for each in maps if each.labels), None)
    if labels is None:
        fault = f"{path} is for labels, and no map has labels"
        raise InputError("no-labels", fault, "choose another format")
    write_labels(path, labels, mesh, about)


def output_remarks(path: Path, mesh: Mesh) -> list[str]:
    """Return a remark if other programs need a brain structure that is not stated."""
    structure = unstated_structure(path.name, mesh.structure)
    return [f"{structure}: give --structure."] if structure else []


def _of_labels(path: Path) -> bool:
    """Whether the format of a file is only for labels."""
    return path.name.lower().endswith((".label.gii", ".annot"))

"""Provenance of exported files: mesh, options and versions, as JSON and in comment lines."""

from __future__ import annotations

import datetime
import json
import platform
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from meshmash_viewer.errors import printable
from meshmash_viewer.units import LENGTH_UNITS, plain_text
from meshmash_viewer.vertex_map import Label

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.weyl import Target

_T = TypeVar("_T")

#: Packages that compute the exported numbers.
_PACKAGES = ("numpy", "scipy", "robust_laplacian")


def provenance(mesh: Mesh, options: dict[str, Any] | None = None) -> dict[str, Any]:
    """Describe a mesh, the options of a computation, versions and time, as a dictionary for JSON.

    Entries are ``program``, ``created`` (ISO 8601, UTC), ``mesh``, ``options`` and ``versions``.
    ``mesh`` has the name, the SHA-256 of the content, unit, voxel, the brain structure if known,
    the numbers of vertices and faces, and after repairs the number of vertices in the file.
    """
    versions = {package: metadata.version(package) for package in _PACKAGES}
    return {
        "program": f"meshmash-viewer {metadata.version('meshmash-viewer')}",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "mesh": {
            "name": mesh.name,
            "hash": mesh.content_hash,
            "unit": mesh.unit,
            "voxel": mesh.voxel,
            **({"structure": mesh.structure} if mesh.structure else {}),
            "n_vertices": mesh.n_vertices,
            "n_faces": mesh.n_faces,
            **({} if mesh.numbering is None else {"n_file_vertices": mesh.n_file_vertices}),
        },
        "options": dict(options or {}),
        "versions": {"python": platform.python_version(), **versions},
    }


def export_options(
    kind: str,
    operator: OperatorOptions,
    target: Target,
    proof: str,
    repairs: Sequence[str] = (),
    *,
    whole_mesh: bool = False,
    mask: str | None = None,
) -> dict[str, Any]:
    """Return the options of an exported result, for `provenance`.

    `kind` is the kind of the result, such as "hks". `proof` is a sentence on the verification of
    the eigenpairs, "" if none were used. `whole_mesh` is whether the result has a value at each
    vertex of the mesh before its repairs. `mask` names the part of the mesh on which eigenpairs
    were computed, see `read_mask`.
    """
    options: dict[str, Any] = {"kind": kind}
    if proof:
        options |= {
            "operator": asdict(operator),
            "target": asdict(target),
            "proof": plain_text(proof),
        }
    if repairs:
        options |= {"repairs": list(repairs), "whole_mesh": whole_mesh}
    if mask:
        options["mask"] = mask
    return options


def stated_mesh(meta: str) -> tuple[str | None, str]:
    """Return unit and brain structure in a JSON text of `provenance`; None and "" if unstated."""
    about = _stated(meta, "mesh", dict)
    unit, structure = about.get("unit"), about.get("structure")
    named = printable(structure, 60) if isinstance(structure, str) else ""
    return unit if isinstance(unit, str) and unit in LENGTH_UNITS else None, named


def _stated(meta: str, entry: str, kind: type[_T]) -> _T:
    """Return an entry of a JSON text of `provenance`; empty if it is missing or of another type."""
    try:
        found = json.loads(meta)[entry]
    except (ValueError, KeyError, TypeError):
        return kind()
    return found if isinstance(found, kind) else kind()


def stated_columns(meta: str) -> list[str]:
    """Return the columns of features in a JSON text of `provenance`; an empty list if unstated."""
    return list(map(str, _stated(meta, "columns", list)))


def stated_units(meta: str) -> dict[str, str]:
    """Return the unit of each column of features in a JSON text of `provenance`."""
    try:
        options = _stated(meta, "options", dict)
        unit, maps = str(options.get("values_unit", "")), options.get("maps", {})
        units = dict.fromkeys(stated_columns(meta), unit) | {"component": ""}
        units |= {name: str(about["unit"]) for name, about in maps.items()}
    except (KeyError, TypeError, AttributeError):
        return {}
    return {name: printable(each, 30) for name, each in units.items()}


def second_file(path: Path) -> str:
    """Return the text of the ``.json`` file next to a table, "" if there is no such file."""
    try:
        return path.with_name(path.name + ".json").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def stated_labels(meta: str) -> tuple[Label, ...]:
    """Return the labels in a JSON text of `provenance`; empty if unstated."""
    return _as_labels(_stated(meta, "labels", list))


def stated_map_labels(meta: str) -> dict[str, tuple[Label, ...]]:
    """Return the labels of each map among the columns in a JSON text of `provenance`."""
    try:
        maps = _stated(meta, "options", dict)["maps"]
        return {name: _as_labels(about["labels"]) for name, about in maps.items()}
    except (KeyError, TypeError, AttributeError):
        return {}


def _as_labels(stated: Any) -> tuple[Label, ...]:
    """Convert a list of (number, name, colour) to labels; empty if the list has another form.

    Former versions wrote names by number, without colours.
    """
    if not isinstance(stated, list):
        return ()
    try:
        return tuple(Label(int(key), str(name), str(color)) for key, name, color in stated)
    except (ValueError, TypeError):
        return ()


# -- in the headers of PLY and OBJ files, readable by other programs ---------------------------

#: Longest line in characters; MeshLab rejects lines over 512 with their line end.
_LONGEST_LINE = 500
#: Longest name of a property in characters, short enough for lists in other programs.
_LONGEST_NAME = 100
_SPACE = r"\u0020"
_FIRST, _NEXT = "meshmash-viewer ", "meshmash-viewer+ "


def comment_lines(meta: str, keyword: str) -> Iterator[str]:
    """Split a JSON text of `provenance` into comment lines of at most 500 characters.

    Lines begin with a keyword, "comment" in PLY and "#" in OBJ, and then ``meshmash-viewer``, in
    the second and later lines ``meshmash-viewer+``. Spaces at the start or end of a line's text,
    which other programs may drop, are escaped.
    """
    # all spaces of the JSON text are within strings, so that they can be escaped
    meta = meta.replace("  ", " " + _SPACE)
    length = _LONGEST_LINE - len(f"{keyword} {_NEXT}") - 2 * len(_SPACE)
    for start in range(0, max(len(meta), 1), length):
        line = re.sub("^ | $", lambda _: _SPACE, meta[start : start + length])
        yield f"{keyword} {_NEXT if start else _FIRST}{line}"


def stated_comment(lines: Iterable[str]) -> str:
    """Return the text of `provenance` in comment lines without keyword; "" if there is none.

    Older files have the text in one line.
    """
    text = ""
    for line in lines:
        if line.startswith(_FIRST) and not text:
            text = line.removeprefix(_FIRST)
        elif line.startswith(_NEXT) and text:
            text += line.removeprefix(_NEXT)
    return text


def property_names(columns: Sequence[str]) -> list[str]:
    """Convert column names to names of PLY properties: ASCII, no white space, unique, short."""
    names: list[str] = []
    for column in columns:
        name = re.sub(r"[^!-~]", "_", column.replace("λ", "lambda"))[:_LONGEST_NAME] or "feature"
        free, number = name, len(names)
        while free in names or free in ("x", "y", "z", "vertex"):
            free, number = f"{name}_{number}", number + 1
        names.append(free)
    return names


def names_of_properties(meta: str) -> dict[str, str]:
    """Return the column name of each PLY property, by a JSON text of `provenance`."""
    columns = stated_columns(meta)
    return dict(zip(property_names(columns), columns, strict=True))

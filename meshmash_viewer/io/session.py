"""Session files, JSON with the open meshes and their display, and files of maps next to them."""

from __future__ import annotations

import base64
import json
import os
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.parameter import (
    Choice,
    Flag,
    Kind,
    Listing,
    Number,
    Parameters,
    Record,
    Text,
    Whole,
    checked_entry,
    parameter,
)
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.links import is_link, link_file, parse_link, shown_path
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.weyl import TARGET_KINDS
from meshmash_viewer.vertex_map import COLOR, Label, VertexMap

SESSION_ENDING = ".meshmash.json"

_FORMAT = "meshmash-viewer session"
#: Version of the format. Since version 3, vertices are given by their index in the mesh file, which
#: differs from the index in the mesh only after repairs. Sessions without repairs are written as
#: version 2, which older programs can read.
_VERSION, _WITHOUT_REPAIRS = 3, 2
#: Largest size in bytes, a hundred times that of a session with thousands of pins.
_LARGEST = 16_000_000


def _check_color(text: str) -> None:
    if text and not COLOR.fullmatch(text):
        raise ValueError


def _check_mask(text: str) -> None:
    try:
        zlib.decompressobj().decompress(base64.b64decode(text, validate=True), 1)
    except zlib.error as fault:
        raise ValueError from fault


#: A unit of length with an optional factor, a colour "#RRGGBB", a text of `packed_mask`; all may
#: be "".
_UNIT = Text(100, parse_unit, 'a unit such as "nm" or "8 nm"')
_COLOR = Text(4096, _check_color, 'a colour such as "#E69F00"')
_MASK = Text(_LARGEST, _check_mask, "packed vertices, as the program writes them")


class _FileNames(Listing):
    """Names of files; older sessions have a single name, or "", in place of the list."""

    def __call__(self, value: object) -> Any:
        if isinstance(value, str):
            value = [value] if value else []
        return super().__call__(value)


class _Target(Kind):
    """A kind of target with its value."""

    def __call__(self, value: object) -> dict[str, Any]:
        kinds = Record({"kind": Choice(dict.fromkeys(TARGET_KINDS))})(value)
        size = Whole(1) if kinds.get("kind", "count") == "count" else Number(1e-150, 1e150)
        return {**kinds, **Record({"value": size})(value)}


_FILES = Listing(Text(), 1000, different=True)
_NAMES = Listing(Text(), 10_000)
_REPAIRS = Listing(Choice(REPAIRS), 100)
_AXIS = Listing(Number(-1.001, 1.001), 3, 3)
_CAMERA = Record(
    {
        "focus": Listing(Number(-1e30, 1e30), 3, 3),
        "axes": Listing(_AXIS, 3, 3),
        "half_size": Number(1e-30, 1e30),
        "fitted": Flag(),
    }
)
_MATCH = Record(
    {
        "feature": Text(100),
        "refined": Flag(),
        "carried": Flag(),
        "pinned": Listing(Listing(Whole(), 2, 2), 10_000),
    }
)

_POINTS = Record(
    {
        "path": Text(),
        "hash": Text(100),
        "unit": _UNIT,
        "position": Text(200),
        "column": Text(200),
        "size": Whole(1, 100),
        "max_distance": Number(0.0),
    }
)


@dataclass(frozen=True)
class Session(Parameters):
    """State of a window, as written to a session file."""

    #: File of the mesh. It is written as a relative path if it is below the folder of the session
    #: file, so that both can be moved together; a link file is written as its link.
    mesh_path: str = parameter("", Text())
    #: Files of added maps, in their order; written as relative paths like `mesh_path`.
    maps: list[str] = parameter(list, _FILES)
    #: Names of all maps of the mesh, in their order.
    map_names: list[str] = parameter(list, _NAMES)
    #: Name of the label set that is edited; "" for none.
    label_set: str = parameter("", Text())
    #: Unit given to `read_mesh`: "nm", "8 nm", "4 × 4 × 40 nm", "none", or "" for the unit that is
    #: stated by the format.
    unit: str = parameter("", _UNIT)
    #: Names of the repairs made after reading, oldest first.
    repairs: list[str] = parameter(list, _REPAIRS)
    #: Content hash of the mesh before its repairs; "" if unknown.
    source: str = parameter("", Text(200))
    #: Content hash of the repaired mesh, to detect changes of the file; "" if unknown.
    mesh_hash: str = parameter("", Text(200))
    #: Number of vertices that `pins` index; 0 if unknown.
    n_vertices: int = parameter(0, Whole())
    #: Fields of `OperatorOptions`.
    operator: dict[str, Any] = parameter(
        dict, Record({"robust": Flag(), "mollify_factor": Number(0.0)})
    )
    #: Fields of `Target`: ``kind`` and ``value``.
    target: dict[str, Any] = parameter(dict, _Target())
    #: The displayed field with its limits and colours, in the form written by the window's model.
    display: dict[str, Any] = parameter(dict, Record({}))
    #: Settings of the classes and the state of their prediction, in the form of the model.
    classes: dict[str, Any] = parameter(dict, Record({}))
    #: Pinned vertices, by their index in the mesh file, and the numbers of their pins.
    pins: list[int] = parameter(list, Listing(Whole(), 10_000, different=True))
    pin_numbers: list[int] = parameter(list, Listing(Whole(1), 10_000, different=True))
    #: Names and colours of the pins, "" for none.
    pin_names: list[str] = parameter(list, Listing(Text(200), 10_000))
    pin_colors: list[str] = parameter(list, Listing(_COLOR, 10_000))
    #: Selected vertices of the mesh file, as a text of `packed_mask`.
    selection: str = parameter("", _MASK)
    #: Hidden vertices of the mesh file, as a text of `packed_mask`.
    hidden: str = parameter("", _MASK)
    #: Vertices on which eigenpairs are computed, as a text of `packed_mask`; "" for all vertices.
    part: str = parameter("", _MASK)
    #: Result of `PointSet.plain`, with a path that is relative like `mesh_path`.
    points: dict[str, Any] = parameter(dict, _POINTS)
    #: Names of files in the folder of the session, with maps that are in no other file.
    kept_maps: list[str] = parameter(list, _FileNames(Text(200), 1000))
    #: False for older sessions, in which vertices are given by their index in the repaired mesh.
    file_indices: bool = True
    #: Focal point, axes and half size of the view in mesh coordinates; empty for the default view.
    camera: dict[str, Any] = parameter(dict, _CAMERA)
    #: Like `mesh_path` and `unit`, for the second mesh; "" without a second mesh.
    second_path: str = parameter("", Text())
    second_unit: str = parameter("", _UNIT)
    #: Like `maps`, `map_names`, `kept_maps` and `repairs`, for the second mesh.
    second_maps: list[str] = parameter(list, _FILES)
    second_map_names: list[str] = parameter(list, _NAMES)
    second_kept_maps: list[str] = parameter(list, Listing(Text(200), 1000))
    second_repairs: list[str] = parameter(list, _REPAIRS)
    #: Like `part`, for the second mesh.
    second_part: str = parameter("", _MASK)
    #: Names of the active links between the views of the two meshes.
    links: list[str] = parameter(list, Listing(Text(100), 100, different=True))
    #: Settings of the matching of vertices: the feature, whether the match is refined, whether
    #: colours are transferred, and pairs of a pin number and its vertex on the second mesh.
    match: dict[str, Any] = parameter(dict, _MATCH)


def write_session(path: str | Path, session: Session) -> None:
    """Write a session; an older file is replaced only after the new file is complete.

    `InputError` is raised if the file cannot be written.
    """
    path = Path(path)
    content = session.plain()
    folder = path.absolute().parent
    for name in ("mesh_path", "second_path"):
        if content[name]:
            shown = shown_path(Path(content[name]))
            content[name] = shown if is_link(shown) else _relative(shown, folder)
    for name in ("maps", "second_maps"):
        content[name] = [_relative(each, folder) for each in content[name]]
    if path_of_points := content["points"].get("path"):
        content["points"] = {**content["points"], "path": _relative(path_of_points, folder)}
    version = _VERSION if session.repairs else _WITHOUT_REPAIRS
    text = json.dumps({"format": _FORMAT, "version": version, **content}, indent=1)
    with writing_errors(path), written_whole(path) as part:
        part.write_text(text + "\n", encoding="utf-8")


def read_session(path: str | Path) -> Session:
    """Read a session, and make its paths absolute.

    `InputError` is raised if the file cannot be read, is not a session, was written by a newer
    program, or has an entry of the wrong type or out of bounds; `display` and `classes` are not
    checked here.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            text = file.read(_LARGEST + 1)
    except OSError as fault:
        raise InputError(
            f"{path} cannot be read ({fault.strerror}); check its name and permission."
        ) from fault
    if len(text) > _LARGEST:
        raise InputError(f"{path} is too large for a session; open another file.")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.pop("format", None) != _FORMAT:
        raise InputError(f"{path} is not a session of this program; open another file.")
    version = content.pop("version", None)
    if version not in (_VERSION, _WITHOUT_REPAIRS):
        raise InputError(
            f"{path} is a session of version {version}, and this program knows {_VERSION};"
            " open it with the program that wrote it."
        )
    session = {
        name: checked_entry(each.check, content[name], path, name)
        for name, each in Session.declared().items()
        if name in content
    }
    session |= {name: content.get(name, {}) for name in ("display", "classes")}
    session["file_indices"] = version == _VERSION or not session.get("repairs")
    beyond = [pin for pin in session.get("pins", []) if pin >= session.get("n_vertices", 0)]
    if session.get("n_vertices") and beyond:
        raise InputError(
            f"{path.name} has pins at vertex {beyond[0]}, and its mesh has "
            f"{session['n_vertices']} vertices: correct that entry, or open another file."
        )
    folder = path.absolute().parent
    for name in ("mesh_path", "second_path"):
        if is_link(session.get(name)):
            session[name] = str(link_file(parse_link(session[name])))
        elif session.get(name):
            session[name] = os.path.normpath(folder / session[name])
    for name in ("maps", "second_maps"):
        session[name] = [os.path.normpath(folder / each) for each in session.get(name, ())]
    if points := session.get("points"):
        points["path"] = os.path.normpath(folder / points["path"]) if points.get("path") else ""
    return Session(**session)


def packed_mask(mask: npt.NDArray[np.bool_] | None) -> str:
    """Convert a mask to text: its bits, compressed, in base64; "" for None."""
    if mask is None:
        return ""
    return base64.b64encode(zlib.compress(np.packbits(mask).tobytes(), 1)).decode()


def unpacked_mask(text: str, n: int) -> npt.NDArray[np.bool_] | None:
    """Convert a text of `packed_mask` to a mask of shape (n,); None for "".

    `InputError` is raised if the mask has another length.
    """
    if not text:
        return None
    size = -(-n // 8)
    try:
        bits = zlib.decompressobj().decompress(base64.b64decode(text), size + 1)
    except zlib.error:
        bits = b""
    if len(bits) != size:
        raise InputError(f"vertices of a mesh that does not have {n:,} vertices")
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=n).astype(np.bool_)


def _relative(name: str, folder: Path) -> str:
    """Return a path relative to a folder if the file is in the folder, else absolute."""
    file = Path(name).absolute()
    return file.relative_to(folder).as_posix() if file.is_relative_to(folder) else str(file)


# -- maps that are in no other file ----------------------------------------------------------------

#: Ending of files of maps.
KEPT_MAPS_ENDING = ".maps.npz"


@dataclass(frozen=True, eq=False)
class KeptMaps:
    """Maps of a mesh that are written next to the session."""

    maps: tuple[VertexMap, ...]
    #: Content hash of the mesh.
    mesh: str
    #: Names of the maps that replace maps read from files.
    edited: Sequence[str] = ()


def write_kept_maps(path: Path, kept: KeptMaps) -> None:
    """Write maps; if it fails, `OSError` is raised and an older file is unchanged."""
    named = [
        {"name": each.name, "unit": each.unit, "labels": [astuple(label) for label in each.labels]}
        for each in kept.maps
    ]
    about = json.dumps({"mesh": kept.mesh, "edited": list(kept.edited), "maps": named})
    values: dict[str, Any] = {f"values_{at}": each.values for at, each in enumerate(kept.maps)}
    with written_whole(path) as part, part.open("wb") as file:
        np.savez(file, about=np.array(about), **values)


def read_kept_maps(path: Path) -> KeptMaps:
    """Read maps; `InputError` is raised if the file is damaged or cannot be read."""
    try:
        with path.open("rb") as file, np.load(file) as stored:
            about = json.loads(str(stored["about"]))
            maps = tuple(
                VertexMap(
                    one["name"],
                    stored[f"values_{at}"],
                    tuple(Label(*each) for each in one.get("labels", ())),
                    one["unit"],
                )
                for at, one in enumerate(about["maps"])
            )
            return KeptMaps(maps, str(about["mesh"]), tuple(about.get("edited", ())))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as fault:
        raise InputError(f"{path.name} cannot be read: {fault}") from fault

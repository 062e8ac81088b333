"""Session files, JSON with the open meshes and their display, and files of maps next to them."""

from __future__ import annotations

import base64
import json
import os
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from msgspec import Meta

from meshmash_viewer.errors import InputError, not_readable
from meshmash_viewer.fields.parameter import (
    MOST_INDEX,
    CheckedText,
    Index,
    NotNegative,
    Parameters,
    Text,
    checked_entry,
    invalid_entry,
    parameter,
    record,
)
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.links import is_link, link_file, parse_link, shown_path
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import COLOR, Label, VertexMap

SESSION_ENDING = ".meshmash.json"

_FORMAT = "meshmash-viewer session"
#: Version of the format. Since version 4, it has a list of meshes, and the entries of the window.
#: Since version 3, vertices are given by their index in the mesh file, which differs from the index
#: in the mesh only after repairs.
_VERSION, _FLAT, _OLDEST = 4, 3, 2
#: Entries of pins next to their numbers.
_ABOUT_PINS = ("pin_names", "pin_colors")
#: Largest size in bytes, a hundred times that of a session with thousands of pins.
_LARGEST = 16_000_000


class _Unit(CheckedText):
    """Unit of length with an optional factor, or ""."""

    @staticmethod
    def check(text: str) -> object:
        return parse_unit(text)


class _Repair(CheckedText):
    """Name of a repair."""

    @staticmethod
    def check(text: str) -> object:
        if text not in REPAIRS:
            raise ValueError(f"no repair is called '{text}'")
        return text


_Color = Annotated[str, Meta(pattern=rf"^(|{COLOR.pattern})\Z")]
_Vector = Annotated[
    list[Annotated[float, Meta(ge=-1e30, le=1e30)]], Meta(min_length=3, max_length=3)
]
#: In sessions before version 4: a pin number and its vertex on the second mesh.
_Pair = Annotated[list[Index], Meta(min_length=2, max_length=2)]
_PINNED = {"pinned": list[_Pair], "pin_names": list[Text], "pin_colors": list[_Color]}
_PINS = Annotated[list[Index], Meta(max_length=10_000)]
_CAMERA = {
    "focus": _Vector, "axes": Annotated[list[_Vector], Meta(min_length=3, max_length=3)],
    "half_size": Annotated[float, Meta(ge=1e-30, le=1e30)], "fitted": bool,
}  # fmt: skip
_MATCH = {"feature": Text, "refined": bool, "carried": bool}
_Meshes = Annotated[list[dict[str, Any]], Meta(min_length=1, max_length=2)]
#: Entries of the window; the others belong to a mesh.
_WINDOW = {"camera", "links", "match"}
_POINTS = {
    "path": Text, "hash": Text, "unit": _Unit, "position": Text, "column": Text,
    "size": Annotated[int, Meta(ge=1, le=100)], "max_distance": NotNegative,
}  # fmt: skip


@dataclass(frozen=True)
class Session(Parameters):
    """State of a mesh and of the window, as written to a session file."""

    #: File of the mesh. It is written as a relative path if it is below the folder of the session
    #: file, so that both can be moved together; a link file is written as its link.
    mesh_path: str = parameter("", Text)
    #: Files of added maps, in their order; written as relative paths like `mesh_path`.
    maps: list[str] = parameter(list, list[Text])
    #: Names of all maps of the mesh, in their order.
    map_names: list[str] = parameter(list, list[Text])
    #: Name of the label set that is edited; "" for none.
    label_set: str = parameter("", Text)
    #: Unit given to `read_mesh`: "nm", "8 nm", "4 × 4 × 40 nm", "none", or "" for the unit that is
    #: stated by the format.
    unit: str = parameter("", _Unit)
    #: Names of the repairs made after reading, oldest first.
    repairs: list[str] = parameter(list, list[_Repair])
    #: Content hash of the mesh before its repairs; "" if unknown.
    source: str = parameter("", Text)
    #: Content hash of the repaired mesh, to detect changes of the file; "" if unknown.
    mesh_hash: str = parameter("", Text)
    #: Number of vertices that `pins` index; 0 if unknown.
    n_vertices: int = parameter(0, Index)
    #: Options of the Laplacian, and the target of the next solve; None for the default.
    operator: OperatorOptions = parameter(OperatorOptions, OperatorOptions)
    target: Target | None = parameter(None, Target)
    #: The displayed field with its limits and colours, in the form written by the window's model.
    display: dict[str, Any] = parameter(dict, dict[str, Any])
    #: Settings of the classes and the state of their prediction, in the form of the model.
    classes: dict[str, Any] = parameter(dict, dict[str, Any])
    #: Pinned vertices, by their index in the mesh file, and the numbers of their pins.
    pins: list[int] = parameter(list, _PINS)
    pin_numbers: list[int] = parameter(list, _PINS)
    #: Names and colours of the pins, "" for none.
    pin_names: list[str] = parameter(list, list[Text])
    pin_colors: list[str] = parameter(list, list[_Color])
    #: Selected vertices of the mesh file, as a text of `packed_mask`.
    selection: str = parameter("", str)
    #: Hidden vertices of the mesh file, as a text of `packed_mask`.
    hidden: str = parameter("", str)
    #: Vertices on which eigenpairs are computed, as a text of `packed_mask`; "" for all vertices.
    part: str = parameter("", str)
    #: Result of `PointSet.plain`, with a path that is relative like `mesh_path`.
    points: dict[str, Any] = parameter(dict, record(_POINTS))
    #: Names of files in the folder of the session, with maps that are in no other file.
    kept_maps: list[str] = parameter(list, list[Text])
    #: False for older sessions, in which vertices are given by their index in the repaired mesh.
    file_indices: bool = parameter(True, bool)
    #: Focal point, axes and half size of the view in mesh coordinates; empty for the default view.
    camera: dict[str, Any] = parameter(dict, record(_CAMERA))
    #: Names of the active links between the views of the two meshes.
    links: list[str] = parameter(list, list[Text])
    #: Settings of the matching of vertices: the feature, whether the match is refined, and whether
    #: colours are transferred.
    match: dict[str, Any] = parameter(dict, record(_MATCH))
    #: The second mesh, whose entries of the window are not used; None for one mesh.
    second: Session | None = None


def write_session(path: str | Path, session: Session) -> None:
    """Write a session; an older file is replaced only after the new file is complete.

    `InputError` is raised if the file cannot be written.
    """
    path = Path(path)
    both = [session] if session.second is None else [session, session.second]
    meshes = [_entries(each, path.absolute().parent) for each in both]
    window = {name: entry for name, entry in session.plain().items() if name in _WINDOW}
    content = {"format": _FORMAT, "version": _VERSION, "meshes": meshes, "window": window}
    with writing_errors(path), written_whole(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _entries(session: Session, folder: Path) -> dict[str, Any]:
    """Return the entries of a mesh, with paths relative to a folder."""
    content = {name: entry for name, entry in session.plain().items() if name not in _WINDOW}
    if session.mesh_path:
        shown = shown_path(Path(session.mesh_path))
        content["mesh_path"] = shown if is_link(shown) else _relative(shown, folder)
    content["maps"] = [_relative(each, folder) for each in session.maps]
    if path_of_points := session.points.get("path"):
        content["points"] = {**session.points, "path": _relative(path_of_points, folder)}
    return content


def _read_content(path: Path) -> tuple[dict[str, Any], int]:
    """Return the unchecked entries of a session file, and its version."""
    try:
        with path.open("rb") as file:
            text = file.read(_LARGEST + 1)
    except OSError as fault:
        raise not_readable(path, fault) from fault
    if len(text) > _LARGEST:
        raise InputError("too-large", f"{path} is too large for a session", "open another file")
    try:
        content = json.loads(text, parse_float=_number)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.pop("format", None) != _FORMAT:
        what = f"{path} is not a session of this program"
        raise InputError("wrong-format", what, "open another file")
    version = content.pop("version", None)
    if version not in (_VERSION, _FLAT, _OLDEST):
        what = f"{path} is a session of version {version}, and this program knows {_VERSION}"
        raise InputError("wrong-version", what, "open it with the program that wrote it")
    return content, version


def read_session(path: str | Path) -> Session:
    """Read a session, and make its paths absolute.

    `InputError` is raised if the file cannot be read, is not a session, was written by a newer
    program, or has an entry of the wrong type or out of bounds; `display` and `classes` are not
    checked here.
    """
    path = Path(path)
    content, version = _read_content(path)
    if version != _VERSION:
        content = _upgraded(content, path, version)
    kind = {"meshes": _Meshes, "window": dict[str, Any]}
    whole = checked_entry(record(kind), content, path)
    first, *others = whole.get("meshes", [{}])
    window = {name: each for name, each in whole.get("window", {}).items() if name in _WINDOW}
    second = _checked(others[0], path, "meshes[1]") if others else None
    return replace(_checked(first | window, path), second=second)


def _checked(content: dict[str, Any], path: Path, entry: str = "") -> Session:
    """Return the session of one mesh from its entries in a file; `entry` is their place."""
    session = checked_entry(record(Session.entries()), content, path, entry)
    beyond = [pin for pin in session.get("pins", []) if pin >= session.get("n_vertices", 0)]
    if session.get("n_vertices") and beyond:
        about = f"vertex {beyond[0]}, and its mesh has {session['n_vertices']} vertices"
        raise invalid_entry(path, f"{entry}.pins".lstrip("."), about)
    folder = path.absolute().parent
    if is_link(session.get("mesh_path")):
        session["mesh_path"] = str(link_file(parse_link(session["mesh_path"])))
    elif session.get("mesh_path"):
        session["mesh_path"] = os.path.normpath(folder / session["mesh_path"])
    session["maps"] = [os.path.normpath(folder / each) for each in session.get("maps", ())]
    if points := session.get("points"):
        points["path"] = os.path.normpath(folder / points["path"]) if points.get("path") else ""
    return Session(**session)


def _upgraded(content: dict[str, Any], path: Path, version: int) -> dict[str, Any]:
    """Convert the entries of a session before version 4, which are in no list."""
    if isinstance(kept := content.get("kept_maps"), str):  # in older sessions the one name, or ""
        content["kept_maps"] = [kept] if kept else []
    if content.get("target") == {}:
        del content["target"]
    checked_entry(record(Session.entries()), content, path)
    indices = version == _FLAT or not content.get("repairs")
    first = {name: each for name, each in content.items() if not name.startswith("second_")}
    meshes = [first | {"file_indices": indices}]
    match = content.get("match", {})
    pinned = checked_entry(record(_PINNED), match, path, "match")
    if content.get("second_path"):
        given = zip_longest(*(content.get(name, ()) for name in ("pin_numbers", *_ABOUT_PINS)))
        # where pins of the second mesh lack names and colours, those of equal number have them
        about = {number: dict(zip(_ABOUT_PINS, each, strict=True)) for number, *each in given}
        second = {
            name.removeprefix("second_"): each
            for name, each in content.items()
            if name.startswith("second_") and name != "second_path"
        }
        pairs = pinned.get("pinned", [])
        second |= {
            "mesh_path": content["second_path"],
            "pins": [at for _, at in pairs],
            "pin_numbers": [number for number, _ in pairs],
            "file_indices": indices,
        }
        for name in _ABOUT_PINS:
            known = [about.get(number, {}).get(name) or "" for number, _ in pairs]
            second[name] = pinned.get(name, known)
        if "operator" in content:
            second["operator"] = content["operator"]
        meshes.append(second)
    return {"meshes": meshes, "window": {name: content[name] for name in _WINDOW & content.keys()}}


def _number(text: str) -> float:
    """Convert a number of JSON; older sessions have counts such as 50.0."""
    value = float(text)
    return int(value) if value.is_integer() and abs(value) <= MOST_INDEX else value


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
        bits = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), size + 1)
    except (ValueError, zlib.error):
        bits = b""
    if len(bits) != size:
        raise InputError("other-mesh", f"vertices of a mesh that does not have {n:,} vertices")
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
        raise InputError("not-readable", f"{path.name} cannot be read ({fault})") from fault

"""A session on disk: what was open and how it was looked at, as versioned JSON."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole

__all__ = ["SESSION_ENDING", "Session", "read_session", "write_session"]

SESSION_ENDING = ".meshmash.json"

_FORMAT = "meshmash-viewer session"
_VERSION = 1


@dataclass(frozen=True)
class Session:
    """What it takes to come back to where one was.

    Parameters
    ----------
    mesh_path : str
        The mesh's file. In the session's file it is relative to it where both share a folder, so
        that the two can be moved together.
    unit : str
        What `read_mesh` was asked for: "nm", "8 nm", "4 × 4 × 40 nm", "none", or "" for what the
        format states.
    repairs : list of str
        Names of the repairs made after reading, oldest first.
    mesh_hash : str
        Content hash of the repaired mesh, to tell whether the file has changed since; "" if not
        known.
    operator : dict
        Fields of `OperatorOptions`.
    target : dict
        Fields of `Target`: ``kind`` and ``value``.
    display : dict
        The displayed field with its limits and colours, as the model writes it.
    pins : list of int
        Pinned vertices.
    camera : dict
        Position, focal point and so on in the mesh's coordinates; empty for the default view.
    """

    mesh_path: str = ""
    unit: str = ""
    repairs: list[str] = field(default_factory=list)
    mesh_hash: str = ""
    operator: dict[str, Any] = field(default_factory=dict)
    target: dict[str, Any] = field(default_factory=dict)
    display: dict[str, Any] = field(default_factory=dict)
    pins: list[int] = field(default_factory=list)
    camera: dict[str, Any] = field(default_factory=dict)


def write_session(path: str | Path, session: Session) -> None:
    """Write a session; an older file is replaced only when the new one is whole.

    Raises
    ------
    InputError
        If the system refuses.
    """
    path = Path(path)
    content = asdict(session)
    if session.mesh_path:
        mesh = Path(session.mesh_path).absolute()
        if mesh.is_relative_to(path.absolute().parent):
            content["mesh_path"] = mesh.relative_to(path.absolute().parent).as_posix()
        else:
            content["mesh_path"] = str(mesh)
    text = json.dumps({"format": _FORMAT, "version": _VERSION, **content}, indent=1)
    with writing_errors(path), written_whole(path) as part:
        part.write_text(text + "\n", encoding="utf-8")


def read_session(path: str | Path) -> Session:
    """Read a session, with its mesh's path made absolute.

    Raises
    ------
    InputError
        If there is no such file, it is no session, or a newer program wrote it.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as fault:
        raise InputError(
            f"{path} cannot be read ({fault.strerror}); check its name and permission."
        ) from fault
    except ValueError as fault:
        raise InputError(f"{path} is not a session of this program; open another file.") from fault
    if not isinstance(content, dict) or content.pop("format", None) != _FORMAT:
        raise InputError(f"{path} is not a session of this program; open another file.")
    version = content.pop("version", None)
    if version != _VERSION:
        raise InputError(
            f"{path} is a session of version {version}, and this program knows {_VERSION};"
            " open it with a newer program."
        )
    blank = Session()
    for known in fields(Session):
        default = getattr(blank, known.name)
        value = content.get(known.name, default)
        if not isinstance(value, type(default)):
            raise InputError(f"{path} has a damaged entry {known.name!r}; open another file.")
        content[known.name] = value
    if not all(isinstance(pin, int) and pin >= 0 for pin in content["pins"]):
        raise InputError(f"{path} has a damaged entry 'pins'; open another file.")
    session = {known.name: content[known.name] for known in fields(Session)}
    if session["mesh_path"]:
        session["mesh_path"] = os.path.normpath(path.absolute().parent / session["mesh_path"])
    return Session(**session)

"""Sessions of a window: what is on screen, to a file and back."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmash_viewer.errors import InputError
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.io.session import Session, read_session, write_session
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.model.display import FieldKind, SimilarityBasis
from meshmash_viewer.model.document import Document, Notice, Severity
from meshmash_viewer.model.jobs import ReadJob
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)
from meshmash_viewer.weyl import Target

if TYPE_CHECKING:
    from meshmash_viewer.app.main_window import MainWindow

__all__ = ["display_from_json", "display_to_json", "restore_session", "store_session"]

_POLICIES = {
    policy.__name__: policy
    for policy in (SymmetricLimits, MinMaxLimits, PercentileLimits, LockedLimits)
}
_ENUMS = {"kind": FieldKind, "similarity_basis": SimilarityBasis}
#: What a session does not keep: a window never opens playing.
_LEFT_OUT = {"playing"}


def store_session(window: MainWindow, path: Path) -> None:
    """Write what a window shows.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    document = window.document
    mesh = document.mesh
    session = Session(
        mesh_path=str(document.path or ""),
        unit=document.unit_text,
        repairs=list(document.repairs),
        mesh_hash=mesh.content_hash,
        operator=asdict(document.operator),
        target={"kind": document.target.kind, "value": document.target.value},
        display=display_to_json(document),
        pins=[pin.vertex for pin in document.pins],
        camera=(window.scene.camera() or {}) if window.loaded else {},
    )
    write_session(path, session)


def restore_session(window: MainWindow, path: Path) -> None:
    """Open the mesh of a session, and everything else as soon as it is there.

    Raises
    ------
    InputError
        If the file is no session, or its entries make no sense.
    """
    document = window.document
    session = read_session(path)
    fault = InputError(f"{path} has settings that this program does not know; open another file.")
    try:
        operator = OperatorOptions(**session.operator)
        target = Target(**session.target) if session.target else Target()
    except (TypeError, ValueError) as error:
        raise fault from error
    wanted = Path(session.mesh_path)

    repairs, started = list(session.repairs), False
    if not set(repairs) <= set(REPAIRS):
        raise fault

    def advance() -> None:
        """Repair what was repaired once the mesh has been read, then restore the rest."""
        nonlocal started
        state = document.job
        if state is not None:
            job = state.job
            started |= isinstance(job, ReadJob) and job.path.absolute() == wanted
        elif not started:
            pass  # what ran before has been stopped; the read comes next
        elif document.path is None or document.path.absolute() != wanted:
            document.job_changed.disconnect(advance)  # its own notice says why
        elif repairs:
            document.repair(repairs.pop(0))
        else:
            document.job_changed.disconnect(advance)
            _restore(window, session, path)

    document.operator = operator
    document.target = target
    document.job_changed.connect(advance)
    window.open_mesh(wanted, session.unit)


def _restore(window: MainWindow, session: Session, path: Path) -> None:
    document = window.document
    mesh = document.mesh
    if session.mesh_hash and mesh.content_hash != session.mesh_hash:
        text = (
            f"{document.path} has changed since {path.name} was saved: "
            "pins and field may not be where they were."
        )
        document.notify(Notice(text, Severity.WARNING))
    for vertex in session.pins:
        if vertex < mesh.n_vertices:
            document.toggle_pin(vertex)
    display_from_json(document, session.display)
    if session.camera and window.loaded:
        try:
            window.scene.set_camera(session.camera)
        except ValueError:
            document.notify(Notice("The session's camera is damaged: showing the whole mesh."))


def display_to_json(document: Document) -> dict[str, Any]:
    """The display as plain JSON."""
    display = document.display
    content: dict[str, Any] = {}
    for name in (each.name for each in fields(display)):
        value = getattr(display, name)
        if name in _LEFT_OUT:
            continue
        if name == "limits":
            value = None if value is None else _policy_to_json(value)
        elif isinstance(value, frozenset):
            value = sorted(value)
        content[name] = value
    return content


def display_from_json(document: Document, content: dict[str, Any]) -> None:
    """Set the display; entries that are unknown or of another type are left alone."""
    display = document.display
    known = {each.name for each in fields(display)}
    for name, value in content.items():
        if name not in known or name in _LEFT_OUT:
            continue
        try:
            if name in _ENUMS:
                value = _ENUMS[name](value)
            elif name == "flipped":
                value = frozenset(int(index) for index in value)
            elif name == "limits" and value is not None:
                value = _policy_from_json(value)
        except (KeyError, TypeError, ValueError):
            continue
        setattr(display, name, value)


def _policy_to_json(policy: LimitPolicy) -> dict[str, Any]:
    return {"policy": type(policy).__name__, **asdict(policy)}  # type: ignore[call-overload]


def _policy_from_json(content: dict[str, Any]) -> LimitPolicy:
    rest = {name: value for name, value in content.items() if name != "policy"}
    return _POLICIES[content["policy"]](**rest)

"""Conversion of the state of a window to a session, and restoration of a session."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from psygnal import Signal

from meshmash_viewer.app.view.camera import View
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.session import Session, packed_mask, read_session, unpacked_mask
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.classes import read_saved_classes
from meshmash_viewer.model.display import display_from_json, display_to_json, read_display
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.model.pins import Pin, free_number
from meshmash_viewer.model.selection import mask_in_file, mask_of_file
from meshmash_viewer.surface.masks import Mask


def session_of(document: Document, camera: dict[str, Any], pair: Pair | None = None) -> Session:
    """Return the session of a document, with the second mesh of `pair`, if any.

    `camera` is the result of `View.to_json`, or empty without a render.
    """
    mesh, ready, pins = document.mesh, document.ready, document.pins.placed
    assert mesh is not None and ready is not None  # noqa: PT018  both or neither
    part, labels = document.part_mesh, document.labels.current
    second = None if pair is None or pair.second.path is None else pair.second
    return Session(
        mesh_path=str(document.path or ""),
        maps=_map_files(document),
        map_names=document.maps.names,
        label_set="" if labels is None else labels.name,
        unit=document.unit_text,
        repairs=list(document.repairs),
        source=ready.source,
        mesh_hash=mesh.content_hash,
        n_vertices=mesh.n_file_vertices,
        operator=document.solve.operator,
        target=document.solve.target,
        display=display_to_json(document.display, mesh.file_index),
        classes=document.classes.plain(),
        pins=[mesh.file_index(pin.vertex) for pin in pins],
        pin_numbers=[pin.number for pin in pins],
        pin_names=[pin.name for pin in pins],
        pin_colors=[pin.own_color for pin in pins],
        selection=_packed(mesh, document.selection.mask),
        hidden=_packed(mesh, document.hiding.mask),
        part=_packed(mesh, None if part is None else part.referenced),
        points=document.points.plain(),
        camera=camera,
        links=sorted(pair.links) if pair is not None else [],
        match={} if pair is None else pair.match,
        second=None if second is None else session_of(second, {}),
    )


def _packed(mesh: Mesh, mask: Mask | None) -> str:
    return packed_mask(None if mask is None else mask_in_file(mesh, mask))


def _map_files(document: Document) -> list[str]:
    maps = () if document.mesh is None else document.mesh.maps
    read = (each.path for each in maps if each.path)
    return list(dict.fromkeys([*read, *map(str, document.maps.pending)]))


def _checked_parts(session: Session, path: Path) -> tuple[dict[str, Any], Any]:
    """Return the attributes of the display and the state of the classes in a session."""
    return read_display(session.display, path), read_saved_classes(session.classes, path)


class Restoration:
    """Restoration of a session: all entries are checked, then mesh and document are restored.

    Parameters
    ----------
    path : Path
        File of the session.
    session : Session, optional
        Content of the session file, if already read.
    saved_itself : bool
        Whether the session was saved automatically (`LastSession`), not by the user. It is then
        restored only if the content of the mesh file has not changed.
    maps : sequence of Path
        Files of additional maps.

    Raises
    ------
    InputError
        If the file is not a session, or an entry is invalid. The document is not changed then.
    """

    #: Everything except the camera and the second mesh has been restored.
    restored = Signal()

    def __init__(
        self,
        document: Document,
        path: Path,
        session: Session | None = None,
        *,
        saved_itself: bool = False,
        maps: Sequence[Path] = (),
    ) -> None:
        self._saved_itself, self._maps = saved_itself, tuple(maps)
        session = session or read_session(path)
        if not session.mesh_path:
            fault = f"{path.name} has no mesh_path"
            raise InputError("no-mesh", fault, "open the mesh itself instead")
        if session.second is not None:  # its entries are checked before anything is changed
            _checked_parts(session.second, path)
        self._display, self._classes = _checked_parts(session, path)
        #: The saved camera.
        self.camera: View | None = None
        #: Whether the camera showed the whole mesh, fitted to the size of the render.
        self.fitted = bool(session.camera.get("fitted"))
        if session.camera:
            try:
                self.camera = View.from_json(session.camera)
            except ValueError as fault:
                damage = f"{path.name} has a damaged camera ({fault})"
                raise InputError("invalid-entry", damage, "omit that entry") from fault
        self._document = document
        #: The session, and its file.
        self.session, self.path = session, path
        self._mesh_path = Path(session.mesh_path)
        self._stopped = False
        #: Whether `restored` has been emitted.
        self.done = False

    def begin(self) -> None:
        session = self.session
        source = session.source if self._saved_itself else ""
        self._document.open_mesh(
            self._mesh_path, session.unit, session.operator, repairs=session.repairs, source=source,
            maps=self._maps, target=session.target, then=self._advance,
        )  # fmt: skip

    def stop(self) -> None:
        """Restore nothing more."""
        self._stopped = True

    def _advance(self, job: Job) -> None:
        """Restore the state of the document once the mesh has been read and repaired."""
        document = self._document
        if job.succeeded and not self._stopped:
            with document.history.paused():
                document.solve.operator = self.session.operator
                if self.session.target is not None:
                    document.solve.target = self.session.target
                self._restore()

    def _restore(self) -> None:
        document, session = self._document, self.session
        mesh = document.mesh
        assert mesh is not None
        if session.mesh_hash and mesh.content_hash != session.mesh_hash:
            if self._saved_itself:
                self._warn(
                    f"{document.path} has changed since it was last open: the pins, maps and"
                    " settings of its last session are left out."
                )
                return
            self._warn(
                f"{document.path} has changed since {self.path.name} was saved: "
                "pins and field may not be where they were."
            )
        pins = self._pins()
        if missing := sum(self._place(index) is None for index in session.pins):
            self._warn(
                f"{self.path.name} has pins at vertices that {document.path} does not have: "
                f"{missing:,} of {len(session.pins):,} are left out."
            )
        document.pins.set("pins", pins)
        document.selection.put(self._mask(session.selection, "selection"))
        document.hiding.put(self._mask(session.hidden, "hidden"))
        for place, index in display_from_json(document.display, self._display, self._place):
            self._warn(
                f"{self.path.name} has display.{place} = {index}, which {document.path}"
                " does not have: it is left out."
            )
        part = self._mask(session.part, "part")
        if part is not None:
            document.take_part(part)
        document.classes.restore(self._classes)
        document.labels.choose(session.label_set, displayed=False)
        document.maps.open([Path(each) for each in session.maps], shown=False)
        document.maps.sort(session.map_names)
        document.points.restore(session.points)
        self.done = True
        self.restored.emit()

    def _pins(self) -> tuple[Pin, ...]:
        """Return the pins of the session at existing vertices, at most one pin per vertex."""
        session, pins = self.session, dict[int, Pin]()
        given = zip_longest(session.pin_numbers, session.pin_names, session.pin_colors)
        for index, about in zip_longest(session.pins, given):
            vertex = None if index is None else self._place(index)
            if vertex is not None and vertex not in pins:
                number, name, color = about or (0, "", "")
                number = free_number(tuple(pins.values()), number or 0)
                pins[vertex] = Pin(vertex, number, name or "", color or "")
        return tuple(pins.values())

    def _mask(self, text: str, entry: str) -> Mask | None:
        """Return the mask encoded by an entry of the session; None if empty or invalid."""
        mesh = self._document.mesh
        assert mesh is not None
        try:
            in_file = unpacked_mask(text, mesh.n_file_vertices)
        except InputError as fault:
            self._warn(f"{self.path.name} has as {entry} {fault}: it is left out.")
            return None
        return None if in_file is None else mask_of_file(mesh, in_file)

    def _place(self, index: int) -> int | None:
        """Return the vertex of the mesh for an index of the session; None if it does not exist."""
        mesh = self._document.mesh
        assert mesh is not None
        if not self.session.file_indices:
            return index if index < mesh.n_vertices else None
        with contextlib.suppress(InputError):
            return mesh.vertex_of(index)
        return None

    def _warn(self, text: str) -> None:
        self._document.notices.say(text, Severity.WARNING)

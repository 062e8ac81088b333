"""Sessions that save themselves: every mesh file opens again as it was left."""

from __future__ import annotations

import hashlib
import json
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QObject, Qt, QThreadPool, QTimer, Signal

from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import written_whole
from meshmash_viewer.io.session import SESSION_ENDING, Session, read_session, write_session
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.vertex_map import Label, VertexMap

#: Milliseconds from a change until it is written.
_DELAY = 700
#: Number of mesh files whose sessions are kept.
_KEPT = 200
_MAPS_ENDING = ".maps.npz"


class LastSession(QObject):
    """Writes the session of a document's mesh file after every change, and finds it again.

    Files are written in a thread, as flushing them to the disk takes up to a tenth of a second.

    `folder` holds them, one for each mesh file. `look` returns the camera (see `View.to_json`) and
    the pair with the second mesh, if there is one.
    """

    _failed = Signal(str)

    def __init__(
        self,
        document: Document,
        folder: Path,
        look: Callable[[], tuple[dict[str, Any], Pair | None]],
        parent: QObject,
    ) -> None:
        super().__init__(parent)
        self._document, self._folder, self._look = document, folder, look
        self._second: Document | None = None
        #: The maps that have been written.
        self._written: tuple[VertexMap, ...] = ()
        #: Name of the file in which they are; "" without any.
        self._maps_file = ""
        self._pool = QThreadPool(self, maxThreadCount=1)
        self._failed.connect(self._say_failed, Qt.ConnectionType.QueuedConnection)
        self._timer = QTimer(self, singleShot=True, interval=_DELAY)
        self._timer.timeout.connect(self.save)
        listen(document.mesh_changed, self.changed)
        changes = document.history.changed, document.display.events, document.solve.changed
        listen(changes, self.changed)
        self._rest = QTimer(self, singleShot=True, interval=_DELAY)
        self._rest.timeout.connect(self.save)

    def changed(self) -> None:
        """Write the session soon."""
        if self._document.path is not None and not self._timer.isActive():
            self._timer.start()

    def camera_moved(self) -> None:
        """Write the session when the camera has come to rest."""
        self._rest.start()

    def watch(self, document: Document | None) -> None:
        """Save unit and repairs of a second document, too, until it is closed (None)."""
        self._second = document
        if document is not None:
            listen(document.mesh_changed, self._keep_second)

    def stored(self, mesh_path: Path) -> Session | None:
        """Return the session of a mesh file; None if there is none that can be read."""
        self._pool.waitForDone()
        if not self.path(mesh_path).exists():
            return None
        try:
            return read_session(self.path(mesh_path))
        except InputError as fault:
            self.set_aside(mesh_path, str(fault))
            return None

    def set_aside(self, mesh_path: Path, fault: str) -> None:
        """Keep a session that cannot be used under another name, and say so."""
        file = self.path(mesh_path)
        kept = file.with_suffix(".unreadable")
        try:
            file.replace(kept)
        except OSError as error:
            fault += f" It cannot be renamed ({error.strerror})."
        text = f"{mesh_path.name} opens without what was made on it before. {fault}"
        text += f" That session is kept as {kept}."
        # past the opening, too
        self._document.notices.show(Notice(text, Severity.WARNING, holds=lambda: True))

    def path(self, mesh_path: Path) -> Path:
        """Return the file of the session of a mesh file."""
        key = hashlib.sha256(str(mesh_path.absolute()).encode()).hexdigest()[:20]
        return self._folder / f"{key}{SESSION_ENDING}"

    def save(self) -> None:
        """Write the session now; a failure is shown in the message bar."""
        self._timer.stop()
        self._rest.stop()
        document = self._document
        if document.path is None or document.mesh is None:
            return
        mesh, path = document.mesh, self.path(document.path)
        camera, pair = self._look()
        if not camera:  # the render is still being loaded, and what was saved not yet restored
            return
        maps = self._new_maps(mesh)
        session = replace(session_of(document, camera, pair), kept_maps=self._maps_file)
        about = {"mesh": mesh.content_hash, "edited": sorted(document.maps.edited)}
        self._pool.start(lambda: self._write(path, session, about, maps))

    def close(self) -> None:
        """Write the session, and wait for the thread."""
        self.save()
        self._pool.waitForDone()

    def forget(self, mesh_path: Path) -> None:
        """Delete the session of a mesh file."""
        self._timer.stop()
        self._rest.stop()
        self._pool.waitForDone()
        _delete(self.path(mesh_path))

    def restore_maps(self, name: str) -> int:
        """Add the kept maps in a file of this name to the mesh again, and return their number."""
        document = self._document
        mesh = document.mesh
        if mesh is None or document.path is None or not name:
            return 0
        self._pool.waitForDone()
        try:
            with (self._folder / Path(name).name).open("rb") as file, np.load(file) as stored:
                about = json.loads(str(stored["about"]))
                maps = [
                    VertexMap(
                        one["name"],
                        stored[f"values_{at}"],
                        tuple(Label(*each) for each in one.get("labels", ())),
                        one["unit"],
                    )
                    for at, one in enumerate(about["maps"])
                ]
            if about["mesh"] != mesh.content_hash:
                return 0
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as fault:
            text = f"The maps kept of {document.path.name} cannot be read: {fault}"
            document.notices.say(text, Severity.WARNING)
            return 0
        document.maps.restore(mesh, maps, about.get("edited", ()))
        self._written, self._maps_file = tuple(maps), name
        return len(maps)

    # -- details ------------------------------------------------------------------------------

    def _keep_second(self) -> None:
        document = self._second
        if document is not None and document.path is not None:
            now = session_of(document, {}, None)
            known = self.stored(document.path)
            if known is not None:
                now = replace(known, unit=now.unit, repairs=now.repairs, source=now.source)
            path = self.path(document.path)
            self._pool.start(lambda: self._write(path, now, {}, None))

    def _new_maps(self, mesh: Mesh) -> tuple[VertexMap, ...] | None:
        """Return the maps that are in no file; None if they have been written."""
        path = self._document.path
        assert path is not None  # without one nothing is saved
        key = _key(self.path(path))
        if not self._maps_file.startswith(key):  # of another file
            self._written, self._maps_file = (), ""
        maps = self._document.maps
        kept = tuple(
            each
            for each in mesh.maps
            if each.name in maps.edited or not (each.path or each.name in maps.in_file)
        )
        if len(kept) == len(self._written) and all(
            (one.values is other.values, one.labels) == (True, other.labels)
            for one, other in zip(kept, self._written, strict=True)
        ):
            return None
        self._written = kept
        self._maps_file = f"{key}.{time.time_ns():x}{_MAPS_ENDING}" if kept else ""
        return kept

    def _write(
        self,
        path: Path,
        session: Session,
        about: Mapping[str, Any],
        maps: tuple[VertexMap, ...] | None,
    ) -> None:
        """Write a session and new maps, in the thread."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if maps:
                named = [
                    {
                        "name": each.name,
                        "unit": each.unit,
                        "labels": [astuple(label) for label in each.labels],
                    }
                    for each in maps
                ]
                text = json.dumps({**about, "maps": named})
                values: dict[str, Any] = {
                    f"values_{at}": each.values for at, each in enumerate(maps)
                }
                # a new file, so that those of the session before stay until this one is written
                kept = self._folder / session.kept_maps
                with written_whole(kept) as part, part.open("wb") as file:
                    np.savez(file, about=np.array(text), **values)
            write_session(path, session)
            if maps is not None:
                _delete_maps(path, session.kept_maps)
            self._delete_oldest()
        except (InputError, OSError) as fault:
            self._failed.emit(str(fault))

    def _say_failed(self, fault: str) -> None:
        self._written, self._maps_file = (), ""  # to be tried again
        text = f"What you made could not be saved for the next time: {fault}"
        self._document.notices.say(text, Severity.WARNING)

    def _delete_oldest(self) -> None:
        sessions = sorted(
            self._folder.glob(f"*{SESSION_ENDING}"), key=lambda each: each.stat().st_mtime
        )
        for old in sessions[:-_KEPT]:
            _delete(old)


def _delete_maps(session: Path, but: str = "") -> None:
    """Delete the files of maps of a session, but for one."""
    for file in session.parent.glob(f"{_key(session)}.*{_MAPS_ENDING}"):
        if file.name != but:
            file.unlink(missing_ok=True)


def _key(session: Path) -> str:
    return session.name.removesuffix(SESSION_ENDING)


def _delete(session: Path) -> None:
    """Delete a session and its maps."""
    session.unlink(missing_ok=True)
    _delete_maps(session)

"""Sessions that save themselves: every mesh file opens again as it was left."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt, QThreadPool, QTimer, Signal

from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.kept_maps import KEPT_MAPS_ENDING, KeptMaps, read_kept_maps, write_kept_maps
from meshmash_viewer.io.session import SESSION_ENDING, Session, read_session, write_session
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.vertex_map import VertexMap

#: Milliseconds from a change until it is written.
_DELAY = 700
#: Number of mesh files whose sessions are kept.
_KEPT = 200


@dataclass(eq=False)
class _Kept:
    """The maps of a document that are in no other file, as they were written last."""

    maps: tuple[VertexMap, ...] = ()
    #: Name of the file in which they are; "" without any.
    file: str = ""


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
        self._kept = _Kept()
        self._second: Document | None = None
        self._kept_of_second = _Kept()
        #: The file of the second mesh, and its session as it was found or written last.
        self._known_of_second: tuple[Path, Session | None] = Path(), None
        self._pool = QThreadPool(self, maxThreadCount=1)
        self._failed.connect(self._say_failed, Qt.ConnectionType.QueuedConnection)
        self._timer = QTimer(self, singleShot=True, interval=_DELAY)
        self._timer.timeout.connect(self.save)
        listen(document.mesh_changed, self.changed)
        changes = (
            document.history.changed, document.display.events, document.solve.changed,
            document.classes.changed,
        )  # fmt: skip
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
        """Save unit, repairs and kept maps of a second document, too, until it is closed (None)."""
        self._save_second()
        self._second, self._kept_of_second = document, _Kept()
        self._known_of_second = Path(), None
        if document is not None:
            listen(document.mesh_changed, self._save_second)
            listen(document.history.changed, self.changed)

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
        self._save_second()
        document = self._document
        if document.path is None or document.mesh is None:
            return
        path = self.path(document.path)
        camera, pair = self._look()
        if not camera:  # the render is still being loaded, and what was saved not yet restored
            return
        maps = self._new_maps(document, self._kept)
        session = replace(session_of(document, camera, pair), kept_maps=self._kept.file)
        self._pool.start(lambda: self._write(path, session, maps))

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

    def restore_maps(self, session: Path, name: str) -> int:
        """Add the kept maps in a file next to a session to the mesh, and return their number."""
        return self._restore_maps(self._document, self._kept, session, name)

    # -- details ------------------------------------------------------------------------------

    def _restore_maps(self, document: Document, kept: _Kept, session: Path, name: str) -> int:
        mesh = document.mesh
        if mesh is None or document.path is None or not name:
            return 0
        self._pool.waitForDone()
        try:
            stored = read_kept_maps(session.with_name(Path(name).name))
        except InputError as fault:
            text = f"The maps kept of {document.path.name} cannot be read: {fault}"
            document.notices.say(text, Severity.WARNING)
            return 0
        if stored.mesh != mesh.content_hash:
            return 0
        document.maps.restore(mesh, stored.maps, stored.edited)
        if session.parent == self._folder:
            kept.maps, kept.file = stored.maps, Path(name).name
        return len(stored.maps)

    def _save_second(self) -> None:
        """Write the session of the second mesh; once it is open, restore the maps kept of it."""
        document, kept = self._second, self._kept_of_second
        if document is None or document.path is None or document.mesh is None:
            return
        path, known = self._known_of_second
        if path != document.path:
            known = self.stored(document.path)
            self._known_of_second = document.path, known
            name = "" if known is None else known.kept_maps
            self._restore_maps(document, kept, self.path(document.path), name)
        now, maps = session_of(document, {}, None), self._new_maps(document, kept)
        if known is not None:
            now = replace(known, unit=now.unit, repairs=now.repairs, source=now.source)
        now = replace(now, kept_maps=kept.file)
        if now != known:
            self._known_of_second = document.path, now
            file = self.path(document.path)
            self._pool.start(lambda: self._write(file, now, maps))

    def _new_maps(self, document: Document, kept: _Kept) -> KeptMaps | None:
        """Return the maps that are in no file; None if they have been written."""
        assert document.path is not None  # without one nothing is saved
        key = _key(self.path(document.path))
        if not kept.file.startswith(key):  # of another file
            kept.maps, kept.file = (), ""
        unsaved = document.maps.unsaved
        maps = unsaved.maps
        if len(maps) == len(kept.maps) and all(
            (one.values is other.values, one.labels) == (True, other.labels)
            for one, other in zip(maps, kept.maps, strict=True)
        ):
            return None
        kept.maps = maps
        kept.file = f"{key}.{time.time_ns():x}{KEPT_MAPS_ENDING}" if maps else ""
        return unsaved

    def _write(
        self,
        path: Path,
        session: Session,
        maps: KeptMaps | None,
    ) -> None:
        """Write a session and new maps, in the thread."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if maps is not None and maps.maps:
                # a new file, so that those of the session before stay until this one is written
                write_kept_maps(self._folder / session.kept_maps, maps)
            write_session(path, session)
            if maps is not None:
                _delete_maps(path, session.kept_maps)
            self._delete_oldest()
        except (InputError, OSError) as fault:
            self._failed.emit(str(fault))

    def _say_failed(self, fault: str) -> None:
        self._kept, self._kept_of_second = _Kept(), _Kept()  # to be tried again
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
    for file in session.parent.glob(f"{_key(session)}.*{KEPT_MAPS_ENDING}"):
        if file.name != but:
            file.unlink(missing_ok=True)


def _key(session: Path) -> str:
    return session.name.removesuffix(SESSION_ENDING)


def _delete(session: Path) -> None:
    """Delete a session and its maps."""
    session.unlink(missing_ok=True)
    _delete_maps(session)

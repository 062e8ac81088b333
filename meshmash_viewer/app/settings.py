"""Data stored between runs: settings of the window, and one session per mesh file."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QObject, QSettings, Qt, QTimer, Signal

from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.app.theme import Mode
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import session_folder
from meshmash_viewer.io.session import (
    KEPT_MAPS_ENDING,
    SESSION_ENDING,
    KeptMaps,
    Session,
    read_kept_maps,
    read_session,
    write_kept_maps,
    write_session,
)
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.vertex_map import VertexMap

_RECENT_KEPT = 10


class Settings:
    """Recent files, theme, layout and the speed of the last solve.

    With `fresh`, all settings have default values, and no stored settings are read or written.
    """

    def __init__(self, fresh: bool = False) -> None:
        self._fresh = fresh
        #: Folder of the sessions of mesh files.
        self.sessions = Path(tempfile.mkdtemp()) if fresh else session_folder()
        store = None if fresh else QSettings("meshmash-viewer", "meshmash-viewer")
        kept: dict[str, object] = {}
        self._get: Callable[[str], Any] = kept.get if store is None else store.value
        self._set = kept.__setitem__ if store is None else store.setValue

    def close(self) -> None:
        """Delete the sessions if the settings are fresh."""
        if self._fresh:
            shutil.rmtree(self.sessions, ignore_errors=True)

    @property
    def recent(self) -> list[Path]:
        """Recently opened mesh files that still exist, newest first."""
        stored = self._get("recent")
        # QSettings returns a list of one string as a string
        texts = [stored] if isinstance(stored, str) else stored or []
        return [path for path in map(Path, texts) if path.exists()]

    def add_recent(self, path: Path) -> None:
        path = path.absolute()
        kept = [path, *(other for other in self.recent if other != path)][:_RECENT_KEPT]
        self._set("recent", [str(each) for each in kept])

    @property
    def folder(self) -> Path:
        folder = Path(str(self._get("folder") or Path.home()))
        return folder if folder.is_dir() else Path.home()

    @folder.setter
    def folder(self, folder: Path) -> None:
        self._set("folder", str(folder))

    @property
    def theme(self) -> Mode:
        stored = self._get("theme")
        return Mode(stored) if stored in set(Mode) else Mode.SYSTEM

    @theme.setter
    def theme(self, mode: Mode) -> None:
        self._set("theme", mode.value)

    @property
    def figure(self) -> tuple[str, str]:
        """Options of the last saved figure as JSON, and the ending of its file; "" if unknown."""
        return str(self._get("figure") or ""), str(self._get("figure_ending") or "")

    @figure.setter
    def figure(self, figure: tuple[str, str]) -> None:
        self._set("figure", figure[0])
        self._set("figure_ending", figure[1])

    @property
    def sheet(self) -> str:
        """Options of the last saved picture of a gallery as JSON; "" if unknown."""
        return str(self._get("sheet") or "")

    @sheet.setter
    def sheet(self, options: str) -> None:
        self._set("sheet", options)

    @property
    def seconds_rate(self) -> float | None:
        """Seconds per vertex and pair of the last solve on this machine."""
        try:
            rate = float(str(self._get("seconds_rate")))
        except ValueError:
            return None
        return rate if 0.0 < rate < 1.0 else None

    @seconds_rate.setter
    def seconds_rate(self, rate: float) -> None:
        self._set("seconds_rate", rate)

    @property
    def layout(self) -> tuple[QByteArray, QByteArray] | None:
        geometry, state = self._get("geometry"), self._get("state")
        if isinstance(geometry, QByteArray) and isinstance(state, QByteArray):
            return geometry, state
        return None

    @layout.setter
    def layout(self, layout: tuple[QByteArray, QByteArray]) -> None:
        self._set("geometry", layout[0])
        self._set("state", layout[1])


#: Minimum time in milliseconds between two writes of a session.
_PAUSE = 300
#: Number of mesh files whose sessions are kept, and of earlier states of a file.
_KEPT, _STATES = 200, 3


class LastSession(QObject):
    """Automatic storage of the session of a document's mesh file after every change.

    The first change is written before the next frame, which may take a second on a slow machine;
    further changes are written together after a pause. Files are written in a thread, because
    flushing them to the disk takes up to a tenth of a second.

    `folder` contains one session per mesh file. `look` returns the camera (see `View.to_json`) and
    the pair with the second mesh, or None.
    """

    _due = Signal()

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
        #: Unsaved maps of each document, as last written, by the name of their file.
        self._kept: dict[Document, dict[str, VertexMap]] = {document: {}}
        #: File of the second mesh, and its session as last read or written.
        self._known_of_second: tuple[Path, Session | None] = Path(), None
        self._slot = Slot(self, "session")
        #: Whether there are changes to write.
        self._waiting = False
        self._timer = QTimer(self, singleShot=True, interval=_PAUSE)
        self._timer.timeout.connect(self._save_changes)
        self._due.connect(self._save_changes, Qt.ConnectionType.QueuedConnection)
        listen(document.mesh_changed, self._change_mesh)
        changes = (
            document.history.changed, document.display.events, document.solve.changed,
            document.classes.changed,
        )  # fmt: skip
        listen(changes, self.changed)

    def changed(self) -> None:
        """Request that the session is written soon."""
        self._waiting = self._document.path is not None
        # a queued signal, because slow frames may delay a timer by more than the pause
        if self._waiting and self._timer.remainingTime() <= 0:
            self._due.emit()

    def watch(self, document: Document | None) -> None:
        """Also save unit, repairs and unsaved maps of a second document; None ends the saving."""
        self._save_second()
        if self._second is not None:
            del self._kept[self._second]
        self._second, self._known_of_second = document, (Path(), None)
        if document is not None:
            self._kept[document] = {}
            listen(document.mesh_changed, self._save_second)
            listen(document.history.changed, self.changed)

    def stored(self, mesh_path: Path) -> Session | None:
        """Return the stored session of a mesh file; None if there is no readable session."""
        self._slot.wait()
        if not self.path(mesh_path).exists():
            return None
        try:
            return read_session(self.path(mesh_path))
        except InputError as fault:
            self.set_aside(mesh_path, str(fault))
            return None

    def set_aside(self, mesh_path: Path, fault: str) -> None:
        """Rename an unusable session file, and show the reason."""
        text = (
            f"{mesh_path.name} is opened without the pins, maps and settings of its last"
            f" session. {fault}"
        )
        text += _set_aside(self.path(mesh_path))
        # `holds` is always True, so that opening the mesh does not withdraw the notice
        self._document.notices.show(Notice(text, Severity.WARNING, holds=lambda: True))

    def path(self, mesh_path: Path) -> Path:
        key = hashlib.sha256(str(mesh_path.absolute()).encode()).hexdigest()[:20]
        return self._folder / f"{key}{SESSION_ENDING}"

    def save(self) -> None:
        """Write the session now. If writing fails, a message is shown."""
        self._timer.stop()
        self._waiting = False
        self._save_second()
        document = self._document
        if document.path is None or document.mesh is None:
            return
        path = self.path(document.path)
        camera, pair = self._look()
        if not camera:  # without a render, the stored session has not been restored yet
            return
        maps = self._new_maps(document)
        session = session_of(document, camera, pair)
        session = replace(session, kept_maps=list(self._kept[document]))
        self._start_writing(path, session, maps)

    def keep_state(self, mesh_path: Path) -> None:
        """Copy the session of a mesh file as it is now; the last `_STATES` copies are kept.

        A copy can be opened like any session.
        """
        self.save()
        session = self.path(mesh_path)
        self._slot.submit(lambda _: _copy_state(session), self._say_failed, queued=True)

    def restore_maps(self, document: Document, session: Path, names: Sequence[str]) -> int:
        """Add the maps in files next to a session to a document; return the number of maps."""
        mesh, kept = document.mesh, self._kept.get(document)
        if kept is None or mesh is None or document.path is None or not names:
            return 0
        self._slot.wait()
        found: list[KeptMaps] = []
        for file in (session.with_name(Path(name).name) for name in names):
            try:
                stored = read_kept_maps(file)
            except InputError as fault:
                text = f"The maps kept of {document.path.name} cannot be read: {fault}"
                if session.parent == self._folder:
                    text += _set_aside(file)
                document.notices.say(text, Severity.WARNING)
                continue
            if stored.mesh == mesh.content_hash:
                found.append(stored)
                if session.parent == self._folder and len(stored.maps) == 1:
                    kept[file.name] = stored.maps[0]
        maps = [each for stored in found for each in stored.maps]
        document.maps.restore(mesh, maps, [name for stored in found for name in stored.edited])
        return len(maps)

    # -- details ------------------------------------------------------------------------------

    def _change_mesh(self) -> None:
        """Write the session of a new mesh after a pause, once the stored session is restored."""
        self._waiting = self._document.path is not None
        if not self._timer.isActive():
            self._timer.start()

    def _save_changes(self) -> None:
        """Write the session, or try again after the next pause if the thread is still writing."""
        if self._waiting and self._timer.remainingTime() <= 0:
            if not self._slot.working:
                self.save()
            self._timer.start()

    def _save_second(self) -> None:
        """Write the session of the second mesh; at the first call, restore its unsaved maps."""
        document = self._second
        if document is None or document.path is None or document.mesh is None:
            return
        path, known = self._known_of_second
        if path != document.path:
            known = self.stored(document.path)
            self._known_of_second = document.path, known
            names = [] if known is None else known.kept_maps
            self.restore_maps(document, self.path(document.path), names)
        now, maps = session_of(document, {}, None), self._new_maps(document)
        if known is not None:
            now = replace(known, unit=now.unit, repairs=now.repairs, source=now.source)
        now = replace(now, kept_maps=list(self._kept[document]))
        if now != known:
            self._known_of_second = document.path, now
            file = self.path(document.path)
            self._start_writing(file, now, maps)

    def _new_maps(self, document: Document) -> dict[str, KeptMaps]:
        """Return the maps that must be written, by the names of their new files."""
        assert document.path is not None
        kept, unsaved = self._kept[document], document.maps.unsaved
        key = _key(self.path(document.path))
        maps: dict[str, VertexMap] = {}
        new: dict[str, KeptMaps] = {}
        for each in unsaved.maps:
            written = (at for at in kept if at.startswith(key))
            file = next((at for at in written if _is_same(kept[at], each)), "")
            if not file:  # use a new name, because the stored session still refers to the old file
                file = f"{key}.{time.time_ns():x}-{len(maps)}{KEPT_MAPS_ENDING}"
                edited = [name for name in unsaved.edited if name == each.name]
                new[file] = KeptMaps((each,), unsaved.mesh, edited)
            maps[file] = each
        self._kept[document] = maps
        return new

    def _start_writing(self, path: Path, session: Session, maps: dict[str, KeptMaps]) -> None:
        self._slot.submit(lambda _: self._write(path, session, maps), self._say_failed, queued=True)

    def _write(self, path: Path, session: Session, maps: dict[str, KeptMaps]) -> str:
        """Write a session and its maps; return a description of a fault, or ""."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            for name, each in maps.items():
                write_kept_maps(self._folder / name, each)
            write_session(path, session)
            _delete_maps(path, session.kept_maps)
            self._delete_oldest()
        except (InputError, OSError) as fault:
            return str(fault)
        return ""

    def _say_failed(self, fault: str) -> None:
        if not fault:
            return
        self._kept = {document: {} for document in self._kept}  # write all maps at the next attempt
        text = f"The session of this mesh (pins, maps, settings) could not be saved: {fault}"
        self._document.notices.say(text, Severity.WARNING)

    def _delete_oldest(self) -> None:
        sessions = sorted(
            self._folder.glob(f"*{SESSION_ENDING}"), key=lambda each: each.stat().st_mtime
        )
        for old in sessions[:-_KEPT]:
            _delete(old)


def _set_aside(file: Path) -> str:
    """Rename an unreadable file; return a sentence with its new path."""
    kept = file.with_suffix(".unreadable")
    try:
        file.replace(kept)
    except OSError as error:
        return f" {file} cannot be renamed ({error.strerror})."
    return f" The file is kept as {kept}."


def _is_same(one: VertexMap, other: VertexMap) -> bool:
    """Whether two maps share their array of values, and name, unit and labels are equal."""
    about = (one.name, one.unit, one.labels) == (other.name, other.unit, other.labels)
    return about and one.values is other.values


def _delete_maps(session: Path, but: Sequence[str] = ()) -> None:
    """Delete the map files of a session, except those named in `but` or in an earlier state."""
    files = session.parent.glob(f"{_key(session)}.*{KEPT_MAPS_ENDING}")
    if stale := [file for file in files if file.name not in but]:
        kept = set[str]()
        for state in _states(session):
            with contextlib.suppress(InputError):  # an unreadable state needs no maps
                kept |= set(read_session(state).kept_maps)
        for file in stale:
            if file.name not in kept:
                file.unlink(missing_ok=True)


def _copy_state(session: Path) -> str:
    """Copy a session, and delete older copies; return a description of a fault, or ""."""
    try:
        if session.exists():
            copy = f"{_key(session)}-{time.time_ns():x}{SESSION_ENDING}"
            shutil.copyfile(session, session.with_name(copy))
            for old in _states(session)[:-_STATES]:
                old.unlink(missing_ok=True)
    except OSError as fault:
        return str(fault)
    return ""


def _states(session: Path) -> list[Path]:
    """Return the copies that `LastSession.keep_state` made of a session, oldest first."""
    return sorted(session.parent.glob(f"{_key(session)}-*{SESSION_ENDING}"))


def _key(session: Path) -> str:
    return session.name.removesuffix(SESSION_ENDING)


def _delete(session: Path) -> None:
    """Delete a session file and its map files."""
    session.unlink(missing_ok=True)
    _delete_maps(session)

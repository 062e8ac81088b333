"""Opening of meshes, maps, tables and sessions, and of a second mesh for a comparison."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QDialog, QFileDialog, QMainWindow

from meshmash_viewer.app.background import say_saved
from meshmash_viewer.app.controller import Controller
from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.app.sessions import Restoration, session_of
from meshmash_viewer.app.settings import LastSession, Settings
from meshmash_viewer.app.stage import Stage
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors
from meshmash_viewer.io.links import LINK_ENDING, name_and_place
from meshmash_viewer.io.maps import is_map_file
from meshmash_viewer.io.pins import is_pin_table
from meshmash_viewer.io.points import POINT_ENDINGS
from meshmash_viewer.io.read import READABLE_ENDINGS
from meshmash_viewer.io.session import (
    KEPT_MAPS_ENDING,
    SESSION_ENDING,
    Session,
    write_kept_maps,
    write_session,
)
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.structures import brain_side
from meshmash_viewer.units import counted

if TYPE_CHECKING:
    from meshmash_viewer.app.second_view import SecondView
    from meshmash_viewer.app.view.mesh_view import MeshView


class Opening(QObject):
    """Commands that open files in a window; owner of the second view and of the sessions.

    `document` and `settings` are those of the window.
    """

    #: A second mesh was opened (its `Pair`) or closed (None).
    pair_changed = Signal(object)
    #: A table of pins was opened: its path.
    pins_requested = Signal(object)
    #: A table of points, or of values per vertex, was opened: its path.
    points_requested = Signal(object)

    def __init__(
        self, window: QMainWindow, document: Document, settings: Settings, stage: Stage
    ) -> None:
        super().__init__(window)
        self.window, self.document, self.settings = window, document, settings
        self._stage = stage
        self.last_session = LastSession(document, settings.sessions, self._look_of, self)
        #: The render of the first mesh, and its controller; None until they are loaded.
        self.scene: MeshView | None = None
        self.controller: Controller | None = None
        self.second_view: SecondView | None = None
        #: Sessions being restored, of the first and of the second mesh.
        self.restoration: Restoration | None = None
        self._second_restoration: Restoration | None = None
        #: Paths of two meshes that are opened together, and map files of the second mesh.
        self._waiting: tuple[Path, Path, list[Path]] | None = None
        self._history = document.history.of("window")
        self._history.keep("second mesh", self._session_of_second, self._restore_second)
        follow(document.mesh_changed, self._open_waiting)
        follow((document.mesh_changed, document.spectrum_changed), self._name_first)

    def _name_first(self) -> None:
        """Show name and number of eigenpairs of the first mesh above its render."""
        mesh, spectrum = self.document.mesh, self.document.spectrum
        parts = [(mesh.name if mesh is not None else "") or "First mesh"]
        if spectrum is not None and len(spectrum):
            pairs = counted(len(spectrum), "pair")
            parts.append(f"{pairs} · complete" if spectrum.complete else pairs)
        self._stage.first_label.setText("  ·  ".join(parts))

    def open_path(self, path: Path) -> None:
        """Open a session, a mesh, or a map of the open mesh; see `open_paths`."""
        self.open_paths([path])

    def open_paths(self, paths: Sequence[Path], *, as_second: bool = False) -> None:
        """Open the first session or mesh among files, and add all maps and tables.

        Two meshes are opened for a comparison. With `as_second`, the mesh file is opened as the
        second mesh, and maps are added to the second mesh, or to the first if there is no second.
        Tables of pins and points are always added to the first mesh.
        """
        if paths[0].suffix != LINK_ENDING:  # link files are stored in an internal folder
            self.settings.folder = paths[0].parent
        maps, others = _divided(paths)
        pins = [] if others else [path for path in maps if is_pin_table(path)]
        maps = [path for path in maps if path not in pins]
        for path in pins:
            self.pins_requested.emit(path)
        if not others and not as_second and self.document.mesh is not None:
            tables = [path for path in maps if _is_table(path)]
            for path in tables:
                self.points_requested.emit(path)
            maps, pins = [path for path in maps if path not in tables], pins + tables
        if pins and not maps:
            return
        self._waiting = None
        if not others:
            second = self.pair.second if as_second and self.pair is not None else None
            (second or self.document).maps.open(maps)
        elif others[0].name.endswith(SESSION_ENDING):
            self.restore_session(others[0], maps)
        elif as_second:
            self.open_second(others[0], maps)
        elif len(others) == 2:
            side = brain_side("", others[1].name)
            apart = side is not None and side != brain_side("", others[0].name)
            sides = [brain_side("", path.name, of_values=True) for path in maps]
            theirs = [path for path, of in zip(maps, sides, strict=True) if apart and of == side]
            self._waiting = (others[0], others[1], theirs)
            self.read(others[0], maps=[path for path in maps if path not in theirs])
            self.document.following = others[1], *maps
        else:
            self.read(others[0], maps=maps)
        if left := ", ".join(path.name for path in others[1 + (self._waiting is not None) :]):
            text = f"Opening {others[0].name} without {left}: open two meshes, or one session."
            self.document.notices.show(Notice(text, Severity.WARNING, holds=lambda: True))

    def _open_waiting(self) -> None:
        """Open the second of two meshes opened together, once the first mesh is open."""
        if self._waiting is None or self.document.path != self._waiting[0]:
            return
        if self.scene is not None and self.restoration is None:
            (_, path, maps), self._waiting = self._waiting, None
            self.open_second(path, maps)

    def drop_texts(self, paths: Sequence[Path]) -> tuple[str, ...]:
        """Describe the effect of `open_paths`, and its effect with `as_second` if different."""
        first, (maps, others) = self.document.mesh, _divided(paths)
        values = maps[0].name if len(maps) == 1 else counted(len(maps), "map")
        if not others:
            names = ["the open mesh" if first is None else first.name or "the open mesh"]
            if self.pair is not None and self.pair.second.mesh is not None:
                names.append(self.pair.second.mesh.name or "the second mesh")
            return tuple(f"Add {values}\nto {name}" for name in names)
        if others[0].name.endswith(SESSION_ENDING):
            return (f"Open the session\n{others[0].name}",)
        name = " and ".join(path.name for path in others[:2]) + (f"\nwith {values}" if maps else "")
        if first is None or self.scene is None:
            return (f"Open\n{name}",)
        return f"Open\n{name}", f"Compare\n{first.name or 'the open mesh'}\nwith {name}"

    def read(self, path: Path, unit: str = "", maps: Sequence[Path] = ()) -> None:
        """Read a mesh file, restore its stored session, and add maps from files.

        An empty `unit` stands for the unit of the session. If reading fails, the previous mesh
        stays open.
        """
        self.last_session.save()
        session = self.last_session.stored(path)
        if session is None:
            self.document.open_mesh(path, unit, maps=maps)
            return
        file = self.last_session.path(path)
        session = replace(session, unit=unit or session.unit, mesh_path=str(path.absolute()))
        try:
            restoration = Restoration(self.document, file, session, saved_itself=True, maps=maps)
        except InputError as fault:
            self.last_session.set_aside(path, str(fault))
            self.document.open_mesh(path, session.unit, maps=maps)
            return
        restoration.restored.connect(lambda: self._offer_fresh_start(path, session))
        self._begin(restoration)

    def _offer_fresh_start(self, path: Path, session: Session) -> None:
        """List the restored items, with a button that opens the file without its session."""
        made = {
            "pin": len(self.document.pins.placed),
            "map": self.last_session.restore_maps(
                self.document, self.last_session.path(path), session.kept_maps
            ),
            "map file": len(session.maps),
            "other mesh": int(session.second is not None),
            "part": int(bool(session.part)),
            "selection": int(bool(session.selection)),
            "set of hidden vertices": int(bool(session.hidden)),
            "table of points": int(bool(session.points)),
            "rebuilt shape": int(self.document.display.shape.shown),
        }
        if any(made.values()):
            made["repair"] = len(self.document.repairs)
            what = ", ".join(counted(count, noun) for noun, count in made.items() if count)
            text = f"Opened as you left it: {what}."
            notice = Notice(text, button="Start afresh", action=lambda: self.start_afresh(path))
            self.document.notices.show(notice)

    def start_afresh(self, path: Path) -> None:
        """Open the file of the mesh as it is, which can be undone; its stored state is kept."""
        self.last_session.keep_state(path)
        self.document.start_afresh(self.end_comparison)

    def _look_of(self) -> tuple[dict[str, Any], Pair | None]:
        """Return the camera (empty without a render) and the pair, to be stored in a session."""
        camera = self.scene.camera() if self.scene is not None else None
        if camera and self.scene is not None and not self.scene.turned_by_hand:
            camera["fitted"] = True  # the camera is fitted to the whole mesh
        return camera or {}, self.pair

    def add_map(self) -> None:
        self._add_map(self.document)

    def add_map_to_second(self) -> None:
        assert self.pair is not None
        self._add_map(self.pair.second)

    def _add_map(self, document: Document) -> None:
        from meshmash_viewer.app.dialogs.files import ask_for_maps

        if paths := ask_for_maps(self.window, self.settings.folder):
            self.settings.folder = paths[0].parent
            document.maps.open(paths)

    def open_mesh(self) -> None:
        if path := self._ask_for_mesh("Open mesh"):
            self.open_path(path)

    def open_link(self) -> None:
        """Ask for a link to the mesh of a segment, and open it as the first or the second mesh."""
        from meshmash_viewer.app.dialogs.link_dialog import LinkDialog

        path = self.document.path
        is_linked = path is not None and path.suffix == LINK_ENDING
        source = name_and_place(path)[1] if path and is_linked else ""
        dialog = LinkDialog(self.window, source, can_compare=self.scene is not None)
        ask(dialog, lambda: self.open_paths([dialog.path], as_second=dialog.compares))

    def compare_with(self) -> None:
        if path := self._ask_for_mesh("Compare with"):
            self.open_second(path)

    def _ask_for_mesh(self, title: str) -> Path | None:
        # the ending of a FreeSurfer file is the name of the surface, such as .pial
        patterns = " ".join([*(f"*{ending}" for ending in READABLE_ENDINGS), "lh.*", "rh.*"])
        return self.ask_for_file(title, f"Meshes ({patterns})")

    def ask_for_file(self, title: str, pattern: str) -> Path | None:
        """Ask for a file to open, in the folder used last; return None if cancelled."""
        chosen, _ = QFileDialog.getOpenFileName(
            self.window, title, str(self.settings.folder), f"{pattern};;All files (*)"
        )
        if not chosen:
            return None
        self.settings.folder = Path(chosen).parent
        return Path(chosen)

    def open_sample(self, name: str = "dendrite") -> None:
        from meshmash_viewer.samples import sample_path

        self.read(sample_path(name))

    # -- the second mesh ----------------------------------------------------------------------

    @property
    def pair(self) -> Pair | None:
        """The pair of both documents; None without a second mesh."""
        return None if self.second_view is None else self.second_view.pair

    @property
    def scenes(self) -> list[MeshView]:
        """The existing renders: of the first mesh, then of the second mesh."""
        first = [] if self.scene is None else [self.scene]
        return first if self.second_view is None else [*first, self.second_view.scene]

    def open_second(self, path: Path, maps: Sequence[Path] = (), unit: str = "") -> None:
        """Read a second mesh like `read`; if reading fails, the previous second mesh stays open."""
        session = self.last_session.stored(path)
        document = self._make_view(None).document
        if session is None:
            document.open_mesh(path, unit, maps=maps)
        else:
            unit = unit or session.unit
            known = session.repairs, session.source
            document.open_mesh(path, unit, None, maps, *(known if session.source else ()))

    def _make_view(self, links: Collection[str] | None) -> SecondView:
        """Return the view of the second mesh, made if needed; pass `links` to `Pair.set_links`."""
        from meshmash_viewer.app.second_view import SecondView

        view = self.second_view
        if view is None:
            assert self.scene is not None and self.controller is not None  # noqa: PT018  a render
            view = self.second_view = SecondView(self.document, self.scene, self.controller)
            view.close_requested.connect(self.end_comparison)
            self.last_session.watch(view.document)
            listen(view.pair.changed, self.last_session.changed)
            self._stage.add_second(view)
            self._name_first()
            self.pair_changed.emit(view.pair)
        view.pair.set_links(links)
        return view

    def end_comparison(self) -> None:
        """Close the second mesh as one change."""
        session = self._session_of_second()
        self._end_comparison()
        if session is not None:
            self._history.record("closing of the second mesh", before={"second mesh": session})

    def _session_of_second(self) -> Session | None:
        """Return the session of the second mesh; None without one that is read from a file."""
        pair = self.pair
        if pair is None or pair.second.path is None:
            return None
        return replace(session_of(pair.second, {}), links=sorted(pair.links), match=pair.match)

    def _restore_second(self, session: Session | None, file: Path | None = None) -> None:
        """Open the second mesh of a session, by default one that was closed in this window."""
        if session is None:
            self._end_comparison()
        elif self.scene is not None:
            view = self._make_view(session.links)
            view.pair.match = session.match
            path = file or Path(session.mesh_path)
            self._second_restoration = Restoration(view.document, path, session)
            self._second_restoration.begin()

    def _end_comparison(self) -> None:
        if self.second_view is not None:
            view, self.second_view, self._second_restoration = self.second_view, None, None
            view.shut()
            self.last_session.watch(None)
            self.pair_changed.emit(None)
            self._stage.remove_second(view)

    # -- sessions -----------------------------------------------------------------------------

    def open_session(self) -> None:
        if path := self.ask_for_file("Open session", f"Sessions (*{SESSION_ENDING})"):
            self.restore_session(path)

    def restore_session(self, path: Path, maps: Sequence[Path] = ()) -> None:
        """Restore a session file, and add maps from further files."""
        try:
            restoration = Restoration(self.document, path, maps=maps)
        except InputError as fault:
            self.document.notices.say(str(fault), Severity.ERROR)
            return
        names = restoration.session.kept_maps
        restoration.restored.connect(
            lambda: self.last_session.restore_maps(self.document, path, names)
        )
        self._begin(restoration)

    def _begin(self, restoration: Restoration) -> None:
        if self.restoration is not None:
            self.restoration.stop()
        self.last_session.save()
        self.restoration = restoration
        restoration.restored.connect(self.look)
        restoration.begin()

    def look(self) -> None:
        """Restore camera and second mesh of a session, once the first mesh and render are ready."""
        restoration = self.restoration
        if self.scene is None or restoration is None or not restoration.done:
            return
        self.restoration = None
        if restoration.camera is not None:
            self.scene.set_camera(restoration.camera.to_json(), fitted=restoration.fitted)
        session = restoration.session
        if session.second is not None and self._waiting is None:
            file, names = restoration.path, session.second.kept_maps
            other = replace(session.second, links=session.links, match=session.match)
            self._restore_second(other, file)
            assert self._second_restoration is not None
            assert self.pair is not None
            second = self.pair.second
            self._second_restoration.restored.connect(
                lambda: self.last_session.restore_maps(second, file, names)
            )
        self._open_waiting()

    def store_session(self, path: Path) -> None:
        """Write a session file, and next to it a file of the unsaved maps.

        `InputError` is raised if a file cannot be written.
        """
        session = session_of(self.document, *self._look_of())
        session = replace(session, kept_maps=_write_maps(path, self.document))
        if session.second is not None and self.pair is not None:
            names = _write_maps(path, self.pair.second, ".second")
            session = replace(session, second=replace(session.second, kept_maps=names))
        write_session(path, session)

    def save_session(self) -> None:
        if self.document.path is None:
            text = "This mesh is only in memory: a session requires a mesh file."
            self.document.notices.say(text, Severity.WARNING)
            return
        start = self.settings.folder / f"{self.document.path.stem}{SESSION_ENDING}"
        chosen, _ = QFileDialog.getSaveFileName(
            self.window, "Save session", str(start), f"Sessions (*{SESSION_ENDING})"
        )
        if not chosen:
            return
        path = Path(chosen)
        if not path.name.endswith(SESSION_ENDING):
            path = path.with_name(path.name.removesuffix(".json") + SESSION_ENDING)
        try:
            self.store_session(path)
        except (InputError, OSError) as fault:
            self.document.notices.say(f"The session was not saved: {fault}", Severity.ERROR)
            return
        say_saved(self.document, f"Session saved to {path}.", path)


def ask(dialog: QDialog, accepted: Callable[[], None] | None = None) -> None:
    """Open a dialog, and delete it when it is closed."""
    if accepted is not None:
        dialog.accepted.connect(accepted)
    dialog.finished.connect(dialog.deleteLater)
    dialog.open()


def _write_maps(session: Path, document: Document, of: str = "") -> list[str]:
    """Write the unsaved maps to a file next to a session file; return the names of the files."""
    if document.mesh is None or not document.maps.unsaved.maps:
        return []
    name = f"{session.name.removesuffix(SESSION_ENDING)}{of}{KEPT_MAPS_ENDING}"
    with writing_errors(session.with_name(name)):
        write_kept_maps(session.with_name(name), document.maps.unsaved)
    return [name]


def _divided(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Divide files into files of maps, pins or points, and other files."""
    maps = [path for path in paths if is_map_file(path) or _is_table(path)]
    return maps, [path for path in paths if path not in maps]


def _is_table(path: Path) -> bool:
    """Return whether a file is a table of points or maps, by its ending."""
    return path.suffix.lower() in POINT_ENDINGS

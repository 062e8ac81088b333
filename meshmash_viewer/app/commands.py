"""Commands of the window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QCursor, QGuiApplication
from PySide6.QtWidgets import QFileDialog, QMainWindow, QMessageBox

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS, Actions, Command
from meshmash_viewer.app.arrangement import Arrangement
from meshmash_viewer.app.background_io import BackgroundIO
from meshmash_viewer.app.controls.focus_keys import settle_typing
from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.app.pictures import Pictures, ask
from meshmash_viewer.app.sessions import Restoration, store_session
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.maps import is_map_file
from meshmash_viewer.io.read import READABLE_ENDINGS
from meshmash_viewer.io.session import SESSION_ENDING
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import cost, stepping
from meshmash_viewer.model.document import Document, Notice, Severity
from meshmash_viewer.model.failure import Failure
from meshmash_viewer.model.field import request_of
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.model.script import Exported, reproduction_script, script_output

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
    from meshmash_viewer.app.second_view import Comparing
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Keys that a focused field uses itself.
_OF_FIELDS = ("cancel", "undo")


class Commands:
    """Implements each command of the table by the method of its name, here or in a helper.

    The others are `pictures`, for what is taken of the render, and the document.

    Parameters
    ----------
    window : QMainWindow
        The parent of dialogs.
    document : Document
    settings : Settings
    actions : Actions
    arrangement : Arrangement
    background_io : BackgroundIO
        Reads and writes files.
    read : callable
        Opens a mesh file in its last unit, with files of maps.

    Attributes
    ----------
    pictures : Pictures
    scene : MeshView, optional
        The render, once it is loaded.
    comparing : Comparing, optional
        Opens a second mesh; set together with `scene`.
    restoration : Restoration, optional
        The session that is being opened.
    """

    def __init__(
        self,
        window: QMainWindow,
        document: Document,
        settings: Settings,
        actions: Actions,
        arrangement: Arrangement,
        background_io: BackgroundIO,
        read: Callable[..., None],
    ) -> None:
        self._window, self._document, self._settings = window, document, settings
        self._actions, self._arrangement = actions, arrangement
        self._background_io, self._read = background_io, read
        self.comparing: Comparing | None = None
        self.restoration: Restoration | None = None
        self._export_ending = ""
        self._exported: Exported | None = None
        self.pictures = Pictures(window, document, settings, background_io)
        display = document.display
        #: The commands that are a call of something else.
        self._calls: dict[str, Callable[..., object]] = {
            "quit": window.close,
            "reset_layout": arrangement.reset,
            "nodal_lines": partial(setattr, display, "nodal_lines"),
            "play": partial(setattr, display, "playing"),
            "show_kind": partial(setattr, display, "kind"),
            "step": partial(stepping.step, document),
            "first": partial(stepping.go_to_start, document),
            "last": partial(stepping.go_to_end, document),
        }
        for each in COMMANDS:
            actions[each.name].triggered.connect(
                lambda checked=False, each=each: self._do(each, checked)
            )

    def _do(self, command: Command, checked: bool) -> None:
        # checked again, as an action is disabled with a delay of some milliseconds
        if command.needs not in self.there():
            return
        if command.name not in _OF_FIELDS and not settle_typing():
            return
        name, given = command.does or (command.name, checked)
        act = self.method(name)
        if command.does or command.checkable:
            act(given)
        else:
            act()

    def method(self, name: str) -> Callable[..., object]:
        """Return the method of a command."""
        owners = (self, self.pictures, self._document)
        return self._calls.get(name) or next(
            getattr(owner, name) for owner in owners if hasattr(owner, name)
        )

    def there(self) -> set[str]:
        """Return the needs of commands (`Command.needs`) that are met now."""
        ready, spectrum = self._document.ready, self._document.spectrum
        shown = self.scene is not None and ready is not None
        some = shown and spectrum is not None and len(spectrum) > 0
        known = {
            "": True,
            "mesh": ready is not None,
            "render": shown,
            "spectrum": some,
            # previews are not exported
            "exact spectrum": some
            and spectrum is not None
            and (not spectrum.preview or spectrum.complete),
            "second mesh": self.comparing is not None and self.comparing.second_view is not None,
        }
        return {name for name, known_now in known.items() if known_now}

    def refresh(self) -> None:
        """Update the enabled and checked state of all actions."""
        document, display, actions = self._document, self._document.display, self._actions
        actions.enable(self.there())
        running = document.job is not None
        actions["compute"].setEnabled(document.can_compute)
        actions["cancel"].setEnabled(running)
        actions["undo"].setEnabled(bool(document.last_change))
        actions["undo"].setText(f"Undo {document.last_change}".rstrip())
        actions["clear_pins"].setEnabled(bool(document.pins))
        actions["similar"].setEnabled(bool(document.pins) and document.spectrum is not None)
        if not document.can_flip:
            actions["flip"].setEnabled(False)
        # resolved, as the sign of a map depends on the mesh
        request = request_of(document)
        if request is not None and not request.family.signed and not request.family.contoured:
            actions["nodal_lines"].setEnabled(False)
        actions["nodal_lines"].setChecked(display.nodal_lines)
        actions["play"].setChecked(display.playing)
        for mode in theme.Mode:
            actions[f"theme_{mode.value}"].setChecked(theme.mode() is mode)

    def _say(self, text: str, severity: Severity = Severity.INFORMATION) -> None:
        self._document.notify(Notice(text, severity))

    @property
    def scene(self) -> MeshView | None:
        return self.pictures.scene

    @scene.setter
    def scene(self, scene: MeshView) -> None:
        self.pictures.scene = scene

    # -- opening ------------------------------------------------------------------------------

    def open_path(self, path: Path) -> None:
        """Open a file: a session by its ending, a map of the open mesh, or a mesh."""
        self.open_paths([path])

    def open_paths(self, paths: Sequence[Path], *, as_second: bool = False) -> None:
        """Open the first session or mesh among files, and add all maps among them.

        With `as_second` they are for the second mesh; maps are for the first if there is none.
        """
        self._settings.folder = paths[0].parent
        maps = [path for path in paths if is_map_file(path)]
        others = [path for path in paths if path not in maps]
        if not others:
            second = self._pair.second if as_second and self._pair is not None else None
            (second or self._document).open_maps(maps)
        elif others[0].name.endswith(SESSION_ENDING):
            self.restore_session(others[0])
        elif as_second:
            self.open_second(others[0], maps)
        else:
            self._read(others[0], maps=maps)
        if len(others) > 1:
            self._say(f"Opening {others[0].name}; one mesh at a time.")

    def add_map(self) -> None:
        """Ask for files with values per vertex of the open mesh."""
        self._add_map(self._document)

    def add_map_to_second(self) -> None:
        """Ask for files with values per vertex of the second mesh."""
        assert self._pair is not None
        self._add_map(self._pair.second)

    def _add_map(self, document: Document) -> None:
        from meshmash_viewer.app.dialogs.files import ask_for_maps

        paths = ask_for_maps(self._window, self._settings.folder)
        if paths:
            self._settings.folder = paths[0].parent
            document.open_maps(paths)

    def open_mesh(self) -> None:
        """Ask for a mesh file."""
        path = self._ask_for_mesh("Open mesh")
        if path is not None:
            self.open_path(path)

    def compare_with(self) -> None:
        """Ask for a second mesh."""
        path = self._ask_for_mesh("Compare with")
        if path is not None:
            self._settings.folder = path.parent
            self.open_second(path)

    def open_second(self, path: Path, maps: Sequence[Path] = ()) -> None:
        """Open a second mesh in its last unit, with files of maps."""
        assert self.comparing is not None
        self.comparing.open(path, maps=maps)

    def end_comparison(self) -> None:
        """Close the second mesh."""
        assert self.comparing is not None
        self.comparing.end()

    @property
    def _pair(self) -> Pair | None:
        return None if self.comparing is None else self.comparing.pair

    def _ask_for_mesh(self, title: str) -> Path | None:
        # FreeSurfer surfaces have endings of many kinds
        patterns = " ".join([*(f"*{ending}" for ending in READABLE_ENDINGS), "lh.*", "rh.*"])
        path, _ = QFileDialog.getOpenFileName(
            self._window,
            title,
            str(self._settings.folder),
            f"Meshes ({patterns});;All files (*)",
        )
        return Path(path) if path else None

    def open_sample(self, name: str = "dendrite") -> None:
        """Open a mesh that comes with the program."""
        from meshmash_viewer.samples import sample_path

        self._read(sample_path(name))

    # -- sessions -----------------------------------------------------------------------------

    def open_session(self) -> None:
        """Ask for a session."""
        path, _ = QFileDialog.getOpenFileName(
            self._window,
            "Open session",
            str(self._settings.folder),
            f"Sessions (*{SESSION_ENDING});;All files (*)",
        )
        if path:
            self.restore_session(Path(path))

    def restore_session(self, path: Path) -> None:
        """Open a session file."""
        try:
            restoration = Restoration(self._document, path)
        except InputError as fault:
            self._say(str(fault), Severity.ERROR)
            return
        if self.restoration is not None:
            self.restoration.stop()
        self.restoration = restoration
        restoration.restored.connect(self.look)
        restoration.begin()

    def look(self) -> None:
        """Restore the camera of the session, once both mesh and render are loaded."""
        restoration = self.restoration
        if self.scene is None or restoration is None or not restoration.done:
            return
        self.restoration = None
        if restoration.camera is not None:
            self.scene.set_camera(restoration.camera.to_json())
        if restoration.second is not None and self.comparing is not None:
            self.comparing.restore(restoration.second)

    def store_session(self, path: Path) -> None:
        """Write the session; raise `InputError` if the file cannot be written."""
        camera = self.scene.camera() if self.scene is not None else None
        store_session(self._document, camera or {}, path, self._pair)

    def save_session(self) -> None:
        """Ask for a file name, and save the session."""
        if self._document.path is None:
            text = "This mesh was handed over in memory: a session needs one that is in a file."
            self._say(text, Severity.WARNING)
            return
        start = self._settings.folder / f"{self._document.path.stem}{SESSION_ENDING}"
        chosen, _ = QFileDialog.getSaveFileName(
            self._window, "Save session", str(start), f"Sessions (*{SESSION_ENDING})"
        )
        if not chosen:
            return
        path = Path(chosen)
        if not path.name.endswith(SESSION_ENDING):
            path = path.with_name(path.name.removesuffix(".json") + SESSION_ENDING)
        try:
            self.store_session(path)
        except (InputError, OSError) as fault:
            self._say(f"The session was not saved: {fault}", Severity.ERROR)
            return
        self._say(f"Session saved to {path}.")

    # -- taking away --------------------------------------------------------------------------

    def export(self) -> None:
        """Ask for the export options, and start the export."""
        from meshmash_viewer.app.dialogs.export_dialog import ExportDialog

        folder, ending = self._settings.folder, self._export_ending
        dialog = ExportDialog(self._document, folder, self._window, ending)
        ask(dialog, lambda: self._start_export(dialog))

    def _start_export(self, dialog: ExportDialog) -> None:
        job = dialog.job()
        self._export_ending = dialog.format.ending
        self._settings.folder = job.path.parent
        self._exported = Exported(job.mesh.content_hash, job.family, job.n_pairs, job.maps)
        self._document.request(job)

    def compute_in_pieces(self) -> None:
        """Ask for feature, pieces and file, and start the computation."""
        from meshmash_viewer.app.dialogs.pieces_dialog import PiecesDialog

        dialog = PiecesDialog(self._document, self._settings.folder, self._window)
        ask(dialog, lambda: self._document.request(dialog.job()))

    def save_shape(self, path: Path) -> None:
        """Save the displayed shape as a mesh."""
        from meshmash_viewer.app.shape_source import shape_writer

        if self._document.spectrum is None:  # another mesh was opened meanwhile
            self._say("The shape was not saved: its mesh is not open any more.", Severity.WARNING)
            return
        self._write(path, shape_writer(self._document, path), "Shape")

    def save_match(self, path: Path) -> None:
        """Save the match of the vertices of both meshes."""
        if (pair := self._pair) is not None:
            self._write(path, lambda: pair.write_match(path), "Match")

    def _write(self, path: Path, work: Callable[[], object], what: str) -> None:
        doing = f"Writing {path.name}"
        self._background_io.run(doing, work, lambda _: self._say(f"{what} written to {path}."))

    def say_failed(self, failure: Failure) -> None:
        """Show why something is not available."""
        self._document.notify(notice_of(failure))

    def copy_script(self) -> None:
        """Copy a script that reproduces the display to the clipboard."""
        script = reproduction_script(self._document, self._pair, self._exported)
        QGuiApplication.clipboard().setText(script)
        text = "Copied a Python script that makes what is on screen again"
        if output := script_output(self._document):
            text += f" and writes {output}, or the next free name where there is such a file"
        self._say(f"{text}.")

    def clear_cache(self) -> None:
        """Delete the stored eigenpairs, after a question."""
        from meshmash_viewer.io.cache import EigenpairCache

        cache = EigenpairCache()
        size = cost.written_bytes(cache.size())
        answer = QMessageBox.question(
            self._window,
            "Clear stored eigenpairs",
            f"Eigenpairs of meshes opened before take {size} on disk. Delete them?\n"
            "Opening these meshes again means computing again.",
        )
        if answer == QMessageBox.StandardButton.Yes:
            cache.clear()
            self._say(f"Deleted {size} of stored eigenpairs.")

    # -- looking ------------------------------------------------------------------------------

    def reset_camera(self) -> None:
        """Show the whole mesh."""
        assert self.scene is not None
        self.scene.reset_camera()

    def choose_theme(self, mode: theme.Mode) -> None:
        """Set and store the theme: light, dark, or that of the system."""
        self._settings.theme = mode
        theme.set_mode(mode)
        self.refresh()  # a checked theme cannot be unchecked

    def full_screen(self, on: bool) -> None:
        """Toggle full screen."""
        if on:
            self._window.showFullScreen()
        else:
            self._window.showNormal()

    # -- inspecting ---------------------------------------------------------------------------

    def pin(self) -> None:
        """Pin the vertex under the pointer, or remove its pin."""
        scene = self.scene
        assert scene is not None
        place = scene.mapFromGlobal(QCursor.pos())
        vertex = scene.vertex_at(place.x(), place.y()) if scene.rect().contains(place) else -1
        if vertex >= 0:
            self._document.toggle_pin(vertex)
        else:
            self._say("Hold the pointer over the mesh, then press P.")

    def pin_index(self) -> None:
        """Ask for an index and pin that vertex."""
        from meshmash_viewer.app.dialogs.pin_dialog import PinDialog

        mesh = self._document.mesh
        assert mesh is not None
        dialog = PinDialog(mesh, self._window)
        ask(dialog, lambda: self._pin(mesh, dialog.vertex))

    def _pin(self, mesh: Mesh, vertex: int) -> None:
        if self._document.mesh is not mesh:
            self._say("The vertex was not pinned: its mesh is not open any more.", Severity.WARNING)
        elif any(pin.vertex == vertex for pin in self._document.pins):
            self._say(f"{mesh.named_vertex(vertex).capitalize()} is pinned already.")
        else:
            self._document.toggle_pin(vertex)

    # -- help ---------------------------------------------------------------------------------

    def help(self) -> None:
        """Show the table of commands."""
        from meshmash_viewer.app.dialogs.help_dialog import HelpDialog

        ask(HelpDialog(self._window))

    def command_palette(self) -> None:
        """Open the search box over commands and settings."""
        from meshmash_viewer.app.dialogs.command_palette import CommandPalette

        CommandPalette(self._window, self._actions).show()

    def system_report(self) -> None:
        """Copy the report of the machine, for a bug report, to the clipboard."""
        from meshmash_viewer.app.view.picture import graphics
        from meshmash_viewer.model.system_report import system_report

        drawn = "none yet" if self.scene is None else graphics(self.scene.plotter.window_of_vtk)
        QGuiApplication.clipboard().setText(system_report(drawn))
        self._say("System report copied: paste it where you report a fault.")

    def about(self) -> None:
        """Show version, licence and methods."""
        from meshmash_viewer.app.dialogs.help_dialog import AboutDialog

        ask(AboutDialog(self._window))

"""What the commands of the window do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QCursor, QGuiApplication, QImage
from PySide6.QtWidgets import QDialog, QFileDialog, QInputDialog, QMessageBox

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS
from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.app.view.picture_writer import PictureWriter
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.read import READABLE_ENDINGS
from meshmash_viewer.io.session import SESSION_ENDING
from meshmash_viewer.model import cost, stepping
from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.document import Notice, Severity
from meshmash_viewer.model.failure import Failure

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
    from meshmash_viewer.app.dialogs.picture_dialog import PictureDialog
    from meshmash_viewer.app.main_window import MainWindow

__all__ = ["Commands"]


class Commands:
    """Connects every command of the table to what it does.

    Parameters
    ----------
    window : MainWindow
        With its `actions_`, `menus`, `document`, `stage` and `settings`.
    """

    def __init__(self, window: MainWindow) -> None:
        self._window = window
        self._document = window.document
        self.pictures = PictureWriter(window)
        self.pictures.written.connect(
            lambda path: self._document.notify(Notice(f"Picture saved to {path}."))
        )
        self.pictures.failed.connect(self._say_not_saved)
        document, display = window.document, window.document.display
        does = {
            "open_mesh": self.ask_for_mesh,
            "open_sample": self.open_sample,
            "open_session": self.ask_for_session,
            "save_session": self.save_session,
            "export": self.export,
            "save_picture": self.save_picture,
            "copy_picture": self.copy_picture,
            "copy_script": self.copy_script,
            "quit": window.close,
            "undo_repair": document.undo_repair,
            "compute": document.compute,
            "cancel": document.cancel,
            "clear_cache": self.clear_cache,
            "reset_camera": lambda: window.scene.reset_camera(),
            "nodal_lines": lambda on: setattr(display, "nodal_lines", on),
            "theme_system": lambda _: self.choose_theme(theme.Mode.SYSTEM),
            "theme_light": lambda _: self.choose_theme(theme.Mode.LIGHT),
            "theme_dark": lambda _: self.choose_theme(theme.Mode.DARK),
            "full_screen": self.full_screen,
            "reset_layout": window.arrangement.reset,
            "play": lambda on: setattr(display, "playing", on),
            "next": lambda: self.step(1),
            "previous": lambda: self.step(-1),
            "next_ten": lambda: self.step(10),
            "previous_ten": lambda: self.step(-10),
            "first": lambda: stepping.go_to_start(document),
            "last": lambda: stepping.go_to_end(document),
            "flip": self.flip,
            "show_eigenfunctions": lambda: setattr(display, "kind", FieldKind.EIGENFUNCTION),
            "show_hks": lambda: setattr(display, "kind", FieldKind.HKS),
            "show_bands": lambda: setattr(display, "kind", FieldKind.BAND),
            "pin": self.pin_under_pointer,
            "pin_index": self.pin_by_index,
            "clear_pins": document.clear_pins,
            "similar": self.similar,
            "help": self.help,
            "about": self.about,
        }
        assert does.keys() == {each.name for each in COMMANDS}
        for name, act in does.items():
            window.actions_.on(name, act, window.there)
        welcome = window.stage.welcome
        welcome.open_requested.connect(self.ask_for_mesh)
        welcome.sample_requested.connect(self.open_sample)
        welcome.recent_requested.connect(self.open_path)
        menu = window.menus["File"]
        self._recent_menu = menu.addMenu("Recent meshes")
        menu.insertMenu(window.actions_["open_session"], self._recent_menu)

    def _ask(self, dialog: QDialog, accepted: Callable[[], None] | None = None) -> None:
        """Open a dialog, which is gone when it has been answered."""
        if accepted is not None:
            dialog.accepted.connect(accepted)
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()

    # -- opening ------------------------------------------------------------------------------

    def open_path(self, path: Path) -> None:
        """Open a file: a session by its ending, a mesh otherwise."""
        self._window.settings.folder = path.parent
        if path.name.endswith(SESSION_ENDING):
            self.open_session(path)
        else:
            self._window.open_mesh(path)

    def ask_for_mesh(self) -> None:
        """Let the person choose a mesh file."""
        endings = " ".join(f"*{ending}" for ending in READABLE_ENDINGS)
        path, _ = QFileDialog.getOpenFileName(
            self._window,
            "Open mesh",
            str(self._window.settings.folder),
            f"Meshes ({endings});;All files (*)",
        )
        if path:
            self.open_path(Path(path))

    def open_sample(self) -> None:
        """Open the dendrite that comes with the program."""
        from meshmash_viewer.samples import sample_path

        self._window.open_mesh(sample_path())

    def refresh_recent(self) -> None:
        """List the recent files in the menu and on the welcome."""
        recent = self._window.settings.recent
        self._recent_menu.clear()
        self._recent_menu.setEnabled(bool(recent))
        for path in recent:
            action = self._recent_menu.addAction(path.name)
            action.setToolTip(str(path))
            action.triggered.connect(lambda _checked=False, path=path: self.open_path(path))
        self._window.stage.welcome.set_recent(recent)

    # -- sessions -----------------------------------------------------------------------------

    def ask_for_session(self) -> None:
        """Let the person choose a session."""
        path, _ = QFileDialog.getOpenFileName(
            self._window,
            "Open session",
            str(self._window.settings.folder),
            f"Sessions (*{SESSION_ENDING});;All files (*)",
        )
        if path:
            self.open_session(Path(path))

    def open_session(self, path: Path) -> None:
        """Go on from a session file."""
        from meshmash_viewer.app.sessions import restore_session

        try:
            restore_session(self._window, path)
        except InputError as fault:
            self._document.notify(Notice(str(fault), Severity.ERROR))

    def save_session(self) -> None:
        """Save what is on screen under a name that the person chooses."""
        from meshmash_viewer.app.sessions import store_session

        if self._document.path is None:
            text = "This mesh was handed over in memory: a session needs one that is in a file."
            self._document.notify(Notice(text, Severity.WARNING))
            return
        start = self._window.settings.folder / f"{self._document.path.stem}{SESSION_ENDING}"
        chosen, _ = QFileDialog.getSaveFileName(
            self._window, "Save session", str(start), f"Sessions (*{SESSION_ENDING})"
        )
        if not chosen:
            return
        path = Path(chosen)
        if not path.name.endswith(SESSION_ENDING):
            path = path.with_name(path.name.removesuffix(".json") + SESSION_ENDING)
        try:
            store_session(self._window, path)
        except (InputError, OSError) as fault:
            self._document.notify(Notice(f"The session was not saved: {fault}", Severity.ERROR))
            return
        self._document.notify(Notice(f"Session saved to {path}."))

    # -- taking away --------------------------------------------------------------------------

    def export(self) -> None:
        """Ask what to write, and have it written."""
        from meshmash_viewer.app.dialogs.export_dialog import ExportDialog

        dialog = ExportDialog(self._document, self._window.settings.folder, self._window)
        self._ask(dialog, lambda: self._start_export(dialog))

    def _start_export(self, dialog: ExportDialog) -> None:
        job = dialog.job()
        self._window.settings.folder = job.path.parent
        self._document.export(job)

    def save_picture(self) -> None:
        """Ask for size and background, and save the render."""
        from meshmash_viewer.app.dialogs.picture_dialog import PictureDialog

        scene = self._window.scene
        name = (self._document.mesh.name or "mesh") + ".png"
        ratio = scene.devicePixelRatioF()
        size = (round(scene.width() * ratio), round(scene.height() * ratio))
        dialog = PictureDialog(size, self._window.settings.folder / name, self._window)
        self._ask(dialog, lambda: self._write_picture(dialog))

    def _write_picture(self, dialog: PictureDialog) -> None:
        path = dialog.path
        twin = self._window.scene.twin()
        self.pictures.write(path, twin, dialog.size_, dialog.transparent)
        self._window.settings.folder = path.parent

    def _say_not_saved(self, failure: Failure) -> None:
        text = f"The picture was not saved: {failure.text}"
        self._document.notify(notice_of(replace(failure, text=text)))

    def copy_picture(self) -> None:
        """Put the render on the clipboard."""
        picture = self._window.scene.picture()
        height, width, _ = picture.shape
        image = QImage(picture.tobytes(), width, height, QImage.Format.Format_RGBA8888)
        QGuiApplication.clipboard().setImage(image.copy())
        self._document.notify(Notice("Picture copied."))

    def copy_script(self) -> None:
        """Put a script that makes what is on screen on the clipboard."""
        from meshmash_viewer.model.script import reproduction_script

        QGuiApplication.clipboard().setText(reproduction_script(self._document))
        self._document.notify(Notice("Copied a Python script that makes what is on screen again."))

    def clear_cache(self) -> None:
        """Delete what is stored, after asking."""
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
            self._document.notify(Notice(f"Deleted {size} of stored eigenpairs."))

    # -- looking ------------------------------------------------------------------------------

    def step(self, steps: int) -> None:
        """Go on or back in whatever is on the render."""
        stepping.step(self._document, steps)

    def flip(self) -> None:
        """Flip the sign of the eigenfunction on the render."""
        if self._document.display.kind is FieldKind.EIGENFUNCTION:
            self._document.flip()

    def choose_theme(self, mode: theme.Mode) -> None:
        """Light, dark, or as the system is; kept for the next time."""
        self._window.settings.theme = mode
        theme.set_mode(mode)

    def full_screen(self, on: bool) -> None:
        """Fill the screen, or go back to the size before."""
        if on:
            self._window.showFullScreen()
        else:
            self._window.showNormal()

    # -- inspecting ---------------------------------------------------------------------------

    def pin_under_pointer(self) -> None:
        """Pin the vertex under the pointer, or take its pin away."""
        scene = self._window.scene
        place = scene.mapFromGlobal(QCursor.pos())
        vertex = scene.vertex_at(place.x(), place.y()) if scene.rect().contains(place) else -1
        if vertex >= 0:
            self._document.toggle_pin(vertex)
        else:
            self._document.notify(Notice("Hold the pointer over the mesh, then press P."))

    def pin_by_index(self) -> None:
        """Ask for an index and pin that vertex."""
        last = self._document.mesh.n_vertices - 1
        vertex, chosen = QInputDialog.getInt(
            self._window, "Pin vertex", f"Index of the vertex, 0 to {last:,}:", 0, 0, last
        )
        if chosen and all(pin.vertex != vertex for pin in self._document.pins):
            self._document.toggle_pin(vertex)

    def similar(self) -> None:
        """Paint the distance in feature space from the vertex pinned last."""
        if self._document.pins:
            self._document.display.similarity_vertex = self._document.pins[-1].vertex
            self._document.display.kind = FieldKind.SIMILARITY

    # -- help ---------------------------------------------------------------------------------

    def help(self) -> None:
        """Show the table of commands."""
        from meshmash_viewer.app.dialogs.help_dialog import HelpDialog

        self._ask(HelpDialog(self._window))

    def about(self) -> None:
        """Show version, licence and methods."""
        from meshmash_viewer.app.dialogs.help_dialog import AboutDialog

        self._ask(AboutDialog(self._window))

"""Commands that save the render: pictures, figures, galleries, movies and scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QGuiApplication, QImage
from PySide6.QtWidgets import QDialog, QMainWindow

from meshmash_viewer.app.background_io import BackgroundIO
from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.app.saved import say_saved
from meshmash_viewer.app.series_painter import SeriesPainter, picture_file
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import remove_left_overs
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.failure import Failure
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.work import call_in_child

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
    from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog
    from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog
    from meshmash_viewer.app.dialogs.picture_dialog import PictureChoice, PictureDialog
    from meshmash_viewer.app.view.figure import FigureOptions
    from meshmash_viewer.app.view.mesh_view import MeshView


class Pictures:
    """The commands that save or copy the render `scene`, with their dialogs."""

    def __init__(
        self,
        window: QMainWindow,
        document: Document,
        settings: Settings,
        background_io: BackgroundIO,
    ) -> None:
        self._window, self._document, self._settings = window, document, settings
        self.scene: MeshView | None = None
        #: Returns the renders of the first mesh and of the second, if there is one.
        self.scenes: Callable[[], list[MeshView]] = list
        self._pictured = ""
        self._picture: PictureChoice | None = None
        self._figure: FigureOptions | None = None
        #: Open modeless dialogs by command.
        self._open_dialogs: dict[str, GalleryDialog | MovieDialog] = {}
        self.painter = SeriesPainter(window)
        self.painter.drawn.connect(
            lambda _at, path: say_saved(document, f"Picture saved to {path}.", path)
        )
        self.painter.failed.connect(self._say_not_saved)
        self._background_io, self._closed = background_io, False

    def save_picture(self) -> None:
        """Ask for size and background, and save the render."""
        from meshmash_viewer.app.dialogs.picture_dialog import PictureDialog

        scene, mesh = self.scene, self._document.mesh
        assert scene is not None and mesh is not None  # noqa: PT018  the command needs them
        path, before = self._settings.folder / f"{mesh.name or 'mesh'}.png", self._picture
        if before is not None and self._pictured == mesh.name:
            path = before.path
        ratio = scene.devicePixelRatioF()
        size = (round(scene.width() * ratio), round(scene.height() * ratio))
        dialog = PictureDialog(size, path, self._window, before)
        ask(dialog, lambda: self._write_picture(dialog))

    def _write_picture(self, dialog: PictureDialog) -> None:
        from meshmash_viewer.app.view.series import Shot

        assert self.scene is not None
        choice, mesh = dialog.choice, self._document.mesh
        self._picture, self._pictured = choice, mesh.name if mesh is not None else ""
        self.painter.start(
            self.scene.renderer.twin(),
            choice.size,
            [Shot()],
            self._document.display,
            picture_file(choice.path),
            transparent=choice.transparent,
        )
        self._settings.folder = choice.path.parent

    def save_figure(self) -> None:
        """Ask for size and contents, and save the render, or both, as a figure for a paper."""
        from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog

        mesh = self._document.mesh
        assert mesh is not None
        path = self._settings.folder / f"{mesh.name or 'mesh'}_figure"
        dialog = FigureDialog(path, self._window, self._figure)
        ask(dialog, lambda: self._write_figure(dialog))

    def _write_figure(self, dialog: FigureDialog) -> None:
        from meshmash_viewer.app.view.figure import compose_figure, save_figure

        path = dialog.path
        try:
            self._figure = dialog.options
            drawings = [scene.renderer.twin() for scene in self.scenes()]
            figure = compose_figure(drawings, self._figure)
        except InputError as fault:
            self._document.notices.say(f"The figure was not saved: {fault}", Severity.ERROR)
            return
        self._settings.folder = path.parent
        self._background_io.run(
            f"Writing {path.name}",
            lambda: save_figure(figure, path),
            lambda _: say_saved(self._document, f"Figure saved to {path}.", path),
        )

    def gallery(self) -> None:
        """Open the gallery of the displayed family."""
        from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog

        scene = self.scene
        assert scene is not None
        if not self._raise_open("gallery"):
            dialog = GalleryDialog(self._document, scene, self._window)
            dialog.save_requested.connect(lambda: self._save_gallery(dialog))
            self._open("gallery", dialog, "Picture")

    def _save_gallery(self, gallery: GalleryDialog) -> None:
        from meshmash_viewer.app.dialogs.picture_dialog import PictureDialog

        mesh = self._document.mesh
        assert mesh is not None
        path = self._settings.folder / f"{mesh.name or 'mesh'}_gallery.png"
        dialog = PictureDialog(gallery.size_on_screen, path, gallery)

        def save() -> None:
            choice = dialog.choice
            gallery.save(choice.path, choice.size, choice.transparent)

        ask(dialog, save)

    def save_movie(self) -> None:
        """Open the dialog that makes a movie."""
        from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog

        scene, mesh = self.scene, self._document.mesh
        assert scene is not None and mesh is not None  # noqa: PT018  the command needs them
        if not self._raise_open("movie"):
            path = self._settings.folder / (mesh.name or "mesh")
            self._open("movie", MovieDialog(self._document, scene, path, self._window), "Movie")

    def _raise_open(self, name: str) -> bool:
        """Raise the dialog of a command if it is open; returns whether it is."""
        dialog = self._open_dialogs.get(name)
        if dialog is not None:
            dialog.raise_()
            dialog.activateWindow()
        return dialog is not None

    def _open(self, name: str, dialog: GalleryDialog | MovieDialog, what: str) -> None:
        """Open a modeless dialog, and notify when it has saved its file."""

        def take_saved(path: Path) -> None:
            self._settings.folder = path.parent
            say_saved(self._document, f"{what} saved to {path}.", path)

        self._open_dialogs[name] = dialog
        dialog.saved.connect(take_saved)
        dialog.finished.connect(lambda: self._open_dialogs.pop(name, None))
        dialog.finished.connect(dialog.deleteLater)
        dialog.show()

    def save_scene(self) -> None:
        """Ask for format and file, and save the mesh with its field as a scene."""
        from meshmash_viewer.app.dialogs.picture_dialog import SceneDialog

        mesh = self._document.mesh
        assert mesh is not None
        dialog = SceneDialog(self._settings.folder / (mesh.name or "mesh"), self._window)
        ask(dialog, lambda: self._write_scene(dialog.path))

    def _write_scene(self, path: Path) -> None:
        from meshmash_viewer.app.view.scene import displayed_surface, write_scene

        assert self.scene is not None
        self._settings.folder = path.parent
        self._document.notices.say(f"Writing {path.name} …")
        surface = displayed_surface(self.scene.renderer)

        def write() -> None:
            try:  # in a process, as pyvista takes seconds, with the interpreter lock
                call_in_child(write_scene, surface, path, look=self._stop_if_closed)
            finally:
                remove_left_overs(path.parent)  # of a process that was ended

        self._background_io.run(
            f"Writing {path.name}",
            write,
            lambda _: say_saved(self._document, f"Scene saved to {path}.", path),
        )

    def _stop_if_closed(self, _: object) -> None:
        if self._closed:
            raise Cancelled

    def copy_picture(self) -> None:
        """Copy the render to the clipboard."""
        assert self.scene is not None
        picture = self.scene.picture()
        height, width, _ = picture.shape
        image = QImage(picture.tobytes(), width, height, QImage.Format.Format_RGBA8888)
        QGuiApplication.clipboard().setImage(image.copy())
        self._document.notices.say("Picture copied.")

    def close(self) -> None:
        """Finish the pictures that are being written, and close open dialogs."""
        self.painter.wait()
        self._closed = True
        for dialog in list(self._open_dialogs.values()):
            dialog.done(0)  # cancels a movie that is being made

    def _say_not_saved(self, failure: Failure) -> None:
        text = f"The picture was not saved: {failure.text}"
        self._document.notices.show(notice_of(replace(failure, text=text)))


def ask(dialog: QDialog, accepted: Callable[[], None] | None = None) -> None:
    """Open a dialog, and delete it when it is closed."""
    if accepted is not None:
        dialog.accepted.connect(accepted)
    dialog.finished.connect(dialog.deleteLater)
    dialog.open()

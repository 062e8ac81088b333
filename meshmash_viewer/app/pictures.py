"""What is taken of the render: pictures, galleries, films and scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QGuiApplication, QImage
from PySide6.QtWidgets import QDialog, QMainWindow

from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.app.scene_writer import SceneWriter
from meshmash_viewer.app.series_painter import SeriesPainter, picture_file
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.model.document import Document, Notice
from meshmash_viewer.model.failure import Failure

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog
    from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog
    from meshmash_viewer.app.dialogs.picture_dialog import PictureChoice, PictureDialog
    from meshmash_viewer.app.view.mesh_view import MeshView

__all__ = ["Pictures", "ask"]


class Pictures:
    """The commands that save or copy what the render shows, and the dialogs that ask how.

    Parameters
    ----------
    window : QMainWindow
        The parent of dialogs.
    document : Document
    settings : Settings

    Attributes
    ----------
    scene : MeshView, optional
        The render, once it is loaded.
    """

    def __init__(self, window: QMainWindow, document: Document, settings: Settings) -> None:
        self._window, self._document, self._settings = window, document, settings
        self.scene: MeshView | None = None
        self._pictured = ""
        self._picture: PictureChoice | None = None
        #: Dialogs that stand open beside the window, one of each command.
        self._standing: dict[str, GalleryDialog | MovieDialog] = {}
        self.painter = SeriesPainter(window)
        self.painter.drawn.connect(lambda _at, path: self._say(f"Picture saved to {path}."))
        self.painter.failed.connect(self._say_not_saved)
        self._scenes = SceneWriter(window)
        self._scenes.written.connect(lambda path: self._say(f"Scene saved to {path}."))
        self._scenes.failed.connect(lambda failure: document.notify(notice_of(failure)))

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
            [Shot()],  # as it is
            self._document.display,
            picture_file(choice.path),
            transparent=choice.transparent,
        )
        self._settings.folder = choice.path.parent

    def gallery(self) -> None:
        """Show the columns of the family on the render side by side."""
        from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog

        scene = self.scene
        assert scene is not None
        if not self._is_standing("gallery"):
            dialog = GalleryDialog(self._document, scene, self._window)
            dialog.save_requested.connect(lambda: self._save_gallery(dialog))
            self._stand("gallery", dialog, "Picture")

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
        """Ask for motion, size, rate and place, and film the render."""
        from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog

        scene, mesh = self.scene, self._document.mesh
        assert scene is not None and mesh is not None  # noqa: PT018  the command needs them
        if not self._is_standing("movie"):
            path = self._settings.folder / (mesh.name or "mesh")
            self._stand("movie", MovieDialog(self._document, scene, path, self._window), "Movie")

    def _is_standing(self, name: str) -> bool:
        """Bring a dialog forward that stands open beside the window, if it does."""
        dialog = self._standing.get(name)
        if dialog is not None:
            dialog.raise_()
            dialog.activateWindow()
        return dialog is not None

    def _stand(self, name: str, dialog: GalleryDialog | MovieDialog, what: str) -> None:
        """Open a dialog beside the window, which says what it has saved."""

        def say_saved(path: Path) -> None:
            self._settings.folder = path.parent
            self._say(f"{what} saved to {path}.")

        self._standing[name] = dialog
        dialog.saved.connect(say_saved)
        dialog.finished.connect(lambda: self._standing.pop(name, None))
        dialog.finished.connect(dialog.deleteLater)
        dialog.show()

    def save_scene(self) -> None:
        """Ask for format and place, and save the mesh with its field as a scene."""
        from meshmash_viewer.app.dialogs.scene_dialog import SceneDialog

        mesh = self._document.mesh
        assert mesh is not None
        dialog = SceneDialog(self._settings.folder / (mesh.name or "mesh"), self._window)
        ask(dialog, lambda: self._write_scene(dialog.path))

    def _write_scene(self, path: Path) -> None:
        assert self.scene is not None
        self._settings.folder = path.parent
        self._say(f"Writing {path.name} …")
        self._scenes.write(self.scene.to_pyvista(), path)

    def copy_picture(self) -> None:
        """Put the render on the clipboard."""
        assert self.scene is not None
        picture = self.scene.picture()
        height, width, _ = picture.shape
        image = QImage(picture.tobytes(), width, height, QImage.Format.Format_RGBA8888)
        QGuiApplication.clipboard().setImage(image.copy())
        self._say("Picture copied.")

    def close(self) -> None:
        """Finish the pictures that are being written, and close what stands open."""
        self.painter.wait()
        self._scenes.close()
        for dialog in list(self._standing.values()):
            dialog.done(0)  # a film that is being made is given up

    def _say_not_saved(self, failure: Failure) -> None:
        text = f"The picture was not saved: {failure.text}"
        self._document.notify(notice_of(replace(failure, text=text)))

    def _say(self, text: str) -> None:
        self._document.notify(Notice(text))


def ask(dialog: QDialog, accepted: Callable[[], None] | None = None) -> None:
    """Open a dialog, which is gone when it has been answered."""
    if accepted is not None:
        dialog.accepted.connect(accepted)
    dialog.finished.connect(dialog.deleteLater)
    dialog.open()

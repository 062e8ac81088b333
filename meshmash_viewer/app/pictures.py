"""Commands that save the render: pictures, galleries, movies and scenes."""

from __future__ import annotations

import json
import weakref
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PySide6.QtGui import QGuiApplication, QImage

from meshmash_viewer.app.background import BackgroundIO, say_saved
from meshmash_viewer.app.executor import Held
from meshmash_viewer.app.listening import later
from meshmash_viewer.app.opening import Opening, ask
from meshmash_viewer.io.atomic import remove_left_overs
from meshmash_viewer.model.notices import Notice
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.work import call_in_child

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
    from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog
    from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog
    from meshmash_viewer.app.view.child import PictureProcess
    from meshmash_viewer.app.view.figure import FigureOptions, Panel
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.mesh_view import MeshView
    from meshmash_viewer.mesh import Mesh

Result = TypeVar("Result")


class Pictures:
    """Commands that save or copy the render, with their dialogs."""

    def __init__(self, opening: Opening, background_io: BackgroundIO) -> None:
        self._opening, self._window = opening, opening.window
        self._document, self._settings = opening.document, opening.settings
        #: Name of the mesh and path of the last saved picture; meshes of the current preview.
        self._saved: tuple[str, Path] | None = None
        self._previewed: list[weakref.ref[Mesh]] = []
        #: Open modeless dialogs by command.
        self._open_dialogs: dict[str, GalleryDialog | MovieDialog] = {}
        self._background_io = background_io
        self._held = Held(background_io, self._close_dialogs)

    def save_picture(self) -> None:
        from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog

        mesh, (stored, ending) = self._document.mesh, self._settings.figure
        assert mesh is not None
        path = self._settings.folder / (mesh.name or "mesh")
        if self._saved is not None and self._saved[0] == mesh.name:
            path = self._saved[1].with_suffix("")
        dialog = FigureDialog(path, self._seen, self._window, _options(stored))
        dialog.format_combo.setCurrentIndex(max(dialog.format_combo.findData(ending), 0))
        ask(dialog, lambda: self._write_picture(dialog))
        for scene in self._scenes():
            scene.frames.stand_in_made.connect(dialog.look)
        later(dialog.look)

    def _scenes(self) -> list[MeshView]:
        """Return the renders that display a mesh."""
        return [scene for scene in self._opening.scenes if scene.mesh is not None]

    def _seen(self) -> list[Panel]:
        """Return the visible parts of the meshes; empty until large meshes have been simplified.

        `InputError` is raised if no part of a mesh is visible.
        """
        from meshmash_viewer.app.view.figure import panel_of

        panels = []
        for scene in self._scenes():
            pixels = scene.frames.mesh_alone()
            if pixels is None:
                return []
            panels.append(panel_of(scene.renderer, pixels))
        # weak references, so that a mesh closed before the next picture is freed
        self._previewed = [_reference(scene.renderer) for scene in self._scenes()]
        return panels

    def _write_picture(self, dialog: FigureDialog) -> None:
        from meshmash_viewer.app.view.figure import compose, save_figure, seen_of, sharpened

        path, options, panels = dialog.path, dialog.options, dialog.panels
        drawings, sizes = self._drawings()
        # the mesh may have been replaced since the preview
        current = self._previewed == list(map(_reference, drawings))
        mesh = self._document.mesh
        self._saved = ("" if mesh is None else mesh.name), path
        self._settings.figure = json.dumps(asdict(options)), path.suffix
        self._settings.folder = path.parent

        def save(process: PictureProcess) -> None:
            seen: Sequence[Panel] = panels if current else ()
            if not seen:
                places = zip(drawings, sizes, strict=True)
                seen = [seen_of(*each, process.draw) for each in places]
            save_figure(compose(sharpened(drawings, seen, options, process.draw), options), path)

        self._run(
            f"Drawing {path.name}",
            save,
            lambda _: say_saved(self._document, f"Picture saved to {path}.", path),
        )

    def _drawings(self) -> tuple[list[MeshRenderer], list[tuple[int, int]]]:
        """Return copies of the drawings of the renders, and the sizes of the renders in pixels."""
        scenes = self._scenes()
        return (
            [scene.renderer.twin() for scene in scenes],
            [scene.plotter.pixels()[:2] for scene in scenes],
        )

    def _run(
        self,
        doing: str,
        work: Callable[[PictureProcess], Result],
        then: Callable[[Result], object],
    ) -> None:
        """Call `work` in the background, with a message that has the button "Cancel"."""
        from meshmash_viewer.app.view.child import PictureProcess

        process = PictureProcess()
        held = Held(self._background_io, process.close)

        def call() -> Result:
            try:
                return work(process)
            finally:
                held.close()

        holds = lambda: not process.closed  # noqa: E731
        self._background_io.run(doing, call, then)
        self._document.notices.show(
            Notice(f"{doing} …", action=process.close, button="Cancel", holds=holds)
        )

    def gallery(self) -> None:
        from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog

        scene = self._opening.scene
        assert scene is not None
        if not self._raise_open("gallery"):
            dialog = GalleryDialog(self._document, scene, self._window)
            dialog.save_requested.connect(lambda: self._save_gallery(dialog))
            self._open("gallery", dialog, "Picture")

    def _save_gallery(self, gallery: GalleryDialog) -> None:
        from meshmash_viewer.app.dialogs.figure_dialog import SheetDialog

        mesh = self._document.mesh
        assert mesh is not None
        path = self._settings.folder / f"{mesh.name or 'mesh'}_gallery"
        dialog = SheetDialog(path, gallery, _options(self._settings.sheet))

        def save() -> None:
            self._settings.sheet = json.dumps(asdict(dialog.options))
            gallery.save(dialog.path, dialog.options)

        ask(dialog, save)

    def save_movie(self) -> None:
        from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog

        scene, mesh = self._opening.scene, self._document.mesh
        assert scene is not None and mesh is not None  # noqa: PT018  the command needs them
        if not self._raise_open("movie"):
            path = self._settings.folder / (mesh.name or "mesh")
            self._open("movie", MovieDialog(self._document, scene, path, self._window), "Movie")

    def _raise_open(self, name: str) -> bool:
        """Raise the dialog of a command if it is open; return whether the dialog is open."""
        dialog = self._open_dialogs.get(name)
        if dialog is not None:
            dialog.raise_()
            dialog.activateWindow()
        return dialog is not None

    def _open(self, name: str, dialog: GalleryDialog | MovieDialog, product: str) -> None:
        """Open a modeless dialog, and show a message when its `product` has been saved."""

        def take_saved(path: Path) -> None:
            self._settings.folder = path.parent
            say_saved(self._document, f"{product} saved to {path}.", path)

        self._open_dialogs[name] = dialog
        dialog.saved.connect(take_saved)
        dialog.finished.connect(lambda: self._open_dialogs.pop(name, None))
        dialog.finished.connect(dialog.deleteLater)
        dialog.show()

    def save_scene(self) -> None:
        from meshmash_viewer.app.dialogs.files import FormatDialog
        from meshmash_viewer.app.view.picture import SCENES, missing_pages

        mesh = self._document.mesh
        assert mesh is not None
        path = self._settings.folder / (mesh.name or "mesh")
        missing = {".html": missing_pages()}
        dialog = FormatDialog("scene", "Save scene", path, SCENES, self._window, missing, "trame")
        dialog.lay_out()
        ask(dialog, lambda: self._write_scene(dialog.path))

    def _write_scene(self, path: Path) -> None:
        from meshmash_viewer.app.view.picture import displayed_surface, write_scene

        drawing = self._opening.scenes[0].renderer.twin()
        self._settings.folder = path.parent

        def write(process: PictureProcess) -> None:
            def look(_: object) -> None:
                if process.closed:
                    raise Cancelled

            surface = displayed_surface(drawing)
            try:  # in a child process, because pyvista holds the GIL for seconds
                call_in_child(write_scene, surface, path, look=look)
            finally:
                remove_left_overs(path.parent)  # temporary files of a terminated process

        self._run(
            f"Writing {path.name}",
            write,
            lambda _: say_saved(self._document, f"Scene saved to {path}.", path),
        )

    def copy_picture(self) -> None:
        from meshmash_viewer.app.view.picture import straight

        drawings, sizes = self._drawings()

        def draw(process: PictureProcess) -> QImage:
            drawn = zip(drawings, sizes, strict=True)
            pictures = [straight(process.draw(*each)) for each in drawn]
            tallest = max(len(each) for each in pictures)
            level = [np.pad(each, ((0, tallest - len(each)), (0, 0), (0, 0))) for each in pictures]
            picture = np.concatenate(level, axis=1)
            height, width, _ = picture.shape
            image = QImage(picture.tobytes(), width, height, QImage.Format.Format_RGBA8888)
            return image.copy()

        def take(image: QImage) -> None:
            QGuiApplication.clipboard().setImage(image)
            text = "Picture copied." if len(drawings) == 1 else "Both pictures copied."
            self._document.notices.say(text)

        self._run("Drawing the picture", draw, take)

    def _close_dialogs(self) -> None:
        for dialog in list(self._open_dialogs.values()):
            dialog.done(0)  # cancels the recording of a movie


def _options(stored: str) -> FigureOptions:
    """Return figure options from JSON; default options if the JSON is invalid."""
    from meshmash_viewer.app.view.figure import FigureOptions

    try:
        return FigureOptions(**json.loads(stored))
    except (ValueError, TypeError):
        return FigureOptions()


def _reference(drawing: MeshRenderer) -> weakref.ref[Mesh]:
    assert drawing.mesh is not None
    return weakref.ref(drawing.mesh)

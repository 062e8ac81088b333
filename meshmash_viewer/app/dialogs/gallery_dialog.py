"""The columns of the family on the render side by side, to look through, go to and save."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QIcon, QImage, QKeyEvent, QPixmap
from PySide6.QtWidgets import (
    QDialog,
    QLabel,
    QListView,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QPushButton,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.column_range import ColumnRange
from meshmash_viewer.app.controls.facts import keep_room, reserved_note
from meshmash_viewer.app.controls.field_wheel import FieldWheel
from meshmash_viewer.app.controls.layout import column, row
from meshmash_viewer.app.listening import follow, stop_listening
from meshmash_viewer.app.series_painter import Picture, SeriesPainter
from meshmash_viewer.app.view.annotations import Caption
from meshmash_viewer.app.view.contact_sheet import ContactSheet
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.picture import straight
from meshmash_viewer.app.view.series import Shot, aspect, series_view, shots_of
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.sweep import evenly, n_columns, sweep
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.failure import Failure
from meshmash_viewer.model.field import shown_family
from meshmash_viewer.units import counted

__all__ = ["GalleryDialog"]

#: Thumbnails that are shown at first, and their width and most height in logical pixels.
_SHOWN, _WIDTH, _MOST_HEIGHT = 24, 190, 190
#: Milliseconds that a range must rest before its pictures are begun.
_REST = 250


class GalleryDialog(QDialog):
    """Thumbnails of a family's columns.

    Parameters
    ----------
    document : Document
        With a mesh and at least one eigenpair.
    scene : MeshView
        Whose camera the pictures share.

    Signals
    -------
    save_requested()
        Somebody wants it as a picture: `save` makes one.
    saved(Path)
        It is there.
    """

    save_requested = Signal()
    saved = Signal(object)

    def __init__(self, document: Document, scene: MeshView, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        theme.named(self, "gallery_dialog").setWindowTitle("Gallery")
        self.resize(1160, 740)
        self._document, self._scene, self._path = document, scene, Path()
        self._mesh = document.mesh
        self._shown: tuple[object, ...] = ()
        self._families: list[Family] = []
        scene.small_ready.connect(self._fill)
        self._thumbnails, self._sheet = SeriesPainter(self), SeriesPainter(self)
        self._thumbnails.drawn.connect(self._show_thumbnail)
        self._thumbnails.failed.connect(self._say_failed)
        self._sheet.drawn.connect(self._show_progress)
        self._sheet.finished.connect(self._say_saved)
        self._sheet.failed.connect(self._say_failed)
        self._rest = QTimer(self, singleShot=True, interval=_REST)
        self._rest.timeout.connect(self._fill)
        self._build()
        display = document.display
        for signal in (
            display.events.kind, display.events.fields, display.events.policies,
            display.events.diverging_colormap, display.events.sequential_colormap,
            display.events.nodal_lines, document.spectrum_changed, document.mesh_changed,
        ):  # fmt: skip
            follow(signal, self._refresh)
        theme.notifier().changed.connect(self._fill)
        self._refresh()

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.range = ColumnRange("gallery")
        self.range.changed.connect(self._rest.start)
        self.count_label = theme.named(QLabel(), "gallery_count_label", role="muted")
        self.list = theme.named(_Thumbnails(), "gallery_list", "Thumbnails", role="gallery")
        self.list.itemClicked.connect(self._go)
        self.list.itemActivated.connect(self._go)
        self.progress_bar = theme.named(QProgressBar(), "gallery_progress_bar", "Pictures drawn")
        self.progress_bar.setTextVisible(False)
        self.cancel_button = theme.named(
            QPushButton("Cancel", autoDefault=False), "gallery_cancel_button", "Stop saving"
        )
        self.cancel_button.clicked.connect(self._cancel)
        for widget in (self.progress_bar, self.cancel_button):
            keep_room(widget)
            widget.hide()
        self.save_button = theme.named(
            QPushButton("Save picture…", autoDefault=False), "gallery_save_button", role="primary"
        )
        self.save_button.clicked.connect(self.save_requested)
        self.close_button = theme.named(
            QPushButton("Close", autoDefault=False), "gallery_close_button"
        )
        self.close_button.clicked.connect(self.close)
        self.remark_label = reserved_note("gallery_remark_label", 1)
        self.setLayout(
            column(
                row(QLabel("Columns"), self.range, self.count_label, None),
                (self.list,),
                self.remark_label,
                row(
                    (self.progress_bar,), self.cancel_button, self.save_button, self.close_button
                ),
                margins=(16, 12, 16, 12),
            )
        )  # fmt: skip
        theme.pad_fields(self)
        FieldWheel(self).watch(self)

    def say_refusal(self, sentence: str) -> None:
        """Say why a field refuses what was typed; see `controls.spin.show_refusal`."""
        self.remark_label.setText(sentence)

    # -- which are shown ----------------------------------------------------------------------

    def _refresh(self) -> None:
        """Follow the model: another family or spectrum is another gallery."""
        document, display = self._document, self._document.display
        if document.mesh is not self._mesh or not document.spectrum:
            self.close()
            return
        family = shown_family(display)
        now = (
            family.name, family.at_rest(), document.spectrum, display.policies.get(family.name),
            display.nodal_lines, display.sequential_colormap, display.diverging_colormap,
        )  # fmt: skip
        if now != self._shown:
            same = self._shown[:1] == now[:1]
            self._shown = now
            self._set_range(n_columns(family, document.spectrum), keep=same)
            self._fill()
        self._mark()

    def _set_range(self, most: int, *, keep: bool) -> None:
        kept = keep and self.range.columns[-1] < most
        columns = self.range.columns if kept else evenly(most, _SHOWN)
        self.range.choose(columns, most)

    def _shots(self) -> list[Shot]:
        document, ready = self._document, self._document.ready
        assert ready is not None
        assert document.spectrum is not None
        sample = ready.mesh.area_sample() if ready.sample is None else ready.sample
        return shots_of(
            self._families, document.spectrum, ready.mesh, sample, document.display.fields
        )

    def _fill(self) -> None:
        """Begin anew with the thumbnails."""
        self._rest.stop()
        self._thumbnails.stop()
        document, display = self._document, self._document.display
        small = None if document.spectrum is None else self._scene.small_twin()
        if document.spectrum is None or small is None:
            return
        family = shown_family(display)
        self._families = sweep(family, document.spectrum, self.range.columns)
        drawing, picked = small
        drawing.annotated = False
        size = QSize(_WIDTH, min(round(_WIDTH / aspect(drawing)), _MOST_HEIGHT))
        remark = ""
        if self.range.most == 1:
            remark = f"{family.label} is one field; the others have columns to look through."
        try:
            shots = self._shots()
            captions = [each.request.caption for each in shots if each.request is not None]
        except InputError as fault:  # such as no energies where all eigenvalues are zero
            self._families, shots, captions, remark = [], [], [], str(fault)
        self.list.begin(captions, size)
        self.count_label.setText(f"{counted(len(shots), 'picture')} · {family.label}")
        self.remark_label.setText(remark)
        self.save_button.setEnabled(bool(shots) and not self._sheet.busy)
        ratio = self.devicePixelRatioF()
        pixels = round(size.width() * ratio), round(size.height() * ratio)
        drawing.view = series_view(drawing, pixels, self._scene.plotter.pixels()[:2])
        self._thumbnails.start(
            drawing,
            pixels,
            shots,
            replace(display),
            contextlib.nullcontext(_image),
            transparent=True,
            picked=picked,
        )
        self._mark()

    def _show_thumbnail(self, at: int, image: object) -> None:
        assert isinstance(image, QImage)
        self.list.show_picture(at, image)

    # -- going there --------------------------------------------------------------------------

    def _go(self, item: QListWidgetItem) -> None:
        """Move the display to a column; what else is chosen of the family stays."""
        chosen, display = self._families[self.list.row(item)], self._document.display
        places = {name: getattr(chosen, name) for name in chosen.position}
        display.show(replace(display.fields[chosen.name], **places))

    def _mark(self) -> None:
        """Mark the thumbnail of what is on the render, if there is one."""
        family = shown_family(self._document.display)
        here = [getattr(family, name) for name in family.position]
        for at, each in enumerate(self._families):
            if here and [getattr(each, name) for name in each.position] == here:
                self.list.setCurrentRow(at)
                return
        self.list.clearSelection()

    # -- saving -------------------------------------------------------------------------------

    @property
    def size_on_screen(self) -> tuple[int, int]:
        """Width and height of the thumbnails together, in pixels."""
        ratio = self.devicePixelRatioF()
        return round(self.list.width() * ratio), round(self.list.height() * ratio)

    def save(self, path: Path, size: tuple[int, int], transparent: bool) -> None:
        """Write a sheet of what is shown, in pictures of their own; `saved` says that it is there.

        Parameters
        ----------
        path : Path
        size : (int, int)
            Of the sheet in pixels.
        transparent : bool
            Leave the background out.
        """
        self._path, mesh = path, self._document.mesh
        if mesh is None:
            return
        drawing, shots = self._scene.renderer.twin(), self._shots()
        drawing.annotated = False
        captions = [each.request.caption for each in shots if each.request is not None]
        label = shown_family(self._document.display).label
        try:
            sheet = ContactSheet(
                captions,
                size,
                aspect(drawing),
                f"{mesh.name} · {label}" if mesh.name else label,
                dark=theme.is_dark(),
                transparent=transparent,
            )
        except InputError as fault:
            self.remark_label.setText(str(fault))
            return
        seen = self._scene.plotter.pixels()[:2]
        drawing.view = series_view(drawing, sheet.picture_size, seen)
        self.remark_label.setText("")
        self.progress_bar.setRange(0, len(shots))
        self.progress_bar.setValue(0)
        self._show_saving(True)
        display, sink = replace(self._document.display), _sheet_file(path, sheet)
        self._sheet.start(drawing, sheet.picture_size, shots, display, sink, transparent=True)

    def _show_saving(self, saving: bool) -> None:
        for widget in (self.progress_bar, self.cancel_button):
            widget.setVisible(saving)
        self.save_button.setEnabled(not saving)

    def _show_progress(self, at: int, _made: object) -> None:
        self.progress_bar.setValue(at + 1)

    def _cancel(self) -> None:
        self._sheet.stop()
        self._show_saving(False)

    def _say_saved(self) -> None:
        self._show_saving(False)
        self.saved.emit(self._path)

    def _say_failed(self, failure: Failure) -> None:
        self._show_saving(False)
        self.remark_label.setText(failure.text)

    def done(self, result: int) -> None:
        """Stop what is being drawn, and close."""
        stop_listening(self)
        theme.notifier().changed.disconnect(self._fill)
        self._rest.stop()
        for painter in (self._thumbnails, self._sheet):
            painter.close()
        self._scene.small_ready.disconnect(self._fill)
        super().done(result)


class _Thumbnails(QListWidget):
    """Pictures with their captions in as many columns as there is room for."""

    def __init__(self) -> None:
        super().__init__()
        self.setViewMode(QListView.ViewMode.IconMode)
        self.setResizeMode(QListView.ResizeMode.Adjust)
        self.setMovement(QListView.Movement.Static)
        self.setUniformItemSizes(True)
        self.setWordWrap(True)
        self.setSpacing(4)

    def begin(self, captions: list[str], size: QSize) -> None:
        """Make room for pictures that have not come yet."""
        self.clear()
        self.setIconSize(size)
        self.setGridSize(size + QSize(30, 2 * self.fontMetrics().lineSpacing() + 18))
        empty = QPixmap(size)
        empty.fill(Qt.GlobalColor.transparent)
        for caption in captions:
            item = QListWidgetItem(QIcon(empty), caption, self)
            item.setTextAlignment(Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop)
            item.setToolTip(caption)

    def show_picture(self, at: int, image: QImage) -> None:
        """Put a picture over its caption."""
        item = self.item(at)
        if item is not None:
            pixmap = QPixmap.fromImage(image)
            pixmap.setDevicePixelRatio(self.devicePixelRatioF())
            icon = QIcon(pixmap)
            icon.addPixmap(pixmap, QIcon.Mode.Selected)
            item.setIcon(icon)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Go to the thumbnail that the keys are at with Return."""
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentItem():
            self.itemActivated.emit(self.currentItem())
        else:
            super().keyPressEvent(event)


def _image(_at: int, picture: Picture, _caption: Caption | None) -> QImage:
    pixels = straight(picture)
    height, width, _ = pixels.shape
    return QImage(pixels.tobytes(), width, height, QImage.Format.Format_RGBA8888).copy()


@contextlib.contextmanager
def _sheet_file(
    path: Path, sheet: ContactSheet
) -> Iterator[Callable[[int, Picture, Caption | None], None]]:
    from meshmash_viewer.io.write import write_picture

    def put(at: int, picture: Picture, caption: Caption | None) -> None:
        assert caption is not None
        sheet.put(at, straight(picture), caption)

    yield put
    write_picture(path, sheet.pixels())

"""Dialog with pictures of the columns of the displayed family."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QIcon, QImage, QKeyEvent, QPixmap
from PySide6.QtWidgets import QLabel, QListView, QListWidget, QListWidgetItem, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.field_events import FieldWheel
from meshmash_viewer.app.controls.make import column, keep_room, reserved_note, row
from meshmash_viewer.app.dialogs.series import Picture, Run, SeriesDialog, SeriesPainter
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.figure import FigureOptions
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.page import MM
from meshmash_viewer.app.view.picture import straight
from meshmash_viewer.app.view.series import ContactSheet, aspect, series_view
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.table import evenly, n_columns, sweep
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import shown_family
from meshmash_viewer.units import counted

#: Number of thumbnails by default, and their width and largest height in logical pixels.
_SHOWN, _WIDTH, _MAX_HEIGHT = 24, 190, 190
#: Milliseconds from a change of the range to new thumbnails.
_DELAY = 250


class GalleryDialog(SeriesDialog):
    """Dialog with thumbnails of the columns of the displayed family; a click displays a column."""

    #: The user wants to save the gallery; the receiver asks for a file and calls `save`.
    save_requested = Signal()

    def __init__(self, document: Document, scene: MeshView, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        theme.named(self, "gallery_dialog").setWindowTitle("Gallery")
        self.resize(1160, 740)
        self._set_up(document, scene, "gallery")
        self._draft_painter = SeriesPainter(self)
        self._draft_painter.drawn.connect(self._show_draft)
        self._draft_painter.failed.connect(self._show_failure)
        self._delay = QTimer(self, singleShot=True, interval=_DELAY)
        self._delay.timeout.connect(self._draw_draft)
        scene.frames.stand_in_made.connect(self._draw_draft)
        self._path = Path()
        self._families: list[Family] = []
        self._build()
        events = document.display.events
        signals = (
            events.kind, events.fields, events.policies, events.diverging_colormap,
            events.sequential_colormap, events.nodal_lines, document.spectrum_changed,
            document.mesh_changed, document.pins.changed,
        )  # fmt: skip
        follow(signals, self._refresh)
        theme.notifier().changed.connect(self._draw_draft)
        self._refresh()

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.range.changed.connect(self._delay.start)
        self.count_label = make.label("gallery_count_label", role="muted")
        self.list = theme.named(_Thumbnails(), "gallery_list", "Thumbnails", role="gallery")
        self.list.itemClicked.connect(self._go)
        self.list.itemActivated.connect(self._go)
        self.cancel_button = make.button(
            "Cancel", "gallery_cancel_button", "Stop saving", self._cancel
        )
        keep_room(self.cancel_button)
        self.cancel_button.hide()
        self.save_button = make.button(
            "Save picture…", "gallery_save_button", "", self.save_requested, role="primary"
        )
        self.close_button = make.button("Close", "gallery_close_button", "", self.close)
        buttons = self.cancel_button, self.save_button, self.close_button
        for button in buttons:
            button.setAutoDefault(False)
        self.remark_label = reserved_note("gallery_remark_label", 1)
        head = row(QLabel("Columns"), self.range, self.count_label, None)
        foot = row((self.progress_bar,), *buttons)
        self.setLayout(
            column(head, (self.list,), self.remark_label, foot, margins=(16, 12, 16, 12))
        )
        theme.pad_fields(self)
        FieldWheel(self).watch(self)

    def say_refusal(self, sentence: str) -> None:
        """Show why the text of a field is invalid; see `WholeField`."""
        self.remark_label.setText(sentence)

    # -- thumbnails ---------------------------------------------------------------------------

    def _refresh(self) -> None:
        """Draw new thumbnails if the family, the spectrum or the display options have changed."""
        document, display = self._document, self._document.display
        if document.mesh is not self._mesh or not document.spectrum:
            self.close()
            return
        family = shown_family(display)
        pinned = _at_pins(family, document)
        state = (
            family.name, pinned or family.at_rest(), document.spectrum, display.kind,
            display.policies, display.nodal_lines, display.sequential_colormap,
            display.diverging_colormap, [(pin.vertex, pin.name) for pin in document.pins.placed],
        )  # fmt: skip
        if state != self._state:
            same_family = self._state[:1] == state[:1]
            self._state = state
            count = len(pinned) or n_columns(family, document.spectrum)
            self._choose_range(count, evenly(count, _SHOWN), keep=same_family and not pinned)
            self._draw_draft()
        self._mark()

    def _draw_draft(self) -> None:
        self._delay.stop()
        self._draft_painter.stop()
        document, display = self._document, self._document.display
        small = None if document.spectrum is None else self._scene.frames.small_twin()
        if document.spectrum is None or small is None:
            return
        family = shown_family(display)
        pinned, columns = _at_pins(family, document), self.range.columns
        self._families = (
            list(pinned[columns.start : columns.stop : columns.step])
            if pinned
            else sweep(family, document.spectrum, columns)
        )
        drawing, picked = small
        drawing.annotated = False
        size = QSize(_WIDTH, min(round(_WIDTH / aspect(drawing)), _MAX_HEIGHT))
        remark = ""
        if family is not display.family:
            remark = f"Pin vertices on the render: {display.family.label} has a picture for each."
        elif len(pinned) == 1:
            remark = "There is a picture for each pin: click more vertices on the render."
        elif self.range.most == 1:
            remark = f"{family.label} has a single column; other families have several columns."
        try:
            shots = self._shots_of(self._families)
            captions = [each.request.caption for each in shots if each.request is not None]
        except InputError as fault:  # for example, WKS has no energies if all eigenvalues are zero
            self._families, shots, captions, remark = [], [], [], str(fault)
        self.list.begin(captions, size)
        self.count_label.setText(f"{counted(len(shots), 'picture')} · {family.label}")
        self.remark_label.setText(remark)
        self.save_button.setEnabled(bool(shots) and not self._painter.busy)
        ratio = self.devicePixelRatioF()
        pixels = round(size.width() * ratio), round(size.height() * ratio)
        drawing.view = series_view(drawing, pixels, self._pixels_on_screen)
        sink = contextlib.nullcontext(_image)
        self._draft_painter.start(Run(drawing, pixels, shots, replace(display), sink, True, picked))
        self._mark()

    def _show_draft(self, at: int, made: object) -> None:
        assert isinstance(made, QImage)
        self.list.show_picture(at, made)

    # -- choosing a column --------------------------------------------------------------------

    def _go(self, item: QListWidgetItem) -> None:
        """Display the column of a thumbnail."""
        chosen, display = self._families[self.list.row(item)], self._document.display
        places = {name: getattr(chosen, name) for name in _place_of(chosen)}
        display.show(replace(display.fields[chosen.name], **places))

    def _mark(self) -> None:
        """Select the thumbnail of the displayed column, if there is one."""
        family = shown_family(self._document.display)
        here = [getattr(family, name) for name in _place_of(family)]
        for at, each in enumerate(self._families):
            if here and [getattr(each, name) for name in _place_of(each)] == here:
                self.list.setCurrentRow(at)
                return
        self.list.clearSelection()

    # -- saving -------------------------------------------------------------------------------

    def save(self, path: Path, options: FigureOptions) -> None:
        """Draw the columns on a sheet, write the sheet to a file, then emit `saved`.

        Width, resolution and background are taken from `options`; the sheet has the aspect ratio
        of the list of thumbnails.
        """
        wide = options.width_mm / MM * options.dpi
        size = round(wide), round(wide * self.list.height() / self.list.width())
        self._path, mesh = path, self._document.mesh
        if mesh is None:
            return
        drawing, shots = self._scene.renderer.twin(), self._shots_of(self._families)
        drawing.annotated = False
        captions = [each.request.caption for each in shots if each.request is not None]
        label = shown_family(self._document.display).label
        try:
            sheet = ContactSheet(
                captions,
                size,
                aspect(drawing),
                f"{mesh.name} · {label}" if mesh.name else label,
                dark=theme.is_dark() and options.background == "window",
                ground={"white": "#ffffff", "transparent": ""}.get(options.background),
            )
        except InputError as fault:
            self.remark_label.setText(str(fault))
            return
        drawing.view = series_view(drawing, sheet.picture_size, self._pixels_on_screen)
        sink = _sheet_file(path, sheet, options.dpi)
        self._save_series(drawing, sheet.picture_size, shots, sink, transparent=True)

    def _show_saving(self, saving: bool) -> None:
        for widget in (self.progress_bar, self.cancel_button):
            widget.setVisible(saving)
        self.save_button.setEnabled(not saving)

    def _cancel(self) -> None:
        self._painter.cancel()
        self._show_saving(False)

    def _finish(self) -> None:
        self._show_saving(False)
        self.saved.emit(self._path)

    def done(self, result: int) -> None:
        theme.notifier().changed.disconnect(self._draw_draft)
        self._scene.frames.stand_in_made.disconnect(self._draw_draft)
        self._delay.stop()
        super().done(result)


def _place_of(family: Family) -> tuple[str, ...]:
    """Return the names of the parameters in which thumbnails of a family differ."""
    return (*family.position, *(("vertex",) if family.required == "vertex" else ()))


def _at_pins(family: Family, document: Document) -> tuple[Family, ...]:
    """Return the family at each pin if the family has one column per vertex, otherwise ()."""
    assert document.spectrum is not None
    if family.required != "vertex" or n_columns(family, document.spectrum) > 1:
        return ()
    one: Any = family
    return tuple(replace(one, vertex=pin.vertex) for pin in document.pins.placed)


class _Thumbnails(QListWidget):
    """List of pictures with captions, in as many columns as fit."""

    def __init__(self) -> None:
        super().__init__()
        self.setViewMode(QListView.ViewMode.IconMode)
        self.setResizeMode(QListView.ResizeMode.Adjust)
        self.setMovement(QListView.Movement.Static)
        self.setUniformItemSizes(True)
        self.setWordWrap(True)
        self.setSpacing(4)

    def begin(self, captions: list[str], size: QSize) -> None:
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
        item = self.item(at)
        if item is not None:
            pixmap = QPixmap.fromImage(image)
            pixmap.setDevicePixelRatio(self.devicePixelRatioF())
            item.setIcon(make.untinted(pixmap))

    def keyPressEvent(self, event: QKeyEvent) -> None:
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
    path: Path, sheet: ContactSheet, dpi: int
) -> Iterator[Callable[[int, Picture, Caption | None], None]]:
    from meshmash_viewer.io.write import write_picture

    def put(at: int, picture: Picture, caption: Caption | None) -> None:
        assert caption is not None
        sheet.put(at, straight(picture), caption)

    yield put
    write_picture(path, sheet.pixels(), dpi)

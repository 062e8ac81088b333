"""Dialogs that ask for a file: base classes of those that save one, and functions."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from PySide6.QtCore import QMimeDatabase, Qt, Signal
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QLayout,
    QLineEdit,
    QPushButton,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.field_events import FieldWheel
from meshmash_viewer.app.controls.make import Part, column, form, reserved_note, row
from meshmash_viewer.app.controls.number_field import typed_fields
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.links import folder_of
from meshmash_viewer.io.maps import MAP_ENDINGS
from meshmash_viewer.io.read import READERS
from meshmash_viewer.io.write import check_output
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import failure_of


class SaveDialog(QDialog):
    """Asks for a file among other things; it stays open while the file cannot be written.

    Subclasses lay out their widgets by `_arrange`. `kind` is what is written, as
    in `check_output`, and the prefix of the names of the widgets; `accept` is text and name of the
    button that writes.
    """

    def __init__(
        self,
        kind: str,
        title: str,
        file_row: FileRow,
        parent: QWidget | None,
        accept: tuple[str, str] = ("Save", ""),
    ) -> None:
        super().__init__(parent)
        theme.named(self, f"{kind}_dialog").setWindowTitle(title)
        self.file_row = file_row
        self.remark_label = reserved_note(f"{kind}_remark_label", 2)
        text, name = accept
        name = name or f"{kind}_save_button"
        self.accept_button = theme.named(QPushButton(text), name, role="primary")
        self._output = kind
        self._refused = False

    @property
    def path(self) -> Path:
        return self.file_row.path

    def _arrange(
        self,
        *rows: tuple[str, QWidget | QLayout],
        below: Sequence[QWidget] = (),
        left: QLayout | None = None,
        width: int = 560,
    ) -> None:
        """Lay out labelled rows, the file, and the buttons, next to something else.

        Between file and buttons is the remark, or what is `below`, with the remark.
        """
        about = (("", each) for each in below or (self.remark_label,))
        self._form = form(*rows, ("File", self.file_row), *about)
        parts: Part = self._form
        if left is not None:
            parts = (row((left,), column(self._form, None), spacing=20),)
        self.accept_button.setDefault(True)
        self.accept_button.pressed.connect(self._note_refusal)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.addButton(self.accept_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        self.setLayout(column(parts, buttons, spacing=theme.MARGIN, margins=(20, 16, 20, 16)))
        self.setMinimumWidth(width)
        self.file_row.changed.connect(self._refresh_remark)
        theme.pad_fields(self)
        FieldWheel(self).watch(self)
        self._refresh_remark()

    def say_refusal(self, sentence: str) -> None:
        """Show why a field refuses what was typed; see `number_field.show_refusal`."""
        self._refresh_remark()
        if sentence:
            self.remark_label.setText(sentence)

    def _note_refusal(self) -> None:
        """Note whether pressing the button committed a value that a field has refused."""
        self._refused = any(each.just_refused for each in typed_fields(self))

    def _refresh_remark(self) -> None:
        self.accept_button.setEnabled(self.file_row.named)
        self.remark_label.setText(self.file_row.remark)

    def _accept(self) -> None:
        if self._refused:  # the field shows another value now, which the user has not seen yet
            return
        fault = self.file_row.fault(self._output)
        if fault:
            self.remark_label.setText(fault)
        else:
            self._save()

    def _save(self) -> None:
        self.accept()


class FormatDialog(SaveDialog):
    """Asks for a format as well; typing a file name with another ending chooses that format.

    `formats` are names by ending; the suggested `path` has none. `missing` says of endings why such
    files cannot be written, empty if they can; `needs` is the missing library.
    """

    def __init__(
        self,
        kind: str,
        title: str,
        path: Path,
        formats: Mapping[str, str],
        parent: QWidget | None,
        missing: Mapping[str, str] | None = None,
        needs: str = "",
    ) -> None:
        self._formats = formats
        self._missing = dict.fromkeys(formats, "") | dict(missing or {})
        first = next(ending for ending in formats if not self._missing[ending])
        suggested = path.with_name(path.name + first)
        super().__init__(kind, title, FileRow(suggested, self._pattern(first), first), parent)
        self.format_combo = theme.named(QComboBox(), f"{kind}_format_combo", "Format")
        model = self.format_combo.model()
        assert isinstance(model, QStandardItemModel)
        for at, (ending, name) in enumerate(formats.items()):
            fault = self._missing[ending]
            self.format_combo.addItem(f"{name} – needs {needs}" if fault else name, ending)
            self.format_combo.setItemData(at, fault, Qt.ItemDataRole.ToolTipRole)
            model.item(at).setEnabled(not fault)
        self.format_combo.setCurrentIndex(self.format_combo.findData(first))
        self.format_combo.currentIndexChanged.connect(self._change_format)
        self.file_row.edit.textChanged.connect(self._follow_name)

    def lay_out(self) -> None:
        """Lay out the format and the file alone, for a dialog without other choices."""
        self._arrange(("Format", self.format_combo))

    @property
    def ending(self) -> str:
        return str(self.format_combo.currentData())

    def _pattern(self, ending: str) -> str:
        return f"{self._formats[ending].partition(',')[0]} (*{ending})"

    def _change_format(self) -> None:
        self.file_row.set_ending(self.ending, self._pattern(self.ending))

    def _follow_name(self) -> None:
        ending = Path(self.file_row.edit.text().strip()).suffix.lower()
        if self._missing.get(ending) == "":
            self.format_combo.setCurrentIndex(self.format_combo.findData(ending))

    def _refresh_remark(self) -> None:
        super()._refresh_remark()
        here = self._missing.get(self.path.suffix.lower(), "")
        anywhere = " ".join(filter(None, self._missing.values()))
        self.remark_label.setText(here or self.remark_label.text() or anywhere)
        self.accept_button.setEnabled(self.accept_button.isEnabled() and not here)


def ask_for_maps(parent: QWidget, folder: Path, what: str = "maps") -> list[Path]:
    """Ask for files with values per vertex; an empty list if the dialog is cancelled."""
    patterns = " ".join(
        [*(f"*{ending}" for ending in MAP_ENDINGS), "*.npz", "*.gii", "lh.*", "rh.*"]
    )
    meshes = " ".join(f"*{ending}" for ending in READERS)
    chosen, _ = QFileDialog.getOpenFileNames(
        parent,
        f"Open {what}",
        str(folder),
        f"Values per vertex ({patterns});;Meshes with such values ({meshes});;All files (*)",
    )
    return [Path(name) for name in chosen]


def ask_to_save(
    parent: QWidget, document: Document, what: str, name: str, kind: str, endings: Iterable[str]
) -> Path | None:
    """Ask for a file next to the open mesh, named after it; None if the dialog is cancelled."""
    pattern = f"{kind} ({' '.join(f'*{ending}' for ending in endings)})"
    suggested = str(suggested_path(document, name))
    path, _ = QFileDialog.getSaveFileName(parent, f"Export {what}", suggested, pattern)
    return Path(path) if path else None


def suggested_path(document: Document, name: str, folder: Path | None = None) -> Path:
    """Return a file that is named after the open mesh, next to it if no folder is given."""
    mesh = document.mesh.name if document.mesh is not None else ""
    return (folder or folder_of(document.path)) / f"{mesh or 'mesh'}_{name}"


class FileRow(QWidget):
    """Where a file with an `ending` is written; `pattern` is one of Qt: "PNG picture (*.png)"."""

    changed = Signal()

    def __init__(self, path: Path, pattern: str, ending: str) -> None:
        super().__init__()
        self._pattern = pattern
        self._ending = ending
        self.edit = theme.named(QLineEdit(str(path)), "file_edit", "File")
        self.edit.setMinimumWidth(260)
        self.edit.textChanged.connect(self.changed)
        browse = QPushButton("Browse…", autoDefault=False)
        self.browse_button = theme.named(browse, "browse_button", "Choose the file")
        self.browse_button.clicked.connect(self._browse)
        self.setLayout(row((self.edit,), self.browse_button))

    @property
    def named(self) -> bool:
        """Whether there is a name to write to: a folder alone, or nothing, is none."""
        text = self.edit.text().strip()
        return bool(Path(text).name) and not text.endswith(("/", os.sep))

    @property
    def path(self) -> Path:
        # unlike Path.expanduser it takes "~r" on the way to "~root" as it is
        path = Path(os.path.expanduser(self.edit.text().strip()))
        # "bun.jpg" means what it says, though it cannot be had; "t=0.5" has no ending yet
        ended = path.name.lower().endswith(self._ending)
        if self.named and not ended and not QMimeDatabase().suffixForFileName(path.name):
            path = path.parent / (path.name + self._ending)
        return path

    @property
    def remark(self) -> str:
        """What writing there would replace; empty if nothing."""
        there = os.path.isfile(self.path)  # unlike Path.is_file of a name that is too long, too
        return f"{self.path.name} exists and will be replaced." if there else ""

    def fault(self, kind: str) -> str:
        """Why nothing of a kind (`check_output`) can be written there; empty if it can."""
        try:
            check_output(self.path, kind)
        except (InputError, OSError) as fault:
            return failure_of(fault).text
        return ""

    def set_ending(self, ending: str, pattern: str) -> None:
        path, before, typed = self.path, self._ending, self.edit.text().strip().lower()
        self._ending, self._pattern = ending, pattern
        if self.named and not typed.endswith(ending):
            stem = path.name.removesuffix(before)
            self.edit.setText(str(path.parent / (stem + ending)))

    def _browse(self) -> None:
        here, quietly = str(self.path), QFileDialog.Option.DontConfirmOverwrite
        chosen, _ = QFileDialog.getSaveFileName(
            self, "Save as", here, self._pattern, options=quietly
        )
        if chosen:
            self.edit.setText(chosen)

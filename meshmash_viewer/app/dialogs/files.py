"""Base classes of dialogs that save a file, and functions that ask for files."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
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
from meshmash_viewer.app.controls.field_events import FieldWheel, settle_typing
from meshmash_viewer.app.controls.make import Part, column, form, reserved_note, row
from meshmash_viewer.app.controls.number_field import has_refused
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.io.links import folder_of
from meshmash_viewer.io.maps import MAP_ENDINGS
from meshmash_viewer.io.read import READERS
from meshmash_viewer.io.write import check_output
from meshmash_viewer.io.write_labels import write_labels
from meshmash_viewer.io.writers import LABEL_WRITERS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import failure_of


class SaveDialog(QDialog):
    """Base class of dialogs that ask for a file, and stay open if the file cannot be written.

    Subclasses call `_arrange` with their widgets. `kind` is the kind of output for `check_output`,
    and the object names of the widgets begin with it. `accept` is text and object name of the
    button that saves.
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
        """Lay out rows with labels, the file, and the buttons, to the right of `left`.

        The widgets `below`, by default the remark, are between the file and the buttons.
        """
        about = (("", each) for each in below or (self.remark_label,))
        self._form = form(*rows, ("File", self.file_row), *about)
        parts: Part = self._form
        if left is not None:
            parts = (row((left,), column(self._form, None), spacing=20),)
        self.accept_button.pressed.connect(self._note_refusal)
        buttons = button_box(self, self.accept_button, self._accept)
        self.setLayout(column(parts, buttons, spacing=theme.MARGIN, margins=(20, 16, 20, 16)))
        self.setMinimumWidth(width)
        self.file_row.changed.connect(self._refresh_remark)
        theme.pad_fields(self)
        FieldWheel(self).watch(self)
        self._refresh_remark()

    def say_refusal(self, sentence: str) -> None:
        """Show why the text of a field is invalid; see `WholeField`."""
        self._refresh_remark()
        if sentence:
            self.remark_label.setText(sentence)

    def _note_refusal(self) -> None:
        """Record whether pressing the button made a field reject its text."""
        settle_typing()  # on macOS, a button that is clicked does not take the focus
        self._refused = has_refused(self)

    def _fault(self) -> str:
        """Return why the choices are invalid, or ""."""
        return ""

    def _remark(self) -> str:
        """Return a sentence about valid choices, or ""."""
        return self.file_row.remark

    def _refresh_remark(self) -> None:
        fault = self._fault()
        self.accept_button.setEnabled(self.file_row.named and not fault)
        self.remark_label.setText(fault or self._remark())

    def _accept(self) -> None:
        if self._refused:  # the field has restored a value that the user has not seen yet
            return
        if fault := self.file_row.fault(self._output):
            self.remark_label.setText(fault)
        else:
            self._save()

    def _save(self) -> None:
        self.accept()


class FormatDialog(SaveDialog):
    """Dialog for a format and a file; the ending of a typed file name chooses the format.

    `formats` maps endings to names; the suggested `path` has no ending. `missing` maps endings to
    the reason why the format cannot be written, or ""; `needs` is the missing library.
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
        """Lay out format and file, for a dialog without other choices."""
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

    def _fault(self) -> str:
        return self._missing.get(self.path.suffix.lower(), "")

    def _remark(self) -> str:
        return super()._remark() or " ".join(filter(None, self._missing.values()))


def ask_for_maps(parent: QWidget, folder: Path, what: str = "maps") -> list[Path]:
    """Ask for files with values per vertex; return an empty list if cancelled."""
    patterns = " ".join(
        [*(f"*{ending}" for ending in MAP_ENDINGS), "*.npz", "*.gii", "*.gii.gz", "lh.*", "rh.*"]
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
    """Ask for a file, by default next to the open mesh; return None if cancelled."""
    pattern = f"{kind} ({' '.join(f'*{ending}' for ending in endings)})"
    suggested = str(suggested_path(document, name))
    path, _ = QFileDialog.getSaveFileName(parent, f"Export {what}", suggested, pattern)
    return Path(path) if path else None


def save_labels(
    parent: QWidget,
    document: Document,
    write: Callable[..., object],
    chosen: Collection[int] = (),
) -> None:
    """Ask for a file, then call `write` to write the current label set, as `Commands.write`.

    `chosen` contains the numbers of the chosen labels; a file for a single label gets this label.
    """
    known, mesh = document.labels.current, document.mesh
    if known is not None and mesh is not None:
        name = f"{known.name}.label.gii"
        path = ask_to_save(parent, document, "labels", name, "Labels", LABEL_WRITERS)
        if path is not None:
            labels = tuple(each for each in known.labels if each.key in chosen)
            if path.name.endswith(".label") and len(labels) == 1:
                known = replace(known, labels=labels)
            write(path, partial(write_labels, path, known, mesh), "Labels")


def suggested_path(document: Document, name: str, folder: Path | None = None) -> Path:
    """Return a path with the name of the open mesh, by default in the folder of the mesh."""
    mesh = document.mesh.name if document.mesh is not None else ""
    return (folder or folder_of(document.path)) / f"{mesh or 'mesh'}_{name}"


def configured(document: Document, kind: type[Family]) -> Family:
    """Return a family with its parameters in the window; distances are from the pins."""
    chosen = document.display.fields.get(kind.name) or kind()
    return chosen.measured_from([pin.vertex for pin in document.pins.placed])


def button_box(dialog: QDialog, accept: QPushButton, act: Callable[[], None]) -> QDialogButtonBox:
    """Make a row of buttons: `accept`, which Return presses and which calls `act`, and Cancel."""
    accept.setDefault(True)
    box = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
    box.addButton(accept, QDialogButtonBox.ButtonRole.AcceptRole)
    box.accepted.connect(act)
    box.rejected.connect(dialog.reject)
    return box


class FileRow(QWidget):
    """Field for the path of a file to write, and a button that opens Qt's file dialog.

    `ending` is appended to a name without an ending; `pattern` is the filter of Qt's file dialog,
    such as "PNG picture (*.png)".
    """

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
        """Whether the text names a file, not only a folder."""
        text = self.edit.text().strip()
        return bool(Path(text).name) and not text.endswith(("/", os.sep))

    @property
    def path(self) -> Path:
        # Path.expanduser raises an error for the unknown user "~r", typed before "~root"
        path = Path(os.path.expanduser(self.edit.text().strip()))
        # the ending of "bun.jpg" is kept, although no format has it; "t=0.5" has no ending
        ended = path.name.lower().endswith(self._ending)
        if self.named and not ended and not QMimeDatabase().suffixForFileName(path.name):
            path = path.parent / (path.name + self._ending)
        return path

    @property
    def remark(self) -> str:
        """A sentence if the file exists, otherwise ""."""
        exists = os.path.isfile(self.path)  # Path.is_file raises an error if the name is too long
        return f"{self.path.name} exists and will be replaced." if exists else ""

    def fault(self, kind: str) -> str:
        """Return why output of a kind (see `check_output`) cannot be written to the file, or ""."""
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
        options = QFileDialog.Option.DontConfirmOverwrite
        chosen, _ = QFileDialog.getSaveFileName(
            self, "Save as", str(self.path), self._pattern, options=options
        )
        if chosen:
            self.edit.setText(chosen)

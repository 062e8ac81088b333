"""What the dialogs that end with a file have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QComboBox, QDialog, QDialogButtonBox, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.field_wheel import FieldWheel
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import Part, column
from meshmash_viewer.app.controls.spin import typed_fields

__all__ = ["FormatDialog", "SaveDialog"]


class SaveDialog(QDialog):
    """Asks for a file among other things; it stays open while that cannot be written.

    Subclasses make `accept_button`, and put all they ask for in `_arrange`.

    Parameters
    ----------
    kind : str
        What is written, as `check_output` takes it; its widgets are called after it.
    title : str
    file_row : FileRow
    """

    accept_button: QPushButton

    def __init__(self, kind: str, title: str, file_row: FileRow, parent: QWidget | None) -> None:
        super().__init__(parent)
        theme.named(self, f"{kind}_dialog").setWindowTitle(title)
        self.file_row = file_row
        self.remark_label = reserved_note(f"{kind}_remark_label", 2)
        self._output = kind
        self._refused = False

    @property
    def path(self) -> Path:
        """Where to write."""
        return self.file_row.path

    def _arrange(self, *parts: Part, spacing: int = theme.MARGIN) -> None:
        """Put parts over the two buttons."""
        self.accept_button.setDefault(True)
        self.accept_button.pressed.connect(self._note_refusal)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.addButton(self.accept_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        self.setLayout(column(*parts, buttons, spacing=spacing, margins=(20, 16, 20, 16)))
        self.file_row.changed.connect(self._refresh_remark)
        theme.pad_fields(self)
        FieldWheel(self).watch(self)

    def say_refusal(self, sentence: str) -> None:
        """Say why a field refuses what was typed; see `controls.spin.show_refusal`."""
        self._refresh_remark()
        if sentence:
            self.remark_label.setText(sentence)

    def _note_refusal(self) -> None:
        """Note whether the press of the button has ended the typing of what is refused."""
        self._refused = any(each.just_refused for each in typed_fields(self))

    def _refresh_remark(self) -> None:
        self.accept_button.setEnabled(self.file_row.named)
        self.remark_label.setText(self.file_row.remark)

    def _accept(self) -> None:
        if self._refused:  # it is said, and what is there instead has not been seen yet
            return
        fault = self.file_row.fault(self._output)
        if fault:
            self.remark_label.setText(fault)
        else:
            self.accept()


class FormatDialog(SaveDialog):
    """One that asks for a format, too; the ending of a name that is typed chooses it as well.

    Parameters
    ----------
    kind, title
        As of `SaveDialog`.
    path : Path
        Suggested file, without its ending.
    formats : mapping of str to str
        Names by ending.
    missing : callable
        Why no file with an ending can be written here; empty if it can.
    needs : str
        What such a format lacks, in a word.
    """

    def __init__(
        self,
        kind: str,
        title: str,
        path: Path,
        formats: Mapping[str, str],
        missing: Callable[[str], str],
        needs: str,
        parent: QWidget | None,
    ) -> None:
        self._formats = formats
        self._missing = {ending: missing(ending) for ending in formats}
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

    @property
    def ending(self) -> str:
        """Of the format."""
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

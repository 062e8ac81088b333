"""Notices of saved files, with a button that shows their folder."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices

from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity

SHOW_IN_FOLDER = "Show in folder"


def say_saved(
    document: Document, text: str, path: Path, severity: Severity = Severity.INFORMATION
) -> None:
    """Show that a file has been saved, with a button that shows its folder."""
    document.notices.show(saved_notice(document, text, path, severity))


def saved_notice(
    document: Document, text: str, path: Path, severity: Severity = Severity.INFORMATION
) -> Notice:
    """Return the notice of `say_saved`."""

    def show_folder() -> None:
        folder = path.absolute().parent
        if not QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder))):
            text = f"This system has no program that shows folders: the folder is {folder}."
            document.notices.say(text, Severity.WARNING)

    return Notice(text, severity, action=show_folder, button=SHOW_IN_FOLDER)

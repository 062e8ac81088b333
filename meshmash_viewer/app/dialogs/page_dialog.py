"""Dialog with a page of the documentation, which comes with the program."""

from __future__ import annotations

import re

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QTextBrowser, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.folders import page_file

#: What Qt does not show: formulas in LaTeX, and pictures.
_LEFT_OUT = re.compile(r"^```math\n.*?^```\n|^!\[.*?\]\(.*?\)\n", re.DOTALL | re.MULTILINE)


class PageDialog(QDialog):
    """A page of the algorithms; links to other pages of that folder are followed.

    Parameters
    ----------
    name : str
        Of the file, without its ending.
    formula : str
        What is shown below the title.
    """

    def __init__(self, name: str, formula: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("page_dialog")
        self.resize(720, 640)
        self.browser = theme.named(QTextBrowser(openLinks=False), "page_text", "Page")
        self.browser.anchorClicked.connect(self._follow)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        self.setLayout(column((self.browser,), buttons, margins=(16, 16, 16, 12)))
        self._show_page(name, formula)

    def _show_page(self, name: str, formula: str = "") -> None:
        path = page_file(name)
        if path is None:
            text = "# Page not found\n\nThe pages were not installed with the program."
        else:
            text = _LEFT_OUT.sub("", path.read_text(encoding="utf-8"))
        title, _, rest = text.partition("\n")
        self.setWindowTitle(title.lstrip("# "))
        self.browser.setMarkdown("\n\n".join((title, formula, rest)))

    def _follow(self, link: QUrl) -> None:
        name = link.path().removesuffix(".md")
        if link.scheme():
            QDesktopServices.openUrl(link)
        elif page_file(name) is not None:
            self._show_page(name)

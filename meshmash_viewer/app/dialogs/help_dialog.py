"""Help with all commands, keys and mouse gestures, a page of the documentation, and "about"."""

from __future__ import annotations

import re

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRect, QSize, Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QHeaderView,
    QLineEdit,
    QMessageBox,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTextBrowser,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS, MENUS, MOUSE_HELP, native_keys, native_text
from meshmash_viewer.app.controls import icons
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.folders import page_file
from meshmash_viewer.model.notices import versions

#: Column of what commands do, and the pixels at its sides that are not for text.
_TEXT, _SIDES = 2, 20

_WHAT = (
    "Laplacian eigenfunctions, heat kernel signatures and spectral bands of triangle meshes, live "
    "and certified. MIT licence."
)
_METHODS = (
    "Robust Laplacian: Sharp & Crane 2020. Manifold harmonics: Vallet & Lévy 2008. "
    "Spectrum slices certified by inertia: Grimes, Lewis & Simon 1994. "
    "Heat kernel signature: Sun, Ovsjanikov & Guibas 2009. "
    "Wave kernel signature: Aubry, Schlickewei & Cremers 2011. "
    "Spline bands: Litman & Bronstein 2014."
)


class HelpDialog(QDialog):
    """A searchable list of commands and gestures."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("help_dialog")
        self.setWindowTitle("Help and shortcuts")
        self.resize(860, 660)

        hint = "Find a command, a key or a gesture"
        self.search = QLineEdit(clearButtonEnabled=True, placeholderText=hint)
        theme.named(self.search, "help_search", "Find a command")
        self.search.textChanged.connect(self._filter)

        self.tree = QTreeWidget()
        theme.named(self.tree, "help_table", "Commands")
        self.tree.setRootIsDecorated(False)
        self.tree.setIndentation(12)
        self.tree.setWordWrap(True)
        self.tree.setHeaderLabels(["Command", "Keys", "What it does"])
        self._groups: list[tuple[QTreeWidgetItem, list[QTreeWidgetItem]]] = []
        for menu in MENUS:
            mine = (each for each in COMMANDS if each.menu == menu)
            rows = [
                (each.text.rstrip("…"), native_keys(*each.sequences()), each.tooltip)
                for each in mine
            ]
            self._add_group(menu, rows)
        gestures = [(native_text(gesture), "", what) for gesture, what in MOUSE_HELP]
        self._add_group("Mouse over the render", gestures)
        self.tree.expandAll()
        header = self.tree.header()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(_TEXT, QHeaderView.ResizeMode.Stretch)
        header.sectionResized.connect(self.tree.scheduleDelayedItemsLayout)
        self.tree.setItemDelegateForColumn(_TEXT, _Wrapped(self.tree))

        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        parts = self.search, (self.tree,), buttons
        self.setLayout(column(*parts, margins=(16, 16, 16, 12)))

    def _add_group(self, name: str, rows: list[tuple[str, str, str]]) -> None:
        group = QTreeWidgetItem(self.tree, [name])
        font = group.font(0)
        font.setBold(True)
        group.setFont(0, font)
        group.setFirstColumnSpanned(True)
        group.setFlags(Qt.ItemFlag.ItemIsEnabled)
        items = [QTreeWidgetItem(group, list(row)) for row in rows]
        self._groups.append((group, items))

    def _filter(self, text: str) -> None:
        wanted = text.casefold()
        for group, items in self._groups:
            for item in items:
                texts = (item.text(column).casefold() for column in range(3))
                item.setHidden(not any(wanted in text for text in texts))
            group.setHidden(all(item.isHidden() for item in items))


class _Wrapped(QStyledItemDelegate):
    """Makes rows as tall as the text needs in the width of its column, which Qt leaves out."""

    def sizeHint(
        self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> QSize:
        """Size of the wrapped text."""
        hint, view = super().sizeHint(option, index), self.parent()
        assert isinstance(view, QTreeWidget)
        metrics, text = view.fontMetrics(), str(index.data() or "")
        room = QRect(0, 0, view.columnWidth(index.column()) - _SIDES, 1000)
        wrapped = metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, text).height()
        return QSize(hint.width(), hint.height() + max(wrapped - metrics.height(), 0))


class AboutDialog(QMessageBox):
    """Version, licence and methods, with the versions of libraries for bug reports."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("about_dialog")
        self.setWindowTitle("About MeshMash Viewer")
        self.setIconPixmap(icons.application_icon().pixmap(64, 64))
        self.setText("<big><b>MeshMash Viewer</b></big>")
        self.setInformativeText("\n\n".join((_WHAT, _METHODS, versions())))
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.addButton(self.StandardButton.Close)


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

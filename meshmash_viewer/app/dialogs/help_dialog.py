"""Dialogs of the Help menu, and the palette that searches commands and settings."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import (
    QEvent,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QPoint,
    QRect,
    QSize,
    Qt,
    QTimer,
    QUrl,
)
from PySide6.QtGui import QColor, QDesktopServices, QKeyEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDockWidget,
    QHeaderView,
    QLabel,
    QLineEdit,
    QMainWindow,
    QMessageBox,
    QStyledItemDelegate,
    QTextBrowser,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import (
    COMMANDS,
    MENUS,
    MOUSE_HELP,
    Actions,
    native_keys,
    native_text,
)
from meshmash_viewer.app.controls.field_events import bring_into_view
from meshmash_viewer.app.controls.make import column
from meshmash_viewer.io.atomic import page_file
from meshmash_viewer.model.notices import versions

#: Column with the description of commands, and the width of its margins in pixels.
_TEXT, _SIDES = 2, 12

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
    """Dialog with a searchable list of commands and gestures."""

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
            rows = [
                (each.text.rstrip("…"), native_keys(*each.sequences()), each.tooltip)
                for each in COMMANDS
                if each.menu == menu
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
    """Delegate that computes row heights for the width of the column, which Qt's trees ignore."""

    def sizeHint(self, option: Any, index: QModelIndex | QPersistentModelIndex) -> QSize:
        view: Any = self.parent()
        option.rect = QRect(0, 0, view.columnWidth(index.column()) - _SIDES, 1000)
        return super().sizeHint(option, index)


class AboutDialog(QMessageBox):
    """Dialog with licence, methods, and the versions of libraries for bug reports."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("about_dialog")
        self.setWindowTitle("About MeshMash Viewer")
        self.setIconPixmap(theme.application_icon().pixmap(64, 64))
        self.setText("<big><b>MeshMash Viewer</b></big>")
        self.setInformativeText("\n\n".join((_WHAT, _METHODS, versions())))
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.addButton(self.StandardButton.Close)


#: Parts of pages that Qt cannot show: formulas in LaTeX, and pictures.
_LEFT_OUT = re.compile(r"^```math\n.*?^```\n|^!\[.*?\]\(.*?\)\n", re.DOTALL | re.MULTILINE)


class PageDialog(QDialog):
    """Dialog with a page on an algorithm, which opens linked pages.

    `name` is the file name without its ending; `formula` is shown below the title.
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


#: Search words for commands, by the name of the command.
SYNONYMS = {
    "open_mesh": "load import file",
    "open_sample": "example demo",
    "compare_with": "second mesh side by side",
    "add_map": "overlay values scalars load",
    "open_points": "synapses table csv parquet spines load",
    "export": "save write csv table features download",
    "save_picture": "image screenshot figure png pdf svg photo paper journal",
    "gallery": "overview contact sheet thumbnails montage views",
    "show_map": "smooth smoothing filtered thickness overlay residual",
    "show_filter": "smooth smoothing gaussian low-pass high-pass band-pass",
    "save_movie": "video animation film gif mp4",
    "save_scene": "gltf html web blender",
    "copy_picture": "image clipboard screenshot",
    "copy_script": "python code reproduce",
    "quit": "exit close",
    "undo": "revert back",
    "redo": "again repeat",
    "compute_selection": "mask part region submesh medial wall",
    "compute": "solve decompose run start eigenfunctions spectrum",
    "compute_in_pieces": "large stitch split",
    "cancel": "stop abort interrupt",
    "clear_cache": "delete free disk storage",
    "reset_camera": "home fit center centre view all",
    **{
        f"view_{name}": f"camera side {words}"
        for name, words in {
            "lateral": "outside right hemisphere",
            "medial": "inside left hemisphere",
            "anterior": "front frontal",
            "posterior": "back behind occipital",
            "dorsal": "top above superior",
            "ventral": "bottom below inferior",
        }.items()
    },
    "hide_small": "debris fragments islands components clean",
    "nodal_lines": "contours isolines zero level",
    "cut": "slice section clip clipping plane inside",
    "flip_cut": "cut slice section clip invert flip",
    **{f"cut_{axis}": "cut slice section clip sagittal coronal axial plane" for axis in "xyz"},
    "reset_cut": "cut slice section clip reset plane",
    "label_borders": "boundaries outlines contours parcels regions",
    "label_graph": "domains network nodes edges adjacency neighbours regions",
    "theme_system": "theme dark light mode appearance colour color",
    "theme_light": "theme white mode appearance colour color",
    "theme_dark": "theme night black mode appearance colour color",
    "full_screen": "maximize",
    "reset_layout": "restore panels default docks",
    "play": "animate",
    "flip": "invert negate",
    "pin_index": "go to find vertex jump",
    "remove_pin": "delete unpin marker",
    "import_pins": "load read markers points csv table",
    "export_pins": "save write markers points csv table distances",
    "clear_pins": "remove delete markers",
    "help": "manual keys shortcuts",
    "system_report": "bug versions debug",
}
#: Search words for gestures, by their effect in `actions.MOUSE_HELP`.
_GESTURES = {"Rotate": "turn orbit spin", "Pan": "shift move translate drag", "Roll": "rotate tilt"}
#: Search words for panels, by title.
_PANELS = {
    "Mesh": "panel health defects repair decomposition information",
    "Shape": "panel reconstruction vibration morph",
    "Compare": "panel second mesh match correspondence",
    "Labels": "panel segmentation parcellation annotation parts regions",
    "Field": "panel families colours colors",
    "Spectrum": "panel eigenvalues filters plot",
    "Profiles": "panel pins plot legend",
}
_SETTINGS = QLineEdit, QAbstractSpinBox, QComboBox, QAbstractButton, QAbstractSlider
_MAX_ROWS, _WIDTH = 12, 560
#: Keys of the entries that were run last, newest first.
_recent: list[str] = []


@dataclass(frozen=True)
class Entry:
    """Row of the palette: text, menu or panel, shortcut, search words, and effect of Enter."""

    key: str
    text: str
    place: str
    keys: str
    words: str
    run: Callable[[], object]
    enabled: bool = True

    def rank(self, wanted: list[str]) -> int | None:
        """Return how well words match, 0 best; None if a word does not match."""
        text, words = self.text.casefold(), self.words.casefold()
        if not all(word in text or word in words for word in wanted):
            return None
        if text.startswith(" ".join(wanted)):
            return 0
        starts = {part for each in (text, words) for part in each.split()}
        if all(any(part.startswith(word) for part in starts) for word in wanted):
            return 1 if all(word in text for word in wanted) else 2
        return 3


class CommandPalette(QDialog):
    """Palette that runs the chosen command, or gives the focus to the chosen setting."""

    def __init__(self, window: QMainWindow, actions: Actions) -> None:
        super().__init__(window, Qt.WindowType.Popup)
        self.setObjectName("command_palette")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        hint = "Find a command, a setting or a field"
        self.search = theme.named(QLineEdit(placeholderText=hint), "palette_search", hint)
        self.list = theme.named(QTreeWidget(), "palette_list", "What was found")
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setColumnCount(3)
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.list.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.nothing = theme.named(QLabel("Nothing found"), "palette_nothing", role="muted")
        self.setLayout(column(self.search, self.list, self.nothing, None, margins=(8, 8, 8, 8)))
        self._entries = [*_commands(actions), *_gestures(actions), *_settings(window)]
        self._shown: list[Entry] = []
        self.search.textChanged.connect(self._find)
        self.search.installEventFilter(self)
        self.list.itemClicked.connect(lambda: self.accept())
        self.list.ensurePolished()
        self._find("")
        self.setFixedWidth(min(_WIDTH, window.width() - 40))
        corner = QPoint((window.width() - self.width()) // 2, window.height() // 10)
        self.move(window.mapToGlobal(corner))
        self.search.setFocus()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Move the selection on arrow keys; run the selected row on Enter."""
        if watched is self.search and isinstance(event, QKeyEvent):
            if event.type() != QEvent.Type.KeyPress:
                return False
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()))
            if step is not None and self._shown:
                self._choose((self._chosen() + step) % len(self._shown))
                return True
            if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                self.accept()
                return True
        return super().eventFilter(watched, event)

    def accept(self) -> None:
        """Run the selected row; the palette stays open if the row is not available."""
        at = self._chosen()
        if not 0 <= at < len(self._shown) or not self._shown[at].enabled:
            return
        entry = self._shown[at]
        _recent[:] = [entry.key, *(key for key in _recent if key != entry.key)][:_MAX_ROWS]
        super().accept()
        entry.run()

    def _find(self, text: str) -> None:
        wanted = text.casefold().split()
        ranked = [(entry.rank(wanted), entry) for entry in self._entries]
        found = [
            (_recency(entry), rank, not entry.enabled, at)
            for at, (rank, entry) in enumerate(ranked)
            if rank is not None
        ]
        self._shown = [self._entries[key[-1]] for key in sorted(found)[:_MAX_ROWS]]
        self.list.clear()
        for entry in self._shown:
            item = QTreeWidgetItem(self.list, [entry.text, entry.place, entry.keys])
            for cell in (1, 2):
                item.setForeground(cell, QColor(theme.palette().muted))
            item.setDisabled(not entry.enabled)
            if not entry.enabled:
                item.setToolTip(0, "Not available now")
        self._choose(0)
        self.list.setVisible(bool(self._shown))
        self.nothing.setVisible(not self._shown)
        self.list.doItemsLayout()  # items made before the style was polished lack its padding
        self.list.setFixedHeight(len(self._shown) * max(self.list.sizeHintForRow(0), 1) + 4)
        self.adjustSize()

    def _chosen(self) -> int:
        return self.list.currentIndex().row()

    def _choose(self, at: int) -> None:
        if (item := self.list.topLevelItem(at)) is not None:
            self.list.setCurrentItem(item)


def _recency(entry: Entry) -> int:
    return _recent.index(entry.key) if entry.key in _recent else len(_recent)


def _commands(actions: Actions) -> Iterator[Entry]:
    for each in COMMANDS:
        if each.name == "command_palette":
            continue
        action = actions[each.name]
        place = f"{each.menu} › {each.submenu}" if each.submenu else each.menu
        words = " ".join((each.tooltip, each.name.replace("_", " "), SYNONYMS.get(each.name, "")))
        keys = native_keys(*each.sequences()[:1])
        yield Entry(
            each.name, action.text().rstrip("…"), place, keys, words, action.trigger,
            action.isEnabled(),
        )  # fmt: skip


def _gestures(actions: Actions) -> Iterator[Entry]:
    for gesture, what in MOUSE_HELP:
        words = f"{gesture} {_GESTURES.get(what, '')}"
        yield Entry(
            gesture, what, "Mouse over the render", native_text(gesture), words,
            actions["help"].trigger,
        )  # fmt: skip


def _settings(window: QMainWindow) -> Iterator[Entry]:
    """Yield panels and their enabled controls; a panel behind another tab counts as enabled."""
    for dock in window.findChildren(QDockWidget):
        place, panel = dock.windowTitle(), dock.widget()
        words, front = _PANELS.get(place, ""), partial(_bring_to_front, dock)
        yield Entry(dock.objectName(), place, "View", "", words, front)
        seen = set()  # a slider and its field are one setting
        for control in panel.findChildren(QWidget):
            name = control.accessibleName()
            if not (name and isinstance(control, _SETTINGS) and control.isEnabledTo(panel)):
                continue
            focusable = control.focusPolicy() != Qt.FocusPolicy.NoFocus
            if focusable and control.isVisibleTo(dock) and name not in seen:
                seen.add(name)
                key = f"{dock.objectName()}.{control.objectName()}"
                words = f"{place} {_SETTING_WORDS.get(control.objectName(), '')}"
                yield Entry(key, name, place, "", words, partial(_go_to, control, dock))


#: Search words for controls, by object name.
_SETTING_WORDS = {
    "colormap_combo": "colour color bar palette",
    "limits_combo": "threshold range percentiles colour color bar minimum maximum",
    "color_scale_combo": "logarithmic linear colour color bar",
}


def _bring_to_front(dock: QDockWidget) -> None:
    dock.show()
    dock.raise_()


def _go_to(control: QWidget, dock: QDockWidget) -> None:
    """Bring a control to the front and give it the focus."""
    _bring_to_front(dock)
    # after the show event of the panel, which enables its controls
    QTimer.singleShot(0, control, partial(_give_focus, control))


def _give_focus(control: QWidget) -> None:
    bring_into_view(control)
    control.setFocus(Qt.FocusReason.ShortcutFocusReason)
    if isinstance(control, QLineEdit):
        control.selectAll()

"""The Field panel: the displayed field, its controls, and its colours."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QListView,
    QListWidget,
    QListWidgetItem,
    QStackedWidget,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.app.panels.color_section import ColorSection
from meshmash_viewer.app.tabs import make_tab
from meshmash_viewer.app.tabs.form import Player
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.limits import Limits

#: Families side by side, and the height of their lines in pixels.
_COLUMNS, _LINE = 2, 28
#: Height of the panel from which nothing moves when controls come and go.
_ROOMY = 700


class FamilyList(QListWidget):
    """The families of fields, two side by side, of which one is chosen."""

    def __init__(self) -> None:
        super().__init__()
        theme.named(self, "field_list", "Family of fields", role="choices")
        self.setFlow(QListView.Flow.LeftToRight)
        self.setWrapping(True)
        self.setResizeMode(QListView.ResizeMode.Adjust)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setIconSize(QSize(16, 16))
        for name, family in FAMILIES.items():
            item = QListWidgetItem(family.short, self)
            item.setData(Qt.ItemDataRole.UserRole, name)
            item.setToolTip(family.tip)
        self.setFixedHeight(-(-len(FAMILIES) // _COLUMNS) * _LINE + 6)
        theme.notifier().changed.connect(self._draw)
        self._draw()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Qt's: the columns share the width."""
        super().resizeEvent(event)
        # a pixel less: Qt wraps a line that fills the width to the last
        cell = QSize((self.viewport().width() - 1) // _COLUMNS, _LINE)
        for row in range(self.count()):
            self.item(row).setSizeHint(cell)
        self.setGridSize(cell)

    def _draw(self) -> None:
        for row, family in enumerate(FAMILIES.values()):
            self.item(row).setIcon(icons.icon(family.icon))


class FieldPanel(QWidget):
    """The families of fields; choosing one shows its controls and displays it."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "field_panel", "Field")
        self._document = document
        self._player = Player(document, self)
        self._shown: tuple[Field | None, Limits | None] = None, None
        self.list = FamilyList()
        self._stack = QStackedWidget()
        self._pages = {name: make_tab(document, family) for name, family in FAMILIES.items()}
        for page in self._pages.values():
            self._stack.addWidget(make.scroll(page))
        self.list.currentRowChanged.connect(self._choose_kind)
        self.hint = note("field_hint")
        self.hint.setContentsMargins(theme.MARGIN, 0, theme.MARGIN, theme.GAP)
        self.colors = ColorSection(document)
        parts = (self.list, make.line(), (self._stack,), self.hint, make.line(), self.colors)
        self.setLayout(column(*parts, spacing=0))

        follow(document.display.events.kind, self._refresh_tab)
        events = document.display.events
        follow((document.spectrum_changed, document.mesh_changed, events.fields), self._refresh_use)
        self._refresh_tab()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave no empty room under the colours where the controls above have to scroll."""
        super().resizeEvent(event)
        self.colors.keep_room(self.height() >= _ROOMY)

    def set_field(self, field: Field | None, limits: Limits | None) -> None:
        """Show the limits of the displayed field, and its description."""
        self._shown = field, limits
        later(self._tell)

    def _tell(self) -> None:
        field, limits = self._shown
        self.colors.set_field(field, limits)
        for page in self._pages.values():
            page.show_field(field)

    def _choose_kind(self, row: int) -> None:
        self._document.display.kind = list(self._pages)[row]

    def _refresh_tab(self) -> None:
        row = list(self._pages).index(self._document.display.kind)
        with QSignalBlocker(self.list):
            self.list.setCurrentRow(row)
        self._stack.setCurrentIndex(row)
        self._refresh_use()

    def _refresh_use(self) -> None:
        known, display = self._document.known, self._document.display
        usable = known is not None and len(known) > 0
        for name, page in self._pages.items():
            page.setEnabled(usable or (known is not None and not display.fields[name].needs_pairs))
        shown = display.fields[display.kind]
        if usable or (known is not None and not shown.needs_pairs):  # it has its own hint
            show_note(self.hint, "")
        elif self._document.mesh is None:
            show_note(self.hint, "Open a mesh, and compute its eigenpairs to see fields on it.")
        else:
            show_note(self.hint, "Press Compute: the first eigenfunctions come within seconds.")

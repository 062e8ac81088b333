"""The Field panel: which field is on the render, and in which colours."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QFrame, QScrollArea, QTabWidget, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.panels.color_section import ColorSection
from meshmash_viewer.app.tabs import tab_of
from meshmash_viewer.app.tabs.play_button import Player
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field

__all__ = ["FieldPanel"]


class FieldPanel(QWidget):
    """One tab for each family of fields; turning to a tab puts its field on the render."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "field_panel", "Field")
        self._document = document
        self._player = Player(document, self)
        self.tabs = theme.named(QTabWidget(), "field_tabs", "Family of fields")
        self.tabs.setDocumentMode(True)
        theme.named(self.tabs.tabBar(), "field_tab_bar").setExpanding(False)
        self.tabs.setUsesScrollButtons(True)
        self._pages = {name: tab_of(family)(document) for name, family in FAMILIES.items()}
        for name, page in self._pages.items():
            area = QScrollArea(widgetResizable=True)
            area.setFrameShape(QFrame.Shape.NoFrame)
            area.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # it follows its fields
            area.setWidget(theme.named(page, "panel_content"))
            family = FAMILIES[name]
            self.tabs.setTabToolTip(self.tabs.addTab(area, family.short), family.tip)
        self.tabs.currentChanged.connect(self._choose_kind)
        self.hint = note("field_hint")
        self.hint.setContentsMargins(theme.MARGIN, 0, theme.MARGIN, theme.GAP)
        self.colors = ColorSection(document)
        line = theme.with_role(QFrame(), "line")
        self.setLayout(column((self.tabs,), self.hint, line, self.colors, spacing=0))

        follow(document.display.events.kind, self._refresh_tab)
        follow(document.spectrum_changed, self._refresh_use)
        follow(document.mesh_changed, self._refresh_use)
        self._refresh_tab()
        self._refresh_use()

    def set_field(self, field: Field | None, limits: tuple[float, float] | None) -> None:
        """Show the limits of the field that has arrived on the render."""
        self.colors.set_field(field, limits)

    def _choose_kind(self, tab: int) -> None:
        self._document.display.kind = list(self._pages)[tab]

    def _refresh_tab(self) -> None:
        with QSignalBlocker(self.tabs):
            self.tabs.setCurrentIndex(list(self._pages).index(self._document.display.kind))

    def _refresh_use(self) -> None:
        usable = self._document.spectrum is not None and len(self._document.spectrum) > 0
        for page in self._pages.values():
            page.setEnabled(usable)
        if usable:
            show_note(self.hint, "")
        elif self._document.mesh is None:
            show_note(self.hint, "Open a mesh, and compute its eigenpairs to see fields on it.")
        else:
            show_note(self.hint, "Press Compute: the first eigenfunctions come within seconds.")

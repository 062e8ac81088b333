"""What the tabs of families have in common, and what those of steppable fields have."""

from __future__ import annotations

from typing import Any, ClassVar

from PySide6.QtWidgets import QLabel, QSpinBox, QVBoxLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.listening import follow
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document

__all__ = ["FamilyTab", "FieldStepper"]


class FamilyTab(QWidget):
    """The controls of one family of fields.

    Subclasses build themselves in `_build` and show the document in `refresh`.
    """

    family: ClassVar[type[Family]]

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._build()
        follow(document.spectrum_changed, self._refresh_in_front)
        follow(document.display.events, self._refresh_in_front)
        self.refresh()

    def _refresh_in_front(self) -> None:
        """Refresh if this is the tab in front; the others do so when they come there."""
        if self._document.display.kind == self.family.name:
            self.refresh()

    def refresh(self) -> None:
        """Show what the document says."""
        raise NotImplementedError

    def _build(self) -> None:
        raise NotImplementedError

    def _change(self, **parameters: Any) -> None:
        self._document.display.change(self.family, **parameters)


class FieldStepper(FamilyTab):
    """A tab that steps through its family.

    Subclasses begin with `_build_head`, and take what the slider or the index was moved to in
    `_choose`.
    """

    def _choose(self, value: int) -> None:
        self._change(index=value)

    def _build_head(self, title: tuple[str, str], slider: tuple[str, str]) -> QVBoxLayout:
        """The column, with title and slider in it; each is given as object and accessible name."""
        column = QVBoxLayout(self)
        column.setContentsMargins(theme.MARGIN, theme.MARGIN, theme.MARGIN, theme.GAP)
        column.setSpacing(theme.GAP)
        self.title = theme.with_role(QLabel(self), "title")
        self.title.setObjectName(title[0])
        self.title.setAccessibleName(title[1])
        column.addWidget(self.title)
        self.slider = StepSlider(self)
        self.slider.setObjectName(slider[0])
        self.slider.setAccessibleName(slider[1])
        self.slider.valueChanged.connect(self._choose)
        column.addWidget(self.slider)
        return column

    def _index_spin(self, name: str, accessible_name: str) -> QSpinBox:
        spin = QSpinBox(self)
        spin.setObjectName(name)
        spin.setAccessibleName(accessible_name)
        spin.setKeyboardTracking(False)
        spin.valueChanged.connect(self._choose)
        return spin

"""Controls of "similar to this": from which pinned vertex, and in which features."""

from __future__ import annotations

from PySide6.QtWidgets import QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.controls.segments import Segments
from meshmash_viewer.app.tabs.pin_chooser import PinChooser
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.units import counted

__all__ = ["SimilarityTab"]


class SimilarityTab(PinChooser):
    """Paint how far every vertex is from a pinned one in feature space; follows the last pin."""

    family = Similarity
    icon = (
        '<circle cx="12" cy="12" r="8.5"/><circle cx="12" cy="12" r="4.5"/><path d="M12 11.8v.4"/>'
    )

    def _build(self) -> None:
        self.basis = Segments(
            "similarity_basis",
            "Features to measure in",
            {name: family.short for name, family in FEATURES.items()},
        )
        self.basis.chosen.connect(self._choose_basis)
        self.explanation = note("similarity_explanation")
        self._fill(
            "similarity_label",
            "",
            *self._make_pin_choice(),
            theme.with_role(QLabel("Distance measured in"), "muted"),
            self.basis,
            self.explanation,
            self.hint,
        )

    # -- from the person --------------------------------------------------------------------

    def _choose_basis(self, key: str) -> None:
        self._change(basis=key)

    # -- from the model ---------------------------------------------------------------------

    def refresh(self) -> None:
        """Show what the model holds."""
        display = self._document.display
        chosen = display[Similarity]
        self.title.setText(f"Similar to {self._show_pin(chosen.vertex)}")
        self.basis.show_key(chosen.basis)
        features = display.fields[chosen.basis]
        count = getattr(features, features.counted)
        show_note(
            self.explanation,
            f"Over the {counted(count, 'column')} of the {features.short} tab, each in units of its"
            " spread; 0 is alike, larger is less so.",
        )

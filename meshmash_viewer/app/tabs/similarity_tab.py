"""Controls of "similar to this": from which pinned vertex, and in which features."""

from __future__ import annotations

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import note, show_note
from meshmash_viewer.app.tabs.form import PinChooser
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.units import counted


class SimilarityTab(PinChooser):
    """Paint how far every vertex is from a pinned one in feature space; follows the last pin."""

    def _build(self) -> None:
        self.basis = make.Segments(
            "similarity_basis",
            "Features to measure in",
            {name: family.short for name, family in FEATURES.items()},
            in_row=2,
        )
        self.basis.chosen.connect(lambda key: self._change(basis=key))
        self.explanation = note("similarity_explanation")
        self._fill(
            "similarity_label",
            "",
            *self._make_pin_choice(),
            make.muted("Distance measured in"),
            self.basis,
            self.explanation,
        )

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
            " spread; 0 is alike and bright, larger is less so and dark.",
        )

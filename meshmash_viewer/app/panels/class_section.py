"""Section of the Labels panel: classification from labels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, grid, note, row, show_note, show_quietly
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import follow
from meshmash_viewer.learn import CLASSIFIERS, KINDS
from meshmash_viewer.model.document import Document

_CLASSIFIERS = dict(
    zip(CLASSIFIERS, ("Mean of both", "Random forest", "Logistic regression"), strict=True)
)
_SCORES = (
    "F1 weighs by area how many vertices of a class are found, and how many that are found are of"
    " it (1 is best). It is measured where whole strokes were left out of the training."
)
_EMPTY = "Press Classify for classes and their scores."
_KINDS = dict(zip(KINDS, ("HKS", "WKS", "Curvature"), strict=True))


class ClassSection(QWidget):
    """Options of the classification, its buttons, and the scores."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "class_section", "Classes")
        self._document = document
        classes = document.classes
        self.kinds = {
            kind: make.check(
                text, f"class_{kind}_check", f"Learn from {text}", self._choose_kinds,
                tip=KINDS[kind].capitalize(),
            )
            for kind, text in _KINDS.items()
        }  # fmt: skip
        self.classifier_combo = make.combo(
            "class_classifier_combo", "Classifier", lambda key: self._choose(classifier=key),
            _CLASSIFIERS,
        )  # fmt: skip
        self.smoothing_field = NumberField(
            "class_smoothing_field", "Smoothing of probabilities",
            tip="Length over which probabilities are smoothed along the surface; 0 for none",
        )  # fmt: skip
        self.smoothing_field.bounds = (0.0, math.inf)
        self.smoothing_field.edited.connect(lambda length: self._choose(smoothing=length))
        self.classify_button = make.button(
            "Classify", "class_classify_button", "Learn from these labels, and classify the mesh",
            classes.classify, role="primary",
            tip="Predicts the class of every vertex, with probabilities, as own maps",
        )  # fmt: skip
        self.live_check = make.check(
            "Live", "class_live_check", "Classify again after each change of the labels",
            lambda on: setattr(classes, "live", on),
            tip="Classifies again after each change of the labels",
        )  # fmt: skip
        self.uncertainty_button = make.button(
            "Uncertainty", "class_uncertainty_button", "Show where the prediction is uncertain",
            classes.show_uncertainty, tip=
                "Shows where another label would improve the result most",
        )  # fmt: skip
        self.note = note("class_note")
        self.setLayout(
            column(
                make.heading("Classes"),
                row(make.muted("From"), *self.kinds.values(), None),
                grid(
                    (make.muted("Classifier"), self.classifier_combo),
                    (make.muted("Smoothing"), self.smoothing_field),
                ),
                row(self.classify_button, self.live_check, None, self.uncertainty_button),
                self.note,
            )
        )
        changes = (
            classes.changed, document.labels.changed, document.spectrum_changed,
            document.mesh_changed, document.work.changed,
        )  # fmt: skip
        follow(changes, self.refresh)
        self.refresh()

    def _choose_kinds(self) -> None:
        self._choose(kinds=tuple(kind for kind, each in self.kinds.items() if each.isChecked()))

    def _choose(self, **options: Any) -> None:
        classes = self._document.classes
        classes.options = replace(classes.options, **options)

    def refresh(self) -> None:
        """Show the state of the model."""
        classes, labels = self._document.classes, self._document.labels
        options, runs = classes.options, classes.runs
        for kind, check in self.kinds.items():
            show_quietly(check, kind in options.kinds)
        self.classifier_combo.setCurrentIndex(list(_CLASSIFIERS).index(options.classifier))
        self.smoothing_field.show_value(options.smoothing, self._document.unit, with_unit=True)
        show_quietly(self.live_check, classes.live)
        self.classify_button.setEnabled(not classes.missing)
        self.uncertainty_button.setEnabled(labels.predicted is not None)
        missing = classes.missing if labels.current is not None else ""
        said = "Classifying …" if runs else classes.said
        empty = "" if labels.current is None else _EMPTY
        show_note(self.note, missing or said or empty)
        self.note.setToolTip(_SCORES if classes.said and not missing and not runs else "")

"""Section of the Labels panel: classification from labels, and the importance of columns."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, grid, note, row, show_note, show_quietly
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.plots.panel import PlotSaver
from meshmash_viewer.app.plots.plot import Plot, Series, color, solid
from meshmash_viewer.learn import CLASSIFIERS, KINDS
from meshmash_viewer.model.classes import ClassesJob, Learned
from meshmash_viewer.model.document import Document
from meshmash_viewer.units import format_number, format_quantity, named_quantity

_CLASSIFIERS = dict(
    zip(CLASSIFIERS, ("Mean of both", "Random forest", "Logistic regression"), strict=True)
)
_SCORES = (
    "F1 weighs by area how many vertices of a class are found, and how many that are found are of"
    " it (1 is best). It is measured where whole strokes were left out of the training."
)
_EMPTY = "Press Classify for classes, their scores, and the importance of each column."
#: Height of the plot in pixels.
_HEIGHT = 150
#: By kind of columns: its name, its name in the legend, the name of one column, and the power of
#: length of the quantity in which the time of the column is written.
_KINDS = dict(zip(KINDS, (
    ("HKS", "HKS", "HKS at", 2),
    ("WKS", "WKS (λ = 1/t)", "WKS at", -2),
    ("Curvature", "Curvature (l = √t)", "over", 1),
), strict=True))  # fmt: skip
#: Number of most important columns in the legend.
_NAMED = 3


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
            for kind, (text, *_) in _KINDS.items()
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
        self.importance = ImportancePlot(document)
        self.legend = note("class_importance_legend")
        self.legend.setTextFormat(Qt.TextFormat.RichText)
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
                self.importance,
                self.legend,
            )
        )
        changes = (
            classes.changed, document.labels.changed, document.spectrum_changed,
            document.mesh_changed, document.work.changed,
        )  # fmt: skip
        follow(changes, self.refresh)
        theme.notifier().changed.connect(self._show_importance)
        self.refresh()

    def _choose_kinds(self) -> None:
        self._choose(kinds=tuple(kind for kind, each in self.kinds.items() if each.isChecked()))

    def _choose(self, **options: Any) -> None:
        classes = self._document.classes
        classes.options = replace(classes.options, **options)

    def refresh(self) -> None:
        """Show the state of the model."""
        classes, labels = self._document.classes, self._document.labels
        options, job = classes.options, self._document.work.job
        for kind, check in self.kinds.items():
            show_quietly(check, kind in options.kinds)
        self.classifier_combo.setCurrentIndex(list(_CLASSIFIERS).index(options.classifier))
        self.smoothing_field.show_value(options.smoothing, self._document.unit, with_unit=True)
        show_quietly(self.live_check, classes.live)
        self.classify_button.setEnabled(not classes.missing)
        self.uncertainty_button.setEnabled(labels.predicted is not None)
        runs = job is not None and isinstance(job.job, ClassesJob)
        missing = classes.missing if labels.current is not None else ""
        said = "Classifying …" if runs else classes.said
        empty = "" if labels.current is None else _EMPTY
        show_note(self.note, missing or said or empty)
        self.note.setToolTip(_SCORES if classes.said and not missing and not runs else "")
        self._show_importance()

    def _show_importance(self) -> None:
        learned = self._document.classes.learned
        self.importance.setVisible(learned is not None)
        if learned is not None:
            self.importance.show_learned(learned)
        show_note(self.legend, "" if learned is None else self.importance.legend())


class ImportancePlot(Plot):
    """Plot of the importance of the columns, summed at each time, with a curve for each kind."""

    def __init__(self, document: Document) -> None:
        self._learned = Learned()
        self._curves: dict[str, pg.PlotDataItem] = {}
        super().__init__("class_importance_plot", "Importance of each column for the classes")
        self.setFixedHeight(_HEIGHT)
        self.set_log(True, False)
        self.saver = PlotSaver(self, document, self.numbers, self.dress)

    def show_learned(self, learned: Learned) -> None:
        """Draw the importance of the columns of a prediction."""
        if learned is self._learned:
            return
        self._learned = learned
        self.set_labels(named_quantity("t", learned.unit, 2), "Importance")
        for kind in set(self._curves) - set(learned.kinds):
            self.removeItem(self._curves.pop(kind))
        for kind, (times, sums) in self._sums().items():
            if kind not in self._curves:
                self._curves[kind] = self.plot([], [], symbol="o", symbolSize=4)
            self._curves[kind].setData(np.log10(times), sums)
        self.dress()
        self.show_all()

    def _sums(self) -> dict[str, tuple[list[float], list[float]]]:
        """Return the times of each kind of columns, and the sums of importance at each time."""
        learned = self._learned
        sums: dict[str, dict[float, float]] = {kind: {} for kind in learned.kinds}
        columns = zip(learned.kinds, learned.times, learned.importance, strict=True)
        for kind, time, share in sorted(columns):
            sums[kind][time] = sums[kind].get(time, 0.0) + share
        return {kind: (list(own), list(own.values())) for kind, own in sums.items()}

    def numbers(self) -> list[Series]:
        """Return the curves and the importance of each column as series."""
        learned = self._learned
        curves = [
            Series(_KINDS[kind][1], *sums, _color(kind)) for kind, sums in self._sums().items()
        ]
        each = zip(learned.names, learned.times, learned.importance, strict=True)
        return curves + [Series(name, [time], [share]) for name, time, share in each]

    def legend(self) -> str:
        """Return the legend and the most important columns as rich text."""
        names = ((kind, _KINDS[kind][1].replace(" ", "&nbsp;")) for kind in self._curves)
        parts = [f'<span style="color:{_color(kind)}">▬</span>&nbsp;{name}' for kind, name in names]
        order = np.argsort(self._learned.importance)[::-1][:_NAMED]
        most = ", ".join(map(self._described, order))
        return f"{' &nbsp;'.join(parts)}<br>Most important: {most}."

    def _described(self, at: int) -> str:
        """Format a column with its importance: "HKS at 0.231 µm² (0.08)"."""
        learned = self._learned
        *_, place, power = _KINDS[learned.kinds[at]]
        size = format_quantity(learned.times[at] ** (power / 2), learned.unit, power)
        name = "" if abs(power) == 2 else f"{learned.names[at].partition('_')[0]} "
        said = f"{name}{place} {size}"
        return f"{said} ({format_number(learned.importance[at], 2)})".replace(" ", "&nbsp;")

    def dress(self) -> None:
        super().dress()
        for kind, curve in self._curves.items():
            curve.setPen(solid(_color(kind), 1.6))
            curve.setSymbolPen(None)
            curve.setSymbolBrush(color(_color(kind)))


def _color(kind: str) -> str:
    return str(theme.palette().series[list(_KINDS).index(kind)])

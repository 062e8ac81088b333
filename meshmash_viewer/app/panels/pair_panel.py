"""The Compare panel: distance of two meshes, match of their vertices, links, second mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import UnitCombo
from meshmash_viewer.app.controls.make import PANEL, column, row
from meshmash_viewer.app.dialogs.files import ask_to_save, save_labels
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.panels.health_table import HealthTable
from meshmash_viewer.app.plots.panel import PlotSaver
from meshmash_viewer.app.plots.plot import MatrixView, Plot, Series, dashed, solid
from meshmash_viewer.features.comparison import Comparison, FunctionMatches, comparison_remarks
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.health import described_components, first_repair
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.mesh import mask_text
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.matching import MATCHED_IN
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pair import CAMERAS, LINKS, Pair
from meshmash_viewer.units import format_number, format_share

_FIGURES = {
    "pair_distance_label": "Spectral distance",
    "pair_compared_label": "Eigenvalues",
    "pair_match_label": "Vertices",
    "pair_functions_label": "Eigenfunctions",
    "pair_function_label": "This one",
}
_MATCHES = {"pair_best_label": "Best match", "pair_next_label": "Next best"}


class PairPanel(QWidget):
    """Results and options of the comparison; a hint without a second mesh."""

    open_requested = Signal()
    close_requested = Signal()
    #: Path of the file for the match.
    save_requested = Signal(object)
    #: Request to store the field of the first mesh as a map of the second.
    keep_requested = Signal()
    #: Request to choose files with values per vertex of the second mesh.
    maps_requested = Signal()
    #: Request to write results of the second mesh to a file.
    export_requested = Signal()
    #: File, function that writes it, and description: request to write labels of the second mesh.
    write_requested = Signal(object, object, str)

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "pair_panel", "Compare")
        self._document = document
        self._pair: Pair | None = None
        self._build()
        events = document.display.events
        changes = events.fields, events.kind, document.pins.changed, document.mesh_changed
        follow(changes, self.refresh)
        theme.notifier().changed.connect(self._dress)
        self._dress()
        self.refresh()

    def _build(self) -> None:
        self.name_label = make.label("pair_name_label", role="heading")
        self.open_button = make.button(
            "Compare with…", "pair_open_button", "Open a second mesh next to this one",
            self.open_requested,
        )  # fmt: skip
        self.close_button = make.button(
            "Close", "pair_close_button", "Close the second mesh", self.close_requested
        )
        self.hint = make.note("pair_hint")
        self.remark = make.note("pair_remark", role="warning")
        self.largest_button = make.button(
            "Keep the largest component of each", "pair_keep_largest_button",
            "Keep the largest component of each mesh, and compare these", self._keep_largest,
            role="link",
        )  # fmt: skip
        self.unit_label = make.muted("Its unit")
        #: Layout of the unit control of the second mesh.
        self._unit = QVBoxLayout()
        self.figures = make.Facts(_FIGURES)
        for label in self.figures.findChildren(QLabel):
            label.setWordWrap(label.objectName() in _FIGURES)
        self.plot = Plot("pair_plot", "Spectra of both meshes, at an area of 1")
        self.plot.setFixedHeight(130)
        self.plot.set_labels("Index", "λ × area")
        self.plot.set_whole(True)
        make.keep_room(self.plot)
        self._curves = tuple(pg.PlotCurveItem() for _ in range(2))
        for curve in self._curves:
            self.plot.addItem(curve)
        self.saver = PlotSaver(self.plot, self._document, self._numbers, self._dress)
        self.legend = make.label("pair_legend", role="muted", wordWrap=True)
        self.feature_combo = make.combo(
            "pair_feature_combo", "Feature in which vertices are matched",
            self._call(lambda pair, name: pair.match_by(name)),
            {name: family.short for name, family in MATCHED_IN.items()},
        )  # fmt: skip
        self.refine_check = make.check(
            "Refined by ZoomOut", "pair_refine_check",
            "Match vertices by a functional map, refined with more and more eigenfunctions",
            self._call(lambda pair, on: pair.match_by(refined=on)),
            tip="Pins that you set on both meshes are its landmarks",
        )  # fmt: skip
        #: The functional map, if the match is refined.
        self.matrix = MatrixView("pair_matrix_plot")
        self.matches = make.Facts(_MATCHES)
        self.match_note = make.note("pair_match_note")
        self.carry_check = make.check(
            "Colours of the first, by the match", "pair_carry_check",
            "Show the colours of the first mesh on the second, each vertex as its match",
            self._call(Pair.carry),
        )  # fmt: skip
        self.save_button = make.button(
            "Export match…", "pair_save_button", "Save the match of all vertices", self._save
        )
        self.keep_button = make.button(
            "Keep as a map", "pair_keep_button",
            "Keep the colours of the first, by the match, as a map of the second mesh",
            self.keep_requested,
        )  # fmt: skip
        self.carry_buttons = [
            make.button(
                f"To {name}", f"carry_to_{name}_button",
                f"Carry maps and labels to the {name} mesh, with the score of each vertex",
                self._call(lambda pair, *_, name=name: pair.carry_maps(to_first=name == "first")),
            )
            for name in ("second", "first")
        ]  # fmt: skip
        self.links = {
            name: make.check(
                text, f"pair_link_{name}", f"Link: {text}",
                self._call(lambda pair, on, name=name: pair.link(name, on)),
            )
            for name, text in LINKS.items()
        }  # fmt: skip
        self.undo_button = make.button(
            "Undo repair", "second_undo_repair_button",
            "Undo the last repair of the second mesh",
            self._call(lambda pair, *_: pair.second.undo_repair()), role="link",
        )  # fmt: skip
        make.keep_room(self.undo_button)
        self.map_button = make.button(
            "Add map…", "second_map_button", "Add values per vertex of the second mesh from files",
            self.maps_requested, tip="Or drop the files on the second mesh",
        )  # fmt: skip
        self.export_button = make.button(
            "Export…", "second_export_button",
            "Write features, eigenpairs or maps of the second mesh to a file",
            self.export_requested,
        )  # fmt: skip
        self.labels_button = make.button(
            "Save labels…", "second_save_labels_button",
            "Save the label set of the second mesh that was displayed last",
            self._call(
                lambda pair, *_: save_labels(self, pair.second, self.write_requested.emit)
            ),
        )  # fmt: skip
        self.mask_button = make.button(
            "", "second_mask_button", "Compute the second mesh on a mask of its own", self._mask,
            tip="The mask is the map displayed on the second mesh: vertices with a label, or with a"
            " value other than 0",
        )  # fmt: skip
        #: Controls of the second mesh, created for each second mesh.
        self.health: HealthTable | None = None
        self._unit_combo: UnitCombo | None = None
        self._second = QVBoxLayout()
        self.cameras = make.Segments("pair_link", "Cameras of both meshes", CAMERAS)
        self.cameras.chosen.connect(self._call(Pair.link_cameras))
        self.content = make.holder(
            column(
                self.figures,
                self.legend,
                self.plot,
                make.heading("Vertices"),
                row(make.muted("Matched by"), (self.feature_combo,)),
                self.refine_check,
                self.matrix,
                self.matches,
                self.match_note,
                self.carry_check,
                row(self.save_button, self.keep_button, None),
                row(make.muted("Carry maps"), *self.carry_buttons, None),
                make.heading("Linked"),
                row(make.muted("Cameras"), (self.cameras,)),
                *self.links.values(),
                row((make.heading("Second mesh"),), self.undo_button),
                self._second,
                row(self.map_button, self.export_button, None),
                row(self.labels_button, self.mask_button, None),
            )
        )
        whole = make.holder(
            column(
                self.name_label,
                row(self.open_button, self.close_button, None),
                self.hint,
                self.remark,
                row(self.largest_button, None),
                row(self.unit_label, None, self._unit),
                self.content,
                None,
                margins=PANEL,
            )
        )
        scroll = make.scroll(whole)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setLayout(column(scroll))

    # -- from the user ------------------------------------------------------------------------

    def _call(self, act: Callable[..., object]) -> Callable[..., None]:
        """Return a slot that calls a function with the pair, if any, and the emitted values."""

        def slot(*given: Any) -> None:
            if self._pair is not None:
                act(self._pair, *given)

        return slot

    def _keep_largest(self) -> None:
        """Merge components that touch, else keep the largest, of each mesh; compute again."""
        if self._pair is not None:
            for document in (self._pair.second, self._pair.first):
                if document.ready is not None and document.ready.health.n_components > 1:
                    first = document is self._pair.first
                    name = first_repair("keep_largest_component", document.ready.health)
                    document.repair(name, then_compute=first)

    def _mask(self) -> None:
        """Compute the second mesh on the mask of its displayed map, or again as a whole."""
        assert self._pair is not None
        second = self._pair.second
        if second.part_mesh is not None or second.mesh is None:
            second.take_part(None, then_compute=True)
        elif not second.maps.displayed:
            second.notices.say(
                "Display a map of the second mesh first: its vertices with a label, or with a value"
                " other than 0, are the mask.",
                Severity.WARNING,
            )
        else:
            mask = second.mesh.map_named(second.maps.displayed).marked
            second.take_part(mask, then_compute=True)

    def _save(self) -> None:
        path = ask_to_save(self, self._document, "match", "match.npz", "Tables", WRITERS)
        if path is not None:
            self.save_requested.emit(path)

    # -- from the model -----------------------------------------------------------------------

    def set_pair(self, pair: Pair | None) -> None:
        """Show the comparison of two meshes, or a hint without a second mesh."""
        self._pair = pair
        for each in (self.health, self._unit_combo):
            if each is not None:
                each.close()
                each.setParent(None)
                each.deleteLater()
        self.health = self._unit_combo = None
        if pair is not None:
            self.health = HealthTable(pair.second, second=True)
            self._unit_combo = UnitCombo(pair.second, second=True)
            self._second.addWidget(self.health)
            self._unit.addWidget(self._unit_combo)
            second = pair.second
            changes = (
                pair.changed, second.mesh_changed, second.spectrum_changed, second.work.changed
            )  # fmt: skip
            follow(changes, self.refresh)
        self.refresh()

    def refresh(self) -> None:
        pair = self._pair
        self.open_button.setEnabled(self._document.ready is not None)
        self.close_button.setEnabled(pair is not None)
        self.content.setVisible(pair is not None)
        other = None if pair is None else pair.second.mesh
        self.name_label.setText("Two meshes" if other is None else other.name or "Second mesh")
        make.show_note(self.hint, self._hint())
        self.unit_label.setVisible(pair is not None)
        self._show_remarks()
        if pair is None:
            return
        found = pair.comparison
        for name, check in self.links.items():
            make.show_quietly(check, name in pair.links)
        self.cameras.show_key(pair.cameras)
        make.show_quietly(self.carry_check, pair.carries)
        make.show_quietly(self.refine_check, pair.refined)
        self.refine_check.setEnabled(found is None or not found.given)
        self.feature_combo.setCurrentIndex(self.feature_combo.findData(pair.matched_in))
        self.matrix.setVisible(found is not None and found.functional is not None)
        if found is not None and found.functional is not None:
            self.matrix.show_matrix(found.functional.matrix)
        usable = pair.carried_from is not None
        self.carry_check.setEnabled(usable)
        self.save_button.setEnabled(found is not None and not pair.comparing)
        for control in (self.keep_button, *self.carry_buttons):
            control.setEnabled(usable and not pair.comparing)  # not during a comparison
        self.undo_button.setVisible(pair.second.undo_repair_steps > 0)
        for control in (self.map_button, self.export_button):
            control.setEnabled(other is not None)
        self.labels_button.setEnabled(pair.second.labels.current is not None)
        self.mask_button.setText("Whole mesh" if pair.second.part_mesh else "On its map")
        self.mask_button.setEnabled(other is not None and pair.second.work.job is None)
        figures, matches = dict[str, str](), dict[str, str]()
        if found is not None:
            figures = {
                "pair_distance_label": _written_distance(found),
                "pair_compared_label": f"{len(found.spectra[0]):,} of each, times area",
                "pair_match_label": _written_match(found),
                "pair_functions_label": _written_functions(found.functions),
            }
            shown = self._document.display.family
            if isinstance(shown, Eigenfunctions):
                text = shown.correspondence_text(pair.correspondence)
                figures["pair_function_label"] = text
            if pair.first.pins.placed:
                best, *others = self._matches_of(pair)
                matches = {"pair_best_label": best, "pair_next_label": "\n".join(others)}
        make.show_note(self.match_note, self._match_text(pair))
        self.figures.show_values(figures)
        self.matches.show_values(matches)
        self.plot.setVisible(found is not None)
        spectra = found.spectra if found is not None else (np.empty(0), np.empty(0))
        for curve, values in zip(self._curves, spectra, strict=True):
            curve.setData(np.arange(len(values)), values)
        self._name_curves()

    def _show_remarks(self) -> None:
        pair, first = self._pair, self._document.ready
        second = None if pair is None else pair.second.ready
        remarks, counts = list[str](), (1, 1)
        if pair is not None and first is not None and second is not None:
            healths = first.health, second.health
            counts = healths[0].n_components, healths[1].n_components
            touch = any(each.untouching_components < each.n_components for each in healths)
            words = "Merge components that touch" if touch else "Keep the largest component of each"
            self.largest_button.setText(words)
            self.largest_button.setToolTip(". ".join(map(described_components, healths)))
            remarks = comparison_remarks(
                first.mesh, second.mesh, n_components=counts, found=pair.comparison
            )
            if first.part is not None and second.part is None:
                remarks.append(
                    f"the first is computed on the mask {mask_text(first.part.mesh)}, the second on"
                    " the whole, which alone makes eigenvalues and features differ; compute both on"
                    " a mask, or both on the whole, to compare shapes."
                )
        make.show_note(self.remark, " ".join(each[0].upper() + each[1:] for each in remarks))
        self.largest_button.setVisible(counts[0] != counts[1])
        idle = pair is not None and pair.first.work.job is None and pair.second.work.job is None
        self.largest_button.setEnabled(idle)

    def _hint(self) -> str:
        if self._document.ready is None:
            return "Open a mesh, then a second one to compare it with."
        if self._pair is None:
            return (
                "Open a second mesh next to this one, or drop it on the right half of the window."
                " Both are solved to the same eigenvalue times area."
            )
        spectrum = self._document.spectrum
        if spectrum is None or not spectrum.complete:
            return "Press Compute: the second mesh is solved as far as the first."
        if self._pair.comparison is not None:
            return ""
        second = self._pair.second.spectrum
        if self._pair.comparing or second is None or not second.complete:
            return "The meshes are being compared …"
        return "The comparison failed: compute more pairs, or repair the second mesh."

    def _matches_of(self, pair: Pair) -> list[str]:
        found, mesh = pair.best_matches(pair.first.pins.placed[-1].vertex), pair.second.mesh
        return [
            f"{mesh.named_vertex(at)} · {format_number(score, 3)}" for at, score in found if mesh
        ] or [""]

    def _match_text(self, pair: Pair) -> str:
        """Return an explanation of the best matches of the last pin and their scores."""
        if pair.comparison is None or not pair.first.pins.placed:
            return ""
        feature, found = MATCHED_IN[pair.matched_in].short, pair.comparison
        way = "by index" if found.given else "by ZoomOut" if found.functional is not None else ""
        best = f"The best match is the one {way}; the next are the nearest by {feature}. "
        return (best if way else "") + (
            f"After each vertex: distance of its {feature} from that of"
            f" {pair.first.pins.placed[-1].title}, in units of the spread of each column."
        )

    def _dress(self) -> None:
        self.plot.dress()
        colors = theme.palette().series
        first, second = self._curves
        first.setPen(solid(colors[0], 2.0))
        second.setPen(dashed(colors[1], 2.0))
        self._name_curves()

    def _numbers(self) -> list[Series]:
        data = (curve.getData() for curve in self._curves)
        drawn = zip(self._names, data, theme.palette().series, strict=False)
        return [Series(name, x, y, color) for name, (x, y), color in drawn if x is not None]

    @property
    def _names(self) -> list[str]:
        """Names of the open meshes, in the order first, second."""
        both = self._document.mesh, self._pair.second.mesh if self._pair else None
        return [each.name or "mesh" for each in both if each is not None]

    def _name_curves(self) -> None:
        named = zip(self._names, theme.palette().series, strict=False)
        lines = (f'<span style="color:{color}">▬</span> {name}' for name, color in named)
        self.legend.setText("<br>".join(lines))


def _written_distance(found: Comparison) -> str:
    """Format the spectral distance with its definition."""
    text = f"{format_number(found.distance)}: norm of the difference of λ × area"
    share = found.relative_distance
    return f"{text}, {format_share(share)} of that of the first" if math.isfinite(share) else text


def _written_match(found: Comparison) -> str:
    """Format the method of the match, and the share of mutual matches."""
    if found.given:
        return "by index: same faces"
    how = "by features" if found.functional is None else "by ZoomOut"
    how = "as a moved copy" if found.is_moved_copy else how
    return f"{how}, {format_share(found.mutual_share)} mutual"


def _written_functions(found: FunctionMatches) -> str:
    """Format the number of eigenfunctions of the first mesh without a match."""
    missing, total = int((~found.determined).sum()), len(found.indices)
    if not missing:
        return f"all {total:,} are matched"
    return f"{missing:,} of {total:,} cannot be matched"

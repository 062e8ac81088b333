"""Controls of maps: a list, facts, and projections on the eigenpairs."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from PySide6.QtCore import QPoint, QSignalBlocker, Qt
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QMenu

from meshmash_viewer.app import theme
from meshmash_viewer.app.background import say_saved
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import (
    Facts,
    column,
    holder,
    note,
    row,
    show_note,
    show_quietly,
)
from meshmash_viewer.app.dialogs.files import ask_for_maps, ask_to_save
from meshmash_viewer.app.listening import later
from meshmash_viewer.app.tabs.form import FamilyTab
from meshmash_viewer.app.tabs.parameters import FilterParameters
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.map_spectrum import MapSpectrum
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.fields.maps import CURVATURES, SUMS, VIEWS, OwnMaps
from meshmash_viewer.io.links import folder_of
from meshmash_viewer.io.write import write_map_spectrum
from meshmash_viewer.io.writers import SPECTRUM_WRITERS
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import (
    counted,
    format_number,
    format_quantity,
    format_range,
    format_share,
)
from meshmash_viewer.vertex_map import Label, VertexMap

_FACTS = {
    "map_range_label": "Range",
    "map_mean_label": "Mean by area",
    "map_count_label": "Vertices",
}
_SHARES = {"map_residual_label": "Residual", "map_share_label": "Energy in them"}
#: Missing share of the variation of a filtered map above which a warning is shown.
_FLAGGED = 0.01
#: Largest number of visible lines in the lists of maps and of labels.
_LINES, _LABEL_LINES = 6, 8


class MapTab(FamilyTab):
    """Controls that choose a map, show facts about it, and project it on eigenpairs."""

    def _build(self) -> None:
        self.list = _list("map_list", "Maps of this mesh")
        self.list.currentItemChanged.connect(self._choose_map)
        self.list.itemChanged.connect(self._rename)
        self.list.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.list.customContextMenuRequested.connect(self._open_menu)
        self.add_button = make.button(
            "Add map…", "map_add_button", "Add maps from files", self._add
        )
        self.remove_button = make.button(
            "Remove", "map_remove_button", "Remove the map from the mesh", self._remove
        )
        self.facts, self.shares = Facts(_FACTS), Facts(_SHARES)
        self.views = make.Segments("map_view", "Displayed part of the map", VIEWS, in_row=3)
        self.views.chosen.connect(lambda key: self._change(view=key))
        self.meaning, self.hint = note("map_varying_label"), note("map_hint")
        self.labels = _list("map_label_list", "Labels and their colours")
        self.labels.setSelectionMode(QListWidget.SelectionMode.NoSelection)
        self._shown_labels: tuple[Label, ...] | None = None
        self._listed: tuple[str, ...] | None = None
        #: Last result of `_of_part`: a map, the part of the mesh with eigenpairs, the map there.
        self._part: tuple[VertexMap, Mesh, VertexMap] | None = None
        self._field: Field | None = None
        slider = self._make_slider("map_pairs_slider", "Number of the lowest eigenpairs")
        pairs = self._make_index_row("map_pairs", "Number of the lowest eigenpairs")
        self.save_button = make.button(
            "Save coefficients…",
            "map_save_button",
            "Save the coefficients of the map",
            self._save,
            tip="Eigenvalue, coefficient and share of the energy of each pair, as a table",
        )
        save = row(self.save_button, None)
        self._sum = holder(column(slider, pairs, self.shares, self.meaning, save))
        self.filter_combo = make.combo(
            "map_filter_combo",
            "Filter applied to the map",
            self._choose_filter,
            tip="Φ h(Λ) Φᵀ M f. Other formulas are typed on the Filter tab",
        )
        fault = note("map_filter_fault", "warning")
        self.missing = note("map_filter_missing", "warning")
        self.parameters = FilterParameters(self._document, "map_")
        self.parameters.tried.connect(partial(show_note, fault))
        self._filter = holder(column(self.filter_combo, self.parameters, fault, self.missing))
        self.keep_button = make.button(
            "Keep as a map",
            "map_keep_button",
            "Keep the displayed values as a map",
            self._keep,
            tip="Add the displayed values to the maps above",
        )
        heading, keep = make.heading("On the eigenpairs"), row(self.keep_button, None)
        self._on_pairs = holder(column(heading, self.views, self._sum, self._filter, keep))
        buttons = row(self.add_button, self.remove_button, None)
        parts = self.list, buttons, self.facts, self._on_pairs, self.hint, self.labels
        self._fill("map_label", "Map", *parts)

    # -- input of the user ------------------------------------------------------------------

    def _choose(self, value: int) -> None:
        view = self._document.display[OwnMaps].view
        self._change(pairs=value, view=view if view in SUMS else "pairs")

    def _choose_map(self, item: QListWidgetItem | None) -> None:
        if item is not None:
            self._change(chosen=item.data(Qt.ItemDataRole.UserRole))

    def _rename(self, item: QListWidgetItem) -> None:
        self._document.maps.rename(item.data(Qt.ItemDataRole.UserRole), item.text())
        self._listed = None  # fill the list again: the name may be refused, or a number appended
        later(self.refresh)

    def _open_menu(self, position: QPoint) -> None:
        item = self.list.itemAt(position)
        if item is None:
            return
        own = item.data(Qt.ItemDataRole.UserRole) not in CURVATURES
        menu = theme.named(QMenu(self.list), "map_menu", "Menu of the map")
        rename = menu.addAction("Rename\tF2", lambda: self.list.editItem(item))
        rename.setEnabled(bool(item.flags() & Qt.ItemFlag.ItemIsEditable))
        menu.addAction("Remove", self._remove).setEnabled(own)
        menu.aboutToHide.connect(menu.deleteLater)
        menu.popup(self.list.viewport().mapToGlobal(position))

    def _choose_filter(self, row: int) -> None:
        self._document.display.put(self._document.display[Filters].with_text(self._formulas()[row]))

    def _formulas(self) -> list[str]:
        """Return the ready formulas, and the current formula if it is another one."""
        return list(dict.fromkeys([*READY.values(), self._document.display[Filters].text]))

    def _add(self) -> None:
        self._document.maps.open(ask_for_maps(self, folder_of(self._document.path)))

    def _save(self) -> None:
        """Write the coefficients, in the interface thread because they are only a few hundred."""
        document, spectrum = self._document, self._document.known
        chosen, mesh = document.display[OwnMaps], document.mesh
        found = None if spectrum is None else chosen.map_spectrum(spectrum)
        if spectrum is None or found is None or mesh is None:
            return
        name = chosen.resolved(spectrum, {}).chosen
        file = f"{name}_coefficients.csv"
        path = ask_to_save(self, document, "coefficients", file, "Tables", SPECTRUM_WRITERS)
        if path is None:
            return
        try:
            found = replace(found, mesh_errors=spectrum.mesh_errors)
            write_map_spectrum(path, found, mesh, name)
        except InputError as fault:
            document.notices.say(f"The coefficients were not saved: {fault}", Severity.ERROR)
        else:
            text = f"Coefficients of {name} on {counted(len(found), 'pair')} written to {path}."
            say_saved(document, text, path)

    def _keep(self) -> None:
        document, field = self._document, self._field
        if document.mesh is not None and field is not None and self._can_keep():
            self.list.setFocus()  # otherwise hiding the button moves the focus to another control
            colors = tuple(map(float, (*field.colors(document.display)[0], field.signed)))
            document.maps.add(document.mesh, [field.as_map()], colors=colors)

    def _can_keep(self) -> bool:
        """Return whether the displayed field is that of the chosen map, exact and complete."""
        document, field, spectrum = self._document, self._field, self._document.known
        if field is None or field.draft or spectrum is None or spectrum.preview:
            return False
        fields = document.display.fields
        return field.family == document.display[OwnMaps].resolved(spectrum, fields)

    def _remove(self) -> None:
        self._document.maps.remove(self._document.display[OwnMaps].chosen)

    # -- from the model ---------------------------------------------------------------------

    def show_field(self, field: Field | None) -> None:
        """Refresh: a curvature or the spectrum of a map is computed with the field."""
        self._field = field
        if field is not None and self._document.display.kind == self.family.name:
            later(self.refresh)

    def refresh(self) -> None:
        spectrum = self._document.known
        if spectrum is None:
            return
        resolved = self._document.display[OwnMaps].resolved(spectrum, {})
        self._refresh_list(resolved.chosen)
        self.remove_button.setEnabled(resolved.shown is not None)
        self.title.setText(resolved.chosen)
        facts, known = {}, resolved.vertex_map(spectrum)
        if known is not None:
            total = "mesh" if self._document.part_mesh is None else "mask"
            facts = _map_facts(self._of_part(known), resolved.mean(spectrum), total)
        self.facts.show_values(facts)
        self._refresh_pairs(spectrum, resolved)
        self._refresh_labels(resolved.describe(spectrum, self._document.unit).labels)

    def _of_part(self, known: VertexMap) -> VertexMap:
        """Return a map at the vertices with eigenpairs; its mean is taken over these vertices."""
        part = self._document.part_mesh
        if part is None:
            return known
        if self._part is None or self._part[0] is not known or self._part[1] is not part:
            self._part = known, part, known.at(part.referenced)
        return self._part[2]

    def _refresh_list(self, chosen: str) -> None:
        mesh = self._document.mesh
        names = tuple(each.name for each in mesh.maps) if mesh is not None else ()
        with QSignalBlocker(self.list):
            if names != self._listed:
                self._listed = names
                self.list.clear()
                for name in (*names, *CURVATURES):
                    item = QListWidgetItem(name, self.list)
                    item.setData(Qt.ItemDataRole.UserRole, name)
                    path = mesh.map_named(name).path if mesh is not None and name in names else ""
                    item.setToolTip(f"{name}\n{path}".rstrip())
                    if self._document.maps.can_rename(name):
                        item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
            _show_lines(self.list, _LINES)
            self.list.setCurrentRow([*names, *CURVATURES].index(chosen))

    def _refresh_pairs(self, spectrum: Eigenpairs, resolved: OwnMaps) -> None:
        labelled = resolved.shown is not None and bool(resolved.shown.labels)
        usable, last = bool(len(spectrum)) and not labelled, max(len(spectrum), 1)
        count = self._document.display[OwnMaps].within(spectrum).pairs
        for control in (self.slider, self.spin):
            show_quietly(control, count, most=last, least=1)
        self._on_pairs.setVisible(usable)
        self._sum.setVisible(resolved.view in ("map", *SUMS))
        self._filter.setVisible(resolved.view == "filter")
        self._refresh_filter()
        show_note(self.missing, self._missing(spectrum))
        self.keep_button.setVisible(resolved.view != "map")
        self.keep_button.setEnabled(self._can_keep())
        self.spin.setSuffix(f" of {counted(last, 'pair')}")
        self.views.show_key(resolved.view)
        known = resolved.map_spectrum(spectrum) if usable else None
        self.save_button.setEnabled(known is not None)
        shares = {}
        if known is not None:
            shares["map_residual_label"] = format_number(known.residual(count))
            shares["map_share_label"] = format_share(known.share(count), 4)
        self.shares.show_values(shares)
        show_note(self.meaning, "" if known is None else _meaning(known, count))
        hint = ""
        if labelled:
            hint = "Labels are names, not numbers, so they have no spectrum."
        elif not usable:
            hint = "Compute eigenpairs to see the spectrum of the map."
        elif spectrum.preview:
            hint = "Computed from approximate pairs: the numbers change when exact pairs converge."
        show_note(self.hint, hint)

    def _missing(self, spectrum: Eigenpairs) -> str:
        """Return a warning if more than 1 % of the filtered map is missing, otherwise ""."""
        shown = self._document.display[OwnMaps].resolved(spectrum, self._document.display.fields)
        known, values = shown.map_spectrum(spectrum), shown.vertex_map(spectrum)
        passed, share = shown.missing(spectrum)
        if known is None or values is None or not share > _FLAGGED:
            return ""
        left = passed * math.sqrt(max(1.0 - known.share(len(known)), 0.0) * known.energy)
        mean = left / math.sqrt(spectrum.vertex_areas.sum())
        size = format_quantity(mean, values.unit, 1, 2)
        is_limit = spectrum.resolvable[1] <= len(spectrum)
        remedy = spectrum.mesh_limit if is_limit else "Compute more pairs."
        return (
            f"The filter is {format_number(passed, 2)} at the last of"
            f" {counted(len(known), 'pair')}: up to {format_share(share)} of what varies is"
            f" missing, in the root mean square at most {size}. {remedy}"
        )

    def _refresh_filter(self) -> None:
        texts = self._formulas()
        names = {text: name for name, text in READY.items()}
        listed = [names.get(text, text) for text in texts]
        if listed != [self.filter_combo.itemText(at) for at in range(self.filter_combo.count())]:
            self.filter_combo.clear()
            self.filter_combo.addItems(listed)
        self.filter_combo.setCurrentIndex(texts.index(self._document.display[Filters].text))
        self.parameters.refresh()

    def _refresh_labels(self, labels: tuple[Label, ...]) -> None:
        self.labels.setVisible(bool(labels))
        if labels != self._shown_labels:
            self._shown_labels = labels
            self.labels.clear()
            for label in labels:
                QListWidgetItem(make.dot(label.color), label.name or str(label.key), self.labels)
            _show_lines(self.labels, _LABEL_LINES)


def _list(name: str, accessible: str) -> QListWidget:
    made = theme.named(QListWidget(), name, accessible, role="choices")
    made.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    made.setFrameShape(QListWidget.Shape.NoFrame)
    return made


def _show_lines(shown: QListWidget, most: int) -> None:
    """Make a list as tall as its lines, but at most `most` lines."""
    line = max(shown.sizeHintForRow(0), 1)
    shown.setFixedHeight(line * min(max(shown.count(), 1), most) + 6)


def _map_facts(shown: VertexMap, mean: float, total: str) -> dict[str, str]:
    """Return facts on a map of the whole mesh or of the mask; `total` is "mesh" or "mask"."""
    of = "" if shown.n_values == shown.n_vertices else f" of {shown.n_vertices:,}"
    where = f" in the {total}" if of or total == "mask" else ""
    count = {"map_count_label": f"{shown.n_values:,}{of}{where}"}
    if shown.labels:
        return count | {"map_range_label": counted(len(shown.labels), "label")}
    like = max(np.abs(shown.range))  # so that the mean has the unit of the range
    written = format_quantity(mean, shown.unit, 1, 4, like=like) if np.isfinite(mean) else ""
    return count | {
        "map_range_label": format_range(*shown.range, shown.unit, word="to", digits=4),
        "map_mean_label": written,
    }


def _meaning(known: MapSpectrum, count: int) -> str:
    share = known.varying_share(count)
    left = f"; the other {format_share(1.0 - share)} is finer detail" if share < 0.9995 else ""
    pairs = "this pair" if count == 1 else f"these {count:,} pairs"
    return (
        f"{format_share(share)} of what varies (the squared differences from the mean, summed"
        f" over the area) is in {pairs}{left}."
    )

"""The Field panel: the displayed field, its controls, its colour map and limits."""

from __future__ import annotations

import math
from functools import lru_cache
from types import NoneType
from typing import Any

from PySide6.QtCore import QSignalBlocker, QSize, Qt
from PySide6.QtGui import QIcon, QImage, QPixmap, QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QListView,
    QListWidget,
    QListWidgetItem,
    QStackedWidget,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import Part, column, form, row
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import follow, later, listen
from meshmash_viewer.app.tabs import make_tab
from meshmash_viewer.app.tabs.form import Player
from meshmash_viewer.app.view.style import color_table
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, reversed_map
from meshmash_viewer.model.limits import (
    Limits,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)
from meshmash_viewer.units import distinct_digits

#: Types of the limit policies with their labels; `NoneType` stands for `automatic_limits`.
_POLICIES: dict[str, tuple[type[Any], str]] = {
    "automatic": (NoneType, "Automatic"),
    "symmetric": (SymmetricLimits, "Symmetric about 0"),
    "minmax": (MinMaxLimits, "Minimum to maximum"),
    "percentile": (PercentileLimits, "Percentiles"),
    "locked": (LockedLimits, "Locked"),
}
#: Whether colours are logarithmic, with labels; None if `spans_decades` decides.
_SCALES: dict[str, tuple[bool | None, str]] = {
    "automatic": (None, "Automatic"),
    "linear": (False, "Linear"),
    "log": (True, "Logarithmic"),
}
_KINDS = [kind for kind, _ in _POLICIES.values()]
#: Displayed names by matplotlib's names. The order of the colours is visible in grey and with the
#: three common kinds of colour blindness (Brewer 2003, Moreland 2009; viridis and its family).
DIVERGING = {
    "RdBu_r": "Blue – red",
    "PuOr_r": "Purple – orange",
    "PRGn": "Purple – green",
    "BrBG_r": "Teal – brown",
    "coolwarm": "Cool – warm",
}
SEQUENTIAL = {
    "viridis": "Viridis",
    "cividis": "Cividis",
    "magma": "Magma",
    "inferno": "Inferno",
    "plasma": "Plasma",
    "YlGnBu_r": "Blue – yellow",
}


@lru_cache(maxsize=64)
def swatch_icon(name: str) -> QIcon:
    """Return a strip of a colour map, 56 × 12 logical pixels at twice the resolution."""
    colors = color_table(name, 112).tobytes() * 24
    image = QImage(colors, 112, 24, 448, QImage.Format.Format_RGBA8888)
    picture = QPixmap.fromImage(image)
    picture.setDevicePixelRatio(2.0)
    return QIcon(picture)


class ColorSection(QWidget):
    """Controls of the colour map, its scale, the policy of its limits, and the limits.

    Typing one limit locks both limits, so that they stay the same when the field changes.
    """

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        #: The displayed field, and its limits.
        self.field: Field | None = None
        self._limits: Limits | None = None
        self._bright_low = False
        self._build()
        events = document.display.events
        colors = events.policies, events.diverging_colormap, events.sequential_colormap
        follow((*colors, events.log_scales, events.kind), self.refresh)
        listen(document.spectrum_changed, self._forget)
        self.refresh()

    def _build(self) -> None:
        self.map_combo = make.combo(
            "colormap_combo", "Colour map", self._choose_map, iconSize=QSize(56, 12)
        )
        self.policy_combo = make.combo(
            "limits_combo",
            "Limits of the colours",
            self._choose_policy,
            {key: text for key, (_, text) in _POLICIES.items()},
        )
        self.scale_combo = make.combo(
            "color_scale_combo",
            "Scale of the colours",
            self._choose_scale,
            {key: text for key, (_, text) in _SCALES.items()},
            tip="Automatic is logarithmic where values are positive and the surface spans more than"
            " two decades, from the 1st to the 99th percentile",
        )
        combos = (
            ("Map", self.map_combo), ("Limits", self.policy_combo), ("Scale", self.scale_combo)
        )  # fmt: skip
        self.fault = make.reserved_note("limits_fault", 1)
        tip = "Give a number to lock the limits"
        self.low = NumberField("limit_low_field", "Low limit", tip=tip)
        self.high = NumberField("limit_high_field", "High limit", tip=tip)
        self.percent_low = self._percent_field("percentile_low_spin", "Low percentile")
        self.percent_high = self._percent_field("percentile_high_spin", "High percentile")
        for low, high, noun, act in (
            (self.low, self.high, "limit", self._lock),
            (self.percent_low, self.percent_high, "percentile", self._choose_percentiles),
        ):
            _keep_in_order(low, high, noun)
            for field in (low, high):
                field.edited.connect(act)
                field.refused.connect(self.fault.setText)
        self.unit_label = make.muted()
        # wide enough for all units, so that the fields do not move
        self.unit_label.setMinimumWidth(self.unit_label.fontMetrics().horizontalAdvance("mm⁻²"))
        both = (self.percent_low,), make.muted("to"), (self.percent_high,)
        self.percentiles = make.holder(row(*both))
        parts: tuple[Part, ...] = (
            row(make.heading("Colour"), (self.fault,)),
            form(*combos, spacing=(theme.GAP, theme.GAP // 2), role="muted"),
            row((self.low,), make.muted("to"), (self.high,), self.unit_label),
            self.percentiles,
        )
        self.setLayout(column(*parts, margins=(theme.MARGIN, 0, theme.MARGIN, theme.MARGIN)))

    def keep_room(self, keep: bool) -> None:
        """Set whether space is reserved for hidden controls, so that the others do not move."""
        make.keep_room(self.percentiles, keep)

    def _percent_field(self, name: str, spoken: str) -> NumberField:
        return NumberField(
            name, spoken, limits=(0.0, 100.0), step=lambda value, steps: value + steps
        )

    # -- from the user ----------------------------------------------------------------------

    def _choose_map(self, row: int) -> None:
        name = self.map_combo.itemData(row)
        if self._is_signed():
            self._document.display.diverging_colormap = name
        else:
            self._document.display.sequential_colormap = name

    def _choose_policy(self, key: str) -> None:
        kind, ends = _POLICIES[key][0], (self._limits or (-1.0, 1.0))[:2]
        policy = kind(*ends) if kind is LockedLimits else kind()
        self._document.display.set_limits(policy, self._key)

    def _choose_scale(self, key: str) -> None:
        self._document.display.set_log_scale(_SCALES[key][0], self._key)

    def _choose_percentiles(self, _value: float) -> None:
        low, high = self.percent_low.value, self.percent_high.value
        if low is not None and high is not None and low < high:
            self._document.display.set_limits(PercentileLimits(low, high), self._key)
        else:
            self.refresh()  # undoes a step beyond the other percentile

    def _lock(self, _value: float) -> None:
        low, high = self.low.value, self.high.value
        if low is not None and high is not None:
            self._document.display.set_limits(LockedLimits(low, high), self._key)

    # -- from the model ---------------------------------------------------------------------

    def set_field(self, field: Field | None, limits: Limits | None) -> None:
        """Set the displayed field and its limits, which are shown by the next `refresh`."""
        self.field, self._limits = field, None if field is None else limits

    def _forget(self) -> None:
        if self._document.spectrum is None:
            self.set_field(None, None)
            self.refresh()

    @property
    def _key(self) -> str:
        """Limits key of the drawn field, or of the displayed family until its field is drawn."""
        family, shown = self._document.display.family, self.field
        is_shown = shown is not None and shown.family.limits_key.partition(":")[0] == family.name
        return shown.family.limits_key if shown is not None and is_shown else family.limits_key

    def _is_signed(self) -> bool:
        shown = self.field
        return self._document.display.family.signed if shown is None else shown.signed

    def refresh(self) -> None:
        display, field, signed = self._document.display, self.field, self._is_signed()
        labelled = field is not None and bool(field.labels)
        unit = "" if field is None else field.unit
        names = DIVERGING if signed else SEQUENTIAL
        chosen = display.diverging_colormap if signed else display.sequential_colormap
        wanted = [*names, *([] if chosen in names else [chosen])]
        bright_low = display.family.bright_low and not signed
        listed = [self.map_combo.itemData(row) for row in range(self.map_combo.count())]
        if (listed, self._bright_low) != (wanted, bright_low):
            self._bright_low = bright_low
            self.map_combo.clear()
            for name in wanted:
                shown = reversed_map(name) if bright_low else name
                self.map_combo.addItem(swatch_icon(shown), names.get(name, name), name)
        self.map_combo.setCurrentIndex(wanted.index(chosen))
        policy = display.policies.get(self._key)
        known = type(policy) in _KINDS
        self.policy_combo.setCurrentIndex(_KINDS.index(type(policy)) if known else 0)
        self.percentiles.setVisible(isinstance(policy, PercentileLimits))
        limits = self._limits
        if isinstance(policy, PercentileLimits):
            self.percent_low.show_value(policy.low, "%", with_unit=True)
            self.percent_high.show_value(policy.high, "%", with_unit=True)
        elif isinstance(policy, LockedLimits) and not (limits and limits.logarithmic):
            limits = Limits(policy.low, policy.high)
        if labelled:  # labels have colours but no limits
            limits = None
        for control in (self.map_combo, self.policy_combo, self.percentiles):
            control.setEnabled(not labelled)
        self.scale_combo.setEnabled(not (labelled or signed))
        scales = [scale for scale, _ in _SCALES.values()]
        self.scale_combo.setCurrentIndex(scales.index(display.log_scales.get(self._key)))
        # the text of the entry includes the automatic scale of this field
        logarithmic = limits is not None and limits.logarithmic
        serves = "logarithmic" if logarithmic else "linear"
        self.scale_combo.setItemText(0, f"Automatic: {serves}")
        low, high = (None, None) if limits is None else limits[:2]
        ends = low or 0.0, high or 0.0
        like = math.sqrt(ends[0] * ends[1]) if logarithmic else max(map(abs, ends))
        digits = distinct_digits(*ends)
        is_typed = self.low.is_typed or self.high.is_typed
        for each, end in ((self.low, low), (self.high, high)):
            if not is_typed:
                each.show_value(end, unit, like=like, digits=digits)
            each.setEnabled(end is not None)
        self.unit_label.setText(self.low.written_unit)
        self.unit_label.setVisible(bool(unit))


def _keep_in_order(low: NumberField, high: NumberField, noun: str) -> None:
    """Make both fields refuse numbers that are not in order."""
    disorder = f"The low {noun} has to be below the high one."
    low.fault = lambda number: "" if high.value is None or number < high.value else disorder
    high.fault = lambda number: "" if low.value is None or number > low.value else disorder


#: Columns of the list of families, and the height of its rows in pixels.
_COLUMNS, _LINE = 2, 28
#: Height of the panel in pixels from which space is reserved for hidden controls.
_ROOMY = 700


class FamilyList(QListWidget):
    """List of the families of fields in two columns."""

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
        super().resizeEvent(event)
        # one pixel narrower, as Qt would wrap a row that fills the whole width
        cell = QSize((self.viewport().width() - 1) // _COLUMNS, _LINE)
        for at in range(self.count()):
            self.item(at).setSizeHint(cell)
        self.setGridSize(cell)

    def _draw(self) -> None:
        for at, family in enumerate(FAMILIES.values()):
            self.item(at).setIcon(theme.icon(family.icon))


class FieldPanel(QWidget):
    """The list of families, the controls of the chosen family, and the colours."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "field_panel", "Field")
        self._document = document
        self._player = Player(document, self)
        self.list = FamilyList()
        self._stack = QStackedWidget()
        self._pages = {name: make_tab(document, family) for name, family in FAMILIES.items()}
        for page in self._pages.values():
            self._stack.addWidget(make.scroll(page))
        self.list.currentRowChanged.connect(self._choose_kind)
        self.hint = make.note("field_hint")
        self.hint.setContentsMargins(theme.MARGIN, 0, theme.MARGIN, theme.GAP)
        self.colors = ColorSection(document)
        parts = (self.list, make.line(), (self._stack,), self.hint, make.line(), self.colors)
        self.setLayout(column(*parts, spacing=0))

        events = document.display.events
        follow(events.kind, self._refresh_tab)
        follow((document.spectrum_changed, document.mesh_changed, events.fields), self._refresh_use)
        self._refresh_tab()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Reserve space for hidden colour controls only in a tall panel."""
        super().resizeEvent(event)
        self.colors.keep_room(self.height() >= _ROOMY)

    def set_field(self, field: Field | None, limits: Limits | None) -> None:
        self.colors.set_field(field, limits)
        later(self._show_field)

    def _show_field(self) -> None:
        self.colors.refresh()
        for page in self._pages.values():
            page.show_field(self.colors.field)

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
        text = "Press Compute: the first eigenfunctions come within seconds."
        if usable or (known is not None and not shown.needs_pairs):  # the page has its own hint
            text = ""
        elif self._document.mesh is None:
            text = "Open a mesh, and compute its eigenpairs to see fields on it."
        make.show_note(self.hint, text)

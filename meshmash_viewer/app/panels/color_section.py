"""Colour map and limits of the field on the render."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, QSize
from PySide6.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import keep_room, reserved_note
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.swatches import DIVERGING, SEQUENTIAL, swatch_icon
from meshmash_viewer.app.listening import follow, later, listen
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

__all__ = ["ColorSection"]

_POLICIES = (
    ("automatic", "Automatic"),
    ("symmetric", "Symmetric about 0"),
    ("minmax", "Minimum to maximum"),
    ("percentile", "Percentiles"),
    ("locked", "Locked"),
)


class ColorSection(QWidget):
    """What colours mean: the map, who decides its two ends, and what they are now.

    Whoever types an end locks both: they then stay when the field changes.
    """

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._signed: bool | None = None
        self._limits: tuple[float, float] | None = None
        self._unit = ""
        self._build()
        follow(document.display.events, self.refresh)
        listen(document.spectrum_changed, self._forget)
        self.refresh()

    def _build(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(theme.MARGIN, 0, theme.MARGIN, theme.MARGIN)
        column.setSpacing(theme.GAP)
        column.addWidget(theme.with_role(QLabel("Colour", self), "heading"))
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GAP)
        grid.setVerticalSpacing(theme.GAP // 2)
        grid.setColumnStretch(1, 1)
        self.map_combo = theme.named(QComboBox(self), "colormap_combo", "Colour map")
        self.map_combo.setIconSize(QSize(56, 12))
        self.map_combo.activated.connect(self._choose_map)
        self.policy_combo = theme.named(QComboBox(self), "limits_combo", "Limits of the colours")
        for key, text in _POLICIES:
            self.policy_combo.addItem(text, key)
        self.policy_combo.activated.connect(self._choose_policy)
        for row, (text, combo) in enumerate(
            (("Map", self.map_combo), ("Limits", self.policy_combo))
        ):
            label = theme.with_role(QLabel(text, self), "muted")
            label.setBuddy(combo)
            grid.addWidget(label, row, 0)
            grid.addWidget(combo, row, 1)
        column.addLayout(grid)
        ends = QHBoxLayout()
        ends.setSpacing(theme.GAP)
        self.low = NumberField("limit_low_field", "Low limit", self)
        self.high = NumberField("limit_high_field", "High limit", self)
        self.low.fault = lambda low: self._fault(low, self.high.value)
        self.high.fault = lambda high: self._fault(self.low.value, high)
        self.unit_label = theme.with_role(QLabel(self), "muted")
        for field in (self.low, self.high):
            field.setToolTip("Give a number to lock the limits")
            field.edited.connect(self._lock)
            field.refused.connect(self._complain)
        ends.addWidget(self.low, 1)
        ends.addWidget(theme.with_role(QLabel("to", self), "muted"))
        ends.addWidget(self.high, 1)
        ends.addWidget(self.unit_label)
        column.addLayout(ends)
        self._build_percentiles(column)
        self.fault = reserved_note("limits_fault", 1)
        column.addWidget(self.fault)

    def _build_percentiles(self, column: QVBoxLayout) -> None:
        self.percentiles = QWidget(self)
        row = QHBoxLayout(self.percentiles)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GAP)
        default = PercentileLimits()
        self.percent_low, self.percent_high = QDoubleSpinBox(self), QDoubleSpinBox(self)
        for spin, name, text, value in (
            (self.percent_low, "percentile_low_spin", "Low percentile", default.low),
            (self.percent_high, "percentile_high_spin", "High percentile", default.high),
        ):
            theme.named(spin, name, text)
            spin.setRange(0.0, 100.0)
            spin.setDecimals(1)
            spin.setSuffix(" %")
            spin.setValue(value)
            spin.setKeyboardTracking(False)
            spin.valueChanged.connect(self._choose_percentiles)
        row.addWidget(self.percent_low, 1)
        row.addWidget(theme.with_role(QLabel("to", self), "muted"))
        row.addWidget(self.percent_high, 1)
        keep_room(self.percentiles)
        column.addWidget(self.percentiles)

    # -- from the person --------------------------------------------------------------------

    def _choose_map(self, row: int) -> None:
        name = self.map_combo.itemData(row)
        if self._is_signed():
            self._document.display.diverging_colormap = name
        else:
            self._document.display.sequential_colormap = name

    def _choose_policy(self, row: int) -> None:
        policies: dict[str, LimitPolicy | None] = {
            "automatic": None,
            "symmetric": SymmetricLimits(),
            "minmax": MinMaxLimits(),
            "percentile": PercentileLimits(),
            "locked": LockedLimits(*(self._limits or (-1.0, 1.0))),
        }
        self._document.display.limits = policies[_POLICIES[row][0]]

    def _choose_percentiles(self, _value: float) -> None:
        low, high = self.percent_low.value(), self.percent_high.value()
        if low < high:
            self._document.display.limits = PercentileLimits(low, high)
        self._complain("" if low < high else "The low percentile has to be below the high one.")

    def _lock(self, _value: float) -> None:
        low, high = self.low.value, self.high.value
        if low is not None and high is not None:
            self._complain("")
            self._document.display.limits = LockedLimits(low, high)

    def _fault(self, low: float | None, high: float | None) -> str:
        disorder = low is not None and high is not None and low >= high
        return "The low limit has to be below the high one." if disorder else ""

    def _complain(self, sentence: str) -> None:
        self.fault.setText(sentence)

    # -- from the model ---------------------------------------------------------------------

    def set_field(self, field: Field | None, limits: tuple[float, float] | None) -> None:
        """Show the limits in force for the field that has arrived; None while there is none."""
        self._signed = None if field is None else field.signed
        self._unit = "" if field is None else field.unit
        self._limits = None if field is None else limits
        later(self.refresh)

    def _forget(self) -> None:
        if self._document.spectrum is None:
            self.set_field(None, None)

    def _is_signed(self) -> bool:
        if self._signed is not None:
            return self._signed
        return self._document.display.family.signed

    def refresh(self) -> None:
        """Show what the model holds."""
        display, signed = self._document.display, self._is_signed()
        names = DIVERGING if signed else SEQUENTIAL
        chosen = display.diverging_colormap if signed else display.sequential_colormap
        wanted = [*names, *([] if chosen in names else [chosen])]
        if [self.map_combo.itemData(row) for row in range(self.map_combo.count())] != wanted:
            self.map_combo.clear()
            for name in wanted:
                self.map_combo.addItem(swatch_icon(name), names.get(name, name), name)
        self.map_combo.setCurrentIndex(wanted.index(chosen))
        key = _key(display.limits)
        self.policy_combo.setCurrentIndex([each for each, _ in _POLICIES].index(key))
        self.percentiles.setVisible(key == "percentile")
        if isinstance(display.limits, PercentileLimits):
            for spin, value in (
                (self.percent_low, display.limits.low),
                (self.percent_high, display.limits.high),
            ):
                with QSignalBlocker(spin):
                    spin.setValue(value)
        limits = self._limits
        if isinstance(display.limits, LockedLimits):
            limits = (display.limits.low, display.limits.high)
        self.low.show_value(limits[0] if limits else None, self._unit)
        self.high.show_value(limits[1] if limits else None, self._unit)
        self.low.setEnabled(limits is not None)
        self.high.setEnabled(limits is not None)
        self.unit_label.setText(self._unit)
        self.unit_label.setVisible(bool(self._unit))


def _key(policy: LimitPolicy | None) -> str:
    for kind, key in (
        (SymmetricLimits, "symmetric"),
        (MinMaxLimits, "minmax"),
        (PercentileLimits, "percentile"),
        (LockedLimits, "locked"),
    ):
        if isinstance(policy, kind):
            return key
    return "automatic"

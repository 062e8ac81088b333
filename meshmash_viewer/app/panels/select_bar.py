"""Toolbar of the *Select* tool: its mode, the options of the mode, and the selected area."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import QSize, Qt, QTimer
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QToolBar, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import SELECT_MODES, Actions
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.select_tool import SelectTool
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.units import counted, format_quantity

#: Commands to the right of the options.
_COMMANDS = (
    "grow_selection", "shrink_selection", "fill_selection", "invert_selection", "clear_selection",
    "cut",
)  # fmt: skip
#: Milliseconds from a change of the selection until its vertices are counted.
_REST = 120


class SelectBar(QToolBar):
    """Toolbar that is visible while the *Select* tool is active."""

    def __init__(self, document: Document, tool: SelectTool, actions: Actions) -> None:
        super().__init__("Select")
        theme.named(self, "select_bar", "Selecting vertices")
        self.setMovable(False)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.setIconSize(QSize(1, 1))
        self.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
        self._document, self._tool = document, tool
        modes = {mode: text for mode, (text, _) in SELECT_MODES.items()}
        self.mode_combo = make.combo("select_mode", "How to select", tool.select_with, modes)
        self.addWidget(self.mode_combo)
        self.radius = NumberField("select_radius", "Radius of the brush", step=_scaled)
        self.radius.edited.connect(tool.set_radius)
        self.radius.setFixedWidth(110)
        self.through = make.check(
            "Through", "select_through", "Select hidden vertices, too",
            lambda on: setattr(tool, "through", on),
            tip="Also select vertices that are hidden by others",
        )  # fmt: skip
        self.low, self.high = (
            NumberField(f"select_{name}", text, tip=f"{text}; – for none")
            for name, text in (
                ("low", "Lower end of the range"),
                ("high", "Upper end of the range"),
            )
        )
        self.low.fault = lambda low: self._fault(low, self._tool.range[1])
        self.high.fault = lambda high: self._fault(self._tool.range[0], high)
        self.low.edited.connect(lambda low: tool.set_range(low, tool.range[1]))
        self.high.edited.connect(lambda high: tool.set_range(tool.range[0], high))
        for field in (self.low, self.high):
            field.setFixedWidth(110)
            field.refused.connect(self._say)
        self.connected = make.check(
            "Connected", "select_alike_connected", "Only the part connected with the pin",
            tool.set_connected,
            tip="Select only vertices connected with the pinned vertex",
        )  # fmt: skip
        to = make.muted(" Up to ")
        #: Controls of each mode.
        self._of_modes: dict[str, tuple[QWidget, ...]] = {
            "brush": (make.muted(" Radius "), self.radius),
            "lasso": (self.through,),
            "value": (make.muted(" From "), self.low, to, self.high),
            "alike": (to, self.high, self.connected),
        }
        shown = dict.fromkeys(each for group in self._of_modes.values() for each in group)
        self._places: dict[QWidget, QAction] = {each: self.addWidget(each) for each in shown}
        self.addSeparator()
        for name in _COMMANDS:
            self.addAction(actions[name])
        self.addSeparator()
        self.count_label = make.label("select_count", "What is selected", selectable=True)
        self.addWidget(self.count_label)  # last, so that its width does not move the commands
        tool.changed.connect(self._refresh)
        tool.changed.connect(self._count_soon)
        #: Delay before counting, so that vertices are not counted at each move of a stroke.
        self._rest = QTimer(self, singleShot=True, interval=_REST)
        self._rest.timeout.connect(self._count)
        listen((document.selection.changed, document.mesh_changed), self._count_soon)
        self._refresh()
        self._count()

    def _refresh(self) -> None:
        tool = self._tool
        self.setVisible(tool.on)
        self.mode_combo.setCurrentIndex(self.mode_combo.findData(tool.mode))
        self.mode_combo.setToolTip(SELECT_MODES[tool.mode][1])
        for widget, place in self._places.items():
            place.setVisible(widget in self._of_modes.get(tool.mode, ()))
        self.radius.bounds = 0.0, math.inf
        self.radius.show_value(tool.radius, self._document.unit, with_unit=True)
        field = tool.field
        unit, like = ("", None) if field is None else (field.unit, field.size)
        for each, end in zip((self.low, self.high), tool.range, strict=True):
            value = end if math.isfinite(end) else None
            each.show_value(value, unit, with_unit=True, like=like)

    def _fault(self, low: float, high: float) -> str:
        return "" if low <= high else "The lower end has to be below the upper one."

    def _say(self, sentence: str) -> None:
        if sentence:
            self._document.notices.say(sentence, Severity.WARNING)

    def _count_soon(self) -> None:
        if not self._rest.isActive():
            self._rest.start()

    def _count(self) -> None:
        mesh, mask = self._document.mesh, self._document.selection.mask
        if not self._tool.on:
            return
        if mesh is None or mask is None:
            self.count_label.setText(" Nothing selected ")
            return
        chosen = np.flatnonzero(mask)  # usually few vertices
        texts = [counted(len(chosen), "vertex")]
        if self._tool.prepared:
            texts.append(format_quantity(float(mesh.vertex_areas[chosen].sum()), mesh.unit, 2, 4))
        self.count_label.setText(f" {' · '.join(texts)} ")


def _scaled(value: float, steps: int) -> float:
    return float(value * 1.1**steps)

"""Functions that make the labels, buttons, fields and layouts of panels and dialogs.

`name` is the ``objectName``, for scripts and tests, and `spoken` the name for screen readers.
`act` is called when the user operates the control. Further keyword arguments are passed to the
constructor of Qt's widget.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, TypeVar

from PySide6.QtCore import QSignalBlocker, QSize, Qt, Signal, SignalInstance
from PySide6.QtGui import QColor, QGuiApplication, QIcon, QPixmap
from PySide6.QtWidgets import (
    QAbstractButton,
    QBoxLayout,
    QButtonGroup,
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QPushButton,
    QScrollArea,
    QSlider,
    QSpinBox,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.number_field import WholeField

#: An item of a row or column. None is empty space that grows; an item in a tuple grows, too.
Part: TypeAlias = QWidget | QLayout | tuple[QWidget | QLayout] | None
Margins: TypeAlias = tuple[int, int, int, int]
Box = TypeVar("Box", bound=QBoxLayout)

#: Margins of the contents of a panel: left, top, right, bottom.
PANEL = theme.MARGIN, theme.MARGIN, theme.MARGIN, theme.GAP


def row(*parts: Part, spacing: int = theme.GAP, margins: Margins = (0, 0, 0, 0)) -> QHBoxLayout:
    """Lay parts out from left to right."""
    return _filled(QHBoxLayout(), parts, spacing, margins)


def column(*parts: Part, spacing: int = theme.GAP, margins: Margins = (0, 0, 0, 0)) -> QVBoxLayout:
    """Lay parts out from top to bottom."""
    return _filled(QVBoxLayout(), parts, spacing, margins)


def grid(
    *rows: tuple[QWidget | QLayout | None, ...],
    spacing: tuple[int, int] = (theme.GAP, theme.GAP // 2),
) -> QGridLayout:
    """Lay rows of parts out in a grid, whose second column grows.

    A single part in a row spans all columns; None leaves a cell empty. `spacing` is between
    columns, then between rows.
    """
    box = QGridLayout()
    box.setContentsMargins(0, 0, 0, 0)
    box.setHorizontalSpacing(spacing[0])
    box.setVerticalSpacing(spacing[1])
    box.setColumnStretch(1, 1)
    widest = max(map(len, rows))
    for at, parts in enumerate(rows):
        for place, part in enumerate(parts):
            span = widest if len(parts) == 1 else 1
            if isinstance(part, QLayout):
                box.addLayout(part, at, place, 1, span)
            elif part is not None:
                box.addWidget(part, at, place, 1, span)
    return box


def form(
    *rows: tuple[str, QWidget | QLayout],
    spacing: tuple[int, int] = (theme.MARGIN, theme.GAP),
    role: str = "",
) -> QFormLayout:
    """Lay parts out from top to bottom, each to the right of a label; `role` styles the labels."""
    box = QFormLayout()
    box.setContentsMargins(0, 0, 0, 0)
    box.setHorizontalSpacing(spacing[0])
    box.setVerticalSpacing(spacing[1])
    box.setLabelAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
    box.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    for text, part in rows:
        name = theme.with_role(QLabel(text), role)
        if isinstance(part, QLayout):
            box.addRow(name, part)
        else:
            name.setBuddy(part)
            box.addRow(name, part)
    return box


def holder(layout: QLayout) -> QWidget:
    """Make a widget with a layout, so that its parts can be hidden together."""
    made = QWidget()
    made.setLayout(layout)
    return made


def _filled(box: Box, parts: tuple[Part, ...], spacing: int, margins: Margins) -> Box:
    box.setContentsMargins(*margins)
    box.setSpacing(spacing)
    for part in parts:
        if part is None:
            box.addStretch(1)
            continue
        inner, grows = (part[0], 1) if isinstance(part, tuple) else (part, 0)
        if isinstance(inner, QLayout):
            box.addLayout(inner, grows)
        else:
            box.addWidget(inner, grows)
    return box


Act: TypeAlias = Callable[..., object] | SignalInstance
ButtonType = TypeVar("ButtonType", bound=QAbstractButton)


def label(
    name: str, spoken: str = "", text: str = "", *, selectable: bool = False, **given: Any
) -> QLabel:
    """Make a label with a name; its text can be copied if `selectable`."""
    role, tip = given.pop("role", ""), given.pop("tip", "")
    made = QLabel(text, **given)
    if selectable:
        made.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return theme.named(made, name, spoken, role=role, tip=tip)


def offer_copy(made: QLabel, whole: Callable[[], str] | None = None) -> None:
    """Add a context menu that copies the selected text, or else `whole`, by default the text."""

    def copy() -> None:
        QGuiApplication.clipboard().setText(made.selectedText() or (whole or made.text)())

    made.addAction("Copy", copy)
    made.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)


def muted(text: str = "", **given: Any) -> QLabel:
    """Make a label in muted colour, such as the name before a field."""
    return theme.with_role(QLabel(text, **given), "muted")


def heading(text: str) -> QLabel:
    """Make the title of a section."""
    return theme.with_role(QLabel(text), "heading")


def line() -> QFrame:
    """Make a line between sections."""
    return theme.with_role(QFrame(), "line")


def button(
    text: str, name: str, spoken: str, act: Act, *, role: str = "", tip: str = "", **given: Any
) -> QPushButton:
    """Make a button that calls `act` on a click."""
    return _clicked(QPushButton(text, **given), name, spoken, act, role, tip)


def icon_button(name: str, spoken: str, act: Act, *, tip: str = "", size: int = 12) -> QToolButton:
    """Make a button without text; the caller sets its icon, in the colours of the theme."""
    made = _clicked(QToolButton(), name, spoken, act, "", tip)
    made.setIconSize(QSize(size, size))
    return made


def _clicked(made: ButtonType, name: str, spoken: str, act: Act, role: str, tip: str) -> ButtonType:
    made.clicked.connect(act)
    return theme.named(made, name, spoken, role=role, tip=tip)


def check(text: str, name: str, spoken: str, act: Act | None = None, *, tip: str = "") -> QCheckBox:
    """Make a check box that calls `act` with its state."""
    made = theme.named(QCheckBox(text), name, spoken, tip=tip)
    if act is not None:
        made.toggled.connect(act)
    return made


def combo(
    name: str,
    spoken: str,
    act: Callable[..., object] | None = None,
    entries: Mapping[str, str] | None = None,
    *,
    tip: str = "",
    **given: Any,
) -> QComboBox:
    """Make a combo box that calls `act` when the user chooses an entry.

    The argument is the key of the entry in `entries`, or the row number without `entries`.
    """
    made = theme.named(QComboBox(**given), name, spoken, tip=tip)
    for data, text in (entries or {}).items():
        made.addItem(text, data)
    if act is not None and entries:
        made.activated.connect(lambda row: act(made.itemData(row)))
    elif act is not None:
        made.activated.connect(act)
    return made


def spin(
    name: str, spoken: str, act: Act | None = None, *, tip: str = "", **given: Any
) -> WholeField:
    """Make a field for a whole number that calls `act` with the number after typing."""
    made = theme.named(WholeField(**given), name, spoken, tip=tip)
    if act is not None:
        made.valueChanged.connect(act)
    return made


def scroll(content: QWidget) -> QScrollArea:
    """Make a scroll area for the contents of a panel; the area itself never takes the focus."""
    area = QScrollArea(widgetResizable=True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    area.setWidget(theme.named(content, "panel_content"))
    return area


def dot(color: str) -> QIcon:
    """Make the icon of a list entry: a square of one colour."""
    picture = QPixmap(12, 12)
    picture.fill(QColor(color))
    return untinted(picture)


def untinted(picture: QPixmap) -> QIcon:
    """Make an icon that keeps its colours in a selected row."""
    made = QIcon(picture)
    made.addPixmap(picture, QIcon.Mode.Selected)
    return made


class Segments(QWidget):
    """Exclusive buttons with the object names ``<name>_<key>``.

    `choices` maps keys to texts; `in_row` is the number of buttons in a row.
    """

    #: Key of the button that the user clicked.
    chosen = Signal(str)

    def __init__(self, name: str, spoken: str, choices: dict[str, str], in_row: int = 8) -> None:
        super().__init__()
        theme.named(self, name, spoken)
        group = QButtonGroup(self)
        self._buttons: dict[str, QPushButton] = {}
        for key, text in choices.items():
            self._buttons[key] = button(
                text,
                f"{name}_{key}",
                f"{spoken}: {text}",
                lambda _on=False, key=key: self.chosen.emit(key),
                role="segment",
                checkable=True,
            )
            group.addButton(self._buttons[key])
        buttons = list(self._buttons.values())
        starts = range(0, len(buttons), in_row)
        rows = (row(*buttons[start : start + in_row], spacing=4) for start in starts)
        self.setLayout(column(*rows, spacing=4))

    def set_text(self, key: str, text: str) -> None:
        self._buttons[key].setText(text)
        self._buttons[key].setAccessibleName(f"{self.accessibleName()}: {text}")

    def show_key(self, key: str) -> None:
        """Check the button of a key without emitting `chosen`."""
        self._buttons[key].setChecked(True)


def note(name: str, role: str = "muted") -> QLabel:
    """Make a hidden label with wrapped text; see `show_note`."""
    label = theme.named(QLabel(wordWrap=True), name, role=role)
    label.hide()
    return label


def keep_room(widget: QWidget, keep: bool = True) -> None:
    """Reserve the space of a widget while it is hidden, so that other widgets do not move."""
    policy = widget.sizePolicy()
    policy.setRetainSizeWhenHidden(keep)
    widget.setSizePolicy(policy)


def reserved_note(
    name: str, lines: int, role: str = "warning", accessible: str = "Remark"
) -> QLabel:
    """Make a label with space for `lines` lines, so that no widget moves when its text changes."""
    label = theme.named(QLabel(wordWrap=True), name, accessible, role=role)
    label.setMinimumHeight(lines * label.fontMetrics().lineSpacing() + 4)
    label.setAlignment(Qt.AlignmentFlag.AlignTop)
    return label


class Facts(QWidget):
    """Rows of a name and a selectable value; `rows` maps object names of values to names."""

    def __init__(self, rows: dict[str, str]) -> None:
        super().__init__()
        self._values = {
            name: label(name, text, "–", selectable=True, role="value")
            for name, text in rows.items()
        }
        cells = zip(map(muted, rows.values()), self._values.values(), strict=True)
        self.setLayout(grid(*cells, spacing=(theme.GAP * 2, 4)))

    def show_value(self, name: str, text: str) -> None:
        """Show a value, or a dash if the text is empty."""
        self._values[name].setText(text or "–")

    def show_values(self, texts: Mapping[str, str]) -> None:
        """Show all values, and a dash for each missing value."""
        for name in self._values:
            self.show_value(name, texts.get(name, ""))


def show_note(label: QLabel, text: str) -> None:
    """Show a sentence in a `note`; hide the note if the sentence is empty."""
    if label.text() != text:
        label.setText(text)
    if label.isHidden() == bool(text):  # `isVisible` is always false in a hidden tab
        label.setVisible(bool(text))


def show_quietly(
    control: QSpinBox | QDoubleSpinBox | QSlider | QAbstractButton,
    value: float,
    most: int | None = None,
    least: int = 0,
) -> None:
    """Show a value without emitting signals; with `most`, set the range of the control first."""
    with QSignalBlocker(control):
        if isinstance(control, QAbstractButton):
            control.setChecked(bool(value))
        elif isinstance(control, QDoubleSpinBox):
            control.setValue(value)
        else:
            if most is not None:
                control.setRange(least, most)
            control.setValue(int(value))

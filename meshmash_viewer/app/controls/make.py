"""Labels, buttons and fields, and how they are laid out, as the whole window has them.

The `name` of each is its ``objectName``, for scripts and tests; `spoken` is what screen readers
call it. Further keywords go to the constructor of Qt's widget.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, TypeVar

from PySide6.QtCore import QSignalBlocker, QSize, Qt, Signal, SignalInstance
from PySide6.QtGui import QColor, QIcon, QPixmap
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

#: What a row or a column holds; None takes the room that is left, a part in a tuple grows.
Part: TypeAlias = QWidget | QLayout | tuple[QWidget | QLayout] | None
Margins: TypeAlias = tuple[int, int, int, int]
Box = TypeVar("Box", bound=QBoxLayout)

#: Margins of the contents of a panel: left, top, right, bottom.
PANEL = theme.MARGIN, theme.MARGIN, theme.MARGIN, theme.GAP


def row(*parts: Part, spacing: int = theme.GAP, margins: Margins = (0, 0, 0, 0)) -> QHBoxLayout:
    """Put parts side by side."""
    return _filled(QHBoxLayout(), parts, spacing, margins)


def column(*parts: Part, spacing: int = theme.GAP, margins: Margins = (0, 0, 0, 0)) -> QVBoxLayout:
    """Put parts under each other."""
    return _filled(QVBoxLayout(), parts, spacing, margins)


def grid(
    *rows: tuple[QWidget | QLayout | None, ...],
    spacing: tuple[int, int] = (theme.GAP, theme.GAP // 2),
) -> QGridLayout:
    """Put rows of parts under each other, with a second column that grows.

    A part alone spans all columns, None leaves a cell empty; `spacing` is that of columns and rows.
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
    """Put parts under each other, each after its label, which has a role."""
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
    """A widget with a layout, whose parts come and go together."""
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
    """A label that scripts can find; `selectable` where its text can be copied."""
    role, tip = given.pop("role", ""), given.pop("tip", "")
    made = QLabel(text, **given)
    if selectable:
        made.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return theme.named(made, name, spoken, role=role, tip=tip)


def muted(text: str = "", **given: Any) -> QLabel:
    """An explanation, such as what is before a field."""
    return theme.with_role(QLabel(text, **given), "muted")


def heading(text: str) -> QLabel:
    """What a section is called."""
    return theme.with_role(QLabel(text), "heading")


def line() -> QFrame:
    """A line between sections."""
    return theme.with_role(QFrame(), "line")


def button(
    text: str, name: str, spoken: str, act: Act, *, role: str = "", tip: str = "", **given: Any
) -> QPushButton:
    """A button, and what a click on it does."""
    return _clicked(QPushButton(text, **given), name, spoken, act, role, tip)


def icon_button(name: str, spoken: str, act: Act, *, tip: str = "", size: int = 12) -> QToolButton:
    """A button without a text, whose icon is drawn by the caller, who knows the colours."""
    made = _clicked(QToolButton(), name, spoken, act, "", tip)
    made.setIconSize(QSize(size, size))
    return made


def _clicked(made: ButtonType, name: str, spoken: str, act: Act, role: str, tip: str) -> ButtonType:
    made.clicked.connect(act)
    return theme.named(made, name, spoken, role=role, tip=tip)


def check(text: str, name: str, spoken: str, act: Act | None = None, *, tip: str = "") -> QCheckBox:
    """A box to tick, and what takes whether it is ticked."""
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
    """A list of which one is chosen, and what takes the choice of a person.

    That is the key of the entry, or the number of its row where there are no `entries`.
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
    """A whole number, and what takes it once it is typed."""
    made = theme.named(WholeField(**{"keyboardTracking": False, **given}), name, spoken, tip=tip)
    if act is not None:
        made.valueChanged.connect(act)
    return made


def scroll(content: QWidget) -> QScrollArea:
    """An area in which the contents of a panel scroll; it takes no focus, but follows theirs."""
    area = QScrollArea(widgetResizable=True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    area.setWidget(theme.named(content, "panel_content"))
    return area


def dot(color: str) -> QIcon:
    """A colour as the icon of an entry."""
    picture = QPixmap(12, 12)
    picture.fill(QColor(color))
    return untinted(picture)


def untinted(picture: QPixmap) -> QIcon:
    """An icon that is the same in a selected row."""
    made = QIcon(picture)
    made.addPixmap(picture, QIcon.Mode.Selected)
    return made


class Segments(QWidget):
    """Buttons ``<name>_<key>`` of which one is on; `choices` are texts by key, so many in a row."""

    #: The user chose this key.
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
        """Turn a key on without emitting `chosen`."""
        self._buttons[key].setChecked(True)


def note(name: str, role: str = "muted") -> QLabel:
    """A line of explanation that wraps, and takes no room while it is empty."""
    label = theme.named(QLabel(), name, role=role)
    label.setWordWrap(True)
    label.setVisible(False)
    return label


def keep_room(widget: QWidget, keep: bool = True) -> None:
    """Leave what is around a widget where it is while that is hidden."""
    policy = widget.sizePolicy()
    policy.setRetainSizeWhenHidden(keep)
    widget.setSizePolicy(policy)


def reserved_note(
    name: str, lines: int, role: str = "warning", accessible: str = "Remark"
) -> QLabel:
    """A text that wraps, whose room is kept, so that nothing moves when it has something to say."""
    label = theme.named(QLabel(wordWrap=True), name, accessible, role=role)
    label.setMinimumHeight(lines * label.fontMetrics().lineSpacing() + 4)
    label.setAlignment(Qt.AlignmentFlag.AlignTop)
    return label


class Facts(QWidget):
    """Rows of a name and a value that can be copied; `rows` are names by object name of values."""

    def __init__(self, rows: dict[str, str]) -> None:
        super().__init__()
        selectable = Qt.TextInteractionFlag.TextSelectableByMouse
        self._values = {
            name: theme.named(
                QLabel("–", textInteractionFlags=selectable), name, text, role="value"
            )
            for name, text in rows.items()
        }
        muted = (theme.with_role(QLabel(text), "muted") for text in rows.values())
        both = zip(muted, self._values.values(), strict=True)
        self.setLayout(grid(*both, spacing=(theme.GAP * 2, 4)))

    def show_value(self, name: str, text: str) -> None:
        """Show a value; an empty one becomes a dash."""
        self._values[name].setText(text or "–")

    def show_values(self, texts: Mapping[str, str]) -> None:
        """Show all values; those that are left out become a dash."""
        for name in self._values:
            self.show_value(name, texts.get(name, ""))


def show_note(label: QLabel, text: str) -> None:
    """Say a sentence in a `note`, or nothing, which takes no room."""
    if label.text() != text:
        label.setText(text)
    # of a hidden tab nothing is visible: ask the flag, not the screen
    if label.isHidden() == bool(text):
        label.setVisible(bool(text))


def show_quietly(
    control: QSpinBox | QDoubleSpinBox | QSlider | QAbstractButton,
    value: float,
    most: int | None = None,
    least: int = 0,
) -> None:
    """Show a value, in a range from `least` to `most`, in a control that does not speak of it."""
    with QSignalBlocker(control):
        if isinstance(control, QAbstractButton):
            control.setChecked(bool(value))
        elif isinstance(control, QDoubleSpinBox):
            control.setValue(value)
        else:
            if most is not None:
                control.setRange(least, most)
            control.setValue(int(value))

"""Labels, buttons and fields, each with all that it needs: its text, names, tip, and what it does.

The `name` of each is its ``objectName``, for scripts and tests; `spoken` is what screen readers
call it. Further keywords go to the constructor of Qt's widget.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, TypeVar

from PySide6.QtCore import QSize, Qt, Signal, SignalInstance
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import (
    QAbstractButton,
    QButtonGroup,
    QCheckBox,
    QComboBox,
    QFrame,
    QLabel,
    QPushButton,
    QScrollArea,
    QToolButton,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import column, row
from meshmash_viewer.app.controls.spin import WholeField

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
        """Change the text of a key."""
        self._buttons[key].setText(text)
        self._buttons[key].setAccessibleName(f"{self.accessibleName()}: {text}")

    def show_key(self, key: str) -> None:
        """Turn a key on without emitting `chosen`."""
        self._buttons[key].setChecked(True)

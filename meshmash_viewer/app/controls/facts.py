"""Names and values in two columns, and the ways numbers are written in the panels."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QAbstractButton, QDoubleSpinBox, QLabel, QSlider, QSpinBox, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import grid


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

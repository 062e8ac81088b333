"""Fields with arrows for whole and for decimal numbers: what is typed is taken whole or refused.

Qt's own pass over the keys that would lead out of bounds: of "99999" a field up to 2,929 keeps 999.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QFocusEvent, QKeyEvent, QValidator
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QSpinBox, QWidget

from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_whole
from meshmash_viewer.units import format_range

if TYPE_CHECKING:

    class _Spin(QAbstractSpinBox):
        def value(self) -> Any: ...
        def prefix(self) -> str: ...
        def suffix(self) -> str: ...
        def textFromValue(self, value: Any) -> str: ...

else:
    _Spin = object

#: Decimals that a number may be typed with.
_DECIMALS = 6


def show_refusal(field: QWidget, sentence: str) -> None:
    """Show why a field refuses what was typed, or, if empty, that it does so no longer.

    The innermost parent with a method `say_refusal` shows it, as windows and dialogs do.
    """
    parent = field.parentWidget()
    while parent is not None and not hasattr(parent, "say_refusal"):
        parent = parent.parentWidget()
    if parent is not None:
        parent.say_refusal(sentence)


def typed_fields(within: QWidget) -> list[WholeField | DecimalField]:
    """All fields of these two kinds within a widget."""
    return [*within.findChildren(WholeField), *within.findChildren(DecimalField)]


class _Typed(_Spin):
    """What both have in common: anything can be typed, and is read once it is finished."""

    #: Whether what was typed has been refused by the event that is being handled.
    just_refused: bool
    #: What it held before someone began to type.
    _before: Any

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.just_refused, self._before, self._fault = False, None, ""
        self.lineEdit().textEdited.connect(self._note_before)

    def validate(self, text: str, at: int) -> tuple[QValidator.State, str, int]:
        """Let anything be typed; what is no number within bounds is not taken."""
        try:
            self._read(text)
        except InputError:
            return QValidator.State.Intermediate, text, at
        return QValidator.State.Acceptable, text, at

    def valueFromText(self, text: str) -> Any:
        return self._read(text)

    def fixup(self, text: str) -> str:
        """Go back to what was and say why: Qt asks this of what is finished and not acceptable."""
        try:
            self._read(text)
        except InputError as fault:
            self.just_refused, self._fault = True, str(fault)
            QTimer.singleShot(0, self, self._say_refusal)  # once it has gone back
            before = self.value() if self._before is None else self._before
            return f"{self.prefix()}{self.textFromValue(before)}{self.suffix()}"
        return text

    def focusInEvent(self, event: QFocusEvent) -> None:
        self._before = None
        super().focusInEvent(event)

    def stepBy(self, steps: int) -> None:
        """Step from what is typed, or from what was."""
        super().stepBy(steps)
        self._before = None
        self._forget_refusal()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Keep Return here where what it finishes is refused, to be typed over."""
        super().keyPressEvent(event)
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._before = None
            if self.just_refused:
                event.accept()
                self.selectAll()

    def _note_before(self) -> None:
        if self._before is None:
            self._before = self.value()  # Qt takes what is typed after this
        self._forget_refusal()

    def commit(self) -> bool:
        """Take what is typed, or say why not and go back; whether there was nothing to refuse."""
        self.interpretText()
        return not self.just_refused

    def _say_refusal(self) -> None:
        self.just_refused = False
        show_refusal(self, self._fault)

    def _forget_refusal(self) -> None:
        if self._fault and not self.just_refused:
            self._fault = ""
            show_refusal(self, "")

    def _bare(self, text: str) -> str:
        """A text without suffixes: one may be typed before the other."""
        text, suffix = text.strip().removeprefix(self.prefix()), self.suffix().strip()
        while suffix and text.endswith(suffix):
            text = text.removesuffix(suffix).rstrip()
        return text

    def _read(self, text: str) -> Any:
        raise NotImplementedError


class WholeField(_Typed, QSpinBox):
    """A whole number between bounds."""

    def _read(self, text: str) -> int:
        name = self.accessibleName() or "The number"
        return parse_whole(self._bare(text), self.minimum(), self.maximum(), name)


class DecimalField(_Typed, QDoubleSpinBox):
    """A number between bounds, written with at least so many decimals; its suffix is its unit."""

    def __init__(self, *, decimals: int, **given: Any) -> None:
        self._decimals = decimals
        super().__init__(decimals=_DECIMALS, **given)

    def textFromValue(self, value: float) -> str:
        """The number with no more zeros than it has to have."""
        whole, _, part = f"{value:.{_DECIMALS}f}".partition(".")
        return f"{whole}.{part.rstrip('0'):0<{self._decimals}}".rstrip(".")

    def _read(self, text: str) -> float:
        text, unit = self._bare(text), self.suffix().strip()
        number, low, high = parse_number(text, unit), self.minimum(), self.maximum()
        if not low <= number <= high:
            between = format_range(low, high, unit, word="and")
            name = self.accessibleName() or "The number"
            raise InputError(f"{name} is between {between}, not {text}.")
        return number

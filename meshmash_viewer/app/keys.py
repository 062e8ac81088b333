"""Names of keys as the operating system writes them: ⌘O on macOS, Ctrl+O elsewhere."""

from __future__ import annotations

import re

from PySide6.QtGui import QKeySequence

#: How texts name keys, and a sequence that holds each.
_MODIFIERS = {"Ctrl": "Ctrl+A", "Shift": "Shift+A", "Alt": "Alt+A"}
_NAMES = {"PgDn": "PgDown", "PgUp": "PgUp", "Esc": "Esc"}


def native_keys(*sequences: QKeySequence | str) -> str:
    """Write sequences of keys, in Qt's portable form if they are texts, with commas between."""
    return ", ".join(_native(QKeySequence(each)) for each in sequences)


def native_text(text: str) -> str:
    """Write the keys in a text, "Ctrl + wheel" or "PgDn", as the operating system does."""
    for name, sequence in _MODIFIERS.items():
        native = _native(QKeySequence(sequence)).removesuffix("A").rstrip("+")
        text = re.sub(rf"\b{name}(?= \+)", native, text)
    for name, sequence in _NAMES.items():
        native = _native(QKeySequence(sequence))
        text = re.sub(rf"\b{name}\b", native, text)
    return text


def _native(sequence: QKeySequence) -> str:
    return sequence.toString(QKeySequence.SequenceFormat.NativeText)

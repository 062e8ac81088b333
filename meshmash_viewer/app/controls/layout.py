"""Rows, columns and grids of controls, at the distances that the whole window keeps."""

from __future__ import annotations

from typing import TypeAlias, TypeVar

from PySide6.QtWidgets import QBoxLayout, QGridLayout, QHBoxLayout, QLayout, QVBoxLayout, QWidget

from meshmash_viewer.app import theme

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

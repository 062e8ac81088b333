"""Going one on or back in whatever is on the render."""

from __future__ import annotations

from meshmash_viewer.fields.sweep import FAR
from meshmash_viewer.model.document import Document

__all__ = ["advance", "go_to_end", "go_to_start", "step"]


def step(document: Document, steps: int) -> bool:
    """Move on by some steps, or back by a negative number; stops at the ends.

    Says whether it moved: not at the end already, nor with nothing to step through.
    """
    spectrum, display = document.known, document.display
    if spectrum is None or (display.family.needs_pairs and not len(spectrum)):
        return False
    moved = display.family.step(spectrum, steps)
    if moved == display.family:
        return False
    display.put(moved)
    return True


def go_to_start(document: Document) -> None:
    """Go to the first eigenfunction or column, or the shortest time."""
    step(document, -FAR)


def go_to_end(document: Document) -> None:
    """Go to the last eigenfunction that is known, the last column, or the longest time."""
    step(document, FAR)


def advance(document: Document) -> None:
    """One step of playing: on, and from the end to the start again."""
    if not step(document, 1):
        go_to_start(document)

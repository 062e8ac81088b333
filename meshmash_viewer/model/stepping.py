"""Steps through the eigenfunctions, columns or times of the displayed family."""

from __future__ import annotations

from meshmash_viewer.fields.sweep import FAR
from meshmash_viewer.model.document import Document


def step(document: Document, steps: int) -> bool:
    """Move by a number of steps, negative for back, at most to the ends.

    Returns False if the position has not changed.
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
    """Move one step on, and from the end to the start."""
    if not step(document, 1):
        go_to_start(document)

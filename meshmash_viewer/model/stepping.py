"""Going one on or back in whatever is on the render: eigenfunction, time or band."""

from __future__ import annotations

import math

from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.ranges import first_nonzero, hks_range, hks_time

__all__ = ["advance", "go_to_end", "go_to_start", "step"]


def step(document: Document, steps: int) -> bool:
    """Move on by some steps, or back by a negative number; stops at the ends.

    Parameters
    ----------
    document : Document
    steps : int
        Eigenfunctions or bands; for HKS, times of the exported scales.

    Returns
    -------
    bool
        Whether it moved: not at the end already, nor with nothing to step through.
    """
    spectrum, display = document.spectrum, document.display
    if spectrum is None or len(spectrum) == 0:
        return False
    if display.kind is FieldKind.EIGENFUNCTION:
        index = _moved(display.index, steps, len(spectrum))
        moved = index != display.index
        display.index = index
        return moved
    if display.kind is FieldKind.BAND:
        band = _moved(display.band, steps, display.band_count)
        moved = band != display.band
        display.band = band
        return moved
    if display.kind is FieldKind.HKS and first_nonzero(spectrum) < len(spectrum):
        t_min, t_max = hks_range(spectrum, display)
        before = hks_time(spectrum, display)
        far = steps / max(display.hks_scales - 1, 1) * math.log(t_max / t_min)
        log_time = min(max(math.log(before) + far, math.log(t_min)), math.log(t_max))
        if abs(log_time - math.log(before)) > 1e-9:
            display.time = math.exp(log_time)
            return True
    return False


def go_to_start(document: Document) -> None:
    """Go to the first eigenfunction or band, or the shortest time."""
    step(document, -_far(document))


def go_to_end(document: Document) -> None:
    """Go to the last eigenfunction that is known, the last band, or the longest time."""
    step(document, _far(document))


def advance(document: Document) -> None:
    """One step of playing: on, and from the end to the start again."""
    if not step(document, 1):
        go_to_start(document)


def _moved(position: int, steps: int, length: int) -> int:
    return min(max(position + steps, 0), length - 1)


def _far(document: Document) -> int:
    display, spectrum = document.display, document.spectrum
    if spectrum is None:
        return 0
    return len(spectrum) + display.band_count + 100 * display.hks_scales + display.index

"""The positions of a family in a row: the columns that a gallery or a film goes through."""

from __future__ import annotations

from bisect import bisect_left

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.units import counted

#: Families with positions to go through, by name.
SWEPT: dict[str, type[Family]] = {
    name: family for name, family in FAMILIES.items() if family.position
}
#: Farther than any family goes.
FAR = 1_000_000_000
#: More columns than anybody looks through; a family without an end is cut off here.
_MOST = 1 << 20
#: Milliseconds that a column of a film is shown where its family is not played.
_PAUSE = 250
#: Frames of the longest film: more than an hour.
_MOST_FRAMES = 100_000


def n_columns(family: Family, spectrum: Spectrum) -> int:
    """Number of positions that `Family.step` goes through; 1 where there is nothing to step."""
    first = family.step(spectrum, -FAR)

    def is_last(column: int) -> bool:
        here = first.step(spectrum, column)
        return here.step(spectrum, 1) == here

    return bisect_left(range(_MOST - 1), True, key=is_last) + 1


def chosen_columns(text: str, most: int) -> range:
    """Columns that "START:STOP:STEP" means among so many, as in Python; each may be left out.

    Raises
    ------
    InputError
        If it is not written so, or names none of them or one that there is not.
    """
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if not 1 <= len(parts) <= 3 or (len(parts) == 1 and numbers[0] is None):
            raise ValueError
    except ValueError:
        raise InputError(
            f"{text!r} does not say which columns: write START:STOP or START:STOP:STEP, such as"
            " 0:32:4, or one number."
        ) from None
    start, stop, step = (*numbers, None, None)[:3]
    if len(parts) == 1 and start is not None:
        stop = start + 1
    start, stop, step = start or 0, most if stop is None else stop, 1 if step is None else step
    if step < 1 or start < 0 or stop <= start:
        raise InputError(f"{text!r} names no column: count up from 0, to a later one.")
    if stop > most:
        raise InputError(
            f"{text!r} goes beyond the {counted(most, 'column')}: the last that STOP may be is"
            f" {most}."
        )
    return range(start, stop, step)


def evenly(most: int, count: int) -> range:
    """About so many of the columns, evenly spread and the first of them among these."""
    return range(0, most, -(-most // count))


def sweep(
    family: Family, spectrum: Spectrum, columns: range, frames: int | None = None
) -> list[Family]:
    """The family at some of its columns, or at so many places from the first of them to the last.

    Parameters
    ----------
    family : Family
    spectrum : Spectrum
    columns : range
        Counted from 0, see `n_columns`; not empty.
    frames : int, optional
        None for one each column.

    Raises
    ------
    InputError
        If there are more frames than different fields.
    """
    first = family.step(spectrum, -FAR)
    if frames is None or frames == len(columns):
        return [first.step(spectrum, column) for column in columns]
    ends = [first.step(spectrum, column) for column in (columns[0], columns[-1])]
    low, high = (end.place(spectrum) for end in ends)
    way = high - low
    places = [low + way * frame / max(frames - 1, 1) for frame in range(frames)]
    found = [first.at_place(spectrum, place) for place in places]
    if len(set(found)) < frames:
        raise InputError(
            f"{counted(frames, 'frame')} are more than the {counted(len(columns), 'column')} that"
            " they would show: choose fewer seconds, a lower rate or more columns."
        )
    return found


def film(
    family: Family,
    spectrum: Spectrum,
    columns: range,
    rate: float | None = None,
    seconds: float | None = None,
) -> tuple[list[Family], float]:
    """A sweep as frames of a film: of each frame its field, and the number of frames a second.

    Parameters
    ----------
    family : Family
    spectrum : Spectrum
    columns : range
        See `sweep`.
    rate : float, optional
        Frames a second; None takes that at which the family is played, or the lower one at which
        its columns last as long as they should.
    seconds : float, optional
        None shows every column once.

    Raises
    ------
    InputError
        If there are more frames than different fields.
    """
    usual = 1000.0 / (family.interval or _PAUSE)
    if seconds is None:
        return sweep(family, spectrum, columns), rate or usual
    try:
        return sweep(family, spectrum, columns, n_frames(rate or usual, seconds)), rate or usual
    except InputError:
        if rate is not None:
            raise
    return sweep(family, spectrum, columns), len(columns) / seconds


def n_frames(rate: float, seconds: float) -> int:
    """How many frames a film has.

    Raises
    ------
    InputError
        If there are none, or more than anybody looks at.
    """
    frames = rate * seconds
    if not (rate > 0.0 and seconds > 0.0 and frames <= _MOST_FRAMES):
        raise InputError(
            f"{seconds:g} s at {rate:g} frames a second are no film: choose both above 0, and up to"
            f" {_MOST_FRAMES:,} frames."
        )
    return max(round(frames), 1)

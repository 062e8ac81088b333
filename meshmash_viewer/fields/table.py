"""Table of families of fields, and sequences of their positions for galleries and movies.

Window, export, command line, session files and the copied script use this table. To add a family,
add its module to this folder and its class to `_LISTED`; its controls are made from its parameters.
Other packages add families by entry points.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.bank_columns import FEATURES as FEATURES
from meshmash_viewer.fields.bank_columns import BankColumns, BankFamily
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.sihks import ScaleInvariantHKS
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.plug_ins import plug_ins, warn
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted

_LISTED: tuple[type[Family], ...] = (
    Eigenfunctions,
    HeatKernelSignature,
    GeometryVectors,
    WaveKernelSignature,
    ScaleInvariantHKS,
    Filters,
    Similarity,
    Distances,
    OwnMaps,
)


def _check_plug_in(name: str, family: type[BankColumns]) -> None:
    if not (isinstance(family, type) and issubclass(family, BankColumns)):
        raise TypeError("it is not a subclass of BankColumns")
    texts = [getattr(family, each, None) for each in ("name", "label", "short", "tip", "export")]
    if texts[0] != name or not all(isinstance(each, str) and each for each in texts):
        raise TypeError("its name is not that of its entry point, or a text is missing")
    options = any(each.option for each in family.declared().values())
    if options or family.export in {each.export for each in _LISTED}:
        raise TypeError("it has options, or is exported as another family is")
    some = np.arange(8.0)
    made = family(index=0, count=3).bank(some)(some)
    if made.shape != (3, 8):
        raise TypeError(f"its bank makes shape {made.shape} of 3 columns and 8 eigenvalues")


#: Families by name, in the order of the window; the first one is the default.
FAMILIES: dict[str, type[Family]] = {family.name: family for family in _LISTED}
for _plug_in in plug_ins("fields", FAMILIES, _check_plug_in).values():
    try:
        FAMILIES[_plug_in.name] = _plug_in.load()
    except InputError as _fault:
        warn(_fault)

FEATURES.update((name, each) for name, each in FAMILIES.items() if issubclass(each, BankFamily))

_WRITTEN = (*FEATURES.values(), *FAMILIES.values())

#: Families by kind of export, features before eigenpairs.
EXPORTS: dict[str, type[Family]] = {each.export: each for each in _WRITTEN if each.export}


# -- galleries and movies -------------------------------------------------------------------------

#: Families with several positions, by name.
SWEPT: dict[str, type[Family]] = {
    name: family for name, family in FAMILIES.items() if family.position
}
#: Number of steps that reaches the end of any family.
FAR = 1_000_000_000
#: Maximum number of columns, for families whose steps have no end.
_MOST = 1 << 20
#: Milliseconds per column in movies of families without `interval`.
_PAUSE = 250
#: Maximum number of frames of a movie, more than an hour.
_MOST_FRAMES = 100_000


def n_columns(family: Family, spectrum: Eigenpairs) -> int:
    """Count the positions that `Family.step` visits; 1 if there are no steps."""
    first = family.step(spectrum, -FAR)

    def is_last(column: int) -> bool:
        here = first.step(spectrum, column)
        return here.step(spectrum, 1) == here

    return bisect_left(range(_MOST - 1), True, key=is_last) + 1


def chosen_columns(text: str, most: int) -> range:
    """Parse "START:STOP:STEP" as in Python, for `most` columns; each part may be left out.

    `InputError` is raised if the syntax is wrong, no column is selected, or a selected column does
    not exist.
    """
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if not 1 <= len(parts) <= 3 or (len(parts) == 1 and numbers[0] is None):
            raise ValueError
    except ValueError:
        remedy = "write START:STOP or START:STOP:STEP, such as 0:32:4, or one number"
        raise InputError("out-of-range", f"{text!r} is not a range of columns", remedy) from None
    start, stop, step = (*numbers, None, None)[:3]
    if len(parts) == 1 and start is not None:
        stop = start + 1
    start, stop, step = start or 0, most if stop is None else stop, 1 if step is None else step
    if step < 1 or start < 0 or stop <= start:
        fault = f"{text!r} selects no column"
        raise InputError("out-of-range", fault, "give START from 0, and below STOP")
    if stop > most:
        fault = f"{text!r} goes beyond the {counted(most, 'column')}"
        raise InputError("out-of-range", fault, f"give STOP up to {most}")
    return range(start, stop, step)


def evenly(most: int, count: int) -> range:
    """Select about `count` columns, evenly spaced from the first one."""
    return range(0, most, -(-most // count))


def sweep(
    family: Family, spectrum: Eigenpairs, columns: range, frames: int | None = None
) -> list[Family]:
    """Return the family at the given columns, or at `frames` positions from first to last column.

    `InputError` is raised if there are more frames than different fields.
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
        what = (
            f"{counted(frames, 'frame')} are more than the {counted(len(columns), 'column')} shown"
        )
        raise InputError("too-many", what, "choose fewer seconds or more columns")
    return found


def film(
    family: Family,
    spectrum: Eigenpairs,
    columns: range,
    rate: float | None = None,
    seconds: float | None = None,
) -> tuple[list[Family], float]:
    """Return the fields of the frames of a movie, and the number of frames per second.

    The default rate follows from `Family.interval`, and is lower if there are too few columns for
    `seconds`. Without `seconds`, every column is shown once. `InputError` is raised if there are
    more frames than different fields.
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
    """Return the number of frames of a movie.

    `InputError` is raised for invalid numbers and for too many frames.
    """
    frames = rate * seconds
    if not (rate > 0.0 and seconds > 0.0 and frames <= _MOST_FRAMES):
        fault = f"Duration is {seconds:g} s and frame rate {rate:g}/s"
        remedy = f"give positive ones, with at most {_MOST_FRAMES:,} frames"
        raise InputError("out-of-range", fault, remedy)
    return max(round(frames), 1)

"""Exceptions as sentences: what the person can mend, and what is a defect of the program."""

from __future__ import annotations

import traceback
from dataclasses import dataclass

from psygnal import EmitLoopError

from meshmash_viewer.errors import InputError, missing_module, not_installed, printable

__all__ = ["Failure", "failure_of"]

#: Characters of an exception's own words that a sentence repeats.
_WORDS = 160


@dataclass(frozen=True)
class Failure:
    """Why something failed.

    Parameters
    ----------
    text : str
        One sentence for the message bar.
    details : str
        For the copy button; empty where the sentence says it all.
    mendable : bool
        Whether what was given is at fault, not the program.
    """

    text: str
    details: str = ""
    mendable: bool = False


def failure_of(fault: BaseException, doing: str = "") -> Failure:
    """What to say of an exception, and of what was being done: "Writing bunny.npz"."""
    while isinstance(fault, EmitLoopError) and fault.__cause__ is not None:
        fault = fault.__cause__  # what a listener of the model raised
    if isinstance(fault, InputError):
        return Failure(str(fault), mendable=True)
    if missing := missing_module(fault):
        return Failure(f"This needs {not_installed(missing)}.", mendable=True)
    details = "".join(traceback.format_exception(fault))
    if isinstance(fault, MemoryError):
        text = "Memory ran out: ask for fewer eigenpairs, or close other programs."
        return Failure(text, details, mendable=True)
    if isinstance(fault, OSError) and fault.strerror:
        named = f"{fault.filename}: " if fault.filename else ""
        text = f"{named}{fault.strerror}; free the disk, or choose another folder."
        return Failure(text, details, mendable=True)
    named = f"{type(fault).__name__}: {printable(fault, _WORDS)}".rstrip(": ")
    what = f"{doing} failed by a defect of the program" if doing else "A defect of the program"
    remedy = "" if doing else "; what is open stays as it is, and the details can be copied"
    return Failure(f"{what} ({named}){remedy}.", details)

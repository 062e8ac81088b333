"""Exceptions as sentences: faults that the user can correct, and defects of the program."""

from __future__ import annotations

import traceback
from dataclasses import dataclass

from psygnal import EmitLoopError

from meshmash_viewer.errors import InputError, missing_module, not_installed, printable

#: Most characters of an exception's message that a sentence repeats.
_WORDS = 160


@dataclass(frozen=True)
class Failure:
    """Reason of a failure: one sentence for the message bar."""

    text: str
    #: Traceback for the copy button.
    details: str = ""
    #: Whether the input or the machine is at fault, not the program.
    correctable: bool = False


def failure_of(fault: BaseException, doing: str = "") -> Failure:
    """Describe an exception; `doing` is what failed, such as "Writing bunny.npz"."""
    while isinstance(fault, EmitLoopError) and fault.__cause__ is not None:
        fault = fault.__cause__  # raised by a slot connected to the model
    if isinstance(fault, InputError):
        return Failure(str(fault), correctable=True)
    if missing := missing_module(fault):
        return Failure(f"This needs {not_installed(missing)}.", correctable=True)
    details = "".join(traceback.format_exception(fault))
    if isinstance(fault, MemoryError):
        text = "Memory ran out: ask for fewer eigenpairs, or close other programs."
        return Failure(text, details, correctable=True)
    if isinstance(fault, OSError) and fault.strerror:
        named = f"{fault.filename}: " if fault.filename else ""
        text = f"{named}{fault.strerror}; free the disk, or choose another folder."
        return Failure(text, details, correctable=True)
    named = f"{type(fault).__name__}: {printable(fault, _WORDS)}".rstrip(": ")
    what = f"{doing} failed by a defect of the program" if doing else "A defect of the program"
    remedy = "" if doing else "; what is open stays as it is, and the details can be copied"
    return Failure(f"{what} ({named}){remedy}.", details)

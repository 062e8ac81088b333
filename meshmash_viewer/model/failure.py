"""Exceptions as sentences: faults that the user can correct, and defects of the program."""

from __future__ import annotations

import contextlib
import datetime
import os
import platform
import sys
import traceback
from dataclasses import dataclass
from importlib import metadata

from psygnal import EmitLoopError

from meshmash_viewer.errors import InputError, missing_module, not_installed, printable
from meshmash_viewer.folders import log_folder

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


#: Packages whose versions a report lists.
PACKAGES = ("meshmash-viewer", "numpy", "scipy", "numba", "vtk", "pyvista", "PySide6-Essentials")


def report_defect(fault: BaseException) -> str:
    """Write the details of a defect to a file in the user's log folder, and say where they are.

    The result ends a sentence: "a defect of the program (KeyError: 3); details are in …".
    """
    what = " ".join(f"{type(fault).__name__}: {fault}".split())[:200].rstrip(": ")
    moment = datetime.datetime.now().strftime("%Y%m%d-%H%M%S-%f")
    with contextlib.suppress(OSError):  # a full disk must not hide the defect
        folder = log_folder()
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"defect-{moment}-{os.getpid()}.txt"
        details = [" ".join(sys.argv), versions(), "", *traceback.format_exception(fault)]
        path.write_text("\n".join(details), encoding="utf-8", errors="replace")
        return (
            f"a defect of the program ({what}); please report it with the details, which are in"
            f" {path}"
        )
    place = traceback.extract_tb(fault.__traceback__)[-1:]
    at = f" at {place[0].name}, line {place[0].lineno}" if place else ""
    return f"a defect of the program ({what}{at}); please report it."


def package_version(package: str) -> str:
    """Return the version of a package, or "not installed"."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def versions() -> str:
    """Return the versions that a bug report needs, in one line."""
    parts = [f"{name.removesuffix('-Essentials')} {package_version(name)}" for name in PACKAGES]
    return " · ".join([*parts, f"Python {platform.python_version()}", platform.platform()])

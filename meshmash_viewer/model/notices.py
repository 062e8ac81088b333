"""Notices for the message bar, descriptions of exceptions, and reports of the system."""

from __future__ import annotations

import contextlib
import datetime
import errno
import os
import platform
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import metadata

from psygnal import EmitLoopError, Signal

from meshmash_viewer.errors import InputError, missing_module, package_missing, printable
from meshmash_viewer.io.atomic import log_folder


class Severity(StrEnum):
    """Severity of a notice, which determines its colour and duration."""

    INFORMATION = "information"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class Notice:
    """One sentence for the message bar."""

    #: The sentence, and its severity.
    text: str
    severity: Severity = Severity.INFORMATION
    #: Text that the button "Copy details" copies.
    details: str = ""
    #: Function that the button calls; `button` is the text of the button.
    action: Callable[[], object] | None = None
    button: str = "Undo"
    #: Whether the notice disappears after some seconds although it has a button.
    brief: bool = False
    #: Function that returns whether the cause still exists; if not, the notice is withdrawn. For
    #: the default see `Notices.show`.
    holds: Callable[[], bool] | None = None


class Notices:
    """The notices of a document; the message bar shows each emitted by ``shown``."""

    shown = Signal(object)

    def __init__(self) -> None:
        #: The last notice, until it is withdrawn.
        self.last: Notice | None = None
        #: Number of meshes that were shown and jobs that were requested.
        self._turn = 0

    def show(self, notice: Notice) -> None:
        """Show a notice in the message bar while `Notice.holds` returns True.

        Without `Notice.holds`, warnings, errors and notices with a button that are not
        `Notice.brief` stay until another mesh is shown or another job is requested. Other notices
        disappear after some seconds.
        """
        offers = notice.action is not None and not notice.brief
        lasting = notice.severity is not Severity.INFORMATION or offers
        if notice.holds is None and lasting:
            turn = self._turn
            notice = replace(notice, holds=lambda: self._turn == turn)
        self.last = notice
        self.shown.emit(notice)

    def say(self, text: str, severity: Severity = Severity.INFORMATION) -> None:
        """Show a sentence in the message bar."""
        self.show(Notice(text, severity))

    def begin_turn(self) -> None:
        """Count that another mesh is shown or another job is requested."""
        self._turn += 1

    def review(self) -> None:
        """Withdraw the last notice if its cause no longer exists, by emitting `shown` with None."""
        notice = self.last
        if notice is not None and notice.holds is not None and not notice.holds():
            self.last = None
            self.shown.emit(None)


# -- exceptions -----------------------------------------------------------------------------------

#: Largest number of characters of an exception's message in a sentence.
_WORDS = 160


@dataclass(frozen=True)
class Failure:
    """Reason of a failure: one sentence for the message bar."""

    text: str
    #: Traceback for the copy button.
    details: str = ""
    #: Whether the input or the machine caused the failure, not a defect of the program.
    correctable: bool = False
    #: The `InputError.code`, if any.
    code: str = ""


#: Remedies for exceptions of the operating system, by error number.
_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free the disk, or choose another folder"),
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS),
        "give yourself permission, or choose another folder",
    ),
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR), "check the name and its folder"),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), "close other programs or windows"),
    errno.ENOMEM: "close other programs",
    errno.EIO: "check the disk and its cable or network, and copy the file elsewhere",
}


def _remedy(fault: OSError) -> str:
    return _REMEDIES.get(fault.errno or 0, "try again, and check the disk and the network")


def failure_of(fault: BaseException, doing: str = "") -> Failure:
    """Describe an exception; `doing` is the failed action, such as "Writing bunny.npz"."""
    while isinstance(fault, EmitLoopError) and fault.__cause__ is not None:
        fault = fault.__cause__  # raised by a slot connected to the model
    if isinstance(fault, InputError):
        return Failure(str(fault), correctable=True, code=fault.code)
    if missing := missing_module(fault):
        return Failure(str(package_missing("This needs", missing)), correctable=True)
    details = "".join(traceback.format_exception(fault))
    if isinstance(fault, MemoryError):
        text = "Memory ran out: ask for fewer eigenpairs, or close other programs."
        return Failure(text, details, correctable=True)
    if isinstance(fault, OSError) and fault.strerror:
        named = fault.filename or doing or "The system reports"
        text = f"{named}: {fault.strerror}; {_remedy(fault)}."
        return Failure(text, details, correctable=True)
    named = f"{type(fault).__name__}: {printable(fault, _WORDS)}".rstrip(": ")
    what = f"{doing} failed by a defect of the program" if doing else "A defect of the program"
    remedy = "" if doing else "; the open meshes are unchanged, and the details can be copied"
    return Failure(f"{what} ({named}){remedy}.", details)


def notice_of(failure: Failure) -> Notice:
    """Return the notice of a failure; its details include versions for a bug report."""
    details = f"{failure.details}\n{versions()}" if failure.details else ""
    return Notice(failure.text, Severity.ERROR, details)


#: Packages whose versions a bug report lists.
PACKAGES = ("meshmash-viewer", "numpy", "scipy", "numba", "vtk", "pyvista", "PySide6-Essentials")


def report_defect(fault: BaseException) -> str:
    """Write the details of a defect to the user's log folder; return a clause with their path."""
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


#: Further packages that the system report lists.
_MORE = ("robust_laplacian", "pymetis", "trimesh", "nibabel", "pyarrow", "pyvistaqt", "pyqtgraph")


def system_report(graphics: str) -> str:
    """Describe versions, memory, cores, the graphics driver and the store of eigenpairs."""
    import scooby

    from meshmash_viewer.fields import FAMILIES  # noqa: F401  loads their plug-ins
    from meshmash_viewer.io import read, writers  # noqa: F401
    from meshmash_viewer.io.cache import EigenpairCache
    from meshmash_viewer.plug_ins import known_plug_ins
    from meshmash_viewer.spectral import cost

    cache = EigenpairCache()
    stores = len(cache.stores())
    kept = f"{cost.written_bytes(cache.size())} of {stores} decompositions in {cache.root}"
    packages = [(name, package_version(name)) for name in (*PACKAGES, *_MORE)]
    more = [("Graphics", graphics), ("Eigenpairs kept", kept), *packages]
    for each in known_plug_ins():
        with contextlib.suppress(InputError):
            each.load()
        said = str(each.fault or f"{each.name} of {each.package}")
        more.append((f"Plug-in, {each.group}", said))
    report = scooby.Report(core=[], optional=[], ncol=1, text_width=100, extra_meta=more)
    return str(report).strip()

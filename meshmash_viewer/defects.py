"""Reports of defects of the program: one sentence for the user, and a file with details."""

from __future__ import annotations

import contextlib
import datetime
import os
import platform
import sys
import traceback
from importlib import metadata

from meshmash_viewer.folders import log_folder

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

"""Checks that a display and OpenGL are available.

Without a display Qt aborts the process, even a notebook kernel, so the checks precede Qt's start.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path

from PySide6.QtCore import QLibraryInfo
from PySide6.QtGui import QGuiApplication, QOffscreenSurface, QOpenGLContext

from meshmash_viewer.errors import InputError

#: Qt platforms on Linux whose windows can use OpenGL.
_DRAWN = ("xcb", "wayland", "wayland-egl", "wayland-brcm", "eglfs")
#: The oldest version of OpenGL that VTK supports.
_OPENGL = (3, 2)
#: Seconds to wait until a platform has opened its display.
_PATIENCE = 30.0
_NO_WINDOW = "use the commands that need no window (see --help)"
#: Program of a child process that opens the display. No core dump is written if Qt aborts it.
_PROBE = """
import resource
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
from PySide6.QtGui import QGuiApplication
QGuiApplication([])
"""


@contextmanager
def open_display() -> Iterator[None]:
    """Select a Qt platform that works, and keep the display open while Qt is started.

    An X11 server that loses its only client may restart, and reject the next client.

    `InputError` is raised if there is no display, or the display does not respond.
    """
    with ExitStack() as held:
        if sys.platform.startswith("linux"):
            _choose_platform(held)
        yield


def _choose_platform(held: ExitStack) -> None:
    """Set QT_QPA_PLATFORM to the first platform that works."""
    asked = os.environ.get("QT_QPA_PLATFORM", "")
    # X11 first: Wayland does not allow a program to choose the position of its windows
    offered = {"xcb": "DISPLAY", "wayland": "WAYLAND_DISPLAY"}
    names = [name for name, variable in offered.items() if os.environ.get(variable)]
    faults = []
    for name in asked.split(";") if asked else names:
        fault = _fault(name.partition(":")[0], held)
        if not fault:
            os.environ["QT_QPA_PLATFORM"] = asked or name
            return
        faults.append(fault)
    why = f" ({'; '.join(faults)})" if faults else ""
    fault = f"No display is available for a window{why}"
    raise InputError("no-display", fault, f"{_NO_WINDOW}, or run it under xvfb-run")


def check_opengl() -> None:
    """Raise `InputError` if windows have no OpenGL, or a version older than 3.2."""
    if not has_opengl():
        found = ".".join(map(str, _version())) or "none"
        raise InputError(
            "no-opengl",
            f"The render needs OpenGL 3.2, and windows get {found} here (platform"
            f" {QGuiApplication.platformName()})",
            f"install a driver, such as Mesa's (libgl1-mesa-dri), or {_NO_WINDOW}",
        )


def has_opengl() -> bool:
    """Return whether windows have OpenGL 3.2 or newer."""
    return _version() >= _OPENGL


@cache
def _version() -> tuple[int, ...]:
    """Return the version of OpenGL that windows have; empty without OpenGL."""
    if sys.platform.startswith("linux") and QGuiApplication.platformName() not in _DRAWN:
        return ()  # some of these platforms abort the process when a context is made
    context, surface = QOpenGLContext(), QOffscreenSurface()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        return ()
    version = tuple(context.format().version())
    context.doneCurrent()
    return version


def _fault(platform: str, held: ExitStack) -> str:
    """Return the reason why no window can be opened on a platform; "" if a window can be opened."""
    if platform not in _DRAWN:
        return f"QT_QPA_PLATFORM={platform} draws no window"
    if platform == "xcb":
        return _fault_of_x(held)
    environment = {**os.environ, "QT_QPA_PLATFORM": platform}
    command = [sys.executable, "-c", _PROBE]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=_PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return f"{platform} does not answer"
    named = f"WAYLAND_DISPLAY={os.environ.get('WAYLAND_DISPLAY', '')}"
    place = named if platform.startswith("wayland") else platform
    return f"{place} does not answer" if done.returncode else ""


def _fault_of_x(held: ExitStack) -> str:
    """Return the reason why the library xcb cannot open the display, or ""; takes under 1 ms."""
    plugins = Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.PluginsPath))
    plugin = plugins / "platforms" / "libqxcb.so"
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
        if plugin.exists():
            ctypes.CDLL(str(plugin))  # the error message names the missing library
    except OSError as fault:
        return f"Qt's xcb lacks a library: {fault}"
    for name in ("xcb_connect", "xcb_get_setup"):
        getattr(xcb, name).restype = ctypes.c_void_p
    screen = ctypes.c_int()
    connection = ctypes.c_void_p(xcb.xcb_connect(None, ctypes.byref(screen)))
    held.callback(xcb.xcb_disconnect, connection)
    if not xcb.xcb_connection_has_error(connection):
        setup = ctypes.c_void_p(xcb.xcb_get_setup(connection))
        if screen.value < xcb.xcb_setup_roots_length(setup):
            return ""
    return f"DISPLAY={os.environ.get('DISPLAY', '')} does not answer"

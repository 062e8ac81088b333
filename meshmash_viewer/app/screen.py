"""The screen: whether windows can be opened on it, and whether they get OpenGL.

Qt ends the process where it finds no display, a notebook's kernel too, so this is found out first.
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

#: Platforms of Qt on Linux whose windows can have OpenGL.
_DRAWN = ("xcb", "wayland", "wayland-egl", "wayland-brcm", "eglfs")
#: The oldest version that VTK draws with.
_OPENGL = (3, 2)
#: Seconds that a platform may take to answer.
_PATIENCE = 30.0
#: Run in a process of its own, which leaves no image of its memory when Qt ends it.
_PROBE = """
import resource
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
from PySide6.QtGui import QGuiApplication
QGuiApplication([])
"""


@contextmanager
def open_display() -> Iterator[None]:
    """Hold the display on which Qt is then started, on the platform that answers.

    Held, because a server of X11 that loses its only client may start anew, and refuse the next.

    `InputError` is raised if there is no display, or it does not answer.
    """
    with ExitStack() as held:
        if sys.platform.startswith("linux"):
            _choose_platform(held)
        yield


def _choose_platform(held: ExitStack) -> None:
    asked = os.environ.get("QT_QPA_PLATFORM", "")
    # X11 first: its window managers place windows where the program asks
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
    raise InputError(
        f"There is no display to open a window on{why}; use the commands that need none (see"
        " --help), or run it under xvfb-run."
    )


def check_opengl() -> None:
    """Complain if windows of the application get no OpenGL that the render can use.

    `InputError` is raised if there is none, or an older one than 3.2.
    """
    if not has_opengl():
        found = ".".join(map(str, _version())) or "none"
        raise InputError(
            f"The render needs OpenGL 3.2, and windows get {found} here (platform"
            f" {QGuiApplication.platformName()}): install a driver, such as Mesa's for the"
            " processor (libgl1-mesa-dri), or use the commands that need no window (see --help)."
        )


def has_opengl() -> bool:
    """Whether windows of the application get an OpenGL that the render can use."""
    return _version() >= _OPENGL


@cache
def _version() -> tuple[int, ...]:
    """Of the OpenGL that windows get; empty if they get none."""
    if sys.platform.startswith("linux") and QGuiApplication.platformName() not in _DRAWN:
        return ()  # to ask some of them ends the process
    context, surface = QOpenGLContext(), QOffscreenSurface()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        return ()
    version = tuple(context.format().version())
    context.doneCurrent()
    return version


def _fault(platform: str, held: ExitStack) -> str:
    """Why a platform of Qt opens no window, in some words; empty if it does."""
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
    """Why X11 opens no window: asked by its own library, which costs less than a millisecond."""
    plugins = Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.PluginsPath))
    plugin = plugins / "platforms" / "libqxcb.so"
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
        if plugin.exists():
            ctypes.CDLL(str(plugin))  # names the library that it lacks
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

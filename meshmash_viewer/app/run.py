"""Start of the application, for a file or a mesh in memory, and handling of uncaught exceptions."""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import platformdirs
from PySide6.QtCore import QEvent, QEventLoop, QObject, Qt, QThread, QTimer, Signal
from PySide6.QtGui import QFileOpenEvent, QFont, QSurfaceFormat
from PySide6.QtWidgets import QApplication, QMessageBox

from meshmash_viewer.app import theme
from meshmash_viewer.app.screen import check_opengl, open_display
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.notices import Failure, Notice, failure_of, notice_of

if TYPE_CHECKING:
    from meshmash_viewer.app.main_window import MainWindow
    from meshmash_viewer.mesh import MeshLike

#: Modules of large libraries, imported in a thread: they define no subclasses of Qt classes.
_LIBRARIES = ("pyvista.plotting", "meshmash_viewer.app.view.figure")
#: Modules that define subclasses of Qt classes, imported in the interface thread. PySide reads its
#: table of classes without the interpreter lock, so that a class defined in another thread
#: sometimes crashed the process.
_WIDGETS = (
    "meshmash_viewer.app.view.mesh_view",
    "meshmash_viewer.app.panels.spectrum_panel",
    "meshmash_viewer.app.panels.profile_panel",
    "meshmash_viewer.app.panels.field_panel",
)
#: Seconds during which a repeated exception, such as an exception at every frame, is shown once.
_ONCE = 2.0
#: Free bytes on disk below which Mesa's shader cache is disabled.
_ROOM_FOR_SHADERS = 100e6
#: Options of glibc, and the size in bytes from which freed blocks are returned to the system. It is
#: larger than a field of a million vertices, allocated at every tick, and smaller than a picture.
_M_MMAP_THRESHOLD, _M_TRIM_THRESHOLD, _LARGE_BLOCK = -3, -1, 6 << 20
#: The application made by this module, kept alive by this reference.
_made: list[QApplication] = []
#: The collector that replaces Python's automatic collection; its timer runs until the process ends.
_collectors: list[Any] = []
#: Windows opened by `view`, kept alive until they are closed.
_windows: dict[int, MainWindow] = {}


def application() -> QApplication:
    """Return the application of this process; if there is none, make and style it.

    `InputError` is raised if there is no display.
    """
    existing = QApplication.instance()
    if isinstance(existing, QApplication):
        return existing
    _draw_without_a_full_disk()
    # all widgets use the profile that VTK requires, because their contexts share resources
    core = QSurfaceFormat()
    core.setProfile(QSurfaceFormat.OpenGLContextProfile.CoreProfile)
    core.setVersion(3, 2)
    QSurfaceFormat.setDefaultFormat(core)
    _give_memory_back()
    with open_display():
        made = Application(sys.argv[:1] or ["meshmash-viewer"])
    made.setApplicationName("meshmash-viewer")
    made.setApplicationDisplayName("")
    made.setDesktopFileName("meshmash-viewer")
    made.setWindowIcon(theme.application_icon())
    if made.font().pointSizeF() < 9.0:
        font = QFont(made.font())
        font.setPointSizeF(9.0)
        made.setFont(font)
    theme.apply(made)
    _made.append(made)
    return made


def _give_memory_back() -> None:
    """Configure glibc to return large blocks to the system when they are freed.

    By default glibc raises the size threshold whenever a larger block is freed, and its heap
    becomes fragmented: after an hour of pictures and meshes, 0.2 GB of unused memory were not
    returned. Other C libraries are not configured.
    """
    if sys.platform.startswith("linux"):
        option = getattr(ctypes.CDLL(None), "mallopt", None)
        if option is not None:
            option(_M_MMAP_THRESHOLD, _LARGE_BLOCK)
            option(_M_TRIM_THRESHOLD, 2 * _LARGE_BLOCK)


def _draw_without_a_full_disk() -> None:
    """Disable Mesa's shader cache on an almost full disk.

    Mesa maps the cache file into memory, and the process crashes if the file cannot be extended.
    With the cache, the start is a third of a second faster.
    """
    caches = Path(platformdirs.user_cache_dir())
    place = next(folder for folder in (caches, *caches.parents) if folder.exists())
    if shutil.disk_usage(place).free < _ROOM_FOR_SHADERS:
        os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")


def run_app(
    path: Path | None = None, unit: str = "", maps: Sequence[Path] = (), *, fresh: bool = False
) -> int:
    """Show the window, with a mesh or session if given, until closed; return the exit status.

    `unit` is as in `read_mesh`, "" for the unit stated in the file. `maps` are files with values
    per vertex of the mesh. With `fresh`, stored settings are ignored.
    """
    app = application()
    # Ctrl+C in the terminal, or the end of the desktop session, closes the window. The timer calls
    # from the event loop: a loop started after the window was closed would not end.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QTimer.singleShot(0, QApplication.closeAllWindows))
    pulse = QTimer(interval=200)  # Python handles signals only between Python instructions
    pulse.timeout.connect(lambda: None)
    pulse.start()

    from meshmash_viewer.app.main_window import MainWindow

    window = MainWindow(fresh=fresh, deferred=True)
    window.show()
    QTimer.singleShot(0, lambda: load_libraries(window))  # after the window has been painted
    with FaultBoundary(window.document.notices.show):
        if path is not None and (unit or maps):
            window.open_mesh(path, unit, maps)
        elif path is not None:
            window.opening.open_path(path)
        status = app.exec()
    pulse.stop()
    return status


def show_message(text: str) -> None:
    """Show in a message box why no window can be opened, for a user without a console."""
    application()
    QMessageBox.critical(None, "MeshMash Viewer", text)


def view(
    mesh: MeshLike, *, unit: str = "", name: str = "", block: bool | None = None
) -> MainWindow:
    """Open the window on a mesh in memory, from a script or a notebook.

    Parameters
    ----------
    mesh : MeshLike
        ``(vertices, faces)``, a `Mesh`, a ``trimesh.Trimesh`` or a pyvista ``PolyData``.
    unit : str
        Length unit of the coordinates or size of the voxels, as in `read_mesh`.
    name : str
        Name of the mesh in the window.
    block : bool, optional
        Whether to wait until the window is closed. The default is True in a script, and False in a
        notebook, at a prompt (with ``%gui qt``) and in a program whose event loop is running.

    Returns
    -------
    MainWindow
        A script can read and change its `document`. Its `plotter` is a ``pyvista.Plotter`` in mesh
        coordinates, and `to_pyvista` returns the displayed mesh. If a QApplication exists already,
        nothing outside the window is changed.

    Raises
    ------
    InputError
        If `mesh` is invalid, or no display or no OpenGL is available.

    Examples
    --------
    >>> window = mv.view((vertices, faces), unit="um")  # doctest: +SKIP
    """
    from meshmash_viewer.mesh import as_mesh
    from meshmash_viewer.quantities import parse_unit
    from meshmash_viewer.spectral.engine.compiler import check_compiler

    check_compiler()
    taken = as_mesh(mesh)
    if unit:
        taken = taken.in_voxels(*parse_unit(unit))
    if name:
        taken = replace(taken, name=name)
    guest = QApplication.instance() is not None
    application()
    check_opengl()

    from meshmash_viewer.app.main_window import MainWindow

    window = MainWindow()
    window.document.take_mesh(taken)
    window.show()
    key = id(window)
    _windows[key] = window
    # by its key: a function that refers to the window would keep window and mesh in memory
    window.closed.connect(lambda: _forget(key))
    if block is None:
        block = not _has_prompt() and QThread.currentThread().loopLevel() == 0
    if block:
        # not `exec` of the application: it may be running already, and ends with the last window
        loop = QEventLoop()
        window.closed.connect(loop.quit)
        # an application made by the caller handles its exceptions itself
        with nullcontext() if guest else FaultBoundary(window.document.notices.show):
            loop.exec()
    return window


def _forget(key: int) -> None:
    """Delete a window that has been closed."""
    _windows.pop(key).deleteLater()


@atexit.register
def _close_windows() -> None:
    """Close the windows at the end of a script; this ends their child processes."""
    for window in list(_windows.values()):
        window.close()


def _has_prompt() -> bool:
    """Return whether commands can be typed at a Python prompt while the window is open."""
    return hasattr(sys, "ps1") or "IPython" in sys.modules or bool(sys.flags.interactive)


def collect_garbage_when_idle(window: MainWindow) -> None:
    """Collect garbage in the interface thread only, and only among objects made after the imports.

    If another thread freed a Python wrapper of a widget, Qt could abort the process. The imported
    libraries are two hundred thousand permanent objects. Scanning them takes more than a tenth of a
    second, so the objects existing now, and again after the first frame, are frozen.
    """
    from pyqtgraph.util.garbage_collector import GarbageCollector

    _collectors.append(GarbageCollector())
    gc.freeze()
    window.scene.frames.first_drawn.connect(gc.freeze)


def load_libraries(window: MainWindow) -> None:
    """Import large libraries in a thread, then make render and panels of a shown window."""

    def load() -> Exception | None:
        try:
            for name in _LIBRARIES:
                importlib.import_module(name)
        except Exception as fault:  # noqa: BLE001  raised again in `complete`
            return fault
        return None

    def complete(fault: Exception | None) -> None:
        try:
            if fault is not None:
                raise fault
            for name in _WIDGETS:
                importlib.import_module(name)
            window.load()
        except Exception as error:  # noqa: BLE001  shown in the message bar
            _say_missing(window, error)
        else:
            collect_garbage_when_idle(window)

    window.stage.welcome.set_loading("Loading the render …")
    try:
        check_opengl()
    except InputError as fault:
        complete(fault)
    else:
        window.background_io.run("Loading the render", load, complete)


def _say_missing(window: MainWindow, fault: Exception) -> None:
    """Show why the render cannot be loaded."""
    failure = failure_of(fault, "Loading the render")
    if isinstance(fault, ImportError):
        text = f"The render cannot be loaded ({fault}): install what is missing, start again."
        failure = Failure(text, failure.details, correctable=True)
    window.stage.welcome.set_loading("The render could not be loaded; see the message.")
    window.document.notices.show(notice_of(failure))


class Application(QApplication):
    """Application that opens files double-clicked or dropped on the Dock icon on macOS.

    macOS passes these files as events, not as arguments of the program.
    """

    def event(self, event: QEvent) -> bool:
        """Open the file of an event in the active window, or else in the newest window."""
        if isinstance(event, QFileOpenEvent) and event.file():
            from meshmash_viewer.app.main_window import MainWindow

            windows = [each for each in self.topLevelWidgets() if isinstance(each, MainWindow)]
            windows = [each for each in windows if each.isVisible()]
            active = [each for each in windows if each.isActiveWindow()]
            if windows:
                (active or windows)[-1].opening.open_path(Path(event.file()))
                return True
        return super().event(event)


class FaultBoundary(QObject):
    """Context manager that replaces Python's hooks for uncaught exceptions.

    An exception in a slot, an event handler or a thread has no caller that catches it. The hooks
    receive exceptions of all threads. `notify` is called with a `Notice` later, from the event
    loop, because the exception may occur while a widget is being painted.
    """

    _caught = Signal(object)

    def __init__(self, notify: Callable[[Notice], None]) -> None:
        super().__init__()
        self._notify = notify
        self._said: dict[str, float] = {}
        self._before: tuple[Any, ...] = ()
        self._caught.connect(self._say, Qt.ConnectionType.QueuedConnection)

    def __enter__(self) -> FaultBoundary:
        self._before = sys.excepthook, sys.unraisablehook, threading.excepthook
        sys.excepthook = self._take
        sys.unraisablehook = lambda args: self._take(type(args.exc_value), args.exc_value, None)
        threading.excepthook = lambda args: self._take(args.exc_type, args.exc_value, None)
        return self

    def __exit__(self, *_: object) -> None:
        sys.excepthook, sys.unraisablehook, threading.excepthook = self._before

    def _take(self, kind: object, fault: BaseException | None, trace: TracebackType | None) -> None:
        if fault is None or isinstance(fault, SystemExit):
            return
        if isinstance(fault, KeyboardInterrupt):
            self._before[0](type(fault), fault, trace)
            return
        # free the objects in the frames of the last exception, which Python keeps for a debugger
        sys.last_value = sys.last_traceback = None
        self._caught.emit(failure_of(fault))

    def _say(self, failure: Failure) -> None:
        now = time.monotonic()
        if now - self._said.get(failure.text, -_ONCE) < _ONCE:
            return
        self._said = {text: at for text, at in self._said.items() if now - at < _ONCE}
        self._said[failure.text] = now
        self._notify(notice_of(failure))

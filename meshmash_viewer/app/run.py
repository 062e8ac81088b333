"""Start of the application, from the command line or on a mesh in memory, and its faults."""

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

#: Modules of heavy libraries to import in a thread: they define no subclasses of Qt classes.
_LIBRARIES = ("pyvista.plotting", "meshmash_viewer.app.view.mesh_renderer")
#: Modules that define such subclasses, to import in the interface thread. PySide registers each
#: class in a table that it reads without the interpreter lock, so that a class defined in another
#: thread sometimes crashed the process.
_WIDGETS = (
    "meshmash_viewer.app.view.mesh_view",
    "meshmash_viewer.app.panels.spectrum_panel",
    "meshmash_viewer.app.panels.profile_panel",
    "meshmash_viewer.app.panels.field_panel",
)
#: Seconds during which a repeated fault, such as one at every frame, is shown only once.
_ONCE = 2.0
#: Free bytes on disk below which Mesa stores no shaders.
_ROOM_FOR_SHADERS = 100e6
#: Options of glibc, and the size in bytes from which blocks are returned to the system: above that
#: of a field of a million vertices, which is allocated at every tick, below that of a picture.
_M_MMAP_THRESHOLD, _M_TRIM_THRESHOLD, _LARGE_BLOCK = -3, -1, 6 << 20
#: The application, if it was made here: it is deleted with its last reference.
_made: list[QApplication] = []
#: The collector that replaces Python's automatic one; its timer runs as long as the process.
_collectors: list[Any] = []
#: Windows opened by `view`, which keeps the only reference.
_windows: dict[int, MainWindow] = {}


def application() -> QApplication:
    """Return the application of this process; if there is none, make and style it.

    `InputError` is raised if there is no display.
    """
    existing = QApplication.instance()
    if isinstance(existing, QApplication):
        return existing
    _draw_without_a_full_disk()
    # the profile that VTK needs, for all widgets, since their contexts share resources
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

    By default glibc raises the threshold for this with each block freed, and fragments its heap:
    after an hour of pictures and meshes a window held 0.2 GB more than it used. Nothing is done
    with other C libraries.
    """
    if sys.platform.startswith("linux"):
        option = getattr(ctypes.CDLL(None), "mallopt", None)
        if option is not None:
            option(_M_MMAP_THRESHOLD, _LARGE_BLOCK)
            option(_M_TRIM_THRESHOLD, 2 * _LARGE_BLOCK)


def _draw_without_a_full_disk() -> None:
    """Disable Mesa's shader cache on an almost full disk.

    Mesa maps the file of the cache into memory, and the process crashes if it cannot be extended.
    With the cache, a start is a third of a second faster.
    """
    caches = Path(platformdirs.user_cache_dir())
    place = next(folder for folder in (caches, *caches.parents) if folder.exists())
    if shutil.disk_usage(place).free < _ROOM_FOR_SHADERS:
        os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")


def run_app(
    path: Path | None = None, unit: str = "", maps: Sequence[Path] = (), *, fresh: bool = False
) -> int:
    """Open the window, on a mesh or session if given, until it is closed; return the exit status.

    `unit` is as in `read_mesh`, "" for the one that the file states; `maps` are files with values
    per vertex of that mesh. With `fresh`, stored settings are ignored.
    """
    app = application()
    # Ctrl+C in the terminal, or the end of the desktop's session, closes the window; in the event
    # loop, which would not end if the window were closed before the loop runs
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QTimer.singleShot(0, QApplication.closeAllWindows))
    pulse = QTimer(interval=200)  # Python handles signals only while it runs code
    pulse.timeout.connect(lambda: None)
    pulse.start()

    from meshmash_viewer.app.main_window import MainWindow

    window = MainWindow(fresh=fresh, deferred=True)
    window.show()
    QTimer.singleShot(0, lambda: load_libraries(window))  # after it has been painted
    with FaultBoundary(window.document.notices.show):
        if path is not None and (unit or maps):
            window.open_mesh(path, unit, maps)
        elif path is not None:
            window.opening.open_path(path)
        status = app.exec()
    pulse.stop()
    return status


def show_message(text: str) -> None:
    """Show why no window can be opened in a message box, for a user without a console."""
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
        Length unit of its coordinates or size of its voxels, as `read_mesh` takes it.
    name : str
        Name of the mesh in the window.
    block : bool, optional
        Whether to wait until the window is closed. By default a script waits; a notebook or a
        prompt (with ``%gui qt``) and a program whose event loop runs do not.

    Returns
    -------
    MainWindow
        Its `document` can be read and changed by the script, its `plotter` is a
        ``pyvista.Plotter`` in mesh coordinates, and `to_pyvista` returns the displayed mesh. If the
        caller has an application already, nothing outside the window is changed.

    Raises
    ------
    InputError
        If `mesh` is not valid, or there is no display or no OpenGL.

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
    # by its key: a function with a reference to the window would keep it, and its mesh, in memory
    window.closed.connect(lambda: _forget(key))
    if block is None:
        block = not _has_prompt() and QThread.currentThread().loopLevel() == 0
    if block:
        # not the loop of the application, which may run already, and ends with its last window
        loop = QEventLoop()
        window.closed.connect(loop.quit)
        # exceptions of another application are handled by it
        with nullcontext() if guest else FaultBoundary(window.document.notices.show):
            loop.exec()
    return window


def _forget(key: int) -> None:
    """Delete a window that has been closed."""
    _windows.pop(key).deleteLater()


@atexit.register
def _close_windows() -> None:
    """Close the windows at the end of a script, which ends their processes."""
    for window in list(_windows.values()):
        window.close()


def _has_prompt() -> bool:
    """Whether Python is interactive, so that commands can be typed while the window is open."""
    return hasattr(sys, "ps1") or "IPython" in sys.modules or bool(sys.flags.interactive)


def collect_garbage_when_idle(window: MainWindow) -> None:
    """Collect garbage in the interface thread only, and only among objects made after the imports.

    Another thread would free Python wrappers of widgets, on which Qt may abort the process. The
    imported libraries are two hundred thousand permanent objects; scanning them takes more than a
    tenth of a second, so they are frozen, and again after the first frame.
    """
    from pyqtgraph.util.garbage_collector import GarbageCollector

    _collectors.append(GarbageCollector())
    gc.freeze()
    window.scene.frames.first_drawn.connect(gc.freeze)


def load_libraries(window: MainWindow) -> None:
    """Import heavy libraries in a thread, then make render and panels of a shown window."""

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
    window.stage.welcome.set_loading("The render is missing; the message says why.")
    window.document.notices.show(notice_of(failure))


class Application(QApplication):
    """Application that opens files on macOS: double-clicked, or dropped on the icon in the Dock.

    macOS sends them as events, not as arguments of the program.
    """

    def event(self, event: QEvent) -> bool:
        """Open a file in the active window, or else in the newest."""
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
    """Replaces Python's hooks for uncaught exceptions while it is entered.

    An exception in a slot, an event handler or a thread has no caller that catches it. It is
    received here from any thread, and `notify` is called with a `Notice` in a later turn of the
    event loop, as it may be raised while a widget is painted.
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
        # Python keeps the last exception for a debugger, with all objects in its frames
        sys.last_value = sys.last_traceback = None
        self._caught.emit(failure_of(fault))

    def _say(self, failure: Failure) -> None:
        now = time.monotonic()
        if now - self._said.get(failure.text, -_ONCE) < _ONCE:
            return
        self._said = {text: at for text, at in self._said.items() if now - at < _ONCE}
        self._said[failure.text] = now
        self._notify(notice_of(failure))

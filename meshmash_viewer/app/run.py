"""Opening the window, from the command line or on a mesh in memory, and what it fails by."""

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

#: Libraries that the window waits for and that define no class of Qt objects.
_LIBRARIES = ("pyvista.plotting", "meshmash_viewer.app.view.mesh_renderer")
#: Modules that do. PySide looks up the class of an object without the interpreter lock, in a table
#: that each new class changes: defined in another thread, now and then one ended the process.
_WIDGETS = (
    "meshmash_viewer.app.view.mesh_view",
    "meshmash_viewer.app.panels.spectrum_panel",
    "meshmash_viewer.app.panels.profile_panel",
    "meshmash_viewer.app.panels.field_panel",
)
#: Seconds in which the same fault, as at every frame, is shown once.
_ONCE = 2.0
#: Bytes free on a disk that is not about to be full.
_ROOM_FOR_SHADERS = 100e6
#: Options of glibc, and bytes of a block that is large: more than a field of a million vertices,
#: which is taken and freed at every tick, and less than a picture of the screen.
_M_MMAP_THRESHOLD, _M_TRIM_THRESHOLD, _LARGE_BLOCK = -3, -1, 6 << 20
#: The application, if it was made here: Qt ends it with the last that knows it.
_made: list[QApplication] = []
#: What collects garbage in place of Python: its timer runs as long as the process.
_collectors: list[Any] = []
#: Windows opened by `view`, which no one else holds.
_windows: dict[int, MainWindow] = {}


def application() -> QApplication:
    """The application of this process, made and dressed if there is none.

    `InputError` is raised if there is no display.
    """
    existing = QApplication.instance()
    if isinstance(existing, QApplication):
        return existing
    _draw_without_a_full_disk()
    # what VTK draws with, in every part of the window: parts share what the card holds
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
    """Have what large blocks took go back to the system as soon as they are freed.

    Left alone, glibc keeps ever larger ones among small blocks that stay: after an hour of pictures
    and meshes a window held 0.2 GB more than it used. Other C libraries are left as they are.
    """
    if sys.platform.startswith("linux"):
        option = getattr(ctypes.CDLL(None), "mallopt", None)
        if option is not None:
            option(_M_MMAP_THRESHOLD, _LARGE_BLOCK)
            option(_M_TRIM_THRESHOLD, 2 * _LARGE_BLOCK)


def _draw_without_a_full_disk() -> None:
    """Keep no shaders where there is hardly room: Mesa maps that file, and the process would end.

    Elsewhere they are kept, since to compile them again takes a third of a second.
    """
    caches = Path(platformdirs.user_cache_dir())
    place = next(folder for folder in (caches, *caches.parents) if folder.exists())
    if shutil.disk_usage(place).free < _ROOM_FOR_SHADERS:
        os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")


def run_app(
    path: Path | None = None, unit: str = "", maps: Sequence[Path] = (), *, fresh: bool = False
) -> int:
    """Open the window, on a mesh or session if given, until it is closed; return the status.

    `unit` is as `read_mesh` takes it, empty for what the file states; `maps` are files with values
    per vertex of that mesh. If `fresh`, stored settings are ignored.
    """
    app = application()
    # Ctrl+C in the terminal, or the end of the desktop's session, closes the window as its cross;
    # by the event loop, which would wait for ever for a window that was closed before it runs
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: QTimer.singleShot(0, QApplication.closeAllWindows))
    pulse = QTimer(interval=200)
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
    """Show why there is no window, in a box, to a user without a console."""
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
        What the window calls it.
    block : bool, optional
        Whether to wait until the window is closed. By default a script waits; a notebook or a
        prompt (with ``%gui qt``) and a program whose event loop runs do not.

    Returns
    -------
    MainWindow
        Its `document` can be read and driven from the script, its `plotter` is a
        ``pyvista.Plotter`` in the mesh's coordinates, and `to_pyvista` gives what it shows.
        In an application of the caller's own nothing outside the window is changed.

    Raises
    ------
    InputError
        If it is no mesh, or there is no display or no OpenGL to show it with.

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
    # by its key: a function that knows the window would keep it, and its mesh, for good
    window.closed.connect(lambda: _forget(key))
    if block is None:
        block = not _has_prompt() and QThread.currentThread().loopLevel() == 0
    if block:
        # not the application's own loop, which ends with its last window and may run already
        loop = QEventLoop()
        window.closed.connect(loop.quit)
        # exceptions of another application are its own
        with nullcontext() if guest else FaultBoundary(window.document.notices.show):
            loop.exec()
    return window


def _forget(key: int) -> None:
    """Let go of a window that has been closed, and of what Qt keeps for it."""
    _windows.pop(key).deleteLater()


@atexit.register
def _close_windows() -> None:
    """Let no process outlive a script that ends with its window open."""
    for window in list(_windows.values()):
        window.close()


def _has_prompt() -> bool:
    """Whether commands can be typed while the window is open."""
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
    """Import heavy libraries in a thread, then complete the window that is shown already."""

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
    """Say what is missing; meshes can neither be drawn nor computed without it."""
    failure = failure_of(fault, "Loading the render")
    if isinstance(fault, ImportError):
        text = f"The render cannot be loaded ({fault}): install what is missing, start again."
        failure = Failure(text, failure.details, correctable=True)
    window.stage.welcome.set_loading("The render is missing; the message says why.")
    window.document.notices.show(notice_of(failure))


class Application(QApplication):
    """Opens files from macOS: double clicks, and files dropped on the icon in the Dock.

    They come as events while the program runs, not as arguments when it starts.
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

"""Random actions with mouse and keyboard in the window, reproducible by a seed.

`Walk` performs the actions and records faults: exceptions, warnings of Qt and Python, notices of a
defect. `Walk.measure` restores the initial state and measures the resources of the process, so that
two measurements can be compared.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import gc
import json
import os
import random
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import psutil
import shapes
from PySide6.QtCore import (
    QCoreApplication,
    QEvent,
    QMimeData,
    QObject,
    QPoint,
    QPointF,
    QRect,
    Qt,
    QtMsgType,
    QUrl,
    qInstallMessageHandler,
)
from PySide6.QtGui import QDropEvent, QKeyEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QDockWidget,
    QFileDialog,
    QLineEdit,
    QMessageBox,
    QTabBar,
    QTableWidget,
    QWidget,
)

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.plots.plot import Plot
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.notices import Notice

__all__ = ["Walk", "Weight", "make_files"]

_LEFT, _RIGHT, _MIDDLE = (
    Qt.MouseButton.LeftButton,
    Qt.MouseButton.RightButton,
    Qt.MouseButton.MiddleButton,
)
_MODIFIERS = (
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.ControlModifier,
)
#: Texts typed into input fields: valid, invalid and extreme ones.
_TEXTS = (
    "0", "1", "2", "7", "30", "64", "0.5", "1e-8", "3.1e5", "1e99", "1e-250", "1e-320", "1e308",
    "-1", "-0", "nan", "inf", "-inf", "", " ", "abc", "1,5", "1e", "99999", "999999999999", "π",
    "nm", "8 nm", "4 x 4 x 40 nm", "mm", "none", "0 nm", "1e-300 nm", "1e300 nm", "µm", "%",
)  # fmt: skip
#: Values put into damaged sessions.
_VALUES = (
    None, True, -1, 0, 1, 2**31, 10**9, 10**30, -0.5, 1e300, float("nan"), float("inf"), "",
    "x", "nonsense", "hks", [], {}, ["x"], [["x"]], [1e9], {"policy": "LockedLimits"},
)  # fmt: skip
#: Commands that are left out, as they end the walk; system dialogs are answered by `_answered`.
_NOT_TAKEN = {"quit"}
#: Beginnings of warnings on a virtual screen, which has no window manager.
_HARMLESS = ("This plugin does not support",)


@dataclass(frozen=True)
class Weight:
    """Resources of the process after some actions, with the window in its initial state.

    `megabytes` is the resident memory; `small` and `large` are allocated blocks in MB (see
    `blocks_in_use`). Leaks accumulate in small blocks; large blocks vary with the pictures. The
    remaining memory is libraries, and free blocks that the C library keeps.
    """

    actions: int
    megabytes: float
    small: float
    large: float
    meshes: int
    widgets: int
    objects: int
    files: int
    threads: int
    processes: int

    @staticmethod
    def header() -> str:
        """Return the column names of `row`."""
        return " ".join(f"{each.name:>9}" for each in fields(Weight))

    def row(self) -> str:
        """Return the values in one line."""
        return " ".join(f"{round(value, 1):9}" for value in astuple(self))


def blocks_in_use() -> tuple[float, float]:
    """Return the megabytes of allocated small blocks, and of blocks mapped individually.

    All threads are included; both are nan without `malloc_info` (musl, macOS, Windows).
    """
    library = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
    if not hasattr(library, "malloc_info"):
        return float("nan"), float("nan")
    library.fdopen.restype = ctypes.c_void_p
    library.fclose.argtypes = [ctypes.c_void_p]
    library.malloc_info.argtypes = [ctypes.c_int, ctypes.c_void_p]
    with tempfile.TemporaryFile() as file:
        stream = library.fdopen(os.dup(file.fileno()), b"w")
        library.malloc_info(0, stream)
        library.fclose(stream)
        file.seek(0)
        root = ElementTree.fromstring(file.read())
    totals = {total.get("type"): int(total.get("size", 0)) for total in root.findall("total")}
    system = {size.get("type"): int(size.get("size", 0)) for size in root.findall("system")}
    small = system["current"] - totals["fast"] - totals["rest"]
    return small / 1e6, totals["mmap"] / 1e6


def make_files(folder: Path) -> list[Path]:
    """Write closed, open, disconnected, dirty, tiny and broken meshes; return their paths."""
    ball = shapes.icosphere(3, radius=500.0)
    stretched = ball.vertices * (1.0, 1.0, 1.7)
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    files = []
    for name, vertices, faces in (
        ("ball", ball.vertices, ball.faces),
        ("egg", stretched, ball.faces),
        ("sheet", shapes.rectangle().vertices, shapes.rectangle().faces),
        ("three", shapes.three_spheres().vertices, shapes.three_spheres().faces),
        ("dendrite", shapes.neuron().vertices, shapes.neuron().faces),
        ("tetrahedron", tetrahedron, sides),
        ("loose", np.vstack([ball.vertices, [[9e3, 0, 0]]]), ball.faces),
    ):
        files.append(folder / f"{name}.npz")
        np.savez(files[-1], vertices=vertices, faces=faces)
    broken = folder / "broken.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n")
    empty = folder / "empty.obj"
    empty.write_bytes(b"")
    return [*files, broken, empty, folder / "absent.obj"]


def make_maps(folder: Path) -> list[Path]:
    """Write maps of the ball and the egg (holed, labelled) and of no mesh; return their paths."""
    wave = np.sin(np.arange(642) / 50.0)
    np.savez(folder / "wave.npz", wave=wave, holes=np.where(wave > 0.5, np.nan, wave))
    np.save(folder / "short.npy", wave[:9])
    label = folder / "lh.some.label"
    label.write_text("#!ascii label\n2\n3 0 0 0 0\n9 0 0 0 0\n")
    return [folder / "wave.npz", folder / "short.npy", label]


class Walk:
    """A window and random actions in it.

    Parameters
    ----------
    folder : Path
        Folder of the meshes, and of written sessions, tables and pictures.
    seed : int
    log : Path, optional
        File to which each action is written at once, in case the process crashes.
    """

    def __init__(self, folder: Path, seed: int = 0, log: Path | None = None) -> None:
        self.random = random.Random(seed)
        self.folder = folder
        self.files = make_files(folder)
        self.maps = make_maps(folder)
        self.sessions: list[Path] = []
        #: Faults, each with the last actions before it.
        self.faults: list[str] = []
        self.log: list[str] = []
        self._file = None if log is None else log.open("w", buffering=1)
        self.actions = 0
        #: Duration (s) and description of the longest action.
        self.slowest = (0.0, "")
        self.window = MainWindow(fresh=True)
        self.window.settings.folder = folder
        self.window.document.notices.shown.connect(self._hear)
        self._process = psutil.Process()
        self._steps: tuple[tuple[int, Callable[[], str]], ...] = (
            (22, self._command),
            (34, self._control),
            (14, self._canvas),
            (8, self._plot),
            (5, self._open),
            (3, self._drop),
            (4, self._session),
            (3, self._resize),
            (2, self._dock),
            (3, self._shortcut),
            (2, self._rest),
        )

    # -- faults -------------------------------------------------------------------------------

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Record exceptions and warnings, and answer system dialogs, within the context."""
        hooks = sys.excepthook, threading.excepthook, sys.unraisablehook
        sys.excepthook = lambda kind, fault, trace: self._note_exception(fault)
        threading.excepthook = lambda told: self._note_exception(told.exc_value)
        sys.unraisablehook = lambda told: self._note_exception(told.exc_value)
        before = qInstallMessageHandler(self._note_message)
        with warnings.catch_warnings(), _answered(self):
            warnings.simplefilter("error")
            try:
                yield
            finally:
                qInstallMessageHandler(before)
                sys.excepthook, threading.excepthook, sys.unraisablehook = hooks

    def _fault(self, text: str) -> None:
        recent = "\n    ".join(self.log[-8:])
        self.faults.append(f"{text}\n  after action {self.actions}:\n    {recent}")

    def _note_exception(self, fault: BaseException | None) -> None:
        if fault is not None:
            self._fault("".join(traceback.format_exception(fault)))

    def _note_message(self, kind: QtMsgType, _context: object, text: str) -> None:
        if kind is not QtMsgType.QtDebugMsg and not text.startswith(_HARMLESS):
            self._fault(f"Qt: {text}")

    def _hear(self, notice: Notice | None) -> None:
        if notice is None:  # the previous notice is withdrawn
            return
        if "defect" in notice.text or "Traceback" in notice.text or "failed" in notice.text:
            self._fault(f"notice: {notice.text}\n{notice.details}")

    # -- walking and measuring ----------------------------------------------------------------

    def begin(self) -> None:
        """Open the window and the first mesh."""
        self.window.show()
        self.window.activateWindow()
        self._wait(self.window.isActiveWindow)
        self.go_home()

    def walk(self, actions: int) -> None:
        """Perform random actions."""
        weights = [weight for weight, _ in self._steps]
        steps = [step for _, step in self._steps]
        for _ in range(actions):
            self.actions += 1
            started = time.monotonic()
            faulthandler.dump_traceback_later(120.0, exit=True)
            popup = QApplication.activePopupWidget()
            dialog = self._dialog()
            if popup is not None:
                what = self._popup(popup)
            elif dialog is not None:
                what = self._in_dialog(dialog)
            else:
                what = self.random.choices(steps, weights)[0]()
            self.log.append(what)
            if self._file is not None:
                self._file.write(f"{self.actions} {what}\n")
            QTest.qWait(self.random.choice((0, 0, 1, 3, 10, 25)))
            faulthandler.cancel_dump_traceback_later()
            took = time.monotonic() - started
            if took > self.slowest[0]:
                self.slowest = (took, what)

    def measure(self) -> Weight:
        """Restore the initial state, and return the resources of the process."""
        self.go_home()
        QTest.qWait(300)
        gc.collect()
        QTest.qWait(50)
        gc.collect()
        if sys.platform.startswith("linux"):
            ctypes.CDLL(None).malloc_trim(0)
        every = gc.get_objects()
        return Weight(
            self.actions,
            self._process.memory_info().rss / 1e6,
            *blocks_in_use(),
            sum(isinstance(each, Mesh) for each in every),
            len(QApplication.allWidgets()),
            sum(isinstance(each, QObject) for each in every),
            self._process.num_fds(),
            self._process.num_threads(),
            len(self._process.children(recursive=True)),
        )

    def go_home(self) -> None:
        """Restore the initial state: the ball with 30 eigenpairs, no pins, all panels in place."""
        window, document = self.window, self.window.document
        window.opening.end_comparison()
        for _ in range(8):
            popup, dialog = QApplication.activePopupWidget(), self._dialog()
            if popup is not None:
                popup.close()
            elif dialog is not None:
                dialog.reject()
            else:
                break
            QTest.qWait(5)
        window.actions_["theme_light"].trigger()
        window.showNormal()
        window.resize(1400, 900)
        window.arrangement.reset()
        document.work.cancel()
        # a large picture that is being drawn or written needs gigabytes
        self._wait(lambda: document.work.job is None and window.background_io.idle)
        document.display.playing = False
        home = self.folder / "home.meshmash.json"
        if not home.exists():
            self._at_home_first(home)
        window.opening.restore_session(home)
        self._wait(lambda: document.work.job is None and document.path == self.files[0])
        QTest.qWait(20)
        document.solve.compute()
        self._wait(lambda: document.work.job is None and bool(document.spectrum))
        self._wait(lambda: window.controller.idle and window.scene.at_rest)
        self._wait(lambda: window.background_io.idle)
        window.stage.message_bar.dismiss()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)

    def _at_home_first(self, home: Path) -> None:
        window, document = self.window, self.window.document
        window.open_mesh(self.files[0], "nm")
        self._wait(lambda: document.path == self.files[0] and document.work.job is None)
        document.solve.target = type(document.solve.target)("count", 30)
        document.solve.compute()
        self._wait(lambda: bool(document.spectrum) and document.spectrum.complete)
        window.opening.store_session(home)
        self.sessions.append(home)

    def close(self) -> None:
        """Close the window."""
        self.window.close()
        self.window.deleteLater()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)

    def _wait(self, condition: Callable[[], bool], seconds: float = 120.0) -> None:
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                self._fault("waited in vain, in:\n" + "".join(traceback.format_stack(limit=3)))
                return
            QTest.qWait(10)

    def _dialog(self) -> QDialog | None:
        shown = [w for w in QApplication.topLevelWidgets() if isinstance(w, QDialog)]
        return next((w for w in shown if w.isVisible()), None)

    # -- actions: each returns its description --------------------------------------------------

    def _command(self) -> str:
        from meshmash_viewer.app.actions import COMMANDS

        each = self.random.choice([c for c in COMMANDS if c.name not in _NOT_TAKEN])
        action = self.window.actions_[each.name]
        action.trigger()  # has no effect if disabled, like a click
        return f"command {each.name}{'' if action.isEnabled() else ' (off)'}"

    def _shortcut(self) -> str:
        key = self.random.choice(
            (Qt.Key.Key_Right, Qt.Key.Key_Left, Qt.Key.Key_PageDown, Qt.Key.Key_Space, Qt.Key.Key_1,
             Qt.Key.Key_2, Qt.Key.Key_3, Qt.Key.Key_N, Qt.Key.Key_F, Qt.Key.Key_P, Qt.Key.Key_Tab,
             Qt.Key.Key_Escape, Qt.Key.Key_Return, Qt.Key.Key_End, Qt.Key.Key_Home)
        )  # fmt: skip
        target = QApplication.focusWidget() or self.window
        QTest.keyClick(target, key, self.random.choice(_MODIFIERS))
        return f"key {key.name} to {_named(target)}"

    def _control(self, within: QWidget | None = None) -> str:
        kinds = (
            QAbstractButton, QAbstractSpinBox, QAbstractSlider, QComboBox, QLineEdit, QTabBar,
            QTableWidget,
        )  # fmt: skip
        within = within or self.window
        found = [
            w
            for w in within.findChildren(QWidget)
            if isinstance(w, kinds)
            and w.isVisible()
            and w.isEnabled()
            and not isinstance(w.parent(), QAbstractSpinBox | QComboBox)
            and not w.visibleRegion().isEmpty()
        ]
        if not found:
            return "no control"
        return self._use(self.random.choice(found))

    def _use(self, widget: QWidget) -> str:
        name = _named(widget)
        if isinstance(widget, QLineEdit | QAbstractSpinBox) and self.random.random() < 0.6:
            return self._type(widget)
        if isinstance(widget, QComboBox) and widget.isEditable() and self.random.random() < 0.5:
            return self._type(widget.lineEdit())
        chance = self.random.random()
        if chance < 0.2:
            self._wheel(widget)
            return f"wheel over {name}"
        if chance < 0.4:
            key = self.random.choice(
                (Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
                 Qt.Key.Key_Home, Qt.Key.Key_End, Qt.Key.Key_Space)
            )  # fmt: skip
            widget.setFocus()
            QTest.keyClick(widget, key)
            return f"key {key.name} to {name}"
        place = self._place_in(widget.visibleRegion().boundingRect())
        QTest.mouseClick(widget, _LEFT, pos=place)
        return f"click {name} at {place.x()}, {place.y()}"

    def _type(self, widget: QWidget) -> str:
        text = self.random.choice(_TEXTS)
        widget.setFocus()
        widget.selectAll()
        for character in text:
            if character.isascii():
                QTest.keyClicks(widget, character)
            else:  # QTest has no keys for other characters
                typed = QKeyEvent(QEvent.Type.KeyPress, 0, _MODIFIERS[0], character)
                QApplication.sendEvent(widget, typed)
        end = self.random.choice(("Return", "Tab", "Escape", ""))
        if end:
            QTest.keyClick(widget, getattr(Qt.Key, f"Key_{end}"))
        return f"type {text!r} {end} into {_named(widget)}"

    def _wheel(self, widget: QWidget) -> None:
        at = QPointF(self._place_in(widget.rect()))
        turn = QPoint(0, self.random.choice((-120, 120, 360, -1200)))
        event = QWheelEvent(
            at, QPointF(widget.mapToGlobal(at.toPoint())), QPoint(), turn,
            Qt.MouseButton.NoButton, self.random.choice(_MODIFIERS),
            Qt.ScrollPhase.NoScrollPhase, False,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)

    def _canvas(self) -> str:
        canvas = self.window.findChild(RenderWidget)
        if canvas is None or not canvas.isVisible():
            return "no render"
        chance = self.random.random()
        if chance < 0.3:
            self._wheel(canvas)
            return "wheel over the render"
        place = self._place_in(canvas.rect())
        if chance < 0.6:
            QTest.mouseMove(canvas, place)
            QTest.mouseClick(canvas, self.random.choice((_LEFT, _LEFT, _MIDDLE)), pos=place)
            return f"click the render at {place.x()}, {place.y()}"
        # press and release buttons in any order
        down, what = [], []
        for _ in range(self.random.randint(2, 8)):
            if self.window.findChild(RenderWidget) is not canvas:
                break  # the render of a second mesh was removed
            at = self._place_in(canvas.rect())
            choice = self.random.random()
            if choice < 0.4:
                button = self.random.choice((_LEFT, _RIGHT, _MIDDLE))
                if button not in down:
                    down.append(button)
                    QTest.mousePress(canvas, button, self.random.choice(_MODIFIERS), at)
                    what.append(f"{button.name} down")
            elif choice < 0.6 and down:
                button = down.pop(self.random.randrange(len(down)))
                QTest.mouseRelease(canvas, button, self.random.choice(_MODIFIERS), at)
                what.append(f"{button.name} up")
            else:
                QTest.mouseMove(canvas, at)
                what.append("move")
        for button in down:
            QTest.mouseRelease(canvas, button, pos=at)
        return "render: " + ", ".join(what)

    def _plot(self) -> str:
        shown = [p for p in self.window.findChildren(Plot) if p.isVisible()]
        if not shown:
            return "no plot"
        plot = self.random.choice(shown)
        inside, name = plot.viewport(), _named(plot)
        chance = self.random.random()
        if chance < 0.3:
            self._wheel(inside)
            return f"wheel over {name}"
        start, end = self._place_in(inside.rect()), self._place_in(inside.rect())
        if chance < 0.6:
            click = QTest.mouseDClick if chance < 0.35 else QTest.mouseClick
            click(inside, _LEFT, pos=start)
            return f"click {name}"
        QTest.mouseMove(inside, start)
        QTest.mousePress(inside, _LEFT, pos=start)
        for share in (0.1, 0.5, 1.0):
            QTest.mouseMove(inside, start + (end - start) * share)
            QTest.qWait(1)
        QTest.mouseRelease(inside, _LEFT, pos=end)
        return f"drag in {name}"

    def _open(self) -> str:
        path = self.random.choice(self.files)
        self.window.opening.open_path(path)
        return f"open {path.name}"

    def _drop(self) -> str:
        path = self.random.choice([*self.files, *self.sessions, *self.maps])
        told = QMimeData()
        told.setUrls([QUrl.fromLocalFile(str(path))])
        event = QDropEvent(
            QPointF(200, 200), Qt.DropAction.CopyAction, told, _LEFT, _MODIFIERS[0]
        )  # fmt: skip
        QApplication.sendEvent(self.window, event)
        return f"drop {path.name}"

    def _session(self) -> str:
        good = self.folder / "good.meshmash.json"
        if self.window.document.path is not None and self.random.random() < 0.4:
            self.window.opening.store_session(good)
            if good not in self.sessions:
                self.sessions.append(good)
        path = self.random.choice(self.sessions)
        if self.random.random() < 0.7:
            content = json.loads(path.read_text())
            where = self._damage(content)
            path = self.folder / "damaged.meshmash.json"
            path.write_text(json.dumps(content))
            self.window.opening.restore_session(path)
            return f"open a session with {where}"
        self.window.opening.restore_session(path)
        return f"open {path.name}"

    def _damage(self, content: Any) -> str:
        """Replace a random entry of a session; return the change as text."""
        where = ""
        while True:
            key = self.random.choice(sorted(content) if isinstance(content, dict) else ["mesh"])
            where += f".{key}"
            inner = content.get(key) if isinstance(content, dict) else None
            if isinstance(inner, dict) and inner and self.random.random() < 0.9:
                content = inner
                continue
            content[key] = self.random.choice(_VALUES)
            return f"{where[1:]} = {content[key]!r}"

    def _resize(self) -> str:
        size = self.random.choice(((900, 600), (1100, 700), (1440, 900), (1900, 1150), (400, 300)))
        self.window.resize(*size)
        return "resize to {} × {}".format(*size)

    def _dock(self) -> str:
        dock = self.random.choice(self.window.findChildren(QDockWidget))
        choice = self.random.choice(("toggle", "double click", "close"))
        if choice == "toggle":
            dock.toggleViewAction().trigger()
        elif choice == "close":
            dock.close()
        elif dock.isVisible():
            QTest.mouseDClick(dock.titleBarWidget(), _LEFT, pos=QPoint(20, 5))
        return f"{choice} {dock.objectName()}"

    def _rest(self) -> str:
        QTest.qWait(self.random.choice((50, 150, 400)))
        return "rest"

    def _popup(self, popup: QWidget) -> str:
        key = self.random.choice(
            (Qt.Key.Key_Down, Qt.Key.Key_Up, Qt.Key.Key_Return, Qt.Key.Key_Escape)
        )
        target = popup.focusWidget() or popup
        QTest.keyClick(target, key)
        return f"key {key.name} to the list of {_named(popup.parent() or popup)}"

    def _in_dialog(self, dialog: QDialog) -> str:
        chance = self.random.random()
        if chance < 0.2:
            QTest.keyClick(dialog, Qt.Key.Key_Escape)
            return f"leave {_named(dialog)}"
        row = dialog.findChild(QLineEdit, "file_edit")
        if chance < 0.35 and row is not None:
            name = self.random.choice(("a", "b.npz", "", "~", "absent/c", "d" * 300))
            row.setText(str(self.folder / "out" / name) if name else "")
            (self.folder / "out").mkdir(exist_ok=True)
            return f"write to {name[:20]!r}"
        return self._control(dialog)

    def _place_in(self, room: QRect) -> QPoint:
        return QPoint(
            self.random.randint(room.left(), max(room.right(), room.left())),
            self.random.randint(room.top(), max(room.bottom(), room.top())),
        )


def _named(widget: QObject) -> str:
    while widget is not None and not widget.objectName():
        widget = widget.parent()
    return widget.objectName() if widget is not None else "something"


@contextlib.contextmanager
def _answered(walk: Walk) -> Iterator[None]:
    """Replace the modal dialogs of the system by functions that return random answers."""

    def opened(*_: object, **__: object) -> tuple[str, str]:
        chosen = walk.random.choice([*walk.files, *walk.sessions, ""])
        return str(chosen), ""

    def several(*_: object, **__: object) -> tuple[list[str], str]:
        chosen = walk.random.sample([*walk.maps, *walk.files], walk.random.randint(0, 3))
        return [str(path) for path in chosen], ""

    def saved(*_: object, **__: object) -> tuple[str, str]:
        name = walk.random.choice(("saved.meshmash.json", "saved", "absent/saved", ""))
        return str(walk.folder / name) if name else "", ""

    def question(*_: object, **__: object) -> QMessageBox.StandardButton:
        yes = walk.random.random() < 0.2
        return QMessageBox.StandardButton.Yes if yes else QMessageBox.StandardButton.No

    with contextlib.ExitStack() as stack:
        for owner, name, answer in (
            (QFileDialog, "getOpenFileName", opened),
            (QFileDialog, "getOpenFileNames", several),
            (QFileDialog, "getSaveFileName", saved),
            (QMessageBox, "question", question),
        ):
            before = getattr(owner, name)
            setattr(owner, name, staticmethod(answer))
            stack.callback(setattr, owner, name, before)
        yield

"""Writes scenes in a process of its own: pyvista takes seconds, and holds the interpreter."""

from __future__ import annotations

import pickle
import subprocess
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QThreadPool, Signal

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import remove_left_overs
from meshmash_viewer.model.failure import failure_of

__all__ = ["SceneWriter"]


class SceneWriter(QObject):
    """Writes one scene after the other.

    Signals
    -------
    written(Path)
        A scene is there.
    failed(Failure)
        Why it is not.
    """

    written = Signal(object)
    failed = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._processes: list[subprocess.Popen[bytes]] = []
        self._closed = False

    def write(self, surface: Any, path: Path) -> None:
        """Write a surface with its field, a pyvista PolyData which is nobody else's."""
        from meshmash_viewer.app.view.scene import child_command

        pipe = subprocess.PIPE
        process = subprocess.Popen(
            child_command(), stdin=pipe, stdout=subprocess.DEVNULL, stderr=pipe
        )
        self._processes.append(process)
        self._pool.start(lambda: self._write(process, surface, path))

    def close(self) -> None:
        """Give up what is being written."""
        self._closed = True
        for process in self._processes:
            process.kill()
        self._pool.waitForDone()

    def _write(self, process: subprocess.Popen[bytes], surface: Any, path: Path) -> None:
        try:
            said = process.communicate(pickle.dumps((surface, path)))[1].decode(errors="replace")
            if process.returncode:
                raise InputError(said) if process.returncode == 2 else RuntimeError(said)
        except Exception as fault:  # noqa: BLE001  said to the person
            if not self._closed:
                self.failed.emit(failure_of(fault, f"Writing {path.name}"))
        else:
            self.written.emit(path)
        finally:
            process.kill()  # it waits for what could not be sent
            self._processes.remove(process)
            remove_left_overs(path.parent)  # of a process that was ended

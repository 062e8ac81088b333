"""Settings of the window, stored between runs."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QSettings

from meshmash_viewer.app.theme import Mode
from meshmash_viewer.io.atomic import session_folder

_RECENT_KEPT = 10


class Settings:
    """Recent files, theme, layout and the speed of the last solve.

    If `fresh`, they start as on the first day, and what is stored is left as it is.
    """

    def __init__(self, fresh: bool = False) -> None:
        self._fresh = fresh
        #: Where the session of each mesh file is saved.
        self.sessions = Path(tempfile.mkdtemp()) if fresh else session_folder()
        store = None if fresh else QSettings("meshmash-viewer", "meshmash-viewer")
        kept: dict[str, object] = {}
        self._get: Callable[[str], Any] = kept.get if store is None else store.value
        self._set = kept.__setitem__ if store is None else store.setValue

    def close(self) -> None:
        """Delete the sessions of a fresh start."""
        if self._fresh:
            shutil.rmtree(self.sessions, ignore_errors=True)

    @property
    def recent(self) -> list[Path]:
        """Recently opened mesh files that still exist, newest first."""
        stored = self._get("recent")
        # Qt returns a list of one string as a string
        texts = [stored] if isinstance(stored, str) else stored or []
        return [path for path in map(Path, texts) if path.exists()]

    def add_recent(self, path: Path) -> None:
        path = path.absolute()
        kept = [path, *(other for other in self.recent if other != path)][:_RECENT_KEPT]
        self._set("recent", [str(each) for each in kept])

    @property
    def folder(self) -> Path:
        folder = Path(str(self._get("folder") or Path.home()))
        return folder if folder.is_dir() else Path.home()

    @folder.setter
    def folder(self, folder: Path) -> None:
        self._set("folder", str(folder))

    @property
    def theme(self) -> Mode:
        stored = self._get("theme")
        return Mode(stored) if stored in set(Mode) else Mode.SYSTEM

    @theme.setter
    def theme(self, mode: Mode) -> None:
        self._set("theme", mode.value)

    @property
    def seconds_rate(self) -> float | None:
        """Seconds per vertex and pair of the last solve on this machine."""
        try:
            rate = float(str(self._get("seconds_rate")))
        except ValueError:
            return None
        return rate if 0.0 < rate < 1.0 else None

    @seconds_rate.setter
    def seconds_rate(self, rate: float) -> None:
        self._set("seconds_rate", rate)

    @property
    def layout(self) -> tuple[QByteArray, QByteArray] | None:
        geometry, state = self._get("geometry"), self._get("state")
        if isinstance(geometry, QByteArray) and isinstance(state, QByteArray):
            return geometry, state
        return None

    @layout.setter
    def layout(self, layout: tuple[QByteArray, QByteArray]) -> None:
        self._set("geometry", layout[0])
        self._set("state", layout[1])

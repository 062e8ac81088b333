"""Settings of the window, stored between runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QSettings

from meshmash_viewer.app.theme import Mode

_RECENT_KEPT = 10
_LOOKS_KEPT = 50


class Settings:
    """Recent files with their last display, theme, layout and the speed of the last solve.

    Parameters
    ----------
    fresh : bool
        Whether to start as on the first day, and to leave what is stored as it is.
    """

    def __init__(self, fresh: bool = False) -> None:
        store = None if fresh else QSettings("meshmash-viewer", "meshmash-viewer")
        kept: dict[str, object] = {}
        self._get: Callable[[str], Any] = kept.get if store is None else store.value
        self._set = kept.__setitem__ if store is None else store.setValue

    @property
    def recent(self) -> list[Path]:
        """Recently opened mesh files that still exist, newest first."""
        stored = self._get("recent")
        # Qt returns a list of one string as a string
        texts = [stored] if isinstance(stored, str) else stored or []
        return [path for path in map(Path, texts) if path.exists()]

    def add_recent(self, path: Path) -> None:
        """Put a file first."""
        path = path.absolute()
        kept = [path, *(other for other in self.recent if other != path)][:_RECENT_KEPT]
        self._set("recent", [str(each) for each in kept])

    @property
    def looks(self) -> dict[str, dict[str, Any]]:
        """The last display of each mesh file (`LastLook`), the newest at the end."""
        try:
            stored = json.loads(str(self._get("looks") or "{}"))
        except ValueError:
            return {}
        return stored if isinstance(stored, dict) else {}

    @looks.setter
    def looks(self, looks: dict[str, dict[str, Any]]) -> None:
        newest = dict(list(looks.items())[-_LOOKS_KEPT:])
        self._set("looks", json.dumps(newest))

    @property
    def folder(self) -> Path:
        """Folder in which the last file was opened or saved."""
        folder = Path(str(self._get("folder") or Path.home()))
        return folder if folder.is_dir() else Path.home()

    @folder.setter
    def folder(self, folder: Path) -> None:
        self._set("folder", str(folder))

    @property
    def theme(self) -> Mode:
        """Light, dark, or as the system is."""
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
        """Geometry and state of the main window."""
        geometry, state = self._get("geometry"), self._get("state")
        if isinstance(geometry, QByteArray) and isinstance(state, QByteArray):
            return geometry, state
        return None

    @layout.setter
    def layout(self, layout: tuple[QByteArray, QByteArray]) -> None:
        self._set("geometry", layout[0])
        self._set("state", layout[1])

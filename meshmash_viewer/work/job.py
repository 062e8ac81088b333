"""Long work as an object, and its connection to the window."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from meshmash_viewer.progress import Progress


class Channel(Protocol):
    """Connection from a running job to the window."""

    @property
    def folder(self) -> Path:
        """Temporary folder that is deleted when the window closes."""
        ...

    def report(self, progress: Progress) -> None:
        """Report the progress of the work."""
        ...

    def send(self, message: object) -> None:
        """Send a part of the result (picklable)."""
        ...

    def cancelled(self) -> bool:
        """Whether the user has cancelled."""
        ...


class Job(Protocol):
    """A frozen, picklable description of long work."""

    @property
    def label(self) -> str:
        """Label next to the progress bar: "Decomposing bunny"."""
        ...

    def run(self, channel: Channel) -> object:
        """Do the work in this process; the result is sent to the window."""
        ...

"""Channels for jobs that tests run in their own process."""

from __future__ import annotations

import pickle
from pathlib import Path

from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


class Listener:
    """A channel that keeps what it is told, and may ask to stop."""

    def __init__(self, folder: Path, stop_at: int | None = None) -> None:
        self.folder = folder
        self.reports: list[Progress] = []
        self.messages: list[Eigenpairs] = []
        self.remarks: list[str] = []
        self.stop_at = stop_at

    def report(self, progress: Progress) -> None:
        self.reports.append(progress)

    def send(self, message: object) -> None:
        if isinstance(message, str):
            self.remarks.append(message)
            return
        assert isinstance(message, Eigenpairs)
        # as it reaches the window: rows are mapped from their file
        self.messages.append(pickle.loads(pickle.dumps(message)))

    def cancelled(self) -> bool:
        last = self.reports[-1].converged if self.reports else 0
        return self.stop_at is not None and last >= self.stop_at

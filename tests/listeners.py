"""Channels for jobs that run in the process of a test."""

from __future__ import annotations

import pickle
from pathlib import Path

from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


class Listener:
    """Channel that stores messages and can request cancellation."""

    def __init__(self, folder: Path, stop_at: int | None = None) -> None:
        self.folder = folder
        self.reports: list[Progress] = []
        self.messages: list[Eigenpairs] = []
        self.stop_at = stop_at

    def report(self, progress: Progress) -> None:
        self.reports.append(progress)

    def send(self, message: object) -> None:
        assert isinstance(message, Eigenpairs)
        # Pickle as on the way to the window, where rows are mapped from a file.
        self.messages.append(pickle.loads(pickle.dumps(message)))

    def cancelled(self) -> bool:
        last = self.reports[-1].converged if self.reports else 0
        return self.stop_at is not None and last >= self.stop_at

"""Channels for jobs that tests run in their own process."""

from __future__ import annotations

from pathlib import Path

from meshmash_viewer.model.results import SpectrumGrew
from meshmash_viewer.progress import Progress


class Listener:
    """A channel that keeps what it is told, and may ask to stop."""

    def __init__(self, folder: Path, stop_at: int | None = None) -> None:
        self.folder = folder
        self.reports: list[Progress] = []
        self.messages: list[SpectrumGrew] = []
        self.stop_at = stop_at

    def report(self, progress: Progress) -> None:
        self.reports.append(progress)

    def send(self, message: object) -> None:
        assert isinstance(message, SpectrumGrew)
        self.messages.append(message)

    def cancelled(self) -> bool:
        last = self.reports[-1].converged if self.reports else 0
        return self.stop_at is not None and last >= self.stop_at

"""Sentences for the message bar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from psygnal import Signal


class Severity(StrEnum):
    """Severity of a notice: its colour, and how long it stays."""

    INFORMATION = "information"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class Notice:
    """One sentence for the message bar."""

    #: The sentence, and its severity.
    text: str
    severity: Severity = Severity.INFORMATION
    #: For the button that copies them.
    details: str = ""
    #: What a button of this text does.
    action: Callable[[], None] | None = None
    button: str = "Undo"
    #: Returns whether its cause still exists; the notice is withdrawn once it does not. See
    #: `Notices.show` for the default.
    holds: Callable[[], bool] | None = None


class Notices:
    """The notices of a document; ``shown`` carries each to the message bar."""

    shown = Signal(object)

    def __init__(self) -> None:
        #: The last notice, until it is withdrawn.
        self.last: Notice | None = None
        #: Number of meshes that were shown and jobs that were requested.
        self._turn = 0

    def show(self, notice: Notice) -> None:
        """Show a notice in the message bar, until its cause has gone.

        Without `Notice.holds`, a warning, an error and what has a button stay until another mesh is
        shown or another job is requested; other notices go after some seconds.
        """
        lasting = notice.severity is not Severity.INFORMATION or notice.action is not None
        if notice.holds is None and lasting:
            turn = self._turn
            notice = replace(notice, holds=lambda: self._turn == turn)
        self.last = notice
        self.shown.emit(notice)

    def say(self, text: str, severity: Severity = Severity.INFORMATION) -> None:
        """Show a sentence in the message bar."""
        self.show(Notice(text, severity))

    def begin_turn(self) -> None:
        """Record that another mesh is shown, or another job requested."""
        self._turn += 1

    def review(self) -> None:
        """Withdraw the last notice if its cause has gone: `shown` is emitted with None."""
        notice = self.last
        if notice is not None and notice.holds is not None and not notice.holds():
            self.last = None
            self.shown.emit(None)

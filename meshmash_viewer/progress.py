"""Progress reports of long computations."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, TypeAlias


class Cancelled(Exception):
    """Raised by a long computation after its cancel callback returned True."""


@dataclass(frozen=True, slots=True)
class Progress:
    """One report of a long computation."""

    #: Present stage, a short noun phrase ("factorization", "eigenpairs").
    stage: str
    #: Completed share, 0 to 1; None if unknown.
    fraction: float | None = None
    #: Estimated seconds to the end; None if unknown.
    remaining: float | None = None
    #: One line for the user.
    message: str = ""
    #: Number of leading eigenpairs that are final and readable.
    converged: int = 0
    #: Number of eigenpairs requested; 0 while unknown.
    total: int = 0


ProgressCallback: TypeAlias = Callable[[Progress], None]
CancelCallback: TypeAlias = Callable[[], bool]


def check_cancelled(cancel: CancelCallback | None) -> None:
    """Raise `Cancelled` if a callback is given and returns True."""
    if cancel is not None and cancel():
        raise Cancelled


_FORMAT = "{desc}: {percentage:3.0f}%|{bar}|{postfix} [{elapsed}]"


class ProgressBar:
    """A progress bar on stderr.

    `then` also receives every report; with `leave` the bar remains visible at the end.
    """

    def __init__(
        self, name: str, then: ProgressCallback | None = None, *, leave: bool = True
    ) -> None:
        from tqdm import tqdm

        self._then = then
        self._bar: Any = tqdm(
            desc=name,
            total=1.0,
            leave=leave,
            file=sys.stderr,
            disable=sys.stderr is None,  # without a console
            bar_format=_FORMAT,
            dynamic_ncols=True,
        )

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def hidden(self) -> AbstractContextManager[None]:
        """Return a context without the bar, in which text can be printed."""
        hidden: AbstractContextManager[None] = self._bar.external_write_mode()
        return hidden

    def __call__(self, progress: Progress) -> None:
        """Draw a report."""
        self._bar.n = progress.fraction or 0.0
        self._bar.set_postfix_str(progress.message or progress.stage, refresh=False)
        self._bar.refresh()
        if self._then is not None:
            self._then(progress)

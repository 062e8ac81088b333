"""How long work speaks to whoever waits for it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

__all__ = ["CancelCallback", "Cancelled", "Progress", "ProgressBar", "ProgressCallback"]


class Cancelled(Exception):
    """Raised by long work after its cancel callback returned True."""


@dataclass(frozen=True, slots=True)
class Progress:
    """One report of long work.

    Parameters
    ----------
    stage : str
        What is being done, as a short noun phrase ("factorization", "eigenpairs").
    fraction : float, optional
        Share of the whole work that is done, 0 to 1; None where nobody can say.
    remaining : float, optional
        Estimated seconds to the end; None where nobody can say.
    message : str
        One human-readable line.
    converged : int
        Number of leading eigenpairs that are final and readable.
    total : int
        Number of eigenpairs that the run owes; 0 while unknown.
    """

    stage: str
    fraction: float | None = None
    remaining: float | None = None
    message: str = ""
    converged: int = 0
    total: int = 0


ProgressCallback: TypeAlias = Callable[[Progress], None]
CancelCallback: TypeAlias = Callable[[], bool]

#: A bar that moves with the share of the work, since pairs come in heaps.
_FORMAT = "{desc}: {percentage:3.0f}%|{bar}|{postfix} [{elapsed}]"


class ProgressBar:
    """Reports as a bar on stderr.

    Parameters
    ----------
    name : str
        What is worked on.
    then : callable, optional
        Gets every report too.
    leave : bool
        Whether the bar stays when it is full.
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
            disable=sys.stderr is None,  # a program without a console
            bar_format=_FORMAT,
            dynamic_ncols=True,
        )

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, progress: Progress) -> None:
        """Draw a report."""
        self._bar.n = progress.fraction or 0.0
        self._bar.set_postfix_str(progress.message or progress.stage, refresh=False)
        self._bar.refresh()
        if self._then is not None:
            self._then(progress)

"""How long work speaks to whoever waits for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

__all__ = ["CancelCallback", "Cancelled", "Progress", "ProgressCallback"]


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

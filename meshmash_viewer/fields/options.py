"""What the command line asks for a family: the options that it adds to those of every command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

__all__ = ["Option"]


@dataclass(frozen=True)
class Option:
    """One option; a name that two families share is one option of the command.

    Parameters
    ----------
    name : str
        With underscores; "t_min" is given as ``--t-min``.
    about : str
        What it is, for ``--help``.
    metavar : str, optional
        What stands for its value there.
    kind : callable
        Makes the value of the text.
    values : tuple of str, optional
        All that it may be.
    many : bool
        Whether it may be given many times.
    """

    name: str
    about: str
    metavar: str | None = None
    kind: Callable[[str], Any] = str
    values: tuple[str, ...] | None = None
    many: bool = False

    @property
    def flag(self) -> str:
        """As it is typed."""
        return f"--{self.name.replace('_', '-')}"

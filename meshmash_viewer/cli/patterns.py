"""Expansion of patterns such as ``*.ply``, which not every shell expands.

The shells of Windows hand them over as they are, as those of POSIX do where they are quoted.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path

from meshmash_viewer.errors import InputError


def expanded(named: Iterable[Path]) -> list[Path]:
    """Replace each pattern by the files that match it.

    Parameters
    ----------
    named : iterable of Path
        A name that holds ``*``, ``?`` or ``[`` and is not that of an existing file is a pattern,
        below the part of its path that exists; ``**`` stands for any number of folders.

    Returns
    -------
    list of Path
        Those of a pattern in alphabetical order.

    Raises
    ------
    InputError
        If nothing matches a pattern.
    """
    return [path for name in named for path in _matches(name)]


def _matches(name: Path) -> list[Path]:
    if not glob.has_magic(str(name)) or os.path.lexists(name):
        return [name]
    folder = next(parent for parent in name.parents if parent.exists() or parent == parent.parent)
    rest = name.relative_to(folder)
    pattern = os.path.join(glob.escape(str(folder)), str(rest)) if folder.name else str(name)
    found = sorted(Path(match) for match in glob.glob(pattern, recursive=True))
    if not found:
        raise InputError(f"No file matches {name}; {_remedy(rest)}")
    return found


def _remedy(rest: Path) -> str:
    """Return the remedy for a pattern without a match."""
    if len(rest.parts) > 1 and not glob.has_magic(rest.parts[0]):
        return f"there is no folder {rest.parts[0]}: check the spelling."
    return "check its folder, its spelling and its ending."

"""The two tiers of the tests: quick ones at every change, slow ones in the whole run."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """A case of several parameters that is slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_unless(is_quick: Callable[[Any], bool], cases: Iterable[Any]) -> list[Any]:
    """Values of one parameter, marked slow unless the function says that a value is quick."""
    return [case if is_quick(case) else slow(case) for case in cases]


def slow_but(quick: Iterable[Any], cases: Iterable[Any]) -> list[Any]:
    """Values of one parameter, all but a few of them marked slow."""
    few, known = list(quick), list(cases)
    assert all(case in known for case in few), "a case that there is not"
    return slow_unless(few.__contains__, known)

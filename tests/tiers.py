"""Two tiers of tests: quick tests run at every change, slow tests only in a full run."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """Return a case of several parameters, marked slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_unless(is_quick: Callable[[Any], bool], cases: Iterable[Any]) -> list[Any]:
    """Return values of one parameter, marked slow unless `is_quick` is true for a value."""
    return [case if is_quick(case) else slow(case) for case in cases]


def slow_but(quick: Iterable[Any], cases: Iterable[Any]) -> list[Any]:
    """Return values of one parameter, marked slow except the quick ones."""
    few, known = list(quick), list(cases)
    assert all(case in known for case in few), "a case that there is not"
    return slow_unless(few.__contains__, known)

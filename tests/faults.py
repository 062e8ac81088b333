"""Assertions on faults that the user can correct."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from meshmash_viewer.errors import InputError


@contextmanager
def raises(code: str, *words: str) -> Iterator[pytest.ExceptionInfo[InputError]]:
    """Assert that the context raises the fault of a code, whose sentence contains some words."""
    with pytest.raises(InputError) as caught:
        yield caught
    assert caught.value.code == code
    assert [word for word in words if word not in str(caught.value)] == []

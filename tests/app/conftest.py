"""What tests of widgets share."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from meshmash_viewer.app import listening


@pytest.fixture(scope="module", autouse=True)
def all_garbage() -> Iterator[None]:
    """Collect what the tests of a file have left."""
    yield
    gc.collect()


@pytest.fixture(autouse=True)
def garbage() -> Iterator[None]:
    """Collect it in the interface's thread: others might free widgets of the test before."""
    gc.disable()
    yield
    gc.collect(1)


@pytest.fixture
def shown_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let widgets show the model without the event loop: for tests of what they show."""
    monkeypatch.setattr(listening._Turns, "note", lambda _turns, held: listening._call(held))

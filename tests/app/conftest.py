"""What tests of widgets share."""

from __future__ import annotations

import pytest

from meshmash_viewer.app import listening


@pytest.fixture
def shown_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let widgets show the model without the event loop: for tests of what they show."""
    monkeypatch.setattr(listening._Turns, "note", lambda _turns, held: listening._call(held))

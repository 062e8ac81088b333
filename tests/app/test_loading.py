from __future__ import annotations

import gc
import sys

import pytest

from meshmash_viewer.app.loading import load_quietly


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that notes whether garbage was looked for automatically while it was imported."""
    (tmp_path / "loaded_quietly.py").write_text("import gc\nenabled = gc.isenabled()\n")
    (tmp_path / "broken_quietly.py").write_text("raise LookupError('as told')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    gc.unfreeze()


def test_no_garbage_is_looked_for_while_a_library_is_loaded(module: None) -> None:
    load_quietly("loaded_quietly")
    assert not sys.modules.pop("loaded_quietly").enabled
    assert gc.isenabled()
    with pytest.raises(LookupError):
        load_quietly("broken_quietly")
    assert gc.isenabled()


@pytest.mark.parametrize("frozen", [True, False])
def test_what_is_loaded_stays_only_where_that_was_said(module: None, frozen: bool) -> None:
    gc.unfreeze()
    if frozen:
        gc.freeze()
    before = gc.get_freeze_count()
    load_quietly("loaded_quietly")
    del sys.modules["loaded_quietly"]
    assert (gc.get_freeze_count() > before) is frozen

"""Loads libraries behind a window that is in use."""

from __future__ import annotations

import gc
import importlib

__all__ = ["load_quietly"]


def load_quietly(module: str) -> None:
    """Import a module whose libraries are large, in a thread that is not the interface's.

    Their tens of thousands of objects would have Python look for garbage among all of them again
    and again, twentieths of a second each time in which no other thread can run. So it does not
    look meanwhile; and where it has been told that what is loaded stays
    (`run.keep_what_is_loaded`), that holds for these, too.
    """
    looked = gc.isenabled()
    gc.disable()
    try:
        importlib.import_module(module)
        if gc.get_freeze_count():
            gc.freeze()
    finally:
        if looked:
            gc.enable()

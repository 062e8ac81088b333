"""Let a widget listen to the model without being kept alive by it, nor called after its end."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import shiboken6

__all__ = ["listen"]


def listen(signals: Any, slot: Callable[[], None]) -> None:
    """Call a bound method of a Qt object, without arguments, whenever the model says something.

    Parameters
    ----------
    signals : psygnal signal or signal group
        For instance ``document.spectrum_changed`` or ``display.events``.
    slot : bound method
        Held weakly; skipped once Qt has deleted its object, though Python may still know it.
    """
    held = weakref.WeakMethod(slot)

    def call() -> None:
        method = held()
        if method is not None and shiboken6.isValid(method.__self__):
            method()

    signals.connect(call)

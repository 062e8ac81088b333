from __future__ import annotations

import sys

from PySide6.QtCore import QObject


def test_calls_into_qt_keep_the_references_to_none() -> None:
    # PySide6 6.12.0 loses a reference to None at each call; at zero the interpreter aborts
    thing = QObject()
    before = sys.getrefcount(None)
    for _ in range(500):
        thing.setObjectName("name")
        thing.setProperty("a", 1)
    assert sys.getrefcount(None) > before - 100

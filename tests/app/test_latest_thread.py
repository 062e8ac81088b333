"""Thread that answers only the latest request: finished requests are released."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator

import pytest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.background import LatestThread
from meshmash_viewer.progress import CancelCallback, Cancelled


class Request:
    """Object that supports weak references."""


def answered(_request: Request, _cancel: CancelCallback) -> None:
    """Return at once."""


def given_up(_request: Request, _cancel: CancelCallback) -> None:
    raise Cancelled


def failed(_request: Request, _cancel: CancelCallback) -> None:
    raise ValueError


@pytest.fixture
def start(qapp: QApplication) -> Iterator[Callable[..., LatestThread[Request]]]:
    """Return a function that starts threads; close these threads at the end."""
    started = []

    def start(work: Callable[[Request, CancelCallback], None], rest: float = 0.0) -> LatestThread:
        started.append(LatestThread(work, rest=rest))
        return started[-1]

    yield start
    for thread in started:
        thread.close()


@pytest.mark.parametrize("work", [answered, given_up, failed])
def test_a_request_is_not_held_when_it_is_over(
    qtbot: QtBot,
    start: Callable[..., LatestThread[Request]],
    work: Callable[[Request, CancelCallback], None],
) -> None:
    thread, request = start(work), Request()
    held = weakref.ref(request)
    thread.ask(request)
    del request
    qtbot.waitUntil(lambda: not thread.working)
    gc.collect()
    assert held() is None


def test_a_request_that_is_dropped_while_it_rests_is_not_held(
    qtbot: QtBot, start: Callable[..., LatestThread[Request]]
) -> None:
    thread, request = start(answered, rest=3600.0), Request()
    held = weakref.ref(request)
    thread.ask(request)
    del request
    qtbot.wait(50)  # the thread has not started the request
    thread.drop()
    qtbot.waitUntil(lambda: not thread.working)
    gc.collect()
    assert held() is None

"""Slots of the executor: which calls run, in which order, and which results are passed on."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.executor import Call, Slot, is_idle, shutdown
from meshmash_viewer.progress import Cancelled


class Window(QObject):
    """Owner of slots."""


@pytest.fixture
def window(qapp: QApplication) -> Iterator[Window]:
    window = Window()
    yield window
    shutdown(window)


def returns(result: object) -> Callable[[Call], object]:
    return lambda _: result


def test_the_newest_call_replaces_the_waiting_one(window: Window, qtbot: QtBot) -> None:
    slot, begun, gate, results = Slot(window, "fields"), threading.Event(), threading.Event(), []
    slot.submit(lambda _: begun.set() or gate.wait(), results.append)
    begun.wait()
    for number in range(5):
        slot.submit(returns(number), results.append)
    gate.set()
    qtbot.waitUntil(lambda: not slot.working)
    assert results == [True, 4]


def test_queued_calls_run_in_order_and_only_the_last_is_replaced(
    window: Window, qtbot: QtBot
) -> None:
    slot, gate, results = Slot(window, "files"), threading.Event(), []
    slot.submit(lambda _: gate.wait(), results.append, queued=True)
    for number in range(5):
        slot.submit(returns(number), results.append, queued=True)
    slot.submit(returns("last"), results.append)
    gate.set()
    qtbot.waitUntil(lambda: not slot.working)
    assert results == [True, 0, 1, 2, 3, "last"]


def test_slots_run_at_the_same_time_and_results_come_in_the_interface_thread(
    window: Window, qtbot: QtBot
) -> None:
    slots, meeting, threads = [Slot(window, str(at)) for at in range(20)], threading.Barrier(20), []
    for slot in slots:
        slot.submit(
            lambda _: meeting.wait(timeout=60), lambda _: threads.append(threading.get_ident())
        )
    qtbot.waitUntil(lambda: is_idle(window))
    assert threads == 20 * [threading.get_ident()]


def test_no_result_is_passed_on_after_drop(window: Window, qtbot: QtBot) -> None:
    slot, begun, results = Slot(window, "fields"), threading.Event(), []

    def run(call: Call) -> None:
        call.send("partial")
        begun.set()
        while not call.cancelled():
            pass

    slot.submit(run, results.append)
    begun.wait()
    slot.submit(returns("dropped"), results.append)
    slot.drop()
    slot.submit(returns("new"), results.append)
    qtbot.waitUntil(lambda: not slot.working)
    assert results == ["new"]


def test_a_call_stays_until_a_newer_one_waits(window: Window, qtbot: QtBot) -> None:
    slot, results = Slot(window, "tables"), []

    def run(call: Call) -> bool:
        call.send("begun")
        return call.stays(60.0)

    slot.submit(run, results.append)
    qtbot.waitUntil(lambda: bool(results))
    slot.submit(lambda call: call.stays(0.01), results.append)
    qtbot.waitUntil(lambda: not slot.working)
    assert results == ["begun", False, True]


def test_a_failure_is_passed_on_or_raised(window: Window, qtbot: QtBot) -> None:
    slot, failures = Slot(window, "fields"), []

    def fail(_: Call) -> None:
        raise ValueError("a fault")

    slot.submit(fail, print, failures.append)
    qtbot.waitUntil(lambda: bool(failures))
    with qtbot.captureExceptions() as raised:
        slot.submit(fail, print)
        qtbot.waitUntil(lambda: bool(raised))
    assert [str(each) for each in (*failures, raised[0][1])] == ["a fault", "a fault"]


def test_shutdown_ends_all_slots_of_a_window_and_completes_queued_calls(
    window: Window, qtbot: QtBot
) -> None:
    panel = QObject(window)
    fields, files = Slot(panel, "fields"), Slot(window, "files")
    begun, written, results = threading.Event(), [], []

    def run(call: Call) -> None:
        begun.set()
        while not call.cancelled():
            pass

    fields.submit(run, results.append)
    begun.wait()
    fields.submit(lambda _: written.append("replaced"), results.append)
    for number in range(3):
        files.submit(lambda _, number=number: written.append(number), results.append, queued=True)
    assert not is_idle(window)
    shutdown(window)
    assert written == [0, 1, 2]
    assert is_idle(window)
    fields.submit(returns("late"), results.append)
    qtbot.wait(20)
    assert results == []
    owner = QObject()
    other = Slot(owner, "of another window")
    other.submit(returns("other"), results.append)
    qtbot.waitUntil(lambda: results == ["other"])


def test_a_call_of_a_deleted_object_is_not_passed_on(qapp: QApplication, qtbot: QtBot) -> None:
    owner, results = QObject(), []
    slot, gate = Slot(owner, "fields"), threading.Event()
    slot.submit(lambda _: gate.wait(), results.append)
    owner.deleteLater()
    qtbot.wait(20)
    gate.set()
    slot.wait()
    qtbot.wait(20)
    assert results == []


def answer(_content: object, _call: Call) -> None:
    """Return at once."""


def give_up(_content: object, _call: Call) -> None:
    raise Cancelled


def fail(_content: object, _call: Call) -> None:
    raise ValueError


class Content:
    """Object that supports weak references."""


@pytest.mark.parametrize("function", [answer, give_up, fail])
def test_a_call_is_not_held_when_it_is_over(
    window: Window, qtbot: QtBot, function: Callable[..., Any]
) -> None:
    slot, content = Slot(window, "fields"), Content()
    held = weakref.ref(content)
    slot.submit(partial(function, content), lambda _: None, lambda _: None)
    del content
    qtbot.waitUntil(lambda: not slot.working)
    gc.collect()
    assert held() is None

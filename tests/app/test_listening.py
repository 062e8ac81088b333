from __future__ import annotations

from collections.abc import Callable

import pytest
import shiboken6
from closed_form import rectangle_document
from PySide6.QtCore import QObject
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import listening
from meshmash_viewer.app.listening import catch_up, follow, later, listen, stop_listening
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.model.document import Document


class Follower(QObject):
    """Receiver that records its calls."""

    def __init__(self, calls: list[str], name: str) -> None:
        super().__init__()
        self.calls, self.name = calls, name

    def show(self) -> None:
        self.calls.append(self.name)


@pytest.fixture
def calls(qapp) -> list[str]:
    catch_up()
    return []


def test_listeners_are_told_at_once_and_followers_in_a_turn(qtbot: QtBot, calls: list[str]) -> None:
    document = Document()
    acts, shows = Follower(calls, "acts"), Follower(calls, "shows")
    follow(document.display.events, shows.show)
    follow(document.spectrum_changed, shows.show)
    listen(document.display.events.fields, acts.show)
    document.display.change(Eigenfunctions, index=4)
    document.display.change(Eigenfunctions, index=5)
    document.spectrum_changed.emit()
    assert calls == ["acts", "acts"]
    qtbot.waitUntil(lambda: len(calls) > 2)
    qtbot.wait(40)
    assert calls == ["acts", "acts", "shows"], "however often it was said"


def test_the_dead_are_not_called(calls: list[str]) -> None:
    gone, deleted = Follower(calls, "gone"), Follower(calls, "deleted")
    later(gone.show)
    later(deleted.show)
    del gone
    shiboken6.delete(deleted)
    catch_up()
    assert not calls


def test_what_has_closed_is_not_called_for_what_was_said_before(calls) -> None:
    document = Document()
    follower = Follower(calls, "closed")
    follow(document.mesh_changed, follower.show)
    document.mesh_changed.emit()
    stop_listening(follower)
    document.mesh_changed.emit()
    catch_up()
    assert calls == []


def test_followers_are_called_once_a_frame_is_drawn(
    qtbot: QtBot,
    calls: list[str],
    open_window: Callable[..., MainWindow],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    window = open_window(rectangle_document())
    qtbot.waitUntil(lambda: window.scene.at_rest)
    catch_up()
    monkeypatch.setattr(listening, "_DELAY", 10**8)  # too long to pass in this test
    monkeypatch.setattr(listening, "_known", None)
    follower, canvas = Follower(calls, "called"), window.scene.plotter
    later(follower.show)
    canvas.render()
    qtbot.waitUntil(lambda: calls == ["called"])
    later(follower.show)
    with qtbot.waitSignal(canvas.frameSwapped):
        canvas.render()
    qtbot.wait(20)
    assert calls == ["called"], "not again at the next frame of a drag"
    monkeypatch.setattr(listening, "perf_counter", lambda: 0.0)  # as if no time had passed
    monkeypatch.setattr(listening, "_DELAY", 1)
    canvas.render()
    qtbot.waitUntil(lambda: calls == ["called", "called"])  # the frame restarts the delay

from __future__ import annotations

import time

import pytest
import shiboken6
from PySide6.QtCore import QObject, QTimer
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import listening
from meshmash_viewer.app.listening import (
    catch_up,
    follow,
    frame_drawn,
    later,
    listen,
    stop_listening,
    wait_for_frame,
)
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.model.document import Document


class Follower(QObject):
    """Notes when it was called; may take its time."""

    def __init__(self, calls: list[str], name: str, seconds: float = 0.0) -> None:
        super().__init__()
        self.calls, self.name, self.seconds = calls, name, seconds

    def show(self) -> None:
        self.calls.append(self.name)
        time.sleep(self.seconds)


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
    qtbot.wait(20)
    assert calls == ["acts", "acts", "shows"], "however often it was said"


def test_long_work_is_spread_over_turns(qtbot: QtBot, calls: list[str]) -> None:
    followers = [Follower(calls, name, 0.01) for name in "abc"]
    turn = Follower(calls, "|")
    for follower in followers:
        later(follower.show)
    timer = QTimer(interval=1)
    timer.timeout.connect(turn.show)
    timer.start()
    qtbot.waitUntil(lambda: "c" in calls)
    timer.stop()
    text = "".join(calls)
    assert text.replace("|", "") == "abc", "in the order in which it was said"
    assert "ab" not in text
    assert "bc" not in text


def test_the_dead_are_not_called(calls: list[str]) -> None:
    gone, deleted = Follower(calls, "gone"), Follower(calls, "deleted")
    later(gone.show)
    later(deleted.show)
    del gone
    shiboken6.delete(deleted)
    catch_up()
    assert not calls


@pytest.fixture
def words(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> Follower:
    """What waits for the picture, however long that takes."""
    monkeypatch.setattr(listening, "_PATIENCE", 60_000)
    return Follower(calls, "words")


@pytest.mark.parametrize("just_before", [False, True])
def test_words_wait_for_the_picture(
    qtbot: QtBot, calls: list[str], words: Follower, just_before: bool
) -> None:
    steps = [wait_for_frame, lambda: later(words.show)]
    for step in reversed(steps) if just_before else steps:
        step()
    qtbot.wait(20)
    assert not calls
    frame_drawn()
    qtbot.waitUntil(lambda: calls == ["words"])


def test_words_about_the_last_picture_come_though_the_next_is_in_a_hurry(
    qtbot: QtBot, calls: list[str], words: Follower
) -> None:
    wait_for_frame()
    later(words.show)
    frame_drawn()
    wait_for_frame()
    qtbot.waitUntil(lambda: calls == ["words"])


def test_a_frame_that_does_not_come_is_not_waited_for_forever(
    qtbot: QtBot, calls: list[str]
) -> None:
    words = Follower(calls, "words")
    wait_for_frame()
    later(words.show)
    qtbot.waitUntil(lambda: calls == ["words"])


def test_what_has_closed_is_not_called_for_what_was_said_before(calls) -> None:
    document = Document()
    follower = Follower(calls, "closed")
    follow(document.mesh_changed, follower.show)
    document.mesh_changed.emit()
    stop_listening(follower)
    document.mesh_changed.emit()
    catch_up()
    assert calls == []

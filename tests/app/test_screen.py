"""Messages without a display or without OpenGL; the process continues."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap

import pytest

from meshmash_viewer.app.screen import check_opengl, has_opengl, open_display
from meshmash_viewer.errors import InputError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="about X11, Wayland")

NAMES = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
#: A number too high for any X11 server.
GONE = {"DISPLAY": ":4711"}
WITHOUT = "No display is available for a window"
VIEWED = """
    import json, os, sys
    import meshmash_viewer as mv
    corners, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    for variables in json.loads(sys.argv[1]):
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
            os.environ.pop(name, None)
        os.environ.update(variables)
        try:
            mv.view((corners, faces))
        except mv.InputError as fault:
            print(fault)
"""
UNDRAWN = """
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication
    import meshmash_viewer as mv
    from meshmash_viewer.app.run import run_app

    try:
        mv.view(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    except mv.InputError as fault:
        print(fault)

    def look():
        for window in QApplication.topLevelWidgets():
            if window.objectName() == "main_window" and window.stage.message_bar.isVisible():
                picture = window.screen().grabWindow(window.winId()).toImage().scaled(64, 64)
                pixels = {picture.pixel(x, y) for x in range(64) for y in range(64)}
                if len(pixels) > 20:  # painted, and not black
                    print(window.stage.message_bar.notice.text, window.loaded, sep="\\n")
                    timer.stop()
                    window.close()

    timer = QTimer(interval=100)
    timer.timeout.connect(look)
    timer.start()
    assert run_app(fresh=True) == 0
"""


def run(script: str, *arguments: str, **variables: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, **variables},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("variables", "named"),
    [
        ({}, f"{WITHOUT}: use the commands that need no window"),
        (GONE, r"\(DISPLAY=:4711 does not answer\)"),
        ({"DISPLAY": ":4711.3"}, "DISPLAY=:4711.3 does"),
        ({"DISPLAY": "unix:4711"}, "DISPLAY=unix:4711 does"),
        ({"DISPLAY": "localhost:4711.0"}, "DISPLAY=localhost:4711.0 does"),
        ({"DISPLAY": "nonsense"}, "DISPLAY=nonsense does"),
        ({"DISPLAY": ""}, f"{WITHOUT}:"),
        ({"QT_QPA_PLATFORM": "xcb"}, "DISPLAY= does not"),
        ({"QT_QPA_PLATFORM": "offscreen"}, "QT_QPA_PLATFORM=offscreen draws no window"),
        ({"QT_QPA_PLATFORM": "minimal:enable_fonts"}, "QT_QPA_PLATFORM=minimal draws"),
        ({"QT_QPA_PLATFORM": "vnc", **GONE}, "QT_QPA_PLATFORM=vnc draws"),
        ({"QT_QPA_PLATFORM": "nonsense"}, "QT_QPA_PLATFORM=nonsense draws"),
        ({"QT_QPA_PLATFORM": "offscreen;xcb", **GONE}, "offscreen draws .*; DISPLAY=:4711 does"),
    ],
)
def test_no_display_is_a_sentence(
    variables: dict[str, str], named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=named) as caught, open_display():
        pytest.fail("no window can be opened")
    assert str(caught.value).startswith(WITHOUT)


def test_viewing_without_a_display_leaves_the_process_as_it_is() -> None:
    tried = [{}, GONE, {"QT_QPA_PLATFORM": "minimal"}, {"WAYLAND_DISPLAY": "nonsense", **GONE}]
    said = run(VIEWED, json.dumps(tried))
    assert [line.startswith(WITHOUT) for line in said] == [True] * 4
    assert "WAYLAND_DISPLAY=nonsense does not answer" in said[3]


def test_the_display_that_answers_is_chosen(qapp: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("QT_QPA_PLATFORM", raising=False)
    monkeypatch.setenv("WAYLAND_DISPLAY", "nonsense")
    with open_display():
        assert os.environ["QT_QPA_PLATFORM"] == "xcb"
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen;xcb")
    with open_display():
        pass


def test_windows_of_this_display_have_opengl(qapp: object) -> None:
    check_opengl()
    assert has_opengl()


@pytest.mark.slow
def test_without_opengl_the_window_says_so_in_its_bar() -> None:
    said = run(UNDRAWN, QT_XCB_GL_INTEGRATION="none")
    assert said[0] == said[1]
    assert said[0].startswith("The render needs OpenGL 3.2, and windows get none here")
    assert said[2] == "False", "there is no render"

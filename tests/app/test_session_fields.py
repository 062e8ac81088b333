"""Values typed into fields of the window, stored in a session and restored."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from closed_form import give, part, rectangle_document
from faults import raises
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox, QFileDialog, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.sessions import Restoration, session_of
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.io.session import write_session
from meshmash_viewer.model.classes import Learned
from meshmash_viewer.model.display import (
    Display,
    display_from_json,
    display_to_json,
    read_display,
)
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.weyl import Target

PATIENCE = 60_000
#: Numbers of every size and sign. A field that refuses a number keeps its value.
TEXTS = ("0", "50.0", "1e-8", "2e7", "1e300", "-5")


def shown(window: MainWindow, field: QWidget) -> bool:
    """Return whether a field is visible and enabled in its raised panel."""
    for dock in window.arrangement.docks.values():
        if dock.isAncestorOf(field):
            dock.raise_()
    catch_up()
    return field.isVisible() and field.isEnabled()


def flat(path: Path) -> dict[str, Any]:
    """Return the content of a session file in the form before version 4."""
    content = json.loads(path.read_text())["meshes"][0]
    return content | {"format": "meshmash-viewer session", "version": 3, "mesh_path": "ball.npz"}


def read_again(document: Document, path: Path) -> None:
    """Write a session, read it for a new document, and compare all typed values."""
    write_session(path, session_of(document, {}))
    content = flat(path)
    path.write_text(json.dumps(content))
    read = Restoration(Document(), path)
    display = Display()
    display_from_json(display, read_display(content["display"], path))
    assert json.dumps(display_to_json(display)) == json.dumps(display_to_json(document.display))
    assert read.session.target == document.solve.target
    assert read.session.operator == document.solve.operator


@pytest.mark.slow
def test_every_number_that_a_field_takes_is_read_back(
    open_window: Callable[..., MainWindow], tmp_path: Path
) -> None:
    window = open_window(rectangle_document(), (1300, 900))
    document, typed = window.document, set[str]()
    for kind in FAMILIES:
        document.display.kind = kind
        window.wait(60.0)
        fields = [each for each in window.findChildren(QAbstractSpinBox) if shown(window, each)]
        for text in TEXTS:
            for field in fields:
                if field.objectName() not in typed:
                    field.setFocus()
                    field.selectAll()
                    QTest.keyClicks(field, text)
                    QTest.keyClick(field, Qt.Key.Key_Return)
            catch_up()
            read_again(document, tmp_path / "a.meshmash.json")
        typed |= {each.objectName() for each in fields}
        policies = part(window, "limits_combo")
        for at in range(policies.count()):
            policies.setCurrentIndex(at)
            policies.activated.emit(at)
            read_again(document, tmp_path / "a.meshmash.json")
    assert len(typed) > 20


#: A field for each kind of target, the typed text, and the target.
TYPED = (
    ("target_count_spin", "50", Target("count", 50)),
    ("target_eigenvalue_spin", "3e-5", Target("max_eigenvalue", 3e-5)),
    ("target_wavelength_spin", "0.6 um", Target("wavelength", 600.0)),
    ("target_time_spin", "0.5 um²", Target("time", 5e5)),
)


@pytest.mark.slow
def test_what_is_typed_computed_and_saved_is_opened(
    qtbot: QtBot,
    open_window: Callable[..., MainWindow],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh, path = shapes.icosphere(2, radius=500.0), tmp_path / "ball.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces, unit="nm")
    saved = tmp_path / "ball.meshmash.json"
    window = open_window(size=(1300, 900))
    document = window.document
    window.open_mesh(path)
    qtbot.waitUntil(
        lambda: document.ready is not None and document.work.job is None, timeout=PATIENCE
    )
    give(part(window, "unit_combo").lineEdit(), "nm")
    window.wait(60.0)
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(saved), ""))
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(saved), ""))
    for name, text, wanted in TYPED:
        give(part(window, name), text)
        QTest.mouseClick(part(window, "compute_button"), Qt.MouseButton.LeftButton)
        window.wait(60.0)
        assert document.solve.target == wanted
        n_pairs = len(document.spectrum)
        QTest.keyClick(window, Qt.Key.Key_S, Qt.KeyboardModifier.ControlModifier)
        assert json.loads(saved.read_text())["meshes"][0]["target"] == asdict(wanted)
        document.solve.target = Target("count", 7)
        window.opening.open_session()
        qtbot.waitUntil(
            lambda wanted=wanted: document.solve.target == wanted and document.work.job is None,
            timeout=PATIENCE,
        )
        assert part(window, name).value == wanted.value
        assert document.unit_text == "nm"
        assert len(document.spectrum) == n_pairs, "they are in the store"


def test_a_session_of_before_with_a_count_that_is_a_float(tmp_path: Path) -> None:
    path = tmp_path / "old.meshmash.json"
    write_session(path, session_of(rectangle_document(), {}))
    content = flat(path)
    content["target"] = {"kind": "count", "value": 50.0}
    content["display"]["fields"]["hks"]["scales"] = 9.0
    content["display"]["fields"]["filter"] |= {"automatic": False, "low": 0.0, "high": 3.0}
    path.write_text(json.dumps(content))
    read = Restoration(Document(), path)
    assert read.session.target == Target("count", 50)
    assert isinstance(read.session.target.value, int)


def test_the_importance_of_columns_in_an_earlier_session_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "a.meshmash.json"
    write_session(path, session_of(rectangle_document(), {}))
    content = flat(path)
    learned = {"said": "F1", "unit": "nm", "names": ["a"], "kinds": ["hks"], "importance": [1.0]}
    path.write_text(json.dumps(content | {"classes": {"learned": learned}}))
    assert Restoration(Document(), path)._classes.learned == Learned("F1")


@pytest.mark.parametrize(
    ("classes", "said"),
    [
        ({"kinds": ["heat"]}, "classes.kinds[0] (Invalid enum value 'heat')"),
        ({"smoothing": -1.0}, "classes.smoothing (Expected `float` >= 0.0)"),
        ({"live": 3}, "classes.live (Expected `bool`, got `int`)"),
        ({"learned": {"said": 3}}, "classes.learned.said (Expected `str`, got `int`)"),
    ],
)
def test_classes_that_make_no_sense_are_refused(
    tmp_path: Path, classes: dict[str, object], said: str
) -> None:
    path = tmp_path / "a.meshmash.json"
    write_session(path, session_of(rectangle_document(), {}))
    content = flat(path)
    path.write_text(json.dumps(content | {"classes": classes}))
    with raises("invalid-entry", said):
        Restoration(Document(), path)

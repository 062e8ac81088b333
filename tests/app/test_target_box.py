"""Typed targets of a decomposition, and messages about impossible targets."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox, QLabel
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.panels.target_box import TargetBox
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.weyl import Target


@pytest.fixture
def box(qtbot: QtBot, sphere: Mesh) -> Iterator[TargetBox]:
    document = Document()
    document.accept_mesh(MeshReady(sphere, mesh_health(sphere), sphere.vertex_normals))
    box = TargetBox(document)
    qtbot.addWidget(box)
    box.document = document
    box.show()
    box.activateWindow()
    qtbot.waitUntil(box.isActiveWindow)
    catch_up()
    return box


def type_in(box: TargetBox, name: str, text: str) -> QAbstractSpinBox:
    """Type key by key, and let listeners follow after each key."""
    field = box.findChild(QAbstractSpinBox, name)
    field.setFocus()
    field.selectAll()
    for key in text:
        QTest.keyClicks(field, key)
        catch_up()
    return field


def enter(field: QAbstractSpinBox) -> None:
    QTest.keyClick(field, Qt.Key.Key_Return)
    catch_up()


def reason(box: TargetBox) -> str:
    return box.findChild(QLabel, "target_fault").text()


def test_what_is_typed_is_left_as_it_is(box: TargetBox) -> None:
    for text in ("1e9", "1e99", "0.0000125"):
        field = type_in(box, "target_eigenvalue_spin", text)
        assert field.lineEdit().text() == text


@pytest.mark.parametrize("text", ["1e99", "643"])
def test_there_are_no_more_eigenpairs_than_vertices(box: TargetBox, text: str) -> None:
    enter(type_in(box, "target_count_spin", "50"))
    field = type_in(box, "target_count_spin", text)
    enter(field)
    assert field.value == 50
    assert box.document.solve.target == Target("count", 50)
    assert reason(box) == "This mesh has 642 vertices, and so at most 642 eigenpairs."
    enter(type_in(box, "target_count_spin", "20"))
    assert reason(box) == ""
    assert box.document.solve.target == Target("count", 20)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("target_eigenvalue_spin", "Eigenvalues"),
        ("target_wavelength_spin", "Waves"),
        ("target_time_spin", "Times"),
    ],
)
@pytest.mark.parametrize("text", ["1e-250", "1e300"])
def test_what_no_mesh_has_goes_back_to_what_was(
    box: TargetBox, name: str, what: str, text: str
) -> None:
    enter(type_in(box, name, "1.5"))
    before = box.document.solve.target
    field = type_in(box, name, text)
    enter(field)
    assert field.lineEdit().text() == "1.5"
    assert box.document.solve.target == before
    assert reason(box).startswith(f"{what} of this mesh lie between")


@pytest.mark.parametrize("text", ["18,800", "1.5x"])
def test_what_is_refused_leaves_the_target_as_it_was(box: TargetBox, text: str) -> None:
    enter(type_in(box, "target_count_spin", "50"))
    field = type_in(box, "target_wavelength_spin", text)
    assert box.document.solve.target == Target("count", 50)
    enter(field)
    assert box.document.solve.target == Target("count", 50)
    assert reason(box) != ""


def test_escape_leaves_the_target_as_it_was(box: TargetBox) -> None:
    enter(type_in(box, "target_count_spin", "50"))
    field = type_in(box, "target_wavelength_spin", "1.5")
    assert box.document.solve.target == Target("wavelength", 1.5)
    QTest.keyClick(field, Qt.Key.Key_Escape)
    assert box.document.solve.target == Target("count", 50)


@pytest.mark.parametrize(
    ("text", "count"), [("50", 50), ("50.0", 50), ("1e2", 100), ("0,5e2", 50), ("12.5", None)]
)
def test_a_count_is_a_whole_number(box: TargetBox, text: str, count: int | None) -> None:
    enter(type_in(box, "target_count_spin", "20"))
    enter(type_in(box, "target_count_spin", text))
    value = box.document.solve.target.value
    assert value == (count or 20)
    assert isinstance(value, int)

"""A document with eigenpairs in closed form, and simulated mouse and keyboard events."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import shapes
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.certificate import Certificate, Method
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

Widget = TypeVar("Widget", bound=QWidget)
A, B = 12000.0, 47000.0  # nm


def rectangle_document(
    n_pairs: int = 120, *, converged: int | None = None, twins: slice | None = None
) -> Document:
    """Return a flat rectangle in nm with its Neumann eigenpairs, products of cosines."""
    flat = shapes.rectangle(12, 30, A, B)
    mesh = Mesh(flat.vertices, flat.faces, unit="nm", name="rectangle")
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(rectangle_spectrum(mesh, n_pairs, converged=converged, twins=twins))
    return document


def rectangle_spectrum(
    mesh: Mesh, n_pairs: int, *, converged: int | None = None, twins: slice | None = None
) -> Eigenpairs:
    waves = np.array([(i, j) for i in range(40) for j in range(120)])
    values = (np.pi * waves[:, 0] / A) ** 2 + (np.pi * waves[:, 1] / B) ** 2
    order = np.argsort(values, kind="stable")[:n_pairs]
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    rows = np.cos(np.pi * np.outer(waves[order, 0], x - x.min()) / A)
    rows *= np.cos(np.pi * np.outer(waves[order, 1], y - y.min()) / B)
    rows *= np.sqrt(2.0 ** (waves[order] > 0).sum(axis=1) / (A * B))[:, None]
    eigenvalues = values[order]
    if twins is not None:
        eigenvalues[twins] = eigenvalues[twins.start]
    k = n_pairs if converged is None else converged
    residuals = np.full(k, 3e-12)
    method: Method = "dense" if converged is None else "none"
    certificate = Certificate(method, n_pairs, n_pairs)
    return Eigenpairs(eigenvalues[:k], rows, residuals, certificate, total=n_pairs)


def part(within: QWidget, name: str) -> QWidget:
    """Return the widget of this object name after pending events are processed."""
    catch_up()
    found = within.findChildren(QWidget, name)
    assert len(found) == 1, f"{len(found)} of {name}"
    return found[0]


def shown(qtbot: QtBot, widget: Widget, width: int, height: int) -> Widget:
    """Show a widget in this size, and return it."""
    qtbot.addWidget(widget)
    widget.resize(width, height)
    with qtbot.waitExposed(widget, timeout=120_000):
        widget.show()
    return widget


def turn_wheel(
    widget: QWidget, notches: int, modifiers: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier
) -> None:
    """Turn the wheel over the middle of a widget; positive notches scroll down."""
    middle = QPointF(widget.rect().center())
    for _ in range(abs(notches)):
        turn = QPoint(0, -120 if notches > 0 else 120)
        event = QWheelEvent(
            middle, QPointF(widget.mapToGlobal(middle.toPoint())), QPoint(), turn,
            Qt.MouseButton.NoButton, modifiers, Qt.ScrollPhase.NoScrollPhase, False,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)
    QApplication.sendPostedEvents(widget)  # the render adds notches up


def drag(widget: QWidget, start: QPoint, *way: QPoint) -> None:
    """Drag from `start` along the points of `way`."""
    QTest.mouseMove(widget, start)
    QTest.qWait(20)
    QTest.mousePress(widget, Qt.MouseButton.LeftButton, pos=start)
    for point in way:
        QTest.mouseMove(widget, point)
        QTest.qWait(40)
    QTest.mouseRelease(widget, Qt.MouseButton.LeftButton, pos=way[-1])
    QTest.qWait(20)


def give(field: QLineEdit, text: str) -> None:
    """Replace the text of a field by pasting, and press Return."""
    field.setFocus()
    field.selectAll()
    QApplication.clipboard().setText(text)
    QTest.keyClick(field, Qt.Key.Key_V, Qt.KeyboardModifier.ControlModifier)
    QTest.keyClick(field, Qt.Key.Key_Return)

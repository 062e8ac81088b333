"""The *Select* tool, by mouse and keys on two balls, one behind the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.actions import SELECT_MODES
from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.annotations import bar_place
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.vertex_map import Label, VertexMap

PATIENCE = 15_000
LEFT, MIDDLE = Qt.MouseButton.LeftButton, Qt.MouseButton.MiddleButton
NONE, SHIFT, ALT = (
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.AltModifier,
)

SIDES = (Label(1, "left", "#4477aa"), Label(2, "right", "#ee6677"))


class Hand:
    """Mouse and keys on a window with two balls, one behind the other, seen from above."""

    def __init__(self, window: MainWindow, qtbot: QtBot) -> None:
        self.window, self.qtbot, self.document = window, qtbot, window.document
        self.mesh: Mesh = window.document.mesh  # type: ignore[assignment]
        self.canvas = window.scene.plotter
        self.tool = window.select_tool

    def key(self, key: Qt.Key, modifiers: Qt.KeyboardModifier = NONE) -> None:
        QTest.keyClick(self.window, key, modifiers)
        self.wait()

    def wait(self) -> None:
        self.qtbot.waitUntil(lambda: is_idle(self.tool), timeout=PATIENCE)
        self.qtbot.wait(1)
        catch_up()

    def drag(
        self,
        *places: QPoint,
        keys: Qt.KeyboardModifier = NONE,
        button: Qt.MouseButton = LEFT,
    ) -> None:
        QTest.mousePress(self.canvas, button, keys, places[0])
        for place in places[1:]:
            QTest.mouseMove(self.canvas, place)
        QTest.mouseRelease(self.canvas, button, keys, places[-1])
        self.wait()

    def at(self, x: float, y: float, z: float) -> QPoint:
        """Return the canvas position of the vertex nearest to a point."""
        away = np.linalg.norm(self.mesh.vertices - [x, y, z], axis=1)
        return self.window.scene.display_point(int(away.argmin()))

    def choose(self, mode: str) -> None:
        combo = part(self.window, "select_mode")
        row = combo.findData(mode)
        combo.setCurrentIndex(row)
        combo.activated.emit(row)
        self.wait()

    @property
    def chosen(self) -> np.ndarray:
        mask = self.document.selection.mask
        return np.zeros(self.mesh.n_vertices, dtype=np.bool_) if mask is None else mask


@pytest.fixture
def hand(reopen_window: Callable[..., MainWindow], qtbot: QtBot) -> Hand:
    ball = shapes.icosphere(4)
    mesh = Mesh(
        np.concatenate([ball.vertices, 0.5 * ball.vertices + np.array([0.0, 0.0, -3.0])]),
        np.concatenate([ball.faces, ball.faces + ball.n_vertices]),
        unit="nm",
        maps=(
            VertexMap("height", np.concatenate([ball.vertices[:, 2]] * 2).astype(np.float32)),
            VertexMap("hemisphere", np.tile(ball.vertices[:, 0] > 0.0, 2) + 1.0, SIDES),
        ),
    )
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    window = reopen_window(document, (1200, 800))
    window.wait()
    window.scene.look_from("dorsal")
    qtbot.waitUntil(lambda: window.scene.can_pick, timeout=PATIENCE)
    made = Hand(window, qtbot)
    made.key(Qt.Key.Key_W)
    qtbot.waitUntil(lambda: made.tool.prepared, timeout=60_000)  # the first use compiles loops
    return made


def angles(hand: Hand) -> np.ndarray:
    """Return the angles of the front ball's vertices from the pole at the camera."""
    return np.arccos(np.clip(hand.mesh.vertices[:2562, 2], -1.0, 1.0))


@pytest.mark.slow
def test_the_circle_of_the_brush_is_the_only_one(hand: Hand) -> None:
    ring, place = part(hand.window, "hover_ring"), hand.at(0.0, 0.0, 1.0)
    assert hand.canvas.cursor().shape() == Qt.CursorShape.CrossCursor, "it is prepared"
    for shown in (False, True):
        hand.tool.select(not shown)
        hand.window.wait()  # the bar of the tool resizes the render, which hides the ring
        with hand.qtbot.waitSignal(hand.window.scene.vertex_hovered, timeout=PATIENCE):
            QTest.mouseMove(hand.canvas, place + QPoint(40, 0))
            QTest.mouseMove(hand.canvas, place)
        assert ring.isVisible() == shown


def test_a_brush_paints_what_is_visible_and_is_one_change(hand: Hand) -> None:
    assert part(hand.window, "select_bar").isVisible()
    hand.tool.set_radius(0.3)
    before = hand.window.scene.camera()
    pole = hand.at(0.0, 0.0, 1.0)
    hand.drag(pole)
    near = angles(hand) < 0.28
    assert hand.chosen[:2562][near].all()
    assert not hand.chosen[:2562][angles(hand) > 0.32].any()
    painted = hand.chosen.copy()
    image = hand.canvas.image
    hand.drag(pole, pole + QPoint(30, 0), hand.at(0.9, 0.0, 0.4), keys=SHIFT)
    assert hand.chosen[painted].all()
    assert hand.chosen.sum() > painted.sum()
    assert not hand.chosen[:2562][hand.mesh.vertices[:2562, 2] < -0.1].any()  # the far side
    assert not np.array_equal(hand.canvas.image, image)
    hand.drag(pole, keys=ALT)
    assert not hand.chosen[:2562][near].any()
    assert hand.window.scene.camera() == before
    assert [step.label for step in hand.document.history.past] == ["brush"] * 3
    assert hand.document.pins.placed == ()
    for _ in range(2):
        hand.key(Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert np.array_equal(hand.chosen, painted)
    count = part(hand.window, "select_count")
    text = f"{painted.sum():,} vertices · "
    hand.qtbot.waitUntil(lambda: count.text().strip().startswith(text), timeout=PATIENCE)
    assert "nm²" in count.text()


@pytest.mark.slow
def test_a_small_window_has_all_commands_in_the_bar(hand: Hand) -> None:
    hand.window.resize(900, 600)
    bar, commands = part(hand.window, "select_bar"), hand.window.actions_
    names = [f"{name}_selection" for name in ("grow", "shrink", "fill", "invert", "clear")]
    for mode in ("brush", "value", "alike"):
        hand.choose(mode)
        for name in (*names, "cut"):
            assert bar.widgetForAction(commands[name]).isVisible(), mode


@pytest.mark.slow
def test_the_default_layout_has_the_bar_on_its_own_line(hand: Hand) -> None:
    hand.window.actions_["reset_layout"].trigger()
    catch_up()
    assert part(hand.window, "select_bar").y() >= part(hand.window, "toolbar").geometry().bottom()


def test_a_lasso_takes_the_visible_or_what_is_behind_too(hand: Hand) -> None:
    hand.choose("lasso")
    corners = [(-1.2, -1.2), (1.2, -1.2), (1.2, 1.2), (-1.2, 1.2)]
    pole, edge = hand.at(0.0, 0.0, 1.0), hand.at(1.0, 0.0, 0.0)
    size = edge.x() - pole.x()
    around = [pole + QPoint(round(x * size), round(y * size)) for x, y in corners]
    hand.drag(*around)
    front = hand.mesh.vertices[:, 2] > 0.0
    assert (hand.chosen != front).sum() < 0.01 * front.sum()
    through = part(hand.window, "select_through")
    QTest.mouseClick(through, LEFT, NONE, QPoint(8, through.height() // 2))
    hand.drag(*around)
    assert hand.chosen.all()
    kept = hand.chosen.copy()
    corner = QPoint(4, 4)
    hand.drag(corner, corner + QPoint(9, 0), corner + QPoint(9, 9))
    assert np.array_equal(hand.chosen, kept)
    notice = hand.window.stage.message_bar.notice
    assert notice is not None
    assert notice.text == "There is no vertex in the lasso. The selection stays as it is."
    hand.key(Qt.Key.Key_Escape)
    assert not hand.chosen.any()


@pytest.mark.slow
def test_components_growing_and_inverting(hand: Hand) -> None:
    hand.choose("connected")
    hand.drag(hand.at(0.0, 0.0, 1.0))
    first = np.arange(hand.mesh.n_vertices) < 2562
    assert np.array_equal(hand.chosen, first)
    hand.key(Qt.Key.Key_I, Qt.KeyboardModifier.ControlModifier)
    assert np.array_equal(hand.chosen, ~first)
    hand.document.selection.set(np.arange(len(first)) == 5)
    hand.key(Qt.Key.Key_Plus)
    ring = hand.chosen.sum()
    assert 6 <= ring <= 7
    hand.key(Qt.Key.Key_Minus)
    assert np.flatnonzero(hand.chosen).tolist() == [5]


@pytest.mark.slow
def test_a_range_of_values_follows_the_handles_at_the_colour_bar(hand: Hand) -> None:
    hand.document.display.kind = OwnMaps.name
    hand.window.wait()
    hand.choose("value")
    field, scene = hand.window.controller.field, hand.window.scene
    assert field is not None
    low, high = scene.renderer.caption.low, scene.renderer.caption.high  # type: ignore[union-attr]
    place = bar_place(scene.renderer.caption, scene.renderer.page)  # type: ignore[arg-type]
    assert place is not None
    camera = scene.camera()

    def at(share: float) -> QPoint:
        up = place.below + share * place.tall
        return QPoint(round(place.left - 5), round(hand.canvas.height() - up))

    image = hand.canvas.image
    hand.drag(at(0.0), at(0.2), at(0.5))
    np.testing.assert_allclose(hand.tool.range[0], (low + high) / 2, atol=0.02 * (high - low))
    assert hand.tool.range[1] == np.inf
    assert np.array_equal(hand.chosen, field.values >= hand.tool.range[0])
    hand.qtbot.wait(600)  # the next drag is a separate change
    hand.drag(at(1.0), at(0.75))
    assert np.array_equal(
        hand.chosen,
        (field.values >= hand.tool.range[0]) & (field.values <= hand.tool.range[1]),
    )
    assert not np.array_equal(hand.canvas.image, image)
    assert scene.camera() == camera
    hand.qtbot.wait(600)
    assert [step.label for step in hand.document.history.past] == ["selection by value"] * 2
    typed = part(hand.window, "select_low")
    typed.setFocus()
    typed.selectAll()
    QTest.keyClicks(typed, "-0.25")
    QTest.keyClick(typed, Qt.Key.Key_Return)
    hand.wait()
    assert hand.tool.range[0] == -0.25
    assert np.array_equal(
        hand.chosen, (field.values >= -0.25) & (field.values <= hand.tool.range[1])
    )
    # the range is dropped when the quantity changes
    hand.window.add_map("width", hand.mesh.vertices[:, 0], unit="nm")
    hand.qtbot.waitUntil(lambda: hand.window.controller.field.unit == "nm", timeout=PATIENCE)
    hand.window.wait()
    assert hand.tool.range == (-np.inf, np.inf)
    assert typed.text().startswith("–")
    hand.choose("brush")
    assert scene.renderer.annotations.bar_range is None


def test_a_click_takes_the_part_of_a_label_or_the_component(hand: Hand) -> None:
    assert list(SELECT_MODES) == ["brush", "lasso", "connected", "value", "alike"]
    hand.choose("connected")
    place, front = hand.at(0.5, 0.0, 0.8), np.arange(hand.mesh.n_vertices) < 2562
    hand.drag(place)
    assert np.array_equal(hand.chosen, front)
    hand.document.display.change(OwnMaps, chosen="hemisphere")
    hand.document.display.kind = OwnMaps.name
    hand.window.wait()
    hand.drag(place)
    right = hand.mesh.vertices[:, 0] > 0.0
    assert np.array_equal(hand.chosen, right & front)
    hand.document.labels.assign(None)  # the vertices under the pointer have no label
    hand.window.wait()
    hand.drag(place)
    assert np.array_equal(hand.chosen, front)


@pytest.mark.slow
def test_the_middle_button_turns_and_without_the_tool_a_click_pins(hand: Hand) -> None:
    before = hand.window.scene.camera()
    pole = hand.at(0.0, 0.0, 1.0)
    hand.drag(pole, pole + QPoint(40, 0), pole + QPoint(80, 0), button=MIDDLE)
    assert hand.window.scene.camera() != before
    assert not hand.chosen.any()
    QTest.mouseMove(hand.canvas, hand.at(0.0, 0.0, 1.0))
    label = part(hand.window, "hover_label")
    hand.qtbot.waitUntil(lambda: label.text().startswith("Vertex"), timeout=PATIENCE)
    assert "click" not in label.text()
    hand.key(Qt.Key.Key_W)
    assert not part(hand.window, "select_bar").isVisible()
    QTest.mouseClick(hand.canvas, LEFT, NONE, hand.at(0.0, 0.0, 1.0))
    assert len(hand.document.pins.placed) == 1
    assert not hand.chosen.any()


@pytest.mark.slow
def test_alike_needs_a_pin(hand: Hand) -> None:
    hand.choose("alike")
    notice = hand.window.stage.message_bar.notice
    assert notice is not None
    assert "pin a vertex" in notice.text


@pytest.mark.slow
def test_what_is_hidden_is_not_drawn_and_not_picked(hand: Hand) -> None:
    scene, mesh = hand.window.scene, hand.mesh
    pole = hand.at(0.0, 0.0, 1.0)
    front = np.arange(mesh.n_vertices) < 2562
    alone = scene.picture((300, 200), transparent=True)[..., 3] > 0
    hand.choose("connected")
    hand.drag(pole)
    hand.key(Qt.Key.Key_H)
    hand.qtbot.waitUntil(lambda: scene.can_pick, timeout=PATIENCE)
    assert np.array_equal(hand.document.hidden, front)
    assert scene.vertex_at(pole.x(), pole.y()) >= 2562  # on the ball behind
    hand.drag(pole)
    assert np.array_equal(hand.chosen, ~front)
    hand.key(Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    hand.key(Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert hand.document.hidden is None
    half = front & (mesh.vertices[:, 0] > 0.0)
    hand.document.selection.set(half)
    hand.key(Qt.Key.Key_I)
    hand.qtbot.waitUntil(lambda: scene.can_pick, timeout=PATIENCE)
    camera = scene.camera()
    drawn = scene.picture((300, 200), transparent=True)[..., 3] > 0
    assert 0.2 * alone.sum() < drawn.sum() < 3.0 * alone.sum()
    assert drawn[:, 150:].sum() > 0
    left = hand.at(-0.5, 0.0, 0.8)
    assert scene.vertex_at(left.x(), left.y()) == -1
    assert camera is not None
    hand.key(Qt.Key.Key_H, SHIFT)
    assert hand.document.hidden is None
    assert [step.label for step in hand.document.history.past][-2:] == [
        "isolation",
        "showing of all vertices",
    ]


@pytest.mark.slow
def test_a_minus_that_is_typed_is_no_command(hand: Hand) -> None:
    hand.document.display.kind = OwnMaps.name
    hand.window.wait()
    mask = np.arange(hand.mesh.n_vertices) < 100
    hand.document.selection.set(mask)
    field = part(hand.window, "limit_low_field")
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, "-0.25")
    QTest.keyClick(field, Qt.Key.Key_Return)
    hand.wait()
    assert field.value == -0.25
    assert np.array_equal(hand.chosen, mask)


@pytest.mark.slow
def test_a_selection_is_drawn_and_hidden_after_a_map_was_added(hand: Hand) -> None:
    renderer, mask = hand.window.scene.renderer, hand.mesh.vertices[:, 2] > 0.5
    hand.window.add_map("depth", hand.mesh.vertices[:, 2])
    hand.document.selection.set(mask)
    hand.wait()
    np.testing.assert_array_equal(renderer.selected, mask)
    hand.drag(hand.at(0.0, 0.0, 1.0))
    assert hand.chosen[:2562][angles(hand) < 0.5 * hand.tool.radius].all()
    assert not hand.chosen[:2562][angles(hand) > 2.0 * hand.tool.radius].any()
    hand.document.selection.set(mask)
    hand.wait()
    hand.document.hiding.hide(mask)
    hand.wait()
    np.testing.assert_array_equal(renderer.hidden, mask)


def trigger(hand: Hand, command: str) -> None:
    action = hand.window.findChild(QAction, command)
    assert action is not None
    action.trigger()
    hand.wait()


@pytest.mark.slow
def test_what_is_cut_away_is_not_drawn_not_picked_and_not_painted(hand: Hand) -> None:
    scene, x = hand.window.scene, hand.mesh.vertices[:, 0]
    whole = scene.picture((300, 200), transparent=True)[..., 3] > 0
    left, right = hand.at(-0.5, 0.0, 0.8), hand.at(0.5, 0.0, 0.8)
    trigger(hand, "cut_x")
    half = scene.picture((300, 200), transparent=True)[..., 3] > 0
    assert 0.4 * whole.sum() < half.sum() < 0.6 * whole.sum()
    assert scene.vertex_at(left.x(), left.y()) == -1
    assert scene.vertex_at(right.x(), right.y()) >= 0
    hand.tool.set_radius(0.3)
    hand.drag(left)
    assert not hand.chosen.any()
    hand.drag(hand.at(0.15, 0.6, 0.8))
    assert hand.chosen.any()
    assert not hand.chosen[x < 0.0].any()
    hand.choose("lasso")
    hand.tool.through = True
    pole = hand.at(0.0, 0.0, 1.0)
    size = hand.at(1.0, 0.0, 0.0).x() - pole.x()
    corners = [(-1.2, -1.2), (1.2, -1.2), (1.2, 1.2), (-1.2, 1.2)]
    hand.drag(*(pole + QPoint(round(a * size), round(b * size)) for a, b in corners))
    assert hand.chosen[x > 0.01].all()
    assert not hand.chosen[x < -0.01].any()
    hand.key(Qt.Key.Key_C, SHIFT)
    assert scene.vertex_at(left.x(), left.y()) >= 0
    assert scene.vertex_at(right.x(), right.y()) == -1
    hand.key(Qt.Key.Key_C)
    assert not hand.document.display.cut.shown
    assert scene.vertex_at(right.x(), right.y()) >= 0


@pytest.mark.slow
def test_the_handle_moves_and_turns_the_plane_and_is_one_change(
    hand: Hand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("meshmash_viewer.model.history._ONE_GESTURE", 1e9)  # for slow machines
    camera, mesh = hand.window.scene.camera(), hand.mesh
    trigger(hand, "cut_x")
    pole = hand.at(0.0, 0.0, 1.0)
    size = hand.at(1.0, 0.0, 0.0).x() - pole.x()
    hand.drag(pole, pole + QPoint(size // 4, 0), pole + QPoint(size // 2, 9))
    plane = hand.document.display.cut.plane(mesh.bounds)
    assert plane is not None
    assert plane.normal.tolist() == [1.0, 0.0, 0.0]
    assert abs(plane.level - 0.5) < 0.02
    assert not hand.chosen.any()
    hand.document.history.end_gesture()
    ball, length, turn = pole + QPoint(size // 2, 0), size // 3, np.radians(30.0)
    below = QPoint(-round(length * np.cos(turn)), round(length * np.sin(turn)))
    hand.drag(ball - QPoint(length, 0), ball + below / 2, ball + below)  # on the side cut away
    turned = hand.document.display.cut.plane(mesh.bounds)
    assert turned is not None
    np.testing.assert_allclose(turned.normal[:2], [np.cos(turn), np.sin(turn)], atol=0.03)
    assert hand.window.scene.camera() == camera
    assert [step.label for step in hand.document.history.past][-2:] == ["clipping plane"] * 2
    hand.key(Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert hand.document.display.cut.plane(mesh.bounds).level == plane.level  # type: ignore[union-attr]

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
import shapes
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QSurface, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMainWindow
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

import meshmash_viewer.app.view.frames as frames_module
import meshmash_viewer.app.view.picture as picture_module
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.picture import displayed_surface
from meshmash_viewer.app.view.render_widget import Outline
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.surface.rays import Plane


@pytest.fixture
def complaints() -> Iterator[vtkStringOutputWindow]:
    """Collect the messages of VTK; check that there are none."""
    before, heard = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(heard)
    yield heard
    vtkOutputWindow.SetInstance(before)
    assert heard.GetOutput() == ""


@pytest.fixture
def scene(qtbot, complaints, monkeypatch: pytest.MonkeyPatch) -> Iterator[MeshView]:
    monkeypatch.setattr(frames_module, "SLOW_FRAME", 1e9)  # no frame counts as slow
    window = QMainWindow()
    scene = MeshView(Document(), window)
    window.setCentralWidget(scene)
    window.resize(640, 480)
    qtbot.addWidget(window)
    with qtbot.waitSignal(scene.frames.first_drawn, timeout=20_000):
        window.show()
    yield scene
    scene.close()
    window.close()


def show(scene: MeshView, mesh: Mesh, qtbot) -> Mesh:
    with qtbot.waitSignal(scene.picking_ready, timeout=20_000):
        scene.set_mesh(mesh, mesh.vertex_normals)
    return mesh


def field(values: np.ndarray, title: str = "Eigenfunction 5") -> SimpleNamespace:
    return SimpleNamespace(
        values=values.astype(np.float32),
        title=title,
        description=lambda _lines: "λ₅ = 1 nm⁻²",
        family=SimpleNamespace(definition="L φ = λ M φ"),
        beyond=lambda _limits: (False, False),
        line_spacing=0.0,
        unit="nm⁻¹",
    )


def facing(scene: MeshView, mesh: Mesh) -> np.ndarray:
    """Return the vertices of a convex mesh whose normals point towards the viewer."""
    towards = np.array(scene.camera()["axes"])[2]
    return np.flatnonzero(mesh.vertex_normals @ towards > 0.5)


def ring(scene: MeshView) -> Outline:
    return scene.findChild(Outline, "hover_ring")


def on_canvas(scene: MeshView, vertex: int) -> QPoint:
    return scene.plotter.mapFrom(scene, scene.display_point(vertex))


@pytest.mark.pixels
def test_an_empty_scene_draws_and_answers(scene: MeshView, qtbot) -> None:
    assert scene.mesh is None
    assert scene.vertex_at(100, 100) == -1
    assert scene.camera() is None
    scene.set_field(None)
    scene.reset_camera()
    scene.set_theme(True)
    assert scene.picture((120, 90)).shape == (90, 120, 4)


@pytest.mark.parametrize("shift", [0.0, 1e7])
def test_every_vertex_that_is_seen_is_picked_where_it_is_drawn(
    scene: MeshView, sphere: Mesh, qtbot, shift: float
) -> None:
    mesh = show(scene, Mesh(sphere.vertices + shift, sphere.faces, "nm"), qtbot)
    vertices = facing(scene, mesh)
    assert len(vertices) > 100
    for vertex in vertices:
        place = scene.display_point(vertex)
        assert scene.vertex_at(place.x(), place.y()) == vertex
    assert scene.vertex_at(2, 2) == -1


def test_picking_holds_after_turning_and_zooming(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    canvas = scene.plotter
    before = scene.camera()
    QTest.mousePress(canvas, Qt.MouseButton.LeftButton, pos=QPoint(300, 200))
    for step in range(1, 8):
        QTest.mouseMove(canvas, QPoint(300 + 15 * step, 200 + 9 * step))
    QTest.mouseRelease(canvas, Qt.MouseButton.LeftButton, pos=QPoint(405, 263))
    wheel(canvas, 1, QPoint(200, 300))
    after = scene.camera()
    assert after["axes"] != before["axes"]
    assert after["half_size"] < before["half_size"]
    inside = scene.rect().adjusted(10, 10, -10, -10)
    for vertex in facing(scene, mesh):
        place = scene.display_point(vertex)
        if inside.contains(place):
            assert scene.vertex_at(place.x(), place.y()) == vertex


def wheel(canvas, notches: int, at: QPoint, modifiers=Qt.KeyboardModifier.NoModifier) -> None:
    event = QWheelEvent(
        QPointF(at),
        QPointF(canvas.mapToGlobal(at)),
        QPoint(0, 0),
        QPoint(0, 120 * notches),
        Qt.MouseButton.NoButton,
        modifiers,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    QApplication.sendEvent(canvas, event)


def test_a_click_picks_and_a_drag_does_not(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    heard = []
    scene.vertex_clicked.connect(heard.append)
    vertex = int(facing(scene, mesh)[7])
    place = on_canvas(scene, vertex)
    QTest.mouseClick(scene.plotter, Qt.MouseButton.LeftButton, pos=place)
    assert heard == [vertex]
    QTest.mousePress(scene.plotter, Qt.MouseButton.LeftButton, pos=place)
    QTest.mouseMove(scene.plotter, place + QPoint(40, 0))
    QTest.mouseRelease(scene.plotter, Qt.MouseButton.LeftButton, pos=place + QPoint(40, 0))
    QTest.mouseClick(scene.plotter, Qt.MouseButton.LeftButton, pos=QPoint(3, 3))
    assert heard == [vertex]


def test_the_pointer_tells_the_vertex_without_a_frame(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    QTest.qWait(50)
    frames = []
    scene.plotter.frame_due.connect(lambda: frames.append(1))
    for vertex in facing(scene, mesh)[[3, 40]]:
        with qtbot.waitSignal(scene.vertex_hovered, timeout=5000) as heard:
            QTest.mouseMove(scene.plotter, on_canvas(scene, vertex))
        assert heard.args == [vertex]
        assert ring(scene).isVisible()
    with qtbot.waitSignal(scene.vertex_hovered, timeout=5000) as heard:
        QTest.mouseMove(scene.plotter, QPoint(4, 4))
    assert heard.args == [-1]
    assert not ring(scene).isVisible()
    assert not frames


def test_ctrl_and_the_wheel_step(scene: MeshView, sphere: Mesh, qtbot) -> None:
    show(scene, sphere, qtbot)
    before, heard = scene.camera(), []
    scene.stepped.connect(heard.append)
    control = Qt.KeyboardModifier.ControlModifier
    wheel(scene.plotter, -1, QPoint(100, 100), control)
    qtbot.waitUntil(lambda: heard == [1])
    for notches in (1, 3, -1):
        wheel(scene.plotter, notches, QPoint(100, 100), control)
    qtbot.waitUntil(lambda: len(heard) > 1)
    assert heard == [1, -3], "notches in quick succession make a single step"
    assert scene.camera() == before


def test_zoom_keeps_the_place_under_the_pointer(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    vertex = int(facing(scene, mesh)[11])
    place = on_canvas(scene, vertex)
    wheel(scene.plotter, 3, place)
    assert (on_canvas(scene, vertex) - place).manhattanLength() <= 2


def test_many_fields_are_one_frame(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    surface = scene.renderer.surface
    frames = []
    scene.plotter.frame_due.connect(lambda: frames.append(1))
    for axis in (0, 1, 2):
        scene.set_field(field(mesh.vertices[:, axis]), (-1.0, 1.0), "RdBu_r")
        assert scene.renderer.surface is surface
        np.testing.assert_array_equal(surface.values, mesh.vertices[:, axis].astype(np.float32))
    qtbot.waitUntil(lambda: bool(frames), timeout=5000)
    QTest.qWait(frames_module.REST + 100)
    # one frame for the three fields, and one with smooth edges in software rendering
    assert len(frames) <= 2


def on_screen(scene: MeshView) -> np.ndarray:
    """Return the pixels of the widget, shape (height, width, 3)."""
    image = scene.plotter.grabFramebuffer().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), -1)
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()


def test_no_value_is_said_only_where_it_can_be_seen(scene: MeshView, neuron: Mesh, qtbot) -> None:
    mesh = show(scene, neuron, qtbot)
    assert len(mesh.unreferenced)
    values = mesh.vertices[:, 1].copy()
    values[mesh.unreferenced] = np.nan
    scene.set_field(field(values), (-1.0, 1.0), "RdBu_r")
    assert not scene.renderer.caption.missing
    values[mesh.faces[0, 0]] = np.nan
    scene.set_field(field(values), (-1.0, 1.0), "RdBu_r")
    assert scene.renderer.caption.missing


@pytest.mark.pixels
def test_a_field_changes_the_picture_and_none_takes_it_away(
    scene: MeshView, sphere: Mesh, qtbot
) -> None:
    mesh = show(scene, sphere, qtbot)
    size = (300, 200)
    bare = scene.picture(size)
    scene.set_field(field(mesh.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    coloured = scene.picture(size)
    assert (bare != coloured).any()
    scene.set_field(None)
    np.testing.assert_array_equal(scene.picture(size), bare)


def test_a_field_of_another_mesh_is_refused(scene: MeshView, sphere: Mesh, qtbot) -> None:
    show(scene, sphere, qtbot)
    with pytest.raises(ValueError, match="does not fit"):
        scene.set_field(field(np.zeros(5)), (-1.0, 1.0), "RdBu_r")


def darkened(scene: MeshView, shown: SimpleNamespace, size: tuple[int, int]) -> np.ndarray:
    """Return the pixels that the lines of a field darken, from the lower left, shape (k, 2)."""
    scene.document.display.nodal_lines = True
    scene.set_field(shown, (-1.0, 1.0), "RdBu_r")
    lined = scene.picture(size)[..., :3].max(axis=2)
    scene.document.display.nodal_lines = False
    scene.set_field(shown, (-1.0, 1.0), "RdBu_r")
    plain = scene.picture(size)[..., :3].max(axis=2)
    row, column = np.nonzero(lined < 0.55 * plain)
    return np.stack([column + 0.5, size[1] - row - 0.5], axis=1)


def circle(
    scene: MeshView, axis: int, level: float, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of the circle where a plane cuts the unit sphere, their pixels and depths."""
    turn = np.linspace(0.0, 2 * np.pi, 4000)
    points = np.full((4000, 3), level)
    points[:, (axis + 1) % 3] = np.sqrt(1 - level**2) * np.cos(turn)
    points[:, (axis + 2) % 3] = np.sqrt(1 - level**2) * np.sin(turn)
    view = scene.renderer.view
    return points, view.to_pixels(points, *size)[:, :2], points @ view.axes[2]


def apart(ones: np.ndarray, others: np.ndarray) -> float:
    """Return the largest distance of a pixel to the nearest pixel of another set."""
    return float(np.linalg.norm(ones[:, None] - others[None], axis=2).min(axis=1).max())


@pytest.mark.parametrize("scale", [pytest.param(1.0, marks=pytest.mark.slow), 2.0**-100])
@pytest.mark.pixels
def test_nodal_lines_are_where_the_field_is_zero(scene: MeshView, qtbot, scale: float) -> None:
    """Lines through vertices are drawn, too: edges of this sphere lie in the first plane."""
    mesh, size = show(scene, shapes.icosphere(5), qtbot), (640, 480)
    for axis, level in ((0, 0.0), (1, 0.3)):
        found = darkened(scene, field(scale * (mesh.vertices[:, axis] - level)), size)
        _, line, towards = circle(scene, axis, level, size)
        assert apart(line[towards > 0.3], found) < 1.0, "without a gap"
        assert apart(found, line[towards > -0.1]) < 1.5, "two pixels wide"


@pytest.mark.slow
@pytest.mark.pixels
def test_lines_at_round_values_are_at_all_of_them(scene: MeshView, qtbot) -> None:
    mesh, size = show(scene, shapes.icosphere(5), qtbot), (640, 480)
    shown = field(mesh.vertices[:, 1])
    shown.line_spacing = 0.25
    found = darkened(scene, shown, size)
    circles = [circle(scene, 1, level, size) for level in (0.25, 0.5, 0.75)]
    for _, line, towards in circles:
        assert apart(line[towards > 0.3], found) < 1.0
    seen = np.concatenate([line[towards > -0.1] for _, line, towards in circles])
    away = [apart(found[at : at + 1], seen) for at in range(len(found))]
    assert np.mean(np.array(away) < 3.0) > 0.998, "none below zero, and none at zero"


@pytest.mark.slow
@pytest.mark.pixels
def test_no_lines_where_there_is_no_value_or_nothing_but_zero(scene: MeshView, qtbot) -> None:
    mesh, size = show(scene, shapes.icosphere(5), qtbot), (640, 480)
    assert not len(darkened(scene, field(np.zeros(mesh.n_vertices)), size))
    assert not len(darkened(scene, field(np.full(mesh.n_vertices, np.nan)), size))
    values = np.where(mesh.vertices[:, 1] < 0.0, np.nan, mesh.vertices[:, 0])
    found = darkened(scene, field(values), size)
    points, line, towards = circle(scene, 0, 0.0, size)
    assert apart(line[(towards > 0.3) & (points[:, 1] > 0.05)], found) < 1.0
    assert apart(found, line[(towards > -0.1) & (points[:, 1] > -0.05)]) < 1.5


@pytest.mark.pixels
def test_pins_are_drawn_in_their_colours(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    vertex = int(facing(scene, mesh)[20])
    scene.set_pins((SimpleNamespace(vertex=vertex, color="#00ff00", label="1"),))
    picture = scene.picture((640, 480)).astype(int)
    green = (picture[..., 1] - picture[..., 0] > 150) & (picture[..., 1] - picture[..., 2] > 150)
    assert 30 < green.sum() < 200
    scene.set_pins(())
    picture = scene.picture((640, 480)).astype(int)
    assert not (picture[..., 1] - picture[..., 0] > 150).any()


def test_many_pins_are_hidden_where_the_surface_faces_away(
    scene: MeshView, sphere: Mesh, qtbot
) -> None:
    mesh = show(scene, sphere, qtbot)
    eye = scene.renderer.view.axes[2]
    facing_eye = mesh.vertices @ eye
    vertices = [vertex for vertex in range(0, 600, 3) if abs(facing_eye[vertex]) > 0.2]
    named = [SimpleNamespace(vertex=vertex, color="#00ff00", label="a") for vertex in vertices]
    scene.set_pins(named)
    placed = scene.renderer.placed_pins()
    assert [pin.vertex for pin in placed] == vertices
    assert [pin.hidden for pin in placed] == (facing_eye[vertices] < 0.0).tolist()
    assert (placed[0].label, placed[-1].label) == ("a", "")


def test_the_camera_goes_through_json_and_back(scene: MeshView, sphere: Mesh, qtbot) -> None:
    mesh = show(scene, sphere, qtbot)
    before = json.loads(json.dumps(scene.camera()))
    places = [scene.display_point(vertex) for vertex in range(0, mesh.n_vertices, 50)]
    wheel(scene.plotter, 4, QPoint(50, 60))
    assert scene.camera() != before
    scene.set_camera(before)
    assert [scene.display_point(vertex) for vertex in range(0, mesh.n_vertices, 50)] == places
    with pytest.raises(ValueError, match="camera"):
        scene.set_camera({"focus": [0, 0, 0]})


@pytest.mark.pixels
def test_pictures_of_any_size_and_without_background(scene: MeshView, sphere: Mesh, qtbot) -> None:
    show(scene, sphere, qtbot)
    assert scene.picture().shape == (scene.height(), scene.width(), 4)
    clear = scene.picture((500, 333), transparent=True)
    assert clear.shape == (333, 500, 4)
    assert clear[..., 3].min() == 0
    assert clear[..., 3].max() == 255


def test_the_mesh_alone_is_drawn_by_the_window_that_there_is(
    scene: MeshView, sphere: Mesh, qtbot, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = show(scene, sphere, qtbot)
    scene.set_field(field(mesh.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    before = on_screen(scene)
    monkeypatch.setattr(picture_module, "new_window", lambda: pytest.fail("another window"))
    alone = scene.frames.mesh_alone()
    assert alone.shape == (scene.height(), scene.width(), 4)
    left, right = np.flatnonzero((alone[..., 3] > 0).any(axis=0))[[0, -1]]
    assert left > 20, "neither title nor scale bar"
    assert right < scene.width() - 60, "no colour bar"
    inside = alone[scene.height() // 2, (left + right) // 2 - 100 : (left + right) // 2 + 100]
    assert (np.ptp(inside[:, :3].astype(int), axis=1) > 40).any(), "with its field"
    scene.plotter.update()
    np.testing.assert_array_equal(on_screen(scene), before)
    scene.plotter.render()
    np.testing.assert_array_equal(on_screen(scene), before)
    scene.set_cut(Plane(np.array([1.0, 0.0, 0.0]), 0.2))
    with_handle, handle = scene.frames.mesh_alone(), scene.renderer.handle
    assert handle.GetVisibility()
    handle.VisibilityOff()
    np.testing.assert_array_equal(with_handle, scene.frames.mesh_alone())


def test_slow_frames_get_a_stand_in_while_something_moves(
    scene: MeshView, qtbot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene.frames.rest.setInterval(600_000)  # keeps the coarse mesh on the render
    monkeypatch.setattr(frames_module, "SLOW_FRAME", 0.0)
    monkeypatch.setattr(frames_module, "COARSE_VERTICES", 500)
    mesh = show(scene, shapes.icosphere(4), qtbot)
    drawing = scene.renderer
    scene.plotter.render()
    QTest.qWait(60)
    scene.plotter.render()
    qtbot.waitUntil(lambda: drawing.coarse is not None, timeout=10_000)
    scene.set_field(field(mesh.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    qtbot.waitUntil(lambda: bool(drawing.coarse.actor.GetVisibility()), timeout=5000)
    assert not scene.at_rest
    wanted = mesh.vertices[drawing.coarse.mesh.representatives, 0].astype(np.float32)
    # the coarse mesh gets its values in its first frame
    qtbot.waitUntil(lambda: np.array_equal(drawing.coarse.values, wanted), timeout=5000)
    scene.frames.rest.start(1)
    qtbot.waitUntil(lambda: bool(drawing.surface.actor.GetVisibility()), timeout=5000)
    assert not drawing.coarse.actor.GetVisibility()
    qtbot.waitUntil(lambda: scene.at_rest, timeout=5000)
    assert drawing.surface.actor.GetVisibility()


@pytest.mark.pixels
def test_a_large_mesh_is_seen_before_its_stand_in_is_there(
    scene: MeshView, qtbot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frames_module, "SLOW_FRAME", 0.0)
    monkeypatch.setattr(frames_module, "COARSE_VERTICES", 500)
    scene.frames.rest.setInterval(600_000)  # keeps the first picture on the render
    made, cluster = threading.Event(), frames_module.cluster_vertices

    def slowly(*arguments):
        made.wait(60.0)
        return cluster(*arguments)

    monkeypatch.setattr(frames_module, "cluster_vertices", slowly)
    scene.frames.software = True
    mesh = shapes.icosphere(6)
    scene.set_mesh(mesh, mesh.vertex_normals)
    try:
        scene.set_field(field(mesh.vertices[:, 2]), (-1.0, 1.0), "RdBu_r")
        drawing = scene.renderer
        qtbot.waitUntil(lambda: drawing.caption is not None, timeout=5000)
        assert not scene.renderer.shows_coarse
        frame = on_screen(scene)
        red, _, blue = np.moveaxis(frame[150:330, 230:410].astype(int), 2, 0)
        assert (np.abs(red - blue) > 40).mean() > 0.5
    finally:
        made.set()
    qtbot.waitUntil(lambda: scene.renderer.shows_coarse, timeout=5000)
    scene.frames.rest.start(1)
    qtbot.waitUntil(lambda: scene.at_rest, timeout=10_000)


@pytest.mark.pixels
def test_one_mesh_after_another(scene: MeshView, sphere: Mesh, neuron: Mesh, qtbot) -> None:
    show(scene, sphere, qtbot)
    scene.set_field(field(sphere.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    scene.set_pins((Pin(600, 1),))
    # The next mesh has no field, no pins and another number of vertices.
    show(scene, neuron, qtbot)
    assert scene.renderer.caption is None
    scene.set_field(field(neuron.vertices[:, 0]), (0.0, 1e4), "viridis")
    scene.set_mesh(None)
    assert scene.mesh is None
    assert scene.picture((90, 60)).shape == (60, 90, 4)


def test_closing_while_threads_work_is_quiet(scene: MeshView, sphere: Mesh, qtbot) -> None:
    scene.set_mesh(sphere, sphere.vertex_normals)
    scene.close()
    scene.close()
    QTest.qWait(50)


def test_a_closed_render_refers_to_no_surface_of_qt(scene: MeshView) -> None:
    """PySide would return the deleted surface in place of a new object at the same address."""
    plotter = scene.plotter
    scene.close()
    kept = [each for each in vars(plotter).values() if isinstance(each, QSurface)]
    assert not kept


# -- the plotter ---------------------------------------------------------------------------------


def centre_of(pixels: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Return the mean row and column of the pixels of a colour."""
    found = np.abs(pixels[..., :3].astype(int) - color).max(axis=2) < 40
    assert found.any()
    return np.argwhere(found).mean(axis=0)


@pytest.mark.parametrize("shift", [pytest.param(0.0, marks=pytest.mark.slow), 1e6])
@pytest.mark.pixels
def test_what_others_add_is_at_its_place_and_stays(
    scene: MeshView, sphere: Mesh, qtbot, shift: float
) -> None:
    mesh = show(scene, Mesh(sphere.vertices + shift, sphere.faces, "nm"), qtbot)
    camera = scene.camera()
    vertex = int(facing(scene, mesh)[25])
    out = 1.15 * sphere.vertices[vertex] + shift
    # in double precision, since the coordinates are large
    ball = pyvista.Sphere(radius=0.05).points_to_double().translate(out)
    scene.plotter.add_mesh(ball, color="#00ff00", lighting=False)
    assert scene.camera() == camera, "it is looked at from where it was"

    def where() -> np.ndarray:
        size = scene.plotter.pixels()[:2]
        row, column = centre_of(on_screen(scene), (0, 255, 0))
        x, y, _ = scene.renderer.view.to_pixels(out, *size)[0]
        return np.array([column - x, (size[1] - row) - y])

    assert np.abs(where()).max() < 1.5
    scene.set_field(field(sphere.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    scene.set_theme(True)
    wheel(scene.plotter, 2, QPoint(320, 240))
    assert np.abs(where()).max() < 1.5
    # the same in pictures, which another window draws
    picture = scene.picture((640, 480))
    row, column = centre_of(picture, (0, 255, 0))
    x, y, _ = scene.renderer.view.to_pixels(out, 640, 480)[0]
    assert np.abs([column - x, 480 - row - y]).max() < 1.5
    scene.plotter.clear_actors()
    seen = on_screen(scene)[240].astype(int)
    assert np.abs(seen[320] - seen[5]).max() > 30, "the mesh stays, where the ground was"


@pytest.mark.pixels
def test_what_is_far_from_the_mesh_is_drawn_whole(scene: MeshView, sphere: Mesh, qtbot) -> None:
    show(scene, sphere, qtbot)
    towards = np.array(scene.camera()["axes"])[2]
    for depth in (40.0, -40.0):
        far = depth * towards + 1.2 * np.array(scene.camera()["axes"])[0]
        scene.plotter.add_mesh(
            pyvista.Sphere(radius=0.1, center=far), color="#00ff00", lighting=False
        )
        centre_of(on_screen(scene), (0, 255, 0))
        scene.plotter.clear_actors()


@pytest.mark.pixels
def test_the_camera_of_the_plotter_is_that_of_the_view(
    scene: MeshView, sphere: Mesh, qtbot
) -> None:
    mesh = show(scene, sphere, qtbot)
    scene.plotter.view_xy()
    on_screen(scene)
    np.testing.assert_allclose(scene.camera()["axes"], np.eye(3), atol=1e-9)
    for vertex in facing(scene, mesh)[::20]:
        place = scene.display_point(vertex)
        assert scene.vertex_at(place.x(), place.y()) == vertex


def test_what_is_shown_goes_to_pyvista(scene: MeshView, sphere: Mesh, qtbot) -> None:
    with pytest.raises(ValueError, match="open one"):
        displayed_surface(scene.renderer)
    mesh = show(scene, Mesh(sphere.vertices + 1e6, sphere.faces, "nm"), qtbot)
    assert displayed_surface(scene.renderer).active_scalars is None
    values = sphere.vertices[:, 0].astype(np.float32)
    values[:4] = np.nan
    scene.set_field(field(values), (-0.5, 0.25), "viridis")
    surface = displayed_surface(scene.renderer)
    np.testing.assert_array_equal(surface.points, mesh.vertices)
    assert surface.active_scalars_name == "Eigenfunction 5"
    np.testing.assert_array_equal(surface.active_scalars, values)
    assert surface.user_dict["limits"] == [-0.5, 0.25]
    assert surface.user_dict["colormap"] == "viridis"
    assert surface.user_dict["unit"] == "nm⁻¹"


@pytest.mark.pixels
def test_a_screen_of_another_scale_gets_a_frame_of_its_size(
    scene: MeshView, sphere: Mesh, qtbot, monkeypatch: pytest.MonkeyPatch
) -> None:
    show(scene, sphere, qtbot)
    scene.set_field(field(sphere.vertices[:, 0]), (-1.0, 1.0), "RdBu_r")
    on_screen(scene)
    QTest.qWait(2 * frames_module.REST)
    qtbot.waitUntil(lambda: scene.at_rest, timeout=5000)
    QTest.qWait(100)  # no frame is due now
    window, before = scene.plotter.ren_win, scene.plotter.ren_win.GetSize()
    monkeypatch.setattr(scene.plotter, "devicePixelRatioF", lambda: 2.0)
    QApplication.sendEvent(scene.plotter, QEvent(QEvent.Type.DevicePixelRatioChange))
    qtbot.waitUntil(lambda: window.GetSize() == (2 * before[0], 2 * before[1]), timeout=5000)
    assert window.GetDPI() == 144


def test_nothing_dropped_on_the_render_is_taken_by_it(scene: MeshView) -> None:
    assert not scene.plotter.acceptDrops()


# -- thin branches -------------------------------------------------------------------------------


def tube(radius: float, length: float = 1.0) -> Mesh:
    around, along = np.linspace(0, 2 * np.pi, 17)[:16], np.linspace(-length / 2, length / 2, 60)
    turn, place = (grid.ravel() for grid in np.meshgrid(around, along))
    points = np.stack([place, radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    row, column = np.divmod(np.arange(59 * 16), 16)
    first, beside = 16 * row + column, 16 * row + (column + 1) % 16
    corners = np.concatenate([
        np.stack([first, first + 16, beside], axis=1),
        np.stack([beside, first + 16, beside + 16], axis=1),
    ])  # fmt: skip
    return Mesh(points, corners, "nm")


@pytest.mark.parametrize(("radius", "thin"), [(0.005, True), (0.06, False)])
@pytest.mark.pixels
def test_a_thin_branch_shows_its_colours_and_a_thick_one_its_rim_and_lines(
    scene: MeshView, qtbot, radius: float, thin: bool
) -> None:
    mesh = show(scene, tube(radius), qtbot)
    wave = np.sin(40 * mesh.vertices[:, 0])
    shown = field(np.where(wave > 0, 0.8, -0.8) + 1e-3 * wave)
    scene.set_field(shown, (-1.0, 1.0), "RdBu_r")
    size = (640, 480)
    seen = scene.renderer.view.to_pixels(mesh.vertices, *size)
    rows = slice(480 - int(seen[:, 1].max()), 480 - int(seen[:, 1].min()) - 1)
    columns = slice(int(seen[:, 0].min()) + 9, int(seen[:, 0].max()) - 8)
    plain = scene.picture(size)[rows, columns, :3].max(axis=2).astype(float)
    # brightness of the edge relative to the middle, which gets more light in any case
    edge = np.median(plain[[0, -1]]) / np.median(plain[len(plain) // 2])
    assert edge > 0.8 if thin else edge < 0.65
    scene.document.display.nodal_lines = True
    scene.set_field(shown, (-1.0, 1.0), "RdBu_r")
    lined = scene.picture(size)[rows, columns, :3].max(axis=2)
    black = (lined < 50).mean()
    assert black < 0.002 if thin else black > 0.01

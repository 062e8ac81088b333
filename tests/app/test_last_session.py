"""Last sessions: a mesh file opens again as it was closed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
import shapes
from closed_form import part
from nibabel.freesurfer import write_annot
from nibabel.gifti import GiftiDataArray, GiftiImage, GiftiLabel, GiftiLabelTable
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot
from tiers import slow

from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.io import maps
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.classes import ClassOptions
from meshmash_viewer.model.display import Shape
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

PATIENCE = 60_000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Share the stored sessions between windows, as between runs of the program."""
    made = Settings.__init__

    def begin(settings: Settings, fresh: bool = False) -> None:
        made(settings, fresh)
        settings.close()
        settings.sessions = tmp_path / "sessions"
        settings._fresh = False

    monkeypatch.setattr(Settings, "__init__", begin)
    return tmp_path


def two_balls(path: Path, size: float = 1.0) -> Path:
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    vertices = np.concatenate([small.vertices + 9.0, size * large.vertices])
    np.savez(path, vertices=vertices, faces=np.concatenate([small.faces, large.faces + 42]))
    return path


def opened(window: MainWindow, path: Path, qtbot: QtBot) -> MainWindow:
    window.open_mesh(path)
    document = window.document
    qtbot.waitUntil(lambda: document.path == path and document.work.job is None, timeout=PATIENCE)
    window.wait()
    return window


def test_what_was_made_is_there_again_and_can_be_left_out(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path, other = two_balls(folder / "balls.npz"), two_balls(folder / "other.npz", 2.0)
    window = opened(open_window(), path, qtbot)
    document = window.document
    document.set_unit("nm")
    document.repair("keep_largest_component")
    qtbot.waitUntil(lambda: document.repairs != () and document.work.job is None, timeout=PATIENCE)
    for vertex in (3, 100):
        document.pins.toggle(vertex)
    document.pins.toggle(3)
    document.pins.change("name of a pin", 100, name="soma", own_color="#123456")
    document.selection.set(np.arange(162) < 10)
    document.hiding.hide(np.arange(162) > 150)
    document.display.set_limits(LockedLimits(-1.0, 2.0))
    document.display.sequential_colormap = "magma"
    mesh = document.mesh
    assert isinstance(mesh, Mesh)
    height = VertexMap("height", mesh.vertices[:, 2].astype(np.float32), unit="nm")
    document.maps.add(mesh, [height])
    document.set_unit("µm")
    document.display.kind = HeatKernelSignature.name
    document.display.shape = Shape(shown=True, pairs=6)
    camera = window.scene.camera()
    camera["half_size"] *= 2.0
    window.scene.set_camera(camera)
    opened(window, other, qtbot)  # at once, before the timer saves anything
    assert document.pins.placed == ()

    def check(window: MainWindow) -> None:
        document = window.document
        qtbot.waitUntil(lambda: len(document.pins.placed) == 1, timeout=PATIENCE)
        window.wait()
        assert document.mesh is not None
        assert document.unit == "µm"
        assert document.repairs == ("keep_largest_component",)
        (pin,) = document.pins.placed
        assert (pin.number, document.mesh.file_index(pin.vertex)) == (2, 142)
        assert (pin.name, pin.color) == ("soma", "#123456")
        assert document.selection.mask is not None
        assert np.flatnonzero(document.selection.mask).tolist() == list(range(10))
        assert np.flatnonzero(document.hiding.mask).tolist() == list(range(151, 162))
        assert document.display.policies["eigenfunction"] == LockedLimits(-1.0, 2.0)
        assert document.display.sequential_colormap == "magma"
        kept = document.mesh.map_named("height")
        np.testing.assert_allclose(kept.values, height.values)
        assert kept.unit == "nm"
        assert window.scene.camera()["half_size"] == pytest.approx(camera["half_size"])

    check(opened(window, path, qtbot))
    window.close()
    again = opened(open_window(), path, qtbot)
    check(again)
    assert "1 rebuilt shape" in again.stage.message_bar.notice.text
    button = part(again, "message_action")
    assert button.text() == "Start afresh"
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: again.document.repairs == (), timeout=PATIENCE)
    again.wait()
    assert again.document.pins.placed == ()
    assert again.document.mesh is not None
    assert not again.document.mesh.maps
    again.close()


@pytest.mark.slow
def test_a_changed_file_is_opened_without_what_was_made_on_the_old_one(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path = two_balls(folder / "balls.npz")
    window = opened(open_window(), path, qtbot)
    window.document.pins.toggle(100)
    window.close()
    two_balls(path, 3.0)
    again = opened(open_window(), path, qtbot)
    assert again.document.pins.placed == ()
    notice = again.stage.message_bar.notice
    assert notice is not None
    assert "has changed" in notice.text


@pytest.mark.slow
def test_maps_of_files_and_the_part_are_there_again_and_no_step_to_undo(
    open_window: Callable[..., MainWindow],
    folder: Path,
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path, table = two_balls(folder / "balls.npz"), folder / "values.csv"
    window = opened(open_window(), path, qtbot)
    mesh = window.document.mesh
    assert isinstance(mesh, Mesh)
    rows = (f"{at},{2 * at}" for at in range(mesh.n_vertices))
    table.write_text("\n".join(("radius,depth", *rows)))
    window.document.maps.open([table])
    qtbot.waitUntil(lambda: "new maps" in window.document.history.undo_label, timeout=PATIENCE)
    window.document.take_part(np.arange(mesh.n_vertices) >= 42)
    qtbot.waitUntil(lambda: window.document.part_mesh is not None, timeout=PATIENCE)
    window.close()
    read, may_read = maps.maps_and_remarks, Event()

    def read_later(*given: Any) -> Any:
        may_read.wait()
        return read(*given)

    monkeypatch.setattr(maps, "maps_and_remarks", read_later)
    try:
        again = open_window()
        document, saved = again.document, again.opening.last_session
        again.open_mesh(path)
        qtbot.waitUntil(lambda: document.part_mesh is not None, timeout=PATIENCE)
        assert not document.history.undo_label
        notice = again.stage.message_bar.notice
        assert notice is not None
        assert notice.text == "Opened as you left it: 1 map file, 1 part."
        # maps that are still being read stay in the session, and undo does not remove them
        document.maps.add(document.mesh, [VertexMap("mine", np.arange(mesh.n_vertices))])
        qtbot.waitUntil(lambda: bool(again.scene.camera()), timeout=PATIENCE)
        saved.save()
        qtbot.waitUntil(lambda: is_idle(saved))
        stored = saved.stored(path)
        assert stored is not None
        assert stored.maps == [str(table)]
    finally:
        may_read.set()
    qtbot.waitUntil(lambda: len(document.mesh.maps) == 3, timeout=PATIENCE)
    document.history.undo()
    assert {each.name for each in document.mesh.maps} == {"radius", "depth"}
    document.history.redo()
    assert len(document.mesh.maps) == 3
    assert session_of(document, {}).maps == [str(table)]


@pytest.mark.slow
def test_what_is_damaged_is_said_and_kept(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path = two_balls(folder / "balls.npz")
    window = opened(open_window(), path, qtbot)
    mesh = window.document.mesh
    assert mesh is not None
    window.document.maps.add(mesh, [VertexMap("height", mesh.vertices[:, 2])])
    window.document.set_unit("nm")  # the map still belongs to no file
    window.close()
    (session,) = (folder / "sessions").glob("*.meshmash.json")
    (maps,) = (folder / "sessions").glob("*.maps.npz")
    maps.write_bytes(maps.read_bytes()[:300])
    window = opened(open_window(), path, qtbot)
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.text.startswith("The maps kept of balls.npz cannot be read")
    window.close()
    half = session.read_bytes()[:200]
    session.write_bytes(half)
    window = opened(open_window(), path, qtbot)
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.text.startswith(
        "balls.npz is opened without the pins, maps and settings of its last session."
    )
    (kept,) = (folder / "sessions").glob("*.meshmash.unreadable")
    assert kept.read_bytes() == half


@pytest.mark.slow
def test_a_kept_map_is_written_once(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    window = opened(open_window(), two_balls(folder / "balls.npz"), qtbot)
    document = window.document
    assert document.mesh is not None
    height = document.mesh.vertices[:, 2]

    def written() -> set[tuple[str, int]]:
        window.opening.last_session.save()
        qtbot.waitUntil(lambda: is_idle(window.opening.last_session))
        found = (folder / "sessions").glob("*.maps.npz")
        return {(each.name, each.stat().st_mtime_ns) for each in found}

    document.maps.add(document.mesh, [VertexMap("height", height), VertexMap("depth", -height)])
    first = written()
    document.maps.add(document.mesh, [VertexMap("double", 2.0 * height)])
    assert (len(first), len(written()), len(written() & first)) == (2, 3, 2)
    document.maps.remove("depth")
    assert (len(written()), len(written() & first)) == (2, 1)


def test_a_change_is_saved_before_the_next_frame(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path = two_balls(folder / "balls.npz")
    window = opened(open_window(), path, qtbot)
    last, pins = window.opening.last_session, list[list[int]]()

    def look() -> None:
        session = last.stored(path)
        assert session is not None
        pins.append(session.pins)

    last.save()
    assert last.stored(path) is not None
    window.document.pins.toggle(5)
    window.plotter.frame_due.connect(look)
    qtbot.waitUntil(lambda: bool(pins), timeout=PATIENCE)
    window.plotter.frame_due.disconnect(look)
    assert pins[0] == [5]


@pytest.mark.slow
def test_a_camera_at_rest_is_saved(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path = two_balls(folder / "balls.npz")
    window = opened(open_window(), path, qtbot)
    last = window.opening.last_session
    last.save()
    session = last.stored(path)
    assert session is not None
    before = session.camera
    render = window.plotter
    middle = render.rect().center()
    QTest.mousePress(render, Qt.MouseButton.LeftButton, pos=middle)
    for at in range(5):
        QTest.mouseMove(render, middle + QPoint(8 * at, 0))
    QTest.mouseRelease(render, Qt.MouseButton.LeftButton, pos=middle + QPoint(40, 0))

    def saved() -> bool:
        session = last.stored(path)
        return session is not None and session.camera != before

    qtbot.waitUntil(saved, timeout=PATIENCE)
    session = last.stored(path)
    assert session is not None
    assert session.camera == window.scene.camera()


@pytest.mark.slow
def test_a_view_of_the_whole_mesh_fits_a_render_of_another_size(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path = two_balls(folder / "balls.npz")
    window = opened(open_window(size=(1300, 850)), path, qtbot)
    window.scene.look_from("dorsal")
    axes = window.scene.camera()["axes"]
    window.close()
    again = opened(open_window(size=(1300, 600)), path, qtbot)
    qtbot.waitUntil(lambda: again.scene.camera()["axes"] == axes, timeout=PATIENCE)
    assert not again.scene.turned_by_hand
    wide = again.scene.camera()["half_size"]
    again.scene.set_camera(again.scene.camera() | {"half_size": 3.0 * wide})
    again.close()
    closer = opened(open_window(size=(1300, 850)), path, qtbot)
    qtbot.waitUntil(
        lambda: closer.scene.camera()["half_size"] == pytest.approx(3.0 * wide), timeout=PATIENCE
    )
    assert closer.scene.turned_by_hand


@pytest.mark.slow
def test_label_sets_are_there_as_they_were_changed(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    """Changed label sets are restored, both of the mesh file and of another label file."""
    ball, path, annotation = (
        shapes.icosphere(2),
        folder / "ball.surf.gii",
        folder / "lh.halves.annot",
    )
    halves = (ball.vertices[:, 2] > 0.0).astype(np.int32)
    image = GiftiImage()
    image.labeltable = GiftiLabelTable()
    for key, name in enumerate(("low", "high")):
        entry = GiftiLabel(key, 0.2, 0.4, 0.6, 1.0)
        entry.label = name
        image.labeltable.labels.append(entry)
    arrays = ball.vertices.astype("f4"), ball.faces.astype("i4"), halves
    for intent, values in zip(("POINTSET", "TRIANGLE", "LABEL"), arrays, strict=True):
        image.add_gifti_data_array(GiftiDataArray(values, intent=f"NIFTI_INTENT_{intent}"))
    path.write_bytes(image.to_bytes())
    write_annot(
        annotation,
        halves,
        np.array([[9, 9, 9, 0], [200, 9, 9, 0]]),
        ["low", "high"],
        fill_ctab=True,
    )
    window = opened(open_window(), path, qtbot)
    document = window.document
    document.maps.open([annotation])
    qtbot.waitUntil(lambda: len(document.labels.sets) == 2, timeout=PATIENCE)
    document.selection.set(ball.vertices[:, 0] > 0.5)
    for each in document.labels.sets:
        document.labels.choose(each.name)
        document.labels.new_label()
        document.labels.assign(2)
        document.labels.rename(0, "floor")
    document.labels.new_set()
    document.labels.new_label()
    document.labels.lock(2, True)

    def sets(window: MainWindow) -> dict[str, tuple[object, ...]]:
        return {
            each.name: (each.labels, each.values.tolist()) for each in window.document.labels.sets
        }

    made = sets(window)
    assert [len(labels) for labels, _ in made.values()] == [3, 3, 2]
    document.maps.show("Mean curvature")
    session = folder / "saved.meshmash.json"
    window.opening.store_session(session)
    window.close()
    other = open_window()
    other.opening.restore_session(session)
    qtbot.waitUntil(lambda: sets(other) == made, timeout=PATIENCE)
    assert other.document.labels.current.name == "labels"
    other.close()
    again = opened(open_window(), path, qtbot)
    qtbot.waitUntil(lambda: again.background_io.idle, timeout=PATIENCE)
    assert sets(again) == made
    assert again.document.labels.current.name == "labels"
    assert not again.document.history.undo_label
    again.document.labels.choose("labels")
    again.document.labels.recolor(1, "#123456")  # changed names and colours alone are saved, too
    made = sets(again)
    again.close()
    assert sets(opened(open_window(), path, qtbot)) == made


@pytest.mark.slow
def test_maps_of_one_file_are_all_there_in_their_order(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    """Maps of a label file opened twice, and of a table with names in use, keep their order."""
    path, other = two_balls(folder / "balls.npz"), two_balls(folder / "other.npz", 2.0)
    window = opened(open_window(), path, qtbot)
    document, n = window.document, 204
    names = "lh.halves.annot"
    annotation, table = folder / names, folder / "values.csv"
    halves, table_of_colors = np.arange(n) % 2, np.array([[9, 9, 9, 0], [200, 9, 9, 0]])
    write_annot(annotation, halves, table_of_colors, ["low", "high"], fill_ctab=True)
    table.write_text("\n".join(("radius,depth", *(f"{at},{2 * at}" for at in range(n)))))

    def add(file: Path, count: int) -> None:
        document.maps.open([file])
        qtbot.waitUntil(lambda: len(document.mesh.maps) == count, timeout=PATIENCE)

    document.maps.add(document.mesh, [VertexMap("radius", np.ones(n))])
    add(annotation, 2)
    document.labels.choose(names)
    document.selection.set(np.arange(n) < 9)
    document.labels.assign(1)
    add(annotation, 3)
    add(table, 5)
    add(table, 7)

    def maps(window: MainWindow) -> list[tuple[object, ...]]:
        mesh = window.document.mesh
        return [(each.name, each.labels, each.values.tolist()) for each in mesh.maps]

    made = maps(window)
    assert [name for name, *_ in made] == [
        "radius", names, f"{names} 2", "radius 2", "depth", "radius 3", "depth 2"
    ]  # fmt: skip
    session = folder / "saved.meshmash.json"
    window.opening.store_session(session)
    opened(window, other, qtbot)
    opened(window, path, qtbot)
    qtbot.waitUntil(lambda: maps(window) == made, timeout=PATIENCE)
    window.close()
    for _ in range(2):
        again = opened(open_window(), path, qtbot)
        qtbot.waitUntil(lambda again=again: maps(again) == made, timeout=PATIENCE)
        again.close()
    by_hand = open_window()
    by_hand.opening.restore_session(session)
    by_hand.wait()
    qtbot.waitUntil(lambda: maps(by_hand) == made, timeout=PATIENCE)
    by_hand.close()
    given = open_window()  # a map file opened at each start adds no copy of its maps
    given.opening.read(path, maps=[annotation])
    given.wait()
    qtbot.waitUntil(lambda: len(given.document.mesh.maps) >= 7, timeout=PATIENCE)
    qtbot.waitUntil(lambda: given.background_io.idle, timeout=PATIENCE)
    assert maps(given) == made


@pytest.mark.slow
@pytest.mark.parametrize("by_hand", [slow(False), True])
def test_classes_are_there_with_choices_and_scores(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot, by_hand: bool
) -> None:
    ball, path = shapes.blob(3), folder / "blob.npz"
    np.savez(path, vertices=ball.vertices, faces=ball.faces, unit="nm")
    window = opened(open_window(), path, qtbot)
    document = window.document
    document.solve.target = Target("count", 40)
    document.solve.compute()
    qtbot.waitUntil(lambda: document.solve.is_computed, timeout=PATIENCE)
    document.labels.new_set()
    document.labels.new_label()
    x, y, z = shapes.icosphere(3).vertices.T
    for key, side in ((1, z > 0.6), (2, z < 0.2)):
        for half in (x > 0.3, x < -0.3):
            document.selection.set(side & half & (np.abs(y) < 0.3))
            document.labels.assign(key)
    classes = document.classes
    classes.options = ClassOptions(("curvature", "hks"), "logistic", 0.02)
    classes.classify()
    qtbot.waitUntil(lambda: classes.learned is not None, timeout=PATIENCE)
    window.arrangement.docks["label"].raise_()
    catch_up()
    note, learned = part(window, "class_note").text(), classes.learned
    assert note.startswith("F1 on strokes left out: label 1 ")
    classes.live = True
    saved = folder / "saved.meshmash.json"
    window.opening.store_session(saved)
    window.close()

    window = open_window()
    if by_hand:
        window.opening.restore_session(saved)
    else:
        window.open_mesh(path)
    document, classes = window.document, window.document.classes
    qtbot.waitUntil(lambda: classes.learned is not None, timeout=PATIENCE)
    qtbot.waitUntil(lambda: document.work.job is None, timeout=PATIENCE)
    window.arrangement.docks["label"].raise_()
    catch_up()
    assert classes.options == ClassOptions(("curvature", "hks"), "logistic", 0.02)
    assert classes.live
    assert classes.learned == learned
    assert part(window, "class_note").text() == note
    kinds = [
        part(window, f"class_{kind}_check").isChecked() for kind in ("hks", "wks", "curvature")
    ]
    assert kinds == [True, False, True]
    assert part(window, "class_classifier_combo").currentText() == "Logistic regression"
    assert part(window, "class_smoothing_field").value == 0.02
    if document.spectrum is None:
        document.solve.target = Target("count", 40)
        document.solve.compute()
    qtbot.waitUntil(
        lambda: document.solve.is_computed and document.work.job is None, timeout=PATIENCE
    )
    assert classes.learned is not None
    assert classes.learned == learned, "what is live is not learned again"

    classes.live, classes.options = False, ClassOptions(("hks",))
    window.opening.store_session(saved)
    window.close()
    window = open_window()
    window.opening.restore_session(saved)
    classes = window.document.classes
    qtbot.waitUntil(lambda: classes.learned == learned, timeout=PATIENCE)
    assert classes.outdated, "the prediction of another session had other options"


@pytest.mark.slow
def test_pins_and_maps_of_the_second_mesh_are_there_again(
    open_window: Callable[..., MainWindow], folder: Path, qtbot: QtBot
) -> None:
    path, other = two_balls(folder / "balls.npz"), two_balls(folder / "other.npz", 2.0)
    window = opened(open_window(), path, qtbot)
    window.document.solve.compute()
    window.opening.open_second(other)

    def compared(window: MainWindow) -> bool:
        pair = window.opening.pair
        return pair is not None and pair.comparison is not None

    qtbot.waitUntil(lambda: compared(window), timeout=PATIENCE)
    pair = window.opening.pair
    assert pair is not None
    pair.second.pins.toggle(180)
    pair.second.pins.drag(180, 185)
    pair.second.pins.drop()
    mesh = pair.second.mesh
    assert isinstance(mesh, Mesh)
    pair.second.maps.add(mesh, [VertexMap("height", mesh.vertices[:, 2], unit="nm")])
    above = mesh.vertices[:, 2] > 0.0
    pair.second.selection.set(above)
    pair.second.hiding.hide(~above)
    pair.link("position", False)
    pair.second.display.change(HeatKernelSignature, time=7.0)
    window.close()

    window = opened(open_window(), path, qtbot)
    qtbot.waitUntil(lambda: compared(window), timeout=PATIENCE)
    pair = window.opening.pair
    assert pair is not None and pair.second.mesh is not None  # noqa: PT018
    assert [pin.vertex for pin in pair.second.pins.placed] == [185]
    np.testing.assert_array_equal(pair.second.selection.mask, above)
    np.testing.assert_array_equal(pair.second.hiding.mask, ~above)
    assert "position" not in pair.links
    assert pair.second.display[HeatKernelSignature].time == 7.0
    (kept,) = pair.second.mesh.maps
    assert kept.name == "height"
    np.testing.assert_array_equal(kept.values, mesh.vertices[:, 2])

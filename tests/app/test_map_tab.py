"""Tab of own maps: files are dropped, listed, rebuilt from pairs and drawn in label colours."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import nibabel
import numpy as np
import pytest
import shapes
from nibabel.freesurfer import write_annot, write_morph_data
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QListWidget,
    QPushButton,
    QSpinBox,
    QWidget,
)
from pytestqt.qtbot import QtBot
from scipy.linalg import eigh
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.app.tabs.parameters import FilterParameterRow
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.maps import CURVATURES, OwnMaps
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import format_number, format_quantity, format_range, format_share

LEFT = Qt.MouseButton.LeftButton
MESH = shapes.icosphere(3, radius=50.0)
DEPTH = np.sin(0.07 * MESH.vertices[:, 0]) + 0.01 * MESH.vertices[:, 1]
#: Axis of the largest coordinate of each vertex, and a pure colour of each axis.
SIDES = np.abs(MESH.vertices).argmax(axis=1)
COLORS = np.array([[255, 0, 0, 0], [0, 255, 0, 0], [0, 0, 255, 0]])


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(10)
    catch_up()


def drop(window: MainWindow, *paths: Path) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    place = QPointF(window.stage.mapTo(window, window.stage.rect().center()))
    copy, none = Qt.DropAction.CopyAction, Qt.KeyboardModifier.NoModifier
    window.dropEvent(QDropEvent(place, copy, data, LEFT, none))
    rest(window)


def rest(window: MainWindow) -> None:
    wait_for(lambda: window.document.work.job is None and window.background_io.idle)
    wait_for(lambda: window.controller.idle and not window.controller.field.draft)


def part(window: MainWindow, kind: type, name: str) -> QWidget:
    (found,) = window.findChildren(kind, name)
    return found


def library(window: MainWindow) -> tuple[np.ndarray, np.ndarray]:
    """Return the eigenvectors as columns, and the vertex areas of their inner product."""
    spectrum = window.document.spectrum
    mass = mv.compute_vertex_areas(window.document.mesh, robust=True)
    return np.array(spectrum.rows[: len(spectrum)]).T, mass


def look(window: MainWindow) -> tuple[object, ...]:
    """Return the colours on the render, and the limits and lists in the panel."""
    part(window, QWidget, "limits_combo").window().repaint()
    image = window.scene.plotter.grabFramebuffer()
    middle = image.rect().center()
    row = [image.pixel(x, middle.y()) for x in range(middle.x() - 60, middle.x() + 60, 10)]
    combos = ("colormap_combo", "limits_combo", "color_scale_combo")
    ends = [part(window, QWidget, f"limit_{end}_field").value for end in ("low", "high")]
    return row, ends, [part(window, QComboBox, name).currentText() for name in combos]


def names(window: MainWindow) -> list[str]:
    listed = part(window, QListWidget, "map_list")
    return [listed.item(row).text() for row in range(listed.count())]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a mesh file that has a map, and with map files."""
    folder = tmp_path_factory.mktemp("maps")
    np.savez(folder / "ball.npz", vertices=MESH.vertices, faces=MESH.faces, depth=DEPTH)
    write_morph_data(folder / "lh.thickness", np.linspace(1.0, 4.0, MESH.n_vertices))
    write_annot(folder / "lh.sides.annot", SIDES, COLORS, ["x", "y", "z"], fill_ctab=True)
    np.save(folder / "short.npy", np.ones(5))
    np.savez(folder / "more.npz", more=DEPTH**2)
    return folder


@pytest.fixture(scope="module")
def one_window(folder: Path, module_cache: Path) -> Iterator[MainWindow]:
    application()
    window = MainWindow(fresh=True)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    document = window.document
    window.open_mesh(folder / "ball.npz")
    wait_for(lambda: document.mesh is not None and document.work.job is None)
    QTest.keyClick(window, Qt.Key.Key_9)  # maps need no eigenpairs
    wait_for(lambda: window.controller.field is not None)
    rest(window)
    assert document.spectrum is None
    assert document.display.kind == "map"
    assert document.display[OwnMaps] == OwnMaps(), "controls that are built choose nothing"
    np.testing.assert_array_equal(window.controller.field.values, DEPTH.astype(np.float32))
    document.solve.target = Target("count", 40)
    QTest.mouseClick(window.mesh_panel.compute_button, LEFT)
    wait_for(lambda: bool(document.spectrum and document.spectrum.complete))
    rest(window)
    yield window
    window.close()
    window.deleteLater()


@pytest.fixture
def window(one_window: MainWindow) -> MainWindow:
    """Return the shared window with the map of its file only."""
    document = one_window.document
    for each in document.mesh.maps[1:]:
        document.maps.remove(each.name)
    document.display.show(OwnMaps(chosen="depth"))
    rest(one_window)
    one_window.stage.message_bar.dismiss()
    return one_window


@pytest.mark.slow
def test_files_are_dropped_on_the_mesh(window: MainWindow, folder: Path) -> None:
    assert names(window) == ["depth", *CURVATURES]
    spectrum, camera = window.document.spectrum, window.scene.camera()
    drop(window, folder / "lh.thickness", folder / "more.npz")
    assert names(window) == ["depth", "lh.thickness", "more", *CURVATURES]
    np.testing.assert_allclose(window.controller.field.values, DEPTH**2, rtol=1e-6)
    assert window.controller.field.title == "more"
    assert window.document.spectrum.rows is spectrum.rows
    assert window.scene.camera() == camera
    listed = part(window, QListWidget, "map_list")
    QTest.mouseClick(listed.viewport(), LEFT, pos=listed.visualItemRect(listed.item(1)).center())
    rest(window)
    assert window.controller.field.title == "lh.thickness"
    assert part(window, QLabel, "map_range_label").text() == "1 to 4\N{NO-BREAK SPACE}mm"
    areas, values = mv.compute_vertex_areas(MESH), np.linspace(1.0, 4.0, MESH.n_vertices)
    mean = format_number(float(np.average(values, weights=areas))) + "\N{NO-BREAK SPACE}mm"
    assert part(window, QLabel, "map_mean_label").text() == mean != format_number(values.mean())
    QTest.mouseClick(part(window, QPushButton, "map_remove_button"), LEFT)
    rest(window)
    assert names(window) == ["depth", "more", *CURVATURES]


def test_the_mean_is_in_the_unit_of_the_range(window: MainWindow) -> None:
    values = np.zeros(MESH.n_vertices)
    values[0] = 5000.0
    window.document.maps.add(window.document.mesh, [mv.VertexMap("peak", values, unit="nm")])
    rest(window)
    assert part(window, QLabel, "map_range_label").text() == "0 to 5\N{NO-BREAK SPACE}µm"
    mean = float(np.average(values, weights=mv.compute_vertex_areas(MESH)))
    written = f"{format_number(mean / 1000.0)}\N{NO-BREAK SPACE}µm"
    assert part(window, QLabel, "map_mean_label").text() == written


@pytest.mark.slow
def test_what_is_no_map_costs_a_sentence(window: MainWindow, folder: Path) -> None:
    before = window.document.mesh
    drop(window, folder / "short.npy")
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.severity is not Severity.INFORMATION
    assert "has 5 values and the mesh 642 vertices" in notice.text
    assert str(folder / "short.npy") in notice.text
    assert window.document.mesh is before
    # of two files, the valid file is read
    drop(window, folder / "short.npy", folder / "more.npz")
    assert names(window)[:2] == ["depth", "more"]


def test_the_slider_rebuilds_the_map(window: MainWindow) -> None:
    """Field and numbers of a partial sum equal the results of the library."""
    eigenvectors, mass = library(window)
    coefficients = mv.spectral_coefficients(eigenvectors, mass, DEPTH)
    QTest.mouseClick(part(window, QPushButton, "map_view_pairs"), LEFT)
    slider = part(window, StepSlider, "map_pairs_slider")
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_Home)
    counts = []
    for key in (Qt.Key.Key_Right, Qt.Key.Key_PageDown, Qt.Key.Key_Left, Qt.Key.Key_End):
        QTest.keyClick(slider, key)
        rest(window)
        counts.append(slider.value())
        wanted = mv.reconstruct(eigenvectors, coefficients[: counts[-1]])
        field = window.controller.field
        assert np.abs(field.values - wanted).max() < 1e-6 * np.abs(DEPTH).max()
        left = float(part(window, QLabel, "map_residual_label").text())
        rest_of_it, whole = (np.sum(mass * each**2) for each in (DEPTH - wanted, DEPTH))
        assert left == pytest.approx(np.sqrt(rest_of_it / whole), rel=1e-3, abs=1e-6)
        share = float(part(window, QLabel, "map_share_label").text().removesuffix("%"))
        assert share == pytest.approx(100.0 - 100.0 * rest_of_it / whole, rel=1e-3)
        varying = np.sum(mass * (DEPTH - np.average(DEPTH, weights=mass)) ** 2)
        told = part(window, QLabel, "map_varying_label").text()
        said, of = told.split(" of what varies (")
        assert float(said.removesuffix("%")) == pytest.approx(
            100.0 - 100.0 * rest_of_it / varying, abs=0.1
        )
        assert f"these {counts[-1]} pairs" in of
        assert f"{said} of what varies" in field.quantity
    assert counts[0] == 2
    assert counts[1] > counts[2] > 2
    assert counts[3] == 40
    spin = part(window, QSpinBox, "map_pairs_spin")
    assert (spin.value(), spin.minimum(), spin.maximum()) == (40, 1, 40)


@pytest.mark.slow
def test_the_views_of_a_map_share_limits_unless_others_are_asked_for(window: MainWindow) -> None:
    combo = part(window, QComboBox, "limits_combo")
    found = {}
    for view in ("map", "pairs", "residual"):
        QTest.mouseClick(part(window, QPushButton, f"map_view_{view}"), LEFT)
        part(window, StepSlider, "map_pairs_slider").setValue(5)
        if view == "map":
            QTest.mouseClick(part(window, QPushButton, "map_view_map"), LEFT)
        rest(window)
        found[view] = window.controller.field
    np.testing.assert_allclose(
        found["residual"].values, found["map"].values - found["pairs"].values, atol=1e-6
    )
    assert len({field.limits(None) for field in found.values()}) == 1
    QTest.keyClick(combo, Qt.Key.Key_Down)
    QTest.keyClick(combo, Qt.Key.Key_Down)
    asked = window.document.display.limits
    assert asked is not None
    assert len({field.limits(asked) for field in found.values()}) == 3
    window.document.history.undo()
    QTest.mouseClick(part(window, QPushButton, "map_view_pairs"), LEFT)
    rest(window)


@pytest.mark.slow
def test_limits_that_are_locked_for_a_map_are_not_those_of_another(window: MainWindow) -> None:
    listed, combo = part(window, QListWidget, "map_list"), part(window, QComboBox, "limits_combo")
    high = part(window, NumberField, "limit_high_field")
    before = high.value
    high.setFocus()
    high.selectAll()
    QTest.keyClicks(high, "0.5")
    QTest.keyClick(high, Qt.Key.Key_Return)
    rest(window)
    depth = names(window).index("depth")
    found = []
    for row in (depth, len(names(window)) - 1, depth):
        listed.setCurrentRow(row)
        rest(window)
        found.append((combo.currentText(), high.value == 0.5))
    assert before != 0.5
    assert found == [("Locked", True), ("Automatic", False), ("Locked", True)]
    QTest.mouseClick(part(window, QPushButton, "map_view_pairs"), LEFT)
    rest(window)
    assert combo.currentText() == "Locked", "a view of the same map"
    combo.setCurrentIndex(0)
    combo.activated.emit(0)
    rest(window)
    assert window.document.display.policies == {}


def test_the_spectrum_of_the_map_is_on_its_panel(window: MainWindow) -> None:
    panel = window.spectrum_panel
    assert part(window, QPushButton, "spectrum_view_responses").text() == "Map"
    wait_for(lambda: len(panel.view.response.getData()[0]) == 3 * 40)
    heights = panel.view.response.getData()[1].reshape(-1, 3)[:, 1]
    squares = mv.spectral_coefficients(*library(window), DEPTH) ** 2
    assert heights.argmax() == squares.argmax()
    axis = panel.plot.getAxis("left")
    assert axis.tickStrings([0.0, 0.5, 0.6, 1.0], 1.0, 0.5) == ["10⁻⁶", "0.001", None, "1"]
    drawn = heights > 0.0
    relative = squares[drawn] / squares[1:].max()
    np.testing.assert_allclose(6.0 * (heights[drawn] - 1.0), np.log10(relative), atol=1e-6)
    window.document.display.change(OwnMaps, chosen="Mean curvature")
    rest(window)
    wait_for(lambda: "Mean curvature" in panel.legend.text())
    np.testing.assert_allclose(window.controller.field.values, 0.02, rtol=1e-2)


def test_coefficients_are_saved_from_the_tab(
    window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "depth.npz"
    answers = [(str(path), ""), ("", ""), (str(tmp_path / "no" / "such.csv"), "")]
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: answers.pop(0))
    save = part(window, QPushButton, "map_save_button")
    wait_for(save.isEnabled)
    QTest.mouseClick(save, LEFT)
    with np.load(path) as content:
        wanted = mv.spectral_coefficients(*library(window), DEPTH)
        np.testing.assert_allclose(content["coefficient"], wanted, atol=1e-9)
    assert str(path) in window.stage.message_bar.notice.text
    for _ in range(2):
        QTest.mouseClick(save, LEFT)
    assert "were not saved" in window.stage.message_bar.notice.text


@pytest.mark.slow
def test_columns_that_are_no_map_are_named(window: MainWindow, tmp_path: Path) -> None:
    rows = [f"{at},{at * 2},part {at % 3}," for at in range(MESH.n_vertices)]
    (tmp_path / "table.csv").write_text("\n".join(["a,a,region,empty", *rows]) + "\n")
    drop(window, tmp_path / "table.csv")
    assert names(window) == ["depth", "a", "a 2", *CURVATURES]
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.severity is Severity.WARNING
    assert "'region' (not numbers, such as 'part 0'), 'empty' (it is empty)" in notice.text


def test_facts_are_of_the_part_that_eigenpairs_are_of(window: MainWindow) -> None:
    document = window.document
    document.take_part(MESH.vertices[:, 0] > 10.0)
    wait_for(lambda: document.part_mesh is not None and document.work.job is None)
    rest(window)
    mean = part(window, QLabel, "map_mean_label")
    wait_for(lambda: mean.text() != "")
    inside = document.part_mesh.referenced
    values, areas = DEPTH[inside], document.part_mesh.vertex_areas[inside]
    assert part(window, QLabel, "map_count_label").text() == f"{inside.sum():,} in the mask"
    assert part(window, QLabel, "map_range_label").text() == format_range(
        values.min(), values.max(), "", word="to", digits=4
    )
    assert mean.text() == format_number(float(np.average(values, weights=areas)))
    document.take_part(None)
    wait_for(lambda: document.part_mesh is None and document.work.job is None)
    assert part(window, QLabel, "map_count_label").text() == "642"


@pytest.mark.slow
@pytest.mark.pixels
def test_labels_have_their_colors_on_the_render(window: MainWindow, folder: Path) -> None:
    drop(window, folder / "lh.sides.annot")
    listed = part(window, QListWidget, "map_label_list")
    assert [listed.item(row).text() for row in range(listed.count())] == ["x", "y", "z"]
    assert not window.findChild(QWidget, "colormap_combo").isEnabled()
    wait_for(lambda: window.scene.at_rest)
    picture = window.scene.picture()
    ratio = window.scene.devicePixelRatioF()
    eye = np.array(window.scene.renderer.view.axes[2])
    towards = MESH.vertices @ eye / 50.0
    # away from the rim, and from the borders between the labels
    second = np.sort(np.abs(MESH.vertices), axis=1)[:, 1]
    inside = np.flatnonzero((towards > 0.6) & (np.abs(MESH.vertices).max(axis=1) - second > 12.0))
    seen = set()
    for vertex in inside:
        place = window.scene.display_point(int(vertex))
        pixel = picture[round(place.y() * ratio), round(place.x() * ratio), :3].astype(int)
        side = int(pixel.argmax())
        assert side == SIDES[vertex]
        assert pixel[side] > 3 * max(pixel[(side + 1) % 3], pixel[(side + 2) % 3])
        seen.add(side)
    assert len(seen) >= 2
    window.scene.vertex_hovered.emit(int(inside[0]))
    assert "xyz"[SIDES[inside[0]]] in window.hover_label.text().split("  ·  ")
    document = window.document
    document.display.change(OwnMaps, chosen="depth", view="band")
    rest(window)
    assert listed.count() == len(window.controller.field.labels) > 3


@pytest.mark.slow
def test_a_mesh_comes_with_its_maps(open_window: Callable[..., MainWindow], folder: Path) -> None:
    """Maps dropped with a mesh are added to the mesh; a map dropped alone is refused."""
    window = open_window()
    drop_alone = folder / "lh.thickness"
    window.opening.open_path(drop_alone)
    assert "open the mesh first" in window.stage.message_bar.notice.text
    drop_all = [folder / "more.npz", folder / "ball.npz", drop_alone]
    window.opening.open_paths(drop_all)
    wait_for(lambda: window.document.mesh is not None)
    rest(window)
    assert [each.name for each in window.document.mesh.maps] == ["depth", "more", "lh.thickness"]
    window.document.repair("keep_largest_component")
    rest(window)
    window.document.maps.remove("more")
    window.document.undo_repair()
    rest(window)
    assert "lh.thickness" in names(window)


@pytest.mark.slow
def test_a_session_keeps_the_maps_and_the_choice(
    open_window: Callable[..., MainWindow], folder: Path, tmp_path: Path
) -> None:
    """A session whose map file is missing opens without the map and reports the file."""
    for name in ("ball.npz", "lh.thickness", "more.npz"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    first = open_window()
    drop(first, *(tmp_path / name for name in ("ball.npz", "lh.thickness", "more.npz")))
    wait_for(lambda: first.document.mesh is not None and first.background_io.idle)
    first.document.display.show(OwnMaps(chosen="lh.thickness", pairs=9))
    session = tmp_path / "look.meshmash.json"
    first.opening.store_session(session)
    assert '"lh.thickness"' in session.read_text()
    assert str(tmp_path) not in session.read_text(), "they can be moved together"

    second = open_window()
    drop(second, session)
    wait_for(lambda: second.document.mesh is not None and len(second.document.mesh.maps) == 3)
    rest(second)
    assert second.document.display[OwnMaps] == OwnMaps(chosen="lh.thickness", pairs=9)
    assert second.controller.field.title == "lh.thickness"

    (tmp_path / "lh.thickness").unlink()
    third = open_window()
    drop(third, session)
    wait_for(lambda: third.document.mesh is not None and len(third.document.mesh.maps) == 2)
    rest(third)
    assert "lh.thickness does not exist" in third.stage.message_bar.notice.text
    assert third.controller.field.title == "depth"


def test_what_is_filtered_is_kept_and_exported(window: MainWindow, tmp_path: Path) -> None:
    document = window.document
    QTest.mouseClick(part(window, QPushButton, "map_view_filter"), LEFT)
    rest(window)
    wait_for(part(window, QPushButton, "map_keep_button").isEnabled)
    field, width = window.controller.field, part(window, QListWidget, "map_list").width()
    QTest.mouseClick(part(window, QPushButton, "map_keep_button"), LEFT)
    rest(window)
    assert part(window, QListWidget, "map_list").width() <= width, "a long name widens nothing"
    kept = document.mesh.maps[-1]
    assert names(window) == ["depth", kept.name, *CURVATURES]
    n_pairs = len(document.spectrum)
    assert kept.name.startswith(f"depth, filtered with {n_pairs} pairs through x < c, c = ")
    assert window.controller.field.title == kept.name
    dialog = ExportDialog(document, tmp_path, window)
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("hks"))
    assert kept.name in dialog.columns_label.text()
    document.work.write(dialog.path, dialog.export())
    rest(window)
    with np.load(dialog.path) as file:
        found = file["features"][:, list(file["columns"]).index(kept.name)]
    phi, mass = library(window)
    cut = document.display[Filters].value("c", document.spectrum)
    weights = document.spectrum.eigenvalues < cut
    assert 1 < weights.sum() < len(weights)
    wanted = phi @ (weights * (phi.T @ (mass * DEPTH)))
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())
    np.testing.assert_array_equal(field.values, kept.values)
    assert window.controller.field.colors(document.display) == field.colors(document.display)


@pytest.mark.slow
def test_what_a_filter_misses_beyond_the_last_pair_is_bounded(window: MainWindow) -> None:
    document, mesh = window.document, window.document.mesh
    chosen, rough = document.display[Filters], np.cos(0.3 * mesh.vertices[:, 0])
    document.maps.add(mesh, [mv.VertexMap("rough", rough, unit="mm")])
    mesh = document.mesh
    document.display.put(Filters("exp(-s*x)"))
    QTest.mouseClick(part(window, QPushButton, "map_view_filter"), LEFT)
    rest(window)
    assert window.controller.field.title.startswith("rough")
    note = part(window, QLabel, "map_filter_missing")
    stiffness, lumped = mv.cotangent_laplacian(mesh, robust=True)
    values, vectors = eigh(stiffness.toarray(), lumped.toarray())
    mass, last = lumped.diagonal(), float(document.spectrum.eigenvalues[-1])
    whole = vectors.T @ (mass * rough)
    varies = float(np.square(whole[1:]).sum())
    # the last pairs are a part of a multiplet, whose basis is arbitrary
    phi, _ = library(window)
    rest_of_map = rough - phi @ (phi.T @ (mass * rough))
    left = float(mass @ np.square(rest_of_map))
    for passed in (0.9, 0.5):
        s = -np.log(passed) / last
        document.display.change(Filters, values=(("s", s),))
        rest(window)
        filtered = vectors @ (np.exp(-s * values) * (vectors.T @ (mass * rest_of_map)))
        missing, bound = float(mass @ np.square(filtered)), passed**2 * left
        assert 0.0 < missing <= bound
        share = f"{format_share(bound / varies)} of what varies is missing"
        assert window.controller.field.quantity.endswith(f": up to {share}")
        assert note.isVisible() == (bound / varies > 0.01)
        if note.isVisible():
            assert f"The filter is {passed} at the last of" in note.text()
            size = format_quantity(np.sqrt(bound / mass.sum()), "mm", 1, 2)
            assert f"at most {size}. The mesh resolves about 31 pairs" in note.text()
    assert bound / varies > 0.01, "the note was seen"
    document.display.change(OwnMaps, chosen="Gaussian curvature")  # a computed map
    document.display.change(Filters, values=(("s", 1e-6 / last),))
    rest(window)
    share = document.display[OwnMaps].resolved(document.spectrum, document.display.fields)
    assert note.isVisible() == (share.missing(document.spectrum)[1] > 0.01)
    assert note.isVisible()
    document.display.change(OwnMaps, chosen="rough")
    document.display.change(Filters, values=(("s", 50.0 / last),))
    rest(window)
    assert not note.isVisible()
    assert "missing" not in window.controller.field.quantity
    document.display.put(chosen)


@pytest.mark.slow
def test_a_gaussian_is_given_by_its_width(window: MainWindow) -> None:
    document = window.document
    chosen = document.display[Filters]
    document.set_unit("mm")
    document.display.put(Filters("exp(-s*x)"))
    QTest.mouseClick(part(window, QPushButton, "map_view_filter"), LEFT)
    rest(window)
    field = part(window, NumberField, "map_filter_parameter_0_field")
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, "20 mm")
    QTest.keyClick(field, Qt.Key.Key_Return)
    s = document.display[Filters].value("s", document.spectrum)
    # exp(-r²/4s) is one half at half the width
    np.testing.assert_allclose(np.exp(-(10.0**2) / (4.0 * s)), 0.5, rtol=1e-12)
    rest(window)
    texts = [label.text() for label in field.parentWidget().findChildren(QLabel)]
    assert "FWHM 20\N{NO-BREAK SPACE}mm" in texts
    document.display.put(chosen)
    while document.unit and document.history.past:
        document.history.undo()
    assert document.unit == ""


@pytest.mark.slow
def test_a_kept_map_is_renamed_in_the_list(window: MainWindow) -> None:
    document = window.document
    QTest.mouseClick(part(window, QPushButton, "map_view_residual"), LEFT)
    rest(window)
    assert window.controller.field.title == "depth, residual"
    wait_for(part(window, QPushButton, "map_keep_button").isEnabled)
    QTest.mouseClick(part(window, QPushButton, "map_keep_button"), LEFT)
    rest(window)
    listed, kept = part(window, QListWidget, "map_list"), names(window)[1]

    def rename(name: str) -> None:
        QTest.keyClick(listed, Qt.Key.Key_F2)
        editor = listed.findChild(QLineEdit)
        QTest.keyClicks(editor, name)
        QTest.keyClick(editor, Qt.Key.Key_Return)
        wait_for(lambda: listed.findChild(QLineEdit) is None)
        rest(window)

    values = document.mesh.maps[-1].values
    rename("sulci")
    assert names(window) == ["depth", "sulci", *CURVATURES]
    assert document.maps.displayed == "sulci"
    assert window.controller.field.title == "sulci"
    np.testing.assert_array_equal(document.mesh.map_named("sulci").values, values)
    rename("depth")  # a name in use
    assert names(window) == ["depth", "depth 2", *CURVATURES]
    assert "There is a map called depth already" in window.stage.message_bar.notice.text
    rename("  ")
    assert names(window) == ["depth", "depth 2", *CURVATURES]
    limits = LockedLimits(-1.0, 2.0)
    document.display.set_limits(limits)
    rename("folds")
    display, key = document.display, document.display.family.limits_key
    assert key.endswith("folds")
    assert [each for each in display.policies.values() if each == limits] == [limits]
    assert [each for each, _ in display[OwnMaps].colors] == ["folds"]
    document.history.undo()
    rest(window)
    assert document.maps.displayed == "depth 2"
    assert display.limits == limits
    assert key not in display.policies
    for _ in range(3):
        document.history.undo()
    rest(window)
    assert names(window) == ["depth", kept, *CURVATURES]
    assert document.maps.displayed == kept
    listed.setCurrentRow(2)
    QTest.keyClick(listed, Qt.Key.Key_F2)
    assert listed.findChild(QLineEdit) is None, "a curvature has its name"


@pytest.mark.parametrize(("power", "wanted"), [(-2, (2.0 * np.pi / 500.0) ** 2), (2, 2.5e5)])
def test_a_parameter_is_typed_as_the_length_that_it_means(
    qtbot: QtBot, power: int, wanted: float
) -> None:
    row, given, said = FilterParameterRow("parameter"), [], []
    qtbot.addWidget(row)
    row.chosen.connect(lambda _name, value: given.append(value))
    row.field.refused.connect(said.append)
    row.show_parameter("c", 1.0, (1e-8, 1e8), power, "nm")
    for text in ("0.5 µm", "0.5 mV"):
        row.field.selectAll()
        QTest.keyClicks(row.field, text)
        QTest.keyClick(row.field, Qt.Key.Key_Return)
    assert given == [pytest.approx(wanted)]
    assert "unit that is not known" in said[-1]


@pytest.mark.slow
def test_what_is_kept_of_a_positive_map_has_its_colours(window: MainWindow) -> None:
    """The kept map has the colours of the sum, even below zero and on a log scale."""
    document, display = window.document, window.document.display
    x = MESH.vertices[:, 0] / 50.0
    document.maps.add(document.mesh, [mv.VertexMap("spot", 10.0 ** (4.0 * x - 4.0))])
    for logarithmic in (True, False, None):
        display.change(OwnMaps, chosen="spot", view="pairs", pairs=12)
        display.set_log_scale(logarithmic)
        rest(window)
        field = window.controller.field
        assert field.values.min() < 0.0
        before = look(window)[:2]
        QTest.mouseClick(part(window, QPushButton, "map_keep_button"), LEFT)
        rest(window)
        assert window.controller.field.family.view == "map"
        assert look(window)[:2] == before


@pytest.mark.parametrize(
    ("view", "ending"), [slow("pairs", ".func.gii"), ("residual", ".shape.gii")]
)
def test_a_sum_and_its_residual_are_kept_and_exported_alone(
    window: MainWindow, tmp_path: Path, view: str, ending: str
) -> None:
    document = window.document
    document.display.change(OwnMaps, chosen="depth", pairs=30)
    QTest.mouseClick(part(window, QPushButton, f"map_view_{view}"), LEFT)
    rest(window)
    keep = part(window, QPushButton, "map_keep_button")
    wait_for(keep.isEnabled)
    field, path = window.controller.field, tmp_path / f"sum{ending}"
    window.actions_["export"].trigger()
    (dialog,) = (each for each in window.findChildren(ExportDialog) if each.isVisible())
    assert dialog.kind == "maps", "it opens on what one looks at"
    dialog.file_row.edit.setText(str(path))
    assert dialog.format.ending == ending
    QTest.mouseClick(dialog.accept_button, LEFT)
    wait_for(path.exists)
    rest(window)
    (column,) = nibabel.load(path).darrays
    np.testing.assert_allclose(column.data, field.values, rtol=1e-6)
    notice = window.stage.message_bar.notice
    assert "states no brain structure" in notice.text
    assert notice.severity is Severity.INFORMATION
    assert column.meta["Name"].startswith("depth")
    assert "30 pairs" in column.meta["Name"]
    window.activateWindow()
    wait_for(window.isActiveWindow)
    keep.setFocus()
    before = look(window)
    QTest.keyClick(keep, Qt.Key.Key_Space)
    rest(window)
    assert not keep.isVisible()
    assert window.focusWidget() is part(window, QListWidget, "map_list")
    assert look(window) == before, "limits, colour map and scale are those of before"
    np.testing.assert_array_equal(document.mesh.maps[-1].values, field.values)
    assert window.controller.field.title == document.mesh.maps[-1].name
    document.history.undo()
    rest(window)

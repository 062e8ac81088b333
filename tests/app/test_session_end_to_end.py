"""A whole session with the real window, driven by mouse and keys."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest
import shapes
from closed_form import drag, part, turn_wheel
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog, QLabel, QSlider, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.decompose import decompose_mesh
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.samples import sample_path

LEFT = Qt.MouseButton.LeftButton
CONTROL = Qt.KeyboardModifier.ControlModifier
PATIENCE = 120_000


def type_number(field: QWidget, text: str) -> None:
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)


def waiter(qtbot: QtBot) -> Callable[[Callable[[], bool]], None]:
    return lambda condition: qtbot.waitUntil(condition, timeout=PATIENCE)


def save_ball(path: Path, subdivisions: int = 3) -> Path:
    mesh = shapes.icosphere(subdivisions, radius=500.0)
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


def alive(pid: int | None) -> bool:
    if pid is None:
        return False
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def choose_family(window: MainWindow, row: int) -> None:
    families = part(window, "field_list")
    place = families.visualItemRect(families.item(row)).center()
    QTest.mouseClick(families.viewport(), LEFT, pos=place)


@pytest.mark.slow
@pytest.mark.usefixtures("own_process")
def test_open_compute_scroll_tune_inspect_export(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    wait = waiter(qtbot)
    document, display, source = window.document, window.document.display, window.controller
    canvas = window.scene.findChild(RenderWidget)

    # open
    QTest.mouseClick(window.stage.welcome.sample_button, LEFT)
    wait(lambda: document.mesh is not None and document.work.job is None)
    assert document.mesh.n_vertices > 30_000
    assert document.mesh.unit == "nm"
    wait(lambda: window.scene.can_pick)

    # compute more pairs than are finished during the next steps
    type_number(part(window, "target_count_spin"), "3000")
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    wait(lambda: document.spectrum is not None and len(document.spectrum) >= 14)
    assert part(window, "cancel_button").isEnabled()
    assert part(window, "progress_bar").isVisible()

    # scroll by wheel and keys meanwhile
    wait(lambda: source.field is not None)
    start = display[Eigenfunctions].index
    turn_wheel(canvas, 3, CONTROL)
    assert display[Eigenfunctions].index == start + 3
    wait(lambda: source.field.family.index == start + 3)
    values = source.field.values.copy()
    QTest.keyClick(canvas, Qt.Key.Key_Right)
    QTest.keyClick(canvas, Qt.Key.Key_Right)
    QTest.keyClick(canvas, Qt.Key.Key_Left)
    wait(lambda: source.field.family.index == start + 4)
    assert not np.array_equal(source.field.values, values)
    assert part(window, "eigenvector_spin").value() == start + 4
    assert document.work.job.doing == "Decomposing", "it still computes"
    turn_wheel(canvas, -1, CONTROL)
    assert display[Eigenfunctions].index == start + 3
    before = window.scene.camera()
    turn_wheel(canvas, -2)
    assert window.scene.camera() != before, "the wheel alone zooms"

    # cancel, and request fewer pairs
    QTest.mouseClick(part(window, "cancel_button"), LEFT)
    wait(lambda: document.work.job is None)
    reached = len(document.spectrum)
    assert reached >= 14
    assert not document.spectrum.complete
    assert "stopped early" in part(window, "proof_label").text()
    count = min(reached, 40)
    type_number(part(window, "target_count_spin"), str(count))
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    wait(lambda: document.work.job is None and document.spectrum.complete)
    assert len(document.spectrum) == count
    assert "complete" in part(window, "proof_label").text()
    assert not part(window, "compute_button").isEnabled(), "there is nothing left to compute"

    # HKS: drag its slider
    choose_family(window, 1)
    assert display.kind == "hks"
    wait(lambda: source.field.family.name == "hks")
    slider = part(window, "hks_time_slider")
    assert isinstance(slider, QSlider)
    time_before, middle = source.field.family.time, slider.height() // 2
    at = QPoint(round(slider.width() * 0.5), middle)
    drag(slider, at, *(at + QPoint(round(slider.width() * by), 0) for by in (0.05, 0.15, 0.3)))
    wait(lambda: source.idle)
    assert source.field.family.time > 2 * time_before
    assert not source.field.signed
    assert "µm²" in source.field.quantity

    # bands: drag the end of their range on the spectrum
    choose_family(window, 2)
    wait(lambda: source.idle and source.field.family.name == "band")
    plot, last = part(window, "spectrum_plot"), float(document.spectrum.eigenvalues[-1])
    QTest.qWait(100)
    way = [plot.pixel_of(share * last, 0.85).toPoint() for share in (1.0, 0.9, 0.7, 0.6)]
    drag(plot.viewport(), *way)
    assert not display[GeometryVectors].automatic
    assert display[GeometryVectors].high == pytest.approx(0.6 * last, rel=0.05)
    wait(lambda: source.idle)
    assert source.field.family.high == display[GeometryVectors].high

    # click a vertex in the render, read its value and its profile
    QTest.keyClick(canvas, Qt.Key.Key_R)
    choose_family(window, 1)
    wait(lambda: source.idle and source.field.family.name == "hks")
    vertex = visible_vertex(window)
    place = canvas.mapFrom(window.scene, window.scene.display_point(vertex))
    QTest.mouseMove(canvas, place)
    hover = part(window, "hover_label")
    assert isinstance(hover, QLabel)
    wait(lambda: hover.text().startswith("Vertex "))
    QTest.mouseClick(canvas, LEFT, pos=place)
    assert len(document.pins.placed) == 1
    pinned = document.pins.placed[0].vertex
    apart = np.linalg.norm(document.mesh.vertices[pinned] - document.mesh.vertices[vertex])
    assert apart < 0.02 * np.ptp(document.mesh.vertices, axis=0).max()
    profile = window.profile_panel
    wait(lambda: len(profile._curves) == 1)
    ((_, dots),) = profile._curves.values()
    wait(
        lambda: (
            dots.getData()[0] is not None
            and len(dots.getData()[0]) == display[HeatKernelSignature].scales
        )
    )

    # export, and compare the file with features from the library
    QTest.keyClick(window, Qt.Key.Key_E, CONTROL)
    wait(lambda: window.findChild(QDialog, "export_dialog") is not None)
    dialog = window.findChild(QDialog, "export_dialog")
    dialog.file_row.edit.setText(str(tmp_path / "out.npz"))
    assert dialog.kind == "hks"
    QTest.mouseClick(dialog.accept_button, LEFT)
    wait(lambda: (tmp_path / "out.npz").exists() and document.work.job is None)
    assert "written to" in window.stage.message_bar.notice.text
    with np.load(tmp_path / "out.npz") as archive:
        features, columns = archive["features"], archive["columns"]
        times = np.array([float(name.split("=")[1]) for name in columns])
        assert archive["eigenvalues"] == pytest.approx(document.spectrum.eigenvalues, rel=1e-12)
    values, vectors = decompose_mesh(read_mesh(sample_path()), n_components=count)
    t_min, t_max = times[0], times[-1]
    assert np.all(np.diff(times) > 0)
    first = 4 * np.log(10) / values[-1], 4 * np.log(10) / values[1]
    assert (t_min, t_max) == pytest.approx(first, rel=1e-2), "names are rounded"
    exact = np.geomspace(*first, len(times))
    expected = (vectors**2) @ np.exp(-np.outer(values, exact))
    np.testing.assert_allclose(features, expected, rtol=1e-6)
    _, y = dots.getData()
    np.testing.assert_allclose(10.0**y, features[pinned], rtol=1e-3)


def visible_vertex(window: MainWindow) -> int:
    """Return a visible vertex, searched along a grid of the render."""
    scene = window.scene
    for share in (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65):
        for across in np.linspace(0.15, 0.85, 60):
            vertex = scene.vertex_at(across * scene.width(), share * scene.height())
            if vertex >= 0:
                return vertex
    raise AssertionError("nothing of the mesh is in sight")


@pytest.mark.slow
@pytest.mark.usefixtures("own_process")
def test_closing_in_the_middle_leaves_nothing(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    wait = waiter(qtbot)
    window.open_mesh(sample_path())
    wait(lambda: window.document.mesh is not None and window.document.work.job is None)
    type_number(part(window, "target_count_spin"), "3000")
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    wait(lambda: window.document.spectrum is not None and len(window.document.spectrum) > 4)
    pid, folder = window.jobs.worker.process_id, window.jobs.worker.folder
    family = [process.pid for process in psutil.Process(pid).children(recursive=True)]
    assert alive(pid)
    assert folder.exists()
    window.close()
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline and (folder.exists() or any(map(alive, [pid, *family]))):
        time.sleep(0.02)
    assert not any(map(alive, [pid, *family]))
    assert not folder.exists()


def bad_files(folder: Path) -> dict[str, Path]:
    """Write files without a valid mesh; return the paths by fault."""
    ball = shapes.icosphere(1)
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {ball.n_vertices}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {ball.n_faces}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    points = "\n".join(" ".join(f"{x:.6f}" for x in row) for row in ball.vertices) + "\n"
    triangles = "".join(f"3 {a} {b} {c}\n" for a, b, c in ball.faces)
    made = {
        "empty": ("empty.ply", b""),
        "truncated": ("truncated.ply", (header + points)[: len(header) + 300].encode()),
        "text": ("text.ply", b"Dear colleague, the mesh is attached.\n"),
        "not a number": ("nan.ply", (header + points + triangles).replace(
            points.split("\n")[3], "nan 0 0").encode()),
        "index": ("index.ply",
            (header + points + triangles.replace("3 0", "3 99999", 1)).encode()),
        "no faces": ("points.ply", (header.replace(str(ball.n_faces), "0") + points).encode()),
        "ending": ("mesh.docx", b"PK"),
        "nothing left": ("flat.off", b"OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n"),
        "noise": ("noise.stl", np.random.default_rng(5).bytes(2_000_000)),
    }  # fmt: skip
    for name, content in made.values():
        (folder / name).write_bytes(content)
    paths = {what: folder / name for what, (name, _) in made.items()}
    (folder / "folder.ply").mkdir()
    return paths | {"folder": folder / "folder.ply", "missing": folder / "missing.ply"}


@pytest.mark.slow
def test_bad_files_are_one_sentence_and_the_open_mesh_stays(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    wait = waiter(qtbot)
    document, bar = window.document, window.stage.message_bar
    window.open_mesh(save_ball(tmp_path / "ball.npz"), "nm")
    wait(lambda: document.mesh is not None and document.work.job is None)
    type_number(part(window, "target_count_spin"), "20")
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    wait(lambda: document.work.job is None and document.spectrum is not None)
    mesh, spectrum = document.mesh, document.spectrum
    assert spectrum.complete
    for what, path in bad_files(tmp_path).items():
        bar.dismiss()
        window.open_mesh(path)
        wait(lambda: bar.notice is not None and document.work.job is None)
        text = bar.notice.text
        assert bar.notice.severity is Severity.ERROR, what
        assert "Traceback" not in text, what
        assert "\n" not in text, what
        assert path.name in text or "PLY" in text or "mesh" in text, what
        assert text[-1] == ".", what
        assert bar.isVisible()
        assert document.mesh is mesh, what
        assert document.spectrum is spectrum, what
    # the window still works
    window.setFocus()
    QTest.keyClick(window, Qt.Key.Key_End)
    wait(lambda: window.controller.idle and window.controller.field.family.index == 19)
    window.open_mesh(save_ball(tmp_path / "other.npz", 2))
    wait(lambda: document.mesh is not mesh)

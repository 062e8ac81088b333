"""Tab of the distances from a pin."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from closed_form import part, rectangle_document
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot
from tiers import slow_but

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.panels.field_panel import FieldPanel
from meshmash_viewer.app.tabs.pin_tabs import DistanceTab
from meshmash_viewer.features.distances import (
    biharmonic_distance,
    commute_time_distance,
    diffusion_distance,
    missing_square,
)
from meshmash_viewer.fields.distances import MEASURES, Distances
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, LiveFeatures, compute_field, request_of
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.quantities import parse_number
from meshmash_viewer.surface.geodesics import geodesic_distance
from meshmash_viewer.units import format_quantity

pytestmark = pytest.mark.usefixtures("shown_at_once")


@pytest.fixture
def panel(reopen_panel, kept_document: Document) -> FieldPanel:
    panel = reopen_panel(rectangle_document())
    kept_document.display.kind = "distance"
    return panel


@pytest.fixture
def document(panel: FieldPanel, kept_document: Document) -> Document:
    return kept_document


def test_without_a_pin_it_says_what_to_do_and_what_is_shown(
    document: Document, panel: FieldPanel
) -> None:
    for name in ("distance", "similarity"):
        document.display.kind = name
        hint, combo = part(panel, f"{name}_hint"), part(panel, f"{name}_vertex_combo")
        assert hint.text() == (
            "Click a vertex on the render to pin it. Until then the render shows the"
            " eigenfunctions."
        )
        assert combo.placeholderText() == "No vertex is pinned yet"
        above, below = (each.mapTo(panel, QPoint(0, 0)).y() for each in (combo, hint))
        assert 0 < below - above < 60, "next to the list that is empty"
    document.pins.toggle(5)
    assert not part(panel, "similarity_hint").text()


def choose(panel: FieldPanel, text: str) -> None:
    combo = part(panel, "distance_measure_combo")
    combo.setFocus()
    QTest.keyClicks(combo, text[0])
    assert combo.currentText() == text
    combo.activated.emit(combo.currentIndex())


def on_the_render(document: Document, live: LiveFeatures, *, prepared: bool = True) -> Field:
    request = request_of(document)
    assert request is not None
    if prepared:
        live.prepare(request)
    field = compute_field(request, live)
    assert field is not None
    return field


def wanted(document: Document, name: str, time: float = 1.0) -> np.ndarray:
    spectrum, vertex = document.spectrum, document.display[Distances].vertex
    count = len(spectrum)
    given = spectrum.eigenvalues, np.asarray(spectrum.rows[:count]).T, vertex
    return {
        "geodesic": lambda: geodesic_distance(document.mesh, vertex),
        "biharmonic": lambda: biharmonic_distance(*given),
        "commute": lambda: commute_time_distance(*given),
        "diffusion": lambda: diffusion_distance(*given, time),
    }[name]()


@pytest.mark.parametrize("name", MEASURES)
@pytest.mark.parametrize("prepared", slow_but([True], [True, False]))
def test_each_is_the_librarys(
    panel: FieldPanel, document: Document, name: str, prepared: bool
) -> None:
    choose(panel, MEASURES[name][0])
    document.pins.toggle(20)
    document.pins.toggle(70)
    assert document.display[Distances].vertex == 70, "the newest pin"
    live = LiveFeatures()
    if name == "geodesic" and not prepared:
        assert compute_field(request_of(document), live) is None, "there is no quick way"
        return
    field = on_the_render(document, live, prepared=prepared)
    time = document.display[Distances].time_in(document.spectrum)
    truth = wanted(document, name, time)
    # a table of times has an error of up to 1e-4 of the largest squared distance
    within = 5e-3 if name == "diffusion" and prepared else 1e-6
    np.testing.assert_allclose(field.values, truth, atol=within * truth.max())
    assert field.values[70] == 0.0
    panel.set_field(field, Limits(0.0, 1.0))
    far = format_quantity(float(field.values[20]), field.unit, digits=4)
    assert part(panel, "distance_pins_label").text() == f"1: {far}"


def test_a_long_name_of_a_pin_leaves_the_panel_as_wide(
    panel: FieldPanel, document: Document, qtbot: QtBot
) -> None:
    document.pins.toggle(70)
    document.pins.change("rename", 70, name="presynaptic site 17 on the apical dendrite")
    title = part(panel, "distance_label")
    called = "Distance from presynaptic site 17 on the apical dendrite"
    qtbot.waitUntil(lambda: title.text() == called and title.height() > 1.5 * _line(title))
    tab = panel.findChild(DistanceTab)
    assert tab.minimumSizeHint().width() < panel.width()


def _line(title: QLabel) -> int:
    return title.fontMetrics().height()


def test_the_time_of_diffusion_is_dragged_without_the_pairs(
    panel: FieldPanel, document: Document
) -> None:
    choose(panel, "Diffusion")
    document.pins.toggle(70)
    live = LiveFeatures()
    on_the_render(document, live)
    slider = part(panel, "distance_time_slider")
    slider.setFocus()
    for _ in range(3):
        QTest.keyClick(slider, Qt.Key.Key_PageUp)
        field = on_the_render(document, live, prepared=False)
        truth = wanted(document, "diffusion", document.display[Distances].time)
        np.testing.assert_allclose(field.values, truth, atol=5e-3 * truth.max())
    assert "√t = " in part(panel, "distance_time_label").text()


def test_along_the_surface_no_pairs_are_needed(panel: FieldPanel, document: Document) -> None:
    document.spectrum = None
    document.spectrum_changed.emit()
    document.pins.toggle(70)
    field = on_the_render(document, LiveFeatures())
    np.testing.assert_allclose(field.values, geodesic_distance(document.mesh, 70), rtol=1e-6)
    assert part(panel, "distance_measure_combo").isEnabled()
    choose(panel, "Biharmonic")
    assert "compute more eigenpairs" in part(panel, "distance_hint").text()
    assert request_of(document) is None


def test_what_is_missing_is_said(panel: FieldPanel, document: Document) -> None:
    choose(panel, "Commute time")
    document.pins.toggle(70)
    field = on_the_render(document, LiveFeatures())
    panel.set_field(field, Limits(0.0, 1.0))
    assert "is missing: compute more eigenpairs" in part(panel, "distance_missing_label").text()
    spectrum, family = field.request.spectrum, field.family
    QTest.mouseClick(part(panel, "distance_compute_button"), Qt.MouseButton.LeftButton)
    wanted = document.solve.target.value
    assert len(spectrum) < wanted < spectrum.n_vertices
    typical = float(np.median(field.values[field.request.sample]))
    last = spectrum.eigenvalues[-1]
    last += 4.0 * math.pi * (wanted - len(spectrum)) / document.mesh.area
    left = missing_square(
        "commute", np.full(wanted, last), document.mesh.area, spectrum.n_vertices, 1.0
    )
    whole = typical / (1.0 - family.missing(spectrum, typical))
    assert 1.0 - math.sqrt(1.0 - left / whole**2) == pytest.approx(0.01, rel=0.05)


@pytest.mark.slow
@pytest.mark.pixels
def test_lines_are_at_round_distances_from_the_pin(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    """On a flat sheet the lines are circles about the pin, as far apart as the render states."""
    document = rectangle_document()
    document.display.kind = "distance"
    window = open_window(document)
    document.pins.toggle(20)
    document.pins.toggle(70)
    document.display.nodal_lines = True
    renderer = window.scene.renderer
    qtbot.waitUntil(lambda: bool(renderer.caption.lines), timeout=60_000)
    field = window.controller.field
    assert field is not None
    spacing = field.spacing
    step = spacing / 10.0 ** np.floor(np.log10(spacing))
    assert round(step, 9) in (1.0, 2.0, 5.0)
    count = int(field.values.max() / spacing)
    assert 8 <= count <= 20
    told = f"every {format_quantity(spacing, field.unit)}"
    assert renderer.caption.quantity.endswith(f"· lines {told}")
    mesh = document.mesh
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    size = (1600, 1200)
    lined = window.scene.picture(size)[..., :3].max(axis=2)
    QTest.keyClick(window, Qt.Key.Key_N)
    qtbot.waitUntil(lambda: renderer.caption.lines is None, timeout=60_000)
    plain = window.scene.picture(size)[..., :3].max(axis=2)
    places = []
    for row, column in np.argwhere(lined < 0.5 * plain):
        place = renderer.view.from_pixels(column + 0.5, size[1] - row - 0.5, *size)
        towards = renderer.view.axes[2]
        places.append(place + (mesh.vertices[70, 2] - place[2]) / towards[2] * towards)
    on_sheet = (places > mesh.bounds[0]) & (places < mesh.bounds[1])
    distances = np.linalg.norm(places - mesh.vertices[70], axis=1)[on_sheet[:, :2].all(axis=1)]
    off = np.abs(distances - spacing * np.round(distances / spacing))
    assert np.median(off) < 0.3 * edge.max() < spacing, "a pixel is about as long"
    drawn = set(np.round(distances / spacing).astype(int).ravel().tolist())
    assert drawn >= set(range(2, count - 2))
    assert "lines" not in renderer.caption.quantity


def test_two_pins_tell_the_length_between_them(panel: FieldPanel, document: Document) -> None:
    document.pins.toggle(20)
    document.pins.toggle(70)
    panel.set_field(on_the_render(document, LiveFeatures()), Limits(0.0, 1.0))
    number, unit = part(panel, "distance_pins_label").text().removeprefix("1: ").split()
    apart = np.linalg.norm(document.mesh.vertices[20] - document.mesh.vertices[70])
    assert parse_number(f"{number} {unit}", document.mesh.unit) == pytest.approx(apart, rel=0.05), (
        "on a flat sheet it is a straight line"
    )

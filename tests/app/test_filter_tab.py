"""Tab of filters by formula: filters are chosen, dragged, typed and corrected."""

from __future__ import annotations

import numpy as np
import pytest
from closed_form import drag, part, rectangle_document, shown
from faults import raises
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from meshmash_viewer.app import theme
from meshmash_viewer.app.panels.field_panel import FieldPanel
from meshmash_viewer.app.panels.spectrum_panel import SpectrumPanel
from meshmash_viewer.features.filters import (
    band_pass_bank,
    gaussian_pyramid_bank,
    low_pass_bank,
)
from meshmash_viewer.features.formula import formula_bank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.model.display import display_from_json, display_to_json, read_display
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import LiveFeatures, compute_field, request_of

pytestmark = pytest.mark.usefixtures("shown_at_once")


@pytest.fixture
def document() -> Document:
    document = rectangle_document()
    document.display.kind = "filter"
    return document


@pytest.fixture
def panel(qtbot, document: Document) -> FieldPanel:
    return shown(qtbot, FieldPanel(document), 340, 760)


def write(panel: FieldPanel, name: str, text: str) -> None:
    field = part(panel, name)
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)


def enter(panel: FieldPanel, name: str, text: str) -> None:
    write(panel, name, text)
    QTest.keyClick(part(panel, name), Qt.Key.Key_Return)


def choose(panel: FieldPanel, text: str) -> None:
    """Choose a predefined filter by typing its first letter."""
    combo = part(panel, "filter_combo")
    combo.setFocus()
    QTest.keyClicks(combo, text[0])
    assert combo.currentText() == text
    combo.activated.emit(combo.currentIndex())


def on_the_render(document: Document, live: LiveFeatures | None = None) -> np.ndarray:
    request = request_of(document)
    assert request is not None
    field = compute_field(request, live or LiveFeatures())
    assert field is not None
    return field.values


def summed(document: Document, bank, column: int = 0) -> np.ndarray:
    spectrum = document.spectrum
    rows = spectrum.rows[: len(spectrum)]
    return accumulate_features(rows, bank(spectrum.eigenvalues))[:, column]


def colored(panel: FieldPanel, color: str) -> int:
    """Return the number of pixels of a colour in the formula field."""
    image = part(panel, "filter_formula_edit").grab().toImage()
    places = [(x, y) for x in range(image.width()) for y in range(image.height())]
    return sum(image.pixelColor(x, y).name() == color for x, y in places)


def test_an_error_of_a_formula_is_shown_at_its_character(panel: FieldPanel) -> None:
    edit, error = part(panel, "filter_formula_edit"), theme.palette().error
    write(panel, "filter_formula_edit", "exp(-t*x)")
    assert not colored(panel, error)
    write(panel, "filter_formula_edit", "exp(-t*x) + y[2]")
    assert colored(panel, error), "the character is underlined"
    QTest.keyClick(edit, Qt.Key.Key_Return)
    QTest.qWait(1)
    assert panel.window().focusWidget() is edit
    assert edit.selectedText() == "y"
    QTest.keyClick(edit, Qt.Key.Key_End)
    for _ in range(3):
        QTest.keyClick(edit, Qt.Key.Key_Backspace)
    assert not colored(panel, error)


def test_a_signed_filter_is_drawn_below_zero(qtbot, panel: FieldPanel, document: Document) -> None:
    spectrum = shown(qtbot, SpectrumPanel(document), 500, 300)
    enter(panel, "filter_formula_edit", "cos(t*sqrt(x))")
    time = document.display[Filters].value("t", document.spectrum)
    wanted = summed(document, formula_bank("cos(t*sqrt(x))", t=time))
    values = on_the_render(document)
    assert wanted.min() < 0.0
    np.testing.assert_allclose(values, wanted, atol=1e-6 * np.abs(wanted).max())
    field = compute_field(request_of(document), LiveFeatures())
    colors, _ = field.colors(document.display)
    assert colors.low == pytest.approx(-colors.high)
    QTest.qWait(1)
    drawn, below = spectrum.view.response.getData()[1], spectrum.plot.viewRange()[1][0]
    assert below < np.nanmin(drawn) < -0.9
    enter(panel, "filter_formula_edit", "exp(-t*x)")
    QTest.qWait(1)
    assert spectrum.plot.viewRange()[1][0] > -0.2


def test_a_low_pass_is_the_librarys(panel: FieldPanel, document: Document) -> None:
    cutoff = 0.5 * float(document.spectrum.eigenvalues[40] + document.spectrum.eigenvalues[41])
    enter(panel, "filter_parameter_0_field", f"{cutoff!r}")
    np.testing.assert_allclose(
        on_the_render(document), summed(document, low_pass_bank(cutoff)), rtol=1e-6
    )
    assert "µm⁻²" in request_of(document).description.quantity


def test_a_band_pass_is_the_librarys(panel: FieldPanel, document: Document) -> None:
    choose(panel, "Band-pass")
    values = document.spectrum.eigenvalues
    low, high = float(values[10]), float(values[70])
    enter(panel, "filter_parameter_0_field", f"{low!r}")
    enter(panel, "filter_parameter_1_field", f"{high!r}")
    np.testing.assert_allclose(
        on_the_render(document), summed(document, band_pass_bank(low, high)), rtol=1e-6
    )
    chosen = document.display[Filters]
    response = chosen.response(document.spectrum, values)
    assert response.ends == pytest.approx((low, high))
    document.display.put(chosen.between(2.0 * low, high))
    assert float(part(panel, "filter_parameter_0_field").text()) == pytest.approx(2 * low, rel=1e-3)


def test_a_gaussian_pyramid_is_the_librarys(panel: FieldPanel, document: Document) -> None:
    choose(panel, "Gaussian")
    part(panel, "filter_count_spin").setValue(8)
    chosen = document.display[Filters]
    scales = np.geomspace(*chosen.range(document.spectrum), 8)
    document.display.put(chosen.step(document.spectrum, -100))
    for level in range(8):
        np.testing.assert_allclose(
            on_the_render(document),
            summed(document, gaussian_pyramid_bank(scales), level),
            rtol=1e-6,
        )
        document.display.put(document.display[Filters].step(document.spectrum, 1))


def test_a_formula_of_ones_own(panel: FieldPanel, document: Document) -> None:
    text = "exp(-t*x) * (x > 1e-8)"
    enter(panel, "filter_formula_edit", text)
    assert part(panel, "filter_label").text() == "Formula"
    slider = part(panel, "filter_parameter_0_slider")
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_PageDown)
    time = document.display[Filters].value("t", document.spectrum)
    assert not part(panel, "filter_parameter_1_slider").isVisible()
    np.testing.assert_allclose(
        on_the_render(document), summed(document, formula_bank(text, t=time)), rtol=1e-6
    )


def test_moving_an_edge_mends_the_last_sum(panel: FieldPanel, document: Document) -> None:
    live, values = LiveFeatures(), document.spectrum.eigenvalues
    on_the_render(document, live)
    live.prepare(request_of(document))
    for place in (30, 33, 31, 90, 92, 5):
        cutoff = float(values[place]) * (1.0 + 1e-9)
        document.display.put(document.display[Filters].with_values(c=cutoff))
        np.testing.assert_allclose(
            on_the_render(document, live), summed(document, low_pass_bank(cutoff)), rtol=1e-6
        )


def test_what_is_wrong_is_said_as_one_types(panel: FieldPanel, document: Document) -> None:
    fault, before = part(panel, "filter_fault"), document.display[Filters]
    height = fault.height()
    write(panel, "filter_formula_edit", "exp(-t*x")
    assert fault.text().endswith("at character 4: this bracket is not closed, so add ).")
    assert document.display[Filters] == before, "what was there stays"
    QTest.keyClicks(part(panel, "filter_formula_edit"), ")")
    assert "cannot" not in fault.text()
    assert fault.height() == height, "nothing moves"
    QTest.keyClick(part(panel, "filter_formula_edit"), Qt.Key.Key_Return)
    assert document.display[Filters].text == "exp(-t*x)"
    enter(panel, "filter_formula_edit", "1/x")
    assert "infinite at λ = 0" in fault.text()
    assert document.display[Filters].text == "exp(-t*x)"


def test_a_session_brings_it_back(panel: FieldPanel, document: Document, tmp_path) -> None:
    enter(panel, "filter_formula_edit", "exp(-t*x) * (x < c)")
    slider = part(panel, "filter_parameter_1_slider")
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_PageUp)
    chosen, wanted = document.display[Filters], on_the_render(document)
    kept = read_display(display_to_json(document.display), tmp_path / "s.json")
    again = rectangle_document()
    display_from_json(again.display, kept)
    assert again.display[Filters] == chosen
    np.testing.assert_array_equal(on_the_render(again), wanted)


@pytest.mark.parametrize("text", ["__import__('os').system('touch x')", "x +", 7, None, "1" * 999])
def test_a_strangers_session_runs_no_code(document: Document, tmp_path, text: object) -> None:
    content = display_to_json(document.display)
    content["fields"]["filter"]["text"] = text
    with raises("invalid-entry", "display.fields.filter.text"):
        read_display(content, tmp_path / "s.json")


@pytest.fixture
def plot(qtbot, document: Document) -> SpectrumPanel:
    plot = shown(qtbot, SpectrumPanel(document), 900, 260)
    QTest.qWait(80)  # the plot takes its range when it is painted
    return plot


def move(plot: SpectrumPanel, start: float, end: float, height: float) -> None:
    """Drag the handle at an eigenvalue to another eigenvalue."""
    QTest.qWait(60)
    way = [plot.plot.pixel_of(x, height).toPoint() for x in (start, 0.5 * (start + end), end)]
    drag(plot.plot.viewport(), *way)
    QTest.qWait(20)


def test_edges_are_dragged_on_the_spectrum(plot: SpectrumPanel, document: Document) -> None:
    spectrum = document.spectrum
    values = spectrum.eigenvalues
    document.display.put(document.display[Filters].with_values(c=float(values[60])))
    move(plot, values[60], values[90], 0.4)
    cutoff = document.display[Filters].value("c", spectrum)
    assert cutoff == pytest.approx(values[90], rel=0.02)
    np.testing.assert_allclose(
        on_the_render(document), summed(document, low_pass_bank(cutoff)), rtol=1e-6
    )
    band = Filters(READY["Band-pass"]).with_values(a=float(values[30]), b=float(values[80]))
    document.display.put(band)
    move(plot, values[80], values[100], 1.2)
    low, high = (document.display[Filters].value(name, spectrum) for name in "ab")
    assert low == values[30]
    assert high == pytest.approx(values[100], rel=0.02)
    np.testing.assert_allclose(
        on_the_render(document), summed(document, band_pass_bank(low, high)), rtol=1e-6
    )


def test_a_filter_without_a_length_has_nothing_to_drag(
    plot: SpectrumPanel, document: Document
) -> None:
    lines = plot.view.low, plot.view.high, plot.view.handle
    assert [line.isVisible() for line in lines] == [False, False, True]
    document.display.put(Filters("1 + p * (x > 0)"))
    QTest.qWait(60)
    assert not any(line.isVisible() for line in lines)

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import give, part, rectangle_document, rectangle_spectrum, turn_wheel
from PySide6.QtCore import QPoint, Qt, QUrl
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from scipy.linalg import eigh
from tiers import slow, slow_but

from meshmash_viewer.app.dialogs.help_dialog import PageDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.panels.field_panel import FieldPanel
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature, resolved_from
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import mesh_health
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import (
    Display,
    display_from_json,
    display_to_json,
    read_display,
)
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import LiveFeatures, compute_field, request_of
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.limits import LockedLimits, MinMaxLimits, PercentileLimits
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.weyl import Target, required_eigenvalue
from meshmash_viewer.units import format_quantity

LEFT = Qt.MouseButton.LeftButton
pytestmark = pytest.mark.usefixtures("shown_at_once")


@pytest.fixture
def panel(reopen_panel) -> FieldPanel:
    return reopen_panel(rectangle_document(twins=slice(12, 16)))


@pytest.fixture
def document(panel: FieldPanel, kept_document: Document) -> Document:
    return kept_document


def choose(panel: FieldPanel, tab: int) -> None:
    families = part(panel, "field_list")
    place = families.visualItemRect(families.item(tab)).center()
    QTest.mouseClick(families.viewport(), LEFT, pos=place)


def test_every_control_has_its_names(panel: FieldPanel) -> None:
    for name in (
        "field_list", "eigenvector_slider", "eigenvector_spin",
        "hks_time_slider", "hks_scales_spin", "hks_automatic_check", "hks_t_min_field",
        "hks_t_max_field", "band_count_spin", "band_spin", "band_slider", "band_automatic_check",
        "band_min_field", "band_max_field", "similarity_vertex_combo", "colormap_combo",
        "limits_combo", "limit_low_field", "limit_high_field",
    ):  # fmt: skip
        assert part(panel, name).accessibleName(), name


def test_turning_to_a_tab_puts_its_field_on_the_render(panel: FieldPanel, document) -> None:
    for tab, kind in enumerate(FAMILIES):
        choose(panel, tab)
        assert document.display.kind == kind
    document.display.kind = "hks"
    assert part(panel, "field_list").currentRow() == 1


def test_eigenfunctions_scroll_by_wheel_keys_and_number(panel: FieldPanel, document) -> None:
    slider, spin = part(panel, "eigenvector_slider"), part(panel, "eigenvector_spin")
    turn_wheel(slider, 4)
    assert document.display[Eigenfunctions].index == spin.value() == 5
    QTest.keyClick(slider, Qt.Key.Key_PageDown)
    assert document.display[Eigenfunctions].index == slider.value() == 15
    spin.selectAll()
    QTest.keyClicks(spin, "42")
    QTest.keyClick(spin, Qt.Key.Key_Return)
    assert document.display[Eigenfunctions].index == slider.value() == 42
    value = document.spectrum.eigenvalues[42]
    assert part(panel, "eigenvalue_label").text() == f"λ₄₂ = {format_quantity(value, 'nm', -2, 4)}"
    largest, unit = document.spectrum.eigenvalues[-1], part(panel, "eigenvalue_label").text()[-3:]
    document.display.change(Eigenfunctions, index=1)  # unit of the largest value, as in the plot
    same = format_quantity(document.spectrum.eigenvalues[1], "nm", -2, 4, like=largest)
    assert part(panel, "eigenvalue_label").text() == f"λ₁ = {same}"
    assert same.endswith(unit)
    document.display.change(Eigenfunctions, index=42)
    length = 2 * math.pi / math.sqrt(value)
    assert part(panel, "wavelength_label").text() == format_quantity(length, "nm")
    assert part(panel, "residual_label").text() == "3×10⁻¹²"


def test_zero_modes_and_multiplets_are_said(panel: FieldPanel, document) -> None:
    document.display.change(Eigenfunctions, index=0)
    assert part(panel, "eigenvalue_label").text() == "λ₀ = 0"
    assert part(panel, "wavelength_label").text() == "∞"
    assert "constant" in part(panel, "multiplet_label").text()
    document.display.change(Eigenfunctions, index=14)
    said = part(panel, "multiplet_label").text()
    assert (
        said
        == "λ₁₂…λ₁₅ within 1×10⁻⁶: any orthogonal combination of these is an eigenfunction too."
    )
    document.display.change(Eigenfunctions, index=20)
    assert part(panel, "multiplet_label").isHidden()


def test_an_eigenfunction_is_rotated_within_its_multiplet(panel: FieldPanel, document) -> None:
    document.display.change(Eigenfunctions, index=20)
    assert part(panel, "rotation_controls").isHidden()
    document.display.change(Eigenfunctions, index=14)
    assert not part(panel, "rotation_controls").isHidden()
    slider, combo = part(panel, "rotation_slider"), part(panel, "rotation_combo")
    assert [combo.itemText(at) for at in range(combo.count())] == ["φ₁₂", "φ₁₃", "φ₁₅"]
    assert combo.currentText() == "φ₁₅"
    for _ in range(2):
        QTest.keyClick(slider, Qt.Key.Key_PageDown)
    assert part(panel, "rotation_label").text() == "30°"
    field = compute_field(request_of(document), LiveFeatures())
    rows = document.spectrum.rows
    turned = np.cos(np.pi / 6) * rows[14] + np.sin(np.pi / 6) * rows[15]
    np.testing.assert_allclose(field.values, turned, rtol=1e-5, atol=1e-6 * np.abs(turned).max())
    assert field.quantity.endswith(" · rotated by 30° towards φ₁₅ in the space of 4")
    QTest.keyClick(combo, Qt.Key.Key_Up)
    assert document.display[Eigenfunctions].rotation == (14, 13, 30)
    # the rotation belongs to this function alone, is saved in a session, and can be undone
    document.display.change(Eigenfunctions, index=13)
    assert slider.value() == 0
    document.display.change(Eigenfunctions, index=14)
    assert (slider.value(), combo.currentText()) == (30, "φ₁₃")
    restored = Display()
    display_from_json(restored, read_display(display_to_json(document.display), Path("a.json")))
    assert restored[Eigenfunctions].rotation == (14, 13, 30)
    while document.history.past:
        assert document.history.undo_label in ("rotation", "Eigenfunctions index")
        document.history.undo()
    assert document.display[Eigenfunctions].rotation == ()
    assert slider.value() == 0


def test_only_what_has_converged_can_be_scrolled_to(qtbot) -> None:
    document = rectangle_document(converged=37)
    panel = FieldPanel(document)
    qtbot.addWidget(panel)
    slider = part(panel, "eigenvector_slider")
    QTest.keyClick(slider, Qt.Key.Key_End)
    assert document.display[Eigenfunctions].index == 36
    assert part(panel, "converged_label").text() == "37 of 120 so far"
    document.accept_spectrum(rectangle_spectrum(document.mesh, 120, converged=80))
    assert slider.maximum() == 79
    assert document.display[Eigenfunctions].index == 36, "growing does not move what is looked at"
    document.accept_spectrum(rectangle_spectrum(document.mesh, 120))
    assert part(panel, "converged_label").text() == "120, complete"


def test_a_preview_is_marked_until_exact_pairs_replace_it(panel: FieldPanel, document) -> None:
    exact = document.spectrum
    document.display.change(Eigenfunctions, index=5)
    document.spectrum = None
    document.accept_spectrum(replace(exact, n_exact=0, certificate=Certificate("none")))
    assert part(panel, "eigenvalue_label").text().startswith("λ₅ ≈ ")
    assert not part(panel, "preview_label").isHidden()
    assert part(panel, "residual_label").text() == "–"
    document.accept_spectrum(exact)
    assert part(panel, "eigenvalue_label").text().startswith("λ₅ = ")
    assert part(panel, "preview_label").isHidden()
    assert document.display[Eigenfunctions].index == 5


def test_playing_goes_on_by_itself(panel: FieldPanel, document, qtbot) -> None:
    document.display.playing = True
    qtbot.waitUntil(lambda: document.display[Eigenfunctions].index >= 3, timeout=5000)
    document.display.playing = False


def test_time_slider_is_in_log_scale_with_its_length(panel: FieldPanel, document) -> None:
    choose(panel, 1)
    slider = part(panel, "hks_time_slider")
    low, high = document.display[HeatKernelSignature].range(document.spectrum)
    for share in (0.0, 0.25, 1.0):
        x = slider.value_x(round(share * slider.maximum()))
        QTest.mouseClick(slider, LEFT, pos=QPoint(x, 13))
        time = document.display[HeatKernelSignature].time
        assert math.log(time / low) / math.log(high / low) == pytest.approx(share, abs=5e-3)
        assert part(panel, "hks_length_label").text() == format_quantity(math.sqrt(time), "nm")
        assert part(panel, "hks_time_label").text() == f"t = {format_quantity(time, 'nm', 2)}"
    assert slider.hatched is None, "the automatic range begins where the pairs suffice"


def test_a_time_is_typed_also_outside_the_range(panel: FieldPanel, document) -> None:
    choose(panel, 1)
    field, missing = part(panel, "hks_time_field"), part(panel, "hks_missing_label")
    low, high = document.display[HeatKernelSignature].range(document.spectrum)
    for time in (2.0 * low, 0.1 * low):
        give(field, f"{time:.6g}")
        assert document.display[HeatKernelSignature].time == pytest.approx(time, rel=1e-5)
        assert missing.isHidden() == (time > low)
    assert "This time misses" in missing.text()
    assert document.display[HeatKernelSignature].range(document.spectrum) == (low, high)
    give(field, "1e-30")
    assert document.display[HeatKernelSignature].time == pytest.approx(0.1 * low, rel=1e-5)
    assert "on this mesh" in part(panel, "hks_time_field_fault").text()


def test_short_times_are_hatched_and_what_they_need_is_said(panel: FieldPanel, document) -> None:
    choose(panel, 1)
    give(part(panel, "hks_t_min_field"), "1e5")
    display = document.display
    assert not display[HeatKernelSignature].automatic
    assert display[HeatKernelSignature].t_min == 1e5
    low, high = display[HeatKernelSignature].range(document.spectrum)
    share = math.log(resolved_from(document.spectrum) / low) / math.log(high / low)
    assert part(panel, "hks_time_slider").hatched == pytest.approx((0.0, share))
    display.change(HeatKernelSignature, time=2e5)
    said = part(panel, "hks_missing_label").text()
    stiffness, mass = cotangent_laplacian(document.mesh, robust=True)
    whole = np.exp(-eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True) * 2e5)
    expected = 100 * (1 - whole[:120].sum() / whole.sum())
    stated = float(re.search(r"This time misses about (\d+)\s%", said).group(1))
    assert stated == pytest.approx(expected, rel=0.2)
    needed = required_eigenvalue(2e5)
    assert format_quantity(needed, "nm", -2) in said
    assert f"all {document.mesh.n_vertices} pairs that the mesh has" in said
    display.change(HeatKernelSignature, time=1e6)
    needed = required_eigenvalue(1e6)
    more = document.mesh.area * (needed - document.spectrum.eigenvalues[-1]) / (4 * math.pi)
    said = part(panel, "hks_missing_label").text()
    assert f"about {120 + more:,.0f} pairs in all" in said
    requested: list[Job] = []
    document.work.requested.connect(requested.append)
    button = part(panel, "hks_compute_button")
    document.solve.operator = document.spectrum.operator  # as after a decomposition
    display.change(HeatKernelSignature, time=1.01e6)
    display.change(HeatKernelSignature, time=1e6)
    assert button.text() == f"Compute these ≈ {120 + more:,.0f} pairs"
    assert "of memory and" in button.toolTip()
    QTest.mouseClick(button, LEFT)
    assert document.solve.target == Target("time", 1e6)
    assert requested[0].work.args[2].max_eigenvalue == pytest.approx(needed)
    display.change(HeatKernelSignature, time=0.97 * resolved_from(document.spectrum))
    assert part(panel, "hks_missing_label").isHidden(), "less than 1 % is missing"
    assert button.isHidden()
    check = part(panel, "hks_automatic_check")
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    assert display[HeatKernelSignature].automatic
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    chosen = display[HeatKernelSignature]
    assert not chosen.automatic
    assert (chosen.t_min, chosen.t_max) == HeatKernelSignature().range(document.spectrum)


def test_a_range_of_a_single_time_has_its_slider_at_the_beginning(
    panel: FieldPanel, document
) -> None:
    """A range of one time, as from a session, puts the slider at its start."""
    choose(panel, 1)
    document.display.change(HeatKernelSignature, automatic=False, t_min=1e5, t_max=1e5, time=1e5)
    assert part(panel, "hks_time_slider").value() == 0
    assert part(panel, "hks_time_label").text() == f"t = {format_quantity(1e5, 'nm', 2)}"


@pytest.mark.parametrize("upwards", [True, False])
def test_a_whole_new_range_is_typed_in_either_order(
    panel: FieldPanel, document, qtbot, upwards: bool
) -> None:
    choose(panel, 1)
    panel.activateWindow()
    qtbot.waitUntil(panel.isActiveWindow)
    low, high = part(panel, "hks_t_min_field"), part(panel, "hks_t_max_field")
    was = low.value, high.value
    new = (2.0 * was[1], 3.0 * was[1]) if upwards else (was[0] / 3.0, was[0] / 2.0)
    first, second = (low, high) if upwards else (high, low)
    give(first, f"{new[0 if upwards else 1]:.6g}")
    assert document.display[HeatKernelSignature].automatic, "one end is no range"
    said = part(panel, "hks_t_min_field_fault")
    assert said.text() == "The shortest time has to be below the longest."
    assert QApplication.focusWidget() is second
    assert second.lineEdit().selectedText() == second.text()
    give(second, f"{new[1 if upwards else 0]:.6g}")
    assert said.isHidden()
    display = document.display[HeatKernelSignature]
    assert not display.automatic
    assert (display.t_min, display.t_max) == pytest.approx(new, rel=1e-5)


def test_an_end_beyond_the_other_does_not_stay_alone(panel: FieldPanel, document, qtbot) -> None:
    choose(panel, 1)
    panel.activateWindow()
    qtbot.waitUntil(panel.isActiveWindow)
    low, high = part(panel, "hks_t_min_field"), part(panel, "hks_t_max_field")
    before = low.text(), high.text()
    give(low, f"{2.0 * high.value:.6g}")
    document.display.change(HeatKernelSignature, scales=20)
    assert low.text() != before[0], "somebody is at it"
    part(panel, "hks_scales_spin").setFocus()
    qtbot.waitUntil(lambda: (low.text(), high.text()) == before)
    assert document.display[HeatKernelSignature].automatic


@pytest.mark.parametrize(
    ("tab", "name", "text"),
    [
        slow(1, "hks_t_min_field", "1e-9"),
        slow(1, "hks_t_min_field", "0"),
        (1, "hks_t_max_field", "1e99"),
        slow(2, "band_max_field", "1e99"),
        (2, "band_min_field", "-1"),
    ],
)
def test_what_no_such_mesh_has_is_refused_where_it_is_typed(
    panel: FieldPanel, document, tab: int, name: str, text: str
) -> None:
    choose(panel, tab)
    before, field = document.display.family, part(panel, name)
    shown = field.text()
    give(field, text)
    assert document.display.family == before
    assert field.text() == shown
    said = part(panel, ("hks_t_min" if tab == 1 else "band_min") + "_field_fault").text()
    assert re.search(r": between about \S+ and \S+\s[nµm]+m\S+ on this mesh\.$", said)


def test_scales_and_bands_are_numbers_of_the_model(panel: FieldPanel, document) -> None:
    choose(panel, 1)
    part(panel, "hks_scales_spin").setValue(64)
    assert document.display[HeatKernelSignature].scales == 64
    choose(panel, 2)
    part(panel, "band_spin").setValue(20)
    assert document.display[GeometryVectors].index == 20
    part(panel, "band_count_spin").setValue(8)
    assert (document.display[GeometryVectors].count, document.display[GeometryVectors].index) == (
        8,
        7,
    )
    give(part(panel, "band_max_field"), "1e-6 nm⁻²")
    assert document.display[GeometryVectors].high == 1e-6
    assert not document.display[GeometryVectors].automatic
    assert part(panel, "band_wavelength_label").text().endswith("m")


def test_bands_beyond_the_spectrum_say_so(panel: FieldPanel, document) -> None:
    choose(panel, 2)
    assert part(panel, "band_missing_label").isHidden()
    give(part(panel, "band_max_field"), "1e-5")
    assert "need more eigenpairs" in part(panel, "band_missing_label").text()
    low, high = document.spectrum.eigenvalues[3:5]
    give(part(panel, "band_min_field"), f"{low + 0.4 * (high - low)}")
    give(part(panel, "band_max_field"), f"{low + 0.6 * (high - low)}")
    assert "No eigenpair" in part(panel, "band_missing_label").text()


def test_similarity_follows_the_last_pin(panel: FieldPanel, document) -> None:
    document.pins.toggle(17)
    document.pins.toggle(200)
    combo = part(panel, "similarity_vertex_combo")
    assert document.display[Similarity].vertex == 200
    assert combo.currentText() == "2 · Vertex 200"
    combo.setCurrentIndex(0)
    combo.activated.emit(0)
    assert document.display[Similarity].vertex == 17
    choose(panel, 3)
    QTest.mouseClick(part(panel, "similarity_basis_band"), LEFT)
    assert document.display[Similarity].basis == "band"
    document.pins.toggle(17)
    assert document.display[Similarity].vertex == 200
    document.pins.clear()
    assert document.display[Similarity].vertex is None
    assert not part(panel, "similarity_hint").isHidden()


def test_colour_maps_suit_the_field_and_limits_follow_the_policy(panel: FieldPanel, document):
    def arrive() -> tuple[float, float]:
        field = compute_field(request_of(document), LiveFeatures())
        limits = (document.display.limits or MinMaxLimits()).limits(field.values)
        panel.set_field(
            field,
            field.scaled(
                limits, document.display.log_scales.get(document.display.family.limits_key)
            ),
        )
        return limits

    limits = arrive()
    maps, policies = part(panel, "colormap_combo"), part(panel, "limits_combo")
    assert maps.currentData() == "RdBu_r"
    assert part(panel, "limit_low_field").value == pytest.approx(limits[0])
    engineered = format_quantity(limits[0], "nm⁻¹", digits=4)  # as on the colour bar
    assert engineered.startswith(part(panel, "limit_low_field").text())
    document.display.set_limits(LockedLimits(1.2345e-5, 1.2346e-5))
    arrive()
    ends = [part(panel, f"limit_{end}_field").text() for end in ("low", "high")]
    assert ends == ["12.345", "12.346"], "digits that tell them apart, in mm⁻¹"
    policies.activated.emit(policies.findData("percentile"))
    assert document.display.limits == PercentileLimits()
    catch_up()
    give(part(panel, "percentile_high_spin"), "90 %")
    assert document.display.limits == PercentileLimits(1.0, 90.0)
    arrive()
    for text, sentence in (("0.5", "below"), ("101", "between 0 and 100\N{NO-BREAK SPACE}%.")):
        give(part(panel, "percentile_high_spin"), text)
        assert sentence in part(panel, "limits_fault").text()
        assert document.display.limits == PercentileLimits(1.0, 90.0)
    give(part(panel, "limit_high_field"), "5e-5 nm^-1")
    assert document.display.limits == LockedLimits(part(panel, "limit_low_field").value, 5e-5)
    assert policies.currentData() == "locked"
    give(part(panel, "limit_high_field"), "-1 nm^-1")
    assert "below" in part(panel, "limits_fault").text()
    assert document.display.limits.high == 5e-5
    document.display.kind = "hks"
    arrive()
    maps.activated.emit(maps.findData("cividis"))
    assert document.display.sequential_colormap == "cividis"
    assert document.display.diverging_colormap == "RdBu_r"


def test_a_log_scale_is_chosen_by_family_and_undone(panel: FieldPanel, document) -> None:
    scales = part(panel, "color_scale_combo")
    assert not scales.isEnabled(), "eigenfunctions have both signs"
    document.display.kind = "hks"
    field = compute_field(request_of(document), LiveFeatures())
    panel.set_field(field, field.colors(document.display)[0])
    assert scales.isEnabled()
    assert scales.currentText() == "Automatic: linear"
    QTest.keyClick(scales, Qt.Key.Key_End)
    assert document.display.log_scales == {"hks": True}
    limits, _ = field.colors(document.display)
    assert limits.logarithmic
    assert limits[:2] == field.limits(None)
    assert document.history.undo_label == "colour scale"
    document.history.undo()
    assert document.display.log_scales == {}
    assert scales.currentData() == "automatic"


@pytest.mark.parametrize(
    "name", slow_but(["hks", "map"], [name for name, family in FAMILIES.items() if family.page])
)
def test_a_question_mark_opens_the_page_of_the_family(
    panel: FieldPanel, document, name: str
) -> None:
    document.display.kind = name
    QTest.mouseClick(part(panel, f"{name}_page_button"), LEFT)
    (dialog,) = panel.window().findChildren(PageDialog)
    text = dialog.browser.toPlainText()
    assert dialog.isVisible()
    assert document.display.family.definition in text
    assert "What can go wrong" in text
    assert "\\Phi" not in text
    if name == "hks":
        dialog.browser.anchorClicked.emit(QUrl("truncation.md"))
        assert dialog.windowTitle() == "Truncation"
    dialog.close()


def test_without_eigenpairs_it_says_what_to_do(qtbot) -> None:
    document = Document()
    panel = FieldPanel(document)
    qtbot.addWidget(panel)
    assert "Open a mesh" in part(panel, "field_hint").text()
    assert not part(panel, "eigenvector_slider").isEnabled()
    for kind in FAMILIES:
        document.display.kind = kind
    flat = shapes.rectangle(6, 3, 6.0, 3.0)
    mesh = Mesh(flat.vertices, flat.faces)
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    catch_up()
    for kind, hidden in (("eigenfunction", False), ("map", True)):
        document.display.kind = kind
        catch_up()
        assert part(panel, "field_hint").isHidden() == hidden
    assert "Compute eigenpairs" in part(panel, "map_hint").text(), "one hint, its own"


def test_a_spectrum_of_zeros_only_has_no_times(qtbot) -> None:
    document = rectangle_document(converged=1)
    panel = FieldPanel(document)
    qtbot.addWidget(panel)
    for kind in FAMILIES:
        document.display.kind = kind
    assert not part(panel, "hks_time_slider").isEnabled()

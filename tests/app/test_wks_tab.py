from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QLabel, QSpinBox
from pytestqt.qtbot import QtBot
from solved import spectrum_of

from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.tabs import make_tab
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.units import format_quantity


@pytest.fixture
def document(rectangle: Mesh) -> Document:
    document = Document()
    mesh = rectangle.in_unit("nm")
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    document.accept_spectrum(spectrum_of(rectangle, 60))
    document.display.kind = "wks"
    return document


def test_the_slider_goes_through_log_energies(qtbot: QtBot, document: Document) -> None:
    tab = make_tab(document, WaveKernelSignature)
    qtbot.addWidget(tab)
    slider = tab.findChild(StepSlider, "wks_slider")
    tab.findChild(QSpinBox, "wks_count_spin").setValue(12)
    slider.setValue(9)
    chosen = document.display[WaveKernelSignature]
    assert (chosen.index, chosen.count) == (9, 12)
    energy = chosen.place(document.spectrum)
    title = tab.findChild(QLabel, "wks_label")
    qtbot.waitUntil(lambda: title.text() == f"ln λ = {energy:.4g}")
    assert tab.findChild(QLabel, "wks_eigenvalue_label").text() == format_quantity(
        np.exp(energy), "nm", -2
    )
    lengths = [2 * np.pi / np.sqrt(np.exp(energy))]
    assert tab.findChild(QLabel, "wks_wavelength_label").text() == format_quantity(lengths[0], "nm")


def test_too_few_pairs_are_said(qtbot: QtBot, document: Document) -> None:
    whole = document.spectrum
    document.accept_spectrum(whole.first(2))
    tab = make_tab(document, WaveKernelSignature)
    qtbot.addWidget(tab)
    assert "two different eigenvalues" in tab.findChild(QLabel, "wks_missing_label").text()
    assert tab.findChild(QLabel, "wks_eigenvalue_label").text() == "–"

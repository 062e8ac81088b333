"""Resolution of the mesh in the window: the proof, its button, the Spectrum, and offers."""

from __future__ import annotations

import numpy as np
import trimesh
from pytestqt.qtbot import QtBot

import meshmash_viewer as mv
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.spectral.weyl import Target


def test_measured_by_the_button_and_offered_no_further(qtbot: QtBot) -> None:
    window = MainWindow(fresh=True)
    qtbot.addWidget(window)
    document, panel = window.document, window.mesh_panel
    ball = trimesh.creation.icosphere(3)
    document.take_mesh(mv.Mesh(ball.vertices, ball.faces, name="ball"))
    qtbot.waitUntil(lambda: document.mesh is not None and document.work.job is None, timeout=60_000)
    assert not panel.resolution_button.isEnabled()
    document.solve.target = Target("count", 120)
    document.solve.compute()
    qtbot.waitUntil(lambda: document.solve.measurable == 120, timeout=60_000)
    estimated = document.spectrum
    assert estimated is not None
    label = estimated.resolution
    qtbot.waitUntil(lambda: label in panel.proof_label.text(), timeout=10_000)
    qtbot.waitUntil(panel.resolution_button.isEnabled, timeout=10_000)  # after the job has ended

    # no pairs are offered that the mesh does not resolve
    target, sentence = estimated.within_resolution(Target("count", 642))
    assert target is None
    assert f"about {estimated.resolved.sum()} pairs to 5" in sentence
    assert estimated.within_resolution(Target("count", 20)) == (Target("count", 20), "")
    assert Distances(measure="commute").divergence

    panel.resolution_button.click()
    qtbot.waitUntil(lambda: document.spectrum.n_measured == 120, timeout=60_000)
    qtbot.waitUntil(lambda: document.work.job is None, timeout=60_000)
    spectrum = document.spectrum
    truth = mv.resolution_error(document.mesh, mv.solve(*mv.cotangent_laplacian(ball, True), 120))
    np.testing.assert_allclose(spectrum.mesh_errors, truth, atol=1e-9)
    proof = panel.proof_label
    qtbot.waitUntil(lambda: "measured on a finer mesh" in proof.text(), timeout=10_000)
    assert not panel.resolution_button.isEnabled()
    plot = window.spectrum_panel
    grey = np.flatnonzero(np.abs(truth) > 0.05).tolist()
    drawn = plot.view.unresolved.getData
    qtbot.waitUntil(lambda: drawn()[0].tolist() == grey, timeout=10_000)
    assert "off by over 5" in plot.remark.toPlainText()
    window.close()

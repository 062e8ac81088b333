"""Pictures of painting labels and of a classified neuron, in the light and the dark theme.

    python assets/labels.py FOLDER

Needs a display. The pages show the pictures in docs/pictures.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton
from tour import LEFT, Tour, pause

from meshmash_viewer.app import theme
from meshmash_viewer.app.run import application
from meshmash_viewer.io.maps import read_labels
from meshmash_viewer.samples import labels_path, sample_path
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

#: Number of strokes for each class, and of vertices in a stroke.
STROKES, LENGTH = 10, 25


def painted(tour: Tour) -> VertexMap:
    """Return labels of some vertices, as if painted by hand."""
    mesh = tour.document.mesh
    assert mesh is not None
    parts = read_labels(labels_path("neuron"), mesh)
    values, random = np.zeros(mesh.n_vertices, dtype=np.int64), np.random.default_rng(0)
    for part in parts.labels:
        inside = np.flatnonzero(parts.values == part.key)
        for start in random.choice(inside, STROKES, replace=False):
            away = np.linalg.norm(mesh.vertices[inside] - mesh.vertices[start], axis=1)
            values[inside[np.argsort(away)[:LENGTH]]] = part.key
    return VertexMap("parts", values, parts.labels)


def go(tour: Tour) -> None:
    """Paint labels, classify the vertices, and take the pictures."""
    window, document = tour.window, tour.document
    tour.resize(1440, 900)
    window.show()
    tour.open(sample_path("neuron"))
    document.solve.target = Target("max_eigenvalue", 5e-6)
    document.solve.compute()
    tour.wait(lambda: document.work.job is None)
    assert document.mesh is not None
    document.maps.add(document.mesh, [painted(tour)])
    document.labels.choose("parts")
    document.display.label_borders = True
    window.arrangement.docks["label"].raise_()
    window.commands.method("select_with")("brush")
    tour.settle()
    x, y = document.mesh.vertices[:, 0], document.mesh.vertices[:, 1]
    tip = np.hypot(x - x.max(), y - y[np.argmax(x)])
    document.selection.set(tip < 3500.0)
    shoot(tour, "painting")
    window.commands.method("select")(False)
    document.selection.set(None)
    document.classes.options = replace(document.classes.options, kinds=("hks", "curvature"))
    button = window.findChild(QPushButton, "class_classify_button")
    QTest.mouseClick(button, LEFT)
    pause(200)
    tour.wait(lambda: document.labels.predicted is not None and document.work.job is None)
    shoot(tour, "classes")


def shoot(tour: Tour, name: str) -> None:
    """Take a picture in each theme."""
    for mode in (theme.Mode.LIGHT, theme.Mode.DARK):
        theme.set_mode(mode)
        tour.window.stage.message_bar.dismiss()
        tour.settle()
        tour.shoot(f"{name}-{mode.name.lower()}")


def main() -> int:
    """Make the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the pictures go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="meshmash-viewer-labels-") as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        application()
        tour = Tour(folder)
        try:
            go(tour)
        finally:
            tour.window.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

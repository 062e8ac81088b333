"""Reference times for the window; used by `interaction_window.py`."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from meshmash_viewer.features.sums import sum_squares
from meshmash_viewer.fields.hks import HeatKernelSignature

if TYPE_CHECKING:
    from meshmash_viewer.app.controller import Controller
    from meshmash_viewer.model.document import Document


def time_at(document: Document, share: float) -> float:
    """Return the diffusion time at a position of the slider, from 0 to 1."""
    low, high = document.display[HeatKernelSignature].range(document.spectrum)
    return float(low * (high / low) ** share)


def compressed(document: Document, source: Controller) -> dict[str, float]:
    """Return times (ms) of HKS by its table and by the direct sum, and the largest error."""
    kept, spectrum = source.live.tables.get(HeatKernelSignature.name), document.spectrum
    assert kept is not None
    table = kept.content
    fast, slow, errors = [], [], []
    for share in (0.05, 0.3, 0.5, 0.7, 0.95):
        time_ = time_at(document, share)
        for _ in range(5):
            started = time.perf_counter()
            short = table.at(time_)
            fast.append(time.perf_counter() - started)
        decay = np.exp(-spectrum.eigenvalues * time_)[None]
        started = time.perf_counter()
        exact = sum_squares(spectrum.rows, decay, np.float64)[0]
        slow.append(time.perf_counter() - started)
        errors.append(np.nanmax(np.abs(short - exact)) / np.ptp(exact[np.isfinite(exact)]))
    return {
        "hks_table": 1e3 * median(fast),
        "hks_direct": 1e3 * median(slow),
        "hks_error": float(max(errors)),
    }


def readd(document: Document) -> float:
    """Return the time (ms) of a pyvista script for the next eigenfunction, smoothly shaded."""
    import pyvista as pv

    mesh, spectrum = document.mesh, document.spectrum
    plotter = pv.Plotter(off_screen=True, window_size=(900, 600))
    surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
    took = []
    for index in range(1, 4):
        started = time.perf_counter()
        surface.point_data["field"] = spectrum.rows[index]
        plotter.add_mesh(surface, scalars="field", smooth_shading=True, name="mesh")
        plotter.render()
        took.append(time.perf_counter() - started)
    plotter.close()
    return 1e3 * median(took)


def floor(source: Controller) -> float:
    """Return the time (ms) of writing a field into an existing array."""
    target = source.field.values.copy()
    values = np.zeros_like(target)
    took = []
    for _ in range(20):
        started = time.perf_counter()
        np.copyto(target, values)
        took.append(time.perf_counter() - started)
    return 1e3 * median(took)

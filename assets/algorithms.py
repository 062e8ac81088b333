"""Pictures for the pages in ``docs/algorithms``, of the sample meshes of the package.

    python assets/algorithms.py DIR

Needs no window; ``./dev shots DIR`` runs it after the tour. Every picture is one row of panels on a
transparent background, with text in a grey that is legible on light and on dark pages.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib as mpl
import numpy as np
import pyvista as pv
import trimesh

mpl.use("agg")
from matplotlib import pyplot as plt

import meshmash_viewer as mv
from meshmash_viewer.features.shape import low_pass_vertices
from meshmash_viewer.samples import sample_path
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
GREY = "#7d8590"
SIGNED, POSITIVE = "RdBu_r", "viridis"
#: Width and height of a panel in pixels, and factor by which the panel is rendered larger.
SIZE, FINER = (420, 260), 2


@dataclass(frozen=True)
class Surface:
    """Panel with a field on a mesh; `limits` are the ends of the colour scale."""

    title: str
    mesh: Any
    field: Any
    cmap: str = POSITIVE
    limits: tuple[float, float] | None = None
    unit: str = ""
    edges: bool = False


@dataclass(frozen=True)
class Picture:
    """Panel with an existing picture."""

    title: str
    pixels: Any


@dataclass(frozen=True)
class Curves:
    """Panel with lines: names, and values over a common abscissa."""

    title: str
    x: Any
    lines: Sequence[tuple[str, Any]]
    xlabel: str
    ylabel: str
    log: str = ""


@cache
def dendrite() -> mv.Mesh:
    """Return the sample dendrite, in nm."""
    return mv.read_mesh(sample_path("dendrite"))


@cache
def pairs() -> Eigenpairs:
    """Return the 150 lowest eigenpairs of the dendrite."""
    return mv.solve(*mv.cotangent_laplacian(dendrite(), robust=True), 150)


@cache
def ball() -> Any:
    """Return a dented sphere of radius 1 m, with varying curvature."""
    mesh = trimesh.creation.icosphere(5)
    x, y, z = mesh.vertices.T
    dents = np.sin(4.0 * x) * np.cos(3.0 * y + 1.0) * np.cos(3.0 * z)
    mesh.vertices *= (1.0 + 0.3 * x * y + 0.25 * z + 0.1 * dents)[:, None]
    return mesh


def features(bank: mv.FilterBank) -> Any:
    """Return the features of a bank on the dendrite."""
    return mv.compute_features(pairs(), bank, warn=False).values


def laplacian() -> list[Any]:
    """Return panels of M, and of −Δz³ by L and M, on a sphere."""
    sphere = trimesh.creation.icosphere(4)
    stiffness, mass = mv.cotangent_laplacian(sphere)
    wave = sphere.vertices[:, 2] ** 3
    coarse = trimesh.creation.icosphere(2)
    return [
        Surface("areas of vertices, A", coarse, mv.compute_vertex_areas(coarse), edges=True),
        Surface("a function f = z³", sphere, wave, SIGNED, (-1.0, 1.0)),
        Surface("−Δf = M⁻¹ L f", sphere, stiffness @ wave / mass.diagonal(), SIGNED, (-6.0, 6.0)),
    ]


def eigenpairs() -> list[Any]:
    """Return panels of three eigenfunctions."""
    phi = pairs().eigenvectors
    return [
        Surface(f"φ{index}", dendrite(), phi[:, index], SIGNED, _even(phi[:, index]))
        for index in (1, 5, 20)
    ]


def heat_kernel_signature() -> list[Any]:
    """Return panels of HKS at three times."""
    times = [5e4, 5e5, 5e6]
    values = features(mv.heat_kernel_bank(times))
    return [
        Surface(f"√t = {np.sqrt(time):.0f} nm", dendrite(), column, POSITIVE, _most(column), "nm⁻²")
        for time, column in zip(times, values.T, strict=True)
    ]


def wave_kernel_signature() -> list[Any]:
    """Return panels of the weights of WKS and of two columns."""
    bank = mv.wave_kernel_bank(pairs().eigenvalues, n_energies=12)
    values = features(bank)
    return [_responses(bank, "weight", "log")] + [
        Surface(
            f"energy {index + 1} of 12",
            dendrite(),
            values[:, index],
            limits=_most(values[:, index]),
            unit="nm⁻²",
        )
        for index in (4, 9)
    ]


def geometry_vectors() -> list[Any]:
    """Return panels of the weights of the bands and of two bands."""
    bank = mv.bspline_bank(0.0, float(pairs().eigenvalues[-1]), 8)
    values = features(bank)
    return [_responses(bank, "weight")] + [
        Surface(
            f"band {index + 1} of 8",
            dendrite(),
            values[:, index],
            limits=_most(values[:, index]),
            unit="nm⁻²",
        )
        for index in (1, 5)
    ]


def filters() -> list[Any]:
    """Return panels of the weights and features of a formula with two values of its parameter."""
    high = float(pairs().eigenvalues[-1])
    bank = mv.formula_bank("exp(-log(x/c)**2 / (2*w**2))", c=[high / 30, high / 4], w=0.5)
    values = features(bank)
    return [_responses(bank, "h(λ)", "log")] + [
        Surface(f"c = {c:.1e} nm⁻²", dendrite(), column, limits=_most(column), unit="nm⁻²")
        for c, column in zip((high / 30, high / 4), values.T, strict=True)
    ]


def similarity() -> list[Any]:
    """Return panels of distances in feature space from two vertices."""
    values = features(mv.heat_kernel_bank(np.geomspace(1e5, 5e6, 12)))
    head = int(np.argsort(values[:, 6])[len(values) * 9 // 10])
    shaft = int(np.argsort(values[:, 6])[len(values) // 20])
    return [
        Surface(name, dendrite(), mv.feature_distance(values, index), "viridis_r", (0.0, 6.0))
        for name, index in (("like one head of a spine", head), ("like the shaft", shaft))
    ]


def two_shapes() -> list[Any]:
    """Return panels of a map, of the map transferred by matches, and of two spectra."""
    first = ball()
    turn: Any = trimesh.transformations.rotation_matrix
    second = first.copy().apply_transform(turn(0.3, [0.3, 1, 0.2]))
    second.vertices *= [1.0, 1.06, 0.97]
    a, b = (mv.solve(*mv.cotangent_laplacian(mesh), 60) for mesh in (first, second))
    found = mv.compare_shapes(a, b)
    place = first.vertices[:, 0]
    areas = [first.area, second.area]
    return [
        Surface("the first shape", first, place, SIGNED, _even(place)),
        Surface(
            "the second, by its matches", second, place[found.back.indices], SIGNED, _even(place)
        ),
        Curves(
            f"λ · area: distance {found.distance:.3g}",
            np.arange(60),
            [("first", a.eigenvalues * areas[0]), ("second", b.eigenvalues * areas[1])],
            "pair",
            "λ · area",
        ),
    ]


def distances() -> list[Any]:
    """Return panels of three kinds of distance from one end."""
    start = int(np.argmin(dendrite().vertices[:, 2]))
    kinds = {"geodesic": "nm", "biharmonic": "nm", "diffusion": "nm⁻¹"}
    panels = []
    for kind, unit in kinds.items():
        column = mv.distance_features(dendrite(), start, kind, pairs(), 2e6).values[:, 0]
        panels.append(
            Surface(kind, dendrite(), column, "magma", (0.0, float(np.nanmax(column))), unit)
        )
    return panels


def maps() -> list[Any]:
    """Return panels of a map, of its projection on the lowest pairs, and of their energy."""
    depth = dendrite().vertices[:, 0] + 3000.0 * np.random.default_rng(3).standard_normal(
        dendrite().n_vertices
    )
    depth -= depth.mean()
    spectrum = mv.map_spectrum(pairs(), depth)
    share = [spectrum.share(k) for k in range(1, 151)]
    smooth = mv.filter_map(pairs(), depth, mv.low_pass_bank(float(pairs().eigenvalues[-1])))
    return [
        Surface("a map with noise", dendrite(), depth, SIGNED, _even(depth), "nm"),
        Surface("its 150 lowest pairs", dendrite(), smooth, SIGNED, _even(depth), "nm"),
        Curves(
            "what the pairs explain",
            np.arange(1, 151),
            [("share of energy", share)],
            "pairs",
            "share of energy",
        ),
    ]


def reconstruction() -> list[Any]:
    """Return panels of a shape from few, more and many pairs."""
    known = mv.solve(*mv.cotangent_laplacian(ball()), 150)
    panels = []
    for count in (4, 25, 150):
        smooth = low_pass_vertices(ball(), known, count)
        moved = np.linalg.norm(smooth - ball().vertices, axis=1)
        mesh = mv.Mesh(smooth, ball().faces)
        panels.append(Surface(f"{count} pairs", mesh, moved, limits=(0.0, 0.1), unit="moved by, m"))
    return panels


def curvature() -> list[Any]:
    """Return panels of the mean and the Gaussian curvature."""
    mean, gauss = mv.mean_curvature(ball()), mv.gaussian_curvature(ball())
    return [
        Surface("mean curvature H", ball(), mean, SIGNED, _even(mean), "m⁻¹"),
        Surface("Gaussian curvature K", ball(), gauss, SIGNED, _even(gauss), "m⁻²"),
    ]


def truncation() -> list[Any]:
    """Return panels of the missing share of HKS over time, and of HKS at one time."""
    times = np.geomspace(1e4, 1e7, 40)
    lines = []
    for count in (20, 60, 150):
        some = mv.solve(*mv.cotangent_laplacian(dendrite(), robust=True), count)
        told: Any = mv.compute_features(some, mv.heat_kernel_bank(times), warn=False).truncation
        lines.append((f"{count} pairs", 100.0 * told.estimate))
    lines.append(("flagged above 1 %", np.full(len(times), 1.0)))
    over = mv.compute_features(pairs(), mv.heat_kernel_bank([1e5]), warn=False).values[:, 0]
    return [
        Curves("what is missing of HKS", times, lines, "t in nm²", "% of the column", "both"),
        Surface("√t = 316 nm, by 150 pairs", dendrite(), over, limits=_most(over), unit="nm⁻²"),
    ]


def pieces() -> list[Any]:
    """Return panels of the pieces, and of the number of pieces at each vertex."""
    stitcher = mv.MeshStitcher(dendrite(), n_jobs=1)
    stitcher.split_mesh(max_vertex_threshold=9000)
    owner = np.full(dendrite().n_vertices, np.nan)
    shared = np.zeros(dendrite().n_vertices)
    for number, piece in enumerate(stitcher.pieces):
        owner[piece] = number
        shared[piece] += 1
    return [
        Surface(f"{len(stitcher.pieces)} pieces", dendrite(), owner, "tab20", (0.0, 19.0)),
        Surface("pieces that a vertex is in", dendrite(), shared, POSITIVE, (1.0, 3.0)),
    ]


def examples() -> list[Any]:
    """Return panels of the files that four scripts in ``examples`` write."""
    with TemporaryDirectory() as folder:
        for script in ("bands", "own_map", "distance_and_shape", "with_pyvista"):
            subprocess.run([sys.executable, EXAMPLES / f"{script}.py"], cwd=folder, check=True)
        table = pv.read(Path(folder) / "bands.vtp")
        bands = np.column_stack([table[name] for name in table.point_data])
        bend = np.load(Path(folder) / "bend_smooth.npy")
        smooth = mv.read_mesh(Path(folder) / "smooth.ply", unit="nm")
        moved = np.linalg.norm(smooth.vertices - dendrite().vertices, axis=1)
        drawn = plt.imread(Path(folder) / "phi_5.png")
        rows, columns = np.nonzero((drawn[..., :3] < 1.0).any(axis=2))
        drawn = drawn[rows.min() : rows.max(), columns.min() : columns.max()]
    return [
        Surface("bands.py: the strongest", dendrite(), bands.argmax(axis=1), limits=(0.0, 7.0)),
        Surface("own_map.py", dendrite(), bend, SIGNED, _even(bend), "nm⁻¹"),
        Surface("distance_and_shape.py", smooth, moved, limits=_most(moved), unit="moved by, nm"),
        Picture("with_pyvista.py: phi_5.png", drawn),
    ]


PAGES: list[Callable[[], list[Any]]] = [
    laplacian, eigenpairs, heat_kernel_signature, wave_kernel_signature, geometry_vectors, filters,
    similarity, two_shapes, distances, maps, reconstruction, curvature, truncation, pieces,
    examples,
]  # fmt: skip


def main() -> None:
    """Draw all pages, or one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--page", choices=[page.__name__ for page in PAGES])
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for page in PAGES:
        if options.page in (None, page.__name__):
            draw(page(), options.folder / f"{page.__name__}.webp")
            print(page.__name__)


def draw(panels: Sequence[Any], file: Path) -> None:
    """Draw panels next to one another into a file."""
    with plt.rc_context(
        {
            "text.color": GREY,
            "axes.labelcolor": GREY,
            "xtick.color": GREY,
            "ytick.color": GREY,
            "axes.edgecolor": GREY,
            "font.size": 8.0,
        }
    ):
        figure, axes = plt.subplots(
            1, len(panels), figsize=(2.9 * len(panels), 2.3), squeeze=False, layout="constrained"
        )
        for panel, axis in zip(panels, axes[0], strict=True):
            axis.set_title(panel.title, fontsize=9.5)
            if isinstance(panel, Curves):
                _plot(panel, axis)
            elif isinstance(panel, Picture):
                axis.imshow(panel.pixels)
                axis.axis("off")
            else:
                _paint(panel, axis, figure)
        figure.savefig(
            file, dpi=150, transparent=True, bbox_inches="tight", pil_kwargs={"quality": 85}
        )
        plt.close(figure)


def _plot(panel: Curves, axis: Any) -> None:
    for name, values in panel.lines:
        dashed = name.startswith("flagged")
        axis.plot(
            panel.x, values, "--" if dashed else "-", label=name, color=GREY if dashed else None
        )
    axis.set(xlabel=panel.xlabel, ylabel=panel.ylabel)
    axis.patch.set_alpha(0.0)
    if panel.log:
        axis.set_xscale("log")
    if panel.log == "both":
        axis.set(yscale="log", ylim=(1e-3, 100.0))
    if 1 < len(panel.lines) < 6:
        axis.legend(frameon=False, labelcolor=GREY)


def _paint(panel: Surface, axis: Any, figure: Any) -> None:
    low, high = panel.limits or (float(np.nanmin(panel.field)), float(np.nanmax(panel.field)))
    plotter: Any = pv.Plotter(off_screen=True, window_size=[FINER * side for side in SIZE])
    surface = mv.mesh_to_poly(panel.mesh)
    surface["field"] = np.asarray(panel.field, dtype=np.float64)
    plotter.add_mesh(
        surface,
        scalars="field",
        cmap=mpl.colormaps[panel.cmap],
        clim=(low, high),
        show_scalar_bar=False,
        smooth_shading=not panel.edges,
        show_edges=panel.edges,
        nan_color="#9aa0a6",
        ambient=0.3,
        diffuse=0.75,
    )
    if surface.n_points == dendrite().n_vertices:
        plotter.view_xz()
        plotter.camera.zoom(1.8)
    else:
        plotter.view_isometric()
    picture = np.asarray(plotter.screenshot(transparent_background=True, return_img=True))
    rows, columns = np.nonzero(picture[..., 3])
    axis.imshow(picture[rows.min() : rows.max(), columns.min() : columns.max()])
    plotter.close()
    axis.axis("off")
    if panel.cmap != "tab20":
        colors = mpl.cm.ScalarMappable(mpl.colors.Normalize(low, high), panel.cmap)
        bar = figure.colorbar(
            colors,
            ax=axis,
            orientation="horizontal",
            shrink=0.6,
            aspect=30,
            pad=0.02,
            label=panel.unit,
        )
        bar.locator = mpl.ticker.MaxNLocator(3)
        bar.outline.set_visible(False)


def _responses(bank: mv.FilterBank, ylabel: str, log: str = "") -> Curves:
    values = pairs().eigenvalues
    x = np.geomspace(values[1], values[-1], 400) if log else np.linspace(0.0, values[-1], 400)
    return Curves(
        "weights over λ",
        x,
        [(name, row) for name, row in zip(bank.columns, bank(x), strict=True)],
        "λ in nm⁻²",
        ylabel,
        log,
    )


def _even(field: Any) -> tuple[float, float]:
    most = float(np.nanquantile(np.abs(field), 0.98))
    return -most, most


def _most(field: Any) -> tuple[float, float]:
    low, high = np.nanquantile(field, [0.01, 0.97])
    return float(low), float(high)


if __name__ == "__main__":
    main()

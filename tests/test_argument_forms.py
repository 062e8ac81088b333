"""Every public function takes each form of a mesh, and of eigenpairs."""

from __future__ import annotations

import inspect
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import trimesh
from faults import raises
from scipy import sparse

import meshmash_viewer as mv

pytestmark = pytest.mark.usefixtures("read_here")

BALL = trimesh.creation.icosphere(2)
BALL.vertices *= [1.0, 1.1, 1.3]
UPPER = (BALL.vertices[:, 2] > 0).astype(int)
HEIGHT = np.asarray(BALL.vertices[:, 2])
HEAT = mv.heat_kernel_bank([0.5, 1.0])
LABELS = mv.VertexMap("part", UPPER, (mv.Label(0, "low", "#112233"), mv.Label(1, "up", "#aabbcc")))
L, M = mv.cotangent_laplacian(BALL, robust=True)
PAIRS = mv.solve(L, M, 24)
EVERY = {"max_eigenvalue": 30.0, "n_components": 4}


def written(path: Path) -> Any:
    """Return the contents of a file without the time, and without residuals, NaN for arrays."""
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files if name not in ("meta", "residuals")}


def write(function: Any, folder: Path, *rest: Any, ending: str = ".npz") -> Any:
    path = folder / f"out{ending}"
    function(path, *rest)
    return written(path) if ending == ".npz" else path.read_text()


def read(function: Any, folder: Path, mesh: Any) -> Any:
    path = folder / "part.label.gii"
    mv.write_labels(path, LABELS, BALL)
    given = folder / "height.npy"
    np.save(given, HEIGHT > 0.0 if function is mv.read_mask else HEIGHT)
    return function(path if function is mv.read_labels else given, mesh)


def classes(mesh: Any, pairs: Any) -> Any:
    columns = mv.ClassColumns.chosen(mesh, pairs, n_times=4)
    model = mv.train_classes(mesh, LABELS, columns, "logistic", pairs=pairs, scored=False)
    return [columns.compute(mesh, pairs), mv.predict_classes(mesh, model, pairs=pairs, warn=False)]


#: Calls with a mesh m, eigenpairs p and a folder f, by public name.
CALLS: dict[str, Any] = {
    "GeodesicSolver": lambda m, p, f: mv.GeodesicSolver(m).from_vertex(3),
    "MeshStitcher": lambda m, p, f: mv.MeshStitcher(m, n_jobs=1).mesh,
    "area_matrix": lambda m, p, f: mv.area_matrix(m),
    "compare_shapes": lambda m, p, f: mv.compare_shapes(p, p, meshes=(m, m)).forth.indices,
    "compute_features": lambda m, p, f: mv.compute_features(p, HEAT, warn=False).values,
    "compute_geometry_vectors": lambda m, p, f: mv.compute_geometry_vectors(m, **EVERY),
    "compute_hks": lambda m, p, f: mv.compute_hks(m, t_min=0.5, t_max=1.0, **EVERY),
    "compute_vertex_areas": lambda m, p, f: mv.compute_vertex_areas(m),
    "condensed_hks_pipeline": None,  # decimates, see test_domains
    "corresponding_vertices": lambda m, p, f: mv.corresponding_vertices(m, m),
    "cotangent_laplacian": lambda m, p, f: list(mv.cotangent_laplacian(m)),
    "decompose_mesh": lambda m, p, f: list(mv.decompose_mesh(m, 5)),
    "distance_features": lambda m, p, f: mv.distance_features(m, 3, "biharmonic", p).values,
    "filter_map": lambda m, p, f: mv.filter_map(p, HEIGHT, HEAT),
    "functional_map": lambda m, p, f: mv.functional_map(p, p, meshes=(m, m)).matrix,
    "gaussian_curvature": lambda m, p, f: mv.gaussian_curvature(m),
    "geodesic_distance": lambda m, p, f: mv.geodesic_distance(m, 3),
    "largest_component": lambda m, p, f: mv.largest_component(m),
    "map_spectrum": lambda m, p, f: mv.map_spectrum(p, HEIGHT).coefficients,
    "mean_curvature": lambda m, p, f: mv.mean_curvature(m),
    "mesh_health": lambda m, p, f: mv.mesh_health(m),
    "mesh_to_poly": lambda m, p, f: np.asarray(mv.mesh_to_poly(m).points),
    "nearest_distance": lambda m, p, f: mv.nearest_distance(m, [3, 9]),
    "predict_classes": lambda m, p, f: classes(m, p)[1].labels.values,
    "project_points": lambda m, p, f: mv.project_points(m, 1.01 * BALL.vertices[:9]).vertices,
    "read_labels": lambda m, p, f: read(mv.read_labels, f, m).values,
    "read_maps": lambda m, p, f: read(mv.read_maps, f, m)[0].values,
    "read_mask": lambda m, p, f: read(mv.read_mask, f, m),
    "regions": lambda m, p, f: mv.regions(m, LABELS)["area"],
    "repair_mesh": lambda m, p, f: mv.repair_mesh(m, "drop_duplicate_faces"),
    "resolution_error": lambda m, p, f: mv.resolution_error(m, p),
    "spectral_geometry_filter": lambda m, p, f: mv.spectral_geometry_filter(m, HEAT, 30.0),
    "to_napari": lambda m, p, f: list(mv.to_napari(m, HEIGHT)[0]),
    "train_classes": lambda m, p, f: classes(m, p)[0].values,
    "view": None,  # opens a window, see test_run
    "write_eigenpairs": lambda m, p, f: write(mv.write_eigenpairs, f, p, m),
    "write_features": lambda m, p, f: write(
        mv.write_features, f, mv.Features(HEIGHT[:, None], ("z",)), m
    ),
    "write_labels": lambda m, p, f: write(mv.write_labels, f, LABELS, m),
    "write_map_spectrum": lambda m, p, f: write(
        mv.write_map_spectrum, f, mv.map_spectrum(PAIRS, HEIGHT), m
    ),
    "zoomout": lambda m, p, f: (
        mv.zoomout(
            p, p, mv.functional_map(p, p, n_functions=9), n_functions=15, meshes=(m, m)
        ).matrix
    ),
}
#: Names of parameters that are a mesh, meshes or eigenpairs.
TAKEN = {"mesh", "meshes", "decomposition", "pairs", "first", "second"}

FACES = np.column_stack([np.full(len(BALL.faces), 3), BALL.faces])
MESHES = {
    "pair": (np.asarray(BALL.vertices), np.asarray(BALL.faces)),
    "lists": [BALL.vertices.tolist(), BALL.faces.tolist()],
    "trimesh": BALL,
    "PolyData": pyvista.PolyData(np.array(BALL.vertices), FACES.ravel()),
}


def same(found: Any, wanted: Any) -> None:
    assert type(found) is type(wanted)
    if isinstance(wanted, dict):
        assert found.keys() == wanted.keys()
        found, wanted = list(found.values()), list(wanted.values())
    if is_dataclass(wanted):
        found, wanted = ([getattr(x, y.name) for y in fields(wanted)] for x in (found, wanted))
    if sparse.issparse(wanted):
        found, wanted = found.toarray(), wanted.toarray()
    if isinstance(wanted, list):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            same(one, other)
    elif isinstance(wanted, np.ndarray) and wanted.dtype.kind == "f":
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)
    else:
        np.testing.assert_array_equal(found, wanted)


def is_error(each: Any) -> bool:
    return inspect.isclass(each) and issubclass(each, Exception)


def test_every_public_function_of_meshes_or_eigenpairs_is_called_here() -> None:
    for name in mv.__all__:
        each = getattr(mv, name)
        if not callable(each) or is_dataclass(each) or is_error(each):
            continue
        assert bool(TAKEN & inspect.signature(each).parameters.keys()) is (name in CALLS), name


@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call])
def test_each_form_gives_the_same(name: str, tmp_path: Path) -> None:
    call = CALLS[name]
    mesh = mv.Mesh(BALL.vertices, BALL.faces)
    wanted = call(mesh, PAIRS, tmp_path)
    for form in MESHES.values():
        same(call(form, PAIRS, tmp_path), wanted)
    arrays = mv.decompose_mesh(mesh, 24)
    assert type(arrays) is tuple
    values, vectors = arrays
    same(call(mesh, [values, vectors], tmp_path), wanted)


def test_areas_of_arrays_are_recalled_or_those_of_the_mesh_or_refused(tmp_path: Path) -> None:
    values, vectors = mv.decompose_mesh(BALL, 8)
    copied = values, vectors.copy()
    with raises("no-area"):
        mv.filter_map(copied, HEIGHT, HEAT)
    measured = BALL, 3, "biharmonic"
    wanted = mv.distance_features(*measured, (values, vectors)).values
    same(mv.distance_features(*measured, copied).values, wanted)
    plain = mv.solve(*mv.cotangent_laplacian(BALL), 8)
    mv.write_eigenpairs(tmp_path / "p.npz", (plain.eigenvalues, +plain.eigenvectors), BALL)
    np.testing.assert_allclose(written(tmp_path / "p.npz")["mass"], plain.mass, rtol=1e-12)
    (tmp_path / "p.npz").unlink()
    for wrong in ((values, 2.0 * vectors), (values, np.ones_like(vectors))):
        with raises("no-area", "areas of these eigenvectors are not known"):
            mv.write_eigenpairs(tmp_path / "x.npz", wrong, BALL)
    with raises("wrong-shape", "shape (k,) with eigenvectors of shape (n, k)"):
        mv.compute_features((values, vectors.T), HEAT)
    with raises("wrong-type"):
        mv.compute_features(vectors, HEAT)
    assert not list(tmp_path.iterdir())

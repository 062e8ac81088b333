"""Written files opened in other programs, where these are installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import shapes
from faults import raises
from nibabel.freesurfer import write_geometry

from meshmash_viewer.cli.main import main
from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.provenance import provenance
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import write_features, write_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.structures import STRUCTURES, named_structure, structure_of_file

pytestmark = pytest.mark.usefixtures("read_here")
BALL = shapes.icosphere(2)
MESH = Mesh(BALL.vertices * 50.0, BALL.faces, unit="mm", name="ball", structure="CortexLeft")
COLUMNS = tuple(f"hks_t={time:.6g} λ" for time in np.geomspace(5e4, 2e7, 32))
VALUES = np.random.default_rng(0).normal(size=(MESH.n_vertices, len(COLUMNS)))

#: Number of vertices, number of faces, and the area if the program reports one.
Size = tuple[int, int, float | None]


def in_meshlab(path: Path) -> Size:
    library = pytest.importorskip("pymeshlab")
    meshes = library.MeshSet()
    meshes.load_new_mesh(str(path))
    found = meshes.current_mesh()
    area = meshes.get_geometric_measures()["surface_area"]
    return found.vertex_number(), found.face_number(), area


def in_vtk(path: Path) -> Size:
    import pyvista

    surface = pyvista.read(path)
    if isinstance(surface, pyvista.MultiBlock):
        surface = surface.combine().extract_surface(algorithm="dataset_surface")
    return surface.n_points, surface.n_cells, surface.area


def in_plyfile(path: Path) -> Size:
    content = pytest.importorskip("plyfile").PlyData.read(str(path))
    return content["vertex"].count, content["face"].count, None


def in_trimesh(path: Path) -> Size:
    import trimesh

    found = trimesh.load_mesh(path, process=False)
    return len(found.vertices), len(found.faces), found.area


def in_nibabel(path: Path) -> Size:
    image: Any = nibabel.load(path)
    points, triangles = (array.data for array in image.darrays[:2])
    return (*map(len, (points, triangles)), Mesh(points, triangles).area)  # type: ignore[return-value]


def in_workbench(path: Path) -> Size:
    rows = workbench("-file-information", path)
    return (
        int(rows["Number of Vertices"]),
        int(rows["Number of Triangles"]),
        float(rows["Surface Area"]),
    )


def workbench(*command: str | Path) -> dict[str, str]:
    """Run Connectome Workbench, and return the printed values by row name."""
    if shutil.which("wb_command") is None:
        pytest.skip("wb_command is not installed")
    said = subprocess.run(
        ["wb_command", *map(str, command)], capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr
    rows = [line.partition(":") for line in said.stdout.splitlines()]
    return {name.strip(): value.strip() for name, _, value in rows}


PROGRAMS: dict[str, tuple[Callable[[Path], Size], str]] = {
    "MeshLab": (in_meshlab, ".ply .obj .stl"),
    "VTK": (in_vtk, ".ply .obj .stl .glb .vtp"),
    "plyfile": (in_plyfile, ".ply"),
    "trimesh": (in_trimesh, ".ply .obj .stl .glb"),
    "nibabel": (in_nibabel, ".surf.gii"),
    "Workbench": (in_workbench, ".surf.gii"),
}
OPENED = [
    (program, ending) for program, (_, endings) in PROGRAMS.items() for ending in endings.split()
]


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(("program", "ending"), OPENED)
def test_a_mesh_opens(program: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"ball{ending}"
    write_mesh(path, MESH, provenance(MESH, {"formula": "exp(-t l) " * 600}))
    n_vertices, n_faces, area = PROGRAMS[program][0](path)
    assert n_faces == MESH.n_faces
    assert n_vertices in (MESH.n_vertices, 3 * MESH.n_faces if ending == ".stl" else 0)
    if area is not None:
        assert area == pytest.approx(MESH.area, rel=1e-5)


@pytest.mark.parametrize("ending", [".func.gii", ".shape.gii", ".gii"])
def test_gifti_features_have_their_intent_and_structure(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"ball{ending}"
    write_features(path, Features(VALUES, COLUMNS), MESH)
    image: Any = nibabel.load(path)
    assert image.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    intent = "NIFTI_INTENT_SHAPE" if ending == ".shape.gii" else "NIFTI_INTENT_NONE"
    assert len(image.get_arrays_from_intent(intent)) == len(COLUMNS)
    np.testing.assert_array_equal([each.data for each in image.darrays], np.float32(VALUES.T))
    write_features(path, Features(VALUES, COLUMNS), replace(MESH, structure=""))
    assert "AnatomicalStructurePrimary" not in nibabel.load(path).meta  # type: ignore[attr-defined]


def test_workbench_merges_what_is_of_one_structure(tmp_path: Path) -> None:
    for name, mesh, columns in (("a.func", MESH, 3), ("b.shape", MESH, 2)):
        found = Features(VALUES[:, :columns], COLUMNS[:columns])
        write_features(tmp_path / f"{name}.gii", found, mesh)
        rows = workbench("-file-information", tmp_path / f"{name}.gii")
        assert (rows["Structure"], rows["Number of Maps"]) == ("CortexLeft", str(columns))
        assert (rows["Type"], rows["Number of Vertices"]) == ("Metric", str(MESH.n_vertices))
    merged = tmp_path / "merged.func.gii"
    both = ["-metric", tmp_path / "a.func.gii", "-metric", tmp_path / "b.shape.gii"]
    workbench("-metric-merge", merged, *both)
    assert workbench("-file-information", merged)["Number of Maps"] == "5"
    write_mesh(tmp_path / "ball.surf.gii", MESH)
    rows = workbench("-file-information", tmp_path / "ball.surf.gii")
    assert (rows["Type"], rows["Structure"]) == ("Surface", "CortexLeft")
    workbench(
        "-metric-smoothing", tmp_path / "ball.surf.gii", merged, "4", tmp_path / "smooth.func.gii"
    )


@pytest.mark.parametrize("ending", [".ply", ".vtp", ".npz", ".surf.gii"])
def test_the_structure_is_carried_from_file_to_file(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"ball{ending}"
    write_mesh(path, replace(MESH, structure="HippocampusRight"))
    assert read_mesh(path).structure == "HippocampusRight"
    named = tmp_path / f"lh.ball{ending}"
    write_mesh(named, replace(MESH, structure=""))
    assert read_mesh(named).structure == "CortexLeft"
    write_mesh(named, replace(MESH, structure="CortexRight"))
    assert read_mesh(named).structure == "CortexRight", "what the file says counts more"


@pytest.mark.parametrize(
    ("name", "structure"),
    [
        ("lh.pial", "CortexLeft"), ("rh.white", "CortexRight"), ("lh.pial.surf.gii", "CortexLeft"),
        ("rh.x.ply", "CortexRight"), ("LH.pial", ""), ("lhasa.ply", ""), ("sub.lh.pial", ""),
        ("left.ply", ""), ("lh", ""), ("rh.", "CortexRight"),
    ],
)  # fmt: skip
def test_freesurfer_names_say_the_hemisphere(name: str, structure: str) -> None:
    assert structure_of_file(name) == structure


def test_structures_are_known_in_any_writing() -> None:
    for text in ("left", "lh", "L", "CORTEX_LEFT", "cortex left", "Cortex-Left", "CortexLeft"):
        assert named_structure(text) == "CortexLeft"
    assert all(named_structure(each) == each for each in STRUCTURES)
    for text in ("", "middle", "CortexLeftt", "left right"):
        with raises("unknown-name", "no structure", "CortexLeft, CortexRight"):
            named_structure(text)


@pytest.mark.parametrize("unit", ["", "nm", "µm", "mm", "m"])
def test_a_gifti_surface_is_in_millimetres(unit: str, tmp_path: Path) -> None:
    path = tmp_path / "ball.surf.gii"
    write_mesh(path, replace(MESH, unit=unit))
    found = read_mesh(path)
    scale = {"": 1.0, "nm": 1e-6, "µm": 1e-3, "mm": 1.0, "m": 1e3}[unit]
    assert found.unit == ("mm" if unit else "")
    np.testing.assert_allclose(found.vertices, scale * MESH.vertices, rtol=1e-6, atol=1e-6 * scale)
    np.testing.assert_array_equal(found.faces, MESH.faces)


def test_the_command_line_writes_the_structure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("lh.pial", "pial"):
        write_geometry(tmp_path / name, MESH.vertices, MESH.faces)

    def stated(mesh: str, *options: str) -> list[str]:
        metric, surface = tmp_path / "out.func.gii", tmp_path / "out.surf.gii"
        common = [str(tmp_path / mesh), "--count", "5", "--no-cache", *options, "-o"]
        assert main(["features", *common, str(metric), "--n-components", "2"]) == 0
        assert main(["reconstruct", *common, str(surface)]) == 0
        images: list[Any] = [nibabel.load(metric), nibabel.load(surface).darrays[0]]  # type: ignore[attr-defined]
        return [each.meta.get("AnatomicalStructurePrimary", "") for each in images]

    assert stated("lh.pial") == ["CortexLeft"] * 2
    assert stated("pial") == [""] * 2
    assert stated("pial", "--structure", "right") == ["CortexRight"] * 2
    assert stated("lh.pial", "--structure", "CEREBELLUM") == ["Cerebellum"] * 2
    capsys.readouterr()
    bad = ["features", str(tmp_path / "pial"), "-o", str(tmp_path / "out.surf.gii")]
    assert main(bad) == 2
    assert "features are neither: give it the ending .func.gii" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["reconstruct", str(tmp_path / "pial"), "--structure", "x", "-o", "a.ply"])
    assert ended.value.code == 2
    assert main(["info", str(tmp_path / "lh.pial")]) == 0
    assert "CortexLeft" in capsys.readouterr().out

"""Writers of features, eigenpairs and pictures: content, provenance and failures."""

from __future__ import annotations

import csv
import datetime
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.atomic import made_folder, written_whole
from meshmash_viewer.io.provenance import provenance
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import check_output, write_eigenpairs, write_features, write_picture
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import NO_VOXEL

pytestmark = pytest.mark.usefixtures("read_here")

COLUMNS = ("hks_t=1.23e+05", "wks_λ=2", "band 03")
OPTIONS = {"count": 20, "t_min": 1.5}


@pytest.fixture
def mesh(sphere: Mesh) -> Mesh:
    """Return a mesh as read from a file with voxel coordinates."""
    vertices = 1e6 + sphere.vertices * 1234.5
    return Mesh(vertices, sphere.faces, unit="nm", name="ball", voxel=(4.0, 4.0, 40.0))


@pytest.fixture
def features(mesh: Mesh, rng: np.random.Generator) -> Features:
    values = rng.normal(size=(mesh.n_vertices, 3)) * [1e-8, 1.0, 1e3]
    values[7] = np.nan  # as at an unreferenced vertex
    return Features(values, COLUMNS, unit="nm⁻²", kind="hks")


def read_back(path: Path) -> tuple[np.ndarray, list[str], dict[str, Any]]:
    """Return values (n, f), column names and provenance, read by other libraries."""
    match path.suffix:
        case ".npz":
            with np.load(path, allow_pickle=False) as archive:
                meta = json.loads(str(archive["meta"]))
                return archive["features"], archive["columns"].tolist(), meta
        case ".npy":
            meta = json.loads(path.with_name(path.name + ".json").read_text())
            return np.load(path), meta["columns"], meta
        case ".csv":
            meta = json.loads(path.with_name(path.name + ".json").read_text())
            names = next(csv.reader(path.read_text(encoding="utf-8").splitlines()))
            table = np.genfromtxt(path, delimiter=",", skip_header=1)
            assert np.array_equal(table[:, 0], np.arange(len(table)))
            return table[:, 1:], names[1:], meta
        case ".parquet":
            import pyarrow.parquet

            content = pyarrow.parquet.read_table(path)
            meta = json.loads(content.schema.metadata[b"meshmash-viewer"])
            columns = [column.to_numpy() for column in content.columns[1:]]
            return np.column_stack(columns), content.column_names[1:], meta
        case ".vtp":
            import pyvista

            poly = pyvista.read(path)
            meta = json.loads(poly.field_data["meshmash-viewer"][0])
            names = list(poly.point_data.keys())
            return np.column_stack([poly.point_data[name] for name in names]), names, meta
        case ".ply":
            header = path.read_bytes().split(b"end_header")[0].decode().splitlines()
            made = [line for line in header if line.startswith("comment meshmash-viewer")]
            meta = json.loads("".join(line.split(" ", 2)[2] for line in made))
            import trimesh

            raw = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
            names = [name for name in raw.dtype.names if name not in "xyz"]
            return np.column_stack([raw[name] for name in names]), names, meta
        case ".gii":
            import nibabel

            image: Any = nibabel.load(path)
            meta = json.loads(image.meta["meshmash-viewer"])
            names = [array.meta["Name"] for array in image.darrays]
            return np.column_stack([array.data for array in image.darrays]), names, meta
    raise AssertionError(path)


@pytest.mark.parametrize("ending", WRITERS)
def test_features_come_back(ending: str, mesh: Mesh, features: Features, tmp_path: Path) -> None:
    path = tmp_path / f"out{ending}"
    known = {"eigenvalues": np.arange(3.0), "mesh_errors": np.array([0.0, 0.01, 0.07])}
    write_features(path, features, mesh, **known, meta=OPTIONS)
    values, columns, meta = read_back(path)
    single = ending in (".ply", ".func.gii", ".shape.gii", ".gii")
    np.testing.assert_allclose(values, features.values, rtol=1e-7 if single else 1e-15)
    if ending == ".ply":
        assert columns == ["hks_t=1.23e+05", "wks_lambda=2", "band_03"]
    else:
        assert columns == list(COLUMNS)
    assert meta["mesh"]["hash"] == mesh.content_hash
    assert meta["mesh"]["unit"] == "nm"
    assert meta["mesh"]["voxel"] == [4.0, 4.0, 40.0]
    of_pairs = {name: each.tolist() for name, each in known.items()}
    assert meta["options"] == {"kind": "hks", "values_unit": "nm⁻²"} | OPTIONS | of_pairs
    assert meta["program"].startswith("meshmash-viewer ")
    assert set(meta["versions"]) >= {"numpy", "scipy", "robust_laplacian"}
    made_at = datetime.datetime.fromisoformat(meta["created"])
    assert made_at.utcoffset() == datetime.timedelta(0)
    assert made_at.microsecond == 0
    left = {file.name for file in tmp_path.iterdir()}
    assert left == {path.name} | ({f"{path.name}.json"} if ending in (".npy", ".csv") else set())


def test_provenance_may_be_given_whole(mesh: Mesh, features: Features, tmp_path: Path) -> None:
    made = provenance(mesh, OPTIONS)
    write_features(tmp_path / "out.npz", features, mesh, meta=made)
    _, _, meta = read_back(tmp_path / "out.npz")
    assert meta["options"] == {"kind": "hks", "values_unit": "nm⁻²"} | OPTIONS
    assert meta["created"] == made["created"]
    least = {"program": "another 1.0", "mesh": {"name": "m"}, "options": {"times": 3}}
    write_features(tmp_path / "least.npz", features, mesh, meta=least)
    _, _, meta = read_back(tmp_path / "least.npz")
    assert meta["program"] == "another 1.0"
    assert meta["options"]["times"] == 3


@pytest.mark.parametrize("ending", [".npz", ".vtp", ".ply"])
def test_formats_with_geometry_are_the_same_mesh(
    ending: str, mesh: Mesh, features: Features, tmp_path: Path
) -> None:
    path = tmp_path / f"out{ending}"
    write_features(path, features, mesh)
    again = read_mesh(path)
    assert again.content_hash == mesh.content_hash
    assert (again.unit, again.voxel) == ("nm", NO_VOXEL), "lengths, not voxels, are in the file"
    assert read_mesh(path, unit="m").unit == "m"
    if ending == ".npz":
        with np.load(path) as archive:
            assert set(archive.files) == {
                "features",
                "columns",
                "eigenvalues",
                "vertices",
                "faces",
                "meta",
            }


@pytest.mark.parametrize("ending", WRITERS)
def test_eigenpairs_come_back(
    ending: str, mesh: Mesh, rng: np.random.Generator, tmp_path: Path
) -> None:
    k, n = 4, mesh.n_vertices
    pairs = Eigenpairs(
        np.arange(k, dtype=np.float64),
        rng.normal(size=(k, n)),
        np.full(k, 1e-12),
        Certificate("inertia", k, k, float(k), orthonormality=1e-15),
        mass=np.ones(n),
        mesh_errors=np.array([0.0, 0.01, 0.02, 0.07]),
    )
    path = tmp_path / f"pairs{ending}"
    write_eigenpairs(path, pairs, mesh, {"count": k})
    if ending == ".npz":
        with np.load(path, allow_pickle=False) as archive:
            np.testing.assert_array_equal(archive["eigenvectors"], pairs.eigenvectors)
            np.testing.assert_array_equal(archive["eigenvalues"], pairs.eigenvalues)
            np.testing.assert_array_equal(archive["mass"], pairs.mass)
            meta = json.loads(str(archive["meta"]))
    else:
        values, names, meta = read_back(path)
        np.testing.assert_allclose(values, pairs.eigenvectors, rtol=1e-6)
        assert names == meta["columns"] == ["phi_000", "phi_001", "phi_002", "phi_003"]
    assert meta["options"]["eigenvalues"] == [0.0, 1.0, 2.0, 3.0]
    assert meta["options"]["mesh_errors"] == [0.0, 0.01, 0.02, 0.07]
    assert meta["options"]["proof"] == pairs.proof(mesh.unit)
    assert meta["options"]["count"] == k


@pytest.mark.parametrize("channels", [3, 4])
def test_picture_comes_back(channels: int, tmp_path: Path) -> None:
    from PIL import Image

    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, channels), dtype=np.uint8)
    path = tmp_path / "picture.png"
    write_picture(path, pixels)
    with Image.open(path) as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
        assert image.info["Software"] == "meshmash-viewer"
    with raises("unknown-ending"):
        write_picture(tmp_path / "picture.jpg", pixels)


@pytest.mark.parametrize("ending", WRITERS)
def test_failure_leaves_the_old_file_whole(
    ending: str, mesh: Mesh, features: Features, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"out{ending}"
    path.write_bytes(b"the old content")
    writer = WRITERS[ending]

    def fail_at_the_end(part: Path, table: Any) -> None:
        writer(part, table)
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, ending, fail_at_the_end)
    with raises("not-writable"):
        write_features(path, features, mesh)
    assert path.read_bytes() == b"the old content"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", [".npy", ".csv"])
def test_the_note_names_its_table(
    ending: str, mesh: Mesh, features: Features, tmp_path: Path
) -> None:
    path = tmp_path / f"out{ending}"
    for factor in (1.0, 2.0):
        write_features(path, Features(features.values * factor, COLUMNS), mesh)
        note = json.loads(path.with_name(path.name + ".json").read_text())
        assert note["table_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def killed_while_writing(path: Path) -> list[Path]:
    """Kill a process before it renames its temporary files; return these files."""
    code = (
        "import os, sys\nfrom pathlib import Path\n"
        "from meshmash_viewer.io.atomic import written_together\n"
        "with written_together(*map(Path, sys.argv[1:])) as parts:\n"
        "    for part in parts: part.write_bytes(b'half')\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    note = path.with_name(path.name + ".json")
    subprocess.run([sys.executable, "-c", code, str(path), str(note)], check=False)
    return [each for each in path.parent.iterdir() if each not in (path, note)]


@pytest.mark.skipif(sys.platform == "win32", reason="needs a signal that cannot be caught")
def test_what_a_killed_export_left_goes_with_the_next(
    mesh: Mesh, features: Features, tmp_path: Path
) -> None:
    left = killed_while_writing(tmp_path / "out.csv")
    assert len(left) == 2
    write_features(tmp_path / "other.npz", features, mesh)
    assert list(tmp_path.iterdir()) == [tmp_path / "other.npz"]


def test_a_folder_that_is_made_goes_again_where_it_stays_empty(tmp_path: Path) -> None:
    with made_folder(tmp_path), made_folder(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir()
    assert not list(tmp_path.iterdir())
    with made_folder(tmp_path / "c" / "d"):
        (tmp_path / "c" / "kept").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["c", "kept"]


def test_what_others_write_stays(mesh: Mesh, features: Features, tmp_path: Path) -> None:
    with written_whole(tmp_path / "ours.npz") as part:
        part.write_bytes(b"half")
        # A process of another machine may still be writing, unless its temporary file is old.
        young, old = (tmp_path / f".meshmash-0000000{i}-1-00000000-theirs.npz" for i in (1, 2))
        hidden = tmp_path / ".meshmash-notes"
        for each in (young, old, hidden):
            each.touch()
        for each in (old, hidden):
            os.utime(each, (0, 0))
        write_features(tmp_path / "out.npz", features, mesh)
        assert part.exists()
    assert young.exists()
    assert hidden.exists()
    assert not old.exists()


def test_rows_have_to_go_with_the_mesh(mesh: Mesh, tmp_path: Path) -> None:
    with raises("other-mesh", "5 rows"):
        write_features(tmp_path / "out.npz", Features(np.zeros((5, 1)), ("a",)), mesh)


@pytest.mark.parametrize("kind", ["features", "eigenpairs", "picture"])
def test_what_cannot_be_written_is_known_before_it_is_computed(kind: str, tmp_path: Path) -> None:
    ending = ".png" if kind == "picture" else ".npz"
    check_output(tmp_path / f"a{ending}", kind)
    with raises("unknown-ending", "a.xyz has no ending in which it can be written"):
        check_output(tmp_path / "a.xyz", kind)
    with raises("folder-not-found"):
        check_output(tmp_path / "absent" / f"a{ending}", kind)
    assert not list(tmp_path.iterdir())

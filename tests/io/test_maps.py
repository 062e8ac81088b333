"""Files of values per vertex: round trips in every format, and one-sentence errors."""

from __future__ import annotations

import gzip
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
import shapes
from faults import raises
from nibabel.freesurfer import write_annot, write_geometry, write_morph_data
from nibabel.gifti import GiftiDataArray, GiftiImage, GiftiLabel, GiftiLabelTable
from tiers import slow_but

from meshmash_viewer.errors import InputError
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.maps import is_map_file, maps_and_remarks, read_labels, read_maps
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.vertex_map import Label, VertexMap

pytestmark = pytest.mark.usefixtures("read_here")

MESH = shapes.icosphere(1)
N = MESH.n_vertices
#: Values that are exact in float32 and in text; vertex 5 has none.
VALUES = np.where(np.arange(N) == 5, np.nan, np.arange(N) / 8.0 - 2.0)
PARTS = np.arange(N) % 3
LABELS = (Label(0, "left", "#ff0000"), Label(1, "right", "#00ff80"), Label(2, "top", "#0000ff"))


def gifti(
    path: Path, intent: str, values: np.ndarray, labels: bool = False, alpha_of_0: float = 1.0
) -> None:
    image = GiftiImage()
    if labels:
        image.labeltable = GiftiLabelTable()
        for given in LABELS:
            rgb = [int(given.color[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
            label = GiftiLabel(given.key, *rgb, 1.0 if given.key else alpha_of_0)
            label.label = given.name
            image.labeltable.labels.append(label)
    image.add_gifti_data_array(GiftiDataArray(values, intent=intent))
    path.write_bytes(image.to_bytes())


def write_csv(path: Path) -> None:
    order = np.arange(N)[::-1]
    rows = [f"{v},{VALUES[v]}" for v in order]
    path.write_text("\n".join(["vertex,depth", *rows]) + "\n")


def write_parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"depth": VALUES}), path)


def write_mgh(path: Path) -> None:
    data = VALUES.astype(np.float32).reshape(N, 1, 1)
    nibabel.save(nibabel.MGHImage(data, np.eye(4)), path)


def write_vtp(path: Path) -> None:
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(MESH.vertices, MESH.faces)
    surface["depth"] = VALUES
    surface.save(path)


def write_ply(path: Path) -> None:
    import trimesh

    given = {"depth": VALUES.astype(np.float32)}
    mesh = trimesh.Trimesh(MESH.vertices, MESH.faces, process=False, vertex_attributes=given)
    path.write_bytes(mesh.export(file_type="ply"))


def write_glb(path: Path) -> None:
    import trimesh

    given = {"depth": VALUES.astype(np.float32)}
    mesh = trimesh.Trimesh(MESH.vertices, MESH.faces, process=False, vertex_attributes=given)
    mesh.export(path)


def write_npz_mesh(path: Path) -> None:
    np.savez(
        path,
        vertices=MESH.vertices,
        faces=MESH.faces,
        depth=VALUES,
        eigenvalues=np.ones(3),
        about=np.array([{}], dtype=object),
    )


FILES: dict[str, Callable[[Path], None]] = {
    "depth.npy": lambda path: np.save(path, VALUES),
    "depth.npz": lambda path: np.savez(path, depth=VALUES, eigenvalues=np.ones(N), other=[1.0]),
    "depth.csv": write_csv,
    "plain.csv": lambda path: np.savetxt(path, VALUES),
    "depth.parquet": write_parquet,
    "depth.func.gii": lambda path: gifti(path, "NIFTI_INTENT_NONE", VALUES.astype(np.float32)),
    "depth.shape.gii": lambda path: gifti(path, "NIFTI_INTENT_SHAPE", VALUES.astype(np.float32)),
    "depth.gii": lambda path: gifti(path, "NIFTI_INTENT_SHAPE", VALUES.astype(np.float32)),
    "lh.curv": lambda path: write_morph_data(path, VALUES),
    "lh.thickness": lambda path: write_morph_data(path, VALUES),
    "lh.sulc": lambda path: write_morph_data(path, VALUES),
    "lh.area.pial": lambda path: write_morph_data(path, VALUES),
    "depth.mgh": write_mgh,
    "depth.mgz": write_mgh,
}
MESH_FILES = {
    "mesh.vtp": write_vtp,
    "mesh.vtk": write_vtp,
    "mesh.ply": write_ply,
    "mesh.glb": write_glb,
    "mesh.npz": write_npz_mesh,
}


@pytest.mark.parametrize(
    ("name", "packed"),
    [
        (name, packed)
        for name in [*FILES, "lh.w-g"]
        for packed in ("", ".gz")
        if name + packed != "depth.mgz.gz"
    ],
)
def test_values_come_back_as_they_were_written(name: str, packed: str, tmp_path: Path) -> None:
    path = tmp_path / name
    FILES.get(name, FILES["lh.curv"])(path)
    if packed:
        path = path.rename(tmp_path / f"{name}.gz")
        path.write_bytes(gzip.compress(path.read_bytes()))
    assert is_map_file(path)
    (found,) = read_maps(path, MESH)
    np.testing.assert_array_equal(found.values, VALUES)
    assert found.name in ("depth", name)
    assert (found.path, found.labels, found.signed) == (str(path), (), True)


@pytest.mark.parametrize("name", slow_but(["mesh.vtp", "mesh.npz"], MESH_FILES))
def test_a_mesh_brings_its_maps(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    MESH_FILES[name](path)
    assert not is_map_file(path)
    mesh = read_mesh(path)
    (found,) = mesh.maps
    assert (found.name, found.path) == ("depth", "")
    # a format may put the vertices in another order
    place = np.linalg.norm(mesh.vertices[:, None] - MESH.vertices, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(found.values, VALUES[place])
    (again,) = read_maps(path, mesh)
    np.testing.assert_array_equal(again.values, found.values)
    (sent,) = pickle.loads(pickle.dumps(mesh)).maps
    np.testing.assert_array_equal(sent.values, found.values)


def write_annotation(path: Path) -> None:
    colors = [[int(label.color[at : at + 2], 16) for at in (1, 3, 5)] + [0] for label in LABELS]
    names = [label.name for label in LABELS]
    write_annot(path, PARTS, np.array(colors), names, fill_ctab=True)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("lh.aparc.annot", write_annotation),
        (
            "parts.label.gii",
            lambda path: gifti(path, "NIFTI_INTENT_LABEL", PARTS.astype(np.int32), labels=True),
        ),
    ],
)
def test_labels_have_their_names_and_colors(
    name: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    path = tmp_path / name
    write(path)
    packed = path.with_name(f"{name}.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert is_map_file(path) and is_map_file(packed)  # noqa: PT018
    np.testing.assert_array_equal(read_labels(packed, MESH).values, PARTS)
    (found,) = read_maps(path, MESH)
    assert found.labels == LABELS
    np.testing.assert_array_equal(found.values, PARTS)
    np.testing.assert_array_equal(found.shown, PARTS)


def write_label(path: Path, last: int) -> None:
    inside = [3, 8, last]
    rows = [f"{vertex} 0.0 0.0 0.0 0.0" for vertex in inside]
    path.write_text("\n".join(["#!ascii label", str(len(rows)), *rows]) + "\n")


def test_the_transparent_label_0_of_workbench_is_none(tmp_path: Path) -> None:
    path = tmp_path / "parts.label.gii"
    gifti(path, "NIFTI_INTENT_LABEL", PARTS.astype(np.int32), labels=True, alpha_of_0=0.0)
    (found,) = read_maps(path, MESH)
    assert found.labels == LABELS[1:]
    assert np.array_equal(np.nan_to_num(found.values), PARTS)


def test_our_own_features_come_back_as_maps(tmp_path: Path) -> None:
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.io.write import write_features

    values = np.stack([VALUES, 2.0 * VALUES], axis=1)
    mesh = MESH.with_maps(VertexMap("voltage", VALUES, unit="mV"))
    features = Features(values, ("one", "two"), "nm⁻²").with_maps(mesh).with_components(mesh)
    for ending in (".npz", ".npy", ".vtp", ".ply", ".csv", ".parquet", ".func.gii"):
        path = tmp_path / f"made{ending}"
        write_features(path, features, MESH)
        found = read_maps(path, MESH)
        units = [(each.name, each.unit) for each in found]
        assert units == [
            ("one", "nm⁻²"), ("two", "nm⁻²"), ("voltage", "mV"), ("component", ""),
        ], ending  # fmt: skip
        np.testing.assert_allclose(found[1].values, values[:, 1])


def test_a_packed_table_has_the_units_of_the_file_next_to_it(tmp_path: Path) -> None:
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.io.write import write_features

    path = tmp_path / "made.npy"
    write_features(path, Features(VALUES[:, None], ("one",), "nm⁻²"), MESH)
    packed = path.with_name("made.npy.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    (found,) = read_maps(packed, MESH)
    assert (found.name, found.unit, found.path) == ("one", "nm⁻²", str(packed))
    packed.write_bytes(packed.read_bytes()[:-20])
    with raises("file-cut-short"):
        read_maps(packed, MESH)


@pytest.mark.parametrize("n_maps", [1, 41, 100])
def test_maps_in_the_rows_of_an_array(n_maps: int, tmp_path: Path) -> None:
    rows = np.arange(float(n_maps * N)).reshape(n_maps, N).astype(np.float32)
    gifti(tmp_path / "bold.func.gii", "NIFTI_INTENT_TIME_SERIES", rows)
    np.save(tmp_path / "bold.npy", rows)
    np.savez(tmp_path / "bold.npz", bold=rows)
    for ending in (".func.gii", ".npy", ".npz"):
        found = read_maps(tmp_path / f"bold{ending}", MESH)
        assert len({each.name for each in found}) == n_maps
        np.testing.assert_array_equal([each.values for each in found], rows)
    large = Mesh(*shapes.icosphere(2))
    rows = np.arange(float(5 * large.n_vertices)).reshape(5, -1).astype(np.float32)
    gifti(tmp_path / "bold.func.gii", "NIFTI_INTENT_TIME_SERIES", rows)
    np.testing.assert_array_equal(
        [each.values for each in read_maps(tmp_path / "bold.func.gii", large)], rows
    )


@pytest.mark.parametrize(
    ("file", "mesh", "warned"),
    [
        ("sulc_left.npy", "pial_right", True), ("s1.L.sulc.npy", "rh.pial", True),
        ("hemi-L_curv.csv", "hemi-R_midthickness", True), ("LeftThickness.npy", "rh.white", True),
        ("area.lh.npy", "rh.pial", True), ("L.func.gii", "rh.inflated", True),
        ("sulc_left.npy", "lh.pial", False), ("thickness_r2.npy", "lh.pial", False),
        ("motor_right_hand_L.func.gii", "lh.pial", False), ("sulc_lh_rh.npy", "rh.pial", False),
        ("sulc_left.npy", "neuron_right", False), ("left.npy", "rh.pial", False),
    ],
)  # fmt: skip
def test_a_map_of_the_other_hemisphere(file: str, mesh: str, warned: bool, tmp_path: Path) -> None:
    path, ending = tmp_path / file, file.rpartition(".")[2]
    FILES[f"depth.{ending}"](path)
    _, remarks = maps_and_remarks(path, replace(MESH, name=mesh))
    wanted = [f"{path} is of the other hemisphere than {mesh}: by its name."] if warned else []
    assert list(remarks) == wanted


def test_the_other_hemisphere_is_also_known_from_within_the_file(tmp_path: Path) -> None:
    right = replace(MESH, name="rh.pial")
    np.savez(tmp_path / "both.npz", **{"lh.area": VALUES, "rh.area": VALUES})
    _, remarks = maps_and_remarks(tmp_path / "both.npz", right)
    assert [each.partition(": ")[2] for each in remarks] == ["by the name lh.area."]
    array = GiftiDataArray(VALUES.astype(np.float32), intent="NIFTI_INTENT_SHAPE")
    array.meta["AnatomicalStructurePrimary"] = "CortexLeft"  # of the array, not of the image
    path = tmp_path / "depth.gii"
    path.write_bytes(GiftiImage(darrays=[array]).to_bytes())
    _, remarks = maps_and_remarks(path, right)
    assert [each.partition(": ")[2] for each in remarks] == ["it states CortexLeft."]


def test_a_map_without_the_medial_wall(tmp_path: Path) -> None:
    brain, mask = replace(MESH, name="lh.pial"), np.arange(N) % 10 > 0
    values, path = np.arange(float(mask.sum())), tmp_path / "thickness.npy"
    np.save(path, values)
    with raises("other-mesh") as raised:
        read_maps(path, brain)
    code = str(raised.value)[str(raised.value).index("np.savez") : -1]
    code = code.replace("thickness.npz", str(tmp_path / "thickness.npz"))
    exec(code, {"np": np, "mask": mask, "values": values})
    (found,) = read_maps(tmp_path / "thickness.npz", brain)
    np.testing.assert_array_equal(found.values[mask], values)
    assert np.isnan(found.values[~mask]).all()
    for mesh, count in ((MESH, len(values)), (brain, 30), (brain, N + 1)):
        np.save(path, np.arange(float(count)))
        with raises("other-mesh", "give a map that was made for this surface."):
            read_maps(path, mesh)


def test_indices_that_count_from_one(tmp_path: Path) -> None:
    path = tmp_path / "depth.csv"
    for first, said in ((1, ": subtract 1 if it counts from 1, or give"), (0, ": give the one")):
        vertices = [first, *range(2, N + 1)]
        path.write_text("vertex,depth\n" + "\n".join(f"{each},1" for each in vertices))
        with raises("vertex-out-of-range", said):
            read_maps(path, MESH)


def labels_beyond(path: Path) -> None:
    write_label(path, N)


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "short.npy": (lambda path: np.save(path, VALUES[:-1]), r"41 values and the mesh 42 vertices"),
    "text.npy": (lambda path: np.save(path, np.full(N, "a")), r"type <U1: give real numbers"),
    "nothing.npy": (lambda path: np.save(path, np.full(N, np.nan)), r"all are NaN"),
    "complex.npy": (lambda path: np.save(path, np.full(N, 1j)), r"type complex128: give real"),
    "infinite.npy": (
        lambda path: np.save(path, np.where(np.arange(N) == 7, np.inf, 1.0)),
        r"1 infinite value, the first at vertex 7: put NaN",
    ),
    "volume.npy": (lambda path: np.save(path, np.ones((2, 3, 4))), r"shape \(2, 3, 4\)"),
    "objects.npy": (
        lambda path: np.save(path, np.array([{}] * N), allow_pickle=True),
        r"has an array of Python objects: save it with a type of numbers",
    ),
    "words.csv": (lambda path: path.write_text("a\n" + "b\n" * N), r"no column of numbers"),
    "twice.csv": (
        lambda path: path.write_text("vertex,a\n" + "3,1\n" * N),
        r"column vertex that is not an index",
    ),
    "empty.csv": (lambda path: path.write_text(""), r"is empty"),
    "lh.other.label": (labels_beyond, r"names vertex 42, and the mesh has 42 vertices"),
    "lh.cut.annot": (lambda path: path.write_bytes(b"\0\0\0\x2a\0\0"), r"ends within its labels"),
    "lh.cut.curv": (lambda path: path.write_bytes(b"\xff\xff\xff\0\0"), r"does not begin like"),
    "lh.promise.annot": (
        lambda path: path.write_bytes(np.array([2**31 - 1, 0, 0], ">i4").tobytes()),
        r"ends within its labels",
    ),
    "mesh.surf.gii": (
        lambda path: gifti(path, "NIFTI_INTENT_POINTSET", MESH.vertices.astype(np.float32)),
        r"one number per vertex",
    ),
    "notes.md": (lambda path: path.write_text("hello"), r"ending \(\.md\)"),
    "notes.txt": (lambda path: path.write_text("hello"), r"is no table"),
    "volume.mgh": (
        lambda path: nibabel.save(
            nibabel.MGHImage(np.ones((3, 4, 5), np.float32), np.eye(4)), path
        ),
        r"of a volume, not of a surface",
    ),
}


#: One case of each kind of fault. Other files are read in a child process under limits (0.5 s).
QUICK = ["short.npy", "text.npy", "infinite.npy", "words.csv", "lh.other.label", "notes.md"]


@pytest.mark.parametrize("name", slow_but(QUICK, BROKEN))
def test_what_is_no_map_is_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("meshmash_viewer.io.raw._watched", name in QUICK)
    path = tmp_path / name
    write, pattern = BROKEN[name]
    write(path)
    with pytest.raises(InputError, match=pattern) as raised:
        read_maps(path, MESH)
    said = str(raised.value)
    assert said.startswith(str(path))
    assert said.endswith(".")
    assert "\n" not in said
    assert said.removesuffix(".").count(". ") == 0


def test_numpy_arrays_of_other_shapes_and_types(tmp_path: Path) -> None:
    values = np.arange(2.0 * N).reshape(2, N)
    large = Mesh(*shapes.icosphere(2))
    np.save(tmp_path / "rows.npy", np.arange(2.0 * large.n_vertices).reshape(2, -1))
    first, second = read_maps(tmp_path / "rows.npy", large)
    np.testing.assert_array_equal(second.values, first.values + large.n_vertices)
    np.save(
        tmp_path / "fields.npy", np.array(list(map(tuple, values.T)), [("a", "f4"), ("b", "f8")])
    )
    assert [each.name for each in read_maps(tmp_path / "fields.npy", MESH)] == ["a", "b"]
    np.testing.assert_array_equal(read_maps(tmp_path / "fields.npy", MESH)[1].values, values[1])


def test_columns_of_afni_are_maps(tmp_path: Path) -> None:
    path = tmp_path / "depth.1D"
    path.write_text("# ni_dimen = 42\n# area\n" + "".join(f" {each} 7\n" for each in VALUES))
    first, second = read_maps(path, MESH)
    np.testing.assert_allclose(first.values, VALUES)
    assert set(second.values) == {7}


def test_the_first_format_of_freesurfer_values(tmp_path: Path) -> None:
    values = np.arange(N) - 20
    content = N.to_bytes(3) + (2 * N).to_bytes(3) + (100 * values).astype(">i2").tobytes()
    (tmp_path / "lh.curv").write_bytes(content)
    (found,) = read_maps(tmp_path / "lh.curv", MESH)
    np.testing.assert_allclose(found.values, values)
    (tmp_path / "lh.curv").write_bytes(content + b"x")
    with raises("wrong-format"):
        read_maps(tmp_path / "lh.curv", MESH)


def test_a_gifti_file_may_name_its_vertices(tmp_path: Path) -> None:
    arrays = [
        GiftiDataArray(np.array([5, 1], np.int32), intent="NIFTI_INTENT_NODE_INDEX"),
        GiftiDataArray(np.array([0.5, 0.25], np.float32), intent="NIFTI_INTENT_SHAPE"),
    ]
    path = tmp_path / "lh.some.func.gii"
    path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
    (found,) = read_maps(path, MESH)
    assert found.name == path.name
    assert np.flatnonzero(np.isfinite(found.values)).tolist() == [1, 5]
    assert found.values[[5, 1]].tolist() == [0.5, 0.25]
    for wrong, code in (([-1, 2], "not-whole-numbers"), ([1, 2, 3], "counts-differ")):
        indices = np.array(wrong, np.int32)
        arrays[0] = GiftiDataArray(indices, intent="NIFTI_INTENT_NODE_INDEX")
        path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
        with raises(code):
            read_maps(path, MESH)


def test_a_surface_is_no_map(tmp_path: Path) -> None:
    path = tmp_path / "lh.pial"
    write_geometry(path, MESH.vertices, MESH.faces)
    assert not is_map_file(path)
    with raises("file-not-found"):
        read_maps(tmp_path / "lh.curv", MESH)


def test_maps_go_along_with_repairs(tmp_path: Path) -> None:
    """A map with the vertices of the file can be added before and after a repair of the mesh."""
    both = shapes.three_spheres()
    marks = np.arange(both.n_vertices, dtype=np.float64)
    marked = both.with_maps(VertexMap("marks", marks), VertexMap("marks", marks))
    assert [each.name for each in marked.maps] == ["marks", "marks 2"]
    for mesh in (marked, replace(marked, maps=())):
        left = repair_mesh(mesh, "keep_largest_component", "drop_unreferenced_vertices")
        first = (left if left.maps else left.with_maps(VertexMap("marks", marks))).maps[0]
        np.testing.assert_array_equal(both.vertices[first.values.astype(int)], left.vertices)
    with raises("other-mesh"):
        left.with_maps(VertexMap("marks", marks[:-1]))
    scaled = marked.in_voxels((2.0, 2.0, 2.0), "nm").without_map("marks")
    assert [each.name for each in scaled.maps] == ["marks 2"]


def test_a_map_is_of_its_mesh() -> None:
    with raises("other-mesh", "3 values and the mesh 42 vertices"):
        Mesh(MESH.vertices, MESH.faces, maps=(VertexMap("a", np.ones(3)),))
    with raises("wrong-shape"):
        VertexMap("a", np.ones((N, 2)))
    assert VertexMap("a", np.arange(3)).values.dtype == np.float64
    assert not VertexMap("a", np.arange(3)).signed
    assert not VertexMap("thickness", np.array([-0.003, 0.0, 4.7])).signed  # slightly < 0
    smoothed = np.append(np.linspace(0.5, 4.0, 500), [-0.3, -0.1])
    assert not VertexMap("thickness of few pairs", smoothed).signed  # few values < 0
    assert VertexMap("few", np.append(np.zeros(500), [-3.0, 4.0])).signed
    assert VertexMap("curv", np.array([-0.4, 0.0, 0.3])).signed
    assert not VertexMap("parts", np.arange(-1, 2), (Label(-1, "a", "#000000"),)).signed


def test_an_array_of_too_many_columns_is_no_map(tmp_path: Path) -> None:
    np.savez(path := tmp_path / "rows.npz", wide=np.ones((162, 65)))
    with raises("no-values", "an array wide of 65 columns, of which 64 can be taken"):
        read_maps(path, shapes.icosphere(2))

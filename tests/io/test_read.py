"""Mesh readers: the same mesh from every format, and one-sentence errors for broken files."""

from __future__ import annotations

import gzip
import os
import re
import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from faults import raises
from mesh_files import (
    FACES,
    VERTICES,
    WRITERS,
    draco_bytes,
    same_surface,
    write_freesurfer,
    write_freesurfer_text,
    write_meshparty,
    write_obj,
    write_text_ply,
    write_vtk,
)
from tiers import slow, slow_unless

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.io.maps import is_map_file, read_maps
from meshmash_viewer.io.read import READABLE_ENDINGS, mesh_name, read_mesh
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.units import Voxel

#: Files read in a child process, which takes 0.5 s to start.
GUARDED = (
    "mesh.glb", "mesh.gltf", "mesh.vtp", "mesh.vtu", "mesh.vtk", "mesh.surf.gii", "mesh.h5",
    "mesh.drc",
)  # fmt: skip
#: Endings of `GUARDED`, except .vtk.
IN_A_CHILD = {Path(name).suffix for name in GUARDED} - {".vtk"}


@pytest.mark.parametrize(
    "name", slow_unless(lambda name: name not in GUARDED or name == "mesh.vtp", WRITERS)
)
def test_every_format_gives_the_same_mesh(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    mesh = read_mesh(path)
    assert same_surface(mesh, VERTICES, FACES)
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int64
    assert mesh.unit == ("mm" if name.startswith(("mesh.surf.gii", "lh.pial")) else "")


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    "name", [name for name in WRITERS if Path(name).suffix + ".gz" in READABLE_ENDINGS]
)
def test_gzipped_files_read_the_same(name: str, tmp_path: Path) -> None:
    plain, packed = tmp_path / name, tmp_path / f"{name}.gz"
    WRITERS[name](plain)
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    mesh = read_mesh(packed)
    assert same_surface(mesh, VERTICES, FACES)
    assert mesh.name == mesh_name(plain)


@pytest.mark.usefixtures("read_here")
def test_a_fragment_packed_by_draco_needs_no_ending(tmp_path: Path) -> None:
    path = tmp_path / "91:0:0-512_0-512_0-512"
    path.write_bytes(draco_bytes())
    assert same_surface(read_mesh(path), VERTICES, FACES)
    path.write_bytes(draco_bytes()[:-20])
    with raises("file-cut-short"):
        read_mesh(path)


@pytest.mark.usefixtures("read_here")
def test_meshparty_files_packed_by_draco_with_masks_and_link_edges(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "mesh.h5"
    with h5py.File(path, "w") as file:
        file["draco"] = np.void(draco_bytes())
        file["link_edges"] = [[0, 3]]
        file["node_mask"] = np.arange(6) > 1
    with pytest.warns(MeshWarning, match="holds 1 link edge, which no surface has, left out"):
        mesh = read_mesh(path)
    assert same_surface(mesh, VERTICES, FACES)
    assert mesh.maps[0].name == "node_mask"
    assert mesh.maps[0].values.tolist() == [0, 0, 1, 1, 1, 1]
    write_meshparty(path)
    with h5py.File(path, "a") as file:
        file["node_mask"] = np.ones(9, dtype=bool)
    with pytest.warns(MeshWarning, match="node mask of other vertices"):
        assert read_mesh(path).maps == ()


@pytest.mark.usefixtures("read_here")
def test_a_mesh_in_a_group_of_an_hdf5_file_is_read_if_it_is_the_only_one(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "mesh.h5"
    for number, group in enumerate(("meshes/first", "second")):
        with h5py.File(path, "a") as file:
            file[f"{group}/vertices"], file[f"{group}/faces"] = VERTICES, FACES
        if not number:
            assert same_surface(read_mesh(path), VERTICES, FACES)
    with raises("ambiguous-content"):
        read_mesh(path)


@pytest.mark.parametrize("stamp", ["by me\n\n", "by me\non Friday\n\n", "by me\n", "a\nb\nc\n\n"])
def test_the_text_before_a_freesurfer_surface_has_any_number_of_lines(
    stamp: str, tmp_path: Path
) -> None:
    write_freesurfer(path := tmp_path / "lh.pial")
    content = path.read_bytes()
    start = len(content) - 12 * (len(VERTICES) + len(FACES)) - 8
    path.write_bytes(content[:3] + stamp.encode() + content[start:])
    assert same_surface(read_mesh(path), VERTICES, FACES)


def test_text_of_freesurfer_that_is_cut_short_or_has_values_is_said(tmp_path: Path) -> None:
    write_freesurfer_text(path := tmp_path / "lh.pial.asc")
    path.write_text(path.read_text()[:-3])
    with raises("counts-differ"):
        read_mesh(path)
    path = tmp_path / "lh.thickness.asc"
    rows = [f"{at:03d} {x} {y} {z} {at}.5" for at, (x, y, z) in enumerate(VERTICES.tolist())]
    path.write_text("\n".join(rows))
    (found,) = read_maps(path, (VERTICES, FACES))
    assert (found.unit, found.values.tolist()) == ("mm", [at + 0.5 for at in range(len(VERTICES))])
    assert is_map_file(path)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("content", "code"),
    [
        ({}, "missing-data"),
        ({"vertices": np.ones((4, 2)), "faces": FACES}, "wrong-shape"),
        ({"vertices": VERTICES, "faces": FACES + 0.5}, "not-whole-numbers"),
        ({"vertices": VERTICES, "faces": FACES + 9}, "vertex-out-of-range"),
    ],
)
def test_broken_meshparty_files(content: dict[str, np.ndarray], code: str, tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "mesh.h5"
    with h5py.File(path, "w") as file:
        for name, values in content.items():
            file[name] = values
    with raises(code):
        read_mesh(path)
    path.write_bytes(path.read_bytes()[:100])
    with raises("file-cut-short"):
        read_mesh(path)


@pytest.mark.parametrize(
    ("unit", "voxel", "carried"),
    [
        ("nm", (1.0, 1.0, 1.0), "nm"),
        ("8 nm", (8.0, 8.0, 8.0), "nm"),
        ("none", (1.0, 1.0, 1.0), ""),
        ("0.5 um", (0.5, 0.5, 0.5), "µm"),
        ("4 x 4 x 40 nm", (4.0, 4.0, 40.0), "nm"),
    ],
)
def test_unit_multiplies_voxels_and_is_carried(
    unit: str, voxel: Voxel, carried: str, tmp_path: Path
) -> None:
    write_obj(tmp_path / "mesh.obj")
    mesh = read_mesh(tmp_path / "mesh.obj", unit=unit)
    assert (mesh.unit, mesh.voxel) == (carried, voxel)
    np.testing.assert_allclose(mesh.vertices, VERTICES * voxel)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("name", ["mesh.surf.gii", "lh.pial"])
@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, "mm"), (0.04, "m"), (0.24, "m"), (0.26, "mm"), (1e-3, "mm")]
)
def test_a_brain_in_metres_is_known_by_its_size(
    name: str, factor: float, unit: str, tmp_path: Path
) -> None:
    from nibabel.freesurfer import write_geometry
    from nibabel.gifti import GiftiDataArray, GiftiImage

    path, vertices = tmp_path / name, (factor * VERTICES).astype(np.float32)  # 4 * factor long
    if name.endswith(".gii"):
        arrays = [
            GiftiDataArray(vertices, intent="NIFTI_INTENT_POINTSET"),
            GiftiDataArray(FACES.astype(np.int32), intent="NIFTI_INTENT_TRIANGLE"),
        ]
        path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
    else:
        write_geometry(str(path), vertices, FACES, create_stamp="")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = read_mesh(path)
    assert mesh.unit == unit
    np.testing.assert_array_equal(mesh.vertices, vertices)
    said = [str(each.message) for each in caught]
    assert len(said) == (unit == "m")
    if said:
        assert said[0].startswith(f"{path} has an extent of {4 * factor:.3g}, too small")
        assert "--unit mm" in said[0]
    with warnings.catch_warnings(action="error"):
        assert read_mesh(path, unit="mm").unit == "mm"


@pytest.mark.usefixtures("read_here")
def test_a_small_surface_of_our_own_is_in_mm(tmp_path: Path) -> None:
    path = tmp_path / "neuron.surf.gii"
    write_mesh(path, Mesh(1e4 * VERTICES, FACES, unit="nm"))
    with warnings.catch_warnings(action="error"):
        mesh = read_mesh(path)
    assert mesh.unit == "mm"
    np.testing.assert_allclose(mesh.vertices, 0.01 * VERTICES, rtol=1e-6)


def test_obj_is_not_split_at_texture_seams(tmp_path: Path) -> None:
    # A square whose diagonal is a seam: four vertices, six texture coordinates.
    path = tmp_path / "seam.obj"
    path.write_text(
        "mtllib none.mtl\no square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
        + "".join(f"vt {i / 6} 0\n" for i in range(6))
        + "vn 0 0 1\nusemtl none\ns off\nf 1/1/1 2/2/1 3/3/1\nf 1/4 3/5 4/6\n"
    )
    mesh = read_mesh(path)
    assert mesh.n_vertices == 4
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_obj_polygons_negative_indices_and_continued_lines(tmp_path: Path) -> None:
    path = tmp_path / "odd.obj"
    path.write_bytes(
        b"# a square and a pentagon\r\n  v 0 0 0 1\r\nv 1 0 0 # corner\r\nv 1 1 0 .5 .5 .5\r\n"
        b"v 0 1 0\r\nf -4//1 -3//1 \\ \t\r\n -2//1 -1//1\r\nv 0.5 2 0\r\nf 1 2 3 5 4\r\nl 1 2\r\n"
    )
    mesh = read_mesh(path)
    assert mesh.n_vertices == 5
    assert mesh.faces[:2].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.face_areas[:2].sum() == pytest.approx(1.0)
    assert (mesh.n_faces, mesh.face_areas[2:].sum()) == (5, pytest.approx(1.5))


@pytest.mark.usefixtures("read_here")
def test_vtk_strips_polygons_and_grids(tmp_path: Path) -> None:
    points = "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET {kind}\nPOINTS 5 float\n"
    points += "0 0 0 1 0 0 1 1 0 0 1 0 0.5 2 0\n"
    path = tmp_path / "mesh.vtk"
    path.write_text(
        points.format(kind="POLYDATA")
        + "POLYGONS 2 9\n3 0 1 2\n4 0 2 4 3\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\n"
    )
    wanted = [[0, 1, 2], [0, 2, 3], [2, 4, 3], [0, 1, 3], [3, 1, 2]]
    assert read_mesh(path).faces.tolist() == wanted
    path.write_text(
        points.format(kind="UNSTRUCTURED_GRID")
        + "CELLS 2 9\n3 0 1 2\n4 0 2 4 3\nCELL_TYPES 2\n5\n9\n"
    )
    assert read_mesh(path).n_faces == 3


def test_a_vtk_xml_grid_has_the_vertices_of_the_file_and_its_maps(tmp_path: Path) -> None:
    import pyvista

    unused = np.vstack([[[9.0, 9.0, 9.0]], VERTICES])
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: FACES[::-1] + 1}, unused)
    grid["height"] = unused[:, 2]
    grid.save(tmp_path / "mesh.vtu")
    mesh = read_mesh(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(mesh.vertices, unused)
    assert sorted(map(sorted, mesh.faces.tolist())) == sorted(map(sorted, (FACES + 1).tolist()))
    (height,) = mesh.maps
    np.testing.assert_array_equal(height.values, unused[:, 2])


def test_ply_coordinates_may_be_in_capitals(tmp_path: Path) -> None:
    write_text_ply(tmp_path / "mesh.ply")
    text = re.sub(
        r"float ([xyz])\n", lambda found: found[0].upper(), (tmp_path / "mesh.ply").read_text()
    )
    (tmp_path / "mesh.ply").write_text(text.replace("FLOAT", "float"))
    assert "float X\n" in (tmp_path / "mesh.ply").read_text()
    np.testing.assert_array_equal(read_mesh(tmp_path / "mesh.ply").vertices, VERTICES)


def test_ply_polygons_of_differing_length_and_strips(tmp_path: Path) -> None:
    header = (
        "ply\nformat {kind} 1.0\nelement vertex 5\nproperty double x\nproperty double y\n"
        "property double z\nelement {name} {count}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]], dtype="<f8")
    polygons = [[0, 1, 2], [0, 2, 4, 3]]
    body = b"".join(struct.pack(f"<B{len(p)}i", len(p), *p) for p in polygons)
    path = tmp_path / "mixed.ply"
    head = header.format(kind="binary_little_endian", name="face", count=2)
    path.write_bytes(head.encode() + points.tobytes() + body)
    assert read_mesh(path).faces.tolist() == [[0, 1, 2], [0, 2, 3], [2, 4, 3]]

    text = "".join(f"{x} {y} {z}\n" for x, y, z in points) + "8 0 1 3 2 -1 2 4 3\n"
    head = header.format(kind="ascii", name="tristrips", count=1)
    path.write_text(head + text)
    assert read_mesh(path).faces.tolist() == [[0, 1, 3], [3, 1, 2], [2, 4, 3]]


@pytest.mark.usefixtures("read_here")
def test_scene_is_placed_by_its_transforms(tmp_path: Path) -> None:
    import trimesh

    scene = trimesh.Scene()
    box = trimesh.Trimesh(VERTICES, FACES, process=False)
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([10, 0, 0]))
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([0, 20, 0]))
    scene.export(tmp_path / "scene.glb")
    mesh = read_mesh(tmp_path / "scene.glb")
    assert (mesh.n_vertices, mesh.n_faces) == (12, 16)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [12, 21, 1])
    np.testing.assert_allclose(mesh.vertices.min(axis=0), [-2, -1, -1])


@pytest.mark.parametrize(
    ("name", "shown"),
    [("a.obj", "a"), ("a.b.PLY.gz", "a.b"), ("lh.pial", "lh.pial"), ("lh.pial.gz", "lh.pial")],
)
def test_name_is_the_stem(name: str, shown: str) -> None:
    assert mesh_name(name) == shown


@pytest.mark.parametrize(
    "name",
    ["lh.pial.T1", "lh.white.preaparc", "lh.sphere.reg", "lh.graymid", "rh.pial_semi_inflated"],
)
@pytest.mark.parametrize("packed", [False, True])
def test_freesurfer_surfaces_are_known_by_how_they_begin(
    name: str, packed: bool, tmp_path: Path
) -> None:
    path = tmp_path / name
    write_freesurfer(path)
    if packed:
        path = tmp_path / f"{name}.gz"
        path.write_bytes(gzip.compress((tmp_path / name).read_bytes()))
    mesh = read_mesh(path)
    assert same_surface(mesh, VERTICES, FACES)
    assert (mesh.name, mesh.unit) == (name, "mm")


@pytest.mark.parametrize("magic", [b"\xff\xff\xff", b"\xff\xff\xfd"])
def test_freesurfer_quadrangles(magic: bytes, tmp_path: Path) -> None:
    # A square gives two triangles, whichever diagonal divides it.
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    places = (100 * square).astype(">i2") if magic[2] == 255 else square.astype(">f4")
    corners = bytes([0, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0, 3])
    path = tmp_path / "lh.odd"
    path.write_bytes(magic + bytes([0, 0, 4, 0, 0, 1]) + places.tobytes() + corners)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, square)
    assert mesh.n_faces == 2
    assert mesh.area == pytest.approx(1.0)
    path.write_bytes(path.read_bytes()[:-3])
    assert fault_of(path).code == "file-cut-short"


def test_numbers_on_a_freesurfer_surface_are_no_surface(tmp_path: Path) -> None:
    path = tmp_path / "lh.thickness"
    path.write_bytes(b"\xff\xff\xff" + struct.pack(">iii5f", 5, 6, 1, 1, 2, 3, 4, 5))
    assert fault_of(path).code == "no-faces"


# Bad input: one sentence names the file, the fault and the remedy.


def fault_of(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.startswith(str(path))
    assert sentence.endswith(".")
    assert len(sentence) < 400 + len(str(path))
    return caught.value


@pytest.mark.parametrize(
    "ending", slow_unless(lambda ending: ending not in IN_A_CHILD, READABLE_ENDINGS)
)
def test_noise_a_letter_and_nothing(
    ending: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], recwarn: object
) -> None:
    path, noise = tmp_path / f"noise{ending}", np.random.default_rng(7).bytes(200_000)
    for content in (noise, b"Dear colleague,\nplease find the mesh attached.\n", b""):
        path.write_bytes(content)
        assert (fault_of(path).code == "file-empty") == (content == b"")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", slow_unless(lambda name: name not in GUARDED, WRITERS))
def test_every_truncation(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    whole = path.read_bytes()
    for share in (0.1, 0.5, 0.7, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        # OBJ states no counts, so a file that is cut after a line is valid, with fewer faces.
        if name == "mesh.obj" and share > 0.5:
            continue
        fault_of(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("content", "code", "place"),
    [
        (
            "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n",
            "not-finite",
            "1 vertex with a coordinate that is not finite, in line 3",
        ),
        (
            "v 0 0 0\nv 1 0 0\nf 1 2 3\nv 0 1 0\nf 1 2 7\nf 9 1 2\n",
            "vertex-out-of-range",
            "vertex 7 of 3, in line 5",
        ),
        ("hello\n", "no-vertices", ""),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n# no\nf 0 1 2\n", "vertex-out-of-range", "in line 5"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf -4 1 2\n", "vertex-out-of-range", "in line 5"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no-faces", ""),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\nf 1 2\n", "no-faces", ""),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 1 2\n", "no-faces", ""),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "wrong-shape", "in line 2"),
        ("v 0 0 0\nv \nv 0 1 0\nf 1 2 3\n", "wrong-shape", "in line 2"),
        ("v 0 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf \n", "wrong-shape", "in line 5"),
        (
            "v 0 0 0\nvn 1 1 x\nv 1 0 zero\nv 0 1 0\nf 1 2 3\n",
            "not-a-number",
            "'zero' where a number should be, in line 3",
        ),
        (
            "v 0 \\\n0 \\\r\n0\nv 1 0 0\nv 0 1 0\nf 1 \\\n2 3.5\n",
            "not-a-number",
            "'3.5' where a whole number should be, in line 6",
        ),
    ],
)
def test_faulty_obj(content: str, code: str, place: str, tmp_path: Path) -> None:
    path = tmp_path / "faulty.obj"
    path.write_text(content)
    fault = fault_of(path)
    assert fault.code == code
    assert f"{fault.fault}.".endswith(f"{place}.")


@pytest.mark.parametrize("name", ["mesh.vtp", "mesh.vtk"])
@pytest.mark.parametrize(
    ("signal", "message"),
    [
        (11, "the library that reads it crashes"),
        pytest.param(
            9,
            "or too little memory is free",
            marks=pytest.mark.skipif(os.name == "nt", reason="has no signals"),
        ),
    ],
)
def test_a_reader_that_ends_its_process(
    name: str, signal: int, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # VTK ends its process on some broken files: by a segmentation fault, or for lack of memory.
    monkeypatch.setattr("meshmash_viewer.work._CHILD", f"import os; os.kill(os.getpid(), {signal})")
    write_vtk(tmp_path / name)
    fault = fault_of(tmp_path / name)
    assert (fault.code, message in fault.fault) == ("process-crashed", True)


def test_no_triangle_left_after_merging(tmp_path: Path) -> None:
    path = tmp_path / "needle.stl"
    body = struct.pack("<3f9fH", 0, 0, 0, 1, 2, 3, 1, 2, 3, 4, 5, 6, 0)
    path.write_bytes(bytes(80) + struct.pack("<I", 1) + body)
    assert fault_of(path).code == "no-faces"
    path.write_bytes(bytes(80) + struct.pack("<I", 0))
    assert fault_of(path).code == "no-vertices"


def test_npz_of_other_things(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", features=np.zeros(3))
    assert fault_of(tmp_path / "other.npz").code == "missing-data"
    np.savez(tmp_path / "objects.npz", vertices=np.array([None]), faces=FACES)
    assert fault_of(tmp_path / "objects.npz").code == "wrong-type"


NAMES = [
    *(("verts", "faces"), ("points", "triangles"), ("V", "F"), ("v", "f"), ("X", "T")),
    *(("coord", "tri"), ("VERT", "TRIV"), ("Vertices", "Faces"), ("pos", "face"), ("rr", "tris")),
    *(("pts", "elements"), ("V", "T"), ("Coords", "F")),
]


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("transposed", [False, True])
def test_npz_arrays_of_other_names_and_orders(
    names: tuple[str, str], transposed: bool, tmp_path: Path
) -> None:
    path, height = tmp_path / "a.npz", VERTICES[:, 2]
    arrays = [np.asfortranarray(VERTICES).astype(">f4"), FACES.astype(float)]
    arrays = [each.T if transposed else each for each in arrays]
    if names == ("pos", "face"):
        arrays[1] = FACES.astype(float).T  # always transposed, as in PyTorch Geometric
    np.savez(path, height=height, **dict(zip(names, arrays, strict=True)))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert [each.name for each in mesh.maps] == ["height"]
    assert not is_map_file(path)
    assert [each.name for each in read_maps(path, mesh)] == ["height"]
    np.savez(path, pos=VERTICES, face=FACES[:3].T)
    np.testing.assert_array_equal(read_mesh(path).faces, FACES[:3])


@pytest.mark.usefixtures("read_here")
def test_npz_arrays_with_one_of_the_names_of_a_mesh_are_maps(tmp_path: Path) -> None:
    path, values = tmp_path / "a.npz", VERTICES[:, 2]
    for names in (("f", "height"), ("X", "depth"), ("v", "T"), ("vertices", "f")):
        np.savez(path, **dict.fromkeys(names, values))
        assert is_map_file(path)
        found = {each.name for each in read_maps(path, (VERTICES, FACES))}
        assert found == set(names) - {"vertices"}
    np.savez(path, F=FACES, V=VERTICES, f=values)
    assert [each.name for each in read_mesh(path).maps] == ["f"]


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("columns", [["a", "b"], ["a"], None])
def test_only_features_have_the_names_of_columns(columns: list[str] | None, tmp_path: Path) -> None:
    two = {name: np.ones((len(VERTICES), 2)) for name in ("features", "other")}
    np.savez(tmp_path / "a.npz", **two, **({} if columns is None else {"columns": columns}))
    named = columns if columns == ["a", "b"] else ["features 0", "features 1"]
    found = [each.name for each in read_maps(tmp_path / "a.npz", (VERTICES, FACES))]
    assert found == [*named, "other 0", "other 1"]


@pytest.mark.usefixtures("read_here")
def test_columns_of_an_npz_beyond_the_limit_are_said(tmp_path: Path) -> None:
    path, mesh = tmp_path / "a.npz", {"vertices": VERTICES, "faces": FACES}
    np.savez(path, wide=np.zeros((len(VERTICES), 65)), height=VERTICES[:, 2], **mesh)
    with pytest.warns(MeshWarning, match="has an array wide of 65 columns, of which 64 can be"):
        assert [each.name for each in read_mesh(path).maps] == ["height"]
    np.savez(path, **{f"f{at}": VERTICES[:, 2] for at in range(66)}, **mesh)
    with pytest.warns(MeshWarning, match="has 2 of 66 columns of numbers beyond the limit"):
        assert len(read_mesh(path).maps) == 64


QUADS = np.array([[0, 2, 1, 3], [4, 1, 5, 0]])  # sections in the xy and xz planes


@pytest.mark.parametrize(
    ("faces", "triangles"),
    [
        (np.column_stack([np.full(len(FACES), 3), FACES]), FACES),
        (np.column_stack([np.full(len(FACES), 3), FACES]).ravel(), FACES),
        (np.column_stack([np.full(len(FACES), 3), FACES]).astype(np.int32).ravel(), FACES),
        (np.column_stack([np.full(len(FACES), 3), FACES]).astype(np.uint8), FACES),
        ([[3, 0, 2, 4]], [[0, 2, 3], [2, 4, 3]]),  # one quadrilateral, not a triangle
        ([3, 0, 2, 4], [[0, 2, 4]]),
        ([4, 0, 2, 1, 3, 3, 0, 2, 4], [[0, 2, 3], [2, 1, 3], [0, 2, 4]]),
    ],
)
def test_npz_faces_as_pyvista_has_them(faces: object, triangles: object, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", vertices=VERTICES, faces=faces)
    mesh = read_mesh(tmp_path / "a.npz")
    assert same_surface(mesh, VERTICES, np.asarray(triangles))


def test_npz_quadrilaterals_with_and_without_their_number(tmp_path: Path) -> None:
    for faces in (QUADS, np.column_stack([np.full(2, 4), QUADS]), np.roll(QUADS, 1, axis=1)):
        np.savez(tmp_path / "a.npz", vertices=VERTICES, faces=faces)
        mesh = read_mesh(tmp_path / "a.npz")
        assert (mesh.n_faces, mesh.area) == (4, pytest.approx(8.0))


@pytest.mark.parametrize(
    ("faces", "code"),
    [
        ([[3, 0, 2, 4], [3, 4, 1, 5]], "ambiguous-content"),
        ([0, 1, 2, 0, 2, 3], "wrong-format"),
        ([3, 0, 2, 4, 3, 0, 2], "file-cut-short"),
        ([[0, 1]], "wrong-shape"),
        ([[0.0, 2.0, 4.5]], "not-whole-numbers"),
        ([[0.0, 2.0, np.nan]], "not-whole-numbers"),
    ],
)
def test_npz_faces_that_are_none(faces: object, code: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", vertices=VERTICES, faces=np.array(faces))
    with raises(code):
        read_mesh(tmp_path / "a.npz")


def test_missing_folder_and_unknown_ending(tmp_path: Path) -> None:
    assert fault_of(tmp_path / "absent.ply").code == "file-not-found"
    folder = tmp_path / "folder.ply"
    folder.mkdir()
    assert fault_of(folder).code == "not-a-file"
    (tmp_path / "notes.docx").write_text("x")
    assert fault_of(tmp_path / "notes.docx").code == "unknown-ending"
    (tmp_path / "bare").write_text("x")
    assert fault_of(tmp_path / "bare").code == "unknown-ending"


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs the permissions of POSIX")
def test_no_permission(tmp_path: Path) -> None:
    path = tmp_path / "secret.obj"
    write_obj(path)
    path.chmod(0)
    if os.geteuid() != 0:
        assert fault_of(path).code == "no-permission"
        return
    os.seteuid(65534)  # root may read all files; user 65534 (nobody) may not
    try:
        assert fault_of(path).code == "no-permission"
    finally:
        os.seteuid(0)


# Files that declare more data than they contain --------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("long.ply", f"ply\nformat ascii 1.0\nelement vertex {900 * '9'}\n"),
        ("long.vtk", f"# vtk DataFile Version 3.0\na\nASCII\n{900 * 'a'} {900 * '9'}\n"),
        slow(
            "long.vtp", f'<VTKFile type="PolyData"><a NumberOfComponents{900 * "a"}="{900 * "9"}"/>'
        ),
    ],
)
def test_a_sentence_is_short_however_much_a_file_says(
    name: str, content: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(content + "property float x\nend_header\n")
    assert len(str(fault_of(path)).removeprefix(str(tmp_path))) < 300


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        (
            "far.gii",
            '<GIFTI Version="1.0"><DataArray Dimensionality="99999999999"/></GIFTI>',
            "wrong-format",
        ),
        (
            "far.vtp",
            '<VTKFile type="PolyData"><DataArray NumberOfComponents="4294967295"/></VTKFile>',
            "file-cut-short",
        ),
        (
            "far.vtk",
            "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 99999999 float\n0 0 0",
            "file-cut-short",
        ),
        ("far.gltf", '{"buffers": [{"uri": "absent.bin"}]}', "file-not-found"),
        ("deep.gltf", "[" * 100_000, "wrong-format"),
        ("far.off", "OFF\n1e300 1e300 0\n0 0 0\n", "counts-differ"),
        ("odd.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 x\n3 0 1 2\n", "not-a-number"),
        ("odd.off", "OFF\r\n3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 x\r\n", "not-a-number"),
        ("odd.off", "OFF\r3 1 0\r0 0 0\r1 0 0\r0 1 x\r3 0 1 2\r", "not-a-number"),
        ("binary.off", "OFF BINARY\n3 1 0\n", "not-supported"),
        (
            "far.gii",
            f'<GIFTI Version="1.0"><DataArray Dimensionality="1" Dim0="{9 * "9"}9999"/></GIFTI>',
            "no-faces",
        ),
        (
            "far.ply",
            f"ply\nformat ascii 1.0\nelement vertex {10**15}\nproperty float x\n"
            "property float y\nproperty float z\nend_header\n0 0 0\n",
            "file-cut-short",
        ),
        ("short.stl", "abc", "file-cut-short"),
        (
            "odd.stl",
            "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex\nvertex 0 1 0\n"
            "endloop\nendfacet\nendsolid\n",
            "wrong-shape",
        ),
        slow(
            "empty.vtk", "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\n", "no-vertices"
        ),
    ],
)
def test_promises_are_not_believed(name: str, content: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    assert fault_of(path).code == code


def test_an_npz_array_larger_than_its_member(tmp_path: Path) -> None:
    import zipfile

    path = tmp_path / "far.npz"
    np.savez(path, vertices=VERTICES, faces=FACES)
    with zipfile.ZipFile(path) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    held["vertices.npy"] = held["vertices.npy"].replace(b"(6, 3), }   ", b"(60000, 3), }")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in held.items():
            archive.writestr(name, content)
    assert fault_of(path).code == "file-damaged"


def test_names_in_archives_bring_no_lines_into_a_sentence(tmp_path: Path) -> None:
    import zipfile

    path = tmp_path / "odd.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("two\nlines \x1b[31m.npy", b"")
    assert "\x1b" not in str(fault_of(path))


def test_gzip_that_unpacks_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    monkeypatch.setenv("MESHMASH_READ_LIMITS", "0.01")
    path = tmp_path / "bomb.obj.gz"
    path.write_bytes(gzip.compress(bytes(20_000_000)))
    assert fault_of(path).code == "beyond-limits"
    assert fault_of(path).code == "beyond-limits"
    path.write_bytes(gzip.compress(b""))
    assert fault_of(path).code == "file-empty"
    assert not list(scratch.iterdir())


@pytest.mark.parametrize("limits", [slow("1"), "0.1"])
def test_gifti_arrays_that_unpack_to_much(
    limits: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nibabel.gifti import GiftiDataArray, GiftiImage

    zeros = np.zeros((6_000_000, 3), dtype=np.float32)  # 72 MB, compressed to 70 kB
    arrays = [
        GiftiDataArray(zeros, intent="NIFTI_INTENT_NONE"),
        GiftiDataArray(VERTICES.astype(np.float32), intent="NIFTI_INTENT_POINTSET"),
        GiftiDataArray(FACES.astype(np.int32), intent="NIFTI_INTENT_TRIANGLE"),
    ]
    path = tmp_path / "mesh.gii"
    path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
    monkeypatch.setenv("MESHMASH_READ_LIMITS", limits)
    if limits == "1":
        assert same_surface(read_mesh(path), VERTICES, FACES)
    else:
        assert fault_of(path).code == "beyond-limits"


@pytest.mark.skipif(os.name != "posix", reason="needs a program that computes for ever")
@pytest.mark.parametrize(
    ("code", "clause"),
    [
        ("while True: pass", "takes longer than"),
        (
            "x = bytearray(300_000_000)\nx[::4096] = b'1' * len(x[::4096])\nwhile True: pass",
            "memory",
        ),
    ],
)
def test_a_reader_without_end_is_stopped(
    code: str, clause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("meshmash_viewer.work._CHILD", code)
    monkeypatch.setenv("MESHMASH_READ_LIMITS", "0.1")
    write_vtk(tmp_path / "mesh.vtk")
    sentence = str(fault_of(tmp_path / "mesh.vtk"))
    assert clause in sentence
    assert "MESHMASH_READ_LIMITS" in sentence


def test_limits_that_are_no_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMASH_READ_LIMITS", "plenty")
    write_obj(tmp_path / "mesh.obj")
    with raises("out-of-range"):
        read_mesh(tmp_path / "mesh.obj")


def test_one_stray_coordinate_does_not_join_all_vertices(tmp_path: Path) -> None:
    corners = np.random.default_rng(0).random((3000, 3, 3)).astype(np.float32)
    corners[0, 0, 0] = 1e38
    body = b"".join(struct.pack("<3f9fH", 0, 0, 0, *tri.reshape(-1), 0) for tri in corners)
    path = tmp_path / "stray.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + body)
    assert fault_of(path).code == "beyond-floating-point"


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"glTF\x02\0\0\0", "wrong-format"),
        (b"GLTF" + bytes(16), "wrong-format"),
        (b"glTF\x02\0\0\0\x14\0\0\0\x02\0\0\0BIN\0{}", "wrong-format"),
    ],
)
def test_a_binary_scene_that_is_none(content: bytes, code: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    path.write_bytes(content)
    assert fault_of(path).code == code


def test_a_scene_that_lies_about_its_length_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    text = b'{"asset": {"version": "2.0"}}'
    path.write_bytes(struct.pack("<4sIIII", b"glTF", 2, 49, 0xFFFFFF00, 0x4E4F534A) + text)
    tracemalloc.start()
    with raises("no-faces"):
        read_mesh(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1e8

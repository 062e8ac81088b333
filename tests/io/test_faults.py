"""Error messages for broken files: the fault, its count, its location and the remedy."""

from __future__ import annotations

import gzip
import math
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io import raw
from meshmash_viewer.io.formats import vtk
from meshmash_viewer.io.formats.npz import npz_limits
from meshmash_viewer.io.formats.vtk import read_legacy_vtk
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.io.raw import LimitExceeded, ReadLimits, ReadWatch, convert, read_guarded
from meshmash_viewer.io.read import read_mesh

VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3]])


def saved(folder: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    path = folder / "mesh.npz"
    np.savez(path, vertices=vertices, faces=faces)
    return path


def test_coordinates_that_are_not_finite_are_counted_by_vertex(tmp_path: Path) -> None:
    vertices = VERTICES.copy()
    vertices[2] = [np.nan, np.inf, 0.0]
    with raises("not-finite"):
        read_mesh(saved(tmp_path, vertices, FACES))
    vertices[3, 1] = -np.inf
    with raises("not-finite"):
        read_mesh(saved(tmp_path, vertices, FACES))


def test_some_faces_without_three_corners_are_read_but_not_only_such(tmp_path: Path) -> None:
    faces = FACES.copy()
    faces[1] = [1, 1, 3]
    np.testing.assert_array_equal(read_mesh(saved(tmp_path, VERTICES, faces)).faces, faces)
    with raises("no-faces"):
        read_mesh(saved(tmp_path, VERTICES, np.array([[0, 0, 1], [2, 1, 2], [3, 1, 1]])))


@pytest.mark.usefixtures("read_here")
def test_a_gifti_surface_of_other_dimensions(tmp_path: Path) -> None:
    from nibabel.gifti import GiftiDataArray, GiftiImage

    points, triangles = VERTICES.astype(np.float32), FACES.astype(np.int32)
    path = tmp_path / "mesh.surf.gii"
    for kept, corners in (
        (points[:, :2], triangles),
        (points, triangles[:, :2]),
        (points[:, 0], triangles),
        (points, triangles[:, 0]),
    ):
        arrays = [
            GiftiDataArray(np.ascontiguousarray(kept), intent="NIFTI_INTENT_POINTSET"),
            GiftiDataArray(np.ascontiguousarray(corners), intent="NIFTI_INTENT_TRIANGLE"),
        ]
        path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
        with raises("wrong-shape"):
            read_mesh(path)


PLY = b"ply\nformat ascii 1.0\nend_header\n"


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("mesh.stl", PLY, "is a PLY file by its content: change its ending to .ply."),
        ("mesh.dat", PLY, "is a PLY file by its content: change its ending to .ply."),
        ("mesh", b"\xef\xbb\xbfOFF\n3 1 0\n", "is an OFF file by its content: change its ending"),
        ("mesh.obj", b"solid a\n facet normal 0 0 1\n", "is an STL file by its content"),
        ("mesh.gltf", b"glTF\2\0\0\0", "is a binary glTF file by its content: change its ending"),
        (
            "mesh.vtk",
            b'<?xml version="1.0"?>\n<VTKFile type="PolyData">',
            "change its ending to .vtp",
        ),
        ("mesh.vtk", b'<VTKFile type="UnstructuredGrid">', "change its ending to .vtu"),
        ("mesh.vtp", b"# vtk DataFile Version 3.0\n", "change its ending to .vtk"),
        ("mesh.vtp", b'<?xml version="1.0"?>\n<!DOCTYPE GIFTI>\n<GIFTI>', "ending to .gii"),
        ("mesh.ply", b"\x1f\x8b\x08", "is a gzip file by its content: add .gz to its name."),
        ("mesh.mat", b"MATLAB 5.0 MAT-file, Platform", "is a MATLAB file: write its vertices, and"),
        ("a.niml.dset", b"<AFNI_dataset", "is a dataset of AFNI: write it as GIFTI, with Convert"),
        (
            "a.1D.dset.gz",
            b"1 2",
            "is a dataset of AFNI: write it as GIFTI, with ConvertDset -o_gii",
        ),
        ("a.mz3", b"MZ\3\0\0\5\0\0", "is a file of Surf Ice (MZ3): save it there as PLY, OBJ or"),
        (
            "a.mz3",
            gzip.compress(b"MZ\x0b\0\0\5", mtime=0),
            "is a file of Surf Ice (MZ3): save it there as",
        ),
        ("info", b'{"data_type": "uint64", "mesh"', "is a part of a layer of Neuroglancer: open"),
        ("a.json", b'{"fragments": ["1:0:0"]}', "is a part of a layer of Neuroglancer: open"),
        ("a.json", b' {"vertices": [[0, 1, 2]', "is a JSON file: write the arrays in it as NPZ."),
        ("a.json", b'{"asset": {"version": "2.0"}', "is a glTF file by its content: change its"),
        ("mid.obj", b"P 0.3 0.3 0.4 10 1 642\n -2", "is an object file of MNI and CIVET: convert"),
        (
            "mid.obj.gz",
            gzip.compress(b"P 0 0 1. 1e1 1 42\n", mtime=0),
            "with obj_mni2wf of the Python pack",
        ),
        (
            "mesh.obj.gz",
            gzip.compress(PLY, mtime=0),
            "is a PLY file by its content: change its ending to .p",
        ),
        ("mesh.ply", b"<!DOCTYPE html><html>", "is a web page: download the file"),
        ("mesh.ply", b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
        ("mesh.3mf", b"PK\3\4" + bytes(40), "is a ZIP archive: unpack it, or"),
        ("mesh.h5", b"PAR1", "is a Parquet table by its content: change its ending to .parquet."),
    ],
)
def test_a_file_whose_ending_is_wrong_is_named(
    name: str, content: bytes, said: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with raises("wrong-ending", f"{path} ", said):
        read_mesh(path)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("packed", ["", ".gz"])
def test_images_of_volumes_and_of_surfaces_have_their_own_remedies(
    packed: str, tmp_path: Path
) -> None:
    import nibabel
    from nibabel.cifti2.cifti2_axes import BrainModelAxis, ScalarAxis

    zeros = np.zeros((4, 4, 4), dtype=np.float32)
    axes = ScalarAxis(["a"]), BrainModelAxis.from_mask(np.ones(6), name="CortexLeft")
    images = {
        "one.nii": nibabel.Nifti1Image(zeros, np.eye(4)),
        "two.nii": nibabel.Nifti2Image(zeros, np.eye(4)),
        "a.dscalar.nii": nibabel.Cifti2Image(np.zeros((1, 6)), axes),
    }
    for name, image in images.items():
        said = "a CIFTI file: write" if "dsc" in name else "a NIfTI volume: sample"
        image.to_filename(tmp_path / name)
        path = (tmp_path / name).rename(tmp_path / f"{name}{packed}")
        if packed:
            path.write_bytes(gzip.compress(path.read_bytes()))
        for read in (read_mesh, lambda path: read_maps(path, (VERTICES, FACES))):
            with raises("wrong-ending", said):
                read(path)


@pytest.mark.usefixtures("read_here")
def test_a_file_of_maps_whose_ending_is_wrong_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "height.npy", VERTICES[:, 2])
    for name in ("height.csv", "lh.annot", "height.dat"):
        path = (tmp_path / "height.npy").rename(tmp_path / name)
        with raises("wrong-ending"):
            read_maps(path, (VERTICES, FACES))
        path.rename(tmp_path / "height.npy")
    assert len(read_maps(tmp_path / "height.npy", (VERTICES, FACES))) == 1


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1,5 0\nf 1 2 3\n"),
        ("mesh.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1,5 0\n3 0 1 2\n"),
    ],
)
def test_a_decimal_comma_is_named(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with raises("not-a-number"):
        read_mesh(tmp_path / name)
    (tmp_path / name).write_text(content.replace("1,5", "1.5"))
    assert read_mesh(tmp_path / name).area == 0.75


def test_a_reader_without_memory_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faults: list[Exception] = [KeyError("normals"), InputError("holds no vertices"), MemoryError()]

    def fails(path: Path) -> None:
        raise faults.pop()

    monkeypatch.setattr(vtk, "read_legacy_vtk", fails)
    for said in ("^$", "holds no vertices", "is not readable"):
        with pytest.raises(MemoryError if said == "^$" else InputError, match=said):
            convert(f"{vtk.__name__}:read_legacy_vtk", Path("mesh.vtk"), math.inf)
    # `read_guarded` reads in a child process, which is made to kill itself here.
    monkeypatch.setattr("meshmash_viewer.work._CHILD", "import os; os.kill(os.getpid(), 9)")
    with raises("process-crashed"):
        read_guarded(read_legacy_vtk, saved(tmp_path, VERTICES, FACES))


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("ending", ["vtp", "vtk"])
def test_a_vtk_file_with_nothing_in_it(ending: str, tmp_path: Path) -> None:
    import pyvista

    path = tmp_path / f"nothing.{ending}"
    pyvista.PolyData().save(path)
    with raises("no-vertices"):
        read_mesh(path)


@pytest.mark.parametrize("value", ["nan", "inf", "1e400"])
def test_a_coordinate_of_a_text_stl_that_is_not_finite(value: str, tmp_path: Path) -> None:
    path = tmp_path / "mesh.stl"
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    good = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    bad = f"vertex 0 0 0\nvertex 1 0 {value}\nvertex 0 1 1\n"
    path.write_text(f"solid a\n{facet.format(good)}{facet.format(bad)}endsolid a\n")
    with raises("not-finite"):
        read_mesh(path)


@pytest.mark.parametrize(("n_vertices", "n_faces"), [(-1, 2), (4, -2), (-5, -5), (5, 3), (4, 4)])
def test_a_freesurfer_surface_has_as_many_bytes_as_it_says(
    n_vertices: int, n_faces: int, tmp_path: Path
) -> None:
    path = tmp_path / "lh.pial"
    beginning = b"\xff\xff\xfecreated by nobody\n\n"
    numbers = VERTICES.astype(">f4").tobytes() + FACES.astype(">i4").tobytes()
    path.write_bytes(beginning + struct.pack(">ii", 4, 3) + numbers)
    np.testing.assert_array_equal(read_mesh(path).faces, FACES)
    path.write_bytes(beginning + struct.pack(">ii", n_vertices, n_faces) + numbers)
    with raises("file-cut-short", f"promises {n_vertices} vertices and {n_faces} faces"):
        read_mesh(path)
    for shorter in (beginning, beginning + b"\0\0\0\4", beginning + b"\0\0\0\4\0\0\0"):
        path.write_bytes(shorter)
        with raises("file-cut-short"):
            read_mesh(path)


@pytest.mark.usefixtures("read_here")
def test_a_gifti_surface_may_keep_its_numbers_beside_it_if_they_are_all_there(
    tmp_path: Path,
) -> None:
    def array(intent: str, kind: str, rows: int, offset: int) -> str:
        return (
            f'<DataArray Intent="NIFTI_INTENT_{intent}" DataType="NIFTI_TYPE_{kind}" '
            f'ArrayIndexingOrder="RowMajorOrder" Dimensionality="2" Dim0="{rows}" Dim1="3" '
            'Encoding="ExternalFileBinary" Endian="LittleEndian" '
            f'ExternalFileName="numbers.bin" ExternalFileOffset="{offset}">'
            "<Data></Data></DataArray>"
        )

    path, beside = tmp_path / "mesh.surf.gii", tmp_path / "numbers.bin"
    content = VERTICES.astype("<f4").tobytes() + FACES.astype("<i4").tobytes()
    beside.write_bytes(content)
    for last in (48, 49):
        parts = array("POINTSET", "FLOAT32", 4, 0) + array("TRIANGLE", "INT32", 3, last)
        path.write_text(
            f'<?xml version="1.0"?><GIFTI Version="1.0" NumberOfDataArrays="2">{parts}</GIFTI>'
        )
        if last == 48:
            mesh = read_mesh(path)
            np.testing.assert_array_equal(mesh.vertices, VERTICES)
            np.testing.assert_array_equal(mesh.faces, FACES)
        else:
            with raises("not-readable"):
                read_mesh(path)


def test_limits_grow_with_the_file_and_with_what_it_may_honestly_unpack_to() -> None:
    least, one, ten = (ReadLimits.of(n_bytes) for n_bytes in (0, 10**7, 10**8))
    for name in ("seconds", "memory"):
        base, small, large = (getattr(each, name) for each in (least, one, ten))
        assert 0.0 < base < small
        assert large - base == pytest.approx(10.0 * (small - base))
    assert least.memory > 5e8, "which the interpreter and its libraries need"
    # Limits grow with the unpacked size between 5 and 1000 times the size of the file.
    assert ReadLimits.of(10**7, unpacked=10**7) == one
    assert ReadLimits.of(10**7, unpacked=5 * 10**7) == one
    assert ReadLimits.of(10**7, unpacked=10**8).memory == ReadLimits.of(2 * 10**7).memory
    assert ReadLimits.of(10**7, unpacked=10**12) == ReadLimits.of(10**7, unpacked=10**10)


def test_an_archive_is_read_under_the_limits_of_what_it_unpacks_to(tmp_path: Path) -> None:
    path = tmp_path / "packed.npz"
    np.savez_compressed(path, vertices=np.zeros((600_000, 3)), faces=FACES, more=np.ones(10**6))
    n_bytes, unpacked = path.stat().st_size, 128 + 600_000 * 24 + 128 + FACES.nbytes
    assert npz_limits(path) == ReadLimits.of(n_bytes, unpacked=unpacked) != ReadLimits.of(n_bytes)


def test_text_out_of_a_file_is_one_short_line() -> None:
    assert printable("a\nb\tc\x07") == "a b c\N{REPLACEMENT CHARACTER}"
    for length in (120, 121, 500):
        said = printable("x" * length)
        assert len(said) == 120
        assert said.endswith("…") == (length > 120)


def test_a_small_file_may_unpack_to_a_little_and_a_large_one_to_its_own_size() -> None:
    """Only files that unpack to more than these sizes need a process with limits."""
    assert ReadLimits.if_needed(1000, 10**6) is None
    assert ReadLimits.if_needed(10**9, 2 * 10**9) is None
    assert ReadLimits.if_needed(1000, 10**9) is not None
    assert ReadLimits.if_needed(10**9, 10**11) is not None


def test_a_starved_reader_goes_on_and_a_blocked_one_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A reader with 0.4 % of a processor is slow; one without any for a minute is blocked."""
    now, computed = 0.0, 0.0
    monkeypatch.setattr(raw, "time", SimpleNamespace(monotonic=lambda: now))
    tree = SimpleNamespace(measured=lambda: (computed, 0.0))
    watch = ReadWatch(ReadLimits(8.0, 1e9))
    for _ in range(1000):
        now, computed = now + 1.0, computed + 0.004
        watch(tree)
    now += 30.0
    watch(tree)
    now += 61.0
    with pytest.raises(LimitExceeded, match="takes too long to read"):
        watch(tree)
    computed = 8.1
    with pytest.raises(LimitExceeded, match="takes longer than 8 seconds"):
        watch(tree)

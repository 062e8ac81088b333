"""Parcellations with label tables of any size, and surface values in arrays of any shape."""

from __future__ import annotations

import gzip
import struct
import warnings
from pathlib import Path

import nibabel
import numpy as np
import pytest
import shapes
from faults import raises
from nibabel.gifti import GiftiDataArray, GiftiImage, GiftiLabel, GiftiLabelTable

from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.io.maps import maps_and_remarks, read_maps
from meshmash_viewer.io.raw import RawMap
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.vertex_map import MOST_LABELS, Label, VertexMap

MESH = shapes.icosphere(3)
N = MESH.n_vertices
POINTS, TRIANGLES = "NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"


pytestmark = pytest.mark.usefixtures("read_here")


def table(keys: np.ndarray) -> tuple[Label, ...]:
    return tuple(
        Label(key, f"part {key}", f"#{(key * 7919 + 1) % 2**24:06x}") for key in keys.tolist()
    )


#: Keys of a label table, and the key of each vertex.
TABLES = {
    "361 of which all": (np.arange(361), np.arange(N) % 361),
    "1,266 with gaps": (np.arange(1266) * 11 + 3, (np.arange(N) % 35) * 11 + 3),
    "some have none": (np.arange(300), np.where(np.arange(N) < 40, 7, 2000)),
    "as many as can be": (np.arange(MOST_LABELS), np.arange(N) % MOST_LABELS),
}


def gifti(path: Path, arrays: list[tuple[str, np.ndarray]], labels: tuple[Label, ...]) -> None:
    image = GiftiImage()
    image.labeltable = GiftiLabelTable()
    for each in labels:
        rgb = [int(each.color[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
        entry = GiftiLabel(each.key, *rgb, 1.0)
        entry.label = each.name
        image.labeltable.labels.append(entry)
    for intent, values in arrays:
        image.add_gifti_data_array(GiftiDataArray(values, intent=intent))
    path.write_bytes(image.to_bytes())


def annotation(path: Path, labels: tuple[Label, ...], values: np.ndarray, numbered: bool) -> None:
    """Write an annotation as FreeSurfer's documentation describes the format."""
    colors = {each.key: [int(each.color[at : at + 2], 16) for at in (1, 3, 5)] for each in labels}
    packed = [r + (g << 8) + (b << 16) for r, g, b in (colors.get(v, (1, 1, 9)) for v in values)]
    pairs = np.column_stack([np.arange(len(values)), packed])[::-1]  # in arbitrary order
    parts = [np.array([len(values)], ">i4").tobytes(), pairs.astype(">i4").tobytes()]
    last = max(each.key for each in labels) + 1
    parts.append(struct.pack(">iii", 1, -2, last) if numbered else struct.pack(">ii", 1, last))
    parts.append(struct.pack(">i4s", 4, b"lut\0"))
    if numbered:
        parts.append(struct.pack(">i", len(labels)))
    for each in labels:
        name = each.name.encode() + b"\0"
        parts.append(struct.pack(">i", each.key) if numbered else b"")
        parts.append(struct.pack(f">i{len(name)}s4i", len(name), name, *colors[each.key], 0))
    path.write_bytes(b"".join(parts))


@pytest.mark.parametrize("kind", ["label.gii", "surf.gii", "annot", "old annot", "library"])
@pytest.mark.parametrize("name", TABLES)
def test_labels_in_use_are_known(name: str, kind: str, tmp_path: Path) -> None:
    keys, values = TABLES[name]
    labels = table(keys)
    path = tmp_path / f"lh.parts.{kind.split()[-1]}"
    if kind == "library":
        found = RawMap("parts", values, labels).checked(N)
    elif kind == "label.gii":
        gifti(path, [("NIFTI_INTENT_LABEL", values.astype(np.int32))], labels)
        (found,), _ = maps_and_remarks(path, MESH)
    elif kind == "surf.gii":
        surface = [(POINTS, MESH.vertices.astype("f4")), (TRIANGLES, MESH.faces.astype("i4"))]
        gifti(path, [*surface, ("NIFTI_INTENT_LABEL", values.astype(np.int32))], labels)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)  # of labels without a row
            (found,) = read_mesh(path).maps
    else:
        if kind == "old annot":  # has labels numbered 0, 1, 2, …
            if not np.array_equal(keys, np.arange(len(keys))):
                pytest.skip("has no such table")
            labels = tuple(sorted(labels, key=lambda each: each.key))
        annotation(path, labels, values, numbered=kind == "annot")
        (found,), _ = maps_and_remarks(path, MESH)
    known = np.isin(values, keys)
    packed = 1 + (1 << 8) + (9 << 16)  # colour of an annotation without a row
    expected = np.where(known, values, packed if "annot" in kind else values)
    used = set(values.tolist())
    more = [str(key) for key in np.unique(expected[~known])]
    assert found.labels[: len(found.labels) - len(more)] == tuple(
        each for each in labels if each.key in used
    )
    assert [each.name for each in found.labels if each.name.isdigit()] == more
    assert [found.labels[place].key for place in found.shown.astype(int)] == expected.tolist()


@pytest.mark.parametrize("ending", ["label.gii", "annot", "csv"])
def test_keys_without_a_row_are_labels_named_by_number(ending: str, tmp_path: Path) -> None:
    path, labels = tmp_path / f"lh.parts.{ending}", (Label(3, "front", "#112233"),)
    numbers = np.repeat([-1, 0, 3, 7], [10, 10, 20, N - 40])
    if ending == "csv":
        names = {3: "front"}
        rows = [f"{number},{names.get(number, '')}" for number in numbers.tolist()]
        path.write_text("label,name\n" + "\n".join(rows))
    elif ending == "annot":
        annotation(path, labels, numbers, numbered=True)
        content = path.read_bytes()  # the packed colour of 7 is 7, that of -1 and 0 is 0
        pairs = np.frombuffer(content, ">i4", 2 * N, 4).reshape(N, 2).copy()
        pairs[:, 1] = np.where(numbers[::-1] == 3, pairs[:, 1], np.maximum(numbers[::-1], 0))
        path.write_bytes(content[:4] + pairs.tobytes() + content[4 + pairs.nbytes :])
    else:
        gifti(path, [("NIFTI_INTENT_LABEL", numbers.astype(np.int32))], labels)
    with pytest.warns(MeshWarning, match=r"without a row in its table, named by number: 7\.$"):
        (found,) = read_maps(path, MESH)
    assert [(each.key, each.name) for each in found.labels] == [(3, "front"), (7, "7")]
    np.testing.assert_array_equal(np.isfinite(found.shown), numbers > 0)


@pytest.mark.parametrize("ending", ["label.gii", "surf.gii"])
def test_a_label_array_without_a_table_has_its_numbers_as_names(
    ending: str, tmp_path: Path
) -> None:
    path, numbers = tmp_path / f"lh.parts.{ending}", np.arange(N) % 3
    array = ("NIFTI_INTENT_LABEL", numbers.astype(np.int32))
    surface = [(POINTS, MESH.vertices.astype("f4")), (TRIANGLES, MESH.faces.astype("i4"))]
    gifti(path, [*(surface if ending == "surf.gii" else ()), array], ())
    (found,) = read_maps(path, MESH)
    assert [(each.key, each.name) for each in found.labels] == [(1, "1"), (2, "2")]
    assert len({each.color for each in found.labels}) == 2
    np.testing.assert_array_equal(np.isfinite(found.shown), numbers > 0)
    assert found.path == str(path)
    numbers = np.arange(N) % (MOST_LABELS + 2)
    gifti(path, [("NIFTI_INTENT_LABEL", numbers.astype(np.int32))], ())
    (found,) = read_maps(path, MESH)
    assert not found.labels, "more than can be distinguished are numbers"
    np.testing.assert_array_equal(found.values, numbers)


@pytest.mark.parametrize("tag", [b"", struct.pack(">i", 0)])
def test_an_annotation_without_a_table_has_its_numbers_as_names(tag: bytes, tmp_path: Path) -> None:
    path, numbers = tmp_path / "lh.parts.annot", np.arange(N) % 3 * 65793 - 1
    pairs = np.column_stack([np.arange(N), numbers])[::-1]
    path.write_bytes(struct.pack(">i", N) + pairs.astype(">i4").tobytes() + tag)
    (found,) = read_maps(path, MESH)
    assert [(each.key, each.name) for each in found.labels] == [
        (65792, "65792"),
        (131585, "131585"),
    ]
    np.testing.assert_array_equal(np.isfinite(found.shown), numbers > 0)
    np.testing.assert_array_equal(found.values, np.maximum(numbers, 0))


def test_more_labels_in_use_than_colors_are_refused() -> None:
    values = np.arange(N) % (MOST_LABELS + 1)
    with raises("too-many", "513 labels", "512"):
        RawMap("parts", values, table(np.arange(2000))).checked(N)
    with raises("no-labels"):
        RawMap("parts", -1 - values, table(np.arange(2000))).checked(N)


def test_labels_may_wait_for_their_vertices() -> None:
    labels = table(np.arange(1, 4))
    found = VertexMap("parts", np.zeros(N), labels)
    assert found.labels == labels
    assert np.isnan(found.shown).all()
    assert (found.n_values, found.signed, found.range) == (0, False, (0.0, 0.0))
    assert not found.mask("part 2").any()
    assert found.at(np.arange(N) < 5).labels == labels


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (struct.pack(">5i", 2, 0, 0, 1, 0), "no-labels"),
        (struct.pack(">6i", 2, 0, -1, 1, 0, 0), "no-labels"),
        (struct.pack(">7i", 2, 0, 1, 1, 2, 1, -3), "wrong-version"),
        (struct.pack(">9i", 2, 0, 1, 1, 2, 1, -2, 9, 400), "file-cut-short"),
        (struct.pack(">5i", 2, 0, 1, 0, 2), "counts-differ"),
        (struct.pack(">5i", 2, 0, 1, 7, 2), "counts-differ"),
        (struct.pack(">i", -5), "file-cut-short"),
        (struct.pack(">i", 2**31 - 1), "file-cut-short"),
    ],
)
def test_broken_annotations_are_one_sentence(content: bytes, code: str, tmp_path: Path) -> None:
    (tmp_path / "lh.aparc.annot").write_bytes(content)
    with raises(code):
        read_maps(tmp_path / "lh.aparc.annot", MESH)


@pytest.mark.parametrize(
    ("shape", "packed"),
    [((642, 1, 1), False), ((1, 6, 107), True), ((3, 2, 107), False), ((642, 1, 1, 3), True),
     ((1, 1, 1, 642), False), ((107, 1, 6, 2), True)],
)  # fmt: skip
def test_values_may_be_folded_in_any_shape(
    shape: tuple[int, ...], packed: bool, tmp_path: Path
) -> None:
    count = int(np.prod(shape)) // N
    values = np.random.default_rng(0).normal(size=(count, N)).astype(np.float32)
    path = tmp_path / ("lh.area.mgz" if packed else "lh.area.mgh")
    # in the file, the first axis runs fastest and the frames follow each other
    nibabel.save(nibabel.MGHImage(values.ravel().reshape(shape, order="F"), np.eye(4)), path)
    found = read_maps(path, MESH)
    np.testing.assert_array_equal([each.values for each in found], values)
    assert {each.unit for each in found} == {"mm²"}


@pytest.mark.parametrize("shape", [(4, 5, 6), (2, 321, 2), (642, 2, 1), (256, 1, 256)])
def test_a_volume_is_one_sentence(shape: tuple[int, ...], tmp_path: Path) -> None:
    image = nibabel.MGHImage(np.ones(shape, np.float32), np.eye(4))
    nibabel.save(image, tmp_path / "brain.mgz")
    with raises("wrong-shape"):
        read_maps(tmp_path / "brain.mgz", MESH)


@pytest.mark.parametrize(("points", "triangles"), [(2, 2), (2, 1), (1, 2), (3, 3)])
def test_many_surfaces_in_a_file_are_one_sentence(
    points: int, triangles: int, tmp_path: Path
) -> None:
    arrays = [(POINTS, MESH.vertices.astype("f4"))] * points
    arrays += [(TRIANGLES, MESH.faces.astype("i4"))] * triangles
    gifti(tmp_path / "both.surf.gii", arrays, ())
    with raises("ambiguous-content", f"{points} point sets and {triangles} sets of triangles"):
        read_mesh(tmp_path / "both.surf.gii")


@pytest.mark.parametrize("name", ["lh.cortex.patch.flat", "rh.patch.3d", "lh.flat.gz", "patch"])
@pytest.mark.parametrize("count", [0, 1, 30])
def test_a_patch_is_one_sentence(name: str, count: int, tmp_path: Path) -> None:
    rows = np.zeros(count, dtype=[("vertex", ">i4"), ("place", ">f4", 3)])
    content = struct.pack(">ii", -1, count) + rows.tobytes()
    path = tmp_path / name
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    with raises("no-faces"):
        read_mesh(path)
    if not name.endswith(".gz"):
        with raises("no-values"):
            read_maps(path, MESH)

"""Reading of glTF files: arrays, faces, transforms and extensions."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import shapes
from faults import raises

from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.io.formats.gltf import read_gltf
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import Mesh

Array = npt.NDArray[Any]
COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
#: An asymmetric tetrahedron with integer coordinates, outward faces and volume 40.
VERTICES = np.array([[0, 0, 0], [6, 0, 0], [0, 5, 0], [0, 0, 8]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
VOLUME = 40.0
AREA = 15.0 + 24.0 + 20.0 + 0.5 * float(np.linalg.norm(np.cross([-6, 5, 0], [-6, 0, 8])))


class Scene:
    """Builder of a glTF scene, array by array."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0}
        for name in ("accessors", "bufferViews", "meshes", "nodes"):
            self.json[name] = []
        self.json["scenes"] = [{"nodes": []}]

    def view(self, data: bytes, **more: object) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more}
        )
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def array(self, values: Array, dtype: str = "f4", *, stride: int = 0, **more: object) -> int:
        values = np.asarray(values).reshape(len(values), -1).astype("<" + dtype)
        entry = {"componentType": COMPONENTS[dtype], "count": len(values)}
        entry["type"] = WIDTHS[values.shape[1]]
        if stride:
            rows = np.zeros((len(values), stride), np.uint8)
            rows[:, 4 : 4 + values[0].nbytes] = values.view(np.uint8)
            entry["bufferView"] = self.view(rows.tobytes(), byteStride=stride)
            entry["byteOffset"] = 4
        else:
            entry["bufferView"] = self.view(values.tobytes())
        self.json["accessors"].append({**entry, **more})
        return len(self.json["accessors"]) - 1

    def mesh(self, *primitives: dict[str, Any], **more: object) -> int:
        self.json["meshes"].append({"primitives": list(primitives), **more})
        return len(self.json["meshes"]) - 1

    def tetrahedron(self) -> int:
        return self.mesh(self.primitive())

    def primitive(self, vertices: Array = VERTICES, faces: Array = FACES, **more: Any) -> Any:
        attributes = {"POSITION": self.array(vertices), **more}
        return {"attributes": attributes, "indices": self.array(faces.reshape(-1, 1), "u2")}

    def node(self, *, root: bool = True, **entry: object) -> int:
        self.json["nodes"].append(entry)
        index = len(self.json["nodes"]) - 1
        if root:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def write(self, path: Path) -> Path:
        data = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffer = {"byteLength": len(self.data)}
        if path.suffix == ".gltf":
            path.write_text(json.dumps({**self.json, "buffers": [{**buffer, "uri": data}]}))
            return path
        text = json.dumps({**self.json, "buffers": [buffer]}).encode()
        path.write_bytes(glb((b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", self.data)))
        return path


def glb(*chunks: tuple[bytes, bytes | bytearray]) -> bytes:
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def read(scene: Scene, tmp_path: Path, ending: str = ".gltf") -> Mesh:
    raw = read_gltf(scene.write(tmp_path / f"scene{ending}"))
    return Mesh(raw.vertices, raw.faces)


def remarks(scene: Scene, tmp_path: Path) -> tuple[str, ...]:
    return read_gltf(scene.write(tmp_path / "scene.gltf")).remarks


def is_tetrahedron(mesh: Mesh, count: int = 1, scale: float = 1.0) -> None:
    assert (mesh.n_vertices, mesh.n_faces) == (4 * count, 4 * count)
    assert mesh.area == pytest.approx(count * AREA * scale**2, rel=1e-6)
    assert shapes.signed_volume(mesh) == pytest.approx(count * VOLUME * scale**3, rel=1e-6)


# -- arrays ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stride", "ending"), [(0, ".gltf"), (16, ".glb"), (20, ".gltf")])
@pytest.mark.parametrize("normalized", [False, True])
@pytest.mark.parametrize("dtype", COMPONENTS)
def test_positions_of_every_type(dtype, normalized, stride, ending, tmp_path: Path) -> None:
    scene = Scene()
    largest = float(np.iinfo(dtype).max) if normalized and dtype != "f4" else 1.0
    position = scene.array(VERTICES, dtype, stride=stride, normalized=normalized)
    indices = scene.array(FACES.reshape(-1, 1), "u1")
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": position}, "indices": indices}))
    is_tetrahedron(read(scene, tmp_path, ending), scale=1.0 / largest)


def test_the_lowest_signed_number_is_minus_one(tmp_path: Path) -> None:
    scene = Scene()
    for dtype in ("i1", "i2"):
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
        corners = np.array([[low, low + 1, 0], [high, 0, 0], [0, high, low]])
        position = scene.array(corners, dtype, stride=12, normalized=True)
        scene.node(mesh=scene.mesh({"attributes": {"POSITION": position}}))
    mesh = read(scene, tmp_path)
    expected = [[-1, -1, 0], [1, 0, 0], [0, 1, -1]] * 2
    np.testing.assert_array_equal(mesh.vertices, expected)


@pytest.mark.parametrize(("kind", "base"), [("u1", True), ("u2", False), ("u4", True)])
@pytest.mark.parametrize(("dtype", "normalized"), [("f4", False), ("i2", True), ("u1", False)])
@pytest.mark.parametrize("offset", [0, 8])
def test_sparse_positions(kind, base, dtype, normalized, offset, tmp_path: Path) -> None:
    """Sparse values replace rows of the base array, or rows of zeros without a base array."""
    scene = Scene()
    rows = np.arange(1, 4)
    indices = scene.view(bytes(offset) + rows.astype("<" + kind).tobytes())
    values = scene.view(bytes(offset) + VERTICES[rows].astype("<" + dtype).tobytes())
    position = scene.array(VERTICES * (3 if dtype == "f4" else 1), dtype, normalized=normalized)
    entry = scene.json["accessors"][position]
    if not base:
        del entry["bufferView"]
    entry["sparse"] = {
        "count": 3,
        "indices": {
            "bufferView": indices,
            "byteOffset": offset,
            "componentType": COMPONENTS[kind],
        },
        "values": {"bufferView": values, "byteOffset": offset},
    }
    faces = scene.array(FACES.reshape(-1, 1), "u2")
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": position}, "indices": faces}))
    is_tetrahedron(read(scene, tmp_path), scale=1.0 / 32767 if normalized else 1.0)


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", None])
def test_indices_of_every_type_and_none(dtype: str | None, tmp_path: Path) -> None:
    scene = Scene()
    primitive: dict[str, Any] = {
        "attributes": {"POSITION": scene.array(VERTICES[FACES].reshape(-1, 3))}
    }
    if dtype:
        primitive = {
            "attributes": {"POSITION": scene.array(VERTICES)},
            "indices": scene.array(FACES.reshape(-1, 1), dtype),
        }
    scene.node(mesh=scene.mesh(primitive))
    is_tetrahedron(read(scene, tmp_path))


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"count": 99}, "file-cut-short"),
        ({"byteOffset": 40}, "file-cut-short"),
        ({"count": -1}, "not-whole-numbers"),
        ({"count": 2.5}, "not-whole-numbers"),
        ({"componentType": 5555}, "wrong-type"),
        ({"type": "VEC9"}, "wrong-type"),
        ({"type": "VEC4", "count": 3}, "wrong-shape"),
        ({"bufferView": 77}, "missing-data"),
        ({"bufferView": -1}, "missing-data"),
    ],
)
def test_an_array_that_is_not_in_its_buffer(change, code: str, tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    scene.json["accessors"][0].update(change)
    with raises(code):
        read(scene, tmp_path)


# -- faces -------------------------------------------------------------------------------------


def grid(rows: int, columns: int) -> Array:
    """Return the corners of unit squares in a plane, shape (rows, columns, 3)."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    return np.stack([x, y, 0.0 * x], axis=-1)


@pytest.mark.parametrize("count", [3, 4, 5, 8, 21])
def test_a_strip_looks_one_way(count: int, tmp_path: Path) -> None:
    scene = Scene()
    points = grid(-(-count // 2), 2).reshape(-1, 3)[:count] * [1, -1, 1]
    scene.node(mesh=scene.mesh({"attributes": {"POSITION": scene.array(points)}, "mode": 5}))
    mesh = read(scene, tmp_path)
    assert mesh.n_faces == count - 2
    np.testing.assert_allclose(mesh.vertex_normals, [[0, 0, -1]] * count)
    assert mesh.area == pytest.approx((count - 2) / 2)


@pytest.mark.parametrize("count", [3, 4, 7, 12])
@pytest.mark.parametrize("indexed", [False, True])
def test_a_fan_is_a_regular_polygon(count: int, indexed: bool, tmp_path: Path) -> None:
    scene = Scene()
    angles = 2.0 * np.pi * np.arange(count) / count
    points = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    primitive = {"attributes": {"POSITION": scene.array(points)}, "mode": 6}
    if indexed:
        primitive["indices"] = scene.array(np.roll(np.arange(count), 2), "u1")
    scene.node(mesh=scene.mesh(primitive))
    mesh = read(scene, tmp_path)
    assert mesh.n_faces == count - 2
    assert mesh.area == pytest.approx(0.5 * count * np.sin(2.0 * np.pi / count))
    np.testing.assert_allclose(mesh.vertex_normals, [[0, 0, 1]] * count)


def test_primitives_of_a_mesh_are_joined_at_their_seams(tmp_path: Path) -> None:
    """Two primitives of one mesh become one surface; two meshes stay separate."""
    ball = shapes.icosphere(2)
    halves = ball.faces[:160], ball.faces[160:]
    scene = Scene()
    scene.node(mesh=scene.mesh(*(scene.primitive(ball.vertices, half) for half in halves)))
    mesh = read(scene, tmp_path)
    assert (mesh.n_components, len(mesh.unreferenced)) == (1, 0)
    assert mesh.n_vertices == ball.n_vertices
    scene = Scene()
    for half in halves:
        scene.node(mesh=scene.mesh(scene.primitive(ball.vertices, half)))
    assert read(scene, tmp_path).n_components == 2


# -- buffers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("a%20mesh.bin", "a mesh.bin"),
        ("f%C3%BCnf%23.bin", "fünf#.bin"),
        ("parts/a.bin", "parts/a.bin"),
        ("./parts/a%2Bb.bin", "parts/a+b.bin"),
        ("parts\\a.bin", "parts/a.bin"),
        ("a mesh.bin", "a mesh.bin"),
        ("100%25.bin", "100%.bin"),
        ("100%.bin", "100%.bin"),
    ],
)
def test_names_of_files(uri: str, name: str, tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    (tmp_path / "parts").mkdir()
    (tmp_path / name).write_bytes(scene.data)
    buffers = [{"uri": uri, "byteLength": len(scene.data)}]
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps({**scene.json, "buffers": buffers}))
    raw = read_gltf(path)
    is_tetrahedron(Mesh(raw.vertices, raw.faces))


@pytest.mark.parametrize(
    "head",
    [
        "data:application/octet-stream;base64,",
        "data:application/gltf-buffer;base64,",
        "data:;base64,",
        "DATA:text/plain;charset=utf-8;BASE64,",
        "data:application/octet-stream,",
    ],
)
def test_data_in_the_description(head: str, tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    packed = base64.b64encode(scene.data).decode()
    plain = "".join(f"%{byte:02X}" for byte in scene.data)
    for body in [packed, packed.rstrip("=")] if head.lower().endswith("base64,") else [plain]:
        path = tmp_path / "scene.gltf"
        buffers = [{"uri": head + body, "byteLength": len(scene.data)}]
        path.write_text(json.dumps({**scene.json, "buffers": buffers}), encoding="utf-8-sig")
        raw = read_gltf(path)
        is_tetrahedron(Mesh(raw.vertices, raw.faces))


def test_a_buffer_that_is_cut_short(tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    path = scene.write(tmp_path / "scene.glb")
    path.write_bytes(path.read_bytes()[:-8])
    with raises("file-cut-short"):
        read_gltf(path)


# -- transforms --------------------------------------------------------------------------------

QUARTER = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    "scale", [[1, 1, 1], [2, 3, 4], [-1, 1, 1], [1, -2, 3], [-1, -1, 1], [-1, -2, -3]], ids=str
)
@pytest.mark.parametrize("as_matrix", [False, True])
def test_translation_rotation_and_scale(scale, as_matrix: bool, tmp_path: Path) -> None:
    """Vertices are scaled, then rotated, then translated; faces still point outwards."""
    linear, shift = TURN * scale, np.array([5.0, -7.0, 11.0])
    scene = Scene()
    mesh = scene.tetrahedron()
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    if as_matrix:
        scene.node(mesh=mesh, matrix=matrix.T.ravel().tolist())
    else:
        scene.node(mesh=mesh, scale=scale, rotation=QUARTER, translation=shift.tolist())
    found = read(scene, tmp_path)
    np.testing.assert_allclose(found.vertices, VERTICES @ linear.T + shift, atol=1e-12)
    assert shapes.signed_volume(found) == pytest.approx(VOLUME * abs(np.prod(scale)))


def test_places_add_up_and_a_mesh_is_shared(tmp_path: Path) -> None:
    scene = Scene()
    mesh = scene.tetrahedron()
    low = scene.node(root=False, mesh=mesh, translation=[1, 0, 0])
    middle = scene.node(root=False, mesh=mesh, scale=[2, 2, 2], children=[low])
    scene.node(rotation=QUARTER, translation=[0, 0, 9], children=[middle])
    found = read(scene, tmp_path)
    assert (found.n_vertices, found.n_components) == (8, 2)
    outer = 2.0 * VERTICES @ TURN.T + [0, 0, 9]
    inner = 2.0 * (VERTICES + np.eye(3)[0]) @ TURN.T + [0, 0, 9]
    np.testing.assert_allclose(found.vertices, [*outer, *inner], atol=1e-12)


def test_of_many_scenes_the_default_is_read(tmp_path: Path) -> None:
    scene = Scene()
    first, second = scene.tetrahedron(), scene.tetrahedron()
    scene.node(mesh=first)
    scene.node(root=False, mesh=second, scale=[3, 3, 3])
    scene.json["scenes"].append({"nodes": [1]})
    scene.json["scene"] = 1
    is_tetrahedron(read(scene, tmp_path), scale=3.0)
    (said,) = remarks(scene, tmp_path)
    assert said == "holds 1 mesh that its scene does not show, which is left out"
    del scene.json["scene"]
    is_tetrahedron(read(scene, tmp_path))


@pytest.mark.parametrize("left", [("scene", "scenes"), ("scene", "scenes", "nodes")])
def test_without_scenes_everything_is_shown(left: tuple[str, ...], tmp_path: Path) -> None:
    scene = Scene()
    low = scene.node(root=False, mesh=scene.tetrahedron())
    scene.node(children=[low])
    scene.node(mesh=scene.tetrahedron())
    for name in left:
        del scene.json[name]
    is_tetrahedron(read(scene, tmp_path), count=2)


@pytest.mark.parametrize("children", [[[1], [0]], [[0], []], [[1, 1], []]])
def test_nodes_that_have_no_place(children: list[list[int]], tmp_path: Path) -> None:
    scene = Scene()
    mesh = scene.tetrahedron()
    for at, each in enumerate(children):
        scene.node(root=at == 0, mesh=mesh, children=each)
    with raises("given-twice"):
        read(scene, tmp_path)


def test_what_is_scaled_to_nothing_is_left_out(tmp_path: Path) -> None:
    scene = Scene()
    mesh = scene.tetrahedron()
    scene.node(mesh=mesh)
    scene.node(mesh=mesh, scale=[0, 0, 0])
    is_tetrahedron(read(scene, tmp_path))
    assert "1 mesh scaled to nothing" in " ".join(remarks(scene, tmp_path))


# -- morph targets and skins -------------------------------------------------------------------


@pytest.mark.parametrize("on_node", [False, True])
def test_targets_move_vertices_by_their_weights(on_node: bool, tmp_path: Path) -> None:
    scene = Scene()
    primitive = scene.primitive()
    primitive["targets"] = [{"POSITION": scene.array(VERTICES * each)} for each in (2, 100)]
    weights = {"weights": [0.5, 0.0]}
    mesh = scene.mesh(primitive, **({"weights": [0, 1]} if on_node else weights))
    scene.node(mesh=mesh, **(weights if on_node else {}))
    is_tetrahedron(read(scene, tmp_path), scale=2.0)


def test_a_skin_moves_vertices_by_its_joints(tmp_path: Path) -> None:
    """Each of two joints has about half the weight; the transform of the mesh's node is ignored."""
    scene = Scene()
    joints, weights = np.tile([0, 1, 0, 0], (4, 1)), np.tile([128, 127, 0, 0], (4, 1))
    primitive = scene.primitive(
        JOINTS_0=scene.array(joints, "u1"), WEIGHTS_0=scene.array(weights, "u1", normalized=True)
    )
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[:, :3, 3] = -1.0
    scene.json["skins"] = [
        {"joints": [1, 2], "inverseBindMatrices": scene.array(inverse.transpose(0, 2, 1))}
    ]
    scene.node(mesh=scene.mesh(primitive), skin=0, translation=[1e3, 0, 0])
    scene.node(translation=[1 + 255, 1, 1])
    scene.node(translation=[1, 1, 1])
    found = read(scene, tmp_path)
    np.testing.assert_allclose(found.vertices, VERTICES + 128.0 * np.eye(3)[0], atol=1e-9)
    is_tetrahedron(found)


# -- extensions --------------------------------------------------------------------------------


def instanced(scene: Scene, **attributes: int) -> None:
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    scene.node(mesh=scene.tetrahedron(), scale=[2, 2, 2], extensions=extension)
    scene.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]


@pytest.mark.parametrize("dtype", ["f4", "i1", "i2"])
def test_instances(dtype: str, tmp_path: Path) -> None:
    """Each instance is scaled, rotated and translated, then transformed by its node."""
    scene = Scene()
    shifts = np.array([[0.0, 0, 0], [30, 0, 0], [0, 40, 0]])
    scales = np.array([[1.0, 1, 1], [1, 2, 3], [-1, 1, 1]])
    turns = np.array([[0, 0, 0, 1.0], QUARTER, [0, 0, 1, 0]])
    if dtype == "f4":
        rotation = scene.array(turns)
    else:
        whole = np.round(turns * np.iinfo(dtype).max)
        rotation = scene.array(whole, dtype, normalized=True)
    instanced(scene, TRANSLATION=scene.array(shifts), ROTATION=rotation, SCALE=scene.array(scales))
    found = read(scene, tmp_path)
    assert (found.n_vertices, found.n_faces, found.n_components) == (12, 12, 3)
    matrices = [np.eye(3), TURN, TURN @ TURN]
    for at, (turn, scale, shift) in enumerate(zip(matrices, scales, shifts, strict=True)):
        expected = 2.0 * ((VERTICES * scale) @ turn.T + shift)
        np.testing.assert_allclose(found.vertices[4 * at : 4 * at + 4], expected, atol=1e-6)
    assert shapes.signed_volume(found) == pytest.approx(8.0 * VOLUME * (1 + 6 + 1))


@pytest.mark.parametrize("instances", [{}, {"TRANSLATION": 2, "SCALE": 3}])
def test_instances_that_do_not_fit(instances: dict[str, int], tmp_path: Path) -> None:
    scene = Scene()
    instanced(scene, **instances)
    scene.array(np.zeros((2, 3)))
    scene.array(np.zeros((3, 3)))
    with raises("counts-differ"):
        read(scene, tmp_path)


@pytest.mark.parametrize(
    ("required", "named"),
    [
        (["EXT_meshopt_compression"], "EXT_meshopt_compression, which is not"),
        (["KHR_meshopt_compression", "KHR_mesh_quantization"], "KHR_meshopt_compression, which is"),
        (["VENDOR_a", "VENDOR_b"], "VENDOR_a, VENDOR_b, which are not"),
        (["KHR_materials_unlit", "CESIUM_RTC"], "requires CESIUM_RTC, which"),
    ],
)
def test_what_is_required_and_not_understood_is_named(required, named, tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    scene.json["extensionsRequired"] = required
    path = scene.write(tmp_path / "scene.gltf")
    with raises("not-supported") as said:
        read_mesh(path)
    assert "point cloud" not in str(said.value)


def test_data_that_is_only_packed_is_named(tmp_path: Path) -> None:
    """A compression extension is reported as required if its fallback buffer has no data."""
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    path = tmp_path / "scene.gltf"
    scene.json["extensionsUsed"] = ["EXT_meshopt_compression"]
    for view in scene.json["bufferViews"]:
        view["extensions"] = {"EXT_meshopt_compression": {"buffer": 1}}
    path.write_text(json.dumps({**scene.json, "buffers": [{"byteLength": len(scene.data)}]}))
    with raises("not-supported"):
        read_gltf(path)


def packed_scene(packed: bytes, **attributes: int) -> Scene:
    """Return a scene of a tetrahedron compressed by Draco and an uncompressed one."""
    scene = Scene()
    kinds = {"POSITION": (4, "VEC3"), "_DEPTH": (4, "SCALAR")}
    accessors = scene.json["accessors"]
    for name in attributes:
        count, kind = kinds[name]
        accessors.append({"componentType": 5126, "count": count, "type": kind})
    view = scene.view(packed)
    extension = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": attributes}}
    indices = {name: at for at, name in enumerate(attributes)}
    scene.node(mesh=scene.mesh({"attributes": indices, "extensions": extension}))
    scene.node(mesh=scene.tetrahedron(), translation=[50, 0, 0])
    scene.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    return scene


def test_draco(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy")
    depth = np.array([[1.0], [2.0], [4.0], [8.0]], dtype=np.float32)
    packed = draco.encode(
        VERTICES.astype(np.float32), FACES.astype(np.uint32), quantization_bits=20,
        preserve_order=True, generic_attributes={0: depth},
    )  # fmt: skip
    scene = packed_scene(packed, POSITION=1, _DEPTH=0)
    raw = read_gltf(scene.write(tmp_path / "scene.gltf"))
    mesh = Mesh(raw.vertices, raw.faces)
    assert (mesh.n_vertices, mesh.n_faces, mesh.n_components) == (8, 8, 2)
    assert mesh.area == pytest.approx(2.0 * AREA, rel=1e-4)
    assert shapes.signed_volume(mesh) == pytest.approx(2.0 * VOLUME, rel=1e-4)
    np.testing.assert_array_equal(raw.maps[0].values, [*depth[:, 0], *[np.nan] * 4])


@pytest.mark.parametrize("packed", [b"", b"DRACO\x02\x02" + bytes(200), b"something else"])
def test_draco_that_is_damaged(packed: bytes, tmp_path: Path) -> None:
    pytest.importorskip("DracoPy")
    with raises(
        "missing-data" if packed[:5] == b"DRACO" else "wrong-format",
        "has a mesh packed by KHR_draco_mesh_compression",
    ):
        read(packed_scene(packed, POSITION=0), tmp_path)


def test_draco_is_an_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "DracoPy", None)
    with raises("package-missing"):
        read(packed_scene(b"DRACO", POSITION=0), tmp_path)


# -- content that is left out ------------------------------------------------------------------


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("modes", "said"),
    [
        ([0], ["holds 1 primitive of points, which is left out"]),
        ([1, 2, 3], ["holds 3 primitives of lines, which are left out"]),
        ([0, 1], ["holds 1 primitive of points, which is", "holds 1 primitive of lines, which is"]),
    ],
)
def test_what_is_left_out_is_said(modes: list[int], said: list[str], tmp_path: Path) -> None:
    scene = Scene()
    position = scene.array(VERTICES)
    others = [{"attributes": {"POSITION": position}, "mode": mode} for mode in modes]
    scene.node(mesh=scene.mesh(scene.primitive(), *others))
    found = remarks(scene, tmp_path)
    assert all(each.startswith(start) for each, start in zip(found, said, strict=True))
    with pytest.warns(MeshWarning) as caught:
        read_mesh(tmp_path / "scene.gltf")
    named = [f"{tmp_path / 'scene.gltf'} {each}." for each in found]
    assert [str(each.message) for each in caught] == named


@pytest.mark.parametrize(
    ("modes", "code"),
    [
        ([0, 0], "no-faces"),
        ([1], "no-faces"),
        ([2, 0], "no-faces"),
        ([], "no-faces"),
        ([7], "wrong-format"),
    ],
)
def test_only_points_are_a_point_cloud(modes: list[int], code: str, tmp_path: Path) -> None:
    scene = Scene()
    position = scene.array(VERTICES)
    others = [{"attributes": {"POSITION": position}, "mode": mode} for mode in modes]
    scene.node(mesh=scene.mesh(*others))
    with raises(code) as fault:
        read(scene, tmp_path)
    assert ("point cloud" in str(fault.value)) == (set(modes) == {0})


@pytest.mark.parametrize("version", ["1.0", "3.0"])
def test_another_version_is_named(version: str, tmp_path: Path) -> None:
    scene = Scene()
    scene.node(mesh=scene.tetrahedron())
    scene.json["asset"]["version"] = version
    with raises("wrong-version", f"of version {version}, not 2"):
        read(scene, tmp_path)


def test_an_attribute_of_many_columns_is_as_many_maps(tmp_path: Path) -> None:
    scene = Scene()
    first = scene.primitive(_FLOW=scene.array(VERTICES), _SIZE=scene.array(VERTICES[:, 0], "u1"))
    scene.node(mesh=scene.mesh(first))
    scene.node(mesh=scene.tetrahedron())
    maps = read_gltf(scene.write(tmp_path / "scene.glb")).maps
    assert [each.name for each in maps] == ["FLOW 0", "FLOW 1", "FLOW 2", "SIZE"]
    for each, column in zip(maps, [*VERTICES.T, VERTICES[:, 0]], strict=True):
        np.testing.assert_array_equal(each.values, [*column, *[np.nan] * 4])

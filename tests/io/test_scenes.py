"""Scenes of several meshes, each placed by a transform."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from faults import raises

from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import Mesh

pytestmark = pytest.mark.usefixtures("read_here")

#: An asymmetric tetrahedron with outward faces.
VERTICES = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
#: A cyclic permutation of the axes, which differs from its transpose.
CYCLE = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
MIRROR = np.diag([-1.0, 1, 1])


def volume(mesh: Mesh) -> float:
    """Return the signed volume, negative if faces point inwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.sum(np.cross(a, b) * c)) / 6.0


def write_scene(path: Path, *transforms: npt.NDArray[np.float64]) -> None:
    import trimesh

    scene = trimesh.Scene()
    for transform in transforms:
        scene.add_geometry(trimesh.Trimesh(VERTICES, FACES, process=False), transform=transform)
    path.write_bytes(scene.export(file_type="glb"))


def placement(
    linear: npt.NDArray[np.float64], shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> npt.NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    return matrix


def rows(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the points sorted, for comparisons independent of vertex order."""
    return np.array(sorted(map(tuple, np.round(points + 0.0, 5))))


@pytest.mark.parametrize(
    "linear", [TURN, CYCLE, MIRROR, MIRROR @ CYCLE, 2.0 * TURN, -np.eye(3)], ids=str
)
def test_a_mesh_is_turned_mirrored_and_moved_as_the_scene_says(
    linear: npt.NDArray[np.float64], tmp_path: Path
) -> None:
    shift = (5.0, -7.0, 11.0)
    write_scene(tmp_path / "scene.glb", placement(linear, shift))
    mesh = read_mesh(tmp_path / "scene.glb")
    np.testing.assert_allclose(rows(mesh.vertices), rows(VERTICES @ linear.T + shift), atol=1e-5)
    # Faces point outwards after every transform, also after a reflection.
    assert volume(mesh) == pytest.approx(abs(np.linalg.det(linear)), rel=1e-5)


def test_every_mesh_of_a_scene_has_its_own_corners_and_its_own_place(tmp_path: Path) -> None:
    import trimesh

    box = trimesh.creation.box((1.0, 2.0, 3.0))
    ball = trimesh.creation.icosphere(subdivisions=1, radius=2.0)
    parts = [
        (trimesh.Trimesh(VERTICES, FACES, process=False), placement(np.eye(3))),
        (box, placement(TURN, (10, 0, 0))),
        (ball, placement(MIRROR, (0, 10, 0))),
    ]
    scene = trimesh.Scene()
    for part, place in parts:
        scene.add_geometry(part, transform=place)
    (tmp_path / "scene.glb").write_bytes(scene.export(file_type="glb"))
    mesh = read_mesh(tmp_path / "scene.glb")
    wanted = [part.vertices @ place[:3, :3].T + place[:3, 3] for part, place in parts]
    np.testing.assert_allclose(rows(mesh.vertices), rows(np.concatenate(wanted)), atol=1e-5)
    assert (mesh.n_faces, mesh.n_components) == (4 + 12 + 80, 3)
    assert volume(mesh) == pytest.approx(1.0 + box.volume + ball.volume, rel=1e-5)
    assert mesh.area == pytest.approx(sum(part.area for part, _ in parts), rel=1e-5)


def test_a_corner_that_no_vertex_has_is_named(tmp_path: Path) -> None:
    import json

    import trimesh

    files = trimesh.Trimesh(VERTICES, FACES, process=False).scene().export(file_type="gltf")
    content = json.loads(files["model.gltf"])
    indices = content["meshes"][0]["primitives"][0]["indices"]
    view = content["bufferViews"][content["accessors"][indices]["bufferView"]]
    name = content["buffers"][view["buffer"]]["uri"]
    data = bytearray(files[name])
    numbers = np.frombuffer(data, dtype="<u4", count=12, offset=view.get("byteOffset", 0))
    numbers[5] = 4
    (tmp_path / name).write_bytes(data)
    for other in set(files) - {name, "model.gltf"}:
        (tmp_path / other).write_bytes(files[other])
    (tmp_path / "scene.gltf").write_text(json.dumps(content))
    with raises("vertex-out-of-range"):
        read_mesh(tmp_path / "scene.gltf")

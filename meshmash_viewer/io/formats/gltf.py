"""Reader of glTF and GLB scenes, as one mesh of all triangles with transforms applied."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, no_whole_numbers, printable, wrong_format
from meshmash_viewer.io.formats.draco import draco_content
from meshmash_viewer.io.formats.gltf_file import DRACO, INSTANCING, Entry, GltfFile, scaled
from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.raw import AS_SURFACE, MOST_MAPS, REPAIR, RawMap, RawMesh, ReadLimits
from meshmash_viewer.triangulation import fan_triangles, strip_triangles
from meshmash_viewer.units import counted

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
#: Prefixes of attributes with the joints of a vertex and their weights, four per attribute.
_SKIN = "JOINTS_", "WEIGHTS_"
#: Modes of primitives without triangles.
_NO_TRIANGLES = {0: "of points", 1: "of lines", 2: "of lines", 3: "of lines"}


def read_gltf(path: Path) -> RawMesh:
    """Read all triangle meshes of a scene, with transforms applied, as one mesh.

    The format repeats a vertex wherever its normal, texture coordinate or material changes.
    Coincident vertices of each mesh are therefore joined, before its transforms are applied.
    `InputError` is raised if the file is no glTF, requires an unsupported extension, or its scene
    has no triangle.
    """
    return _Scene(GltfFile(path)).mesh()


def gltf_limits(path: Path) -> ReadLimits:
    """Return the limits for a scene.

    A small file can use one array in a thousand meshes, or one mesh in a thousand nodes.
    """
    size, unpacked = GltfFile(path).sizes
    return ReadLimits.of(size, unpacked=unpacked)


@dataclass(frozen=True, eq=False)
class _Part:
    """Triangles of a primitive, mesh or scene."""

    vertices: FloatArray
    faces: IntArray
    #: Joints and weights, shape (n, 4) each, and columns of other attributes, shape (n, 1) each.
    values: dict[str, npt.NDArray[Any]]


class _Scene:
    """Conversion of the nodes of a scene to a mesh, with counts of the content left out."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._parts: dict[tuple[object, ...], _Part] = {}
        #: Number of items left out, by noun and description, such as ("primitive", "of lines").
        self._left_out: Counter[tuple[str, str]] = Counter()
        self._matrices: dict[int, FloatArray] = {}

    def mesh(self) -> RawMesh:
        """Return all meshes of the scene as one."""
        self._matrices.update(self._nodes())
        nodes = (self._file.entry("nodes", index) for index in self._matrices)
        shown = {node["mesh"] for node in nodes if "mesh" in node}
        placed = [each for each in self._placed() if len(each.faces)]
        unseen = len(self._file.description.get("meshes") or []) - len(shown)
        self._left_out["mesh", "that its scene does not show"] = unseen
        if not placed:
            raise InputError("no-faces", self._nothing(), AS_SURFACE)
        whole = _concatenated(placed)
        # only names of custom attributes begin with an underscore
        maps = [
            RawMap(name[1:], values[:, 0])
            for name, values in whole.values.items()
            if name.startswith("_")
        ]
        beyond = "column", f"of values beyond the first {MOST_MAPS}"
        self._left_out[beyond] = max(len(maps) - MOST_MAPS, 0)
        remarks = tuple(self._remarks())
        return RawMesh(whole.vertices, whole.faces, maps=tuple(maps[:MOST_MAPS]), remarks=remarks)

    def _remarks(self) -> Iterator[str]:
        for (noun, which), count in self._left_out.items():
            if count:
                verb = "is" if count == 1 else "are"
                yield f"holds {counted(count, noun)} {which}, which {verb} left out"

    def _nothing(self) -> str:
        """Return the error message for a scene without triangles."""
        kinds = sorted(which for (_, which), count in self._left_out.items() if count)
        named = " and ".join(which.removeprefix("of ") for which in kinds)
        if kinds == ["of points"]:
            return "holds nothing but points, so it is a point cloud"
        if kinds and set(kinds) <= set(_NO_TRIANGLES.values()):
            return f"holds nothing but {named}, and no triangle"
        remarks = "; it ".join(self._remarks())
        return f"shows no triangle mesh{f': it {remarks}' if remarks else ''}"

    # -- nodes --------------------------------------------------------------------------------

    def _nodes(self) -> Iterator[tuple[int, FloatArray]]:
        """Yield the index and the transform to scene coordinates of each node of the scene."""
        seen: set[object] = set()
        left = [(root, np.eye(4)) for root in reversed(self._roots())]
        while left:
            index, above = left.pop()
            if index in seen:
                raise InputError("given-twice", f"shows its node {printable(index, 20)} twice")
            seen.add(index)
            node = self._file.entry("nodes", index)
            matrix = above @ _matrix(node)
            yield index, matrix
            left += [(child, matrix) for child in reversed(node.get("children") or [])]

    def _roots(self) -> list[Any]:
        """Return the root nodes of the scene; without a scene, all nodes without a parent."""
        description = self._file.description
        nodes = description.setdefault("nodes", [])
        if not nodes:  # a collection of meshes without a scene
            nodes += [{"mesh": at} for at in range(len(description.get("meshes") or []))]
            return list(range(len(nodes)))
        if description.get("scenes"):
            roots = self._file.entry("scenes", description.get("scene", 0)).get("nodes")
            return list(roots or [])
        under = {child for node in nodes for child in node.get("children") or []}
        return [at for at in range(len(nodes)) if at not in under]

    def _placed(self) -> Iterator[_Part]:
        for index, matrix in self._matrices.items():
            node = self._file.entry("nodes", index)
            if "mesh" not in node:
                continue
            mesh = self._file.entry("meshes", node["mesh"])
            part = self._part(node["mesh"], node.get("weights", mesh.get("weights")) or [])
            if "skin" in node and any(name.startswith(_SKIN[0]) for name in part.values):
                yield self._posed(part, node["skin"])
                continue
            instances, values = self._instances(node)
            matrices = matrix @ instances
            sized = np.any(matrices[:, :3, :3] != 0.0, axis=(1, 2))
            self._left_out["mesh", "scaled to nothing"] += int((~sized).sum())
            if sized.any():
                values = {name: each[sized] for name, each in values.items()}
                yield _copies(part, matrices[sized], values)

    def _instances(self, node: Entry) -> tuple[FloatArray, dict[str, npt.NDArray[Any]]]:
        """Return the transforms of instances of a node, shape (k, 4, 4), and columns of values."""
        extension = (node.get("extensions") or {}).get(INSTANCING)
        if not extension:
            return np.eye(4)[None], {}
        arrays = {
            name: self._file.array(index)
            for name, index in (extension.get("attributes") or {}).items()
        }
        if len({len(each) for each in arrays.values()}) != 1:
            raise InputError("counts-differ", f"has attributes of {INSTANCING} of unequal lengths")
        return _placements(arrays), _columns(arrays)

    def _posed(self, part: _Part, index: object) -> _Part:
        """Return a mesh deformed by a skin, with the joints at the transforms of their nodes."""
        skin = self._file.entry("skins", index)
        joints = skin["joints"]
        if any(joint not in self._matrices for joint in joints):
            raise InputError("missing-data", "has a skin whose joints are not in its scene")
        moves = np.array([self._matrices[joint] for joint in joints])
        if "inverseBindMatrices" in skin:
            inverse = self._file.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            moves = moves @ inverse[: len(moves)].transpose(0, 2, 1).astype(np.float64)
        sets = [name.removeprefix(_SKIN[0]) for name in part.values if name.startswith(_SKIN[0])]
        which = np.hstack([part.values[_SKIN[0] + each] for each in sets]).astype(np.int64)
        weights = np.hstack([part.values[_SKIN[1] + each] for each in sets]).astype(np.float64)
        if which.max(initial=0) >= len(moves):
            raise InputError("missing-data", "has a vertex with a joint that its skin lacks")
        blended = np.einsum("nk,nkij->nij", weights, moves[which])
        vertices = np.einsum("nij,nj->ni", blended[:, :3, :3], part.vertices) + blended[:, :3, 3]
        mirrored = np.median(np.linalg.det(blended[:, :3, :3])) < 0.0
        return _Part(vertices, part.faces[:, ::-1] if mirrored else part.faces, part.values)

    # -- meshes -------------------------------------------------------------------------------

    def _part(self, index: object, weights: list[float]) -> _Part:
        """Return a mesh in local coordinates with coincident vertices joined; cached."""
        key = (index, *weights)
        if key not in self._parts:
            primitives = self._file.entry("meshes", index)["primitives"]
            found = [self._primitive(each, weights) for each in primitives]
            whole = _concatenated([each for each in found if each is not None])
            vertices, faces, kept = join_vertices(whole.vertices, whole.faces)
            values = {name: each[kept] for name, each in whole.values.items()}
            self._parts[key] = _Part(vertices, faces, values)
        return self._parts[key]

    def _primitive(self, primitive: Entry, weights: list[float]) -> _Part | None:
        mode = primitive.get("mode", _TRIANGLES)
        attributes = primitive.get("attributes") or {}
        if mode in _NO_TRIANGLES or "POSITION" not in attributes:
            which = _NO_TRIANGLES.get(mode, "without positions")
            self._left_out["primitive", which] += 1
            return None
        wanted = {
            name: index
            for name, index in attributes.items()
            if name == "POSITION" or name.startswith(("_", *_SKIN))
        }
        packed = (primitive.get("extensions") or {}).get(DRACO)
        stored = self._file.entry("accessors", attributes["POSITION"])
        if packed and "bufferView" not in stored and "sparse" not in stored:
            arrays, faces = self._unpacked(packed, wanted)
        else:
            arrays = {name: self._file.array(index) for name, index in wanted.items()}
            faces = self._triangles(mode, primitive.get("indices"), len(arrays["POSITION"]))
        places = arrays.pop("POSITION").astype(np.float64)
        for weight, target in zip(weights, primitive.get("targets") or [], strict=False):
            if weight and "POSITION" in target:
                places += weight * self._file.array(target["POSITION"])
        if places.shape[1] != 3:
            raise InputError("wrong-shape", "has vertices without three coordinates each")
        if any(len(each) != len(places) for each in arrays.values()):
            raise InputError("counts-differ", "has an attribute without a value for each vertex")
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(places):
            fault = "has a face whose vertex index is out of range"
            raise InputError("vertex-out-of-range", fault, REPAIR)
        skin = {name: each for name, each in arrays.items() if name.startswith(_SKIN)}
        return _Part(places, faces, skin | _columns(arrays))

    def _triangles(self, mode: object, indices: object, n_vertices: int) -> IntArray:
        """Return the corners of the triangles of a primitive, shape (m, 3)."""
        corners = np.arange(n_vertices)
        if indices is not None:
            found = self._file.array(indices)
            if found.dtype.kind not in "iu" or found.shape[1] != 1:
                raise no_whole_numbers("vertex indices")
            corners = found[:, 0].astype(np.int64)
        if mode == _TRIANGLES:
            over = len(corners) % 3
            self._left_out["incomplete triangle", "at the end of a primitive"] += over > 0
            return corners[: len(corners) - over].reshape(-1, 3)
        if mode == _STRIP:
            return strip_triangles(corners, np.array([len(corners)]))
        if mode == _FAN:
            return fan_triangles(corners, np.array([len(corners)]))
        raise wrong_format(f"has a primitive of the unknown mode {printable(mode, 20)}")

    def _unpacked(
        self, packed: Entry, wanted: Entry
    ) -> tuple[dict[str, npt.NDArray[Any]], IntArray]:
        """Return the attributes and triangles of a primitive compressed by Draco."""
        data = bytes(self._file.view(packed["bufferView"]))
        try:
            content = draco_content(data)
        except InputError as fault:
            raise fault.of(f"has a mesh packed by {DRACO} that") from fault
        arrays = {}
        for name, index in wanted.items():
            found = content.get_attribute_by_unique_id(packed["attributes"][name])
            if found is None:
                raise InputError("missing-data", f"has a mesh packed by {DRACO} without {name}")
            values = np.asarray(found["data"]).reshape(-1, int(found["num_components"]))
            normalized = self._file.entry("accessors", index).get("normalized")
            arrays[name] = scaled(values) if normalized else values
        faces = np.asarray(getattr(content, "faces", ()), dtype=np.int64)
        return arrays, faces.reshape(-1, 3)


def _concatenated(parts: list[_Part]) -> _Part:
    """Concatenate parts; missing values become NaN, missing joints and weights 0."""
    starts = np.cumsum([0, *(len(each.vertices) for each in parts)]).tolist()
    values: dict[str, npt.NDArray[Any]] = {}
    for part, start in zip(parts, starts, strict=False):
        for name, each in part.values.items():
            missing = 0.0 if name.startswith(_SKIN) else np.nan
            whole = values.setdefault(name, np.full((starts[-1], each.shape[1]), missing))
            whole[start : start + len(each)] = each
    faces = [each.faces + start for each, start in zip(parts, starts, strict=False)]
    return _Part(
        np.concatenate([np.zeros((0, 3)), *(each.vertices for each in parts)]),
        np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces]),
        values,
    )


def _columns(arrays: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of custom attributes, whose names begin with an underscore."""
    return {
        name if values.shape[1] == 1 else f"{name} {at}": values[:, at, None]
        for name, values in arrays.items()
        if name.startswith("_")
        for at in range(values.shape[1])
    }


def _copies(part: _Part, matrices: FloatArray, values: dict[str, npt.NDArray[Any]]) -> _Part:
    """Return copies of a mesh transformed by matrices, shape (k, 4, 4), with values per copy."""
    linear, shift = matrices[:, :3, :3], matrices[:, :3, 3]
    vertices = part.vertices @ linear.transpose(0, 2, 1) + shift[:, None]
    faces = np.repeat(part.faces[None], len(matrices), axis=0)
    mirrored = np.linalg.det(linear) < 0.0  # a reflection reverses orientation
    faces[mirrored] = faces[mirrored][:, :, ::-1]
    count = len(part.vertices)
    faces += (np.arange(len(matrices)) * count)[:, None, None]
    own = {name: np.tile(each, (len(matrices), 1)) for name, each in part.values.items()}
    shared = {name: np.repeat(each, count, axis=0) for name, each in values.items()}
    return _Part(vertices.reshape(-1, 3), faces.reshape(-1, 3), shared | own)


def _matrix(node: Entry) -> FloatArray:
    """Return the transform from a node to its parent, shape (4, 4)."""
    if "matrix" in node:
        columns: FloatArray = np.array(node["matrix"], dtype=np.float64).reshape(4, 4)
        return np.asarray(columns.T)
    keys = ("translation", "rotation", "scale")
    given = {key.upper(): np.array([node[key]]) for key in keys if key in node}
    return np.asarray(_placements(given or {"SCALE": np.ones((1, 3))})[0])


def _placements(arrays: dict[str, npt.NDArray[Any]]) -> FloatArray:
    """Return matrices of translations, rotations (quaternions, w last) and scales, (k, 4, 4)."""
    count = len(next(iter(arrays.values())))
    matrices = np.tile(np.eye(4), (count, 1, 1))
    if "ROTATION" in arrays:
        from scipy.spatial.transform import Rotation

        turns = arrays["ROTATION"].astype(np.float64)
        still = ~np.any(turns, axis=1)
        turns[still] = 0.0, 0.0, 0.0, 1.0
        matrices[:, :3, :3] = Rotation.from_quat(turns).as_matrix()
    if "SCALE" in arrays:
        matrices[:, :3, :3] *= arrays["SCALE"].astype(np.float64)[:, None, :]
    if "TRANSLATION" in arrays:
        matrices[:, :3, 3] = arrays["TRANSLATION"]
    return matrices

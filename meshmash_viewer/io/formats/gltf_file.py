"""Access to the content of glTF files: JSON description, buffers and arrays."""

from __future__ import annotations

import base64
import binascii
import json
import os
import struct
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, no_whole_numbers, printable, wrong_format

#: An object of the description, such as a node.
Entry: TypeAlias = dict[str, Any]

DRACO = "KHR_draco_mesh_compression"
INSTANCING = "EXT_mesh_gpu_instancing"
#: Supported extensions that change the geometry.
_UNDERSTOOD = (DRACO, INSTANCING, "KHR_mesh_quantization", "KHR_accessor_float64")
#: Prefixes of the names of extensions that only change the appearance.
_APPEARANCE = (
    *("KHR_materials_", "EXT_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_"),
    *("KHR_lights_", "EXT_lights_", "KHR_animation_", "KHR_xmp", "KHR_techniques_webgl"),
)
#: Extensions that compress a part of a buffer; the uncompressed data may then be missing.
_PACKED_VIEWS = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_COMPONENTS = {
    5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5124: "<i4", 5125: "<u4",
    5126: "<f4", 5130: "<f8",
}  # fmt: skip
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_JSON, _BIN = b"JSON", b"BIN\0"


class GltfFile:
    """Content of a ``.gltf`` or ``.glb`` file.

    `InputError` is raised if the file is not glTF 2.0, requires an unsupported extension, or refers
    to a file that does not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        text, self._own = _content(path)
        try:
            self.description: Entry = json.loads(text)
        except (ValueError, RecursionError):
            self.description = {}
        if not isinstance(self.description, dict) or not self.description:
            raise wrong_format("does not hold the JSON that a glTF scene begins with")
        self._loaded: dict[int, bytes | memoryview] = {}
        version = str((self.description.get("asset") or {}).get("version", "2.0"))
        if version.split(".")[0] != "2":
            raise InputError("wrong-version", f"is of version {printable(version, 20)}, not 2")
        required = self.description.get("extensionsRequired") or []
        unknown = [each for each in required if each not in _UNDERSTOOD]
        _refuse([each for each in unknown if not str(each).startswith(_APPEARANCE)])

    @property
    def sizes(self) -> tuple[int, int]:
        """Total size in bytes of the file with its buffers, and of all arrays when unpacked."""
        named = [self._file_of(each) for each in self.description.get("buffers") or []]
        packed = self._path.stat().st_size + sum(each.stat().st_size for each in named if each)
        arrays = self.description.get("accessors") or []
        return packed, sum(8 * _whole(each, "count", 0) for each in arrays)

    def entry(self, kind: str, index: object) -> Entry:
        """Return an entry of the list `kind` in the description, such as "nodes".

        `InputError` is raised if the index is out of range.
        """
        entries = self.description.get(kind) or []
        if not isinstance(index, int) or not 0 <= index < len(entries):
            raise InputError(
                "missing-data",
                f"names number {printable(index, 20)} of its {kind}, of which it has"
                f" {len(entries)}, counted from 0",
            )
        found: Entry = entries[index]
        return found

    def array(self, accessor: object) -> npt.NDArray[Any]:
        """Return the array of an accessor, shape (count, width); normalized integers as float64.

        `InputError` is raised if the accessor is invalid, or the array ends beyond its buffer.
        """
        entry = self.entry("accessors", accessor)
        dtype, count = _dtype(entry), _whole(entry, "count")
        if entry.get("type") not in _WIDTHS:
            kind = printable(entry.get("type"), 20)
            raise InputError("wrong-type", f"has an array of type {kind} where numbers should be")
        width = _WIDTHS[entry["type"]]
        if "bufferView" in entry:
            offset = _whole(entry, "byteOffset", 0)
            values = self._rows(entry["bufferView"], offset, count, width, dtype)
        else:
            values = np.zeros((count, width), dtype)  # as specified
        if "sparse" in entry:
            values = self._replaced(values, entry["sparse"])
        return scaled(values) if entry.get("normalized") else values

    def view(self, index: object) -> memoryview:
        """Return the bytes of a buffer view.

        `InputError` is raised if the view ends beyond its buffer, or its buffer has no data, as for
        unsupported compression.
        """
        entry = self.entry("bufferViews", index)
        start, length = _whole(entry, "byteOffset", 0), _whole(entry, "byteLength")
        data = self._buffer(_whole(entry, "buffer"), entry)
        if start + length > len(data):
            raise _shorter()
        return memoryview(data)[start : start + length]

    # -- arrays -------------------------------------------------------------------------------

    def _rows(
        self, view: object, offset: int, count: int, width: int, dtype: np.dtype[Any]
    ) -> npt.NDArray[Any]:
        data, row = self.view(view), width * dtype.itemsize
        stride = _whole(self.entry("bufferViews", view), "byteStride", 0) or row
        if count and offset + (count - 1) * stride + row > len(data):
            raise _shorter()
        strides = stride, dtype.itemsize
        return np.ndarray((count, width), dtype, data, offset if count else 0, strides)

    def _replaced(self, values: npt.NDArray[Any], sparse: Entry) -> npt.NDArray[Any]:
        """Return values with the rows given by a sparse accessor replaced."""
        count, indices, given = _whole(sparse, "count"), sparse["indices"], sparse["values"]
        kind, width = _dtype(indices), values.shape[1]
        at = self._rows(indices["bufferView"], _whole(indices, "byteOffset", 0), count, 1, kind)
        offset = _whole(given, "byteOffset", 0)
        new = self._rows(given["bufferView"], offset, count, width, values.dtype)
        if kind.kind not in "iu" or (count and not 0 <= int(at.min()) <= at.max() < len(values)):
            raise InputError("out-of-range", "has a sparse array whose indices are out of range")
        values = values.copy()
        values[at[:, 0]] = new
        return values

    # -- buffers ------------------------------------------------------------------------------

    def _buffer(self, index: int, view: Entry) -> bytes | memoryview:
        if index not in self._loaded:
            entry = self.entry("buffers", index)
            uri, file = entry.get("uri"), self._file_of(entry)
            if file is not None:
                data: bytes | memoryview = file.read_bytes()
            elif uri is not None:
                data = _data_of(uri)
            elif index == 0 and self._own is not None:
                data = self._own
            else:
                _refuse([each for each in _PACKED_VIEWS if each in view.get("extensions", {})])
                raise InputError("missing-data", f"has no data for its buffer {index}")
            if len(data) < _whole(entry, "byteLength", 0):
                raise _shorter()
            self._loaded[index] = data
        return self._loaded[index]

    def _file_of(self, buffer: Entry) -> Path | None:
        """Return the file of a buffer; None if its data are in the description or the GLB."""
        uri = buffer.get("uri", "data:")
        if uri[:5].lower() == "data:":
            return None
        plain = urllib.parse.unquote(uri)
        names: list[str] = [uri, plain, plain.replace("\\", "/")]
        if uri[:5].lower() == "file:":
            names = [urllib.request.url2pathname(urllib.parse.urlsplit(uri).path)]
        for each in names:
            if "\0" not in each and os.path.isfile(self._path.parent / each):
                return self._path.parent / each
        raise InputError("file-not-found", f"lacks the file {printable(uri, 60)} next to it")


def scaled(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return integers divided by the maximum of their type: 0 to 1, or -1 to 1 if signed."""
    if values.dtype.kind not in "iu":
        return values
    largest = float(np.iinfo(values.dtype).max)
    return np.asarray(np.maximum(values / largest, -1.0))


def _refuse(extensions: list[Any]) -> None:
    if extensions:
        names = ", ".join(dict.fromkeys(printable(each, 60) for each in extensions))
        fault = f"requires {names}, which {'is' if len(extensions) == 1 else 'are'} not understood"
        remedy = f"export it without {'it' if len(extensions) == 1 else 'them'}"
        raise InputError("not-supported", fault, remedy)


def _shorter() -> InputError:
    return InputError("file-cut-short", "has a buffer that is shorter than its parts, or damaged")


def _whole(entry: Entry, key: str, default: int | None = None) -> int:
    """Return a count, offset or index; `InputError` is raised unless it is an integer from 0 on."""
    value = entry.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise no_whole_numbers(f"entries {key} ({printable(value, 30)})")
    return value


def _dtype(entry: Entry) -> np.dtype[Any]:
    kind = entry.get("componentType")
    if kind not in _COMPONENTS:
        raise InputError("wrong-type", f"has an array of numbers of type {printable(kind, 20)}")
    return np.dtype(_COMPONENTS[kind])


def _content(path: Path) -> tuple[bytes, memoryview | None]:
    """Return the text of the description, and the buffer in a GLB file, if any."""
    data = path.read_bytes()
    if not data.startswith(b"glTF"):
        if path.suffix.lower() == ".glb":
            raise wrong_format('does not begin with "glTF"')
        return data, None
    if len(data) < 12:
        raise wrong_format('does not begin with "glTF" and the length of its parts')
    version = int.from_bytes(data[4:8], "little")
    if version != 2:
        raise InputError("wrong-version", f"is of version {version}, not 2")
    chunks: dict[bytes, memoryview] = {}
    place = 12
    while place + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, place)
        chunks.setdefault(kind, memoryview(data)[place + 8 : place + 8 + length])
        place += 8 + length
    if next(iter(chunks), b"") != _JSON:
        raise wrong_format("does not begin with the description of a scene")
    return bytes(chunks[_JSON]), chunks.get(_BIN)


def _data_of(uri: str) -> bytes:
    """Decode a data URI, base64 or percent-encoded."""
    head, _, body = uri.partition(",")
    data = urllib.parse.unquote_to_bytes(body) if "%" in body else body.encode()
    if not head.lower().rstrip().endswith(";base64"):
        return data
    try:
        return base64.b64decode(data + b"=" * (-len(data.rstrip(b"=")) % 4))
    except binascii.Error as fault:
        raise _shorter() from fault

"""Content of mesh files before any check, which readers return, and reading under limits.

Some libraries do not raise on a broken file but crash, loop forever or exhaust the memory; they run
in a child process with limits of time and memory.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, MeshWarning, missing_module, not_installed, printable
from meshmash_viewer.io.provenance import stated_map_labels, stated_units
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.plug_ins import PlugIn
from meshmash_viewer.vertex_map import COLOR, Label, VertexMap, labels_in_use, unused_number
from meshmash_viewer.work import ChildEnded, ProcessTree, call_in_child

#: Largest number of maps read from one file.
MOST_MAPS = 64
#: Colour of a label whose colour in the file is not of the form #rrggbb.
_NO_COLOR = "#808080"


@dataclass(frozen=True)
class RawMap:
    """Values per vertex as read from a file, not yet checked."""

    #: Name of the map; "" for the name of the file.
    name: str
    #: Shape (n,).
    values: npt.NDArray[Any]
    #: A single label without a name gets that of the map; one of several gets its number as name.
    labels: tuple[Label, ...] = ()
    #: Shape (n,): Index in the mesh file of the vertex of each value; None if all have one.
    rows: IntArray | None = None
    #: Whether labels without a vertex are kept; False for tables of other programs, with hundreds.
    keep_unused: bool = False
    #: Shape of the array in the file, if it may be a volume.
    volume: tuple[int, ...] = ()
    #: Unit of the values, "" if it is not stated.
    unit: str = ""

    @property
    def last(self) -> int:
        """Largest index in `rows`; -1 without rows."""
        return -1 if self.rows is None else int(self.rows.max())

    def checked(self, n_vertices: int, path: Path | None = None) -> VertexMap:
        """Convert to a map of a mesh with n vertices; unused labels are dropped, see `keep_unused`.

        `InputError` is raised as by `VertexMap`, and if an index in `rows` is too large.
        """
        name = self.name or (path.name if path else "")
        origin = str(path.absolute()) if path else ""
        if self.last >= n_vertices:
            raise InputError(
                f"Map {name!r} names vertex {self.last:,}, and the mesh has {n_vertices:,}"
                " vertices: give the one that was made for this surface."
            )
        values, labels = self.values, self.labels
        if self.rows is not None:
            values = np.full(n_vertices, unused_number(labels) if labels else np.nan)
            values[self.rows] = self.values
        used = labels if self.keep_unused else labels_in_use(labels, values)
        if labels and not used:
            raise InputError(f"Map {name!r} has no vertex with a label: export it again.")
        labels = tuple(
            replace(
                label,
                name=label.name or (name if len(used) == 1 else str(label.key)),
                color=label.color if COLOR.fullmatch(label.color) else _NO_COLOR,
            )
            for label in used
        )
        return VertexMap(name, values, labels, self.unit, path=origin)


def checked_maps(
    maps: Iterable[RawMap], n_vertices: int, path: Path | None = None
) -> tuple[list[VertexMap], list[InputError], tuple[str, ...]]:
    """Return the maps that are valid, the errors of the others, and each error as a clause."""
    found, faults = [], []
    for each in maps:
        try:
            found.append(each.checked(n_vertices, path))
        except InputError as fault:
            faults.append(fault)
    clauses = (str(fault).removeprefix("Map ").removesuffix(".") for fault in faults)
    return found, faults, tuple(f"has a map that is left out: {clause}" for clause in clauses)


def maps_of_columns(
    values: npt.NDArray[Any], names: Sequence[str], rows: IntArray | None = None
) -> Iterator[RawMap]:
    """Make a map of each column of values, shape (n, columns)."""
    for name, column in zip(names, values.T, strict=True):
        yield RawMap(name, np.ascontiguousarray(column), rows=rows)


def are_ascending_indices(values: npt.NDArray[Any]) -> bool:
    """Whether an array holds strictly ascending whole numbers from 0 on."""
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        return False
    whole = np.isfinite(values).all() and np.array_equal(values, np.floor(values))
    return bool(whole and (values[:1] >= 0).all() and (values[1:] > values[:-1]).all())


@dataclass(frozen=True)
class RawMesh:
    """Content of a file, not yet checked; a file of maps alone has no vertices and no faces."""

    #: Shape (n, 3): Coordinates as written in the file.
    vertices: FloatArray
    #: Shape (m, 3): Vertex indices, counted from zero; they may be out of range.
    faces: IntArray
    #: Unit of length stated by the format or the file; None if unstated.
    unit: str | None = None
    #: Values per vertex in the file.
    maps: tuple[RawMap, ...] = ()
    #: Clauses on content that was not read: "holds 12 lines, which are left out".
    remarks: tuple[str, ...] = ()
    #: Brain structure stated in the file, such as "CortexLeft"; "" if unstated.
    structure: str = ""
    #: JSON text of `io.provenance` in our own exports, "" in other files.
    meta: str = ""
    #: Clause on why `unit` is not the usual unit of the format; "" if it is.
    unit_remark: str = ""

    @property
    def described_maps(self) -> tuple[RawMap, ...]:
        """Maps with the units and labels stated in `meta`."""
        units, labels = stated_units(self.meta), stated_map_labels(self.meta)
        return tuple(
            _labelled(replace(each, unit=units.get(each.name, each.unit)), labels.get(each.name))
            for each in self.maps
        )


def _labelled(known: RawMap, labels: tuple[Label, ...] | None) -> RawMap:
    """Return a map with labels, or as it is if its values are not the numbers of these.

    NaN, which stands for vertices that a repair removed, becomes no label.
    """
    if not labels or known.labels or known.values.dtype.kind not in "fiu":
        return known
    values = np.nan_to_num(known.values, nan=unused_number(labels))
    if not (labels_in_use(labels, values) and np.array_equal(values, np.rint(values))):
        return known
    return replace(known, values=values, labels=labels, keep_unused=True)


def maps_alone(
    maps: Iterable[RawMap], remarks: tuple[str, ...] = (), meta: str = "", structure: str = ""
) -> RawMesh:
    """Return the content of a file without a mesh."""
    no_vertices, no_faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return RawMesh(no_vertices, no_faces, None, tuple(maps), remarks, structure, meta)


def read_raw(reader: Callable[[Path], RawMesh | MeshLike], path: Path) -> RawMesh:
    """Call a reader; mesh warnings become remarks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", MeshWarning)
        raw = raw_mesh(reader(path))
    said = tuple(f"has a fault: {each.message}" for each in caught)
    return replace(raw, remarks=(*raw.remarks, *said)) if said else raw


def raw_mesh(given: RawMesh | MeshLike) -> RawMesh:
    """Convert the result of a reader; readers of plug-ins may return a mesh of any type."""
    if isinstance(given, RawMesh):
        return given
    mesh = as_mesh(given)
    maps = tuple(RawMap(each.name, each.values, each.labels, unit=each.unit) for each in mesh.maps)
    return RawMesh(mesh.vertices, mesh.faces, mesh.unit or None, maps, structure=mesh.structure)


# -- reading under limits ------------------------------------------------------------------------

#: Environment variable whose value multiplies all limits.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Largest plausible compression: gzip compresses text of very regular meshes thirty-fold.
_HONEST_RATIO = 40.0
#: Files that unpack to less than this size, or by less than this ratio, need no limits.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0

#: Whether this is the child process, which runs under limits already.
_watched = False
#: Seconds without processor use after which the child is considered blocked.
_IDLE_SECONDS = 60.0


def is_child() -> bool:
    """Whether this process is the child of `read_guarded`, which runs under limits already."""
    return _watched


class LimitExceeded(InputError):
    """A file takes more time or memory than its size justifies; the message names the remedy."""

    def __init__(self, what: str) -> None:
        super().__init__(
            f"{what}, more than a sound file of its size should; if you trust it, set"
            f" {RAISE_LIMITS}=10 to allow ten times as much, or export it again."
        )


@dataclass(frozen=True)
class ReadLimits:
    """Limits of the process that reads a file, about twenty times what regular files need.

    Both are multiplied by the number in the environment variable `RAISE_LIMITS`.
    """

    #: Processor time.
    seconds: float
    #: Bytes in use at once, the interpreter and its libraries included.
    memory: float

    @classmethod
    def of(cls, n_bytes: int, *, unpacked: int = 0) -> ReadLimits:
        """Return the limits for a file of some bytes, and more after decompression as a whole.

        `InputError` is raised if the environment variable holds no positive number.
        """
        honest = min(float(unpacked), _HONEST_RATIO * n_bytes)
        size = max(float(n_bytes), honest / 5.0)
        factor = limit_factor()
        return cls(
            factor * (_SECONDS + _SECONDS_PER_BYTE * size),
            factor * (_BYTES + _BYTES_PER_BYTE * size),
        )

    @staticmethod
    def are_needed(n_bytes: int, unpacked: float) -> bool:
        """Whether a file unpacks to so much that it must be read under limits."""
        return unpacked > max(_HARMLESS_BYTES, _HARMLESS_RATIO * n_bytes)


def limit_factor() -> float:
    """Return the number in the environment variable `RAISE_LIMITS`, by default 1."""
    text = os.environ.get(RAISE_LIMITS, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not factor > 0.0:
        raise InputError(
            f"{RAISE_LIMITS} is {text!r}: give the number by which the limits of time and memory"
            " for reading a file are to be multiplied, or unset it."
        )
    return factor


def read_guarded(
    reader: Callable[[Path], RawMesh], path: Path, limits: ReadLimits | None = None
) -> RawMesh:
    """Read a file in a child process under limits, by default ``ReadLimits.of`` its size.

    `reader` is a public function of a module. `LimitExceeded` is raised if it takes more time or
    memory; `InputError` if `reader` raises it, or the child crashes.
    """
    if _watched:
        return read_raw(reader, path)
    if isinstance(reader, PlugIn):
        reader.load()  # raises here if the plug-in cannot be loaded
    limits = limits or ReadLimits.of(path.stat().st_size)
    name = f"{reader.__module__}:{reader.__qualname__}"
    try:
        # one thread of OpenBLAS, as each takes memory
        return call_in_child(
            convert,
            name,
            path,
            limits.memory,
            look=_Watch(limits),
            env={"OPENBLAS_NUM_THREADS": "1"},
        )
    except MemoryError:
        raise _too_large(limits) from None
    except ChildEnded:
        raise InputError("is so broken that the library that reads it ends on it") from None


class _Watch:
    """Raises `LimitExceeded` when a process exceeds its limits."""

    def __init__(self, limits: ReadLimits) -> None:
        self._limits, self._began = limits, time.monotonic()

    def __call__(self, tree: ProcessTree) -> None:
        computed, memory = tree.measured()
        if memory > self._limits.memory:
            raise _too_large(self._limits)
        if computed > self._limits.seconds:
            raise LimitExceeded(f"takes longer than {self._limits.seconds:.0f} seconds to read")
        if time.monotonic() - self._began > _IDLE_SECONDS + 10.0 * computed:
            raise LimitExceeded("takes too long to read")


def _too_large(limits: ReadLimits) -> LimitExceeded:
    return LimitExceeded(f"takes more than {limits.memory / 1e6:.0f} MB of memory to read")


def convert(reader: str, path: Path, memory: float) -> RawMesh:
    """Read a file in the child process, by a reader given as "module:function".

    `memory` is the limit in bytes. All exceptions except `MemoryError` are raised as `InputError`.
    """
    global _watched
    module, _, function = reader.partition(":")
    read = getattr(importlib.import_module(module), function)
    _refuse_memory_beyond(memory)
    _watched = True
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return read_raw(read, path)
    except MemoryError:
        raise
    except Exception as fault:  # noqa: BLE001  reported by the parent
        said = str(fault) if isinstance(fault, InputError) else str(unreadable(fault))
        raise InputError(said) from None
    finally:
        _watched = False


def unreadable(fault: BaseException) -> InputError:
    """Return an `InputError` for an exception of a library, or for a library not installed."""
    if missing := missing_module(fault):
        return InputError(f"is read by {not_installed(missing)}")
    return InputError(f"is not readable ({printable(fault) or type(fault).__name__})")


def _refuse_memory_beyond(limit: float) -> None:
    """On Linux, limit the memory by the system, which is faster than checks by the parent."""
    try:
        import resource
    except ImportError:
        return  # the parent measures
    if sys.platform == "linux" and limit < 2.0**62:
        with contextlib.suppress(ValueError, OSError):  # the user has set a stricter limit
            resource.setrlimit(resource.RLIMIT_DATA, (int(limit), resource.RLIM_INFINITY))

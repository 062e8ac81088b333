"""Unchecked content of mesh files, as returned by readers, and reading under limits.

On broken files, some libraries crash, loop forever or exhaust the memory instead of raising an
exception; they run in a child process with limits of time and memory.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import os
import re
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
from meshmash_viewer.errors import (
    InputError,
    MeshWarning,
    missing_module,
    no_whole_numbers,
    package_missing,
    printable,
)
from meshmash_viewer.io.provenance import stated_map_labels, stated_units
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.plug_ins import PlugIn
from meshmash_viewer.vertex_map import (
    COLOR,
    Label,
    VertexMap,
    labels_in_use,
    numbered_labels,
    unused_number,
)
from meshmash_viewer.work import ChildEnded, ProcessTree, call_in_child

#: Largest number of maps read from one file.
MOST_MAPS = 64
#: Path in the place of a name: absolute, or of a file of FreeSurfer or with a common ending.
_PATH = re.compile(
    r"(?:~|\.{1,2}|[a-z]:|file:/*)?[\\/].*[^\\/]|.*[\\/](?:[lr]h\.[^\\/]+|[^\\/]+\.(?:gii|mg[hz]|nii|csv))",
    re.IGNORECASE,
)
#: Remedies of files without triangles, and with unusable ones.
AS_SURFACE, REPAIR = "export it as a surface with triangles", "repair or export the mesh again"
#: Colour of labels without a valid colour #rrggbb.
_NO_COLOR = "#808080"


@dataclass(frozen=True)
class RawMap:
    """Unchecked values per vertex from a file."""

    #: Name of the map; "" for the name of the file.
    name: str
    #: Shape (n,).
    values: npt.NDArray[Any]
    #: Labels named "" are renamed: a single one to the name of the map, others to their numbers.
    labels: tuple[Label, ...] = ()
    #: Shape (n,): Vertex index in the mesh file of each value; None if each vertex has a value.
    rows: IntArray | None = None
    #: Whether labels without a vertex are kept; False for label tables of other programs, which
    #: may have hundreds of unused labels.
    keep_unused: bool = False
    #: Shape of the array in the file if it may be an image volume, otherwise empty.
    volume: tuple[int, ...] = ()
    #: Unit of the values, "" if unstated.
    unit: str = ""

    @property
    def last(self) -> int:
        """Largest index in `rows`; -1 without rows."""
        return -1 if self.rows is None else int(self.rows.max())

    def checked(self, n_vertices: int, path: Path | None = None) -> VertexMap:
        """Convert to a map of a mesh with n vertices; drop unused labels unless `keep_unused`.

        `InputError` is raised as by `VertexMap`, and if an index in `rows` is too large.
        """
        name = self.name or (re.sub(r"\.gz$", "", path.name, flags=re.IGNORECASE) if path else "")
        if _PATH.fullmatch(name):
            name = re.split(r"[\\/]", name)[-1]
        origin = str(path.absolute()) if path else ""
        if self.rows is not None and self.last >= n_vertices:
            from_one = self.last == n_vertices and self.rows.min() > 0
            remedy = "subtract 1 if it counts from 1, or " if from_one else ""
            raise InputError(
                "vertex-out-of-range",
                f"Map {name!r} names vertex {self.last:,}, and the mesh has {n_vertices:,}"
                " vertices, counted from 0",
                f"{remedy}give the one that was made for this surface",
            )
        values, labels = self.values, self.labels
        if self.rows is not None:
            values = np.full(n_vertices, unused_number(labels) if labels else np.nan)
            values[self.rows] = self.values
        if labels and not self.keep_unused:  # Labels without a row in the table are numbered.
            others = (values > 0) & ~np.isin(values, [label.key for label in labels])
            labels = (*labels, *numbered_labels(values[others]))
        used = labels if self.keep_unused else labels_in_use(labels, values)
        if labels and not used:
            fault = f"Map {name!r} has no vertex with a label"
            raise InputError("no-labels", fault, "export it again")
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
    """Return the valid maps, the errors of the others, and clauses on both."""
    found, faults, clauses = [], [], []
    for each in maps:
        try:
            found.append(each.checked(n_vertices, path))
        except InputError as fault:
            faults.append(fault)
            clauses.append(f"has a map that is left out: {fault.clause}")
            continue
        keys = {label.key for label in each.labels}
        if more := [label.name for label in found[-1].labels if label.key not in keys]:
            names = printable(", ".join(more), 60)
            clauses.append(f"has labels without a row in its table, named by number: {names}")
    return found, faults, tuple(clauses)


def maps_of_columns(
    values: npt.NDArray[Any], names: Sequence[str], rows: IntArray | None = None
) -> Iterator[RawMap]:
    """Yield a map for each column of `values`, shape (n, columns)."""
    for name, column in zip(names, values.T, strict=True):
        yield RawMap(name, np.ascontiguousarray(column), rows=rows)


def row_per_vertex(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Transpose a 2-D array whose rows are maps: it has fewer rows than any mesh has vertices."""
    return values.T if values.shape[1] > MOST_MAPS >= len(values) else values


def most_maps(maps: Sequence[RawMap]) -> tuple[tuple[RawMap, ...], tuple[str, ...]]:
    """Return the first `MOST_MAPS` maps, and a clause on the others if there are more."""
    left = len(maps) - MOST_MAPS
    remark = f"has {left} of {len(maps)} columns of numbers beyond the limit, which are left out"
    return tuple(maps[:MOST_MAPS]), (remark,) if left > 0 else ()


def too_many_maps(count: int) -> InputError:
    """Return the fault of a file or array with more than `MOST_MAPS` columns."""
    fault = f"has {count:,} columns, of which {MOST_MAPS} can be taken at most"
    return InputError("too-many", fault)


def vertex_indices(numbers: npt.NDArray[Any]) -> IntArray:
    """Convert corners of faces to integers; `InputError` is raised if one is no whole number."""
    if numbers.dtype.kind == "f":
        if not np.array_equal(numbers, np.floor(numbers)):
            raise no_whole_numbers("vertex indices")
        numbers = np.clip(numbers, -1.0, 2.0**53)
    return numbers.astype(np.int64)


def are_ascending_indices(values: npt.NDArray[Any]) -> bool:
    """Whether an array consists of non-negative, strictly ascending whole numbers."""
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        return False
    whole = np.isfinite(values).all() and np.array_equal(values, np.floor(values))
    return bool(whole and (values[:1] >= 0).all() and (values[1:] > values[:-1]).all())


@dataclass(frozen=True)
class RawMesh:
    """Unchecked content of a file; without vertices and faces for a file with only maps."""

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
    #: JSON text of `io.provenance` in files of this program, "" in other files.
    meta: str = ""
    #: Reason, as a clause, for a `unit` other than the usual one of the format; otherwise "".
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
    """Return a map with labels; the map itself if its values are not label numbers.

    NaN, at vertices that a repair removed, becomes a number without a label.
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
    """Return maps as the content of a file without a mesh."""
    no_vertices, no_faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return RawMesh(no_vertices, no_faces, None, tuple(maps), remarks, structure, meta)


def read_raw(reader: Callable[[Path], RawMesh | MeshLike], path: Path) -> RawMesh:
    """Call a reader, and add its `MeshWarning` messages to the remarks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", MeshWarning)
        raw = raw_mesh(reader(path))
    said = tuple(f"has a fault: {each.message}" for each in caught)
    return replace(raw, remarks=(*raw.remarks, *said)) if said else raw


def raw_mesh(given: RawMesh | MeshLike) -> RawMesh:
    """Convert the result of a reader, which is any `MeshLike` for readers of plug-ins."""
    if isinstance(given, RawMesh):
        return given
    mesh = as_mesh(given)
    maps = tuple(RawMap(each.name, each.values, each.labels, unit=each.unit) for each in mesh.maps)
    return RawMesh(mesh.vertices, mesh.faces, mesh.unit or None, maps, structure=mesh.structure)


# -- reading under limits ------------------------------------------------------------------------

#: Environment variable with a number by which all limits are multiplied.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Largest plausible compression ratio; gzip reaches 30 for text of very regular meshes.
_HONEST_RATIO = 40.0
#: Files need no limits if the unpacked size, or its ratio to the packed size, is below these.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0

#: Whether this process is the child process, which already runs under limits.
_watched = False
#: The child is considered blocked if it computes for less than `_PROGRESS` seconds in this time.
_IDLE_SECONDS, _PROGRESS = 60.0, 0.1


def is_child() -> bool:
    """Whether this process is the child of `read_guarded`, which already runs under limits."""
    return _watched


class LimitExceeded(InputError):
    """Reading a file takes more time or memory than its size justifies."""

    def __init__(self, what: str) -> None:
        fault = f"{what}, more than expected for a file of its size"
        remedy = f"if you trust the file, set {RAISE_LIMITS}=10 to allow ten times as much"
        super().__init__("beyond-limits", fault, f"{remedy}, or export it again")


@dataclass(frozen=True)
class ReadLimits:
    """Limits of the process that reads a file, about twenty times the need of regular files."""

    #: Processor time in seconds.
    seconds: float
    #: Memory in bytes, including the interpreter and its libraries.
    memory: float

    @classmethod
    def of(cls, n_bytes: int, *, unpacked: int = 0) -> ReadLimits:
        """Return the limits for a file of `n_bytes`, and of `unpacked` bytes when decompressed.

        Limits are multiplied by `limit_factor`, which may raise `InputError`.
        """
        honest = min(float(unpacked), _HONEST_RATIO * n_bytes)
        size = max(float(n_bytes), honest / 5.0)
        factor = limit_factor()
        return cls(
            factor * (_SECONDS + _SECONDS_PER_BYTE * size),
            factor * (_BYTES + _BYTES_PER_BYTE * size),
        )

    @classmethod
    def if_needed(cls, n_bytes: int, unpacked: int) -> ReadLimits | None:
        """Return the limits, or None if the unpacked size of the file needs none."""
        is_needed = unpacked > max(_HARMLESS_BYTES, _HARMLESS_RATIO * n_bytes)
        return cls.of(n_bytes, unpacked=unpacked) if is_needed else None


def limit_factor() -> float:
    """Return the number in `RAISE_LIMITS`, by default 1; `InputError` if it is not positive."""
    text = os.environ.get(RAISE_LIMITS, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not factor > 0.0:
        raise InputError(
            "out-of-range",
            f"{RAISE_LIMITS} is {text!r}",
            "give the number by which the limits of time and memory for reading a file are to be"
            " multiplied, or unset it",
        )
    return factor


def read_guarded(
    reader: Callable[[Path], RawMesh], path: Path, limits: ReadLimits | None = None
) -> RawMesh:
    """Read a file in a child process under limits, by default ``ReadLimits.of`` its size.

    `reader` must be a public function of a module. `LimitExceeded` is raised if reading exceeds a
    limit, and `InputError` if `reader` raises any exception or the child process crashes.
    """
    if _watched:
        return read_raw(reader, path)
    if isinstance(reader, PlugIn):
        reader.load()  # an error of loading is raised here, not in the child
    limits = limits or ReadLimits.of(path.stat().st_size)
    name = f"{reader.__module__}:{reader.__qualname__}"
    try:
        # a single OpenBLAS thread, as each thread reserves memory
        environment = {"OPENBLAS_NUM_THREADS": "1"}
        look = ReadWatch(limits)
        return call_in_child(convert, name, path, limits.memory, look=look, env=environment)
    except MemoryError:
        raise _too_large(limits) from None
    except ChildEnded as fault:
        if fault.killed:
            raise InputError(
                "process-crashed",
                "was not read, because the system ended the process that reads it: the file is"
                " damaged, or too little memory is free",
                "close other programs and try again",
            ) from None
        what = "is so damaged that the library that reads it crashes"
        raise InputError("process-crashed", what) from None


class ReadWatch:
    """Check of the limits of processes, to be called repeatedly from their start.

    On a busy machine a process may get a hundredth of a processor, and is slow but not blocked.
    """

    def __init__(self, limits: ReadLimits) -> None:
        self._limits = limits
        #: Processor time of the processes, and when it had last grown by `_PROGRESS`.
        self._computed, self._grown = 0.0, time.monotonic()

    def __call__(self, tree: ProcessTree) -> None:
        """Raise `LimitExceeded` if the processes exceed a limit or are blocked."""
        limits, now = self._limits, time.monotonic()
        computed, memory = tree.measured()
        if memory > limits.memory:
            raise _too_large(limits)
        if computed > limits.seconds:
            raise LimitExceeded(f"takes longer than {limits.seconds:.0f} seconds to read")
        if computed - self._computed >= _PROGRESS:
            self._computed, self._grown = computed, now
        elif now - self._grown > _IDLE_SECONDS:
            raise LimitExceeded("takes too long to read")


def _too_large(limits: ReadLimits) -> LimitExceeded:
    return LimitExceeded(f"takes more than {limits.memory / 1e6:.0f} MB of memory to read")


def convert(reader: str, path: Path, memory: float) -> RawMesh:
    """Read a file in the child process with a reader given as "module:function".

    `memory` is the limit in bytes. Exceptions except `MemoryError` are converted to `InputError`.
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
        raise (fault if isinstance(fault, InputError) else unreadable(fault)).of() from None
    finally:
        _watched = False


def unreadable(fault: BaseException) -> InputError:
    """Return an `InputError` for an exception of a library or of a failed import."""
    if missing := missing_module(fault):
        return package_missing("is read by", missing)
    said = printable(fault) or type(fault).__name__
    return InputError("not-readable", f"is not readable ({said})")


def _refuse_memory_beyond(limit: float) -> None:
    """On Linux, set a memory limit of the kernel, which acts faster than checks by the parent."""
    try:
        import resource
    except ImportError:
        return  # only the parent checks
    if sys.platform == "linux" and limit < 2.0**62:
        with contextlib.suppress(ValueError, OSError):  # a stricter limit is set already
            resource.setrlimit(resource.RLIMIT_DATA, (int(limit), resource.RLIM_INFINITY))

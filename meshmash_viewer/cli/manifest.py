"""Manifest of runs over many meshes: a table with the result and the errors of each mesh."""

from __future__ import annotations

import hashlib
import json
import os
from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from filelock import FileLock

from meshmash_viewer.errors import InputError, package_missing
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.links import shown_path
from meshmash_viewer.mesh import Mesh

#: Columns and their types; unknown values are None.
COLUMNS = {
    "mesh": "string",  # the file
    "output": "string",  # relative to the folder of the manifest
    "status": "string",  # DONE or FAILED
    "fault": "string",
    "hash": "string",  # of the mesh as read, as in its provenance
    "maps_hash": "string",  # of its unit, voxel size and maps
    "options": "string",  # JSON
    "pairs": "int64",
    "max_eigenvalue": "float64",
    "residual": "float64",  # of the worst pair
    "orthonormality": "float64",
    "complete": "bool",
    "proof": "string",
    "truncation": "float64",  # largest estimated missing share of a column
    "seconds": "float64",
    "bytes": "int64",  # of the output
    "report": "string",  # as printed with --json
}
DONE, FAILED = "done", "failed"
#: Columns whose value has another name in the report.
_REPORTED = {"pairs": "n_eigenpairs", "residual": "worst_residual"}
#: Options that do not change the result for a mesh.
_FREE = (
    "mesh", "segment", "lod", "n_meshes", "output", "json", "jobs", "scheduler", "resume",
    "no_cache",
)  # fmt: skip
#: Options that name output files.
_WRITTEN = ("graphs", "id_map")
#: Hashes of a mesh: of vertices and faces, and of unit, voxel size and maps.
Content: TypeAlias = tuple[str, str]


@dataclass(frozen=True)
class Outcome:
    """Result or fault of a mesh, also sent by workers of a cluster."""

    number: int
    report: dict[str, Any] = field(default_factory=dict)
    said: str = ""
    #: None for a mesh that could not be read.
    content: Content | None = None
    status: int = 0
    fault: str = ""
    #: Whether the result of an earlier run is kept.
    kept: bool = False


class Manifest:
    """Manifest of a command in a folder: one row for the last run of each output."""

    def __init__(self, outputs: Sequence[Path], others: Sequence[Path], options: Namespace) -> None:
        self.folder = Path(os.path.commonpath([path.absolute().parent for path in outputs]))
        self.path = self.folder / f"manifest_{options.command}.parquet"
        if find_spec("pyarrow") is None:
            raise package_missing(f"{self.path} needs", "pyarrow")
        self._options = _described(options)
        self._meshes = [_whole(mesh) for mesh in options.mesh]
        self._outputs = [path.absolute() for path in outputs]
        self._others = others
        _table_in(self.path)  # an unreadable file is reported before the computation

    def finished(self) -> dict[int, Content]:
        """Return the contents, by index, of meshes whose results exist with the same options."""
        rows = {row["output"]: row for row in _table_in(self.path).to_pylist()}
        return {
            number: (row["hash"], row["maps_hash"])
            for number, output in enumerate(self._outputs)
            if (row := rows.get(self._name(output), {})).get("status") == DONE
            and row["options"] == self._options
            and row["bytes"] == _size(output)
            and all(path.is_file() for path in self._others[number : number + 1])
        }

    def add(self, outcomes: Iterable[Outcome]) -> None:
        """Add rows, replace older rows of the same outputs, and write the file."""
        import pyarrow.compute
        import pyarrow.parquet

        rows = []
        for each in outcomes:
            output, report, content = self._outputs[each.number], each.report, each.content
            missing = (report.get("truncation") or {}).get("estimate")
            row = {name: report.get(_REPORTED.get(name, name)) for name in COLUMNS}
            rows.append(row | {
                "mesh": self._meshes[each.number],
                "output": self._name(output),
                "status": FAILED if each.fault else DONE,
                "fault": each.fault or None,
                "hash": content and content[0],
                "maps_hash": content and content[1],
                "options": self._options,
                "truncation": max(missing) if missing else None,
                "bytes": None if each.fault else _size(output),
                "report": None if each.fault else json.dumps(report),
            })  # fmt: skip
        added = pyarrow.Table.from_pylist(rows, pyarrow.schema(COLUMNS.items()))
        # the system releases the lock of a killed process
        lock = FileLock(self.path.with_name(f".{self.path.stem}.lock"), poll_interval=0.02)
        with writing_errors(self.path), lock:
            again = pyarrow.compute.field("output").isin(added["output"].combine_chunks())
            table = pyarrow.concat_tables([_table_in(self.path).filter(~again), added])
            with written_whole(self.path) as part:
                pyarrow.parquet.write_table(table.sort_by("output"), str(part))

    def _name(self, output: Path) -> str:
        return Path(os.path.relpath(output, self.folder)).as_posix()


def content_of(mesh: Mesh) -> Content:
    """Return hashes of a mesh as read."""
    rest = hashlib.sha256(f"{mesh.unit} {mesh.voxel}".encode())
    for each in mesh.maps:
        rest.update(f"{each.name} {each.labels}".encode())
        rest.update(each.values.tobytes())
    return mesh.content_hash, rest.hexdigest()


def _whole(mesh: Path) -> str:
    """Return the absolute path of a mesh file, or the link in it."""
    shown = shown_path(mesh)
    return shown if shown != str(mesh) else str(mesh.absolute())


def _described(options: Namespace) -> str:
    """Return options as JSON, with the version of the program and hashes of input files."""
    chosen = {
        name: value
        for name, value in sorted(vars(options).items())
        if name not in _FREE and value not in (None, False, [])
    }
    files = {
        str(each): _digest(Path(place))
        for name, value in chosen.items()
        if name not in _WRITTEN
        for each in (value if isinstance(value, list) else [value])
        if isinstance(each, str | Path)
        and (place := _named_place(str(each)))
        # the word of an option, such as hks, may also be the folder of the results
        and (isinstance(each, Path) or not os.path.isdir(place))
    }
    program = metadata.version("meshmash-viewer")
    return json.dumps({**chosen, "program": program, "files": files}, default=str)


def _named_place(text: str) -> str:
    """Return the file or folder that an option names, as in ``FILE:LABEL`` and ``FILE>0.5``."""
    ends = (end for end in range(len(text), 0, -1) if end == len(text) or not text[end].isalnum())
    return next((text[:end] for end in ends if os.path.exists(text[:end])), "")


def _digest(place: Path) -> str:
    """Return a hash of the content of a file, or of the sizes and times of files in a folder."""
    if place.is_file():
        return hashlib.sha256(place.read_bytes()).hexdigest()
    stats = ((each.name, each.stat()) for each in place.iterdir())
    listed = sorted((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats)
    return hashlib.sha256(repr(listed).encode()).hexdigest()


def _size(path: Path) -> int | None:
    return path.stat().st_size if path.is_file() else None


def _table_in(path: Path) -> Any:
    """Read a manifest; return an empty table if there is no file."""
    import pyarrow.parquet

    schema = pyarrow.schema(COLUMNS.items())
    if not path.is_file():
        return schema.empty_table()
    try:
        return pyarrow.parquet.read_table(str(path)).select(schema.names).cast(schema)
    except (OSError, ValueError, KeyError) as fault:
        what = f"{path} is not a manifest that this version can read"
        remedy = "move it away, and everything is computed"
        raise InputError("wrong-format", what, remedy) from fault

"""Reader of HDF5 files of MeshParty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError, package_missing, printable
from meshmash_viewer.io.formats.draco import decode_draco
from meshmash_viewer.io.raw import RawMap, RawMesh, vertex_indices
from meshmash_viewer.units import counted


def read_meshparty(path: Path) -> RawMesh:
    """Read vertices and faces, or a mesh compressed by Draco, of the file or its only such group.

    A node mask of the vertices becomes the map "node_mask". Link edges, which are not edges of the
    surface, and a node mask of another length are left out with a remark.
    """
    try:
        import h5py
    except ImportError:
        raise package_missing("is read by", "h5py", "neuro") from None
    try:
        with h5py.File(path, "r") as file:
            group = _group_of_mesh(file)
            held = {name: group[name][()] for name in _KNOWN if _is_array(group.get(name))}
    except OSError as fault:
        raise InputError("file-cut-short", "is no HDF5 file, or cut short") from fault
    if "draco" in held:
        raw = decode_draco(np.asarray(held["draco"]).tobytes())
    elif "vertices" in held and "faces" in held:
        raw = RawMesh(_rows(held["vertices"], "vertices"), _rows(held["faces"], "faces"))
    else:
        raise InputError("missing-data", "holds neither vertices and faces nor a Draco mesh")
    maps, remarks = [], []
    if n_links := len(held.get("link_edges", ())):
        remarks.append(f"holds {counted(n_links, 'link edge')}, which no surface has, left out")
    mask = held.get("node_mask")
    if mask is not None and mask.shape == (len(raw.vertices),):
        maps.append(RawMap("node_mask", mask.astype(np.float64)))
    elif mask is not None and mask.size:
        remarks.append("holds a node mask of other vertices than its own, which is left out")
    return RawMesh(raw.vertices, raw.faces, maps=tuple(maps), remarks=tuple(remarks))


_KNOWN = ("vertices", "faces", "draco", "link_edges", "node_mask")


def _group_of_mesh(file: Any) -> Any:
    """Return the file if it contains a mesh itself, else its only group that does."""
    groups = [file]
    file.visititems(lambda _, each: groups.append(each) if hasattr(each, "keys") else None)
    found = [each for each in groups if "draco" in each or {"vertices", "faces"} <= {*each}]
    if len(found) > 1 and found[0] is not file:
        names = printable(", ".join(each.name for each in found), 100)
        fault = f"holds meshes in {len(found)} groups ({names})"
        raise InputError("ambiguous-content", fault, "write each mesh to a file of its own")
    return next(iter(found), file)


def _is_array(entry: Any) -> bool:
    """Whether an entry of the file is an array, neither a group nor missing."""
    return hasattr(entry, "shape") and entry.shape is not None


def _rows(values: Any, name: str) -> Any:
    """Return values as rows of three numbers; some files store faces in a flat array."""
    if values.dtype.kind not in "fiu" or values.size % 3 or values.shape[1:] not in ((), (3,)):
        raise InputError("wrong-shape", f"has {name} that are not rows of three numbers")
    rows = values.reshape(-1, 3)
    return rows.astype(np.float64) if name == "vertices" else vertex_indices(rows)

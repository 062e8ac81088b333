"""Placing of the pins of a table on a mesh, by index in the file or by position."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.pins import PinTable
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.pins import Pin, checked_color, distinct_name
from meshmash_viewer.units import METRES, NO_VOXEL, counted, format_quantity

#: Largest distance at which a vertex index and a position agree, relative to the mesh's diagonal.
_AGREES = 1e-3


@dataclass(frozen=True)
class PlacedPins:
    """Vertex, name and colour of each pin, reasons for rows left out, and other remarks."""

    pins: tuple[tuple[int, str, str], ...]
    faults: tuple[InputError, ...]
    remarks: tuple[str, ...]


def place_pins(mesh: Mesh, table: PinTable) -> PlacedPins:
    """Return the pins for the rows of a table.

    A pin is placed at the vertex with the index of the row in the file; without an index, or if
    this vertex is not at the position of the row, at the vertex nearest to the position.
    """
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    positions, reading = _positions(mesh, table)
    near, far = _nearest(mesh, positions)
    pins: dict[int, tuple[int, str, str]] = {}
    faults: list[InputError] = []
    disagreeing, repeated, farthest = 0, 0, 0.0
    for row, index in enumerate(table.indices.tolist()):
        try:
            color = checked_color(table.colors[row])
            vertex = _vertex_of(mesh, index, positions[row], _AGREES * size)
            if vertex < 0:
                distance = float(far[row])
                if not distance <= size:
                    text = format_quantity(distance, mesh.unit)
                    raise InputError(
                        "far-from-mesh", f"The position is {text} from the mesh", "check its unit"
                    )
                vertex, farthest = int(near[row]), max(farthest, distance)
                disagreeing += index >= 0
        except InputError as fault:
            faults.append(fault.of(f"row {row + 1}"))
            continue
        repeated += vertex in pins
        pins.setdefault(vertex, (vertex, table.names[row], color))
    remarks = [reading] if reading else []
    if disagreeing:
        remarks.append(f"{counted(disagreeing, 'position')} not at the index: the position counts.")
    if farthest > _AGREES * size:
        text = format_quantity(farthest, mesh.unit)
        remarks.append(f"The farthest vertex is {text} from its position.")
    if repeated:
        remarks.append(f"{counted(repeated, 'row')} at the vertex of an earlier row left out.")
    return PlacedPins(tuple(pins.values()), tuple(faults), tuple(remarks))


def _vertex_of(mesh: Mesh, index: int, position: FloatArray, agrees: float) -> int:
    """Return the vertex of an index; -1 if the position determines the vertex.

    `InputError` is raised if there is neither a vertex of that index nor a position.
    """
    placed = bool(np.isfinite(position).all())
    if index < 0 and placed:
        return -1
    if index < 0:
        raise InputError("missing-argument", "There is neither an index nor a position")
    if not placed:
        return mesh.vertex_of(index)
    with contextlib.suppress(InputError):
        vertex = mesh.vertex_of(index)
        if float(np.linalg.norm(mesh.vertices[vertex] - position)) <= agrees:
            return vertex
    return -1


def _positions(mesh: Mesh, table: PinTable) -> tuple[FloatArray, str]:
    """Return positions in the unit of the mesh, shape (n, 3), and a remark on an assumed unit.

    Positions without a unit may be in voxels: the unit with the smaller distances is assumed.
    """
    positions = table.positions
    if table.unit and mesh.unit:
        return positions * 10.0 ** (METRES[table.unit] - METRES[mesh.unit]), ""
    if mesh.voxel == NO_VOXEL or not np.isfinite(positions).any():
        return positions, ""
    both = {mesh.unit: positions, "voxels": positions * mesh.voxel}
    read = min(both, key=lambda each: float(np.nanmedian(_nearest(mesh, both[each])[1])))
    return both[read], f"Positions are read in {read}."


def _nearest(mesh: Mesh, positions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the vertex (on a face) nearest to each position, -1 for NaN, and its distance."""
    from scipy.spatial import cKDTree

    vertices, distances = np.full(len(positions), -1), np.full(len(positions), np.nan)
    given = np.isfinite(positions).all(axis=1)
    if given.any():
        used = np.flatnonzero(mesh.referenced)
        distances[given], found = cKDTree(mesh.vertices[used]).query(positions[given])
        vertices[given] = used[found]
    return vertices, distances


def merged_pins(
    pins: Sequence[Pin], placed: Sequence[tuple[int, str, str]]
) -> tuple[tuple[Pin, ...], str]:
    """Return pins and placed pins together, and a remark on numbered and replaced names.

    At a pinned vertex, name and colour of the placed pin replace those of the pin unless empty.
    """
    merged = {pin.vertex: pin for pin in pins}
    taken, names = {pin.number for pin in pins}, {pin.name for pin in pins}
    numbers = (number for number in count(1) if number not in taken)
    doubled, renamed = [], []
    for vertex, given, color in placed:
        pin = merged.get(vertex) or Pin(vertex, next(numbers))
        name = distinct_name(given, names - {pin.name} if given == pin.name else names)
        names.add(name)
        if name != distinct_name(given, ()):
            doubled.append(f"{distinct_name(given, ())} is {name}")
        if name and pin.name and name != pin.name:
            renamed.append(f"{pin.name} is {name}")
        merged[vertex] = replace(pin, name=name or pin.name, own_color=color or pin.own_color)
    heads = {"Names that are taken have a number": doubled, "Pins are renamed": renamed}
    remarks = [
        f"{head}: {rows[0]}{f' and {len(rows) - 1:,} more' if len(rows) > 1 else ''}."
        for head, rows in heads.items()
        if rows
    ]
    return tuple(merged.values()), " ".join(remarks)

"""Points near the open mesh, such as synapses, and their appearance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from psygnal import Signal

from meshmash_viewer.features.points import Points, ProjectedPoints
from meshmash_viewer.model.history import History
from meshmash_viewer.model.open_mesh import OpenMesh

#: Default and largest diameter, in points (the unit of length).
DEFAULT_SIZE, LARGEST_SIZE = 7, 40


@dataclass(frozen=True, eq=False)
class PointSet:
    """A table of points with the user's choices."""

    table: Points
    #: Name of the position in the table; "" if there is only one.
    position: str = ""
    #: Hash of the content of the file.
    hash: str = ""
    #: Maximum distance, in the unit of the mesh; None for the default of `project_points`.
    max_distance: float | None = None
    #: Column that determines the colours; "" for one colour.
    column: str = ""
    size: int = DEFAULT_SIZE

    def plain(self) -> dict[str, Any]:
        """Return the entry of a session; empty for points from memory."""
        if not self.table.path:
            return {}
        known: dict[str, Any] = {"path": self.table.path, "hash": self.hash}
        known |= {"unit": self.table.unit, "position": self.position}
        known |= {"column": self.column, "size": self.size}
        return known if self.max_distance is None else known | {"max_distance": self.max_distance}


class DocumentPoints:
    """The points of the open mesh; the history records changes by the user."""

    #: Emitted when other points are shown, or their appearance or their vertices change.
    changed = Signal()
    #: Emitted when the points `awaited` are to be read.
    requested = Signal()

    def __init__(self, opened: OpenMesh, history: History) -> None:
        self._opened, self._history = opened, history
        self.shown: PointSet | None = None
        #: The points projected onto the mesh; None until the projection is computed.
        self.projected: ProjectedPoints | None = None
        #: Entry of a session whose points have not been read yet.
        self.awaited: dict[str, Any] = {}
        history.keep("points", lambda: self.shown, self.put)

    def put(self, points: PointSet | None, found: ProjectedPoints | None = None) -> None:
        """Replace the points without a record in the history; `found` is their projection."""
        before, self.shown, self.awaited = self.shown, points, {}
        projections = [each and (each.table, each.max_distance) for each in (before, points)]
        if found is not None or points is None or projections[0] != projections[1]:
            self.projected = found
        self.changed.emit()

    def set(
        self, points: PointSet | None, label: str = "points", found: ProjectedPoints | None = None
    ) -> None:
        """Replace the points as one step of the history; the label completes "Undo …"."""
        self._history.record(label, "points")
        self.put(points, found)

    def change(self, label: str, **attributes: Any) -> None:
        """Change attributes of the points as one step of the history."""
        if self.shown is not None:
            after = replace(self.shown, **attributes)
            if after.plain() != self.shown.plain() or not after.table.path:
                self.set(after, label)

    def accept(self, found: ProjectedPoints | None) -> None:
        """Set the projection of the shown points."""
        if found is not self.projected:
            self.projected = found
            self.changed.emit()

    def drop(self) -> None:
        """Remove the points of the previous mesh; the caller emits `changed`."""
        self.awaited, self.shown, self.projected = {}, None, None

    def plain(self) -> dict[str, Any]:
        """Return the entry of a session."""
        return self.awaited if self.shown is None else self.shown.plain()

    def restore(self, known: dict[str, Any]) -> None:
        """Request the points of a session; until they are read, `plain` returns `known`."""
        if known.get("path"):
            self.awaited = known
            self.requested.emit()

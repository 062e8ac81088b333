"""Points drawn over the render: reading from a table, projection and colouring in a thread."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QInputDialog, QLabel

from meshmash_viewer.app import theme
from meshmash_viewer.app.background import BackgroundIO
from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.opening import Opening, ask
from meshmash_viewer.app.view.points import PointCloud, point_colors
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.points import FarPointsError, ProjectedPoints, project_points
from meshmash_viewer.features.regions import Regions
from meshmash_viewer.io.points import (
    POINT_ENDINGS,
    SeveralPositionsError,
    has_positions,
    read_points,
)
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.points import PointSet
from meshmash_viewer.units import counted, format_quantity, written_unit

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Width of the dialog that asks for a position or a unit.
_WIDE = 440
#: Mesh, points to draw, regions in which points are counted, and the projection if computed.
_Asked: TypeAlias = tuple[Mesh, PointSet, Regions | None, ProjectedPoints | None]
_Drawn: TypeAlias = tuple[ProjectedPoints, PointCloud, Regions | None]
#: Result of reading a table: projected points, an error to resolve, or None if it has no points.
_Read: TypeAlias = tuple[PointSet, ProjectedPoints] | SeveralPositionsError | FarPointsError | None


class PointTool(QObject):
    """Commands that open a table of points for the first mesh; drawing of the points."""

    def __init__(self, opening: Opening, scene: MeshView, background_io: BackgroundIO) -> None:
        super().__init__(opening.window)
        self._opening, self._document, self._scene = opening, opening.document, scene
        self._background_io = background_io
        document = self._document
        self._asked: _Asked | None = None
        self._slot = Slot(self, "points")
        listen(document.mesh_changed, self._begin)
        listen((document.points.changed, document.labels.changed), self.refresh)
        listen(document.points.requested, self._restore)
        self._restore()  # the session may have been restored before the render was made
        self.refresh()

    # -- reading ------------------------------------------------------------------------------

    def open_points(self) -> None:
        """Ask for a table of points, and draw the points."""
        patterns = " ".join(f"*{ending}" for ending in POINT_ENDINGS)
        if path := self._opening.ask_for_file("Open points", f"Tables of points ({patterns})"):
            self._read(path)

    def open_dropped(self, path: Path) -> None:
        """Draw the points of a table, or add its values per vertex as maps."""
        self._read(path, dropped=True)

    def remove_points(self) -> None:
        """Remove the points from the document; their file is not deleted."""
        self._document.points.set(None, "removal of points")

    def _read(self, path: Path, unit: str = "", position: str = "", dropped: bool = False) -> None:
        """Read a table; if it was `dropped`, it may be a table of values per vertex."""
        document, mesh = self._document, self._document.mesh
        if mesh is None:
            text = "There is no mesh for these points: open the mesh first, then its points."
            document.notices.say(text, Severity.WARNING)
            return

        def take(found: _Read) -> None:
            if found is None:
                document.maps.open([path])
            elif isinstance(found, SeveralPositionsError):
                choices = list(found.stems)
                self._ask(str(found), choices, lambda text: self._read(path, unit, text, dropped))
            elif isinstance(found, FarPointsError):
                said = f"{found}\nUnit of the points, or the voxel that they count:"
                choices = [found.unit or unit or written_unit(mesh.unit)]
                self._ask(said, choices, lambda text: self._read(path, text, position, dropped))
            elif document.mesh is None or document.mesh.vertices is not mesh.vertices:
                text = "The points are not shown: their mesh is not open any more."
                document.notices.say(text, Severity.WARNING)
            else:
                points, projected = found
                document.points.set(points, found=projected)
                self._say(projected)

        self._background_io.run(
            f"Reading {path.name}", lambda: _read(path, unit, position, dropped, mesh), take
        )

    def _say(self, found: ProjectedPoints) -> None:
        mesh, table = found.mesh, found.points
        within = format_quantity(found.max_distance, mesh.unit)
        text = f"{counted(len(found), 'point')} in {table.unit or written_unit(mesh.unit)}"
        text += f" from {table.name}, {found.n_near:,} within {within} of a vertex."
        severity = Severity.WARNING if found.remarks else Severity.INFORMATION
        self._document.notices.say(" ".join([text, *found.remarks]), severity)

    def _ask(self, said: str, choices: list[str], then: Callable[[str], None]) -> None:
        """Ask the user to choose one of several position columns, or to enter the unit."""
        dialog = theme.named(
            QInputDialog(self._opening.window), "points_dialog", "How to read the points"
        )
        dialog.setWindowTitle("Open points")
        dialog.setLabelText(said)
        if len(choices) > 1:
            dialog.setComboBoxItems(choices)
        else:
            dialog.setTextValue(choices[0])
        label = dialog.findChild(QLabel)
        assert label is not None
        label.setWordWrap(True)
        dialog.resize(_WIDE, dialog.sizeHint().height())
        ask(dialog, lambda: then(dialog.textValue()))

    def _restore(self) -> None:
        """Read the points stored in a session, if any."""
        document, mesh, known = self._document, self._document.mesh, self._document.points.awaited
        if not known or mesh is None:
            return
        path = Path(known["path"])
        how = known.get("unit", ""), known.get("position", "")
        looks = {name: known[name] for name in ("column", "size", "max_distance") if name in known}

        def read() -> PointSet:
            return PointSet(read_points(path, *how), how[1], _hash(path), **looks)

        def take(points: PointSet) -> None:
            if document.mesh is not None and document.mesh.vertices is mesh.vertices:
                document.points.put(points)
                if points.hash != known.get("hash", points.hash):
                    text = f"{path} has changed since these points were last displayed."
                    document.notices.say(text, Severity.WARNING)

        self._background_io.run(f"Reading {path.name}", read, take)

    # -- drawing and counting -----------------------------------------------------------------

    def _begin(self) -> None:
        """Draw the points again for a new mesh."""
        self._forget()
        self.refresh()

    def _forget(self) -> None:
        """Remove the drawn points and their counts."""
        self._asked, labels = None, self._document.labels
        self._scene.set_points(None)
        if labels.measured is not None:
            labels.accept_counts(labels.measured, labels.measured)

    def refresh(self) -> None:
        """Draw the points of the document, and count them in the measured regions."""
        document, before = self._document, self._asked
        mesh, points, measured = document.mesh, document.points.shown, document.labels.measured
        if mesh is None or points is None:
            if before is not None:
                self._forget()
        elif before is None or before[1] is not points or before[2] is not measured:
            asked = self._asked = mesh, points, measured, document.points.projected
            self._slot.submit(
                lambda _: _found(asked), partial(self._take, asked), partial(self._fail, asked)
            )

    def _fail(self, asked: _Asked, fault: Exception) -> None:
        if not isinstance(fault, InputError):
            raise fault
        if asked is self._asked:
            self._document.notices.say(str(fault), Severity.WARNING)
            self._forget()
            self._asked = asked
            self._document.points.accept(None)

    def _take(self, asked: _Asked, drawn: _Drawn) -> None:
        document, measured = self._document, asked[2]
        if (
            asked is self._asked
            and self._scene.mesh is not None
            and document.is_shown(self._scene.mesh)
        ):
            found, cloud, counted = drawn
            self._scene.set_points(cloud)
            document.points.accept(found)
            if measured is not None and counted is not None:
                document.labels.accept_counts(measured, counted)


def _read(path: Path, unit: str, position: str, dropped: bool, mesh: Mesh) -> _Read:
    if dropped and not has_positions(path):
        return None
    try:
        points = read_points(path, unit, position)
        if dropped and len(points) in (mesh.n_vertices, mesh.n_file_vertices):
            return None
        return PointSet(points, position, _hash(path)), project_points(mesh, points)
    except (SeveralPositionsError, FarPointsError) as fault:
        return fault


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _found(asked: _Asked) -> _Drawn:
    mesh, points, measured, known = asked
    if known is None or known.mesh.vertices is not mesh.vertices or known.mesh.unit != mesh.unit:
        known = project_points(mesh, points.table, points.max_distance)
    if measured is not None and known.mesh.vertices is measured.mesh.vertices:
        measured = measured.with_points(known)
    colors, legend = point_colors(known, points.column)
    return known, PointCloud(known, colors, legend, points.size), measured

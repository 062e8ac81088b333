"""Opens a second mesh beside the first, and closes it again."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from meshmash_viewer.app import theme
from meshmash_viewer.app.beside import Beside
from meshmash_viewer.app.field_source import FieldSource
from meshmash_viewer.app.last_look import LastLook
from meshmash_viewer.app.sessions import Restoration
from meshmash_viewer.app.stage import Stage
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.io.session import Session
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pair import LINKS

__all__ = ["Comparing"]


class Comparing(QObject):
    """The second mesh of a window, while there is one.

    `changed` carries the `Pair`, or None when the second mesh has gone; `shown` says that it has
    been drawn or has gone, so that `common_limits` may be other ones.

    Parameters
    ----------
    document : Document
        Of the first mesh.
    stage : Stage
    scene : MeshView
    source : FieldSource
    last_look : LastLook
        How mesh files were left.

    Attributes
    ----------
    beside : Beside or None
    """

    changed = Signal(object)
    shown = Signal()

    def __init__(
        self,
        document: Document,
        stage: Stage,
        scene: MeshView,
        source: FieldSource,
        last_look: LastLook,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._document, self._stage, self._scene = document, stage, scene
        self._source, self._last_look = source, last_look
        self._restoration: Restoration | None = None
        self.beside: Beside | None = None

    @property
    def idle(self) -> bool:
        """Whether there is nothing beside that works."""
        return self.beside is None or self.beside.idle

    @property
    def common_limits(self) -> tuple[float, float] | None:
        """Limits that the colours of both meshes share; None where each has its own."""
        return None if self.beside is None else self.beside.common_limits

    def first_waits(self) -> bool:
        """Whether a field of the first that has come is drawn later, with that of the second."""
        return self.beside is not None and self.beside.first_waits()

    def open(self, path: Path, unit: str = "", maps: Sequence[Path] = ()) -> None:
        """Read a mesh beside the first, with files of maps; one that is there stays if that fails.

        It is as it was left, in the unit that it was given last unless another is given.
        """
        beside, state = self._put_beside(LINKS), self._last_look.state(path)
        beside.document.open_mesh(path, **{**state, "unit": unit or state["unit"]}, maps=maps)

    def restore(self, session: Session) -> None:
        """Read a mesh beside the first, repaired as it was, with its maps and links."""
        beside = self._put_beside(session.links)
        path = Path(session.mesh_path)
        self._restoration = Restoration(beside.document, path, session)
        self._restoration.begin()

    def _put_beside(self, links: Collection[str]) -> Beside:
        """Make room for a second mesh; what is not among the `LINKS` is cut."""
        if self.beside is None:
            self.beside = Beside(self._document, self._scene, self._source)
            self.beside.close_requested.connect(self.end)
            self.beside.unread.connect(self.end)
            self.beside.shown.connect(self.shown)
            self._last_look.watch(self.beside.document, self.beside)
            self._stage.add_second(self.beside)
            self.changed.emit(self.beside.pair)
        for name in LINKS:
            self.beside.pair.link(name, name in links)
        return self.beside

    def end(self) -> None:
        """Leave the first mesh alone."""
        if self.beside is not None:
            beside, self.beside, self._restoration = self.beside, None, None
            beside.shut()
            self.changed.emit(None)
            self.shown.emit()
            beside.setParent(None)
            beside.deleteLater()

    def set_theme(self) -> None:
        """Light or dark."""
        if self.beside is not None:
            self.beside.scene.set_theme(theme.is_dark())

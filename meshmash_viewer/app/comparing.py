"""Opening and closing of the second mesh of a window."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from meshmash_viewer.app import theme
from meshmash_viewer.app.field_source import FieldSource
from meshmash_viewer.app.last_look import LastLook
from meshmash_viewer.app.second_view import SecondView
from meshmash_viewer.app.sessions import Restoration
from meshmash_viewer.app.stage import Stage
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.io.session import Session
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pair import LINKS


class Comparing(QObject):
    """The second mesh of a window: `second_view`, or None.

    `changed` carries the `Pair`, or None when the second mesh was closed; `shown` is emitted when
    it was drawn or closed, which may change `common_limits`.
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
        self.second_view: SecondView | None = None

    @property
    def idle(self) -> bool:
        """Whether nothing is being computed for the second mesh."""
        return self.second_view is None or self.second_view.idle

    @property
    def common_limits(self) -> tuple[float, float] | None:
        """Limits that the colours of both meshes share; None where each has its own."""
        return None if self.second_view is None else self.second_view.common_limits

    def first_waits(self) -> bool:
        """Whether a new field of the first is drawn later, together with that of the second."""
        return self.second_view is not None and self.second_view.first_waits()

    def open(self, path: Path, unit: str = "", maps: Sequence[Path] = ()) -> None:
        """Read a second mesh, with files of maps; an open one stays if that fails.

        Its unit and repairs are those of the last time, unless `unit` is given.
        """
        view, state = self._make_view(LINKS), self._last_look.state(path)
        view.document.open_mesh(path, **{**state, "unit": unit or state["unit"]}, maps=maps)

    def restore(self, session: Session) -> None:
        """Read the second mesh of a session, with its repairs, maps and links."""
        view = self._make_view(session.links)
        path = Path(session.mesh_path)
        self._restoration = Restoration(view.document, path, session)
        self._restoration.begin()

    def _make_view(self, links: Collection[str]) -> SecondView:
        """Return the view of the second mesh, made if needed, with only these links active."""
        if self.second_view is None:
            self.second_view = SecondView(self._document, self._scene, self._source)
            self.second_view.close_requested.connect(self.end)
            self.second_view.unread.connect(self.end)
            self.second_view.shown.connect(self.shown)
            self._last_look.watch(self.second_view.document, self.second_view)
            self._stage.add_second(self.second_view)
            self.changed.emit(self.second_view.pair)
        for name in LINKS:
            self.second_view.pair.link(name, name in links)
        return self.second_view

    def end(self) -> None:
        """Close the second mesh."""
        if self.second_view is not None:
            view, self.second_view, self._restoration = self.second_view, None, None
            view.shut()
            self.changed.emit(None)
            self.shown.emit()
            view.setParent(None)
            view.deleteLater()

    def set_theme(self) -> None:
        """Apply the light or dark theme."""
        if self.second_view is not None:
            self.second_view.scene.set_theme(theme.is_dark())

"""The menu of a vertex or a pin, for a right click on the render or on a list of pins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QMenu, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.units import NO_VOXEL, format_position, plain_text

#: Significant digits of copied values.
_DIGITS = 7


def close_menus() -> None:
    """Close the open menus: their entries refer to a mesh that has been replaced."""
    while isinstance(menu := QApplication.activePopupWidget(), QMenu):
        menu.close()


@dataclass(frozen=True)
class VertexMenu:
    """What the menu of a vertex needs."""

    mesh: Mesh
    vertex: int
    #: The pin of the vertex.
    pin: Pin | None
    #: The field that is shown.
    field: Field | None
    #: What the entries do, without arguments.
    toggle: Callable[[], object]
    centre: Callable[[], object]
    rename: Callable[[], object]
    recolor: Callable[[], object]
    #: Shows a sentence.
    say: Callable[[str], object]

    def make(self, parent: QWidget) -> QMenu:
        """Make the menu; each entry is named ``menu_<what it does>``."""
        menu = theme.named(QMenu(parent), "vertex_menu", "What can be done at this vertex")
        menu.addAction(self._title).setEnabled(False)
        menu.addSeparator()
        if self.pin is None:
            self._add(menu, "pin", "Pin here", self.toggle)
        else:
            self._add(menu, "unpin", f"Unpin {self.pin.title}", self.toggle)
            self._add(menu, "rename", "Rename…", self.rename)
            self._add(menu, "recolor", "Colour…", self.recolor)
        self._add(menu, "centre", "Centre here", self.centre)
        menu.addSeparator()
        for name, (text, content) in self._copies().items():
            self._add(menu, name, f"{text}: {content}", partial(self._copy, content))
        return menu

    @property
    def _title(self) -> str:
        vertex = self.mesh.named_vertex(self.vertex)
        if self.pin is None:
            return vertex.capitalize()
        return f"{self.pin.name or self.pin.title.capitalize()}, {vertex}"

    def _copies(self) -> dict[str, tuple[str, str]]:
        """What can be copied, by the names of the entries: their texts, and the contents."""
        mesh, field, place = self.mesh, self.field, self.mesh.vertices[self.vertex]
        copies = {}
        if field is not None and len(field.values) == mesh.n_vertices:
            copies["copy_value"] = "Copy value", plain_text(field.value_text(self.vertex, _DIGITS))
        unit = f" in {mesh.unit}" if mesh.unit else ""
        copies["copy_coordinates"] = f"Copy coordinates{unit}", format_position(place)
        if mesh.voxel != NO_VOXEL:
            voxels = format_position(place / mesh.voxel)
            copies["copy_voxels"] = "Copy coordinates in voxels", voxels
        copies["copy_index"] = "Copy index", str(mesh.file_index(self.vertex))
        return copies

    def _copy(self, text: str) -> None:
        QGuiApplication.clipboard().setText(text)
        self.say(f"Copied: {text}")

    @staticmethod
    def _add(menu: QMenu, name: str, text: str, act: Callable[[], object]) -> None:
        action = menu.addAction(text.replace("&", "&&"))
        action.setObjectName(f"menu_{name}")
        action.triggered.connect(lambda _checked=False: act())

"""Commands that set, move, name, remove, import and export pins, and the menus of vertices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QPoint
from PySide6.QtGui import QColor, QCursor, QGuiApplication
from PySide6.QtWidgets import (
    QApplication,
    QColorDialog,
    QInputDialog,
    QMenu,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import Actions
from meshmash_viewer.app.background import BackgroundIO
from meshmash_viewer.app.opening import Opening, ask
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.pins import PinTable, read_pins
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pins import PIN_COLORS, distinct_name, pin_at
from meshmash_viewer.model.placing import PlacedPins, merged_pins, place_pins
from meshmash_viewer.units import NO_VOXEL, counted, format_position, plain_text

if TYPE_CHECKING:
    from meshmash_viewer.app.dialogs.pin_dialog import PinExportDialog
    from meshmash_viewer.app.panels.profile_panel import ProfilePanel
    from meshmash_viewer.app.second_view import SecondView
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Commands of the context menu next to the mesh, and of the context menu of the table of pins.
_ELSEWHERE = ("reset_camera", "copy_picture", "save_picture")
_IN_LISTS = ("import_pins", "export_pins", "clear_pins")
_TABLES = "Tables (*.csv *.tsv *.txt)"
#: Significant digits of copied values.
_DIGITS = 7


class PinCommands:
    """Commands on the pins of a document."""

    def __init__(self, opening: Opening, actions: Actions, background_io: BackgroundIO) -> None:
        self._opening, self._window = opening, opening.window
        self._document, self._settings = opening.document, opening.settings
        self._actions, self._background_io = actions, background_io
        self._panel: ProfilePanel | None = None

    def connect(self, scene: MeshView, panel: ProfilePanel) -> None:
        """Connect the render and the table of pins, once loaded."""
        self._panel = panel
        scene.menu_requested.connect(self.show_menu)
        panel.pin_pointed.connect(scene.point_at)
        panel.pin_activated.connect(self.fly_to)
        panel.menu_requested.connect(partial(self.show_menu, elsewhere=_IN_LISTS))
        panel.table.renamed.connect(self.rename)

    # -- commands -----------------------------------------------------------------------------

    def pin(self) -> None:
        """Pin the vertex under the pointer, or remove its pin."""
        scene = self._opening.scene
        assert scene is not None
        place = scene.mapFromGlobal(QCursor.pos())
        vertex = scene.pinned_or_at(place.x(), place.y()) if scene.rect().contains(place) else -1
        if vertex >= 0:
            self._document.pins.toggle(vertex)
        else:
            self._document.notices.say("Hold the pointer over the mesh, then press P.")

    def pin_index(self) -> None:
        from meshmash_viewer.app.dialogs.pin_dialog import PinDialog

        mesh = self._document.mesh
        assert mesh is not None
        dialog = PinDialog(mesh, self._window, self._document.pins.placed)
        ask(dialog, lambda: self._pin(mesh, dialog.vertex, dialog.remark))

    def _pin(self, mesh: Mesh, vertex: int, remark: str) -> None:
        if not self._document.is_shown(mesh):
            text = "The vertex was not pinned, because its mesh has been closed."
            self._document.notices.say(text, Severity.WARNING)
        elif (pin := pin_at(self._document.pins.placed, vertex)) is not None:
            named = f", as {pin.name}" if pin.name else ""
            self._document.notices.say(
                f"{mesh.named_vertex(vertex).capitalize()} is pinned already{named}."
            )
        else:
            self._document.pins.toggle(vertex)
            if remark:
                self._document.notices.say(remark)
        self.fly_to(vertex)

    def remove_pin(self) -> None:
        chosen = -1 if self._panel is None else self._panel.chosen_pin
        pin = pin_at(self._document.pins.placed, chosen)
        if pin is not None:
            self._document.pins.toggle(pin.vertex)
        else:
            self._document.notices.say(
                "Hold the pointer over a pin, or choose one in the table of pins."
            )

    def import_pins(self) -> None:
        if path := self._opening.ask_for_file("Import pins", _TABLES):
            self.read(path)

    def read(self, path: Path) -> None:
        mesh = self._document.mesh
        if mesh is None:
            text = "There is no mesh to pin: open the mesh first, then its pins."
            self._document.notices.say(text, Severity.WARNING)
            return
        self._background_io.run(
            f"Reading {path.name}",
            lambda: place_pins(mesh, read_pins(path)),
            lambda placed: self._accept(mesh, placed, f"from {path.name}"),
        )

    def add(self, table: PinTable) -> None:
        """Pin the vertices of a table.

        `InputError` is raised if a vertex does not exist; no vertex is pinned then.
        """
        mesh = self._document.mesh
        if mesh is None:
            raise InputError("no-mesh", "There is no mesh to pin", "open one first")
        placed = place_pins(mesh, table)
        if placed.faults:
            raise placed.faults[0].of("No pin was set, as")
        self._accept(mesh, placed, "")

    def _accept(self, mesh: Mesh, placed: PlacedPins, source: str) -> None:
        """Add imported pins if their mesh is still open, and report the rows left out."""
        document, left_out = self._document, placed.faults
        if not document.is_shown(mesh):
            document.notices.say(
                "No pin was set, because its mesh has been closed.", Severity.WARNING
            )
            return
        count = counted(len(placed.pins), "pin") if placed.pins else "No pin"
        sentences = [f"{count} imported {source}.".replace(" .", ".")]
        if placed.pins:
            pins, remark = merged_pins(document.pins.placed, placed.pins)
            document.pins.set("import of pins", pins)
            sentences += [*placed.remarks, *filter(None, [remark])]
        if left_out:
            rest = f"{counted(len(left_out), 'row')} left out, such as {left_out[0]}"
            sentences.append(rest if len(left_out) > 1 else f"Left out is {left_out[0]}")
        if source or len(sentences) > 1:
            severity = Severity.WARNING if left_out else Severity.INFORMATION
            document.notices.say(" ".join(sentences), severity)

    def export_pins(self) -> None:
        from meshmash_viewer.app.dialogs.pin_dialog import PinExportDialog

        dialog = PinExportDialog(self._document, self._settings.folder, self._window)
        ask(dialog, lambda: self._start_export(dialog))

    def _start_export(self, dialog: PinExportDialog) -> None:
        self._settings.folder = dialog.path.parent
        self._document.work.write(dialog.path, dialog.export())

    def fly_to(self, vertex: int) -> None:
        """Move the camera so that a vertex is in the middle of the render."""
        scene = self._opening.scene
        if scene is not None and self._document.is_shown(scene.mesh):
            scene.centre_on(vertex)

    # -- one pin ------------------------------------------------------------------------------

    def rename(self, vertex: int, name: str, document: Document | None = None) -> None:
        """Rename the pin of a vertex; if the name is taken, append a number and show a message."""
        document = document or self._document
        pin = pin_at(document.pins.placed, vertex)
        if pin is None:
            return
        wanted = distinct_name(name, ())
        name = distinct_name(name, [each.name for each in document.pins.placed if each is not pin])
        if name != pin.name:
            document.pins.change("name of a pin", vertex, name=name)
            if name != wanted:
                document.notices.say(f"There is a pin called {wanted} already: this one is {name}.")

    def ask_for_name(self, document: Document, vertex: int) -> None:
        pin = pin_at(document.pins.placed, vertex)
        if pin is None:
            return
        dialog = theme.named(QInputDialog(self._window), "rename_dialog", "Name of the pin")
        dialog.setWindowTitle("Rename pin")
        dialog.setLabelText(f"Name of the pin of {document.named_vertex(vertex)}; empty for none")
        dialog.setTextValue(pin.name)
        ask(dialog, lambda: self.rename(vertex, dialog.textValue(), document))

    def ask_for_color(self, document: Document, vertex: int) -> None:
        pin = pin_at(document.pins.placed, vertex)
        if pin is None:
            return
        dialog = theme.named(QColorDialog(QColor(pin.color), self._window), "color_dialog")
        dialog.setWindowTitle(f"Colour of {pin.title}")
        for at, color in enumerate(PIN_COLORS):
            dialog.setCustomColor(at, QColor(color))
        ask(dialog, lambda: _recolor(document, vertex, dialog.selectedColor()))

    # -- menus --------------------------------------------------------------------------------

    def show_menu(self, vertex: int, place: QPoint, elsewhere: Sequence[str] = _ELSEWHERE) -> None:
        """Show the menu of a vertex, or for -1 a menu of the commands `elsewhere`."""
        document, mesh, controller = self._document, self._document.mesh, self._opening.controller
        if mesh is None:
            return
        if vertex < 0:
            menu = theme.named(QMenu(self._window), "render_menu", "Menu of the render")
            menu.addActions([self._actions[name] for name in elsewhere])
        else:
            field = None if controller is None else controller.field
            menu = self._vertex_menu(document, vertex, field, self.fly_to)
        _open(menu, place)

    def show_second_menu(self, second: SecondView, vertex: int, place: QPoint) -> None:
        """Show the menu of a vertex of the second mesh."""
        document, field = second.document, second.controller.field
        if document.mesh is None or vertex < 0:
            return
        _open(self._vertex_menu(document, vertex, field, second.scene.centre_on), place)

    def _vertex_menu(
        self,
        document: Document,
        vertex: int,
        field: Field | None,
        centre: Callable[[int], object],
    ) -> QMenu:
        """Return the menu of a vertex, with entries for its pin and the displayed field, if any.

        The ``objectName`` of an entry is ``menu_<name>``.
        """
        toggle = document.pins.toggle
        mesh, pin = document.mesh, pin_at(document.pins.placed, vertex)
        assert mesh is not None
        menu = theme.named(QMenu(self._window), "vertex_menu", "Menu of the vertex")

        def add(name: str, text: str, act: Callable[[], object]) -> None:
            action = menu.addAction(text.replace("&", "&&"))
            action.setObjectName(f"menu_{name}")
            action.triggered.connect(lambda _checked=False: act())

        def add_copy(name: str, text: str, content: str) -> None:
            def copy() -> None:
                QGuiApplication.clipboard().setText(content)
                self._document.notices.say(f"Copied: {content}")

            add(f"copy_{name}", f"Copy {text}: {content}", copy)

        title, place = mesh.named_vertex(vertex), mesh.vertices[vertex]
        if pin is None:
            menu.addAction(title.capitalize()).setEnabled(False)
            menu.addSeparator()
            add("pin", "Pin here", partial(toggle, vertex))
        else:
            title = f"{pin.name or pin.title.capitalize()}, {title}"
            menu.addAction(title).setEnabled(False)
            menu.addSeparator()
            add("unpin", f"Unpin {pin.title}", partial(toggle, vertex))
            add("rename", "Rename…", partial(self.ask_for_name, document, vertex))
            add("recolor", "Colour…", partial(self.ask_for_color, document, vertex))
        add("centre", "Centre here", partial(centre, vertex))
        menu.addSeparator()
        if field is not None and len(field.values) == mesh.n_vertices:
            add_copy("value", "value", plain_text(field.value_text(vertex, _DIGITS)))
        unit = f" in {mesh.unit}" if mesh.unit else ""
        add_copy("coordinates", f"coordinates{unit}", format_position(place))
        if mesh.voxel != NO_VOXEL:
            add_copy("voxels", "coordinates in voxels", format_position(place / mesh.voxel))
        add_copy("index", "index", str(mesh.file_index(vertex)))
        return menu


def _recolor(document: Document, vertex: int, color: QColor) -> None:
    if color.isValid():
        document.pins.change("colour of a pin", vertex, own_color=color.name().upper())


def _open(menu: QMenu, place: QPoint) -> None:
    menu.aboutToHide.connect(menu.deleteLater)
    menu.popup(place)


def close_menus() -> None:
    """Close the open menus, because their entries refer to a mesh that has been replaced."""
    while isinstance(menu := QApplication.activePopupWidget(), QMenu):
        menu.close()

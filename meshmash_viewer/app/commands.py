"""Implementation of the commands of the window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QMessageBox

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS, Actions, Command
from meshmash_viewer.app.arrangement import Arrangement
from meshmash_viewer.app.background import BackgroundIO, say_saved
from meshmash_viewer.app.controls.field_events import settle_typing
from meshmash_viewer.app.opening import Opening, ask
from meshmash_viewer.app.pictures import Pictures
from meshmash_viewer.app.pin_commands import PinCommands
from meshmash_viewer.app.view.camera import DIRECTIONS, view_label
from meshmash_viewer.fields.table import FAR
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import request_of, step
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.notices import Failure, Notice, Severity, notice_of
from meshmash_viewer.model.script import Exported, reproduction_script, script_output
from meshmash_viewer.spectral import cost
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.controller import Controller
    from meshmash_viewer.app.cutting import Cutting
    from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
    from meshmash_viewer.app.point_tool import PointTool
    from meshmash_viewer.app.select_tool import SelectTool
    from meshmash_viewer.model.pieces import Pieces

#: Checkable commands that set the attribute of the display of the same name.
_SHOWN = ("nodal_lines", "label_borders", "label_graph", "hide_small")
#: Commands whose keys are handled by the focused input field, if any.
_OF_FIELDS = ("cancel", "undo", "redo")


class Commands:
    """Dispatcher of the commands: calls the method named like the command.

    The method belongs to this class, a tool, `opening`, `pictures`, `pins`, document or render.
    """

    def __init__(
        self,
        opening: Opening,
        actions: Actions,
        arrangement: Arrangement,
        background_io: BackgroundIO,
    ) -> None:
        self._opening, self._window = opening, opening.window
        self._document, self._settings = opening.document, opening.settings
        self._actions, self._arrangement = actions, arrangement
        self._background_io = background_io
        self._export_ending = ""
        self._exported: Exported | None = None
        self.pictures = Pictures(opening, background_io)
        self.pins = PinCommands(opening, actions, background_io)
        opening.pins_requested.connect(self.pins.read)
        #: The tools, None until the render is made.
        self.select_tool: SelectTool | None = None
        self.cutting: Cutting | None = None
        self.point_tool: PointTool | None = None
        document, display = self._document, self._document.display
        #: Functions of the commands whose function has another name.
        self._calls: dict[str, Callable[..., object]] = {
            "quit": self._window.close,
            "reset_layout": arrangement.reset,
            **{name: partial(setattr, display, name) for name in _SHOWN},
            "play": partial(setattr, display, "playing"),
            "show_kind": partial(setattr, display, "kind"),
            "first": partial(step, document, -FAR),
            "last": partial(step, document, FAR),
            "undo": document.history.undo,
            "redo": document.history.redo,
            "compute": document.solve.compute,
            "compute_selection": lambda: document.take_part(
                document.selection.mask, then_compute=True
            ),
            "compute_whole": partial(document.take_part, None, then_compute=True),
            "clear_pins": document.pins.clear,
            "grow_selection": document.selection.grow,
            "shrink_selection": document.selection.shrink,
            "invert_selection": document.selection.invert,
            "clear_selection": document.selection.clear,
        }
        for each in COMMANDS:
            actions[each.name].triggered.connect(
                lambda checked=False, each=each: self._do(each, checked)
            )

    def cancel(self) -> None:
        """Cancel the running job; if there is none, clear the selection."""
        if self._document.work.job is not None:
            self._document.work.cancel()
        else:
            self._document.selection.clear()

    def step(self, steps: int) -> None:
        step(self._document, steps)

    def _do(self, command: Command, checked: bool) -> None:
        # an action is disabled some milliseconds after its condition ceases to hold
        if command.needs not in self.met_needs():
            return
        if command.name not in _OF_FIELDS and not settle_typing():
            return
        name, given = command.does or (command.name, checked)
        act = self.method(name)
        if command.does or command.checkable:
            act(given)
        else:
            act()
        if name in ("show_kind", "similar"):
            self._arrangement.show_field()

    def method(self, name: str) -> Callable[..., object]:
        tools = self.select_tool, self.point_tool, self.cutting
        own = self, *tools, self._opening, self.pictures, self.pins
        owners = *own, self._document, self._opening.scene
        return self._calls.get(name) or next(
            getattr(owner, name) for owner in owners if hasattr(owner, name)
        )

    def met_needs(self) -> set[str]:
        """Return the values of `Command.needs` whose condition holds."""
        document = self._document
        ready, spectrum = document.ready, document.spectrum
        selected, pinned = document.selection.mask is not None, bool(document.pins.placed)
        # whether values are signed depends on the mesh, so read the family of the request
        request = request_of(document)
        lined = request is None or request.family.signed or request.family.contoured
        shown = self._opening.scene is not None and ready is not None
        some = shown and spectrum is not None and len(spectrum) > 0
        known = {
            "": True,
            "mesh": ready is not None,
            "render": shown,
            "spectrum": some,
            "small components": ready is not None and ready.small is not None,
            "second mesh": self._opening.pair is not None,
            "hidden": document.hidden is not None,
            "cut": shown and document.display.cut.shown,
            "selection": selected,
            "part": document.part_mesh is not None,
            "target": document.solve.can_compute,
            "job or selection": selected or document.work.job is not None,
            "undo": bool(document.history.undo_label),
            "redo": bool(document.history.redo_label),
            "pins": pinned,
            "pins and spectrum": pinned and spectrum is not None,
            "sign": some and document.can_flip,
            "lines": some and lined,
        }
        return {name for name, holds in known.items() if holds}

    def refresh(self) -> None:
        """Update the enabled and checked state of all actions."""
        document, display, actions = self._document, self._document.display, self._actions
        actions.enable(self.met_needs())
        tool, history = self.select_tool, document.history
        actions["select"].setChecked(tool is not None and tool.on)
        for name, label in (("undo", history.undo_label), ("redo", history.redo_label)):
            actions[name].setText(f"{name.capitalize()} {label}".rstrip())
        for name in DIRECTIONS:
            actions[f"view_{name}"].setText(view_label(name, document.mesh))
        for name in _SHOWN:
            actions[name].setChecked(getattr(display, name))
        actions["cut"].setChecked(display.cut.shown)
        actions["play"].setChecked(display.playing)
        for mode in theme.Mode:
            actions[f"theme_{mode.value}"].setChecked(theme.mode() is mode)

    # -- saving -------------------------------------------------------------------------------

    def export(self) -> None:
        self._export(self._document, self._opening.controller)

    def export_second(self) -> None:
        if (second := self._opening.second_view) is not None:
            self._export(second.document, second.controller)

    def _export(self, document: Document, controller: Controller | None) -> None:
        from meshmash_viewer.app.dialogs.export_dialog import ExportDialog

        folder, ending = self._settings.folder, self._export_ending
        shown = _shown_map(document, controller)
        dialog = ExportDialog(document, folder, self._window, ending, shown)
        ask(dialog, lambda: self._start_export(document, dialog))

    def _start_export(self, document: Document, dialog: ExportDialog) -> None:
        export = dialog.export()
        self._export_ending = dialog.format.ending
        self._settings.folder = export.path.parent
        if export.family is not None and document is self._document:
            mesh, family = export.mesh.content_hash, export.family
            self._exported = Exported(mesh, family, export.n_pairs, export.maps)
        document.work.write(export.path, export)

    def compute_in_pieces(self) -> None:
        from meshmash_viewer.app.dialogs.export_dialog import PiecesDialog

        dialog = PiecesDialog(self._document, self._settings.folder, self._window)
        ask(dialog, lambda: self._compute_pieces(dialog.pieces()))

    def _compute_pieces(self, pieces: Pieces) -> None:
        document, mesh = self._document, pieces.mesh

        def fail(failure: Failure) -> Notice:
            notice = notice_of(failure)
            if failure.code != "seams-differ":
                return notice
            again = partial(self._compute_pieces, replace(pieces, accept_seams=True))
            return replace(notice, action=again, button="Accept the seams")

        document.work.request(
            Job(
                "Computing",
                f"{mesh.name or 'the mesh'} in pieces",
                pieces,
                receive=partial(document.maps.grow, mesh),
                needed=partial(document.is_shown, mesh),
                failed=fail,
            )
        )

    def save_shape(self, path: Path) -> None:
        from meshmash_viewer.app.shape_source import shape_writer

        if self._document.spectrum is None:  # another mesh has been opened
            text = "The shape was not saved, because its mesh has been closed."
            self._document.notices.say(text, Severity.WARNING)
            return
        self.write(path, shape_writer(self._document, path), "Shape")

    def keep_match(self) -> None:
        """Transfer the field of the first mesh to the second by the match, and add it as a map."""
        pair, controller = self._opening.pair, self._opening.controller
        if pair is not None and controller is not None and controller.field is not None:
            pair.keep(controller.field)

    def save_match(self, path: Path) -> None:
        if (pair := self._opening.pair) is not None:
            self.write(path, lambda: pair.write_match(path), "Match")

    def write(self, path: Path, work: Callable[[], object], what: str) -> None:
        """Write a file in the background, then show a message."""
        written = f"{what} written to {path}."
        self._background_io.run(
            f"Writing {path.name}", work, lambda _: say_saved(self._document, written, path)
        )

    def copy_script(self) -> None:
        script = reproduction_script(self._document, self._opening.pair, self._exported)
        QGuiApplication.clipboard().setText(script)
        text = "Copied a Python script that reproduces what is on screen"
        if output := script_output(self._document):
            text += f" and writes {output}, or the next free name where there is such a file"
        self._document.notices.say(f"{text}.")

    def clear_cache(self) -> None:
        from meshmash_viewer.io.cache import EigenpairCache

        cache = EigenpairCache()
        size = cost.written_bytes(cache.size())
        answer = QMessageBox.question(
            self._window,
            "Clear stored eigenpairs",
            f"Eigenpairs of meshes opened before take {size} on disk. Delete them?\n"
            "They must be computed again when these meshes are opened.",
        )
        if answer == QMessageBox.StandardButton.Yes:
            cache.clear()
            self._document.notices.say(f"Deleted {size} of stored eigenpairs.")

    # -- appearance ---------------------------------------------------------------------------

    def choose_theme(self, mode: theme.Mode) -> None:
        self._settings.theme = mode
        theme.set_mode(mode)
        self.refresh()  # check the action again: a click on the current theme unchecks it

    def full_screen(self, on: bool) -> None:
        (self._window.showFullScreen if on else self._window.showNormal)()

    # -- help ---------------------------------------------------------------------------------

    def help(self) -> None:
        from meshmash_viewer.app.dialogs.help_dialog import HelpDialog

        ask(HelpDialog(self._window))

    def command_palette(self) -> None:
        from meshmash_viewer.app.dialogs.help_dialog import CommandPalette

        CommandPalette(self._window, self._actions).show()

    def system_report(self) -> None:
        from meshmash_viewer.app.view.picture import graphics
        from meshmash_viewer.model.notices import system_report

        scene = self._opening.scene
        drawn = "none yet" if scene is None else graphics(scene.plotter.window_of_vtk)
        QGuiApplication.clipboard().setText(system_report(drawn))
        self._document.notices.say("System report copied: paste it where you report a fault.")

    def about(self) -> None:
        from meshmash_viewer.app.dialogs.help_dialog import AboutDialog

        ask(AboutDialog(self._window))


def _shown_map(document: Document, controller: Controller | None) -> VertexMap | None:
    """Return the displayed field as a map; None for a draft or a field of approximate pairs."""
    field, spectrum = None if controller is None else controller.field, document.spectrum
    if field is None or field.draft:
        return None
    exact = spectrum is None or not spectrum.preview or not field.family.of_pairs
    return field.as_map() if exact else None

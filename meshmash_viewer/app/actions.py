"""Table of the commands of a window, from which menus, toolbar, shortcuts and help are built.

`Actions` makes one ``QAction`` of each command, with the command's name as its ``objectName``;
`commands.Commands` calls the method that implements it.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu, QToolBar

from meshmash_viewer.app import theme
from meshmash_viewer.app.theme import Mode
from meshmash_viewer.app.view.camera import view_label
from meshmash_viewer.arrays import SMALL
from meshmash_viewer.fields import FAMILIES

#: Names of keys in help texts, and a key sequence that contains the key.
_MODIFIERS = {"Ctrl": "Ctrl+A", "Shift": "Shift+A", "Alt": "Alt+A"}
_NAMES = {"PgDn": "PgDown", "PgUp": "PgUp", "Esc": "Esc"}
#: Menus in the order of the menu bar.
MENUS = ("File", "Edit", "View", "Select", "Field", "Inspect", "Help")

#: Modes of the *Select* tool: label and description of each.
SELECT_MODES: dict[str, tuple[str, str]] = {
    "brush": ("Brush", "Select visible vertices with a brush, along the surface"),
    "lasso": ("Lasso", "Draw a line around vertices"),
    "connected": ("Connected", "Click a connected part of a displayed label, or a component"),
    "value": ("By value", "Select a range of the displayed field"),
    "alike": ("Alike", "Select vertices similar to the pinned one, by distance in features"),
}

#: Mouse gestures over the render, and the effect of each, for the help.
MOUSE_HELP: tuple[tuple[str, str], ...] = (
    ("Drag", "Rotate"),
    ("Shift + drag, or right button", "Pan"),
    ("Ctrl + drag", "Roll"),
    ("Wheel, or pinch on a trackpad", "Zoom to the pointer"),
    ("Ctrl + wheel", "Next or previous eigenfunction, time or column"),
    ("Double click", "Centre the point of the surface under the pointer, and zoom in slightly"),
    ("Middle click", "Centre the surface under the pointer"),
    ("Move", "Read index and value of the vertex under the pointer"),
    ("Click", "Pin the vertex under the pointer, or remove its pin"),
    ("Drag a pin", "Move the pin along the surface"),
    ("Drag the ball of the clipping plane, or its arrow", "Move or turn the plane"),
    ("Drag with Select on", "Select; Shift adds to the selection, Alt removes from it"),
    ("Middle button with Select on, or Ctrl + drag", "Rotate"),
    ("Right click", "Open the menu of a vertex, of a pin or of the render"),
    ("Drop a file", "Open the file, or add its values per vertex or its points to the mesh"),
    ("Drop a mesh on the right half of the window", "Compare the dropped mesh with the open mesh"),
    ("Drop values per vertex on the second mesh", "Add the values to the second mesh"),
)


@dataclass(frozen=True)
class Command:
    """A command of the window.

    Attributes
    ----------
    shortcuts : tuple of str
        Key sequences in Qt's portable form. They follow the sequences of `standard` on this
        operating system; menus show the first sequence only.
    toolbar, icon : str
        Label on the toolbar ("" if it has no button there), and a key of `theme.ICONS`.
    separated : bool
        Whether a separator precedes the command in menu and toolbar.
    needs : str
        The condition under which the command is enabled, see `Commands.met_needs`; "" for always.
    does : tuple of str and object, optional
        Name and argument of the method that implements the command; by default the method `name`.
    """

    name: str
    text: str
    menu: str
    tooltip: str
    shortcuts: tuple[str, ...] = ()
    checkable: bool = False
    toolbar: str = ""
    icon: str = ""
    separated: bool = False
    needs: str = ""
    submenu: str = ""
    does: tuple[str, object] | None = None
    standard: QKeySequence.StandardKey | None = None

    def sequences(self) -> list[QKeySequence]:
        """Return the key sequences of the command on this operating system."""
        standard = [] if self.standard is None else QKeySequence.keyBindings(self.standard)
        own = [QKeySequence(text) for text in self.shortcuts]
        return [*standard, *(each for each in own if each not in standard)]


COMMANDS: tuple[Command, ...] = (
    # -- File
    Command("open_mesh", "Open mesh…", "File", "Open a mesh file", ("Ctrl+O",),
            toolbar="Open", icon="open"),
    Command("open_link", "Open link…", "File",
            "Open a segment of a Neuroglancer layer by its link and id: precomputed, Graphene",
            ("Ctrl+L",)),
    Command("open_sample", "Dendrite", "File",
            "Open a piece of a dendrite with spines, in nm", submenu="Open a sample"),
    *(Command(f"open_sample_{name}", text, "File", f"Open {tooltip}", submenu="Open a sample",
              does=("open_sample", name))
      for name, text, tooltip in (
          ("neuron", "Neuron with a soma", "a small neuron with soma, dendrites and axon, in nm"),
          ("cow", "Cow", "a four-legged body, in mm"),
          ("sphere", "Sphere", "the unit sphere, with eigenvalues l (l + 1), each 2 l + 1 times"),
      )),
    Command("compare_with", "Compare with…", "File",
            "Open a second mesh next to this one: linked views, spectra, matching vertices",
            ("Ctrl+Shift+D",), needs="render"),
    Command("end_comparison", "Close the second mesh", "File",
            "Leave the first mesh alone in the window", needs="second mesh"),
    Command("add_map", "Add map…", "File",
            "Add values per vertex of this mesh from files: thickness, activity, labels",
            needs="render"),
    Command("open_points", "Open points…", "File",
            "Draw synapses or other points of a table over the mesh: CSV, Parquet, Feather",
            needs="render"),
    Command("open_session", "Open session…", "File",
            "Open a session file: a mesh with its settings, pins and camera",
            ("Ctrl+Shift+O",), separated=True),
    Command("save_session", "Save session…", "File",
            "Save mesh, settings, pins and camera in a session file", ("Ctrl+S",), needs="mesh"),
    Command("export", "Export…", "File",
            "Write features, eigenpairs or maps of this mesh to a file", ("Ctrl+E",),
            toolbar="Export", icon="export", separated=True, needs="render"),
    Command("save_picture", "Save picture…", "File",
            "Save the render for a paper or a talk: width in mm, text and bars as vectors",
            ("Ctrl+Shift+S",), toolbar="Picture", icon="picture", needs="render"),
    Command("gallery", "Gallery…", "File",
            "Show all columns of this family side by side, and save a picture of them",
            ("Ctrl+Shift+G",), needs="spectrum"),
    Command("save_movie", "Save movie…", "File",
            "Make a movie of the columns of this family, or of the turning mesh",
            ("Ctrl+Shift+M",), needs="render"),
    Command("save_scene", "Save scene…", "File",
            "Save the mesh with its field as glTF, or as a web page",
            needs="render"),
    Command("copy_picture", "Copy picture", "File", "Copy the render, or both, to the clipboard",
            ("Ctrl+Shift+C",), needs="render"),
    Command("copy_script", "Copy script", "File",
            "Copy a Python script that reproduces what is on screen", ("Ctrl+Alt+C",),
            needs="mesh"),
    Command("quit", "Quit", "File", "Close the window and stop its tasks", ("Ctrl+Q",),
            separated=True),
    # -- Edit
    Command("undo", "Undo", "Edit",
            "Revert the last change of pins, signs, unit, repairs, maps, colours or limits",
            ("Ctrl+Z",), needs="undo"),
    Command("redo", "Redo", "Edit", "Repeat the change that was undone last",
            ("Ctrl+Shift+Z", "Ctrl+Y"), needs="redo"),
    Command("compute", "Compute eigenpairs", "Edit",
            "Compute the eigenpairs requested in the Mesh panel", ("Ctrl+Return",),
            separated=True, needs="target"),
    Command("compute_selection", "Compute on the selection", "Edit",
            "Compute eigenpairs of the selected part alone, with a free boundary",
            needs="selection"),
    Command("compute_whole", "Compute on the whole mesh", "Edit",
            "Return to the eigenpairs of the whole mesh, and compute the missing ones",
            needs="part"),
    Command("compute_in_pieces", "Compute in pieces…", "Edit",
            "Compute features in overlapping pieces, for a mesh too large to be solved whole",
            needs="render"),
    Command("cancel", "Cancel", "Edit",
            "Stop the running task and keep converged eigenpairs, or clear the selection",
            ("Esc",), needs="job or selection"),
    Command("clear_cache", "Clear stored eigenpairs…", "Edit",
            "Delete the eigenpairs kept on disk for meshes opened before", separated=True),
    # -- View
    Command("reset_camera", "Reset camera", "View", "Show the whole mesh", ("R",),
            toolbar="Reset camera", icon="reset", needs="render", separated=True),
    *(Command(f"view_{name}", view_label(name, None), "View", f"Show the mesh {text}", (key,),
              needs="render", submenu="Standard views", does=("look_from", name))
      for name, key, text in (
          ("lateral", "X", "from +x; a hemisphere from outside (lateral)"),
          ("medial", "Shift+X", "from -x; a hemisphere from inside (medial)"),
          ("anterior", "Y", "from +y, the front of a brain (anterior)"),
          ("posterior", "Shift+Y", "from -y, the back of a brain (posterior)"),
          ("dorsal", "Z", "from +z, the top of a brain (dorsal)"),
          ("ventral", "Shift+Z", "from -z, the bottom of a brain (ventral)"),
      )),
    Command("nodal_lines", "Nodal lines", "View",
            "Draw the lines where the field is zero, or at round distances", ("N",),
            checkable=True, needs="lines"),
    Command("label_borders", "Borders of labels", "View",
            "Draw the borders between the labels of the current set, over any field", ("B",),
            checkable=True, needs="mesh"),
    Command("cut", "Cut", "View",
            "Cut the mesh at a plane: drag the ball to move the plane, the arrow to turn it",
            ("C",), checkable=True, needs="render", submenu="Clipping plane"),
    Command("flip_cut", "Other side", "View", "Show the other side of the plane",
            ("Shift+C",), needs="cut", submenu="Clipping plane"),
    *(Command(f"cut_{axis}", f"Across {axis}", "View",
              f"Cut the mesh in the middle, across the {axis} axis", needs="render",
              submenu="Clipping plane", does=("cut_across", axis))
      for axis in "xyz"),
    Command("reset_cut", "Oblique", "View", "Cut the mesh in the middle, half towards the eye",
            needs="render", submenu="Clipping plane"),
    Command("label_graph", "Graph of labels", "View",
            "Draw lines between the middles of touching regions of the current label set",
            checkable=True, needs="mesh"),
    Command("hide_small", "Hide small components", "View",
            f"Leave out components with less than {SMALL:.0%} of the area of the largest one",
            checkable=True, needs="small components"),
    Command("theme_system", "Follow the system", "View", "Light or dark, as the desktop",
            checkable=True, submenu="Theme", does=("choose_theme", Mode.SYSTEM)),
    Command("theme_light", "Light", "View", "Always light", checkable=True, submenu="Theme",
            does=("choose_theme", Mode.LIGHT)),
    Command("theme_dark", "Dark", "View", "Always dark", checkable=True, submenu="Theme",
            does=("choose_theme", Mode.DARK)),
    Command("full_screen", "Full screen", "View", "Fill the screen with the window", ("F11",),
            checkable=True, standard=QKeySequence.StandardKey.FullScreen),
    Command("reset_layout", "Reset layout", "View", "Move the panels to their default places"),
    # -- Select
    Command("select", "Select vertices", "Select",
            "Select with the left button instead of rotating; Shift adds, Alt removes", ("W",),
            checkable=True, toolbar="Select", icon="select", needs="render"),
    *(
        Command(f"select_{mode}", f"{text}", "Select", tip, needs="render",
                separated=at == 0, does=("select_with", mode))
        for at, (mode, (text, tip)) in enumerate(SELECT_MODES.items())
    ),
    Command("grow_selection", "Grow", "Select", "Select the neighbours of the selected vertices",
            ("+",), needs="selection", separated=True),
    Command("shrink_selection", "Shrink", "Select", "Remove the border of the selection",
            ("-",), needs="selection"),
    Command("fill_selection", "Fill holes", "Select",
            "Add the parts of the mesh that the selection encloses",
            needs="selection"),
    Command("invert_selection", "Invert", "Select", "Select the other vertices", ("Ctrl+I",),
            needs="render"),
    Command("clear_selection", "Clear", "Select", "Clear the selection (also Esc)",
            needs="selection"),
    Command("hide_selection", "Hide the selection", "Select",
            "Hide the selected vertices and their faces, which cannot be clicked then", ("H",),
            needs="selection", separated=True),
    Command("isolate_selection", "Isolate the selection", "Select",
            "Hide all vertices except the selected ones", ("I",), needs="selection"),
    Command("show_all", "Show all", "Select",
            "Show all hidden vertices and small components", ("Shift+H",), needs="hidden"),
    # -- Field
    Command("play", "Play", "Field", "Step through eigenfunctions, times or columns automatically",
            ("Space",), checkable=True, needs="spectrum"),
    Command("next", "Next", "Field", "The next eigenfunction, time or column", ("Right",),
            separated=True, needs="spectrum", does=("step", 1)),
    Command("previous", "Previous", "Field", "The previous eigenfunction, time or column",
            ("Left",), needs="spectrum", does=("step", -1)),
    Command("next_ten", "Ten on", "Field", "Ten eigenfunctions, times or columns on", ("PgDown",),
            needs="spectrum", does=("step", 10)),
    Command("previous_ten", "Ten back", "Field", "Ten eigenfunctions, times or columns back",
            ("PgUp",), needs="spectrum", does=("step", -10)),
    Command("first", "First", "Field", "The first eigenfunction, time or column", ("Home",),
            needs="spectrum"),
    Command("last", "Last", "Field",
            "The last converged eigenfunction, or the last time or column", ("End",),
            needs="spectrum"),
    Command("flip", "Flip sign", "Field",
            "Draw the eigenfunction with the opposite sign, which is equally valid", ("F",),
            separated=True, needs="sign"),
    *(
        Command(f"show_{name}", family.label, "Field", family.tip,
                (str(at),) if at < 10 else (),
                separated=at == 1, needs="mesh", does=("show_kind", name))
        for at, (name, family) in enumerate(FAMILIES.items(), 1)
    ),
    # -- Inspect
    Command("pin", "Pin vertex under the pointer", "Inspect",
            "Pin the vertex under the pointer, or remove its pin", ("P",), needs="render"),
    Command("pin_index", "Go to vertex or position…", "Inspect",
            "Pin a vertex by its index, or the vertex nearest to a position, and centre on it",
            ("Ctrl+G",), needs="mesh"),
    Command("remove_pin", "Remove pin", "Inspect",
            "Remove the pin under the pointer, or the pin chosen in the table of pins", ("Del",),
            needs="pins"),
    Command("clear_pins", "Clear pins", "Inspect", "Take all pins away", ("Shift+P",),
            needs="pins"),
    Command("import_pins", "Import pins…", "Inspect",
            "Pin the vertices of a table (CSV): by index, or by x, y, z, with names and colours",
            needs="mesh", separated=True),
    Command("export_pins", "Export pins…", "Inspect",
            "Write the pins with positions, names, features and distances to a table (CSV)",
            needs="pins"),
    Command("similar", "Similar to this", "Inspect",
            "Paint the distance in feature space from the vertex pinned last", ("S",),
            needs="pins and spectrum", separated=True),
    # -- Help
    Command("command_palette", "Find a command…", "Help",
            "Find a command, a setting or a field by its name or purpose", ("Ctrl+K",)),
    Command("help", "Help and shortcuts", "Help", "All commands, keys and mouse gestures",
            ("F1",), toolbar="Help", icon="help", separated=True),
    Command("system_report", "Copy system report", "Help",
            "Copy versions, memory, graphics and stored eigenpairs, to paste into a report"),
    Command("about", "About MeshMash Viewer", "Help", "Version, licence and methods"),
)  # fmt: skip


class Actions:
    """The actions of a window for all commands; their shortcuts work in the whole window."""

    def __init__(self, window: QMainWindow) -> None:
        self._actions: dict[str, QAction] = {}
        for each in COMMANDS:
            action = QAction(each.text, window)
            action.setObjectName(each.name)
            action.setShortcuts(each.sequences())
            action.setShortcutContext(Qt.ShortcutContext.WindowShortcut)
            keys = f" ({native_keys(action.shortcut())})" if each.sequences() else ""
            action.setToolTip(f"{each.tooltip}{keys}")
            action.setStatusTip(each.tooltip)
            action.setIconText(each.toolbar or each.text.rstrip("…"))
            action.setCheckable(each.checkable)
            action.setMenuRole(_ROLES.get(each.name, QAction.MenuRole.NoRole))
            window.addAction(action)
            self._actions[each.name] = action
        self.refresh_icons()

    def __getitem__(self, name: str) -> QAction:
        return self._actions[name]

    def enable(self, met: Collection[str]) -> None:
        """Enable the commands whose needs are met."""
        for each in COMMANDS:
            if each.needs:
                self._actions[each.name].setEnabled(each.needs in met)

    def refresh_icons(self) -> None:
        for each in COMMANDS:
            if each.icon:
                self._actions[each.name].setIcon(theme.icon(each.icon))

    def fill_menus(self, window: QMainWindow) -> dict[str, QMenu]:
        """Fill the menu bar of a window; return its menus and submenus by name."""
        menus: dict[str, QMenu] = {}
        taken = set("il")  # the underline of these narrow letters would be too short to see
        for name in MENUS:
            at = next(at for at, letter in enumerate(name.lower()) if letter not in taken)
            taken.add(name[at].lower())
            menus[name] = window.menuBar().addMenu(f"{name[:at]}&{name[at:]}")
        for each in COMMANDS:
            menu = menus[each.menu]
            if each.separated:
                menu.addSeparator()
            if each.submenu:
                if each.submenu not in menus:
                    menus[each.submenu] = menu.addMenu(each.submenu)
                menu = menus[each.submenu]
            menu.addAction(self._actions[each.name])
        return menus

    def fill_toolbar(self, toolbar: QToolBar) -> None:
        for each in COMMANDS:
            if each.toolbar:
                if each.separated and toolbar.actions():
                    toolbar.addSeparator()
                toolbar.addAction(self._actions[each.name])

    def fit_toolbar(self, toolbar: QToolBar, width: int) -> None:
        """Hide the text of as few toolbar buttons as needed for the toolbar to fit a width."""
        for name in _BY_ICON:
            self._actions[name].setPriority(QAction.Priority.NormalPriority)
        for name in _BY_ICON:
            if toolbar.sizeHint().width() <= width:
                return
            self._actions[name].setPriority(QAction.Priority.LowPriority)


#: Commands whose buttons lose their text if the toolbar is too wide, in this order.
_BY_ICON = ("help", "reset_camera", "save_picture", "export")
_ROLES = {"quit": QAction.MenuRole.QuitRole, "about": QAction.MenuRole.AboutRole}


def native_keys(*sequences: QKeySequence | str) -> str:
    """Return key sequences, given in Qt's portable form, as the operating system writes them."""
    return ", ".join(_native(QKeySequence(each)) for each in sequences)


def native_text(text: str) -> str:
    """Replace key names in a text ("Ctrl + wheel") by the names on this operating system."""
    for name, sequence in _MODIFIERS.items():
        native = _native(QKeySequence(sequence)).removesuffix("A").rstrip("+")
        text = re.sub(rf"\b{name}(?= \+)", native, text)
    for name, sequence in _NAMES.items():
        native = _native(QKeySequence(sequence))
        text = re.sub(rf"\b{name}\b", native, text)
    return text


def _native(sequence: QKeySequence) -> str:
    return sequence.toString(QKeySequence.SequenceFormat.NativeText)

"""Maps of a document: added from files and results, renamed, restored and removed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from psygnal import Signal

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.regions import label_map
from meshmash_viewer.fields.maps import CURVATURES, OwnMaps
from meshmash_viewer.io.session import KeptMaps
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.history import History
from meshmash_viewer.model.notices import Notices, Severity
from meshmash_viewer.model.open_mesh import MapGrew, OpenMesh, Shown
from meshmash_viewer.model.pins import distinct_name
from meshmash_viewer.units import counted, power_unit
from meshmash_viewer.vertex_map import VertexMap

#: Largest number of map names in a message.
_NAMED = 4


class Maps:
    """The maps of the open mesh, with methods that add, rename and remove maps."""

    #: Files to read, and the arguments `shown` and `labels` of `open`.
    requested = Signal(object, bool, bool)
    #: Former and new name of a map; emitted before views are refreshed.
    renamed = Signal(str, str)

    def __init__(
        self, opened: OpenMesh, display: Display, history: History, notices: Notices
    ) -> None:
        self._opened, self._display = opened, display
        self._history, self._notices = history, notices
        #: Names of the maps in the mesh file itself.
        self.in_file: frozenset[str] = frozenset()
        #: Names of maps of files that were changed or renamed; a session stores these maps.
        self.edited: frozenset[str] = frozenset()
        #: Files of the last session that are still being read.
        self.pending: tuple[Path, ...] = ()
        #: Names of the maps that the last session stored, and of all its maps in their order.
        self._kept: frozenset[str] = frozenset()
        self._names: tuple[str, ...] = ()
        #: The map that is being computed, and its mesh.
        self._growing: VertexMap | None = None
        self._mesh: Mesh | None = None
        #: The displayed family and map; and by map, the family and map that were displayed before.
        self._shown = display.kind, ""
        self._former: dict[str, tuple[str, str]] = {}
        #: Maps that were removed while they were displayed, also by undo.
        self._removed: set[str] = set()
        display.events.connect(self._note_shown)
        history.keep("edited maps", lambda: self.edited, self._put_edited, alongside="mesh")

    def _put_edited(self, edited: frozenset[str]) -> None:
        self.edited = edited

    def begin(self, mesh: Mesh) -> None:
        """Reset the state for another mesh, whose maps are all in its file."""
        self.in_file = frozenset(each.name for each in mesh.maps)
        self.edited, self.pending, self._kept, self._names = frozenset(), (), frozenset(), ()
        self._former, self._removed = {}, set()

    @property
    def names(self) -> list[str]:
        """Names of the maps in their order, including maps of `pending` files."""
        mesh = self._opened.mesh
        names = [] if mesh is None else [each.name for each in mesh.maps]
        return list(dict.fromkeys([*self._names, *names])) if self.pending else names

    def sort(self, names: Sequence[str]) -> None:
        """Sort the maps in the order of `names`, also maps added later from `pending` files."""
        self._names, mesh = tuple(names), self._opened.mesh
        if mesh is not None and self._sorted(mesh) is not mesh:
            self._put(self._sorted(mesh))

    def _sorted(self, mesh: Mesh) -> Mesh:
        places = {name: at for at, name in enumerate(self._names)}
        maps = sorted(mesh.maps, key=lambda each: places.get(each.name, len(places)))
        return mesh if maps == list(mesh.maps) else mesh.with_only_maps(*maps)

    def _is_there(self, now: Mesh, read: VertexMap) -> bool:
        """Return whether a map that is read for the last session is already in the mesh."""
        if read.name in self.edited:
            return True
        if self._names and read.name in self._kept:
            return True  # the session stored another map of this name
        if read.name in self.in_file and any(_is_numbered(at, read.name) for at in self._kept):
            return True
        return any((each.name, each.path) == (read.name, read.path) for each in now.maps)

    def _same(self, now: Mesh, read: VertexMap) -> str:
        """Return the name of a map of the last session that equals a map of a file, or ""."""
        of = (each for each in now.maps if each.name in self._kept)
        return next((each.name for each in of if read.path and _are_equal(each, read)), "")

    def open(self, paths: Sequence[Path], *, shown: bool = True, labels: bool = False) -> None:
        """Request to read files with values per vertex.

        For `shown` and `labels` see `add`.
        """
        if self._opened.ready is None:
            names = ", ".join(path.name for path in paths) or "a map"
            text = f"There is no mesh to put {names} on: open the mesh first, then its maps."
            self._notices.say(text, Severity.WARNING)
        elif paths:
            paths = tuple(path.absolute() for path in paths)
            if not shown:
                self.pending = paths
            self.requested.emit(paths, shown, labels)

    def add(
        self,
        mesh: Mesh,
        maps: Sequence[VertexMap],
        *,
        shown: bool = True,
        labels: bool = False,
        colors: tuple[float, ...] = (),
    ) -> None:
        """Add maps of a mesh, if the mesh is still open, and show the last map.

        `colors` is the entry of `OwnMaps.colors` of the last map. With `labels`, maps of whole
        numbers become label sets, and the last set is shown; without a set, a notice says why.

        Without `shown`, the maps belong to the last session: adding them is not recorded, undo of
        earlier steps does not remove them, and maps that were changed since then are left out.
        """
        now = self._still(mesh)
        if now is None:
            return
        if not shown:
            self.pending = ()
            maps = [each for each in maps if not self._is_there(now, each)]
        else:
            same = [self._same(now, each) for each in maps]
            maps = [each for each, name in zip(maps, same, strict=True) if not name]
            if same and not maps:
                self.show(same[-1], colors)
        if not maps:
            return
        given, faults = maps, list[str]()
        if labels:
            maps, faults = _as_labels(given)
        more = now.with_maps(*maps)
        added = more.maps[len(now.maps) :]
        # a session stores maps that became label sets or were renamed
        self.edited |= {
            each.name
            for each, was in zip(added, given, strict=True)
            if was.path and (each.name, each.path) != (was.name, was.path)
        }
        if not shown:
            self._history.amend("mesh", partial(_with_more, mesh, maps))
            self._put(self._sorted(more))
            return
        sets = [each for each in added if each.labels]
        self._history.record("new map" if len(maps) == 1 else "new maps", "mesh")
        self._take(more)
        self.show((sets if labels and sets else added)[-1].name, colors)
        self._say_added([each.name for each in added], [] if sets else faults)
        self._opened.spectrum_changed.emit()

    def _say_added(self, names: list[str], faults: list[str]) -> None:
        rest = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        text = f"Added {counted(len(names), 'map')}: {', '.join(names[:_NAMED])}{rest}."
        if faults:
            text += f" There is no label set in it: {faults[0]}"
        self._notices.say(text, Severity.WARNING if faults else Severity.INFORMATION)

    def change(self, label: str, changed: VertexMap) -> None:
        """Replace the map of the same name as one change; `label` completes "Undo …"."""
        mesh = self._opened.mesh
        if mesh is not None:
            if mesh.map_named(changed.name).path or changed.name in self.in_file:
                self.edited |= {changed.name}
            self._put(mesh.with_changed_map(replace(changed, path="")), label)

    def can_rename(self, name: str) -> bool:
        """Return whether a map can be renamed: it has no labels, and is not in the mesh file."""
        mesh = self._opened.mesh
        named = [] if mesh is None else [each for each in mesh.maps if each.name == name]
        return any(name not in self.in_file and not each.labels for each in named)

    def rename(self, name: str, wanted: str) -> None:
        """Rename a map, also in the limits; a number is appended if the new name is taken.

        Nothing changes if `can_rename` is False, or the name is blank. A session stores a renamed
        map of a file.
        """
        mesh, wanted = self._opened.mesh, distinct_name(wanted, ())
        if mesh is None or not self.can_rename(name) or wanted in ("", name):
            return
        taken = {*(each.name for each in mesh.maps), *CURVATURES} - {name}
        given = distinct_name(wanted, taken)
        renamed = (
            replace(each, name=given, path="") if each.name == name else each for each in mesh.maps
        )
        with self._history.together("name of a map"):
            self._history.record("name of a map", "mesh", "policies", "log_scales")
            self._take(mesh.with_only_maps(*renamed))
            self.renamed.emit(name, given)
        with self._history.paused():
            self._rename_choices(name, given)
        self._opened.spectrum_changed.emit()
        if given != wanted:
            self._notices.say(f"There is a map called {wanted} already: this one is {given}.")

    def _rename_choices(self, name: str, given: str) -> None:
        """Move the choice, colours and limits of a map to its new name."""
        display = self._display
        maps, keys = display[OwnMaps], [OwnMaps(chosen=each).limits_key for each in (name, given)]
        colors = tuple((given if each == name else each, ends) for each, ends in maps.colors)
        chosen = given if maps.chosen == name else maps.chosen
        display.put(replace(maps, chosen=chosen, colors=colors))
        display.set_limits(display.policies.get(keys[0]), keys[1])
        display.set_log_scale(display.log_scales.get(keys[0]), keys[1])
        display.set_limits(None, keys[0])
        display.set_log_scale(None, keys[0])

    def follow(self, before: Mesh, now: Mesh) -> None:
        """Follow maps that undo or redo has renamed, removed or added again."""
        former, names = ({each.name for each in mesh.maps} for mesh in (before, now))
        new = [each for each in now.maps if each.name not in former]
        for known in (each for each in before.maps if each.name not in names):
            for same in new:
                if np.array_equal(same.values, known.values, equal_nan=True):
                    self._rename_choices(known.name, same.name)
        again = [each.name for each in new if each.name in self._removed]
        self._removed.difference_update(again)
        if again:
            self.show(again[-1])
        self._leave_removed()

    def exchange(self, label: str, names: Collection[str], maps: Sequence[VertexMap]) -> None:
        """Replace maps by others as one change; without `label`, as part of the last change."""
        mesh = self._opened.mesh
        if mesh is not None:
            for name in names:
                mesh = mesh.without_map(name)
            self._put(mesh.with_maps(*maps), label)

    def is_made_here(self, known: VertexMap) -> bool:
        """Return whether a map was made in this program, not read from a file."""
        return not known.path and known.name not in self.in_file | self.edited

    @property
    def unsaved(self) -> KeptMaps:
        """The maps of the mesh whose current values or names are in no file."""
        mesh = self._opened.mesh
        assert mesh is not None
        maps = (
            each
            for each in mesh.maps
            if each.name in self.edited or not (each.path or each.name in self.in_file)
        )
        return KeptMaps(tuple(maps), mesh.content_hash, sorted(self.edited))

    def restore(self, mesh: Mesh, maps: Sequence[VertexMap], edited: Collection[str]) -> None:
        """Add the maps of a session; maps named in `edited` replace maps of the mesh file."""
        now = self._still(mesh)
        if now is not None:
            for each in maps:
                if any(_are_equal(each, known, numbered=False) for known in now.maps):
                    continue
                if each.name in edited and each.name in self.in_file:
                    now = now.with_changed_map(each)
                else:
                    now = now.with_maps(each)
            self.edited |= frozenset(edited)
            self._kept |= {each.name for each in maps}
            self._put(self._sorted(now))

    def remove(self, name: str) -> None:
        """Remove a map from the mesh; its file stays."""
        if self._opened.mesh is not None:
            self._put(self._opened.mesh.without_map(name), "removal of a map")
            self._leave_removed()

    def grow(self, mesh: Mesh, grew: MapGrew) -> None:
        """Add values to the map that is being computed, and show it; missing values are NaN."""
        shown = self.settled()
        if shown is None or self._still(mesh) is None:
            return
        if self._growing is None:
            self._mesh, name = mesh, grew.name
            values = np.full(mesh.n_vertices, np.nan, dtype=np.float32)
        else:
            name, values = self._growing.name, np.array(self._growing.values)
        values[grew.vertices] = grew.values
        grown = VertexMap(name, values, unit=power_unit(mesh.unit, -2))
        more = shown.ready.mesh.with_maps(grown)
        self._growing = more.maps[-1]  # its name may have a number appended
        self._take(more)
        self.show(self._growing.name)
        self._opened.spectrum_changed.emit()

    def end_growing(self, whole: bool) -> None:
        """Keep the computed map if it is complete; else remove it and show the former family."""
        shown, grown = self.settled(), self._growing
        if shown is None or grown is None or self._mesh is None:
            return
        kept = whole and self._still(self._mesh) is not None
        if kept:
            self._history.record("new map", "mesh")
        self._growing, self._mesh, settled = None, None, shown.ready.mesh
        self._take(settled.with_maps(grown) if kept else settled)
        self._opened.spectrum_changed.emit()
        self._leave_removed()

    @property
    def chosen(self) -> str:
        """Name of the map that is displayed with the family of maps; "" for the first map."""
        return self._display[OwnMaps].chosen

    @property
    def displayed(self) -> str:
        """Name of the displayed map; "" while another family is displayed."""
        return self.chosen if self._display.kind == OwnMaps.name else ""

    def show(self, name: str, colors: tuple[float, ...] = ()) -> None:
        """Display a map; `colors` replaces its entry of `OwnMaps.colors`."""
        maps = self._display[OwnMaps]
        if colors:
            maps = replace(maps, colors=tuple({**dict(maps.colors), name: colors}.items()))
        with self._history.paused():
            self._display.show(replace(maps, chosen=name, view="map"))

    def _note_shown(self) -> None:
        """Store the field that was displayed before the displayed map."""
        name = "" if self.is_missing(self.displayed) else self.displayed
        shown = self._display.kind, name
        if shown != self._shown:
            if name and not self.is_missing(self._shown[1]):
                self._former[name] = self._shown
            self._shown = shown

    def _leave_removed(self) -> None:
        """Display the former field if the displayed map is no longer in the mesh."""
        while (name := self.displayed) in self._former and self.is_missing(name):
            kind, chosen = self._former.pop(name)
            self._removed.add(name)
            if chosen:
                self.show(chosen)
            else:
                self._display.kind = kind

    def is_missing(self, name: str) -> bool:
        """Return whether the mesh has no map of a name."""
        mesh = self._opened.mesh
        maps = () if mesh is None else mesh.maps
        return bool(name) and name not in {*(each.name for each in maps), *CURVATURES}

    def settled(self) -> Shown | None:
        """The open mesh with its spectrum, without the map that is being computed."""
        shown = self._opened.shown
        if shown is None or self._growing is None:
            return shown
        mesh = shown.ready.mesh.without_map(self._growing.name)
        return replace(shown, ready=replace(shown.ready, mesh=mesh))

    def _still(self, mesh: Mesh) -> Mesh | None:
        """Return the open mesh if it has the vertices of `mesh`, else None."""
        now = self._opened.mesh
        return now if now is not None and now.vertices is mesh.vertices else None

    def _put(self, mesh: Mesh, label: str = "") -> None:
        """Replace the mesh by one with other maps; record the change if there is a label."""
        if label:
            self._history.record(label, "mesh")
        self._take(mesh)
        self._opened.spectrum_changed.emit()

    def _take(self, mesh: Mesh) -> None:
        assert self._opened.ready is not None
        self._opened.take(replace(self._opened.ready, mesh=mesh), self._opened.spectrum)


def _as_labels(maps: Sequence[VertexMap]) -> tuple[list[VertexMap], list[str]]:
    """Convert maps of whole numbers to label sets; return all maps, and failures."""
    result, faults = list[VertexMap](), list[str]()
    for each in maps:
        try:
            found = label_map(each)
        except InputError as fault:
            found = each
            faults.append(str(fault))
        result.append(found)
    return result, faults


def _is_numbered(name: str, taken: str) -> bool:
    """Return whether a name consists of `taken` and a number."""
    return name.startswith(f"{taken} ") and name.removeprefix(taken).strip().isdigit()


def _are_equal(one: VertexMap, read: VertexMap, *, numbered: bool = True) -> bool:
    """Return whether two maps are equal; if `numbered`, the name of `one` may have a number."""
    named = one.name == read.name or (numbered and _is_numbered(one.name, read.name))
    about = (one.unit, one.labels) == (read.unit, read.labels)
    same = one.values.shape == read.values.shape
    return named and about and same and np.array_equal(one.values, read.values, equal_nan=True)


def _with_more(mesh: Mesh, maps: Sequence[VertexMap], former: object) -> object:
    """Return a state of the mesh in the history, with maps added."""
    if not isinstance(former, Shown) or former.ready.mesh.vertices is not mesh.vertices:
        return former
    ready = replace(former.ready, mesh=former.ready.mesh.with_maps(*maps))
    return replace(former, ready=ready)

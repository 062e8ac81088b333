"""Label sets of a document: named and coloured parts of the surface, made from the selection."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial, wraps
from itertools import count
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, unknown
from meshmash_viewer.features.regions import Regions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.history import History
from meshmash_viewer.model.jobs import Job, Queueing, Work
from meshmash_viewer.model.maps import Maps
from meshmash_viewer.model.notices import Notice, Notices, Severity
from meshmash_viewer.model.open_mesh import OpenMesh
from meshmash_viewer.model.pins import PIN_COLORS, checked_color, distinct_name
from meshmash_viewer.model.selection import Hiding, Selection
from meshmash_viewer.progress import Progress
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import Label, VertexMap
from meshmash_viewer.work import Channel, JobResult

_Act = TypeVar("_Act", bound=Callable[..., None])
#: Pattern of the names of predicted label sets.
_PREDICTED = re.compile(r"class( \d+)*")


def _said(act: _Act) -> _Act:
    """Show the `InputError` of a method, raised before any change, as a notice."""

    @wraps(act)
    def acting(self: Labels, *given: Any) -> None:
        try:
            act(self, *given)
        except InputError as fault:
            self._notices.say(str(fault), Severity.WARNING)

    return acting  # type: ignore[return-value]


def _measure(
    mesh: Mesh, labels: VertexMap, maps: tuple[VertexMap, ...], whole: bool, channel: Channel
) -> JobResult:
    """Measure `Regions`, whose mesh the window has; the content is columns, rows and remarks."""
    from meshmash_viewer.features.regions import regions

    channel.report(Progress("regions", message="Measuring the regions"))
    found = regions(mesh, labels, maps, whole=whole)
    remark = f"Regions: {' '.join(found.remarks)}" if found.remarks else ""
    return JobResult((found.columns, found.rows, found.remarks), remark)


class Labels:
    """The label sets of the open mesh, one of which is current.

    A set is a map with labels, see `VertexMap`. Every change is a step of the history.
    """

    #: Emitted for another current set or other regions; for contents see `spectrum_changed`.
    changed = Signal()

    def __init__(
        self,
        opened: OpenMesh,
        maps: Maps,
        selection: Selection,
        hiding: Hiding,
        display: Display,
        notices: Notices,
        work: Work,
        history: History,
    ) -> None:
        self._opened, self._maps = opened, maps
        self._selection, self._hiding = selection, hiding
        self._notices, self._work = notices, work
        self._chosen = ""
        #: The last measured regions, these regions with counts of points, and their label set.
        self.measured: Regions | None = None
        self.regions: Regions | None = None
        self.regions_of: VertexMap | None = None
        #: Returns the set from which a prediction was learned, or None; set by `Classes`.
        self.source_of: Callable[[VertexMap], VertexMap | None] = lambda _: None
        history.keep("label set", lambda: self._chosen, self._restore, alongside="mesh")
        display.events.connect(self._follow)
        opened.mesh_changed.connect(self._drop_regions)

    # -- sets ---------------------------------------------------------------------------------

    @property
    def sets(self) -> tuple[VertexMap, ...]:
        """The label sets of the mesh."""
        mesh = self._opened.mesh
        return () if mesh is None else tuple(each for each in mesh.maps if each.labels)

    @property
    def current(self) -> VertexMap | None:
        """The set that was chosen or displayed last, else the first; None without a set."""
        sets = {each.name: each for each in self.sets}
        return sets.get(self._chosen, next(iter(sets.values()), None))

    @property
    def current_is_displayed(self) -> bool:
        """Whether the current set is the displayed map."""
        known = self.current
        return known is not None and self._maps.displayed == known.name

    @property
    def predicted(self) -> VertexMap | None:
        """The last predicted set, see `Classes`; None without a prediction."""
        return next(filter(self.is_predicted, reversed(self.sets)), None)

    def is_predicted(self, known: VertexMap) -> bool:
        return bool(_PREDICTED.fullmatch(known.name)) and self._maps.is_made_here(known)

    def choose(self, name: str, *, displayed: bool = True) -> None:
        """Make a set the current one, and display it; the mesh may get the set later."""
        self._chosen = name
        if displayed:
            self._maps.show(name)
        self.changed.emit()

    def _restore(self, name: str) -> None:
        """Choose a set again, and display it if a set or a removed map is displayed."""
        shown, names = self._maps.displayed, [each.name for each in self.sets]
        shows = shown in names or self._maps.is_missing(shown)
        self.choose(name, displayed=shows and name in names)

    def _follow(self) -> None:
        """Make the displayed set the current set."""
        name = self._maps.displayed
        if name != self._chosen and name in (each.name for each in self.sets):
            self.choose(name, displayed=False)

    @_said
    def new_set(self) -> None:
        """Add a set with one label without vertices, and display it."""
        mesh = self._opened.mesh
        if mesh is None:
            raise InputError("no-mesh", "There is no mesh to label", "open one first")
        first = Label(1, "label 1", PIN_COLORS[0])
        self._maps.add(mesh, [VertexMap("labels", np.zeros(mesh.n_vertices), (first,))])

    @_said
    def remove_set(self) -> None:
        """Remove the current set from the mesh; its file stays."""
        self._maps.remove(self._set.name)

    # -- labels -------------------------------------------------------------------------------

    @_said
    def new_label(self) -> None:
        """Add a label in the next colour, or a set if there is none."""
        known = self.current
        if known is None:
            self.new_set()
            return
        taken = [label.name for label in known.labels]
        key = max(0, int(known.values.max()), *(label.key for label in known.labels)) + 1
        numbered = (f"label {number}" for number in count(len(taken) + 1))
        name = next(each for each in numbered if each not in taken)
        added = Label(key, name, _free_color(known.labels))
        self._change("new label", labels=(*known.labels, added))

    @_said
    def rename(self, key: int, name: str) -> None:
        """Rename a label; a number is appended if the name is taken."""
        taken = [label.name for label in self._set.labels if label.key != key]
        wanted = distinct_name(name, ())
        if not wanted:
            raise InputError("missing-argument", "A label needs a name", "type one")
        name = distinct_name(name, taken)
        self._change_one("name of a label", key, name=name)
        if name != wanted:
            self._notices.say(f"There is a label called {wanted} already: this one is {name}.")

    @_said
    def recolor(self, key: int, color: str) -> None:
        """Set the colour of a label, "#rrggbb"."""
        self._change_one("colour of a label", key, color=checked_color(color))

    @_said
    def lock(self, key: int, locked: bool) -> None:
        """Lock or unlock a label; vertices of a locked label cannot be assigned to another."""
        self._change_one("lock of a label" if locked else "unlocking", key, locked=locked)

    @_said
    def join(self, keys: Sequence[int]) -> None:
        """Assign the vertices of some labels to the first label, and remove the other labels."""
        if len(keys) < 2:
            raise InputError(
                "no-labels", "Two or more labels are needed", "choose them in the list"
            )
        self._refuse_locked(keys)
        self._merge("joining of labels", keys[1:], keys[0])

    @_said
    def delete(self, keys: Collection[int]) -> None:
        """Remove labels from their vertices and the set; remove a set without labels."""
        known = self._set
        if not keys:
            raise InputError("no-labels", "No label is chosen", "choose labels in the list")
        self._refuse_locked(keys)
        if {label.key for label in known.labels} <= set(keys):
            self._maps.remove(known.name)
        else:
            self._merge("removal of a label", keys, known.no_label)

    # -- the selection ------------------------------------------------------------------------

    @_said
    def assign(self, key: int | None) -> None:
        """Assign the selected vertices to a label, or remove their labels (None).

        For a prediction, the labels it was learned from are changed, and displayed. Vertices of
        locked labels do not change. A notice states the number of locked vertices, and
        the number of changed vertices if another field is displayed.
        """
        mask = self._selection.mask
        if mask is None:
            text = "Nothing is selected: select vertices, then assign them to a label."
            selection = self._selection
            self._notices.show(Notice(text, Severity.WARNING, holds=lambda: selection.mask is None))
            return
        known = self._painted()
        to = known.no_label if key is None else self._label(key).key
        changing = mask & (known.values != to)
        kept = changing & np.isin(known.values, [each.key for each in known.labels if each.locked])
        changing &= ~kept
        said = list[str]()
        if n_kept := int(np.count_nonzero(kept)):
            vertices = f"{counted(n_kept, 'vertex')} of locked labels"
            said += [f"{vertices} unchanged: unlock the label in the Labels panel to change that"]
        if n_given := int(np.count_nonzero(changing)):
            step = "removal from labels" if key is None else "labels"
            self._change(step, values=np.where(changing, to, known.values))
            how = "taken out of the labels" if key is None else f"given to {self._label(key).name}"
            if not self.current_is_displayed:  # the change is not visible
                said += [f"{counted(n_given, 'vertex')} {how} of {known.name}"]
        if said:
            self._notices.say(f"{'; '.join(said)}.")

    @_said
    def assign_nth(self, number: int) -> None:
        """Assign the selected vertices to the label at a position of the list, from 1."""
        labels = self._painted().labels
        if number > len(labels):
            fault = f"There is no label {number}, as there are {counted(len(labels), 'label')}"
            raise InputError("unknown-name", fault, "make one with New label")
        self.assign(labels[number - 1].key)

    @_said
    def select(self, keys: Collection[int]) -> None:
        """Select the vertices of some labels."""
        self._selection.set(self._mask(keys), "selection of a label")

    @_said
    def show(self, keys: Collection[int], shown: bool) -> None:
        """Show the vertices of some labels, or hide them."""
        mask, hidden = self._mask(keys), self._hiding.mask
        if not shown:
            self._hiding.hide(mask)
        elif hidden is not None:
            self._hiding.set(hidden & ~mask, "showing of a label")

    @_said
    def isolate(self, keys: Collection[int]) -> None:
        """Hide all vertices but those of some labels."""
        self._hiding.isolate(self._mask(keys))

    # -- regions ------------------------------------------------------------------------------

    def measure_regions(self, maps: tuple[VertexMap, ...] = (), *, whole: bool = False) -> None:
        """Request a measurement of the regions of the current set; see `features.regions`."""
        mesh, known = self._opened.mesh, self.current
        if mesh is not None and known is not None:
            self._work.request(
                Job(
                    "Measuring the regions of",
                    mesh.name,
                    partial(_measure, mesh, known, maps, whole),
                    partial(self._accept_regions, mesh.with_only_maps(*maps), known),
                    queueing=Queueing.COMPLETE,
                )
            )

    def _accept_regions(
        self, measured: Mesh, labels: VertexMap, found: tuple[Any, Any, tuple[str, ...]]
    ) -> None:
        """Store the measured regions of a set, if its mesh is still open."""
        mesh = self._opened.mesh
        if mesh is not None and mesh.vertices is measured.vertices:
            self.regions_of = labels
            columns, rows, remarks = found
            self.measured = Regions(columns, rows, measured, remarks)
            self.accept_counts(self.measured, self.measured)

    def accept_counts(self, measured: Regions, counted: Regions) -> None:
        """Store `counted`, regions with counts of points, if `measured` is the last measurement."""
        if measured is self.measured and counted is not self.regions:
            self.regions = counted
            self.changed.emit()

    def _drop_regions(self) -> None:
        mesh = self._opened.mesh
        before = None if self.regions is None else self.regions.mesh.vertices
        if before is not None and (mesh is None or mesh.vertices is not before):
            self.regions = self.regions_of = self.measured = None
            self.changed.emit()

    # -- details ------------------------------------------------------------------------------

    @property
    def _set(self) -> VertexMap:
        if (known := self.current) is None:
            raise InputError("no-labels", "There is no label set", "make one with New label")
        return known

    def _painted(self) -> VertexMap:
        """Return the set whose vertices are assigned, and make it the current set."""
        known = self._set
        source = self.source_of(known) if self.is_predicted(known) else None
        if source is None:
            return known
        self.choose(source.name, displayed=self.current_is_displayed)
        return source

    def _label(self, key: int) -> Label:
        labels = {label.key: label for label in self._set.labels}
        if key not in labels:
            raise unknown("label", key, labels)
        return labels[key]

    def _mask(self, keys: Collection[int]) -> npt.NDArray[np.bool_]:
        """Return the mask of the vertices with some labels, shape (n,)."""
        mask = np.isin(self._set.values, list(keys))
        if not mask.any():
            raise InputError("no-labels", "No vertex has this label yet", "assign vertices first")
        return mask

    def _refuse_locked(self, keys: Iterable[int]) -> None:
        for label in map(self._label, keys):
            if label.locked:
                raise InputError("label-locked", f"Label {label.name} is locked", "unlock it first")

    def _merge(self, what: str, keys: Collection[int], to: int) -> None:
        """Assign the vertices of some labels to label number `to`, and remove these labels."""
        known = self._set
        labels = tuple(label for label in known.labels if label.key not in keys)
        given = np.isin(known.values, list(keys))
        self._change(what, labels=labels, values=np.where(given, to, known.values))

    def _change_one(self, what: str, key: int, **attributes: Any) -> None:
        before = self._label(key)
        after = replace(before, **attributes)
        if after != before:
            labels = (after if each is before else each for each in self._set.labels)
            self._change(what, labels=tuple(labels))

    def _change(self, what: str, **changes: Any) -> None:
        """Change the current set; a changed prediction gets a name of its own, and so stays."""
        if "values" in changes:
            changes["values"].flags.writeable = False  # the map keeps this array
        known, shown = self._set, self.current_is_displayed
        if not self.is_predicted(known):
            self._maps.change(what, replace(known, **changes))
            return
        name = f"{known.name}, edited"
        self._maps.exchange(what, [known.name], [replace(known, name=name, **changes)])
        assert self._opened.mesh is not None
        self.choose(self._opened.mesh.maps[-1].name, displayed=shown)


class LabelSizes(NamedTuple):
    """Number of vertices, area and hiding of each label, in the order of the set."""

    counts: IntArray
    areas: FloatArray
    hidden: npt.NDArray[np.bool_]


def label_sizes(mesh: Mesh, known: VertexMap, hidden: Mask | None = None) -> LabelSizes:
    """Measure the labels of a set; a label is hidden if all its vertices are hidden."""
    places = known.shown
    has = np.isfinite(places)
    at, n_labels = places[has].astype(np.int64), len(known.labels)
    counts = np.bincount(at, minlength=n_labels)
    areas = np.bincount(at, mesh.vertex_areas[has], n_labels)
    n_hidden = np.zeros(n_labels) if hidden is None else np.bincount(at, hidden[has], n_labels)
    gone = (counts > 0) & (n_hidden == counts)
    return LabelSizes(counts.astype(np.int64), areas.astype(np.float64), gone)


def _free_color(labels: Sequence[Label]) -> str:
    """Return the first unused colour of `PIN_COLORS`; repeat colours if all are used."""
    taken = {label.color.upper() for label in labels}
    free = (color for color in PIN_COLORS if color not in taken)
    return next(free, PIN_COLORS[len(labels) % len(PIN_COLORS)])

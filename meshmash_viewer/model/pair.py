"""Two linked meshes: the second displays the field that is displayed on the first.

The comparison is independent of size: times and eigenvalues are scaled by the ratio of the areas.
Values are scaled, too, while limits are linked (`Pair.shown_field`). Meshes of one template
(`corresponding_vertices`) are matched by vertex index, other meshes by features of their vertices.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import chain

from meshmash_viewer.features.comparison import SCORE
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.display import Cut
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.model.matching import MatchedDocuments
from meshmash_viewer.model.notices import Severity
from meshmash_viewer.structures import brain_side
from meshmash_viewer.surface.rays import Plane
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap

#: Links of the cameras with their labels; "free" if neither "camera" nor "mirror" is active.
CAMERAS = {"camera": "Linked", "mirror": "Mirrored", "free": "Free"}
#: The other links with their labels.
LINKS = {"kind": "Family", "position": "Index, time, band", "colors": "Colours and limits"}
#: Attributes of the display that the second mesh takes from the first, by link; "" for always.
_LINKED = {
    "kind": ("kind",),
    "colors": ("policies", "log_scales", "diverging_colormap", "sequential_colormap"),
    "": ("nodal_lines", "hide_small"),
}


class Pair(MatchedDocuments):
    """Two linked documents, of which the second follows the first."""

    def __init__(self, first: Document, second: Document) -> None:
        super().__init__(first, second)
        #: Active links: keys of `LINKS`, and "camera" or "mirror" of `CAMERAS`. To change them, use
        #: `link`, `link_cameras` or `set_links`.
        self.links: frozenset[str] = frozenset()
        #: Maps that were carried from one mesh to the other, in either direction.
        self.carried: tuple[VertexMap, ...] = ()
        #: By name: the family of the first mesh that was last applied to the second, before and
        #: after `Family.filled_in`.
        self._applied: dict[str, tuple[Family, Family]] = {}
        first.pins.partner, second.pins.partner = second.pins, first.pins
        keep = second.history.keep
        keep("links", lambda: (self.links, self._by_side), self._put_links)
        keep("match", lambda: self.match, lambda match: setattr(self, "match", match))
        events = first.display.events
        self._connections = [
            *(
                (getattr(events, name), self._apply_display)
                for name in chain(("fields", "cut"), *_LINKED.values())
            ),
            (first.pins.changed, self._follow_pins),
            (second.pins.changed, self._follow_pins),
            (first.spectrum_changed, self._follow_spectra),
            (second.spectrum_changed, self._follow_spectra),
            (second.mesh_changed, self._follow_mesh),
            (second.work.changed, self._follow_job),
            (second.display.events.kind, self._follow_second),
            (first.maps.renamed, self._rename_carried),
        ]
        for signal, slot in self._connections:
            signal.connect(slot)
        self.set_links(None)

    def close(self) -> None:
        """Disconnect from both documents, and remove the second from the history."""
        for signal, slot in self._connections:
            signal.disconnect(slot)
        self.first.pins.partner = self.second.pins.partner = None
        self.second.history.close()

    # -- choices ------------------------------------------------------------------------------

    def link(self, name: str, on: bool) -> None:
        """Activate or deactivate one of `LINKS`; deactivation does not change the second mesh."""
        self._record_links()
        self.links = self.links | {name} if on else self.links - {name}
        self._apply_display(everything=True)
        self.changed.emit()

    @property
    def cameras(self) -> str:
        """Link of the cameras: a key of `CAMERAS`."""
        return next((name for name in CAMERAS if name in self.links), "free")

    def link_cameras(self, how: str) -> None:
        """Set the link of the cameras to a key of `CAMERAS`."""
        self._record_links()
        self.links = self.links - set(CAMERAS) | {how} - {"free"}
        self._by_side = False
        self._apply_display()
        self.changed.emit()

    def _record_links(self) -> None:
        """Record links, and what the second mesh displays, since linking it replaces that."""
        self.second.history.record("link", "links", *self.second.displayed.parts)

    def _put_links(self, links: tuple[frozenset[str], bool]) -> None:
        self.links, self._by_side = links
        self.changed.emit()

    def set_links(self, links: Collection[str] | None) -> None:
        """Activate exactly these links; None for all, with cameras mirrored for two hemispheres."""
        self.links = frozenset({"camera", *LINKS} if links is None else links)
        self._by_side = links is None
        self._apply_display(everything=True)
        self._follow_mesh()

    def _follow_mesh(self) -> None:
        """Mirror the cameras of a left and a right hemisphere, unless the user chose their link."""
        meshes = self.first.mesh, self.second.mesh
        sides = {brain_side(mesh.structure, mesh.name) for mesh in meshes if mesh is not None}
        if self._by_side:
            how = "mirror" if sides == {"left", "right"} else "camera"
            self.links = self.links - set(CAMERAS) | {how}
            self._apply_display()
        self._follow_spectra()

    def carry(self, on: bool) -> None:
        """Show the field of the first mesh on the second, or the own field of the second."""
        self.second.history.record("match", "match")
        self.carries = on
        self.changed.emit()

    def keep(self, field: Field) -> None:
        """Add a field of the first mesh, transferred by the match, to the maps of the second."""
        other, found = self.second.mesh, self.carried_from
        if other is not None and found is not None:
            self.second.maps.add(other, [field.carried(found.back.indices).as_map()])

    def carry_maps(self, *, to_first: bool = False) -> None:
        """Add the maps of one mesh and the score of each vertex to the other mesh, as one change.

        Maps carried before are replaced; a map is left out if the other mesh has another map of its
        name. The other mesh then shows the map chosen on the source mesh, or the last carried map.
        If families are linked, so does the first mesh.
        """
        source, target = (self.second, self.first) if to_first else (self.first, self.second)
        found, here, there = self.carried_from, source.mesh, target.mesh
        if found is None or here is None or there is None:
            return
        carried = {id(each) for each in self.carried}
        before = [each.name for each in there.maps if id(each) in carried]
        known = {SCORE, *(each.name for each in there.maps)} - {*before}
        own = [each for each in here.maps if each.name not in known]
        if not own:
            name, other = here.name or "This mesh", there.name or "the other"
            text = f"{name} has no map that {other} lacks: add one, or keep what is shown as a map."
            self.first.notices.say(text, Severity.WARNING)
            return
        chosen = source.maps.chosen or here.maps[0].name
        own.sort(key=lambda each: each.name == chosen)  # the last map is shown
        *maps, score = found.carried(own, back=not to_first)
        if before:
            target.maps.exchange("carried maps", before, [score, *maps])
            target.notices.say(f"Replaced {counted(len(before), 'map')} by those of this match.")
        else:
            target.maps.add(there, [score, *maps])
        assert target.mesh is not None
        target.maps.show(own[-1].name)
        self.carried += target.mesh.maps[-len(maps) - 1 :]
        if "kind" in self.links:
            self.first.maps.show(own[-1].name)

    def _rename_carried(self, name: str, given: str) -> None:
        """Rename the carried copy, or the original, of a renamed map in the same step."""
        first, mesh = self.first.mesh, self.second.mesh
        known = next((each for each in mesh.maps if each.name == name), None) if mesh else None
        if first is None or mesh is None or known is None:
            return
        renamed, copied = first.map_named(given), any(each is known for each in self.carried)
        if not copied and not any(
            each.name == name and each.values.tobytes() == renamed.values.tobytes()
            for each in self.carried
        ):
            return
        self.second.maps.rename(name, given)
        assert self.second.mesh is not None
        self.carried += (self.second.mesh.maps[mesh.maps.index(known)] if copied else renamed,)

    def shown_field(self, first: Field, second: Field) -> tuple[Field, Limits] | None:
        """Return the field to show on the second mesh, and colour limits for both fields.

        With `carries`, this is the field of the first mesh, transferred by the match. Otherwise it
        is the second field, with limits that contain the limits of both fields under the current
        policy. Values that depend on the size of the mesh are scaled to the area of the first
        (`Field.at_size`).

        Returns
        -------
        tuple of Field and Limits, or None
            None if each mesh has its own limits, because the link is off, families, signs or units
            differ, or a field consists of labels.
        """
        if self.carries and (found := self.carried_from) is not None:
            limits, _ = first.colors(self.first.display)
            return first.carried(found.back.indices), limits
        key, display = first.family.limits_key, self.first.display
        if "colors" not in self.links or key != second.family.limits_key:
            return None
        policy, logarithmic = display.policies.get(key), display.log_scales.get(key)
        second.limits(policy)  # cached before values are scaled
        second = second.at_size(self.correspondence.length, first.request.unit)
        if (first.unit, first.signed) != (second.unit, second.signed):
            return None
        if first.labels or second.labels:
            return None
        lows, highs = zip(first.limits(policy), second.limits(policy), strict=True)
        if logarithmic is None:
            logarithmic = first.spans_decades or second.spans_decades
        return second, first.scaled((min(lows), max(highs)), logarithmic)

    def _apply_display(self, *, everything: bool = False) -> None:
        """Copy changed, linked attributes of the display of the first mesh to the second."""
        mine, other, known = self.first.display, self.second.display, self.first.known
        with self.second.history.paused():  # a change of the first mesh
            other.cut = self._other_side(mine.cut)
            if known is None:
                return
            moved = []
            for name, family in mine.fields.items():
                before, was = self._applied.get(name, (None, None))
                if family is not before or everything:
                    shown = family.filled_in(known, mine.fields)
                    self._applied[name] = family, shown
                    moved.append(self._carried_family(shown, was, other.fields[name]))
            other.put(*moved)
            for link, names in _LINKED.items():
                if not link or link in self.links:
                    for name in names:
                        setattr(other, name, getattr(mine, name))

    def _carried_family(self, shown: Family, was: Family | None, other: Family) -> Family:
        """Return the family for the second mesh, which has `other` now; `was` was applied last."""
        kept = [] if "position" in self.links else list(shown.position)
        if was is not None:
            kept += [each for each in shown.own if getattr(was, each) == getattr(shown, each)]
        changes = {each: getattr(other, each) for each in kept}
        return replace(shown.carried(self.correspondence), **changes)

    def cut_second(self, plane: Plane) -> None:
        """Cut both meshes at a plane given for the second."""
        if self.second.mesh is not None:
            cut = Cut.at(plane, self.second.mesh.bounds)
            self.first.display.cut = self._other_side(cut)

    def _other_side(self, cut: Cut) -> Cut:
        """Return the cut for the other mesh, reflected if the cameras are mirrored."""
        x, y, z = cut.normal
        return replace(cut, normal=(-x, y, z)) if self.cameras == "mirror" else cut

    def _follow_second(self) -> None:
        """Display own maps on the first mesh, too, once the second displays them."""
        if "kind" in self.links and self.second.display.family.own:
            self.first.display.kind = self.second.display.kind

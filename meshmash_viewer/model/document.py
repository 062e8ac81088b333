"""The document: the open mesh with pins, selection, labels, maps and display."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import listed_repairs
from meshmash_viewer.io.links import name_and_place
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.classes import Classes
from meshmash_viewer.model.display import Cut, Display, Shape
from meshmash_viewer.model.display_history import DisplayHistory
from meshmash_viewer.model.history import History, Step
from meshmash_viewer.model.jobs import Job, Work, nothing, prepare, prepare_part
from meshmash_viewer.model.labels import Labels
from meshmash_viewer.model.maps import Maps
from meshmash_viewer.model.notices import Failure, Notice, Notices, notice_of
from meshmash_viewer.model.open_mesh import MeshReady, OpenMesh, Shown
from meshmash_viewer.model.pins import Pins, followed_pins, same_vertex
from meshmash_viewer.model.points import DocumentPoints
from meshmash_viewer.model.selection import Hiding, Selection, followed_mask
from meshmash_viewer.model.solve import DEFAULT_TARGET, Solve
from meshmash_viewer.quantities import parse_unit
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.units import counted


@dataclass(frozen=True, eq=False)
class _Repaired:
    """A mesh before one of the repairs that were applied when its file was read."""

    mesh: Mesh
    repairs: tuple[str, ...]


@dataclass(eq=False)
class _Undoing:
    """A pending undo of a step, the repairs of its mesh, and the number of requests."""

    step: Step
    repairs: tuple[str, ...]
    times: int = 1


class Document(OpenMesh):
    """State of a window, and the only copy of the displayed data.

    Views read attributes, connect to signals, and call methods of `pins`, `maps` and the other
    parts. The methods of this class replace the mesh: they open files, repair, and change units.
    """

    def __init__(self, history: History | None = None) -> None:
        super().__init__()
        self.display = Display()
        self.notices = Notices()
        self.work = Work()
        #: Changes by the user of all that a session stores, but for what is displayed.
        self.history = History() if history is None else history
        self.history.keep("mesh", lambda: self.maps.settled(), self._restore_mesh, self._is_ready)
        #: The history of what is displayed and of the options of the solve.
        self.displayed = DisplayHistory(self, self.display, self.history)
        self.pins = Pins(self, self.history)
        self.selection = Selection(self, self.history)
        self.hiding = Hiding(self, self.history)
        self._hidden: tuple[Mask | None, Mask | None, Mask | None] = (None, None, None)
        self.points = DocumentPoints(self, self.history)
        self.maps = Maps(self, self.display, self.history, self.notices)
        self.labels = Labels(
            self,
            self.maps,
            self.selection,
            self.hiding,
            self.display,
            self.notices,
            self.work,
            self.history,
        )
        self.classes = Classes(self, self.maps, self.labels, self.work, self.notices, self.history)
        self.solve = Solve(self, self.work, self.accept_spectrum)
        self.displayed.keep_solve(self.solve)
        self.work.requested.connect(self.notices.begin_turn)
        for signal in (
            self.mesh_changed, self.spectrum_changed, self.pins.changed, self.history.changed,
            self.selection.changed, self.solve.changed, self.work.changed, self.display.events,
        ):  # fmt: skip
            signal.connect(self.notices.review)
        #: The pending undo, whose former mesh is being computed again.
        self._undoing: _Undoing | None = None
        self._file_mesh: Mesh | None = None
        self._preview: Eigenpairs | None = None
        #: Files to open after the mesh that is being read, which a failure of reading leaves out.
        self.following: tuple[Path, ...] = ()

    @property
    def hidden(self) -> npt.NDArray[np.bool_] | None:
        """Mask of the hidden vertices, shape (n,); None if no vertex is hidden."""
        small = self.ready.small if self.ready is not None and self.display.hide_small else None
        chosen = self.hiding.mask
        if small is None or chosen is None:
            return chosen if small is None else small
        if self._hidden[0] is not small or self._hidden[1] is not chosen:
            self._hidden = small, chosen, small | chosen  # identical for identical masks
        return self._hidden[2]

    def hide_selection(self) -> None:
        """Hide the selected vertices with their faces."""
        if self.selection.mask is not None:
            self.hiding.hide(self.selection.mask)

    def isolate_selection(self) -> None:
        """Hide all but the selected vertices."""
        if self.selection.mask is not None:
            self.hiding.isolate(self.selection.mask)

    def show_all(self) -> None:
        """Show all vertices, including small components."""
        self.hiding.show_all()
        self.display.hide_small = False

    # -- requests ---------------------------------------------------------------------------

    def open_mesh(
        self,
        path: str | Path,
        unit: str = "",
        operator: OperatorOptions | None = None,
        maps: Sequence[Path] = (),
        repairs: Sequence[str] = (),
        source: str = "",
        target: Target | None = None,
        then: Callable[[Job], object] = nothing,
    ) -> None:
        """Request to read a mesh file; the open mesh stays until the file has been read.

        `operator` is the Laplacian whose stored eigenpairs are looked up, by default the current
        operator; `maps` are files of maps to add (`Maps.open`). `repairs` are applied in this
        order; `source` is the hash of the content for which they were made, see `prepare`. `target`
        is the part of the spectrum to show if it is stored; else the stored one used last is shown.
        `then` is called once the file is read, or is not going to be.
        """
        path = Path(path).absolute()  # for notices and scripts
        self.following = tuple(maps)
        accept = partial(self._take_mesh, maps=tuple(maps))
        self._prepare(
            "Reading", path, accept, then, self._not_opened, repairs=tuple(repairs), unit=unit,
            hashed=source, target=target, operator=operator or self.solve.operator,
        )  # fmt: skip

    def _prepare(
        self,
        doing: str,
        source: Path | Mesh,
        accept: Callable[[MeshReady], object] | None = None,
        then: Callable[[Job], object] = nothing,
        failed: Callable[[Failure], Notice] = notice_of,
        **asked: Any,
    ) -> None:
        """Request a mesh in a file, or another form of the open mesh, see `prepare`."""
        asked = {"operator": self.solve.operator, **asked}
        if isinstance(source, Path):
            name = name_and_place(source)[0]
        else:
            name, asked = source.name, {"path": self.path, "target": self.solve.target, **asked}
        work = partial(prepare, source, **asked)
        self.work.request(
            Job(doing, name, work, accept or self._take_mesh, then=then, failed=failed)
        )

    def _not_opened(self, failure: Failure) -> Notice:
        names = ", ".join(path.name for path in self.following)
        text = f"{failure.text} Not opened either: {names}." if names else failure.text
        return notice_of(replace(failure, text=text))

    def start_afresh(self, close: Callable[[], object] = lambda: None) -> None:
        """Request to read the open file again, without what was made since, as one change.

        `close` is part of the change, and called once the file is read.
        """

        def take(ready: MeshReady) -> None:
            with self.history.together("fresh start"):
                close()
                self._take_mesh(ready, afresh=True)

        if self.path is not None:
            self._prepare("Reading", self.path, take)

    def take_mesh(self, mesh: Mesh) -> None:
        """Request to show a mesh in memory."""
        self._prepare("Inspecting", mesh, path=None, target=None)

    def set_unit(self, text: str) -> None:
        """Set the unit of the coordinates, or the voxel size of coordinates in voxels.

        The text (see `meshmash_viewer.quantities.parse_unit`) refers to the coordinates in the
        file: "8 nm" given twice scales once, and "nm" after it restores the numbers of the file.
        The spectrum is kept if the voxel size stays the same; otherwise it is computed again.
        `InputError` is raised if the text is not a unit.
        """
        voxel, unit = parse_unit(text)
        if self.ready is None:
            return
        if voxel == self.ready.mesh.voxel:
            if unit == self.unit:
                return
            before = self.unit_text
            self.history.record("change of unit", "mesh")
            self.take(replace(self.ready, mesh=self.ready.mesh.in_unit(unit)), self.spectrum)
            self._emit_all()
            self._announce_unit(before, "the coordinates keep their numbers")
        else:
            self._prepare("Scaling", self._settled().mesh, earlier=self.repairs, unit=text)

    def repair(self, name: str, *, then_compute: bool = False) -> None:
        """Request a repair of `meshmash_viewer.health.REPAIRS`; `then_compute` solves after it."""
        if self.ready is not None:
            ready, then = self._settled(), self._compute_after if then_compute else nothing
            accept = partial(self._take_mesh, keeps_target=then_compute)
            known = ready.repairs
            self._prepare("Repairing", ready.mesh, accept, then, earlier=known, repairs=(name,))

    def _compute_after(self, job: Job) -> None:
        """Decompose the mesh or its part after a repair or the choice of the part."""
        if job.succeeded and self.solve.can_compute:
            self.solve.compute()

    def take_part(self, mask: npt.NDArray[np.bool_] | None, *, then_compute: bool = False) -> None:
        """Request the eigenpairs on a mask of vertices, shape (n,), or on the whole mesh (None).

        Faces with a corner outside the mask are left out, see `Mesh.masked`. Without
        `then_compute`, only stored eigenpairs are used.
        """
        if self.ready is not None:
            mesh, solve, records = self._settled().mesh, self.solve, not self.history.is_paused
            self.work.request(
                Job(
                    "Taking a part of",
                    mesh.name,
                    partial(prepare_part, mesh, mask, solve.operator, solve.target),
                    partial(self.accept_part, computes=then_compute, records=records),
                    needed=partial(self.is_shown, mesh),
                    then=self._compute_after if then_compute else nothing,
                )
            )

    def accept_part(
        self,
        found: tuple[MeshReady | None, Eigenpairs | None],
        *,
        computes: bool = False,
        records: bool = False,
    ) -> None:
        """Show the stored eigenpairs of a part or of the whole mesh (None).

        `computes` states that they are computed next, and `records` whether undo returns.
        """
        part, known = found
        if records:
            parts = "mesh", "selection", "target", *self.displayed.families
            self.history.record("part that is computed", *parts)
        with self.history.paused():
            if computes:
                self.selection.put(None)  # the selection would cover the field
            ready = replace(self._settled(), part=part)
            # a session is restored with its own parameters
            self._take_part(ready, known, resets=records)
            if not computes:
                self._restore_target(known)

    def _take_part(
        self, ready: MeshReady, spectrum: Eigenpairs | None, *, resets: bool = True
    ) -> None:
        self.take(ready, spectrum)
        self._preview = None
        if resets:
            components = (ready.part or ready).health.n_components
            families = self.display.fields.values()
            self.display.put(*(each.for_repair(components) for each in families))
        if self.spectrum is not None and self.spectrum.complete:
            self._go_within(self.spectrum)
        self._emit_all()

    def _settled(self) -> MeshReady:
        shown = self.maps.settled()
        assert shown is not None
        return shown.ready

    # -- history ----------------------------------------------------------------------------

    def undo_repair(self) -> None:
        """Revert the last repair and all changes after it."""
        for _ in range(self.undo_repair_steps):
            self.history.undo()

    @property
    def undo_repair_steps(self) -> int:
        """Number of steps that `undo_repair` reverts; 0 without a repair."""
        labels = [step.label for step in reversed(self.history.past)]
        repair = self.history.label("repair")
        return labels.index(repair) + 1 if repair in labels else 0

    @property
    def file_mesh(self) -> Mesh | None:
        """The mesh as read, before all repairs; its unit may differ from that of the open mesh."""
        return self._file_mesh if self.repairs else self.mesh

    def _offer_undo(self, text: str) -> None:
        """Announce the last change, and offer to undo it until another change is recorded."""
        history, last = self.history, self.history.past[-1:]
        action = history.undo if last else None
        self.notices.show(Notice(text, action=action, holds=lambda: history.past[-1:] == last))

    def _is_ready(self, shown: Shown | _Repaired | None) -> bool:
        """Return whether a former mesh is in memory; else request it, and undo after that."""
        if isinstance(shown, _Repaired) and self.mesh is not None:
            if self._undoing is not None and self.work.job is not None:
                self._undoing.times += 1  # the mesh is being computed already
            else:
                undoing = self._undoing = _Undoing(self.history.past[-1], shown.repairs)
                then, unit = partial(self._end_undoing, undoing), self.unit_text
                self._prepare("Scaling", shown.mesh, None, then, earlier=shown.repairs, unit=unit)
            return False
        return True

    def _restore_mesh(self, shown: Shown | None) -> None:
        now = self.mesh
        if shown is None or now is None:
            return
        if shown.ready.mesh.vertices is not now.vertices:
            self._show(shown.ready, shown.spectrum, now)
            return
        solved = shown.ready.part or shown.ready
        if not self.is_solved(solved.mesh):
            self._take_part(shown.ready, shown.spectrum)
            return
        self.take(shown.ready, self.spectrum)
        self.maps.follow(now, shown.ready.mesh)
        if shown.ready.mesh.unit != now.unit:
            self._emit_all()
        else:
            self.spectrum_changed.emit()

    # -- results ----------------------------------------------------------------------------

    def _take_mesh(
        self,
        ready: MeshReady,
        maps: tuple[Path, ...] = (),
        *,
        keeps_target: bool = False,
        afresh: bool = False,
    ) -> None:
        """Show a mesh, then read maps from files, and request a preview of its eigenpairs."""
        self.accept_mesh(ready, keeps_target=keeps_target, afresh=afresh)
        if maps:
            self.maps.open(maps)
        self.solve.preview(ready)

    def _end_undoing(self, undoing: _Undoing, _: Job) -> None:
        if self._undoing is undoing:
            self._undoing = None

    def accept_mesh(
        self, ready: MeshReady, *, keeps_target: bool = False, afresh: bool = False
    ) -> None:
        """Show a mesh that was read or repaired, with its stored spectrum.

        The target is set to that of the stored spectrum, unless `keeps_target`. With `afresh`,
        everything made on the mesh of the same file is dropped as one change.
        """
        # a length or an eigenvalue does not suit a mesh of another size
        resets = self.solve.target.kind != "count" and not self._measures_as(ready)
        if ready.derived and self.ready is not None:
            self._accept_derived(replace(ready, source=self.ready.source), self.ready.mesh)
        elif afresh and ready.path == self.path:
            self.history.record("fresh start", *self.history.read())
            self._file_mesh = ready.mesh
            with self.history.paused():
                self.maps.begin(ready.mesh)
                self._show(ready, ready.known)
                self.classes.restore()
                self._offer_undo(f"{ready.mesh.name} is as in its file.")
        else:
            self._undoing = None
            self._file_mesh = ready.before[0] if ready.before else None
            self.maps.begin(ready.mesh)
            with self.history.paused():
                self._show(ready, ready.known)
            before = enumerate(ready.before)
            steps = (_Repaired(mesh, ready.repairs[:at]) for at, mesh in before)
            self.history.start(*(("repair", {"mesh": each}) for each in steps))
            if ready.unasked:
                text = f"Repaired as before: {listed_repairs(ready.repairs)}."
                self._offer_undo(text)
        with self.history.paused():
            if resets:
                self.solve.target = DEFAULT_TARGET
            if not keeps_target:
                self._restore_target(ready.known)

    def _restore_target(self, stored: Eigenpairs | None) -> None:
        """Set the target to what was asked for the stored pairs of a mesh."""
        if stored is not None:
            self.solve.target = self.solve.stated(stored)

    def _accept_derived(self, ready: MeshReady, before: Mesh) -> None:
        """Show the open mesh after a repair, its undo, or a change of the voxel size."""
        n_pins, unit = len(self.pins.placed), self.unit_text
        undoing, self._undoing = self._undoing, None
        if undoing is not None and undoing.repairs == ready.repairs:
            parts = {
                "mesh": Shown(ready, ready.known),
                "pins": followed_pins(self.pins.placed, before, ready.mesh),
                "selection": followed_mask(self.selection.mask, before, ready.mesh),
                self.hiding.part: followed_mask(self.hiding.mask, before, ready.mesh),
            }
            followed = self._followed(ready, before)
            parts |= {f"field {each.name}": each for each in followed}
            if self.history.complete(undoing.step, parts):
                for _ in range(undoing.times):
                    self.history.undo()
            return
        repaired = ready.repairs != self.repairs
        if repaired and not self.repairs:
            self._file_mesh = before
        label = "repair" if repaired else "change of unit"
        if self.part_mesh is not None:
            text = f"The {label} needs eigenpairs of the whole mesh; Undo brings the part back."
            self.notices.say(text)
        self.history.record(label, *self.history.read())  # all parts depend on the mesh
        with self.history.paused():
            self._show(ready, ready.known, before)
        self._announce_unit(unit, "lengths are scaled, and eigenpairs change")
        lost = n_pins - len(self.pins.placed)
        if lost:
            where, them = ("a vertex", "it") if lost == 1 else ("vertices", "them")
            text = (
                f"{counted(lost, 'pin')} went with {where} that the repair left out or merged."
                f" Undo brings {them} back."
            )
            self._offer_undo(text)

    def _announce_unit(self, before: str, what: str) -> None:
        if self.unit_text != before:
            text = f"Unit changed from {before} to {self.unit_text}: {what}."
            self._offer_undo(text)

    def _measures_as(self, ready: MeshReady) -> bool:
        """Return whether the mesh is the open one, repaired or read again, with equal voxels."""
        if self.mesh is None:
            return True
        again = ready.derived or (ready.path is not None and ready.path == self.path)
        return again and ready.mesh.voxel == self.mesh.voxel

    def _show(
        self, ready: MeshReady, spectrum: Eigenpairs | None, before: Mesh | None = None
    ) -> None:
        """Show a mesh; pins are mapped from `before`, the previous mesh of the same file."""
        self.notices.begin_turn()
        same_unit = self.mesh is None or self.mesh.unit == ready.mesh.unit
        self.take(ready, spectrum)
        self._preview = None
        pins = self.pins.placed
        self.pins.placed = () if before is None else followed_pins(pins, before, ready.mesh)
        self.selection.follow(before, ready.mesh)
        self.hiding.follow(before, ready.mesh)
        if before is None:
            self.points.drop()
        n_components, display = ready.health.n_components, self.display
        if before is None:
            display.put(
                *(
                    (each if same_unit else each.for_other_unit()).for_other_mesh(n_components)
                    for each in display.fields.values()
                )
            )
        else:
            display.put(*self._followed(ready, before))
        if spectrum is not None and spectrum.complete:
            self._go_within(spectrum)
        if not display.family.usable:
            display.kind = Display().kind
        if not ready.derived:
            display.shape, display.vibrating, display.cut = Shape(), False, Cut()
        self._emit_all()

    def _followed(self, ready: MeshReady, before: Mesh) -> list[Family]:
        """Return the families for the mesh `before` after a repair or with another voxel size."""
        mesh = ready.mesh
        same = (before.unit, before.voxel) == (mesh.unit, mesh.voxel)
        vertex = partial(same_vertex, before, mesh)
        return [
            _repaired(each, ready.health.n_components, vertex, same_size=same)
            for each in self.display.fields.values()
        ]

    def _emit_all(self) -> None:
        self.mesh_changed.emit()
        self.pins.changed.emit()
        self.selection.changed.emit()
        self.hiding.changed.emit()
        self.points.changed.emit()
        self.spectrum_changed.emit()

    def accept_spectrum(self, spectrum: Eigenpairs) -> None:
        """Show a longer spectrum or a preview; preview pairs beyond the exact pairs are kept.

        The first pairs of another request do not replace more pairs, until they are complete.
        """
        known = self.spectrum
        if (
            known is not None
            and not (spectrum.complete or spectrum.preview)
            and known.operator == spectrum.operator
            and len(spectrum) < len(known.exact)
        ):
            return
        if known is not None and not len(spectrum.mass) and known.operator == spectrum.operator:
            spectrum = replace(spectrum, mass=known.mass)  # sent only with the first pairs
        if spectrum.preview and not spectrum.n_exact:
            self._preview = spectrum
            if known is not None and not known.preview and len(known):
                spectrum = known
        preview = self._preview
        if not spectrum.preview and preview is not None and len(spectrum) < len(preview):
            spectrum = spectrum.before(preview)
        self.spectrum = spectrum
        if spectrum.complete:
            self._go_within(spectrum)
        self.spectrum_changed.emit()

    def _go_within(self, spectrum: Eigenpairs) -> None:
        """Clip the position of every family to the range of a spectrum."""
        with self.history.paused():
            self.display.put(*(each.within(spectrum) for each in self.display.fields.values()))

    # -- the displayed family ----------------------------------------------------------------

    def flip(self) -> None:
        """Flip the sign of the displayed eigenfunction."""
        family = self.display.family
        if isinstance(family, Eigenfunctions):
            self.display.put(family.sign_flipped())

    def rotate(self, other: int, degrees: int) -> None:
        """Rotate the chosen eigenfunction towards the eigenfunction `other` of its multiplet."""
        chosen = self.display[Eigenfunctions]
        self.display.change(Eigenfunctions, rotation=(chosen.index, other, degrees))

    @property
    def can_flip(self) -> bool:
        """Whether the displayed field has a sign that can be flipped."""
        return isinstance(self.display.family, Eigenfunctions)

    def similar(self) -> None:
        """Display the similarity of all vertices to the vertex pinned last."""
        if self.pins.placed:
            chosen = self.display[Similarity]
            self.display.show(replace(chosen, vertex=self.pins.placed[-1].vertex))


def _repaired(
    family: Family, n_components: int, vertex: Callable[[int], int | None], *, same_size: bool
) -> Family:
    """Convert a family to the repaired mesh; `vertex` maps a vertex, or returns None."""
    here = family.at_vertices(vertex)
    kept = {name: getattr(here, name) for name, each in here.declared().items() if each.vertex}
    made = family.for_repair if same_size else family.for_other_mesh
    return replace(made(n_components), **kept)

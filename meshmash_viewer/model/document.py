"""The document: the open mesh, its spectrum, the pins and the running job."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from psygnal import Signal

from meshmash_viewer.features.truncation import sufficient_target
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.health import listed_repairs
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display, Shape
from meshmash_viewer.model.history import History, Step
from meshmash_viewer.model.jobs import (
    DecomposeJob,
    InspectJob,
    JobState,
    PreviewJob,
    ReadJob,
    RepairJob,
    ScaleJob,
)
from meshmash_viewer.model.pins import (
    Pin,
    changed_pins,
    followed_pins,
    free_number,
    pin_at,
    same_vertex,
)
from meshmash_viewer.model.results import MapGrew, MeshReady
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.cost import decomposition_seconds, measured_rate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.units import Voxel, counted, parse_unit, power_unit, written_unit
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work.job import Job

#: Attributes of the display whose changes are recorded, with their names in the menu.
_RECORDED = {
    "policies": "colour limits",
    "log_scales": "colour scale",
    "diverging_colormap": "colour map",
    "sequential_colormap": "colour map",
}
#: Default of `Document.target`.
_DEFAULT_TARGET = Target("count", 100)


class Severity(StrEnum):
    """Severity of a notice: its colour, and how long it stays."""

    INFORMATION = "information"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class Notice:
    """One sentence for the message bar."""

    #: The sentence, and its severity.
    text: str
    severity: Severity = Severity.INFORMATION
    #: For the button that copies them.
    details: str = ""
    #: What a button of this text does.
    action: Callable[[], None] | None = None
    button: str = "Undo"
    #: Returns whether its cause still exists; the notice is withdrawn once it does not. See
    #: `Document.notify` for the default.
    holds: Callable[[], bool] | None = None


@dataclass(frozen=True, eq=False)
class _Shown:
    """An open mesh with its spectrum."""

    ready: MeshReady
    spectrum: Eigenpairs | None


@dataclass(frozen=True, eq=False)
class _Repaired:
    """A mesh before one of the repairs that were made while its file was read."""

    mesh: Mesh
    repairs: tuple[str, ...]


class Document:
    """State of a window: the only copy of what its views display.

    Views read attributes, connect to the signals and call the methods. Long work is only described
    here: `job_requested` carries a `Job`, and its runner calls `job_started`, `job_progressed`,
    `accept_mesh` or `accept_spectrum`, and `job_ended`.
    """

    mesh_changed = Signal()
    spectrum_changed = Signal()
    pins_changed = Signal()
    settings_changed = Signal()
    job_changed = Signal()
    job_requested = Signal(object)
    cancel_requested = Signal()
    maps_requested = Signal(object, bool)
    noticed = Signal(object)

    def __init__(self) -> None:
        self.display = Display()
        self.ready: MeshReady | None = None
        #: The open mesh without pairs, for fields that need none.
        self._bare: Eigenpairs | None = None
        self._spectrum: Eigenpairs | None = None
        self._preview: Eigenpairs | None = None
        self.pins: tuple[Pin, ...] = ()
        self.job: JobState | None = None
        self._operator = OperatorOptions()
        self._target = _DEFAULT_TARGET
        #: Seconds per vertex and pair of the last decomposition on this machine, if any.
        self.seconds_rate: float | None = None
        #: Changes by the user: of mesh, pins, signs, colours and limits.
        self.history = History(self._read_part, self._restore_parts)
        self.history.changed.connect(self.settings_changed.emit)
        self._record_display()
        #: The mesh before a repair after which the repaired one is decomposed.
        self._computes_after: MeshReady | None = None
        #: The last notice, until it is withdrawn.
        self.notice: Notice | None = None
        #: Number of meshes that were shown and jobs that were requested, for `notify`.
        self._turn = 0
        for signal in (
            self.mesh_changed, self.spectrum_changed, self.pins_changed, self.settings_changed,
            self.job_changed, self.display.events,
        ):  # fmt: skip
            signal.connect(self.review_notice)
        #: Whether a mesh is computed again that the last step needs to be undone.
        self._undoing = False
        self._file_mesh: Mesh | None = None
        #: The map that is being computed, the family that was displayed before, and the mesh.
        self._growing: tuple[str, str, _Shown] | None = None
        #: A mesh file that is being read, and the files of maps to read after it.
        self._maps_of: tuple[Path, tuple[Path, ...]] | None = None

    # -- mesh -------------------------------------------------------------------------------

    @property
    def mesh(self) -> Mesh | None:
        """The open mesh."""
        return self.ready.mesh if self.ready else None

    def named_vertex(self, vertex: int) -> str:
        """Return the name of a vertex of the open mesh, see `Mesh.named_vertex`."""
        return "a vertex" if self.mesh is None else self.mesh.named_vertex(vertex)

    @property
    def unit(self) -> str:
        """The unit of the open mesh; "" without a unit or a mesh."""
        return self.mesh.unit if self.mesh is not None else ""

    @property
    def spectrum(self) -> Eigenpairs | None:
        """The eigenpairs of the open mesh; None while there are none."""
        return self._spectrum

    @spectrum.setter
    def spectrum(self, spectrum: Eigenpairs | None) -> None:
        if spectrum is not None and spectrum.mesh is not self.mesh:
            spectrum = replace(spectrum, mesh=self.mesh)
        self._spectrum = spectrum

    @property
    def known(self) -> Eigenpairs | None:
        """The spectrum, or one without pairs while there are none; None without a mesh."""
        return self._bare if self._spectrum is None else self._spectrum

    @property
    def scaled_spectrum(self) -> Eigenpairs | None:
        """The spectrum if it has an eigenvalue above 0, as times and bands need; else None."""
        spectrum = self.spectrum
        return (
            spectrum if spectrum is not None and first_nonzero(spectrum) < len(spectrum) else None
        )

    @property
    def path(self) -> Path | None:
        """The file of the mesh; None for a mesh passed in memory."""
        return self.ready.path if self.ready else None

    @property
    def repairs(self) -> tuple[str, ...]:
        """Names of the repairs in force, oldest first."""
        return self.ready.repairs if self.ready else ()

    def open_mesh(
        self,
        path: str | Path,
        unit: str = "",
        operator: OperatorOptions | None = None,
        maps: Sequence[Path] = (),
        repairs: Sequence[str] = (),
        source: str = "",
    ) -> None:
        """Request that a mesh file is read; the open mesh stays until that has succeeded.

        `operator` is the Laplacian whose stored eigenpairs are looked up, by default the current
        one; `maps` are files of maps to add (`open_maps`). `repairs` are applied in this order, and
        `source` is the hash of the content that they were made for, see `ReadJob`.
        """
        path = Path(path).absolute()  # in notices and scripts, too
        self._maps_of = (path, tuple(maps)) if maps else None
        operator = operator or self.operator
        self.request(ReadJob(path, unit, operator, tuple(repairs), source))

    def take_mesh(self, mesh: Mesh) -> None:
        """Request that a mesh in memory is shown."""
        self.request(InspectJob(mesh, self.operator))

    def set_unit(self, text: str) -> None:
        """Set the unit of the coordinates, or the size of the voxels that they count.

        Parameters
        ----------
        text : str
            See `meshmash_viewer.units.parse_unit`. It refers to the coordinates in the file: "8 nm"
            given twice scales once, and "nm" after it restores the numbers of the file. The
            spectrum is kept where the numbers do not change; with another voxel size it is computed
            again.

        Raises
        ------
        InputError
            If the text is not a unit.
        """
        voxel, unit = parse_unit(text)
        if self.ready is None:
            return
        if voxel == self.ready.mesh.voxel:
            if unit == self.unit:
                return
            before = self.unit_text
            self.history.record("change of unit", "mesh")
            self._take(replace(self.ready, mesh=self.ready.mesh.in_unit(unit)), self.spectrum)
            self.mesh_changed.emit()
            self.pins_changed.emit()
            self.spectrum_changed.emit()
            self._announce_unit(before, "the coordinates keep their numbers")
        else:
            self._rescale(self.ready.mesh, self.repairs, voxel, unit)

    @property
    def unit_text(self) -> str:
        """The unit as `open_mesh` takes it: "nm", "none", or "8 nm" for a file in voxels."""
        return "" if self.mesh is None else written_unit(self.mesh.unit, self.mesh.voxel)

    def _announce_unit(self, before: str, what: str) -> None:
        """Announce a change of the unit, and offer to undo it."""
        if self.unit_text != before:
            text = f"Unit changed from {before} to {self.unit_text}: {what}."
            self._offer_undo(text)

    def _rescale(self, mesh: Mesh, repairs: tuple[str, ...], voxel: Voxel, unit: str) -> None:
        self.request(ScaleJob(mesh, voxel, unit, self.path, self.operator, repairs))

    # -- maps -------------------------------------------------------------------------------

    def open_maps(self, paths: Sequence[Path], *, shown: bool = True) -> None:
        """Request that files with values per vertex are read, and the last map shown if `shown`."""
        if self.ready is None:
            text = "There is no mesh to put a map on: open the mesh first, then its maps."
            self.say(text, Severity.WARNING)
        elif paths:
            self.maps_requested.emit(tuple(path.absolute() for path in paths), shown)

    def accept_maps(self, mesh: Mesh, maps: Sequence[VertexMap], *, shown: bool = True) -> None:
        """Take maps that were read for a mesh, if that is still open, and show the last."""
        now = self.mesh
        if now is None or now.vertices is not mesh.vertices or not maps or self.ready is None:
            return
        more = now.with_maps(*maps)
        self.history.record("new map" if len(maps) == 1 else "new maps", "mesh")
        self._take(replace(self.ready, mesh=more), self.spectrum)
        if shown:
            self._show_map(more.maps[-1].name)
            names = ", ".join(each.name for each in more.maps[len(now.maps) :])
            self.say(f"Added {counted(len(maps), 'map')}: {names}.")
        self.spectrum_changed.emit()

    def accept_growing(self, mesh: Mesh, grew: MapGrew) -> None:
        """Add values to a map that is being computed, and show it; NaN where values are missing."""
        now = self.mesh
        if now is None or now.vertices is not mesh.vertices or self.ready is None:
            return
        if self._growing is None:
            self._growing = grew.name, self.display.kind, _Shown(self.ready, self.spectrum)
            values = np.full(now.n_vertices, np.nan, dtype=np.float32)
        else:
            values = np.array(now.map_named(grew.name).values)
        values[grew.vertices] = grew.values
        if any(each.name == grew.name for each in now.maps):
            now = now.without_map(grew.name)
        unit = power_unit(now.unit, -2)
        now = now.with_maps(VertexMap(grew.name, values, unit=unit))
        self._take(replace(self.ready, mesh=now), self.spectrum)
        self._show_map(grew.name)
        self.spectrum_changed.emit()

    def end_growing(self, whole: bool) -> None:
        """Keep the computed map if it is whole; else remove it and show the previous family."""
        if self._growing is not None:
            (name, kind, before), self._growing = self._growing, None
            if whole:
                self.history.record("new map", before={"mesh": before})
            elif self.mesh is not None:
                with self.history.paused():
                    self.remove_map(name)
                self.display.kind = kind

    def remove_map(self, name: str) -> None:
        """Remove a map from the mesh; its file stays."""
        if self.ready is not None:
            left = self.ready.mesh.without_map(name)
            self.history.record("removal of a map", "mesh")
            self._take(replace(self.ready, mesh=left), self.spectrum)
            self.spectrum_changed.emit()

    def repair(self, name: str, *, then_compute: bool = False) -> None:
        """Request a repair of `meshmash_viewer.health.REPAIRS`, and then perhaps `compute`."""
        if self.ready is not None:
            ready = self.ready
            self._computes_after = ready if then_compute else None
            self.request(RepairJob(ready.mesh, name, ready.path, self.operator, ready.repairs))

    # -- history ----------------------------------------------------------------------------

    def undo(self) -> None:
        """Revert the last change; if the mesh before it was not kept, that is computed first."""
        step = self.history.past[-1] if self.history.past else None
        shown = None if step is None else step.state.get("mesh")
        if isinstance(shown, _Repaired) and self.mesh is not None:
            self._undoing = True
            self._rescale(shown.mesh, shown.repairs, self.mesh.voxel, self.mesh.unit)
        else:
            self.history.undo()

    def redo(self) -> None:
        """Make the change again that was undone last."""
        self.history.redo()

    def undo_repair(self) -> None:
        """Revert the last repair, and what was changed after it."""
        while self.can_undo_repair and self.history.undo_label != "repair":
            self.history.undo()
        if self.can_undo_repair:
            self.undo()

    @property
    def can_undo_repair(self) -> bool:
        """Whether there is a repair to undo."""
        return any(step.label == "repair" for step in self.history.past)

    @property
    def file_mesh(self) -> Mesh | None:
        """The mesh as it was read, before all repairs; its unit may differ from the open mesh's."""
        return self._file_mesh if self.repairs else self.mesh

    def _offer_undo(self, text: str) -> None:
        """Announce the last change, and offer to undo it until another one comes after it."""
        last = self.history.past[-1:]
        action = self.undo if last else None
        self.notify(Notice(text, action=action, holds=lambda: self.history.past[-1:] == last))

    def _read_part(self, part: str) -> Any:
        """Return the current value of a part of the state."""
        if part == "mesh":
            return None if self.ready is None else _Shown(self.ready, self.spectrum)
        if part == "signs":
            return self.display[Eigenfunctions].flipped
        return self.pins if part == "pins" else getattr(self.display, part)

    def _restore_parts(self, state: Mapping[str, Any]) -> None:
        """Set parts of the state to former values."""
        parts, now = dict(state), self.mesh
        shown = parts.pop("mesh", None)
        if isinstance(shown, _Shown) and now is not None:
            pins = parts.pop("pins", self.pins)
            ready, spectrum = shown.ready, shown.spectrum
            if ready.mesh.vertices is not now.vertices:
                self._show(ready, spectrum, pins, now)
            else:
                self._take(ready, self.spectrum)
                if ready.mesh.unit != now.unit:
                    self.mesh_changed.emit()
                    self.pins_changed.emit()
                self.spectrum_changed.emit()
        for part, value in parts.items():
            if part == "signs":
                self.display.change(Eigenfunctions, flipped=value)
            elif part == "pins":
                self.pins = value
                self.pins_changed.emit()
            else:
                setattr(self.display, part, value)

    def _record_display(self) -> None:
        """Record changes of colours and limits."""
        for part, label in _RECORDED.items():
            # held weakly, so that a closed document is freed
            getattr(self.display.events, part).connect(partial(self._record_part, part, label))

    def _record_part(self, part: str, label: str, _new: object, old: object) -> None:
        self.history.record(label, before={part: old})

    # -- opening ----------------------------------------------------------------------------

    def accept_mesh(self, ready: MeshReady) -> None:
        """Show a mesh that was read or repaired, with its stored spectrum."""
        if self._target.kind != "count" and not self._measures_as(ready):
            # a length or an eigenvalue says nothing about a mesh of another size
            self.target = _DEFAULT_TARGET
        spectrum = ready.known
        if ready.derived and self.ready is not None:
            ready = replace(ready, source=self.ready.source)
            self._accept_derived(ready, spectrum)
        else:
            self._undoing = False
            self._file_mesh = ready.before[0] if ready.before else None
            with self.history.paused():
                self._show(ready, spectrum)
            before = enumerate(ready.before)
            steps = (_Repaired(mesh, ready.repairs[:at]) for at, mesh in before)
            self.history.start(*(Step("repair", {"mesh": each}) for each in steps))
            if ready.unasked:
                text = f"Repaired as before: {listed_repairs(ready.repairs)}."
                self._offer_undo(text)
        if self._maps_of is not None and self._maps_of[0] == ready.path:
            (_, files), self._maps_of = self._maps_of, None
            self.open_maps(files)

    def _accept_derived(self, ready: MeshReady, spectrum: Eigenpairs | None) -> None:
        """Show the open mesh with one repair more or less, or with another voxel size."""
        before, pins, unit = self.mesh, self.pins, self.unit_text
        assert before is not None and self.ready is not None  # noqa: PT018  it is derived from it
        shown = followed_pins(pins, before, ready.mesh)
        if self._undoing:
            self._undoing = False
            self.history.complete({"mesh": _Shown(ready, spectrum), "pins": shown})
            self.history.undo()
            return
        repaired = ready.repairs != self.repairs
        if repaired and not self.repairs:
            self._file_mesh = before
        self.history.record("repair" if repaired else "change of unit", "mesh", "pins")
        with self.history.paused():
            self._show(ready, spectrum, shown, before)
        self._announce_unit(unit, "lengths are scaled, and eigenpairs are other ones")
        if lost := len(pins) - len(self.pins):
            where, them = ("a vertex", "it") if lost == 1 else ("vertices", "them")
            text = (
                f"{counted(lost, 'pin')} went with {where} that the repair left out or merged."
                f" Undo brings {them} back."
            )
            self._offer_undo(text)

    def _measures_as(self, ready: MeshReady) -> bool:
        """Whether lengths mean the same on a mesh as on this: repaired, or read again."""
        if self.mesh is None:
            return True
        again = ready.derived or (ready.path is not None and ready.path == self.path)
        return again and ready.mesh.voxel == self.mesh.voxel

    def _show(
        self,
        ready: MeshReady,
        spectrum: Eigenpairs | None,
        pins: tuple[Pin, ...] = (),
        before: Mesh | None = None,
    ) -> None:
        """Show a mesh; `before` is the previous mesh of the same file, whose vertices are kept."""
        self._turn += 1
        self._take(ready, spectrum)
        self._preview = None
        self.pins = pins
        n_components = ready.health.n_components
        display = self.display
        display.put(
            *(
                each.for_other_mesh(n_components)
                if before is None
                else _repaired(each, n_components, partial(same_vertex, before, ready.mesh))
                for each in display.fields.values()
            )
        )
        if spectrum is not None and spectrum.complete:
            self._go_within(spectrum)
        if not display.family.usable:
            display.kind = Display().kind
        if not ready.derived:
            display.shape, display.vibrating = Shape(), False
        self.mesh_changed.emit()
        self.pins_changed.emit()
        self.spectrum_changed.emit()

    def _take(self, ready: MeshReady, spectrum: Eigenpairs | None) -> None:
        self.ready = ready
        self._bare = Eigenpairs.without_pairs(ready.mesh)
        self.spectrum = spectrum

    # -- decomposition ----------------------------------------------------------------------

    @property
    def operator(self) -> OperatorOptions:
        """Options of the Laplacian for the next solve."""
        return self._operator

    @operator.setter
    def operator(self, operator: OperatorOptions) -> None:
        if operator != self._operator:
            self._operator = operator
            self.settings_changed.emit()

    @property
    def target(self) -> Target:
        """How much of the spectrum the next solve computes."""
        return self._target

    @target.setter
    def target(self, target: Target) -> None:
        if target != self._target:
            self._target = target
            self.settings_changed.emit()

    def translation(self) -> Translation:
        """Return the conversion of targets for the open mesh; for unit area without a mesh."""
        if self.ready is None:
            return Translation(1.0)
        health = self.ready.health
        n_vertices = health.n_vertices - health.unreferenced_vertices
        spectrum = None if self.spectrum is None else self.spectrum.exact
        if spectrum is None or not len(spectrum) or spectrum.operator != self._operator:
            return Translation(health.area, n_vertices=n_vertices)
        return Translation(
            health.area, spectrum.eigenvalues, n_vertices, known_to=spectrum.known_to
        )

    @property
    def is_computed(self) -> bool:
        """Whether all pairs of the target are computed and certified."""
        spectrum, translation = self.spectrum, self.translation()
        if spectrum is None or not spectrum.complete:
            return False
        wanted, exact = translation.count(self.target)
        return exact and wanted <= len(translation.eigenvalues)

    @property
    def can_compute(self) -> bool:
        """Whether there is a mesh with pairs left to compute, and no other job runs."""
        # a preview ends within seconds
        waits = self.job is None or isinstance(self.job.job, PreviewJob)
        return self.ready is not None and waits and not self.is_computed

    def compute(self) -> None:
        """Request the decomposition of the open mesh."""
        if self.ready is not None:
            target = self.target
            if target.kind == "time":
                # at most the whole spectrum
                n_vertices = int(self.translation().n_vertices)
                target = sufficient_target(target.value, self.ready.health.area, n_vertices)
            self.request(DecomposeJob(self.ready.mesh, self.operator, target))

    def accept_spectrum(self, spectrum: Eigenpairs) -> None:
        """Show a longer spectrum or a preview; a preview is not replaced by fewer pairs."""
        known = self.spectrum
        if known is not None and not len(spectrum.mass) and known.operator == spectrum.operator:
            spectrum = replace(spectrum, mass=known.mass)  # which is sent once
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

    # -- pins -------------------------------------------------------------------------------

    def toggle_pin(self, vertex: int, number: int = 0) -> None:
        """Pin a vertex under a number, by default the lowest free one, or remove its pin.

        `IndexError` is raised if the mesh has no vertex of that index.
        """
        if self.mesh is None or not 0 <= vertex < self.mesh.n_vertices:
            raise IndexError(f"vertex {vertex} is not in the mesh")
        left = tuple(pin for pin in self.pins if pin.vertex != vertex)
        if len(left) < len(self.pins):
            self.set_pins("removal of a pin", left)
        else:
            new = Pin(int(vertex), free_number(self.pins, number))
            self.set_pins("pin", (*self.pins, new))

    def clear_pins(self) -> None:
        """Remove all pins."""
        self.set_pins("removal of all pins", ())

    def set_pins(self, label: str, pins: Iterable[Pin]) -> None:
        """Replace the pins as one change, whose label completes "Undo …"."""
        self.history.record(label, "pins")
        self.pins = tuple(pins)
        self.pins_changed.emit()

    def change_pin(self, label: str, vertex: int, **attributes: Any) -> None:
        """Change attributes of the pin of a vertex as one change, if there is one."""
        if pin_at(self.pins, vertex) is not None:
            self.set_pins(label, changed_pins(self.pins, vertex, **attributes))

    def flip(self) -> None:
        """Flip the sign of the displayed eigenfunction."""
        family = self.display.family
        if isinstance(family, Eigenfunctions):
            self.history.record("flip of a sign", "signs")
            self.display.put(family.sign_flipped())

    @property
    def can_flip(self) -> bool:
        """Whether the displayed field has a sign that can be flipped."""
        return isinstance(self.display.family, Eigenfunctions)

    def similar(self) -> None:
        """Show the similarity to the vertex pinned last."""
        if self.pins:
            chosen = self.display[Similarity]
            self.display.show(replace(chosen, vertex=self.pins[-1].vertex))

    def _show_map(self, name: str) -> None:
        self.display.show(replace(self.display[OwnMaps], chosen=name, view="map"))

    def _go_within(self, spectrum: Eigenpairs) -> None:
        """Clip the position of every family to the range of a spectrum."""
        self.display.put(*(each.within(spectrum) for each in self.display.fields.values()))

    # -- the job that runs ------------------------------------------------------------------

    def request(self, job: Job) -> None:
        """Request that a job runs, such as an export."""
        self._turn += 1
        self.job_requested.emit(job)

    def cancel(self) -> None:
        """Ask the running job to stop."""
        if self.job is not None:
            self.job = replace(self.job, cancelling=True)
            self.job_changed.emit()
            self.cancel_requested.emit()

    def job_started(self, job: Job) -> None:
        """Record that a job runs now."""
        expected = None
        if isinstance(job, DecomposeJob) and job.mesh is self.mesh:
            expected = self.expected_seconds(job.target)
        self.job = JobState(job, Progress("starting"), began=time.monotonic(), expected=expected)
        self.job_changed.emit()

    def job_progressed(self, progress: Progress) -> None:
        """Record the progress of the job."""
        if self.job is not None:
            self.job = self.job.progressed(progress)
            self.job_changed.emit()

    def job_ended(self, notice: Notice | None = None) -> None:
        """Record the end of the job, show its notice, and measure the speed of the machine."""
        job, spectrum = self.job, self.spectrum
        if (
            job is not None
            and isinstance(job.job, DecomposeJob)
            and not job.cancelling
            and spectrum is not None
            and spectrum.complete
        ):
            took = time.monotonic() - job.began
            rate = measured_rate(spectrum.rows.shape[1], len(spectrum.exact), took)
            self.seconds_rate = rate or self.seconds_rate
        self.job, self._undoing = None, False
        self.job_changed.emit()
        if notice is not None:
            self.notify(notice)
        if job is not None and isinstance(job.job, RepairJob):
            before, self._computes_after = self._computes_after, None
            if before is not None and self.ready is not before:
                self.compute()

    def expected_seconds(self, target: Target) -> float:
        """Estimate the seconds that a decomposition of the open mesh takes."""
        assert self.ready is not None
        pairs = self.translation().count(target)[0]
        return decomposition_seconds(self.ready.health.n_vertices, pairs, self.seconds_rate)

    def notify(self, notice: Notice) -> None:
        """Show a notice in the message bar, until its cause has gone.

        Without `Notice.holds`, a warning, an error and what has a button stay until another mesh is
        shown or another job is requested; other notices go after some seconds.
        """
        lasting = notice.severity is not Severity.INFORMATION or notice.action is not None
        if notice.holds is None and lasting:
            turn = self._turn
            notice = replace(notice, holds=lambda: self._turn == turn)
        self.notice = notice
        self.noticed.emit(notice)

    def review_notice(self) -> None:
        """Withdraw the last notice if its cause has gone: `noticed` is emitted with None."""
        notice = self.notice
        if notice is not None and notice.holds is not None and not notice.holds():
            self.notice = None
            self.noticed.emit(None)

    def say(self, text: str, severity: Severity = Severity.INFORMATION) -> None:
        """Show a sentence in the message bar."""
        self.notify(Notice(text, severity))


def _repaired(family: Family, n_components: int, vertex: Callable[[int], int | None]) -> Family:
    """Convert a family to the repaired mesh; `vertex` maps vertices, or returns None."""
    here = family.at_vertices(vertex)
    kept = {name: getattr(here, name) for name, each in here.declared().items() if each.vertex}
    return replace(family.for_other_mesh(n_components), **kept)

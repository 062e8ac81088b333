"""Displayed shapes of a mesh: reconstructions from eigenfunctions, and vibrations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, QTimer, Signal

from meshmash_viewer.app.executor import Call, Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.camera import drawn_points, geometry_of
from meshmash_viewer.features.shape import Reconstruction
from meshmash_viewer.io.provenance import export_options, provenance
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import FEWEST_PAIRS, Shape
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.notices import failure_of, notice_of
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted

FloatArray = npt.NDArray[np.floating]

#: Milliseconds between the frames of a vibration, and period of the vibration in seconds.
_FRAME, _PERIOD = 33, 1.6
#: Seconds between the displays of partial sums while a long sum is computed.
_PARTIAL = 0.06
#: Number of vertices up to which normals are computed for every shape, and seconds without a new
#: request after which the normals of a larger mesh are computed.
_SMALL, _REST = 60_000, 0.15


@dataclass(eq=False)
class _Kept:
    """Intermediate results for one mesh, reused by the next request."""

    sums: tuple[Eigenpairs, Reconstruction] | None = None
    swings: tuple[Field, FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class _Request:
    """Request for a shape."""

    spectrum: Eigenpairs
    shape: Shape
    kept: _Kept
    #: Field of the amplitudes of a vibration, or None, and current displacement from -1 to 1.
    field: Field | None = None
    phase: float = 0.0


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """Displayed positions of the vertices."""

    #: Eigenpairs of the mesh.
    spectrum: Eigenpairs
    #: Positions, shape (n, 3), relative to the centre of the mesh; None for the mesh's vertices.
    points: npt.NDArray[np.float32] | None = None
    #: Vertex normals, shape (n, 3); None to keep the displayed normals.
    normals: npt.NDArray[np.float32] | None = None
    #: Number of eigenfunctions of the reconstruction; 0 without a reconstruction.
    count: int = 0
    #: See `Shape.morph`.
    morph: float = 1.0
    #: Root mean square distance from the vertices of the mesh.
    distance: float = 0.0
    #: Whether the shape is the final answer to a request without a vibration.
    rests: bool = True

    @property
    def text(self) -> str:
        """Description for the title, such as "shape from 8 pairs"; "" for the mesh itself."""
        if not self.count or not self.morph:
            return ""
        share = "" if self.morph == 1.0 else f" ({100.0 * self.morph:.0f} %)"
        return f"shape from {counted(self.count, 'pair')}{share}"


class ShapeSource(QObject):
    """Source of the displayed shape of a document, computed in a thread.

    `shape_ready` is emitted with each `DrawnShape`, including partial sums; only the latest request
    is completed. A failure is shown as a notice.
    """

    shape_ready = Signal(object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._field: Field | None = None
        self._latest: _Request | None = None
        self.drawn: DrawnShape | None = None
        self._kept = _Kept()
        self._slot = Slot(self, "shape", one_core=True)
        self._clock = QTimer(self, interval=_FRAME)
        self._clock.timeout.connect(self.refresh)
        self._began = 0.0
        events = document.display.events
        listen(document.mesh_changed, self._forget)
        shown = events.shape, events.vibrating, document.spectrum_changed, document.mesh_changed
        listen(shown, self.refresh)

    def set_field(self, field: Field | None) -> None:
        self._field = field
        if field is None or not field.signed:
            self._document.display.vibrating = False

    @property
    def idle(self) -> bool:
        """Whether the requested shape is displayed, with its normals."""
        return not self._slot.working and (self._latest is None or self.drawn is not None)

    def _forget(self) -> None:
        """Drop requests and results of the previous mesh."""
        self._slot.drop()
        self._latest = self.drawn = None
        self._kept = _Kept()  # a new object, because the thread may still write to the old one

    def refresh(self) -> None:
        display, spectrum = self._document.display, self._document.spectrum
        if spectrum is None or spectrum.mesh is None:
            self._clock.stop()
            self._forget()
            display.vibrating = False
            return
        request = _Request(spectrum, display.shape, self._kept)
        if display.vibrating and self._field is not None:
            if not self._clock.isActive():
                self._began = perf_counter()
                self._clock.start()
            phase = math.tau * (perf_counter() - self._began) / _PERIOD
            request = replace(request, field=self._field, phase=math.sin(phase))
        else:
            self._clock.stop()
        still = request.field is None and not request.shape.shown
        if still and (self.drawn is None or self.drawn.points is None) and self._latest is None:
            return
        self._latest = request
        self._slot.submit(partial(self._answer, request), partial(self._take, request), self._fail)

    # -- in the thread ------------------------------------------------------------------------

    def _answer(self, request: _Request, call: Call) -> DrawnShape:
        drawn = self._drawn(request, self._rebuilt(request, call))
        if drawn.points is None or drawn.normals is not None or not drawn.rests:
            return drawn
        call.send(drawn)
        if not call.stays(_REST):
            raise Cancelled
        return replace(drawn, normals=_normals(drawn))

    def _rebuilt(self, request: _Request, call: Call) -> Reconstruction | None:
        """Compute the requested reconstruction, and send partial sums."""
        spectrum, shape = request.spectrum, request.shape
        if not shape.shown or len(spectrum) < FEWEST_PAIRS:
            return None
        known = request.kept.sums
        if known is None or known[0] is not spectrum:
            assert spectrum.mesh is not None
            sums = Reconstruction(spectrum.mesh, spectrum.rows, spectrum.vertex_areas)
            known = request.kept.sums = spectrum, sums
        sums = known[1]
        sent = perf_counter()
        for _ in sums.move_to(shape.within(len(spectrum))):
            if call.cancelled():
                raise Cancelled
            if perf_counter() - sent > _PARTIAL:
                call.send(self._drawn(request, sums))
                sent = perf_counter()
                if call.superseded() and request.field is None:
                    raise Cancelled  # the next request continues from the partial sum
        return sums

    def _drawn(self, request: _Request, sums: Reconstruction | None) -> DrawnShape:
        spectrum, shape = request.spectrum, request.shape
        mesh = spectrum.mesh
        assert mesh is not None
        geometry = geometry_of(mesh)
        points, distance, count = geometry.points, 0.0, 0
        if sums is not None:
            # the centre is subtracted in float64: float32 is too coarse far from the origin
            points = drawn_points(mesh, sums.vertices, geometry.centre)
            if shape.morph != 1.0:
                points = geometry.points + np.float32(shape.morph) * (points - geometry.points)
            distance, count = shape.morph * sums.rms_distance, sums.count
        if request.field is not None:
            swings = request.kept.swings
            if swings is None or swings[0] is not request.field:
                swings = request.field, _along_normals(mesh, request.field.values)
                request.kept.swings = swings
            reach = shape.amplitude * float(np.linalg.norm(np.ptp(geometry.bounds, axis=0)))
            points = points + np.float32(reach * request.phase) * swings[1]
        moved = points is not geometry.points
        rests = request.field is None and (sums is None or count == shape.within(len(spectrum)))
        drawn = DrawnShape(
            spectrum, points if moved else None, None, count, shape.morph, distance, rests
        )
        small = mesh.n_vertices <= _SMALL
        return replace(drawn, normals=_normals(drawn)) if moved and small else drawn

    # -- in the interface thread --------------------------------------------------------------

    def _fail(self, fault: Exception) -> None:
        self._document.notices.show(notice_of(failure_of(fault, "Rebuilding the shape")))

    def _take(self, request: _Request, answer: DrawnShape) -> None:
        latest = self._latest
        if latest is None:
            return
        same = answer.spectrum is latest.spectrum
        if not same or latest.shape.shown != request.shape.shown:
            return
        self.drawn = answer
        if answer.points is None and latest is request:
            self._latest = None
        self.shape_ready.emit(answer)


def shape_writer(document: Document, path: Path) -> Callable[[], None]:
    """Return a function that writes the current reconstruction, without vibration, to a file."""
    spectrum, shape = document.spectrum, document.display.shape
    assert spectrum is not None and spectrum.mesh is not None  # noqa: PT018
    mesh, operator = spectrum.mesh, spectrum.operator or document.solve.operator
    repairs = document.repairs
    count = shape.within(len(spectrum))
    proof = "" if spectrum.certificate.method == "none" else spectrum.proof(mesh.unit)

    def write() -> None:
        sums = Reconstruction(mesh, spectrum.rows, spectrum.vertex_areas)
        for _ in sums.move_to(count):
            pass
        vertices = mesh.vertices + shape.morph * (sums.vertices - mesh.vertices)
        target = Target("count", count)
        options = export_options("reconstruction", operator, target, proof, repairs)
        options |= {"morph": shape.morph, "rms_distance": shape.morph * sums.rms_distance}
        write_mesh(path, replace(mesh, vertices=vertices), provenance(mesh, options))

    return write


def _normals(drawn: DrawnShape) -> npt.NDArray[np.float32]:
    """Compute the vertex normals of a displaced shape, shape (n, 3)."""
    mesh, points = drawn.spectrum.mesh, drawn.points
    assert mesh is not None and points is not None  # noqa: PT018
    return replace(mesh, vertices=points.astype(np.float64)).vertex_normals


def _along_normals(mesh: Mesh, values: FloatArray) -> FloatArray:
    """Return the vertex normals, shape (n, 3), times the field divided by its maximum magnitude."""
    known = np.nan_to_num(np.asarray(mesh.on_surface(values), dtype=np.float32))
    most = float(np.abs(known).max(initial=0.0)) or 1.0
    return (known / np.float32(most))[:, np.newaxis] * mesh.vertex_normals

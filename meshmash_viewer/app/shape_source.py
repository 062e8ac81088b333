"""Where the vertices are drawn: rebuilt from eigenfunctions, between, or swinging; in a thread."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, Qt, QThreadPool, QTimer, Signal, Slot

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.geometry import geometry_of
from meshmash_viewer.features.reconstruction import Reconstruction
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.io.provenance import export_options, provenance
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import FEWEST_PAIRS, Shape
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.field import Field
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.weyl import Target

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["DrawnShape", "ShapeSource"]

FloatArray = npt.NDArray[np.floating]

#: Milliseconds between two places of a vibration, and seconds that it takes to swing once.
_SWING, _PERIOD = 33, 1.6
#: Seconds between partial sums that are drawn on the way to a number far away.
_PARTIAL = 0.06
#: Vertices up to which normals are there at every tick, and seconds without one after which
#: those of a larger mesh are computed.
_SMALL, _REST = 60_000, 0.15


@dataclass(frozen=True, eq=False)
class _Request:
    spectrum: Spectrum
    shape: Shape
    #: A field along whose values the vertices swing, and how far, from -1 to 1.
    field: Field | None = None
    phase: float = 0.0


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """Where vertices are drawn.

    Parameters
    ----------
    spectrum : Spectrum
        With the mesh that they are of.
    points : ndarray of float32, shape (n, 3), or None
        Relative to the centre that the mesh is drawn about; None where the mesh has them.
    normals : ndarray of float32, shape (n, 3), or None
        None for those of before.
    count : int
        Of the eigenfunctions in them.
    distance : float
        Root mean square of how far the surface is from where the mesh has it.
    rests : bool
        Whether this is what was asked for, and nothing swings.
    """

    spectrum: Spectrum
    points: npt.NDArray[np.float32] | None = None
    normals: npt.NDArray[np.float32] | None = None
    count: int = 0
    distance: float = 0.0
    rests: bool = True


class ShapeSource(QObject):
    """Listens to a document and answers with places of vertices.

    `shape_ready` carries each `DrawnShape`; only the latest request counts, and partial sums are
    drawn on the way to it. `written` carries the path of a shape that has been saved, `failed` a
    `Failure`.
    """

    shape_ready = Signal(object)
    written = Signal(object)
    failed = Signal(object)
    _computed = Signal(object, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._field: Field | None = None
        self._latest: _Request | None = None
        self.drawn: DrawnShape | None = None
        # -- of the thread alone
        self._sums: tuple[Spectrum, Reconstruction] | None = None
        self._swings: tuple[Field, FloatArray] | None = None
        self._threads: ThreadpoolController | None = None
        # --
        self._computed.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self._thread = LatestThread(self._answer, parent=self)
        self._normals = LatestThread(self._turn_normals, rest=_REST, parent=self)
        self._pool = QThreadPool(self)
        self._clock = QTimer(self, interval=_SWING)
        self._clock.timeout.connect(self.refresh)
        self._began = 0.0
        events = document.display.events
        for signal in (
            events.shape, events.vibrating, document.spectrum_changed, document.mesh_changed
        ):  # fmt: skip
            listen(signal, self.refresh)
        self._thread.start()
        self._normals.start()

    def set_field(self, field: Field | None) -> None:
        """Swing by another field."""
        self._field = field
        if field is None or not field.signed:
            self._document.display.vibrating = False

    @property
    def idle(self) -> bool:
        """Whether what is wanted is drawn, with its normals."""
        waiting = self._thread.working or self._normals.working
        return not waiting and (self._latest is None or self.drawn is not None)

    def refresh(self) -> None:
        """Ask for the shape that the document wants now."""
        display, spectrum = self._document.display, self._document.spectrum
        if spectrum is None or spectrum.mesh is None:
            self._clock.stop()
            self._latest = self.drawn = None
            self._thread.drop()
            self._normals.drop()
            display.vibrating = False
            return
        request = _Request(spectrum, display.shape)
        if display.vibrating and self._field is not None:
            if not self._clock.isActive():
                self._began = perf_counter()
                self._clock.start()
            swung = math.tau * (perf_counter() - self._began) / _PERIOD
            request = replace(request, field=self._field, phase=math.sin(swung))
        else:
            self._clock.stop()
        still = request.field is None and not request.shape.shown
        if still and (self.drawn is None or self.drawn.points is None) and self._latest is None:
            return
        self._latest = request
        self._normals.drop()
        self._thread.ask(request)

    def write(self, path: Path) -> None:
        """Save the reconstruction that is chosen, without a vibration."""
        document, spectrum = self._document, self._document.spectrum
        if spectrum is None or spectrum.mesh is None:
            return
        mesh, shape = spectrum.mesh, document.display.shape
        operator, repairs = spectrum.operator or document.operator, document.repairs
        count, certificate = shape.within(len(spectrum)), spectrum.certificate
        proof = "" if certificate is None else certificate.sentence(len(spectrum), mesh.unit)

        def work() -> None:
            try:
                sums = Reconstruction(mesh, spectrum.rows, spectrum.vertex_areas)
                for _ in sums.move_to(count):
                    pass
                vertices = mesh.vertices + shape.morph * (sums.vertices - mesh.vertices)
                target = Target("count", count)
                options = export_options("reconstruction", operator, target, proof, repairs)
                options |= {"morph": shape.morph, "rms_distance": shape.morph * sums.rms_distance}
                write_mesh(path, replace(mesh, vertices=vertices), provenance(mesh, options))
            except Exception as fault:  # noqa: BLE001  said to the person
                self.failed.emit(failure_of(fault, f"Writing {path.name}"))
            else:
                self.written.emit(path)

        self._pool.start(work)

    def close(self) -> None:
        """Stop the threads and wait for them."""
        self._clock.stop()
        self._latest = None
        self._thread.close()
        self._normals.close()
        self._pool.waitForDone()

    # -- in the threads -----------------------------------------------------------------------

    def _answer(self, request: _Request, cancel: CancelCallback) -> None:
        try:
            if self._threads is None:
                from threadpoolctl import ThreadpoolController

                self._threads = ThreadpoolController()
            with self._threads.limit(limits=1, user_api="blas"):
                self._compute(request, cancel)
        except Exception as error:  # noqa: BLE001  the window says it
            self._computed.emit(request, error)

    def _compute(self, request: _Request, cancel: CancelCallback) -> None:
        spectrum, shape = request.spectrum, request.shape
        rebuilt = shape.shown and len(spectrum) >= FEWEST_PAIRS
        if not rebuilt:
            self._computed.emit(request, self._drawn(request, None))
            return
        if self._sums is None or self._sums[0] is not spectrum:
            assert spectrum.mesh is not None
            sums = Reconstruction(spectrum.mesh, spectrum.rows, spectrum.vertex_areas)
            self._sums = spectrum, sums
        sums = self._sums[1]
        told = perf_counter()
        for _ in sums.move_to(shape.within(len(spectrum))):
            if cancel():
                return
            if perf_counter() - told > _PARTIAL:
                self._computed.emit(request, self._drawn(request, sums))
                told = perf_counter()
                if self._latest is not request and request.field is None:
                    return  # the next one goes on from here
        self._computed.emit(request, self._drawn(request, sums))

    def _drawn(self, request: _Request, sums: Reconstruction | None) -> DrawnShape:
        spectrum, shape = request.spectrum, request.shape
        mesh = spectrum.mesh
        assert mesh is not None
        geometry = geometry_of(mesh)
        points, distance, count = geometry.points, 0.0, 0
        if sums is not None:
            # distances before float32, which has no digits for them far from the origin
            points = (sums.vertices - geometry.centre).astype(np.float32)
            if shape.morph != 1.0:
                points = geometry.points + np.float32(shape.morph) * (points - geometry.points)
            distance, count = shape.morph * sums.rms_distance, sums.count
        if request.field is not None:
            if self._swings is None or self._swings[0] is not request.field:
                self._swings = request.field, _along_normals(mesh, request.field.values)
            reach = shape.amplitude * float(np.linalg.norm(np.ptp(geometry.bounds, axis=0)))
            points = points + np.float32(reach * request.phase) * self._swings[1]
        moved = points is not geometry.points
        rests = request.field is None and (sums is None or count == shape.within(len(spectrum)))
        normals = None
        if moved and mesh.n_vertices <= _SMALL:
            normals = replace(mesh, vertices=points.astype(np.float64)).vertex_normals
        return DrawnShape(spectrum, points if moved else None, normals, count, distance, rests)

    def _turn_normals(self, drawn: DrawnShape, _cancel: CancelCallback) -> None:
        mesh = drawn.spectrum.mesh
        assert mesh is not None
        assert drawn.points is not None
        normals = replace(mesh, vertices=drawn.points.astype(np.float64)).vertex_normals
        self._computed.emit(None, replace(drawn, normals=normals))

    # -- in the interface thread --------------------------------------------------------------

    @Slot(object, object)
    def _take(self, request: _Request | None, answer: DrawnShape | Exception) -> None:
        latest = self._latest
        if latest is None:
            return
        if isinstance(answer, Exception):
            self.failed.emit(failure_of(answer, "Rebuilding the shape"))
            return
        if answer.spectrum is not latest.spectrum:
            return
        if request is None:
            if self.drawn is None or self.drawn.points is not answer.points:
                return  # it has moved on
        elif latest.shape.shown != request.shape.shown:
            return
        self.drawn = answer
        if answer.rests and answer.points is not None and answer.normals is None:
            self._normals.ask(answer)
        if answer.points is None and latest is request:
            self._latest = None
        self.shape_ready.emit(answer)


def _along_normals(mesh: Mesh, values: FloatArray) -> FloatArray:
    """Normals as long as a field's values are beside the largest, shape (n, 3)."""
    known = np.nan_to_num(np.asarray(mesh.on_surface(values), dtype=np.float32))
    most = float(np.abs(known).max(initial=0.0)) or 1.0
    return (known / np.float32(most))[:, np.newaxis] * mesh.vertex_normals

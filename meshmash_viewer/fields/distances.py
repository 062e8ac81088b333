"""Family of spectral and geodesic distances from a vertex."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.distances import (
    MEASURES,
    RowsFrom,
    check_vertices,
    distance_columns,
    distance_features,
    missing_square,
    spectral_weights,
)
from meshmash_viewer.features.sums import Features, sum_squares
from meshmash_viewer.fields.family import (
    Answer,
    Cancel,
    ColumnArray,
    Description,
    Family,
    Table,
    evenly_in_log,
)
from meshmash_viewer.fields.live_tables import build_heat_table
from meshmash_viewer.fields.parameter import Index, Positive, parameter
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero, same_pairs
from meshmash_viewer.spectral.weyl import TOLERANCE, Target, weyl_eigenvalue
from meshmash_viewer.surface.geodesics import GeodesicSolver
from meshmash_viewer.units import check_positive, counted, format_quantity

#: Number of arrow-key steps from the shortest to the longest time.
_STEPS = 32
_FROM = "A distance is from a vertex"


@dataclass(frozen=True)
class Distances(Family):
    """Distance from a vertex."""

    name = "distance"
    label = "Distance from a vertex"
    page = "distances"
    short = "Distance"
    tip = "Geodesic, biharmonic, commute-time or diffusion distance from a pin"
    export = "distance"
    icon = '<path d="M5 19L19 5"/><path d="M3 17l4 4M17 3l4 4"/><path d="M9 12l3 3M12 9l3 3"/>'
    position = ("time",)
    required = "vertex"
    contoured = True
    interval = 50

    #: Kind of distance, a key of `MEASURES`.
    measure: str = parameter(
        "geodesic",
        str,
        labels=MEASURES,
        option="distance",
        help="kind of distance; default: geodesic",
    )
    #: Vertex from which distances are measured.
    vertex: int | None = parameter(None, Index, vertex=True)
    #: Diffusion time, in squared length units; None as in `time_in`.
    time: float | None = parameter(
        None,
        Positive,
        power=2,
        option="time",
        metavar="T",
        help="diffusion time (unit²); default: the middle of its range",
    )
    #: One vertex for each exported column; if empty, only `vertex`.
    vertices: tuple[int, ...] = parameter(
        (),
        tuple[Index, ...],
        vertex=True,
        saved=False,
        option="vertex",
        metavar="V",
        help="vertex from which distances are measured, from 0; each is a column",
    )

    # -- choices ------------------------------------------------------------------------------

    @property
    def definition(self) -> str:
        return {
            "geodesic": "length of the shortest way on the surface",
            "biharmonic": "√ Σ (φ − φ(pin))² / λ²",
            "commute": "√ Σ (φ − φ(pin))² / λ",
            "diffusion": "√ Σ exp(−2λt) (φ − φ(pin))²",
        }[self.measure]

    @property
    def needs_pairs(self) -> bool:
        return self.measure != "geodesic"

    @property
    def divergence(self) -> str:
        diverges = "The commute time does not converge: it grows with every further pair"
        return diverges if self.measure == "commute" else ""

    @property
    def timed(self) -> bool:
        """Whether the distance depends on a time."""
        return self.measure == "diffusion"

    def time_in(self, spectrum: Eigenpairs) -> float:
        """Return the chosen time, or the middle of the range in log scale."""
        low, high = spectrum.time_range
        return math.sqrt(low) * math.sqrt(high) if self.time is None else self.time

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        return replace(self, time=self.time_in(spectrum) if self.timed else None)

    def for_other_mesh(self, n_components: int) -> Self:
        return replace(self, vertex=None, time=None, vertices=())

    def for_repair(self, n_components: int) -> Self:
        return replace(self.for_other_mesh(n_components), time=self.time)

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        """Return indices into `vertices` if there are several, else log10 of diffusion times."""
        if len(self.vertices) > 1:
            return np.arange(len(self.vertices), dtype=np.float64)
        if not self.timed or first_nonzero(spectrum) >= len(spectrum):
            return np.empty(0)
        return evenly_in_log(spectrum.time_range, _STEPS + 1)

    def place(self, spectrum: Eigenpairs) -> float:
        if len(self.vertices) > 1 and self.vertex is not None:
            return float(self.vertices.index(self.vertex))
        return math.log10(self.time_in(spectrum)) if self.timed else 0.0

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        if len(self.vertices) > 1:
            return replace(self, vertex=self.vertices[round(place)])
        return replace(self, time=10.0**place) if self.timed else self

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        noun, power = MEASURES[self.measure]
        text = "" if self.vertex is None else f"from {spectrum.named_vertex(self.vertex)}"
        if text and self.timed:
            text += f", t = {format_quantity(self.time_in(spectrum), unit, 2)}"
        return Description(text, f"{noun} distance", power)

    # -- values -------------------------------------------------------------------------------

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        """Compute distances, with the table if possible; geodesic distances need a table."""
        if self.vertex is None:
            return None
        if table is not None and self.prepared(spectrum, table):
            content = table.content
            if self.measure == "geodesic":
                return Answer(content.from_vertex(self.vertex).astype(np.float32))
            if not self.timed:
                return Answer(content)
            if content.covers(2.0 * self.time_in(spectrum)):
                return Answer(self._root(content.at(2.0 * self.time_in(spectrum))))
        return None if self.measure == "geodesic" else Answer(self._sum(spectrum, None))

    def _sum(self, spectrum: Eigenpairs, cancel: Cancel) -> ColumnArray:
        """Compute spectral distances by the sum over all pairs."""
        weights = spectral_weights(self.measure, spectrum.eigenvalues, self._time(spectrum))
        squares = sum_squares(self._rows(spectrum), weights[None], cancel=cancel)[0]
        self._leave_out(squares, spectrum)
        return self._root(squares)

    def _time(self, spectrum: Eigenpairs) -> float:
        return self.time_in(spectrum) if self.timed else 1.0

    def _rows(self, spectrum: Eigenpairs) -> Any:
        assert self.vertex is not None
        return RowsFrom(spectrum.rows, self.vertex)

    def _root(self, squares: ColumnArray) -> ColumnArray:
        """Replace squares by distances in place, exactly 0 at the vertex."""
        assert self.vertex is not None
        distances = np.sqrt(np.maximum(squares, 0.0, out=squares), out=squares)
        distances[self.vertex] = 0.0
        return distances

    def _leave_out(self, squares: npt.NDArray[np.floating], spectrum: Eigenpairs) -> None:
        """Set NaN on other connected components."""
        if spectrum.mesh is not None and spectrum.mesh.n_components > 1:
            labels = spectrum.mesh.component_labels
            squares[labels != labels[self.vertex]] = np.nan

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        if table is None or not isinstance(table.family, Distances):
            return False
        if self.measure == "geodesic":
            return table.family.measure == "geodesic" and table.content.mesh is spectrum.mesh
        same = replace(table.family, time=None) == replace(self, time=None)
        return same and same_pairs(table.spectrum, spectrum)

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        content: Any
        if self.measure == "geodesic":
            assert spectrum.mesh is not None
            content = GeodesicSolver(spectrum.mesh)
        elif self.timed:
            # squared distances are the heat kernel signature of φ − φ(pin) at twice the time
            low, high = spectrum.time_range
            from_here = replace(spectrum, rows=self._rows(spectrum))
            content = build_heat_table(from_here, (2.0 * low, 2.0 * high), cancel)
            self._leave_out(content.base, spectrum)
        else:
            content = self._sum(spectrum, cancel)
        return Table(spectrum, self, content)

    def missing(self, spectrum: Eigenpairs, typical: float) -> float:
        """Estimate the share of a typical distance due to pairs that were not computed."""
        mesh = spectrum.mesh
        if mesh is None or self.measure == "geodesic" or not typical > 0.0:
            return 0.0
        n, values = spectrum.n_vertices, spectrum.eigenvalues
        left = missing_square(self.measure, values, mesh.area, n, self._time(spectrum))
        return 1.0 - typical / math.sqrt(typical**2 + left)

    def sufficient(self, spectrum: Eigenpairs, typical: float) -> Target | None:
        """Return the target with a missing share of `TOLERANCE`; None if it is reached."""
        missing, mesh = self.missing(spectrum, typical), spectrum.mesh
        if missing <= TOLERANCE or mesh is None:
            return None
        area, n, known, time = mesh.area, spectrum.n_vertices, len(spectrum), self._time(spectrum)
        allowed = (typical / (1.0 - missing)) ** 2 * (1.0 - (1.0 - TOLERANCE) ** 2)
        last = float(spectrum.eigenvalues[-1])

        def suffices(count: int) -> bool:
            reached = np.broadcast_to(last + weyl_eigenvalue(area, count - known), count)
            return missing_square(self.measure, reached, area, n, time) <= allowed

        return Target("count", known + bisect_left(range(known, n), True, key=suffices))

    # -- files --------------------------------------------------------------------------------

    @classmethod
    def exported(cls, n_columns: int | None = None, unit: str | None = None, **chosen: Any) -> Self:
        vertices = tuple(chosen.get("vertices", ()))
        measure, time = chosen.get("measure", cls.measure), chosen.get("time")
        if n_columns is not None:
            fault = "Distances have one column for each --vertex"
            raise InputError("conflicting-arguments", fault, "omit --n-components")
        if not vertices or len(set(vertices)) < len(vertices):
            raise InputError("no-vertices", _FROM, "give --vertex, from 0, each once")
        if time is not None and measure != "diffusion":
            fault = f"--time is for --distance diffusion, not for {measure}"
            raise InputError("conflicting-arguments", fault)
        if time is not None:
            check_positive(time, "--time")
        return cls(measure, vertices[0], time, vertices)

    @property
    def _origins(self) -> tuple[int, ...]:
        found = self.vertices or (() if self.vertex is None else (self.vertex,))
        if not found:
            raise InputError("no-vertices", _FROM, "pin one on the render")
        return found

    def check_mesh(self, mesh: Mesh) -> None:
        check_vertices(mesh, self._origins)

    def compute_features(
        self, pairs: Eigenpairs | None, mesh: Mesh, bound: float | None = None, **summed: Any
    ) -> Features:
        """Compute the exported columns from all nonzero pairs; `summed` is ignored."""
        time = None
        if self.timed and pairs is not None:
            none = np.empty((0, 0))
            time = self.time_in(Eigenpairs(pairs.eigenvalues, none, none))
        return distance_features(mesh, self._origins, self.measure, pairs, time)

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        origins = [spectrum.file_index(at) for at in self._origins]
        text = f"{MEASURES[self.measure][0]} distance from {counted(len(origins), 'vertex')}"
        if self.timed:
            text += f", t = {format_quantity(self.time_in(spectrum), unit, 2)}"
        return distance_columns(self.measure, origins), f"{text}."

    def script(self, spectrum: Eigenpairs) -> list[str]:
        pairs = f", {self.measure!r}, decomposition" if self.needs_pairs else ""
        time = f", time={self.time_in(spectrum)!r}" if self.timed else ""
        assert self.vertex is not None, "only for a shown field"
        origins = ", ".join(spectrum.vertex_script(at) for at in self._origins)
        return [
            f"features = mv.distance_features(mesh, [{origins}]{pairs}{time})",
            f"values = features.values[:, {self._origins.index(self.vertex)}]",
        ]

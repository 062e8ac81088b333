"""A random walk over all recorded changes, undone and redone at random moments.

A new kind of change needs an entry in `ACTIONS`: each part of the history must be changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapes
from tiers import slow

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.model.display import Shape
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.limits import LockedLimits, MinMaxLimits, PercentileLimits
from meshmash_viewer.model.open_mesh import MapGrew, Shown
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

#: Number of eigenpairs.
_PAIRS = 6


@dataclass
class _Channel:
    """A channel of a job that runs in this process."""

    folder: Path
    send: Callable[[Any], object]

    def report(self, progress: object) -> None: ...

    def cancelled(self) -> bool:
        return False


class Walk:
    """A document without a window, whose jobs run at once."""

    def __init__(self, path: Path, repairs: tuple[str, ...], seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.document = document = Document()
        self.channel = _Channel(path.parent, print)
        document.work.requested.connect(self._run)
        document.solve.target = Target("count", _PAIRS)
        document.open_mesh(path, "nm", repairs=repairs)
        #: The state before the first step and after each step, or None if unknown.
        self.states: list[Any] = [*[None] * len(document.history.past), self.state()]
        #: Changed parts of the history.
        self.changed: set[str] = set()

    def _run(self, job: Job) -> None:
        work = self.document.work
        work.started(job)
        self.channel.send = job.receive
        job.take(job.work(self.channel).content)
        work.ended()

    def state(self) -> dict[str, Any]:
        """Return the state of the history, with the mesh as comparable values."""
        state = self.document.history.read()
        shown = state["mesh"]
        assert isinstance(shown, Shown)
        mesh = shown.ready.mesh
        spectrum = shown.spectrum
        assert spectrum is None or spectrum.mesh is mesh
        assert all(pin.vertex < mesh.n_vertices for pin in self.document.pins.placed)
        maps = [(each.name, each.unit, each.values.tobytes()) for each in mesh.maps]
        indices = mesh.file_indices.tobytes()
        del state["kind"]  # what is displayed is not a change
        # computed pairs limit positions, which is not a change
        fields = {
            part: replace(value.at_rest(), **dict.fromkeys(value.own, ""))
            for part, value in state.items()
            if part.startswith("field ")
        }
        return (
            state
            | fields
            | {
                "mesh": (
                    mesh.content_hash,
                    indices,
                    mesh.unit,
                    mesh.voxel,
                    maps,
                    shown.ready.repairs,
                ),
            }
        )

    def act(self, name: str) -> None:
        """Make a change by its name in `ACTIONS`, and record the state if it is a step."""
        history, before = self.document.history, self.document.history.past
        ACTIONS[name](self)
        if history.past[-1:] != before[-1:]:
            self.changed |= {each.removeprefix("first/") for each in history.past[-1].state}
            del self.states[len(before) + 1 :]
            # a gesture adds no step, and some actions add several
            self.states += [None] * (len(history.past) - len(before))
            self.states[-1] = self.state()
        assert len(self.states) == len(history.past) + len(history.future) + 1, name
        assert not history.future or history.past == before, name

    def cross(self, steps: int) -> None:
        """Undo (negative) or redo steps, and compare the state after each."""
        history = self.document.history
        for _ in range(abs(steps)):
            label = history.undo_label if steps < 0 else history.redo_label
            (history.undo if steps < 0 else history.redo)()
            at, now = len(history.past), self.state()
            if self.states[at] is None:
                self.states[at] = now
            for part, value in now.items():
                assert value == self.states[at][part], (label, part, at)

    def pick(self, values: Any) -> Any:
        """Return one of the values at random."""
        values = list(values)
        return values[int(self.rng.integers(len(values)))]

    def vertex(self) -> int:
        """Return a random vertex of the open mesh."""
        assert self.document.mesh is not None
        return int(self.rng.integers(self.document.mesh.n_vertices))


def _rename(walk: Walk) -> None:
    if pin := walk.pick([*walk.document.pins.placed, None]):
        color = walk.pick(["", "#123456"])
        walk.document.pins.change("pin", pin.vertex, name=f"spine {pin.number}", own_color=color)


def _unpin(walk: Walk) -> None:
    if pin := walk.pick([*walk.document.pins.placed, None]):
        walk.document.pins.toggle(pin.vertex)


def _flip(walk: Walk) -> None:
    display = walk.document.display
    display.kind = Eigenfunctions.name
    display.change(Eigenfunctions, index=int(walk.rng.integers(_PAIRS)))
    walk.document.flip()


def _limits(walk: Walk) -> None:
    display = walk.document.display
    display.kind = walk.pick(FAMILIES)
    low = float(walk.rng.random())
    choices = [None, MinMaxLimits(), PercentileLimits(), LockedLimits(low, low + 1.0)]
    display.set_limits(walk.pick(choices))


def _log_scales(walk: Walk) -> None:
    walk.document.display.log_scales = {walk.pick(FAMILIES): walk.pick([True, False])}


def _add_map(walk: Walk) -> None:
    mesh = walk.document.mesh
    assert mesh is not None
    values = walk.rng.random(mesh.n_vertices).astype(np.float32)
    walk.document.maps.add(mesh, [VertexMap(f"m{walk.vertex()}", values)])


def _remove_map(walk: Walk) -> None:
    mesh = walk.document.mesh
    assert mesh is not None
    if mesh.maps:
        walk.document.maps.remove(walk.pick(mesh.maps).name)


def _grow_map(walk: Walk) -> None:
    mesh, maps = walk.document.mesh, walk.document.maps
    assert mesh is not None
    for _ in range(2):
        some = np.flatnonzero(walk.rng.random(mesh.n_vertices) < 0.5)
        maps.grow(mesh, MapGrew("grown", some, np.ones(len(some))))
        if walk.pick([True, False, False]):  # another change meanwhile
            walk.document.set_unit(walk.pick(["nm", "µm"]))
    maps.end_growing(whole=walk.pick([True, False]))


def _compute(walk: Walk) -> None:
    document = walk.document
    document.solve.target = Target("count", _PAIRS)
    if document.solve.can_compute:
        document.solve.compute()


ACTIONS: dict[str, Callable[[Walk], object]] = {
    "pin": lambda walk: walk.document.pins.toggle(walk.vertex()),
    "pin again": lambda walk: walk.document.pins.toggle(walk.vertex(), walk.pick(range(1, 9))),
    "remove a pin": _unpin,
    "rename a pin": _rename,
    "clear pins": lambda walk: walk.document.pins.clear(),
    "flip": _flip,
    "unit": lambda walk: walk.document.set_unit(walk.pick(["nm", "µm", "none"])),
    "voxel": lambda walk: walk.document.set_unit(walk.pick(["nm", "8 nm", "4 x 4 x 40 nm"])),
    "limits": _limits,
    "log scale": _log_scales,
    "rotate": lambda walk: walk.document.rotate(1, walk.pick([15, 30, 90])),
    "hide small": lambda walk: setattr(
        walk.document.display, "hide_small", walk.pick([True, False])
    ),
    "diverging": lambda walk: setattr(
        walk.document.display, "diverging_colormap", walk.pick(["RdBu_r", "PuOr", "coolwarm"])
    ),
    "sequential": lambda walk: setattr(
        walk.document.display, "sequential_colormap", walk.pick(["viridis", "magma", "cividis"])
    ),
    "times": lambda walk: walk.document.display.change(
        HeatKernelSignature, scales=walk.pick(range(8, 40))
    ),
    "rebuilt shape": lambda walk: setattr(
        walk.document.display, "shape", Shape(True, walk.pick(range(4, 9)))
    ),
    "target": lambda walk: setattr(
        walk.document.solve, "target", Target("count", walk.pick([5, 6, 7]))
    ),
    "live": lambda walk: setattr(walk.document.classes, "live", walk.pick([True, False])),
    "add a map": _add_map,
    "remove a map": _remove_map,
    "grow a map": _grow_map,
    "compute": _compute,
    **{name: lambda walk, name=name: walk.document.repair(name) for name in REPAIRS},  # type: ignore[misc]
}


def dirty(path: Path) -> Path:
    """Write a mesh file with all faults that repairs correct."""
    sheet, ball = shapes.rectangle(6, 5), shapes.icosphere(1, radius=0.3)
    other = sheet.vertices + np.array([2.0, 0.0, 0.0])  # left edge on the sheet's right edge
    n = sheet.n_vertices
    faces = [
        sheet.faces,
        sheet.faces + n,
        ball.faces + 2 * n,
        sheet.faces[:2],
        sheet.faces[3:4, ::-1],
        [[0, 0, 1]],
    ]
    vertices = [sheet.vertices, other, ball.vertices + np.array([0.0, 0.0, 3.0]), [[9.0, 9.0, 9.0]]]
    vertices.append(sheet.vertices[:1])
    np.savez(path, vertices=np.concatenate(vertices), faces=np.concatenate(faces))
    return path


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Clock that times the gestures of the history."""
    time = SimpleNamespace(now=0.0, monotonic=lambda: time.now)
    monkeypatch.setattr("meshmash_viewer.model.history.time", time)
    return time


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("seed", "actions", "repairs"),
    [
        (1, 500, ("merge_seams",)),
        slow(2, 10_000, ()),
        slow(3, 10_000, ("merge_coincident_vertices", "drop_degenerate_faces")),
        slow(4, 10_000, tuple(REPAIRS)),
    ],
)
def test_what_is_undone_and_redone_at_random_comes_back(
    seed: int, actions: int, repairs: tuple[str, ...], tmp_path: Path, clock: SimpleNamespace
) -> None:
    walk = Walk(dirty(tmp_path / "dirty.npz"), repairs, seed)
    history, rng = walk.document.history, walk.rng
    for _ in range(actions):
        clock.now += walk.pick([0.1, 1.0, 10.0])
        chance = rng.random()
        if chance < 0.02:
            walk.cross(-int(rng.integers(len(history.past) + 1)))
        elif chance < 0.04:
            walk.cross(int(rng.integers(len(history.future) + 1)))
        elif chance < 0.2:
            walk.cross(-min(1, len(history.past)))
        elif chance < 0.3:
            walk.cross(min(1, len(history.future)))
        else:
            walk.act(walk.pick(ACTIONS))
    assert walk.changed == set(history.read()), "a kind of change without an action"
    walk.cross(len(history.future))
    steps, end = len(history.past), walk.state()
    walk.cross(-steps)
    assert not history.past
    assert walk.state() == walk.states[0]
    assert not walk.document.repairs
    walk.cross(steps)
    assert walk.state() == end


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("repair", REPAIRS)
def test_pins_follow_each_repair_by_the_index_in_the_file(repair: str, tmp_path: Path) -> None:
    walk = Walk(dirty(tmp_path / "dirty.npz"), (), 1)
    document = walk.document
    before = document.mesh
    assert before is not None
    for vertex in range(before.n_vertices):
        document.pins.toggle(vertex)
    placed = document.pins.placed
    document.repair(repair)
    mesh = document.mesh
    assert mesh is not None
    assert document.repairs == (repair,)
    left = {pin.number: pin.vertex for pin in document.pins.placed}
    assert len(set(left.values())) == len(left) == mesh.n_vertices, "one for each vertex that stays"
    for pin in placed:
        if pin.number in left:
            vertex = left[pin.number]
            np.testing.assert_array_equal(mesh.vertices[vertex], before.vertices[pin.vertex])
            assert mesh.vertex_of(pin.vertex) == vertex, "named by the index in the file"
    document.history.undo()
    assert document.pins.placed == placed

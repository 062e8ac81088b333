"""Random faults in the files of stored eigenpairs, and checks after each.

After a fault, returned values equal the stored ones, all batches before the first damaged pair are
available, and only the other pairs are written again, as they were before.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.cache import PAIRS, ROWS
from meshmash_viewer.io.spectrum import find_eigenpairs, obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target

FloatArray = npt.NDArray[np.float64]

OPERATOR = OperatorOptions()
_PAGE = 4096


def blanket(n_vertices: int, seed: int = 0) -> Mesh:
    """Return a wavy sheet of at least `n_vertices` vertices."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(n_vertices**0.5))
    x, y = np.indices((side, side)).reshape(2, -1).astype(np.float64)
    first = np.arange(side * side).reshape(side, side)[:-1, :-1].ravel()
    faces = np.concatenate(
        [first[:, None] + corners for corners in ([0, side, 1], [1, side, side + 1])]
    )
    height = rng.normal(size=3) @ np.stack([np.sin(x / 7), np.cos(y / 11), np.sin((x + y) / 5)])
    return Mesh(np.stack([x, 0.87 * y, height], axis=1), faces, name=f"blanket {seed}")


@dataclass(frozen=True, eq=False)
class Truth:
    """Expected content of a store.

    Parameters
    ----------
    mesh : Mesh
    pairs : Eigenpairs
        The stored pairs.
    solved : bool
        Whether the pairs are eigenpairs of the mesh; otherwise they are random numbers.
    stops : list of int
        Number of pairs up to the end of each batch.
    """

    mesh: Mesh
    pairs: Eigenpairs
    solved: bool
    stops: list[int]

    @property
    def store(self) -> EigenpairStore:
        """The store, newly opened."""
        return EigenpairStore(self.mesh, OPERATOR, Target("count", len(self.pairs)))

    def left(self, fault: Fault) -> int:
        """Return the number of pairs that a fault leaves."""
        n_pairs = len(self.pairs)
        if fault.pairs:
            return 0
        return max((stop for stop in self.stops if stop <= min(fault.first, n_pairs)), default=0)


def make_store(mesh: Mesh, n_pairs: int, n_batches: int, solved: bool, seed: int = 0) -> Truth:
    """Fill the store of a mesh batch by batch, or by the solver; return its content."""
    stops = [n_pairs * (i + 1) // n_batches for i in range(n_batches)]
    store = EigenpairStore(mesh, OPERATOR, Target("count", n_pairs))
    if solved:
        stops.clear()
        request = Request(n_pairs, on_pairs=lambda pairs: stops.append(len(pairs)))
        obtain_eigenpairs(mesh, OPERATOR, request)
    else:
        rng = np.random.default_rng(seed)
        rows = store.allocate(n_pairs)
        values = np.sort(rng.random(n_pairs))
        _, mass = cotangent_laplacian(mesh)
        begun = Eigenpairs(values, rows, np.full(n_pairs, 1e-12), mass=mass.diagonal())
        for start, stop in zip([0, *stops[:-1]], stops, strict=True):
            for index in range(start, stop):
                rng.standard_normal(out=rows[index])
            store.append(begun.first(stop))
        store.append(replace(begun, certificate=Certificate("inertia", n_pairs, n_pairs, 1.0)))
    found, remark = find_eigenpairs(mesh, OPERATOR, Target("count", n_pairs))
    assert found is not None
    assert not remark
    # A copy in memory, as the file will change.
    return Truth(mesh, replace(found, rows=np.array(found.rows)), solved, stops)


@dataclass
class Fault:
    """Change of the files of a store.

    Parameters
    ----------
    kind : str
    what : str
        Description of the change, to reproduce it.
    first : int
        First pair whose row is changed; at least the number of pairs if no row is.
    pairs : bool
        Whether the file of the other data of the pairs is changed.
    """

    kind: str
    what: str = ""
    first: int = 1 << 30
    pairs: bool = False


class Mutator:
    """Generator of random faults in a store.

    Parameters
    ----------
    truth : Truth
        Expected content of the store; to be set to the result of `mend`.
    other : Truth
        Content of the store of another mesh with equally many vertices.
    seed : int
    """

    def __init__(self, truth: Truth, other: Truth, seed: int) -> None:
        self.truth = truth
        self._folder, self._other = truth.store.folder, other.store.folder
        self._rng = np.random.default_rng(seed)
        self._kinds: dict[str, Callable[[Fault], None]] = {
            "bit": self._flip_bit,
            "page": self._spoil_page,
            "moved page": self._move_page,
            "truncation": self._truncate,
            "garbage at the end": self._append,
            "file of another mesh": self._take_file,
            "folder of another mesh": self._take_folder,
            "edited text": self._edit,
            "nonsense": self._replace,
            "removed file": self._remove,
        }

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of faults."""
        return tuple(self._kinds)

    def inflict(self, kind: str | None = None) -> Fault:
        """Cause a random fault, of the given kind if any, and return its description."""
        fault = Fault(kind or str(self._rng.choice(self.kinds)))
        k = self.truth.pairs.n_components
        while fault.first >= k and not fault.pairs:
            self._kinds[fault.kind](fault)  # repeated if nothing has changed
        return fault

    # -- kinds of faults ----------------------------------------------------------------------

    def _flip_bit(self, fault: Fault) -> None:
        path = self._any_file()
        place = int(self._rng.integers(path.stat().st_size))
        with path.open("r+b") as file:
            file.seek(place)
            byte = file.read(1)[0] ^ (1 << int(self._rng.integers(8)))
            file.seek(place)
            file.write(bytes([byte]))
        self._touch(fault, path, place, place + 1, "one bit")

    def _spoil_page(self, fault: Fault) -> None:
        path = self._any_file()
        place = _PAGE * int(self._rng.integers(-(-path.stat().st_size // _PAGE)))
        with path.open("r+b") as file:
            file.seek(place)
            before = file.read(_PAGE)
            zeros = bool(self._rng.integers(2))
            after = bytes(len(before)) if zeros else self._rng.bytes(len(before))
            file.seek(place)
            file.write(after)
        if before != after:
            self._touch(fault, path, place, place + len(before), "a page of zeros or noise")

    def _move_page(self, fault: Fault) -> None:
        path = self._folder / ROWS
        n_pages = path.stat().st_size // _PAGE
        if n_pages < 2:
            fault.kind = "bit"
            return
        source, target = (_PAGE * int(i) for i in self._rng.choice(n_pages, 2, replace=False))
        with path.open("r+b") as file:
            file.seek(source)
            page = file.read(_PAGE)
            file.seek(target)
            file.write(page)
        self._touch(fault, path, target, target + _PAGE, f"the page at {source}")

    def _truncate(self, fault: Fault) -> None:
        path = self._any_file()
        size = path.stat().st_size
        place = int(self._rng.integers(size))
        with path.open("r+b") as file:
            file.truncate(place)
        self._touch(fault, path, place, size, "cut")

    def _append(self, fault: Fault) -> None:
        path = self._any_file(sealed=True)
        with path.open("ab") as file:
            file.write(self._rng.bytes(int(self._rng.integers(1, 100))))
        self._touch(fault, path, 0, 0, "longer")

    def _take_file(self, fault: Fault) -> None:
        path = self._any_file()
        if not (self._other / path.name).exists():
            return
        shutil.copyfile(self._other / path.name, path)
        self._touch(fault, path, 0, path.stat().st_size, "taken from another mesh")

    def _take_folder(self, fault: Fault) -> None:
        shutil.rmtree(self._folder)
        shutil.copytree(self._other, self._folder)
        fault.what = "all files taken from another mesh"
        fault.first, fault.pairs = 0, True

    def _edit(self, fault: Fault) -> None:
        """Change a digit of the JSON text, which keeps its length."""
        path = self._any_file(sealed=True)
        content = bytearray(path.read_bytes())
        begin = content.index(b'{"certificate"')
        text = content[begin : begin + 60]  # a number and part of the following text
        digits = [i for i, c in enumerate(text) if chr(c).isdigit()]
        place = begin + int(self._rng.choice(digits))
        choices = [c for c in b"0123456789" if c != content[place]]
        content[place] = int(self._rng.choice(choices))
        path.write_bytes(content)
        self._touch(fault, path, place, place + 1, "another digit")

    def _replace(self, fault: Fault) -> None:
        path = self._any_file(sealed=True)
        texts = [b"", b"[]", b"{}", b"null", b"[" * 100_000, b"\x00" * 5000, b'{"key": 1e999}']
        path.write_bytes(texts[int(self._rng.integers(len(texts)))])
        self._touch(fault, path, 0, 0, "nonsense")

    def _remove(self, fault: Fault) -> None:
        path = self._any_file()
        size = path.stat().st_size
        path.unlink()
        self._touch(fault, path, 0, size, "removed")

    # -- locations of faults ------------------------------------------------------------------

    def _any_file(self, sealed: bool = False) -> Path:
        """Return the file of pairs or, at random unless `sealed`, the file of rows."""
        if not sealed and self._rng.integers(2):
            return self._folder / ROWS
        return self._folder / PAIRS

    def _touch(self, fault: Fault, path: Path, begin: int, end: int, how: str) -> None:
        fault.what += f"{path.name}: {how} at {begin}. "
        if path.name == ROWS:
            fault.first = min(fault.first, begin // (8 * self.truth.mesh.n_vertices))
        else:
            fault.pairs = True


def examine(truth: Truth, fault: Fault) -> None:
    """Check that a fault is detected and that undamaged pairs are available.

    Raises
    ------
    AssertionError
        If a value differs or an undamaged pair is missing.
    """
    k = truth.pairs.n_components
    left = truth.left(fault)
    stored, remark = find_eigenpairs(truth.mesh, OPERATOR, Target("count", k))
    assert (0 if stored is None else len(stored)) == left, fault
    # A store without its file of pairs counts as empty, which causes no remark.
    silent = fault.kind == "removed file" and fault.pairs
    assert bool(remark) == (left < k and not silent), fault
    if stored is not None:
        _compare(truth, stored)
        assert stored.complete == (left == k), fault


def mend(truth: Truth, fault: Fault) -> None:
    """Request all pairs again, and check that the store is as before.

    Raises
    ------
    AssertionError
        If undamaged pairs are written again or the result differs.
    """
    k = truth.pairs.n_components
    left = truth.left(fault)
    if truth.solved:
        found, remark = obtain_eigenpairs(truth.mesh, OPERATOR, Request(k))
        silent = fault.kind == "removed file" and fault.pairs
        assert bool(remark) == (left < k and not silent), (fault, remark)
        assert found.complete
    elif left < k:
        _write_again(truth)
    stored, remark = find_eigenpairs(truth.mesh, OPERATOR, Target("count", k))
    assert stored is not None
    assert not remark, fault
    assert truth.store.is_complete, fault
    _compare(truth, stored)


def _compare(truth: Truth, stored: Eigenpairs) -> None:
    pairs, count = truth.pairs, len(stored)
    np.testing.assert_array_equal(stored.eigenvalues, pairs.eigenvalues[:count])
    np.testing.assert_array_equal(stored.residuals, pairs.residuals[:count])
    np.testing.assert_array_equal(stored.rows, pairs.rows[:count])
    np.testing.assert_array_equal(stored.mass, pairs.mass)
    if count == len(pairs):
        assert stored.certificate == pairs.certificate


def _write_again(truth: Truth) -> None:
    """Write the missing random pairs, in place of the solver."""
    pairs, store = truth.pairs, truth.store
    with store:
        stored = store.load()
        kept = 0 if stored is None else len(stored)
        if kept < len(pairs):
            rows = store.allocate(len(pairs), n_kept=kept)
            np.testing.assert_array_equal(rows[:kept], pairs.rows[:kept])
            rows[kept:] = pairs.rows[kept:]
            for stop in truth.stops:
                if stop > kept:
                    store.append(replace(pairs.first(stop), certificate=Certificate("none")))
            store.append(pairs)

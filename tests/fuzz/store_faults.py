"""Random faults of stored eigenpairs, from a seed, and what must hold after each.

Whatever is done to the files of a store, no number that leaves the program may be another one than
was stored; whatever was not touched must still be there; and what was touched, and nothing else, is
made again. `benchmarks/stores.py` tries any number of faults.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.spectrum import find_eigenpairs, obtain_eigenpairs
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.io.stored_spectrum import PROOF, ROWS, StoredSpectrum
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigensolver import Decomposition
from meshmash_viewer.spectral.weyl import Target

FloatArray = npt.NDArray[np.float64]

OPERATOR = OperatorOptions()
LAPLACIAN = "laplacian.sealed"
_PAGE = 4096


def blanket(n_vertices: int, seed: int = 0) -> Mesh:
    """A wavy sheet of at least so many vertices."""
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
    """A store as it should be.

    Parameters
    ----------
    mesh : Mesh
    pairs : Decomposition
        What is in it.
    borders : list of (int, int)
        Start and stop of its batches.
    solved : bool
        Whether these are the mesh's eigenpairs; otherwise they are noise, which costs nothing.
    """

    mesh: Mesh
    pairs: Decomposition
    borders: list[tuple[int, int]]
    solved: bool

    @property
    def store(self) -> EigenpairStore:
        """A new handle of it."""
        return EigenpairStore(self.mesh, OPERATOR)


def make_store(mesh: Mesh, n_pairs: int, n_batches: int, solved: bool, seed: int = 0) -> Truth:
    """Fill the store of a mesh, batch by batch."""
    stops = [n_pairs * (i + 1) // n_batches for i in range(n_batches)]
    store = EigenpairStore(mesh, OPERATOR)
    if solved:
        for stop in stops:
            obtain_eigenpairs(mesh, OPERATOR, Target("count", stop))
    else:
        rng = np.random.default_rng(seed)
        rows = store.allocate(n_pairs)
        values = np.sort(rng.random(n_pairs))
        for start, stop in zip([0, *stops[:-1]], stops, strict=True):
            for index in range(start, stop):
                rng.standard_normal(out=rows[index])
            store.append(start, values[start:stop], np.full(stop - start, 1e-12))
        stiffness, mass = cotangent_laplacian(mesh)
        store.keep_laplacian(stiffness, mass)
        certificate = Certificate("inertia", n_pairs, n_pairs, 1.0)
        store.finish(
            Decomposition(values, rows, np.full(n_pairs, 1e-12), certificate, mass=mass.diagonal())
        )
    return _as_stored(mesh, n_pairs, solved)


def _as_stored(mesh: Mesh, n_pairs: int, solved: bool) -> Truth:
    stored = find_eigenpairs(mesh, OPERATOR, count=n_pairs)
    assert stored is not None
    assert not stored.faults
    found = stored.decomposition(n_pairs)
    # In memory: what is in the file will change.
    pairs = replace(found, rows=np.array(found.rows))
    return Truth(mesh, pairs, [(b.start, b.stop) for b in stored.batches], solved)


@dataclass
class Fault:
    """Something done to the files of a store.

    Parameters
    ----------
    kind : str
    what : str
        In words, to repeat it.
    batches : set of (int, int)
        Those that it touches.
    proof, laplacian : bool
        Whether it touches these.
    """

    kind: str
    what: str = ""
    batches: set[tuple[int, int]] = field(default_factory=set)
    proof: bool = False
    laplacian: bool = False


class Mutator:
    """Inflicts random faults on a store.

    Parameters
    ----------
    truth : Truth
        What the store should be; to be replaced after `mend`.
    other : Truth
        Of another mesh with as many vertices.
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
            "swapped batches": self._swap_batches,
            "file of another mesh": self._take_file,
            "folder of another mesh": self._take_folder,
            "edited text": self._edit,
            "nonsense": self._replace,
            "removed file": self._remove,
        }

    @property
    def kinds(self) -> tuple[str, ...]:
        """What can be done."""
        return tuple(self._kinds)

    def inflict(self, kind: str | None = None) -> Fault:
        """Do something random, or something random of a kind."""
        fault = Fault(kind or str(self._rng.choice(self.kinds)))
        while not (fault.batches or fault.proof or fault.laplacian):
            self._kinds[fault.kind](fault)  # again, where it has changed nothing
        return fault

    # -- what can be done ---------------------------------------------------------------------

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

    def _swap_batches(self, fault: Fault) -> None:
        one, two = (
            self._batch_file(self.truth.borders[i])
            for i in self._rng.choice(len(self.truth.borders), 2, replace=False)
        )
        content = one.read_bytes()
        one.write_bytes(two.read_bytes())
        two.write_bytes(content)
        for path in (one, two):
            self._touch(fault, path, 0, 0, "exchanged")

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
        fault.batches, fault.proof, fault.laplacian = set(self.truth.borders), True, True

    def _edit(self, fault: Fault) -> None:
        """Change a character of the JSON, the length staying the same."""
        path = self._any_file(sealed=True)
        content = bytearray(path.read_bytes())
        begin = content.index(b'{"key"')
        text = content[begin : begin + 60]  # the key and something of what follows
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

    # -- where --------------------------------------------------------------------------------

    def _any_file(self, sealed: bool = False) -> Path:
        """Half the time the file of rows, which is nearly all there is."""
        if not sealed and self._rng.integers(2):
            return self._folder / ROWS
        names = [PROOF, LAPLACIAN, *(self._batch_file(b).name for b in self.truth.borders)]
        return self._folder / str(self._rng.choice(names))

    def _batch_file(self, batch: tuple[int, int]) -> Path:
        return self._folder / f"pairs-{batch[0]:06d}-{batch[1]:06d}.sealed"

    def _touch(self, fault: Fault, path: Path, begin: int, end: int, how: str) -> None:
        fault.what += f"{path.name}: {how} at {begin}. "
        if path.name == ROWS:
            row = 8 * self.truth.mesh.n_vertices
            first, last = begin // row, -(-end // row)
            fault.batches |= {
                (start, stop) for start, stop in self.truth.borders if start < last and first < stop
            }
        elif path.name == PROOF:
            fault.proof = True
        elif path.name == LAPLACIAN:
            fault.laplacian = True
        else:
            fault.batches.add(next(b for b in self.truth.borders if self._batch_file(b) == path))


def examine(truth: Truth, fault: Fault) -> None:
    """See that a fault is found, and that what is not touched is still there.

    Raises
    ------
    AssertionError
        If another number came out, or something whole did not.
    """
    k = truth.pairs.n_components
    stored = find_eigenpairs(truth.mesh, OPERATOR, count=k)
    there = set() if stored is None else {(b.start, b.stop) for b in stored.batches}
    assert there == set(truth.borders) - fault.batches, (fault, sorted(there))
    if stored is not None:
        _compare(truth, stored)
        assert (stored.proof is None) == fault.proof, fault
        for start, stop in fault.batches:
            said = f"eigenpairs {start} to {stop - 1}" in stored.faults
            # The batches of another mesh may have other borders.
            assert said or (fault.kind == "folder of another mesh" and stored.faults), fault
        first = min((start for start, _ in fault.batches), default=k)
        assert stored.n_proven == (0 if fault.proof else first), fault
    matrices = truth.store.laplacian()
    assert (matrices is None) == fault.laplacian, fault


def mend(truth: Truth, fault: Fault) -> Truth:
    """Ask for all pairs again, and see that only what was touched has been made again.

    Returns
    -------
    Truth
        The store as it is now: another basis of a multiple eigenvalue is as good.

    Raises
    ------
    AssertionError
        If something else was written, or the result is another one.
    """
    k, folder = truth.pairs.n_components, truth.store.folder
    kept = {
        path: path.stat().st_mtime_ns
        for start, stop in set(truth.borders) - fault.batches
        for path in folder.glob(f"pairs-{start:06d}-{stop:06d}*")
    }
    if truth.solved:
        if fault.laplacian and not (fault.batches or fault.proof):  # nobody needs it
            truth.store.keep_laplacian(*cotangent_laplacian(truth.mesh, robust=True))
        found = obtain_eigenpairs(truth.mesh, OPERATOR, Target("count", k))
        # Without a proof pairs are as after a kill, which is nothing to speak of.
        silent = fault.kind == "removed file" and fault.proof
        worth = bool(fault.batches or fault.proof) and not silent
        assert bool(found.remark) == worth, (fault, found.remark)
        assert found.decomposition.complete
        np.testing.assert_allclose(
            found.decomposition.eigenvalues, truth.pairs.eigenvalues, rtol=1e-9, atol=1e-12
        )
    elif fault.batches or fault.proof or fault.laplacian:
        _write_again(truth, fault)
    for path, written in kept.items():
        assert path.stat().st_mtime_ns == written, f"{fault}: {path.name} was written again"
    stored = find_eigenpairs(truth.mesh, OPERATOR, count=k)
    assert stored is not None
    assert not stored.faults, fault
    assert stored.n_proven == k, fault
    for start, stop in truth.borders:
        if (start, stop) not in fault.batches:
            np.testing.assert_array_equal(stored.rows[start:stop], truth.pairs.rows[start:stop])
    if not truth.solved:
        _compare(truth, stored)
        return truth
    now = _as_stored(truth.mesh, k, solved=True)
    np.testing.assert_allclose(_heat_kernel(now), _heat_kernel(truth), rtol=1e-6)
    return now


def _heat_kernel(truth: Truth) -> FloatArray:
    pairs = truth.pairs
    return np.exp(-10.0 * pairs.eigenvalues / pairs.eigenvalues[-1]) @ pairs.rows**2


def _compare(truth: Truth, stored: StoredSpectrum) -> None:
    pairs = truth.pairs
    for batch in stored.batches:
        part = slice(batch.start, batch.stop)
        np.testing.assert_array_equal(batch.eigenvalues, pairs.eigenvalues[part])
        np.testing.assert_array_equal(batch.residuals, pairs.residuals[part])
        np.testing.assert_array_equal(stored.rows[part], pairs.rows[part])
    if stored.proof is not None:
        assert stored.proof.certificate == pairs.certificate
        assert stored.proof.n_pairs == pairs.n_components
        np.testing.assert_array_equal(stored.proof.mass, pairs.mass)


def _write_again(truth: Truth, fault: Fault) -> None:
    """What the solver would do for noise."""
    pairs, store = truth.pairs, truth.store
    touched = [i for start, stop in fault.batches for i in range(start, stop)]
    kept = np.setdiff1d(np.arange(pairs.n_components), touched)
    with store:
        if fault.laplacian:
            store.keep_laplacian(*cotangent_laplacian(truth.mesh))
        rows = store.extend(pairs.n_components, None, kept)
        np.testing.assert_array_equal(rows[kept], pairs.rows[kept])
        for start, stop in sorted(fault.batches):
            rows[start:stop] = pairs.rows[start:stop]
            store.append(start, pairs.eigenvalues[start:stop], pairs.residuals[start:stop])
        store.finish(pairs)

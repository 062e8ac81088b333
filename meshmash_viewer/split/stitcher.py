"""Split a mesh into overlapping pieces, apply a function to each in parallel, and stitch.

For local quantities (heat kernel signatures at short times, curvatures) on meshes that are too
large to be decomposed whole: on a piece the spectrum is cheap, and away from the cut the result is
that of the whole mesh, because heat has not yet seen the cut.
"""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from scipy import sparse
from threadpoolctl import threadpool_limits

from meshmash_viewer.errors import ConstantFeaturesWarning, InputError
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, Cancelled, Progress, ProgressCallback
from meshmash_viewer.split.partition import edge_graph, interior_depth, overlapping_pieces

__all__ = ["MeshStitcher", "PieceError"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
#: ``(vertices, faces)`` of one piece, the indices of `faces` counted within it.
PieceMesh: TypeAlias = tuple[FloatArray, IntArray]


class PieceError(RuntimeError):
    """The function failed on a piece; the message names the piece and tells the failure."""


class MeshStitcher:
    """Split, apply, stitch.

    Parameters
    ----------
    mesh : MeshLike
        Any accepted form of a mesh.
    n_jobs : int
        Processes to work in, as joblib counts them: -1 is one for each core, 1 is none beside
        this one. Within ``joblib.parallel_config`` the backend named there is used, which may be
        a cluster.

    Attributes
    ----------
    mesh : Mesh
    pieces : tuple of ndarray of int
        Vertices of each piece, increasing; empty before `split_mesh`.

    Examples
    --------
    >>> import trimesh
    >>> stitcher = mv.MeshStitcher(trimesh.creation.icosphere(3), n_jobs=1)
    >>> stitcher.split_mesh(max_vertex_threshold=400)
    >>> times = {"t_min": 0.5, "t_max": 2.0}  # the same for all pieces
    >>> hks = stitcher.apply(lambda piece: mv.compute_hks(piece, count="auto", **times))
    >>> len(stitcher.pieces) > 1, hks.shape
    (True, (642, 32))

    Without `t_min` and `t_max` every piece would take those of its own spectrum, and a column would
    mean another time on each of them.
    """

    def __init__(self, mesh: MeshLike, n_jobs: int = -1) -> None:
        if n_jobs == 0:
            raise InputError("n_jobs=0 leaves nobody to work: give 1, or -1 for all cores.")
        self.mesh: Mesh = as_mesh(mesh)
        self.n_jobs = n_jobs
        self.pieces: tuple[IntArray, ...] = ()
        self._piece_faces: list[IntArray] = []
        self._piece_of: IntArray = np.full(self.mesh.n_vertices, -1)

    def split_mesh(self, max_vertex_threshold: int = 20_000, overlap: float = 0.15) -> None:
        """Cut the mesh into overlapping pieces; they are then in `pieces`.

        Parameters
        ----------
        max_vertex_threshold : int
            Vertices that a piece may have, its overlap included. Components with no more than
            that stay whole, and small ones share a piece.
        overlap : float
            How far a piece reaches beyond its core, relative to the size of a full piece, which
            is the square root of its mean area: no unit, and the same for a scaled mesh. Where
            vertices are so dense that this does not fit, the overlap is narrower, but always
            holds every neighbour of the core.

        Raises
        ------
        InputError
            If the threshold is too small for a vertex and its neighbours, or the overlap is
            negative or not finite.
        """
        threshold = int(max_vertex_threshold)
        if threshold < 3:
            raise InputError(
                f"max_vertex_threshold={max_vertex_threshold} is less than a triangle has: "
                "give some thousands."
            )
        if not (np.isfinite(overlap) and overlap >= 0.0):
            raise InputError(
                f"overlap={overlap} is not a width: give a number from 0 to about 0.5."
            )
        mesh = self.mesh
        n_used = int(np.count_nonzero(mesh.referenced))
        width = overlap * float(np.sqrt(mesh.area * threshold / n_used))
        graph = edge_graph(mesh)
        pieces = overlapping_pieces(graph, mesh.component_labels, threshold, width)

        piece_of = np.full(mesh.n_vertices, -1)
        deepest = np.full(mesh.n_vertices, -1.0)
        faces_of_mesh = mesh.faces[mesh.distinct_corners]
        face = np.repeat(np.arange(len(faces_of_mesh)), 3)
        faces_at = sparse.csc_array(
            (np.ones(face.size, dtype=np.int8), (face, faces_of_mesh.ravel())),
            shape=(len(faces_of_mesh), mesh.n_vertices),
        )
        kept = []
        for number, piece in enumerate(pieces):
            depth = interior_depth(graph, piece)
            met, n_corners = np.unique(faces_at[:, piece].indices, return_counts=True)
            faces = np.searchsorted(piece, faces_of_mesh[met[n_corners == 3]])
            # A vertex whose faces were all cut off has no place in a mesh of the others.
            used = np.zeros(len(piece), dtype=np.bool_)
            used[faces] = True
            renumbered = np.cumsum(used) - 1
            piece, depth, faces = piece[used], depth[used], renumbered[faces]
            better = depth > deepest[piece]
            piece_of[piece[better]] = number
            deepest[piece[better]] = depth[better]
            kept.append((piece, faces))
        # A piece that is nowhere the deepest would be worked on for nothing.
        owners, self._piece_of = np.unique(piece_of, return_inverse=True)
        if owners[0] < 0:
            owners, self._piece_of = owners[1:], self._piece_of - 1
        self.pieces = tuple(kept[number][0] for number in owners)
        self._piece_faces = [kept[number][1] for number in owners]

    def piece_mesh(self, number: int) -> PieceMesh:
        """Return a fresh copy of one piece as ``(vertices, faces)``."""
        return self.mesh.vertices[self.pieces[number]], self._piece_faces[number].copy()

    def apply(
        self,
        function: Callable[[PieceMesh], Any],
        stitch: bool = True,
        *,
        done: Callable[[IntArray, Any], None] | None = None,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
    ) -> Any:
        """Call a function on every piece, in parallel, and put the results together.

        Parameters
        ----------
        function : callable
            Takes ``(vertices, faces)`` of a piece; may be a lambda. It runs with one BLAS thread,
            and where pieces are worked on side by side, what it solves takes one core.
            To be stitched, it returns a value or a row of values for each vertex: shape (n_i,)
            or (n_i, f).
        stitch : bool
            Whether to return one array for the whole mesh, each vertex with the value of the
            piece it lies deepest in (farthest from the cut along the edges), or the list of what
            the function returned, in the order of `pieces`.
        done : callable, optional
            Called with the vertices that a piece gives its values to, and these values, as soon as
            they are there.
        progress, cancel : callable, optional
            See `meshmash_viewer.progress`; called between pieces.

        Returns
        -------
        ndarray, shape (n,) or (n, f), or list
            Unreferenced vertices are in no piece: they are NaN, and integer results become
            floating-point where there are any.

        Raises
        ------
        PieceError
            If the function fails on a piece; the message says on which.
        InputError
            If what it returned cannot be stitched.
        Cancelled
            If `cancel` returned True.

        Notes
        -----
        Splits with the defaults where `split_mesh` has not been called.
        """
        if not self.pieces:
            self.split_mesh()
        results: list[Any] = []
        total, began = len(self.pieces), time.monotonic()
        for result in self._results(function, cancel):
            if done is not None:
                piece = self.pieces[len(results)]
                own = self._piece_of[piece] == len(results)
                done(piece[own], np.asarray(result)[own])
            results.append(result)
            if progress is not None:
                share = len(results) / total
                left = (time.monotonic() - began) * (1.0 / share - 1.0)
                message = f"{len(results)} of {total} pieces"
                progress(Progress("pieces", share, remaining=left, message=message))
        return self.stitched(results) if stitch else results

    def seams(self, results: list[Any]) -> FloatArray:
        """How far neighbouring pieces differ where the one takes over from the other.

        Parameters
        ----------
        results : list of ndarray, each of shape (n_i, f)
            What `apply` returned with ``stitch=False``.

        Returns
        -------
        ndarray of float64, shape (s, f)
            At each vertex beside a seam that two pieces hold, the difference of their values, over
            the larger of the two. Without seams, as where each piece is a component of its own,
            shape (0, f).
        """
        first, second = edge_graph(self.mesh).tocoo().coords
        owners = self._piece_of
        across = (owners[first] != owners[second]) & (owners[first] >= 0) & (owners[second] >= 0)
        # each vertex beside a seam, its own piece and that of its neighbour
        told = np.unique(
            np.stack([first[across], owners[first[across]], owners[second[across]]], axis=1), axis=0
        )
        differences = [np.empty((0, np.asarray(results[0]).reshape(len(results[0]), -1).shape[1]))]
        for one, other in np.unique(told[:, 1:], axis=0):
            vertices = told[(told[:, 1] == one) & (told[:, 2] == other), 0]
            vertices = vertices[np.isin(vertices, self.pieces[other])]
            both = [
                np.asarray(results[piece])[np.searchsorted(self.pieces[piece], vertices)]
                for piece in (one, other)
            ]
            here, there = (np.reshape(values, (len(vertices), -1)) for values in both)
            largest = np.maximum(np.abs(here), np.abs(there))
            differences.append(
                np.divide(
                    np.abs(here - there), largest, out=np.zeros(here.shape), where=largest > 0.0
                )
            )
        return np.concatenate(differences)

    def _results(
        self, function: Callable[[PieceMesh], Any], cancel: CancelCallback | None
    ) -> Iterator[Any]:
        """Results in the order of the pieces, as they come.

        After a failure or a cancel no further piece is handed out, and those that are being worked
        on are waited for: to abort them would kill workers that others may share.
        """
        alone = effective_n_jobs(self.n_jobs) == 1
        stopped = cancel is not None and cancel()
        outcome: Exception | None = Cancelled() if stopped else None

        def tasks() -> Iterator[Any]:
            for number, piece in enumerate(self.pieces):
                if outcome is not None:
                    return
                name = (
                    f"piece {number + 1} of {len(self.pieces)} ({len(piece)} vertices, "
                    f"the first is vertex {piece[0]})"
                )
                yield delayed(_call)(function, self.piece_mesh(number), name, alone)

        # max_nbytes=None: the function gets arrays of its own, not read-only maps of a file.
        parallel = Parallel(
            n_jobs=self.n_jobs, return_as="generator", max_nbytes=None, pre_dispatch="n_jobs"
        )
        for result in parallel(tasks()):
            if outcome is not None:
                continue
            if isinstance(result, PieceError):
                outcome = result
                continue
            yield result
            if cancel is not None and cancel():
                outcome = Cancelled()
        if outcome is not None:
            raise outcome

    def stitched(self, results: list[Any]) -> npt.NDArray[Any]:
        """Put together what `apply` returned with ``stitch=False``."""
        arrays = [np.asarray(result) for result in results]
        first = arrays[0]
        for number, (array, piece) in enumerate(zip(arrays, self.pieces, strict=True)):
            expected = f"({len(piece)},) or ({len(piece)}, f)"
            if array.ndim not in (1, 2) or len(array) != len(piece):
                raise InputError(
                    f"The function returned shape {array.shape} for piece {number + 1} of "
                    f"{len(arrays)}: to stitch, return shape {expected}, or ask for stitch=False."
                )
            if array.shape[1:] != first.shape[1:]:
                raise InputError(
                    f"The function returned shape {array.shape} for piece {number + 1} of "
                    f"{len(arrays)} but {first.shape} for the first: return the same columns for "
                    "every piece, or ask for stitch=False."
                )
            if array.dtype.kind not in "biufc":
                raise InputError(
                    f"The function returned {array.dtype} for piece {number + 1} of "
                    f"{len(arrays)}: only numbers can be stitched; ask for stitch=False."
                )
        dtype = np.result_type(*arrays)
        complete = bool((self._piece_of >= 0).all())
        if not complete and dtype.kind in "biu":
            dtype = np.dtype(np.float64)
        shape = (self.mesh.n_vertices, *first.shape[1:])
        whole = np.empty(shape, dtype) if complete else np.full(shape, np.nan, dtype)
        for number, (array, piece) in enumerate(zip(arrays, self.pieces, strict=True)):
            own = self._piece_of[piece] == number
            whole[piece[own]] = array[own]
        return whole


def _call(function: Callable[[PieceMesh], Any], piece: PieceMesh, name: str, alone: bool) -> Any:
    """Run in the worker, with one BLAS thread; a failure comes back as a `PieceError`.

    Unless alone, the worker has one core, and what it calls must not plan for those of the others.
    """
    share = nullcontext() if alone else parallel_config(backend="sequential")
    try:
        with share, threadpool_limits(limits=1), warnings.catch_warnings():
            # A piece that gathers small components has nothing but constants to offer.
            warnings.simplefilter("ignore", ConstantFeaturesWarning)
            return function(piece)
    except Exception as failure:  # noqa: BLE001  (returned, and raised by the caller)
        error = PieceError(f"The function failed on {name}: {type(failure).__name__}: {failure}")
        # A cause does not survive the way between processes; a note does.
        error.add_note(traceback.format_exc())
        return error

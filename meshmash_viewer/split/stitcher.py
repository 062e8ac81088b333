"""Overlapping pieces of a mesh: split, apply a function to each in parallel, and stitch.

Pieces are for local quantities (heat kernel signatures at short times, curvatures) on meshes too
large to be decomposed as a whole. The spectrum of a piece is fast to compute. Far from the cut the
result equals that of the whole mesh, because heat does not reach the cut.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, nullcontext
from functools import cached_property, partial
from numbers import Real
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, TruncationWarning, conflicting, of_mesh, wrong_type
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, Progress, ProgressBar, ProgressCallback
from meshmash_viewer.split.partition import (
    Graph,
    Piece,
    edge_graph,
    overlapping_pieces,
    owned_pieces,
)
from meshmash_viewer.split.stitching import PieceError as PieceError
from meshmash_viewer.split.stitching import Seams, Stitched, results_of_calls, seam_sentence
from meshmash_viewer.units import counted

#: Default width of the overlap relative to the square root of the area of a piece.
_OVERLAP = 0.15
#: Width of the overlap divided by √t. A cut at this distance changes heat by e^(-2.5²), or 0.2 %;
#: paths along edges are up to 15 % longer than straight paths. At the worst vertex of a dendrite
#: the change was 0.5 %; it was 7 % with a width of 2, and 0.02 % with 3 and a tenth more vertices.
_REACH = 2.5


class MeshStitcher(Sequence[Piece]):
    """Split a mesh, apply functions to its pieces, and stitch the results.

    After `split_mesh`, the object is the sequence of the pieces as meshes.

    Parameters
    ----------
    n_jobs : int
        Number of processes as in joblib: -1 is one for each core, 1 uses this process only. Within
        ``joblib.parallel_config`` the backend selected there is used, which may be a cluster.
    verbose : int
        1 writes the number of pieces to stderr and draws a progress bar there.
    client : distributed.Client, optional
        Client of a Dask scheduler, whose workers compute the pieces; results are the same.

    Attributes
    ----------
    pieces : tuple of ndarray of int
        Vertices of each piece, increasing; empty before `split_mesh`.
    submesh_mapping : ndarray of int, shape (n,)
        Piece to which each vertex is assigned; -1 for none.

    Examples
    --------
    >>> stitcher = mv.MeshStitcher(trimesh.creation.icosphere(3), n_jobs=1)
    >>> pieces = stitcher.split_mesh(max_vertex_threshold=300, t_max=0.1)
    >>> hks = stitcher.apply(mv.compute_hks, count="auto", t_min=0.05, t_max=0.1)
    >>> len(pieces) > 1, hks.shape
    (True, (642, 32))

    Without `t_min` and `t_max` the times would be chosen for each piece separately, and columns
    would differ between pieces.
    """

    def __init__(
        self, mesh: MeshLike, n_jobs: int | None = -1, verbose: int = False, *, client: Any = None
    ) -> None:
        if isinstance(n_jobs, bool):
            fault = f"n_jobs={n_jobs} is not a number"
            raise InputError("wrong-type", fault, "give verbose by its name")
        if n_jobs == 0:
            raise InputError("out-of-range", "n_jobs must not be 0", "give 1, or -1 for all cores")
        self.mesh: Mesh = as_mesh(mesh)
        self.n_jobs = n_jobs
        self.verbose = verbose
        self.client = client
        self.pieces: tuple[IntArray, ...] = ()
        self._piece_faces: list[IntArray] = []
        self.submesh_mapping: IntArray = np.full(self.mesh.n_vertices, -1)
        #: Arguments of `split_mesh` if it was called without a width of the overlap, else None.
        self._open: dict[str, Any] | None = {}

    def __len__(self) -> int:
        return len(self.pieces)

    @overload
    def __getitem__(self, index: int) -> Piece: ...
    @overload
    def __getitem__(self, index: slice) -> list[Piece]: ...
    def __getitem__(self, index: int | slice) -> Piece | list[Piece]:
        if isinstance(index, slice):
            return [self[number] for number in range(len(self))[index]]
        own = self.pieces[index]
        piece = Piece((self.mesh.vertices[own], self._piece_faces[index].astype(np.int64)))
        piece.first = self._first[own]
        return piece

    @property
    def submeshes(self) -> list[Piece]:
        """Fresh copies of all pieces as ``(vertices, faces)``."""
        return self[:]

    @property
    def submesh_overlap_indices(self) -> tuple[IntArray, ...]:
        """Vertices of each piece, the same as `pieces`."""
        return self.pieces

    def split_mesh(
        self,
        max_vertex_threshold: int | None = 20_000,
        *,
        overlap_distance: float | None = None,
        t_max: float | None = None,
        overlap: float | None = None,
        min_vertex_threshold: int | None = 0,
        max_overlap_neighbors: int | None = None,
    ) -> MeshStitcher:
        """Cut the mesh into overlapping pieces; return this object, the sequence of the pieces.

        `InputError` is raised if the threshold is too small for a vertex and its neighbours, if no
        component is large enough, or if a width of the overlap is invalid or several are given.

        Parameters
        ----------
        max_vertex_threshold : int, optional
            Maximum number of vertices of a piece. Smaller components are not cut, and may share a
            piece. With `overlap_distance` or `t_max`, the overlap has the requested width and is
            not included in the number; otherwise it is included. None: no cuts.
        overlap_distance : float, optional
            Width of the overlap along the edges, in unit of the mesh.
        t_max : float, optional
            Longest diffusion time with accurate results, in squared unit: the overlap has the width
            ``2.5 √t_max`` plus two edges. The effect of the cut on heat is then less than 1 %
            except at single vertices, which `seams` finds.
        overlap : float, optional
            Width relative to the square root of the mean area of a full piece; narrower where
            vertices are dense, but with all neighbours of the core. If no width is given, `overlap`
            is 0.15, and a later `apply` with `t_max` cuts the mesh again with this `t_max`.
        min_vertex_threshold : int, optional
            Components with fewer vertices are left out.
        max_overlap_neighbors : int, optional
            Maximum number of vertices of an overlap, the nearest to the core; only with
            `overlap_distance` or `t_max`.
        """
        mesh = self.mesh
        threshold = mesh.n_vertices if max_vertex_threshold is None else int(max_vertex_threshold)
        if threshold < 3:
            fault = f"max_vertex_threshold={max_vertex_threshold} is less than a triangle has"
            raise InputError("piece-too-small", fault, "give some thousands")
        widths = {"overlap_distance": overlap_distance, "t_max": t_max, "overlap": overlap}
        widths = {name: width for name, width in widths.items() if width is not None}
        _check_width(widths)
        if max_overlap_neighbors is not None and widths.keys() <= {"overlap"}:
            fault = "max_overlap_neighbors limits an overlap of a given width"
            raise InputError("missing-argument", fault, "give overlap_distance or t_max with it")
        self._open = None if widths else {
            "max_vertex_threshold": max_vertex_threshold,
            "min_vertex_threshold": min_vertex_threshold,
        }  # fmt: skip
        labels = mesh.component_labels
        if min_vertex_threshold:
            sizes = np.bincount(labels[labels >= 0])
            kept = np.append(sizes >= min_vertex_threshold, False)
            labels = np.where(kept[labels], labels, -1)
            if (labels < 0).all():
                raise InputError(
                    "no-components",
                    f"min_vertex_threshold={min_vertex_threshold} leaves nothing, as the largest"
                    f" component has {counted(int(sizes.max()), 'vertex')}",
                    "give a smaller one",
                )
            labels = np.unique(labels, return_inverse=True)[1] - int((labels < 0).any())
        graph = edge_graph(mesh)
        if t_max is not None:
            overlap_distance = reach_of(t_max, graph)
        width = overlap_distance
        if width is None:
            n_used = max(int(np.count_nonzero(labels >= 0)), 1)
            share = _OVERLAP if overlap is None else overlap
            width = share * float(np.sqrt(mesh.area * threshold / n_used))
        pieces = overlapping_pieces(
            graph, labels, threshold, width,
            most=max_overlap_neighbors, whole=overlap_distance is None,
        )  # fmt: skip
        self.pieces, self._piece_faces, self.submesh_mapping = owned_pieces(mesh, graph, pieces)
        if self.verbose and sys.stderr is not None:
            largest = max(map(len, self.pieces), default=0)
            sys.stderr.write(
                f"{counted(len(self), 'piece')} of at most {counted(largest, 'vertex')}\n"
            )
        return self

    @cached_property
    def _first(self) -> FloatArray:
        """Square of the first eigenvector of the mesh, shape (n,)."""
        mesh = self.mesh
        on_first = mesh.component_labels == 0
        area = mesh.face_areas[mesh.distinct_corners & on_first[mesh.faces[:, 0]]].sum()
        return np.where(on_first, 1.0 / area if area > 0.0 else 0.0, 0.0)

    def apply(
        self,
        function: Callable[..., Any],
        stitch: bool = True,
        *,
        fill_value: float = np.nan,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
        **arguments: Any,
    ) -> Any:
        """Call a function on every piece, in parallel, and stitch the results.

        `PieceError`, which names the piece, is raised if the function fails, `InputError` if the
        results cannot be stitched, and `Cancelled` if `cancel` returns True.

        Parameters
        ----------
        function : callable
            Called with ``(vertices, faces)`` of a piece; may be a lambda. It runs with one BLAS
            thread, and uses one core if pieces are computed in parallel. For stitching, it returns
            values of shape (n_i,) or (n_i, f), or None for a piece without values.
        stitch : bool
            True: return an array, shape (n,) or (n, f), with the value of each vertex from the
            piece in which it is farthest from the cut. False: return the list of results.
        fill_value : float
            Value of vertices in no piece, such as unreferenced ones; NaN converts integer results
            to floating point.
        progress, cancel : callable, optional
            See `meshmash_viewer.progress`; called between pieces.
        **arguments
            Further arguments of the function: ``apply(mv.compute_hks, t_min=…, t_max=…)``.

        Notes
        -----
        With a `t_max` among the arguments, `split_mesh` is called with it unless a width of the
        overlap has been chosen, and `TruncationWarning` is given if a column differs by more than
        1 % in the median where pieces meet; see `seams`.

        With ``drop_first=True`` the functions of `meshmash_viewer.decompose` leave out the first
        pair of the whole mesh, and not of the piece, whose squared first eigenvector is larger by
        the ratio of the areas. The filter is then called with the eigenvalue zero too.
        """
        if not isinstance(stitch, bool):
            raise wrong_type(
                "Values of stitch", type(stitch), "a bool, and arguments by their names"
            )
        self._split_for(arguments)
        checked = stitch and arguments.get("t_max") is not None and len(self) > 1
        seams = self.seaming() if checked else None
        results = self._gathered(
            function, arguments, stitch, fill_value, seams, progress=progress, cancel=cancel
        )
        if seams is not None:
            differences = seams.differences()
            median = np.median(differences, axis=0) if len(differences) else np.zeros(1)
            remedy = "call split_mesh with t_max, so that the overlap is wide enough"
            if said := seam_sentence([str(at) for at in range(len(median))], median, remedy):
                warnings.warn(f"{of_mesh(self.mesh.name)}{said}.", TruncationWarning, stacklevel=2)
        return results

    def apply_on_features(
        self,
        function: Callable[..., Any],
        features: npt.ArrayLike,
        stitch: bool = True,
        *,
        fill_value: float = np.nan,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
        **arguments: Any,
    ) -> Any:
        """Call a function on every piece and the rows of features at its vertices; see `apply`.

        `features` are of shape (n,) or (n, f); `InputError` is raised if n does not match.
        """
        rows = np.asarray(features)
        if rows.ndim == 0 or len(rows) != self.mesh.n_vertices:
            fault = f"Features of shape {rows.shape} do not match {self.mesh.n_vertices:,} vertices"
            raise InputError("wrong-shape", fault, "give a row for each")
        return self._gathered(
            function, arguments, stitch, fill_value, rows=rows, progress=progress, cancel=cancel
        )

    def subset_apply(
        self,
        function: Callable[..., Any],
        indices: npt.ArrayLike,
        *,
        reindex: bool = False,
        fill_value: float = np.nan,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
        **arguments: Any,
    ) -> npt.NDArray[Any]:
        """Call a function only on the pieces to which some vertices are assigned; see `apply`.

        `indices` are indices of the vertices, or a mask of shape (n,). With `reindex`, only rows of
        these vertices are returned. Vertices whose piece was not computed have `fill_value`.
        `InputError` is raised if a vertex does not exist, or no vertex is in a piece.
        """
        vertices = np.atleast_1d(np.asarray(indices))
        n = self.mesh.n_vertices
        if vertices.dtype == np.bool_ and vertices.shape == (n,):
            vertices = np.flatnonzero(vertices)
        if vertices.dtype.kind not in "iu" or not ((vertices >= 0) & (vertices < n)).all():
            fault = "indices are of vertices"
            raise InputError("vertex-out-of-range", fault, f"give whole numbers from 0 to {n - 1}")
        values: npt.NDArray[Any] = self._gathered(
            function, arguments, True, fill_value,
            vertices=vertices, progress=progress, cancel=cancel,
        )  # fmt: skip
        return values[vertices] if reindex else values

    def _split_for(self, arguments: dict[str, Any]) -> None:
        """Cut the mesh if it is not cut, or again if the overlap depends on `t_max`."""
        if not self.pieces or (self._open is not None and arguments.get("t_max") is not None):
            self.split_mesh(**(self._open or {}), t_max=arguments.get("t_max"))

    def _gathered(
        self,
        function: Callable[..., Any],
        arguments: dict[str, Any],
        stitch: bool,
        fill_value: float,
        seams: Seams | None = None,
        **given: Any,
    ) -> Any:
        """Return the result of `apply`; `seams` records the values, `given` is for `each`."""
        self._split_for(arguments)
        results: list[Any] = [None] * len(self)
        stitching = self.stitching(fill_value)
        put = stitching.add if stitch else results.__setitem__
        for number, result in self.each(partial(function, **arguments), **given):
            put(number, result)
            if seams is not None:
                seams.add(number, result)
        return stitching.values() if stitch else results

    def each(
        self,
        function: Callable[..., Any],
        *,
        rows: npt.NDArray[Any] | None = None,
        vertices: IntArray | None = None,
        n_jobs: int | None = None,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
    ) -> Generator[tuple[int, Any], None, None]:
        """Call a function on every piece in parallel, and yield its number and result.

        Results are not stored. For `rows` see `apply_on_features`, for `vertices` see
        `subset_apply`. `n_jobs` replaces the attribute of the stitcher.
        """
        owners = self.submesh_mapping if vertices is None else self.submesh_mapping[vertices]
        numbers = np.unique(owners[owners >= 0]).tolist()
        if vertices is not None and not numbers:
            raise InputError(
                "vertex-unused",
                "The vertices are in no piece: no face uses them, or they are in small components",
            )

        def call(number: int) -> tuple[str, tuple[Any, ...]]:
            piece, count = self.pieces[number], f"piece {number + 1} of {len(self)}"
            name = f"{count} ({len(piece)} vertices, the first is vertex {piece[0]})"
            return name, (self[number],) if rows is None else (self[number], rows[piece])

        began, calls = time.monotonic(), map(call, numbers)
        found = results_of_calls(function, calls, n_jobs or self.n_jobs, cancel, self.client)
        drawn = ProgressBar("pieces", progress) if self.verbose else nullcontext(progress)
        with closing(found), drawn as report:
            for count, number in enumerate(numbers, 1):
                yield number, next(found)
                if report is not None:
                    share = count / len(numbers)
                    left = (time.monotonic() - began) * (1.0 / share - 1.0)
                    message = f"{count} of {len(numbers)} pieces"
                    report(Progress("pieces", share, remaining=left, message=message))
            next(found, None)  # raises the fault or `Cancelled`

    def stitch_features(
        self, features_by_submesh: Sequence[Any], fill_value: float = np.nan
    ) -> npt.NDArray[Any]:
        """Combine the results of `apply` with ``stitch=False``, None for a piece without values.

        `InputError` is raised if the number of results is not the number of pieces, or shapes do
        not agree. Vertices without a value get `fill_value`.
        """
        if len(features_by_submesh) != len(self):
            fault = f"{len(features_by_submesh)} results do not match {counted(len(self), 'piece')}"
            remedy = "give one for each, None for pieces without values"
            raise InputError("counts-differ", fault, remedy)
        stitching = self.stitching(fill_value)
        for number, result in enumerate(features_by_submesh):
            stitching.add(number, result)
        return stitching.values()

    def stitching(self, fill_value: float = np.nan) -> Stitched:
        """Return an empty `Stitched` for the pieces."""
        return Stitched(self.pieces, self.submesh_mapping, fill_value)

    def seaming(self) -> Seams:
        """Return an empty `Seams` for the pieces."""
        return Seams(self.pieces, self.submesh_mapping, self.mesh.proper_faces)

    def seams(self, results: Sequence[Any]) -> FloatArray:
        """Compute relative differences along seams of the results of an unstitched `apply`, (s, f).

        A row is the difference of two pieces at a vertex next to their seam that both contain.
        """
        seams = self.seaming()
        for number, result in enumerate(results):
            seams.add(number, result)
        return seams.differences()


def reach_of(time: float, graph: Graph) -> float:
    """Return the width of the overlap for diffusion times up to `time`, from the edge graph."""
    # two edges, because the cut crosses an edge on both sides
    return _REACH * math.sqrt(time) + 2.0 * float(graph.data.mean())


def _check_width(widths: dict[str, Any]) -> None:
    """Raise `InputError` if several widths of the overlap are given, or one is invalid."""
    if len(widths) > 1:
        raise conflicting(f"{' and '.join(widths)} are given", "give only one of them")
    for name, width in widths.items():
        if not (isinstance(width, Real) and 0.0 <= float(width) < math.inf):
            usual = "from 0 to about 0.5" if name == "overlap" else "from 0, in unit of the mesh"
            fault = f"{name}={width!r} is not a width"
            raise InputError("out-of-range", fault, f"give a number {usual}")

"""Condensed heat kernel signatures: decimation, computation in pieces and domains of a mesh.

Parameters and results are those of meshmash's pipeline, with lengths in nm and times in nm². Unlike
in meshmash, results do not depend on the number of processes or the order of pieces, and include
the truncation error of each column.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, TruncationWarning, of_mesh
from meshmash_viewer.features.domains import (
    NODE_COLUMNS,
    aggregate_features,
    checked_point,
    condense_mesh_to_graph,
    require,
)
from meshmash_viewer.features.filter_responses import MOST_FILTERS, check_times
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.sums import Features
from meshmash_viewer.features.truncation import Truncation, warn_of_truncation
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.learn.columns import FLOOR
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback, check_cancelled
from meshmash_viewer.split.domains import ward_domains
from meshmash_viewer.split.partition import edge_graph
from meshmash_viewer.split.piece_features import PieceFeatures
from meshmash_viewer.split.stitcher import MeshStitcher, reach_of
from meshmash_viewer.split.stitching import seam_sentence
from meshmash_viewer.surface.decimation import decimated
from meshmash_viewer.units import METRES, whole_number

if TYPE_CHECKING:
    from pandas import DataFrame

#: Arguments of `compute_hks` allowed in `compute_hks_kwargs`; the last three have no effect.
_ARGUMENTS = (
    *("max_eigenvalue", "t_min", "t_max", "n_components", "robust", "mollify_factor", "drop_first"),
    *("decomposition_dtype", "band_size", "truncate_extra", "verbose"),
)


class CondensedHKS(NamedTuple):
    """Result of `condensed_hks_pipeline`, in nm.

    Attributes
    ----------
    simple_mesh : Mesh
        The decimated mesh.
    mapping : ndarray of int, shape (n,)
        The vertex of `simple_mesh` for each vertex of the mesh, -1 in dropped components.
    stitcher : MeshStitcher
        The pieces of `simple_mesh`.
    simple_labels, labels : ndarray of int
        The domain of each vertex of `simple_mesh`, and of the mesh; -1 for none.
    condensed_features : DataFrame
        Log-HKS ``hks_0`` … of each domain, and auxiliary columns; the index is the domain, from -1;
        row -1 is NaN.
    condensed_nodes, condensed_edges : DataFrame
        The graph, see `condense_mesh_to_graph`.
    timing_info : dict
        Seconds of each step.
    truncation : Truncation
        Truncation errors of the columns of HKS.
    seams : ndarray, shape (n_components,)
        Median difference of each column where pieces meet, relative to its values; 0 without cuts.

    Examples
    --------
    >>> CondensedHKS._fields[3:6]
    ('simple_labels', 'labels', 'condensed_features')
    """

    simple_mesh: Mesh
    mapping: IntArray
    stitcher: MeshStitcher
    simple_labels: IntArray
    labels: IntArray
    condensed_features: DataFrame
    condensed_nodes: DataFrame
    condensed_edges: DataFrame
    timing_info: dict[str, float]
    truncation: Truncation
    seams: FloatArray

    @property
    def n_domains(self) -> int:
        """Number of domains."""
        return len(self.condensed_nodes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences, without full stops, on columns with errors above 1 %."""
        missing = self.truncation.sentence()
        missing += ": give a larger max_eigenvalue (--max-eigenvalue)" if missing else ""
        return tuple(filter(None, (missing, _seam_sentence(self.seams))))


def _task_of(given: Mapping[str, Any]) -> PieceFeatures:
    """Check the arguments of `compute_hks`, and return its computation on a piece."""
    if unknown := [name for name in given if name not in _ARGUMENTS]:
        fault = f"compute_hks_kwargs has {', '.join(unknown)}"
        raise InputError("unknown-name", fault, f"give only {', '.join(_ARGUMENTS)}")
    t_min, t_max = given["t_min"], given["t_max"]
    if t_min is None or t_max is None:
        fault = "t_min and t_max are of all pieces, which share no spectrum"
        raise InputError("missing-argument", fault, "give both")
    check_times(t_min, t_max)
    count = whole_number(given["n_components"], "n_components", MOST_FILTERS)
    top = given["max_eigenvalue"]
    if not 0.0 < top < math.inf:
        fault = f"max_eigenvalue is {top!r}"
        raise InputError("out-of-range", fault, "give a positive one, per nm²")
    bank = heat_kernel_bank(np.geomspace(t_min, t_max, count))
    bank = replace(bank, columns=tuple(f"hks_{at}" for at in range(count)))
    operator = OperatorOptions(bool(given["robust"]), given["mollify_factor"])
    precision = np.dtype(given["decomposition_dtype"] or np.float64)
    return PieceFeatures(operator, float(top), bank, given["drop_first"], precision, n_jobs=1)


def _logarithms(values: FloatArray, times: FloatArray) -> FloatArray:
    """Return log-HKS; smaller HKS is replaced by `FLOOR` times the HKS of a plane."""
    return np.asarray(np.log(np.fmax(values, FLOOR / (4.0 * np.pi * times))))


def condensed_hks_pipeline(
    mesh: MeshLike,
    simplify_agg: float = 7,
    simplify_target_reduction: float = 0.7,
    overlap_distance: float = 20_000,
    max_vertex_threshold: int | None = 20_000,
    min_vertex_threshold: int = 200,
    max_overlap_neighbors: int | None = 60_000,
    n_components: int = 32,
    t_min: float = 5e4,
    t_max: float = 2e7,
    max_eigenvalue: float = 1e-5,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    truncate_extra: bool = True,
    drop_first: bool = True,
    decomposition_dtype: npt.DTypeLike = "float32",
    compute_hks_kwargs: Mapping[str, Any] | None = None,
    nuc_point: npt.ArrayLike | None = None,
    distance_threshold: float = 3.0,
    auxiliary_features: bool = True,
    n_jobs: int | None = -1,
    verbose: int = False,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> CondensedHKS:
    """Divide a mesh into domains of similar heat kernel signatures, and average each domain.

    Small components are dropped and the others decimated. The heat kernel signature is computed in
    overlapping pieces, its logarithm is clustered by Ward's criterion, and the signature is
    averaged over the area of each cluster. A mesh in another unit is converted to nm; a mesh
    without a unit is assumed to be in nm.

    `InputError` is raised if an argument is invalid, all components are small, or a package is not
    installed. `TruncationWarning` is given if the truncation error of a column exceeds 1 %, or if a
    column differs by more than 1 % in the median where pieces meet.

    Parameters
    ----------
    simplify_agg, simplify_target_reduction : float
        Aggressiveness of the decimation, and share of the faces to remove; 0 for none.
    overlap_distance : float
        Maximum width of the overlap; it is narrower where `t_max` allows it.
    max_vertex_threshold, max_overlap_neighbors : int, optional
        Maximum number of vertices of a piece without its overlap, and of the overlap.
    min_vertex_threshold : int
        Components of the mesh with fewer vertices are dropped.
    n_components, t_min, t_max : int, float
        Number of times, evenly spaced in log t, and shortest and longest time.
    max_eigenvalue, robust, mollify_factor, truncate_extra, drop_first, decomposition_dtype
        See `compute_hks`. With the defaults, the truncation error exceeds 1 % in 12 of the 32
        columns, and is about 61 % at the shortest time: ``max_eigenvalue=1e-4`` is enough for all.
    compute_hks_kwargs : dict, optional
        Arguments of `compute_hks` that replace the parameters above.
    nuc_point : array_like, shape (3,), optional
        Position of the nucleus, in the unit of the mesh; the distance from it is then a column.
    distance_threshold : float
        Ward distance of log-HKS from which clusters are separate; larger for fewer domains.
    auxiliary_features : bool
        Whether to append columns of the nodes: areas, numbers of vertices, distance.
    n_jobs, verbose : int
        See `MeshStitcher`. They do not change the result.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(action="ignore", category=mv.TruncationWarning):
    ...     found = mv.condensed_hks_pipeline(
    ...         mv.Mesh(1000 * ball.vertices, ball.faces), simplify_target_reduction=0.5, n_jobs=1
    ...     )
    >>> found.simple_mesh.n_faces, found.labels.shape, found.condensed_features.columns[0]
    (640, (642,), 'hks_0')
    """
    require("fast_simplification", "sklearn", "pandas")
    if not distance_threshold > 0.0:
        fault = f"distance_threshold is {distance_threshold!r}"
        raise InputError("out-of-range", fault, "give a positive one")
    task = _task_of({
        "n_components": n_components, "t_min": t_min, "t_max": t_max,
        "max_eigenvalue": max_eigenvalue, "robust": robust, "mollify_factor": mollify_factor,
        "drop_first": drop_first, "decomposition_dtype": decomposition_dtype,
        **(compute_hks_kwargs or {}),
    })  # fmt: skip
    times, surface = task.bank.parameters, as_mesh(mesh)
    starts: dict[str, float] = {}

    def begin(step: str) -> None:
        check_cancelled(cancel)
        starts[step] = time.perf_counter()
        if progress is not None:
            progress(Progress(step, message=f"Condensing: {step}"))

    scale = nm_of(surface)
    if scale != 1.0:
        surface = replace(surface, vertices=surface.vertices * scale, unit="nm", maps=())
    point = None if nuc_point is None else scale * checked_point(nuc_point)
    begin("decimation")
    simple, mapping = decimated(
        surface, simplify_target_reduction, simplify_agg, min_vertex_threshold
    )
    begin("pieces")
    stitcher = MeshStitcher(simple, n_jobs, verbose)
    graph = edge_graph(simple)
    width = min(overlap_distance, reach_of(float(times.max()), graph))
    stitcher.split_mesh(
        max_vertex_threshold, overlap_distance=width, max_overlap_neighbors=max_overlap_neighbors
    )
    begin("hks")
    values, truncation, _, median = task.on(stitcher, progress=progress, cancel=cancel)
    assert truncation is not None  # the filters have a tail
    begin("domains")
    simple_labels = ward_domains(
        _logarithms(values, times), graph, stitcher.submesh_mapping, distance_threshold,
        n_jobs=n_jobs, cancel=cancel,
    )  # fmt: skip
    begin("graph")
    named = Features(values, task.bank.columns)
    features = aggregate_features(named, simple_labels, simple.vertex_areas)
    features[:] = _logarithms(features.to_numpy(), times)
    features.iloc[0] = np.nan
    nodes, edges = condense_mesh_to_graph(simple, simple_labels, point)
    if auxiliary_features:
        features = features.join(nodes.drop(columns=list(NODE_COLUMNS[:3])))
    moments = [*starts.values(), time.perf_counter()]
    seconds = dict(zip(starts, np.diff(moments).tolist(), strict=True))
    found = CondensedHKS(
        simple, mapping, stitcher, simple_labels, np.append(simple_labels, -1)[mapping], features,
        nodes, edges, {**seconds, "total": moments[-1] - moments[0]}, truncation, median,
    )  # fmt: skip
    warn_of_truncation(truncation, name=surface.name)
    if said := _seam_sentence(median):
        warnings.warn(f"{of_mesh(surface.name)}{said}.", TruncationWarning, stacklevel=2)
    return found


def nm_of(mesh: Mesh) -> float:
    """Return the length of the unit of a mesh in nm; 1 without a unit."""
    return float(10.0 ** (METRES[mesh.unit] - METRES["nm"])) if mesh.unit else 1.0


def _seam_sentence(median: FloatArray) -> str:
    """Return `seam_sentence` for columns of HKS."""
    remedy = "allow a wider overlap (overlap_distance, max_overlap_neighbors)"
    return seam_sentence([f"hks_{at}" for at in range(len(median))], median, remedy)

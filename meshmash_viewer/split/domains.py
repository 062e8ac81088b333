"""Domains: connected clusters of similar vertices, by Ward's criterion on the edges of a mesh.

Vertices are clustered in each piece separately. Clusters are then joined across the cuts while
Ward's criterion [1]_ is below the threshold. Domains are numbered by their lowest vertex, so that
the result does not depend on the order of pieces.

References
----------
.. [1] Ward, J. H. (1963). "Hierarchical grouping to optimize an objective function." Journal of the
   American Statistical Association 58.
"""

from __future__ import annotations

import heapq
import math
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse
from scipy.ndimage import value_indices

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.split.partition import Graph
from meshmash_viewer.split.stitching import results_of_calls
from meshmash_viewer.surface.edges import connected


def ward_domains(
    values: FloatArray,
    graph: Graph,
    pieces: IntArray,
    threshold: float,
    *,
    n_jobs: int | None = 1,
    cancel: CancelCallback | None = None,
) -> IntArray:
    """Return the domain of each vertex from 0, shape (n,), -1 for vertices in no piece.

    `values`, shape (n, f), are similar within a domain. `graph` is symmetric; each stored entry is
    an edge. `pieces` is the piece of each vertex, -1 for none. Clusters are joined while their Ward
    distance is below `threshold`. For `n_jobs` and `cancel` see `results_of_calls`.
    """
    tails, tips = sparse.coo_array(graph).coords
    inner = pieces[tails] == pieces[tips]
    part = np.where(pieces < 0, -1, connected(tails[inner], tips[inner], len(pieces)))
    members = [own for (own,) in value_indices(part, ignore_value=-1).values()]
    calls = (
        (f"part {at + 1} of {len(members)}", (values[own], sparse.csr_matrix(graph[own][:, own])))
        for at, own in enumerate(members)
    )
    found = results_of_calls(partial(_clustered, threshold=threshold), calls, n_jobs, cancel)
    labels, count = np.full(len(pieces), -1), 0
    for own, clusters in zip(members, found, strict=True):
        labels[own] = clusters + count
        count += int(clusters.max()) + 1
    labels = _numbered(labels)
    if len(members) > 1:
        labels = _numbered(_joined(values, graph, labels, threshold))
    return labels


def _clustered(values: FloatArray, graph: Any, threshold: float) -> IntArray:
    """Cluster the vertices of a connected graph."""
    from sklearn.cluster import AgglomerativeClustering

    if len(values) == 1:
        return np.zeros(1, dtype=np.int64)
    ward = AgglomerativeClustering(
        n_clusters=None, distance_threshold=threshold, connectivity=graph, linkage="ward"
    )
    return np.asarray(ward.fit(values).labels_, dtype=np.int64)


def _numbered(labels: IntArray) -> IntArray:
    """Number labels from 0 by their lowest vertex; -1 is unchanged."""
    numbered, used = labels.copy(), labels >= 0
    _, first, place = np.unique(labels[used], return_index=True, return_inverse=True)
    numbered[used] = np.argsort(np.argsort(first))[place]
    return numbered


def _joined(values: FloatArray, graph: Graph, labels: IntArray, threshold: float) -> IntArray:
    """Join adjacent clusters, the nearest first, while their Ward distance is below a threshold."""
    used = np.flatnonzero(labels >= 0)
    k = int(labels.max()) + 1
    size = np.bincount(labels[used], minlength=k).astype(np.float64).tolist()
    sums = np.stack([np.bincount(labels[used], each, k) for each in values[used].T], axis=1)
    mean: list[Any] = list(sums / np.asarray(size)[:, None])
    near: list[set[int]] = [set() for _ in range(k)]
    a, b = (labels[each] for each in sparse.coo_array(graph).coords)
    for low, high in np.unique(np.stack([a, b], axis=1)[(a < b) & (a >= 0)], axis=0).tolist():
        near[low].add(high)
        near[high].add(low)

    def distance(i: int, j: int) -> float:
        apart = mean[i] - mean[j]
        return math.sqrt(2.0 * size[i] * size[j] / (size[i] + size[j]) * float(apart @ apart))

    waiting = [(distance(i, j), i, j) for i in range(k) for j in near[i] if i < j]
    waiting = [each for each in waiting if each[0] < threshold]
    heapq.heapify(waiting)
    into = list(range(k))
    while waiting:
        _, i, j = heapq.heappop(waiting)
        if into[i] != i or into[j] != j:
            continue
        new = len(into)
        into[i] = into[j] = new
        into.append(new)
        size.append(size[i] + size[j])
        mean.append((size[i] * mean[i] + size[j] * mean[j]) / size[new])
        near.append({each for each in near[i] | near[j] if into[each] == each})
        for other in sorted(near[new]):
            near[other].add(new)
            if (apart := distance(other, new)) < threshold:
                heapq.heappush(waiting, (apart, other, new))
    for at in reversed(range(len(into))):  # joined clusters have higher numbers
        into[at] = into[into[at]]
    return np.where(labels < 0, -1, np.asarray(into)[labels])

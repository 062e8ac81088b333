"""Domains: connected clusters of similar vertices, by Ward's criterion on the edges of a mesh.

Vertices are clustered in each piece by itself, and clusters are then joined across the cuts as long
as Ward's criterion [1]_ is below the threshold. Domains are numbered by their lowest vertex, so
that the result does not depend on the order of pieces.

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
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.split.partition import Graph
from meshmash_viewer.split.stitching import results_of_calls


def ward_domains(
    values: FloatArray,
    graph: Graph,
    pieces: IntArray,
    threshold: float,
    *,
    n_jobs: int | None = 1,
    cancel: CancelCallback | None = None,
) -> IntArray:
    """Cluster vertices of a graph.

    Parameters
    ----------
    values : ndarray, shape (n, f)
        What vertices of a cluster have in common.
    graph : sparse array, shape (n, n)
        Symmetric; what is stored connects.
    pieces : ndarray of int, shape (n,)
        Piece of each vertex, -1 for vertices that are left out.
    threshold : float
        Clusters are joined while their Ward distance is below it.
    n_jobs, cancel
        See `meshmash_viewer.split.stitching.results_of_calls`.

    Returns
    -------
    ndarray of int, shape (n,)
        The domain of each vertex from 0, -1 for vertices that are left out.
    """
    numbers = np.unique(pieces[pieces >= 0])
    members = [np.flatnonzero(pieces == number) for number in numbers]
    calls = (
        (f"piece {at + 1} of {len(members)}", (values[own], sparse.csr_array(graph[own][:, own])))
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


def _clustered(values: FloatArray, graph: Graph, threshold: float) -> IntArray:
    """Cluster the vertices of a piece, each of its connected components by itself."""
    from sklearn.cluster import AgglomerativeClustering

    _, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    labels, count = np.empty(len(part), dtype=np.int64), 0
    for own in np.split(order, np.cumsum(np.bincount(part))[:-1]):
        found = np.zeros(len(own), dtype=np.int64)
        if len(own) > 1:
            inner = sparse.csr_matrix(graph[own][:, own])
            ward = AgglomerativeClustering(
                n_clusters=None, distance_threshold=threshold, connectivity=inner, linkage="ward"
            )
            found = ward.fit(values[own]).labels_.astype(np.int64)
        labels[own] = found + count
        count += int(found.max()) + 1
    return labels


def _numbered(labels: IntArray) -> IntArray:
    """Number labels from 0 by their lowest vertex; -1 stays."""
    used = np.flatnonzero(labels >= 0)
    _, first, place = np.unique(labels[used], return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    result = np.full(len(labels), -1, dtype=np.int64)
    result[used] = rank[place]
    return result


def _joined(values: FloatArray, graph: Graph, labels: IntArray, threshold: float) -> IntArray:
    """Join touching clusters, the nearest first, while their Ward distance is below a threshold."""
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
    for at in range(len(into) - 1, -1, -1):  # the last one is final
        into[at] = into[into[at]]
    return np.where(labels < 0, -1, np.asarray(into)[labels])

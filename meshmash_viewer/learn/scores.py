"""Honest scores of classes: areas that a classifier gets right where it was not trained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.masks import parts
from meshmash_viewer.units import counted

#: Number of times that a part of the strokes is left out.
_FOLDS = 5


@dataclass(frozen=True, eq=False)
class ClassScores:
    """Result of a cross-validation.

    Parameters
    ----------
    classes : tuple of str
        Names of the c classes.
    confusion : ndarray, shape (c, c)
        Area of the labelled vertices of each class (row) by predicted class (column), in squared
        unit of the model.
    left_out : str
        What was left out of the training, and predicted: "meshes" or "strokes".
    folds : int
        Number of trainings.

    Examples
    --------
    >>> areas = np.array([[8.0, 2.0], [0.0, 10.0]])
    >>> scores = mv.ClassScores(("spine", "shaft"), areas, "strokes", 5)
    >>> scores.f1.round(3), round(scores.weighted_f1, 3)
    (array([0.889, 0.909]), 0.899)
    """

    classes: tuple[str, ...]
    confusion: FloatArray
    left_out: str
    folds: int

    @property
    def f1(self) -> FloatArray:
        """F1 of each class by area, shape (c,)."""
        both = self.confusion.sum(axis=0) + self.confusion.sum(axis=1)
        return np.asarray(2.0 * np.diag(self.confusion) / np.where(both > 0.0, both, 1.0))

    @property
    def weighted_f1(self) -> float:
        """Mean of `f1`, weighted by the area of each class."""
        return float(np.average(self.f1, weights=self.confusion.sum(axis=1)))

    def plain(self) -> dict[str, Any]:
        """Return the scores as JSON has them."""
        return {
            "classes": list(self.classes),
            "confusion": self.confusion.tolist(),
            "left_out": self.left_out,
            "folds": self.folds,
            "f1": self.f1.tolist(),
            "weighted_f1": self.weighted_f1,
        }


def strokes(mesh: Mesh, places: IntArray) -> IntArray:
    """Number the connected parts of each class, shape (n,); -1 without a class (-1 in `places`)."""
    result, taken = np.full(mesh.n_vertices, -1, dtype=np.int64), 0
    for place in range(int(places.max(initial=-1)) + 1):
        part = parts(mesh, places == place)
        result[part >= 0] = part[part >= 0] + taken
        taken += int(part.max(initial=-1)) + 1
    return result


def folds_of(
    places: IntArray, stroke: IntArray, of_mesh: IntArray, names: tuple[str, ...]
) -> tuple[IntArray, str, str]:
    """Assign labelled vertices to folds that are left out in turn.

    `places`, `stroke` and `of_mesh` are class, stroke and mesh of each labelled vertex, shape (s,).
    Whole meshes are left out where the others have all classes, otherwise whole strokes, those of
    each class dealt out by size. The number of each fold, shape (s,), comes with what is left out;
    if a class has one stroke alone, with a sentence in its place.
    """
    n_classes, n_meshes = len(names), int(of_mesh.max()) + 1
    if n_meshes > 1 and all(
        len(np.unique(places[of_mesh != mesh])) == n_classes for mesh in range(n_meshes)
    ):
        return of_mesh, "meshes", ""
    folds = np.zeros(len(places), dtype=np.int64)
    for place, name in enumerate(names):
        own = places == place
        numbers, inverse, sizes = np.unique(stroke[own], return_inverse=True, return_counts=True)
        if len(numbers) < 2:
            said = (
                f"There are no scores yet: {name!r} has {counted(len(numbers), 'stroke')}, and one"
                " has to be left out to test; label another place of it."
            )
            return folds, "", said
        rank = np.empty(len(numbers), dtype=np.int64)
        rank[np.argsort(-sizes, kind="stable")] = np.arange(len(numbers))
        folds[own] = rank[inverse] % _FOLDS
    return folds, "strokes", ""


def cross_validated(
    places: IntArray,
    areas: FloatArray,
    folds: IntArray,
    names: tuple[str, ...],
    predicted: Callable[[IntArray, IntArray], IntArray],
) -> FloatArray:
    """Return the confusion matrix, shape (c, c), over all folds.

    `predicted` gets the indices to train on and those to predict, and returns classes of the
    latter.
    """
    confusion = np.zeros((len(names), len(names)))
    for fold in np.unique(folds):
        inside = np.flatnonzero(folds == fold)
        found = predicted(np.flatnonzero(folds != fold), inside)
        np.add.at(confusion, (places[inside], found), areas[inside])
    return confusion

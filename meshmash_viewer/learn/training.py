"""Training of a classifier on labelled vertices, its probabilities and cross-validation."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError, MeshWarning, of_mesh
from meshmash_viewer.features.sums import Features
from meshmash_viewer.learn.columns import ClassColumns, diffused
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback, check_cancelled
from meshmash_viewer.surface.edges import connected
from meshmash_viewer.units import counted

#: Maximum number of labelled vertices used, and minimum number of a class with at least as many.
_MOST, _FEWEST = 20_000, 100
#: Number of trees, and labelled vertices times trees trained between two calls of `cancel`.
_TREES, _AT_ONCE = 100, 500_000
#: Trees in each training of the cross-validation; 100 trees change scores by thousandths only.
_TREES_SCORED = 40
#: Number of groups of strokes that are left out in turn.
_FOLDS = 5
#: Inverse of the penalty of the coefficients of the logistic regression.
_PENALTY = 0.05
#: Vertices predicted at a time.
_BLOCK = 25_000
#: Range of a constant column relative to its largest magnitude.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class ClassScores:
    """Result of a cross-validation.

    Parameters
    ----------
    classes : tuple of str
        Names of the c classes.
    confusion : ndarray, shape (c, c)
        Area of the labelled vertices of each class (row) by predicted class (column), in the
        squared unit of the model.
    left_out : {"meshes", "strokes"}
        Test sets that are left out of the training.
    folds : int
        Number of trainings.

    Examples
    --------
    >>> areas = np.array([[8.0, 2.0], [0.0, 10.0]])
    >>> scores = ClassScores(("spine", "shaft"), areas, "strokes", 5)
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
        """Return the scores as JSON values."""
        lists = {"confusion": self.confusion.tolist(), "f1": self.f1.tolist()}
        return {**asdict(self), **lists, "weighted_f1": self.weighted_f1}

    @classmethod
    def from_plain(cls, entries: dict[str, Any]) -> Self:
        """Create scores from the result of `plain`."""
        names = tuple(map(str, entries["classes"]))
        confusion = np.array(entries["confusion"], dtype=np.float64).reshape(len(names), len(names))
        return cls(names, confusion, str(entries["left_out"]), int(entries["folds"]))


@dataclass(eq=False)
class Training:
    """Labelled vertices of all meshes, with their columns.

    `known` is the class index of each vertex of each mesh, -1 for none.
    """

    meshes: list[Mesh]
    known: list[IntArray]
    tables: list[Features]
    columns: ClassColumns
    names: tuple[str, ...]
    kind: str
    smoothing: float
    cancel: CancelCallback | None

    def __post_init__(self) -> None:
        starts, known = np.cumsum([0, *map(len, self.known)]), np.concatenate(self.known)
        rows = np.flatnonzero(known >= 0)  # indices among the vertices of all meshes
        if len(rows) > _MOST:
            rows = rows[_drawn(known[rows], len(self.names))]
        self.of_mesh = np.searchsorted(starts, rows, side="right") - 1
        self.vertex = rows - starts[self.of_mesh]
        self.places = known[rows]
        # a stroke is a connected part of a class
        own = zip(self.meshes, starts[:-1], strict=True)
        tails = np.concatenate([mesh.faces + at for mesh, at in own])
        tips = np.roll(tails, -1, axis=1)
        same = known[tails] == known[tips]
        self.stroke = connected(tails[same], tips[same], len(known))[rows]
        areas = [mesh.vertex_areas / self.columns.scale(mesh) ** 2 for mesh in self.meshes]
        self.areas = np.concatenate(areas)[rows]
        self.values = np.concatenate(
            [table.values[self.vertex[self.of_mesh == i]] for i, table in enumerate(self.tables)]
        )
        _check_columns(self.values, self.tables[0].columns, of_mesh(self.meshes[0].name))

    @property
    def meshes_plain(self) -> tuple[dict[str, Any], ...]:
        """The meshes as JSON values, see `ClassModel`."""
        return tuple(
            {
                "name": mesh.name,
                "hash": mesh.content_hash,
                "unit": mesh.unit,
                "n_vertices": mesh.n_vertices,
                "n_left_out": len(mesh.unreferenced),
                "median_edge": self.columns.edge(mesh),
                "n_labelled": int(np.count_nonzero(known >= 0)),
            }
            for mesh, known in zip(self.meshes, self.known, strict=True)
        )

    def fitted(
        self, some: IntArray, progress: ProgressCallback | None = None, n_trees: int = _TREES
    ) -> Any:
        """Train a classifier on some of the labelled vertices."""
        check_cancelled(self.cancel)
        values, places = self.values[some], self.places[some]
        parts = {}
        if self.kind != "logistic":
            parts["forest"] = self._forest(values, places, progress, n_trees)
        if self.kind != "forest":
            parts["logistic"] = _regression(values, places)
        if len(parts) == 1:
            return parts[self.kind]
        from sklearn.ensemble import VotingClassifier
        from sklearn.preprocessing import LabelEncoder

        mean = VotingClassifier(list(parts.items()), voting="soft")
        mean.estimators_, mean.le_ = list(parts.values()), LabelEncoder().fit(places)  # as in `fit`
        mean.classes_ = mean.le_.classes_
        return mean

    def _forest(
        self, values: FloatArray, places: IntArray, progress: ProgressCallback | None, n_trees: int
    ) -> Any:
        from sklearn.ensemble import ExtraTreesClassifier

        forest = ExtraTreesClassifier(
            min_samples_leaf=2, random_state=0, n_jobs=-1, warm_start=True
        )
        for part in blocks(n_trees, max(_AT_ONCE // len(places), 1)):
            check_cancelled(self.cancel)
            if progress is not None:
                progress(Progress("training", part.start / n_trees, message="Training"))
            with warnings.catch_warnings():  # threads of the forest may change the filters
                forest.set_params(n_estimators=part.stop).fit(values, places)
        return forest.set_params(warm_start=False, n_jobs=1)

    def scores(self, progress: ProgressCallback | None) -> tuple[ClassScores | None, str]:
        """Cross-validate; return scores and "", or None and the reason as a sentence."""
        try:
            folds, left_out = self._folds()
        except InputError as fault:
            return None, str(fault)
        numbers, confusion = np.unique(folds), np.zeros((len(self.names), len(self.names)))
        for at, fold in enumerate(numbers):
            if progress is not None:
                progress(Progress("scores", at / len(numbers), message="Cross-validation"))
            test = np.flatnonzero(folds == fold)
            classifier = self.fitted(np.flatnonzero(folds != fold), n_trees=_TREES_SCORED)
            found = self._predicted(classifier, test)
            np.add.at(confusion, (self.places[test], found), self.areas[test])
        return ClassScores(self.names, confusion, left_out, len(numbers)), ""

    def _folds(self) -> tuple[IntArray, str]:
        """Return the fold of each labelled vertex, shape (s,), and the kind of folds.

        Folds are meshes if the others have all classes, otherwise strokes of each class,
        distributed by size. `InputError` is raised if a class has only one stroke.
        """
        places, of_mesh = self.places, self.of_mesh
        kept = [len(np.unique(places[of_mesh != mesh])) for mesh in range(len(self.meshes))]
        if len(kept) > 1 and min(kept) == len(self.names):
            return of_mesh, "meshes"
        folds = np.zeros(len(places), dtype=np.int64)
        for place, name in enumerate(self.names):
            own = places == place
            _, inverse, sizes = np.unique(self.stroke[own], return_inverse=True, return_counts=True)
            if len(sizes) < 2:
                fault = f"There are no scores yet, as {name!r} has {counted(len(sizes), 'stroke')}"
                raise InputError("too-few-labels", fault, "label another place of it")
            rank = np.argsort(np.argsort(-sizes, kind="stable"))
            folds[own] = rank[inverse] % _FOLDS
        return folds, "strokes"

    def _predicted(self, classifier: Any, some: IntArray) -> IntArray:
        """Predict classes of some labelled vertices; probabilities are smoothed on whole meshes."""
        if not self.smoothing:
            values = probabilities(classifier, self.values[some], None, self.cancel)
            return np.asarray(values.argmax(axis=1))
        found = np.zeros(len(some), dtype=np.int64)
        for at in np.unique(self.of_mesh[some]):
            values = predicted(
                classifier, self.meshes[at], self.tables[at].values, self.columns, self.smoothing,
                cancel=self.cancel,
            )  # fmt: skip
            here = self.of_mesh[some] == at
            found[here] = values[self.vertex[some[here]]].argmax(axis=1)
        return found


def _drawn(places: IntArray, n_classes: int) -> IntArray:
    """Draw labelled vertices evenly, and additional vertices of rare classes."""
    drawn = [np.linspace(0, len(places) - 1, _MOST).astype(np.int64)]
    for place in range(n_classes):
        own = np.flatnonzero(places == place)
        if len(own) * _MOST < _FEWEST * len(places):
            some = np.linspace(0, len(own) - 1, min(len(own), _FEWEST))
            drawn.append(own[some.astype(np.int64)])
    return np.unique(np.concatenate(drawn))


def _regression(values: npt.NDArray[Any], places: IntArray) -> Any:
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    # a strong penalty, since strokes are few and neighbouring columns correlated
    regression = LogisticRegression(C=_PENALTY, class_weight="balanced", max_iter=1000)
    return make_pipeline(StandardScaler(), regression).fit(values.astype(np.float64), places)


def _check_columns(values: FloatArray, names: Sequence[str], subject: str) -> None:
    """Raise `InputError` if values are missing or all columns constant; warn if some are."""
    missing = np.flatnonzero(~np.isfinite(values).all(axis=0))
    if len(missing):
        fault = f"{subject}column {names[missing[0]]} has no value at some labelled vertices"
        raise InputError("no-values", fault, "take other columns, or repair the mesh")
    size = np.abs(values).max(axis=0)
    constant = np.flatnonzero(np.ptp(values, axis=0) <= _SAME * size)
    if len(constant) == len(names):
        fault = f"{subject}all columns are the same at all labelled vertices"
        raise InputError("constant-columns", fault, "take other times or other kinds of columns")
    if len(constant):
        said = ", ".join(names[at] for at in constant[:3]) + (", …" if len(constant) > 3 else "")
        said = f"{subject}{counted(len(constant), 'column')} ({said}) the same at all labelled"
        text = f"{said} vertices: nothing is learned from them."
        warnings.warn(text, MeshWarning, stacklevel=5)


def probabilities(
    classifier: Any,
    values: npt.NDArray[Any],
    progress: ProgressCallback | None,
    cancel: CancelCallback | None,
) -> FloatArray:
    """Return the probability of each class, shape (n, c).

    A forest must not use threads here: it would set the warning filters of all threads, and the
    rounding of sums would depend on the order in which its threads end.
    """
    found = []
    for part in blocks(len(values), _BLOCK):
        check_cancelled(cancel)
        found.append(np.asarray(classifier.predict_proba(values[part]), dtype=np.float64))
        if progress is not None:
            share = min(len(found) * _BLOCK / len(values), 1.0)
            progress(Progress("prediction", share, message="Predicting"))
    return np.concatenate(found)


def predicted(
    classifier: Any,
    mesh: Mesh,
    values: npt.NDArray[Any],
    columns: ClassColumns,
    smoothing: float,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> FloatArray:
    """Return the smoothed probability of each class, shape (n, c); NaN at unreferenced vertices."""
    used, own = mesh.referenced, smoothing * columns.scale(mesh)
    found = probabilities(classifier, values[used], progress, cancel)
    result = np.full((mesh.n_vertices, found.shape[1]), np.nan)
    result[used] = found
    if own:
        smooth = diffused(*columns.matrices(mesh), mesh.on_surface(result), own, cancel=cancel)
        smooth = np.clip(smooth[used], 0.0, 1.0)
        sums = smooth.sum(axis=1, keepdims=True)
        result[used] = smooth / np.where(sums > 0.0, sums, 1.0)
    return result


def importance_of(classifier: Any, kind: str) -> FloatArray:
    """Return the share of each column in the decisions, see `ClassModel`."""
    if kind == "ensemble":
        forest, regression = classifier.estimators_
        both = importance_of(forest, "forest"), importance_of(regression, "logistic")
        return np.asarray(np.mean(both, axis=0))
    if kind == "forest":
        return np.asarray(classifier.feature_importances_, dtype=np.float64)
    sizes = np.abs(classifier[-1].coef_).mean(axis=0)
    return np.asarray(sizes / sizes.sum(), dtype=np.float64)

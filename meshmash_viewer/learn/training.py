"""Training of a classifier on labelled vertices, its scores, and its probabilities."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError, MeshWarning, of_mesh
from meshmash_viewer.features.sums import Features
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.learn.columns import ClassColumns
from meshmash_viewer.learn.diffusion import diffused
from meshmash_viewer.learn.scores import ClassScores, cross_validated, folds_of, strokes
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import (
    CancelCallback,
    Progress,
    ProgressCallback,
    check_cancelled,
)
from meshmash_viewer.units import counted

#: Most labelled vertices that are used, which are drawn evenly.
_MOST = 20_000
#: Trees, and labelled vertices times trees that are trained between two questions whether to go on.
_TREES, _AT_ONCE = 100, 500_000
#: Trees in each training of the cross-validation, whose scores differ by some thousandths.
_TREES_SCORED = 40
#: Inverse of the penalty of the coefficients of the logistic regression.
_PENALTY = 0.05
#: Vertices that are predicted at a time.
_BLOCK = 25_000
#: Range relative to the largest magnitude below which a column is constant.
_SAME = 1e-6


class Training:
    """Labelled vertices of all meshes, with their columns."""

    def __init__(
        self,
        meshes: list[Mesh],
        places: list[IntArray],
        tables: list[Features],
        columns: ClassColumns,
        names: tuple[str, ...],
        kind: str,
        smoothing: float,
        cancel: CancelCallback | None,
    ) -> None:
        self.meshes, self.tables, self.columns, self.kind = meshes, tables, columns, kind
        self.smoothing, self.cancel, self.names = smoothing, cancel, names
        self.counts = [int(np.count_nonzero(each >= 0)) for each in places]
        at = [np.flatnonzero(each >= 0) for each in places]
        self.of_mesh = np.repeat(np.arange(len(at)), [len(each) for each in at])
        own, taken = [], 0
        for mesh, each, some in zip(meshes, places, at, strict=True):
            stroke = strokes(mesh, each)[some] + taken
            own.append(stroke)
            taken = int(stroke.max(initial=-1)) + 1 if len(stroke) else taken
        self.stroke = np.concatenate(own)
        self.vertex = np.concatenate(at)
        self.places = np.concatenate([each[some] for each, some in zip(places, at, strict=True)])
        if len(self.places) > _MOST:
            drawn = np.linspace(0, len(self.places) - 1, _MOST).astype(np.int64)
            for name in ("of_mesh", "stroke", "vertex", "places"):
                setattr(self, name, getattr(self, name)[drawn])
        self.values = np.concatenate(
            [table.values[self.vertex[self.of_mesh == i]] for i, table in enumerate(tables)]
        )
        self.areas = np.concatenate(
            [
                mesh.vertex_areas[self.vertex[self.of_mesh == i]] / columns.scale(mesh) ** 2
                for i, mesh in enumerate(meshes)
            ]
        )
        _check_columns(self.values, tables[0].columns, of_mesh(meshes[0].name))

    def described(self) -> tuple[dict[str, Any], ...]:
        """Describe the meshes."""
        return tuple(
            {
                "name": mesh.name,
                "hash": mesh.content_hash,
                "unit": mesh.unit,
                "n_vertices": mesh.n_vertices,
                "n_left_out": len(mesh.unreferenced),
                "n_labelled": count,
            }
            for mesh, count in zip(self.meshes, self.counts, strict=True)
        )

    def fitted(
        self, some: IntArray, progress: ProgressCallback | None = None, n_trees: int = _TREES
    ) -> Any:
        """Train on some of the labelled vertices."""
        check_cancelled(self.cancel)
        values, places = self.values[some], self.places[some]
        if self.kind == "forest":
            return self._forest(values, places, progress, n_trees)
        if self.kind == "logistic":
            return _regression(values, places)
        from sklearn.ensemble import VotingClassifier
        from sklearn.preprocessing import LabelEncoder

        both = self._forest(values, places, progress, n_trees), _regression(values, places)
        mean = VotingClassifier(list(zip(("forest", "logistic"), both, strict=True)), voting="soft")
        mean.estimators_, mean.le_ = list(both), LabelEncoder().fit(places)  # trained already
        mean.classes_ = mean.le_.classes_
        return mean

    def _forest(
        self,
        values: npt.NDArray[Any],
        places: IntArray,
        progress: ProgressCallback | None,
        n_trees: int,
    ) -> Any:
        from sklearn.ensemble import ExtraTreesClassifier

        forest = ExtraTreesClassifier(
            min_samples_leaf=2, random_state=0, n_jobs=-1, warm_start=True
        )
        step = max(_AT_ONCE // len(places), 1)
        for part in blocks(n_trees, step):
            check_cancelled(self.cancel)
            if progress is not None:
                progress(Progress("training", part.start / n_trees, message="Training"))
            with warnings.catch_warnings():  # which threads of the forest may leave changed
                forest.set_params(n_estimators=part.stop).fit(values, places)
        return forest.set_params(warm_start=False, n_jobs=1)

    def scores(self, progress: ProgressCallback | None) -> tuple[ClassScores | None, str]:
        """Cross-validate; return the scores, or None and a sentence why there are none."""
        folds, left_out, fault = folds_of(self.places, self.stroke, self.of_mesh, self.names)
        if fault:
            return None, fault
        count, seen = len(np.unique(folds)), 0

        def predicted(train: IntArray, test: IntArray) -> IntArray:
            nonlocal seen
            if progress is not None:
                progress(Progress("scores", seen / count, message="Cross-validation"))
            seen += 1
            classifier = self.fitted(train, n_trees=_TREES_SCORED)
            if not self.smoothing:
                return self._best(classifier, self.values[test])
            found = np.zeros(len(test), dtype=np.int64)
            for at, (mesh, table) in enumerate(zip(self.meshes, self.tables, strict=True)):
                here = self.of_mesh[test] == at
                if here.any():
                    found[here] = self._best_on(classifier, mesh, table)[self.vertex[test[here]]]
            return found

        confusion = cross_validated(self.places, self.areas, folds, self.names, predicted)
        return ClassScores(self.names, confusion, left_out, count), ""

    def _best(self, classifier: Any, values: FloatArray) -> IntArray:
        found = probabilities(classifier, values, None, self.cancel)
        return np.asarray(classifier.classes_[found.argmax(axis=1)])

    def _best_on(self, classifier: Any, mesh: Mesh, table: Features) -> IntArray:
        """Return the smoothed classes of all vertices."""
        values = np.zeros((mesh.n_vertices, len(self.names)))
        used = mesh.referenced
        values[used] = probabilities(classifier, table.values[used], None, self.cancel)
        smooth = smoothed(mesh, values, self.smoothing, self.columns, self.cancel)
        return np.asarray(smooth.argmax(axis=1))


def _regression(values: npt.NDArray[Any], places: IntArray) -> Any:
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    # strokes are few, and neighbouring columns say nearly the same
    regression = LogisticRegression(C=_PENALTY, class_weight="balanced", max_iter=1000)
    return make_pipeline(StandardScaler(), regression).fit(values.astype(np.float64), places)


def _check_columns(values: FloatArray, names: Sequence[str], subject: str) -> None:
    """Raise `InputError` for columns without values or all constant; warn of some constant ones."""
    missing = np.flatnonzero(~np.isfinite(values).all(axis=0))
    if len(missing):
        raise InputError(
            f"{subject}column {names[missing[0]]} has no value at some labelled vertices: take"
            " other columns, or repair the mesh."
        )
    size = np.abs(values).max(axis=0)
    constant = np.flatnonzero(np.ptp(values, axis=0) <= _SAME * size)
    if len(constant) == len(names):
        raise InputError(
            f"{subject}all columns are the same at all labelled vertices, so nothing can be learned"
            " from them: take other times or other kinds of columns."
        )
    if len(constant):
        said = ", ".join(names[at] for at in constant[:3]) + (", …" if len(constant) > 3 else "")
        warnings.warn(
            f"{subject}{counted(len(constant), 'column')} ({said}) the same at all labelled"
            " vertices: nothing is learned from them.",
            MeshWarning,
            stacklevel=4,
        )


def probabilities(
    classifier: Any,
    values: npt.NDArray[Any],
    progress: ProgressCallback | None,
    cancel: CancelCallback | None,
) -> FloatArray:
    """Return the probability of each class, shape (n, c).

    Without threads: a forest sets the filters of warnings, which are those of all threads, and adds
    up its trees in the order in which threads of its own end.
    """
    found = []
    for part in blocks(len(values), _BLOCK):
        check_cancelled(cancel)
        found.append(np.asarray(classifier.predict_proba(values[part]), dtype=np.float64))
        if progress is not None:
            share = min(len(found) * _BLOCK / len(values), 1.0)
            progress(Progress("prediction", share, message="Predicting"))
    return np.concatenate(found)


def smoothed(
    mesh: Mesh,
    values: FloatArray,
    length: float,
    columns: ClassColumns,
    cancel: CancelCallback | None,
) -> FloatArray:
    """Smooth probabilities over a length, in the unit of the columns."""
    if not length:
        return values
    options = columns.operator
    stiffness, mass = cotangent_laplacian(mesh, options.robust, options.mollify_factor)
    own = length * columns.scale(mesh)
    smooth = diffused(stiffness, mass.diagonal(), mesh.on_surface(values), own, cancel=cancel)
    smooth = np.clip(smooth, 0.0, 1.0)
    smooth /= smooth.sum(axis=1, keepdims=True) + (smooth.sum(axis=1, keepdims=True) == 0.0)
    return np.where(mesh.referenced[:, None], smooth, np.nan)


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

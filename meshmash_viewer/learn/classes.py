"""Classes of vertices: trained from labels of some, predicted at all, on any mesh with a unit."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError, MeshWarning, of_mesh
from meshmash_viewer.features.regions import label_map
from meshmash_viewer.features.sums import Features
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.learn import CLASSIFIERS, Classifier
from meshmash_viewer.learn.columns import ClassColumns
from meshmash_viewer.learn.diffusion import diffused
from meshmash_viewer.learn.scores import ClassScores, cross_validated, folds_of, strokes
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import (
    CancelCallback,
    Progress,
    ProgressCallback,
    check_cancelled,
)
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import Label, VertexMap

#: Fewest labelled vertices of a class, and most of all that are used, which are drawn evenly.
_LEAST, _MOST = 5, 20_000
#: Trees, and labelled vertices times trees that are trained between two questions whether to go on.
_TREES, _AT_ONCE = 100, 500_000
#: Vertices that are predicted at a time.
_BLOCK = 25_000
#: Eigenpairs of the first mesh, where columns are chosen from none.
_PAIRS = 200
#: Range relative to the largest magnitude below which a column is constant.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class ClassModel:
    """A trained classifier, with all that is needed to apply it to another mesh.

    Parameters
    ----------
    classifier : estimator of scikit-learn
    kind : str
        "forest" or "logistic".
    columns : ClassColumns
        What it is applied to.
    classes : tuple of Label
        With their colours, in the order of the classifier.
    importance : ndarray, shape (f,)
        Share of each column in the decisions, of sum 1: the decrease of impurity in a forest, the
        mean magnitude of the coefficients of a regression. Of columns that say the same, each
        has a part.
    smoothing : float
        Length over which probabilities are smoothed, in the unit of the columns.
    meshes : tuple of dict
        Name, content hash, and numbers of vertices and of labelled ones of each training mesh.
    scores : ClassScores, optional
        Of the cross-validation; None without one.
    unscored : str
        Why there are no scores, a sentence.
    about : dict
        Further entries of the card in the file, for JSON.

    Examples
    --------
    >>> parts = (mv.Label(1, "cap", "#4477aa"), mv.Label(2, "side", "#ee6677"))
    >>> pill = mv.Mesh(ball.vertices * [1, 1, 3], ball.faces)
    >>> labels = mv.VertexMap("part", np.where(pill.vertices[:, 2] > 2, 1, 2), labels=parts)
    >>> model = mv.train_classes(pill, labels)
    >>> model.scores, model.unscored[:23]
    (None, 'There are no scores yet')
    """

    classifier: Any
    kind: str
    columns: ClassColumns
    classes: tuple[Label, ...]
    importance: FloatArray
    smoothing: float = 0.0
    meshes: tuple[dict[str, Any], ...] = ()
    scores: ClassScores | None = None
    unscored: str = ""
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the classes."""
        return tuple(each.name for each in self.classes)

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise `InputError` for a mesh whose unit is not known, unless it was trained on it."""
        hashes = {each.get("hash") for each in self.meshes}
        if mesh.unit or self.columns.unit or mesh.content_hash not in hashes:
            self.columns.check_unit(mesh)


@dataclass(frozen=True, eq=False)
class ClassPrediction:
    """The class of every vertex.

    Parameters
    ----------
    labels : VertexMap
        The most probable class; no label at vertices without faces.
    probabilities : tuple of VertexMap
        That of each class, in the order of the model; of sum 1.
    uncertainty : VertexMap
        One minus the largest probability: where another label would help most.

    Examples
    --------
    >>> parts = (mv.Label(1, "cap", "#4477aa"), mv.Label(2, "side", "#ee6677"))
    >>> pill = mv.Mesh(ball.vertices * [1, 1, 3], ball.faces)
    >>> labels = mv.VertexMap("part", np.where(pill.vertices[:, 2] > 2, 1, 2), labels=parts)
    >>> found = mv.predict_classes(pill, mv.train_classes(pill, labels))
    >>> [each.name for each in found.maps]
    ['class', 'probability of cap', 'probability of side', 'uncertainty']
    """

    labels: VertexMap
    probabilities: tuple[VertexMap, ...]
    uncertainty: VertexMap

    @property
    def maps(self) -> tuple[VertexMap, ...]:
        """All of them, for `Mesh.with_maps`."""
        return (self.labels, *self.probabilities, self.uncertainty)


def train_classes(
    meshes: MeshLike | Sequence[MeshLike],
    labels: VertexMap | Sequence[VertexMap],
    columns: ClassColumns | str = "hks",
    classifier: Classifier = "forest",
    *,
    smoothing: float = 0.0,
    pairs: Eigenpairs | Sequence[Eigenpairs | None] | None = None,
    features: Features | Sequence[Features] | None = None,
    scored: bool = True,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> ClassModel:
    """Learn classes from the labels of some vertices of one or several meshes.

    Parameters
    ----------
    meshes : MeshLike or sequence of them
        All with a unit of length, unless it is one mesh.
    labels : VertexMap or sequence of them
        Labels of each mesh. Classes are the same where their names are; without names, where
        their numbers are, and 0 is no label.
    columns : ClassColumns or str
        What to learn from. Kinds alone, such as "hks" or "hks,curvature", are computed at the times
        that `ClassColumns.chosen` finds for the first mesh.
    classifier : {"forest", "logistic"}
        100 extremely randomized trees [1]_, or logistic regression of standardized columns.
    smoothing : float
        Length over which probabilities are smoothed by diffusion, in the unit of the columns.
    pairs : Eigenpairs or sequence, optional
        Eigenpairs of each mesh, if they are known.
    features : Features or sequence, optional
        Results of `ClassColumns.compute` for each mesh, if they are known: with them an interactive
        program trains again after each stroke.
    scored : bool
        Whether to cross-validate, which trains up to five times more. Whole meshes are left out
        where the others have all classes, else whole strokes, which are connected parts of a
        class: neighbouring vertices are nearly equal, so that single ones would show nothing.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ClassModel

    Raises
    ------
    InputError
        If scikit-learn is not installed, labels are of another mesh or are no whole numbers, there
        are fewer than two classes or fewer than five labelled vertices of one, all columns are
        constant there, or one of several meshes has no unit of length.

    Warns
    -----
    MeshWarning
        For columns that are constant at the labelled vertices.

    Notes
    -----
    Of more than 20,000 labelled vertices so many are used, drawn evenly.

    References
    ----------
    .. [1] Geurts, P., Ernst, D. and Wehenkel, L. (2006). "Extremely randomized trees." Machine
       Learning 63.

    Examples
    --------
    >>> parts = (mv.Label(1, "cap", "#4477aa"), mv.Label(2, "side", "#ee6677"))
    >>> pill = mv.Mesh(ball.vertices * [1, 1, 3], ball.faces)
    >>> labels = mv.VertexMap("part", np.where(pill.vertices[:, 2] > 2, 1, 2), labels=parts)
    >>> model = mv.train_classes(pill, labels, "curvature")
    >>> model.names, len(model.importance)
    (('cap', 'side'), 48)
    """
    _require_packages()
    if classifier not in CLASSIFIERS:
        names = ", ".join(CLASSIFIERS)
        raise InputError(f"There is no classifier {classifier!r}: the classifiers are {names}.")
    if not 0.0 <= smoothing < np.inf:
        raise InputError(f"smoothing is {smoothing:g}: give a length, or 0 for none.")
    many = not isinstance(labels, VertexMap)
    given = [as_mesh(each) for each in meshes] if many else [as_mesh(meshes)]
    sets = list(labels) if not isinstance(labels, VertexMap) else [labels]
    known = _listed(pairs, many, len(given))
    done = _listed(features, many, len(given))
    if len(sets) != len(given) or not given:
        said = f"{counted(len(given), 'mesh')} and {counted(len(sets), 'set')} of labels"
        raise InputError(f"There are {said}: give each mesh its own.")
    sets = [
        mesh.with_maps(label_map(each)).maps[-1] for mesh, each in zip(given, sets, strict=True)
    ]
    classes = _joined(sets)
    if isinstance(columns, str):
        if known[0] is None:
            stiffness, mass = cotangent_laplacian(given[0], robust=True)
            known[0] = solve(stiffness, mass, _PAIRS, progress=progress, cancel=cancel)
        kinds = tuple(kind.strip() for kind in columns.split(","))
        columns = ClassColumns.chosen(given[0], known[0], kinds=kinds)
    if len(given) > 1:
        for mesh in given:
            columns.check_unit(mesh)
    places = [
        np.where(mesh.referenced, _places(each, classes), -1)
        for mesh, each in zip(given, sets, strict=True)
    ]
    _check_classes(np.concatenate(places), classes)
    tables = [
        found if found is not None else columns.compute(mesh, own, progress=progress, cancel=cancel)
        for mesh, own, found in zip(given, known, done, strict=True)
    ]
    training = _Training(given, places, tables, columns, classes, classifier, smoothing, cancel)
    fitted = training.fitted(np.arange(len(training.places)), progress)
    importance = _importance(fitted, classifier)
    model = ClassModel(
        fitted, classifier, columns, classes, importance, smoothing, training.described()
    )
    return training.scored(model, progress) if scored else model


def predict_classes(
    mesh: MeshLike,
    model: ClassModel,
    *,
    pairs: Eigenpairs | None = None,
    features: Features | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> ClassPrediction:
    """Predict the class of every vertex of a mesh.

    Parameters
    ----------
    mesh : MeshLike
        In any unit of length, which is converted; without one only the mesh of the training.
    model : ClassModel
    pairs : Eigenpairs, optional
        Of this mesh; computed where they do not suffice.
    features : Features, optional
        Result of ``model.columns.compute`` for this mesh, if it is known.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ClassPrediction

    Raises
    ------
    InputError
        If the mesh or the model has no unit of length.

    Examples
    --------
    >>> parts = (mv.Label(1, "cap", "#4477aa"), mv.Label(2, "side", "#ee6677"))
    >>> pill = mv.Mesh(ball.vertices * [1, 1, 3], ball.faces)
    >>> labels = mv.VertexMap("part", np.where(np.abs(pill.vertices[:, 2]) > 2, 1, 2), labels=parts)
    >>> model = mv.train_classes(pill, labels, "curvature")
    >>> found = mv.predict_classes(pill, model)
    >>> bool((found.labels.values == labels.values).mean() > 0.95), len(found.maps)
    (True, 4)
    """
    mesh = as_mesh(mesh)
    model.check_mesh(mesh)
    if features is None:
        features = model.columns.compute(mesh, pairs, progress=progress, cancel=cancel)
    values = np.full((mesh.n_vertices, len(model.classes)), np.nan)
    values[mesh.referenced] = _probabilities(
        model.classifier, features.values[mesh.referenced], progress, cancel
    )
    values = _smoothed(mesh, values, model.smoothing, model.columns, cancel)
    keys = np.array([each.key for each in model.classes])
    none = 0 if 0 not in keys else int(keys.min()) - 1
    best = np.nan_to_num(values, nan=-1.0).argmax(axis=1)
    labels = np.where(mesh.referenced, keys[best], none)
    return ClassPrediction(
        VertexMap("class", labels, model.classes),
        tuple(
            VertexMap(f"probability of {name}", column)
            for name, column in zip(model.names, values.T, strict=True)
        ),
        VertexMap("uncertainty", 1.0 - values.max(axis=1)),
    )


def _joined(sets: Sequence[VertexMap]) -> tuple[Label, ...]:
    """Return the classes of all sets that some vertex has, those of one name once.

    A label that is named by its number is the one of that number in another set.
    """
    named = {
        each.key: each.name for known in sets for each in known.labels if each.name != str(each.key)
    }
    found: dict[str, Label] = {}
    for known in sorted(
        sets, key=lambda each: all(one.name == str(one.key) for one in each.labels)
    ):
        used = set(np.unique(known.values).tolist())
        for each in known.labels:
            name = named.get(each.key, each.name) if each.name == str(each.key) else each.name
            if each.key in used and name not in found:
                found[name] = replace(each, name=name, locked=False)
    taken: set[int] = set()
    for name, each in found.items():
        key = each.key if each.key not in taken else max(taken) + 1
        taken.add(key)
        found[name] = replace(each, key=key)
    return tuple(found.values())


def _places(known: VertexMap, classes: Sequence[Label]) -> IntArray:
    """Return the class of each vertex, shape (n,); -1 without a label."""
    by_name = {each.name: place for place, each in enumerate(classes)}
    by_key = {each.key: place for place, each in enumerate(classes)}
    result = np.full(known.n_vertices, -1, dtype=np.int64)
    for each in known.labels:
        place = by_name.get(each.name)
        if place is None and each.name == str(each.key):
            place = by_key.get(each.key)
        if place is not None:
            result[known.values == each.key] = place
    return result


def _check_classes(places: IntArray, classes: Sequence[Label]) -> None:
    counts = np.bincount(places[places >= 0], minlength=len(classes))
    if len(classes) < 2:
        only = (
            f"All labelled vertices are {classes[0].name!r}" if classes else "No vertex is labelled"
        )
        raise InputError(f"{only}: label some of at least two classes.")
    for each, count in zip(classes, counts, strict=True):
        if count < _LEAST:
            raise InputError(
                f"Class {each.name!r} has {counted(int(count), 'vertex')} on the surface: label at"
                f" least {_LEAST}."
            )


def _listed(given: Any, many: bool, count: int) -> list[Any]:
    """Return one entry a mesh."""
    if given is None:
        return [None] * count
    found = list(given) if many else [given]
    if len(found) != count:
        raise InputError(f"There are {count} meshes and {len(found)} results for them: give each.")
    return found


class _Training:
    """Labelled vertices of all meshes, with their columns."""

    def __init__(
        self,
        meshes: list[Mesh],
        places: list[IntArray],
        tables: list[Features],
        columns: ClassColumns,
        classes: tuple[Label, ...],
        kind: str,
        smoothing: float,
        cancel: CancelCallback | None,
    ) -> None:
        self.meshes, self.tables, self.columns, self.kind = meshes, tables, columns, kind
        self.smoothing, self.cancel, self.classes = smoothing, cancel, classes
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

    def fitted(self, some: IntArray, progress: ProgressCallback | None = None) -> Any:
        """Train on some of the labelled vertices."""
        check_cancelled(self.cancel)
        values, places = self.values[some], self.places[some]
        if self.kind == "logistic":
            from sklearn.linear_model import LogisticRegression
            from sklearn.pipeline import make_pipeline
            from sklearn.preprocessing import StandardScaler

            return make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000)).fit(
                values.astype(np.float64), places
            )
        from sklearn.ensemble import ExtraTreesClassifier

        forest = ExtraTreesClassifier(
            min_samples_leaf=2, random_state=0, n_jobs=-1, warm_start=True
        )
        step = max(_AT_ONCE // len(some), 1)
        for part in blocks(_TREES, step):
            check_cancelled(self.cancel)
            if progress is not None:
                progress(Progress("training", part.start / _TREES, message="Training"))
            forest.set_params(n_estimators=part.stop).fit(values, places)
        return forest.set_params(warm_start=False, n_jobs=1)

    def scored(self, model: ClassModel, progress: ProgressCallback | None) -> ClassModel:
        """Cross-validate a model."""
        folds, left_out, fault = folds_of(self.places, self.stroke, self.of_mesh, model.names)
        if fault:
            return replace(model, unscored=fault)
        count, seen = len(np.unique(folds)), 0

        def predicted(train: IntArray, test: IntArray) -> IntArray:
            nonlocal seen
            if progress is not None:
                progress(Progress("scores", seen / count, message="Cross-validation"))
            seen += 1
            classifier = self.fitted(train)
            if not self.smoothing:
                return self._best(classifier, self.values[test])
            found = np.zeros(len(test), dtype=np.int64)
            for at, (mesh, table) in enumerate(zip(self.meshes, self.tables, strict=True)):
                here = self.of_mesh[test] == at
                if here.any():
                    found[here] = self._best_on(classifier, mesh, table)[self.vertex[test[here]]]
            return found

        confusion = cross_validated(self.places, self.areas, folds, model.names, predicted)
        return replace(model, scores=ClassScores(model.names, confusion, left_out, count))

    def _best(self, classifier: Any, values: FloatArray) -> IntArray:
        found = _probabilities(classifier, values, None, self.cancel)
        return np.asarray(classifier.classes_[found.argmax(axis=1)])

    def _best_on(self, classifier: Any, mesh: Mesh, table: Features) -> IntArray:
        """Return the smoothed classes of all vertices."""
        values = np.zeros((mesh.n_vertices, len(self.classes)))
        used = mesh.referenced
        values[used] = _probabilities(classifier, table.values[used], None, self.cancel)
        smooth = _smoothed(mesh, values, self.smoothing, self.columns, self.cancel)
        return np.asarray(smooth.argmax(axis=1))


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


def _probabilities(
    classifier: Any,
    values: npt.NDArray[Any],
    progress: ProgressCallback | None,
    cancel: CancelCallback | None,
) -> FloatArray:
    """Return the probability of each class, shape (n, c).

    Blocks of vertices are predicted in threads: a forest that uses threads itself adds up its trees
    in the order in which these end.
    """
    from joblib import cpu_count

    def predicted(part: slice) -> FloatArray:
        check_cancelled(cancel)
        return np.asarray(classifier.predict_proba(values[part]), dtype=np.float64)

    found = []
    with ThreadPoolExecutor(cpu_count()) as pool:
        for block in pool.map(predicted, blocks(len(values), _BLOCK)):
            found.append(block)
            if progress is not None:
                share = min(len(found) * _BLOCK / len(values), 1.0)
                progress(Progress("prediction", share, message="Predicting"))
    return np.concatenate(found)


def _smoothed(
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


def _importance(classifier: Any, kind: str) -> FloatArray:
    if kind == "forest":
        return np.asarray(classifier.feature_importances_, dtype=np.float64)
    sizes = np.abs(classifier[-1].coef_).mean(axis=0)
    return np.asarray(sizes / sizes.sum(), dtype=np.float64)


def _require_packages() -> None:
    """Raise `InputError` if scikit-learn is not installed."""
    from importlib.util import find_spec

    if find_spec("sklearn") is None:
        raise InputError(
            "Learning classes needs scikit-learn, which is not installed:"
            ' pip install "meshmash-viewer[learn]".'
        )

"""Training of classes from labels of some vertices, and prediction at all vertices of meshes."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, MeshWarning, of_mesh, require, unknown, wrong_type
from meshmash_viewer.features.domains import checked_labels, domain_means
from meshmash_viewer.features.regions import label_map
from meshmash_viewer.features.sums import Features
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.learn import CLASSIFIERS, Classifier
from meshmash_viewer.learn.columns import ClassColumns
from meshmash_viewer.learn.training import (
    ClassScores,
    Training,
    importance_of,
    predicted,
    probabilities,
)
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.units import check_number, counted, format_quantity, format_range
from meshmash_viewer.vertex_map import Label, VertexMap, labels_in_use, unused_number

#: Minimum number of labelled vertices of a class.
_LEAST = 5
#: Number of eigenpairs computed to choose the times of columns.
_PAIRS = 200
#: Factor up to which the edge lengths of meshes are similar.
_SIMILAR = 1.5


@dataclass(frozen=True, eq=False)
class ClassModel:
    """A trained classifier with its columns and classes, applicable to other meshes.

    Parameters
    ----------
    classifier : estimator of scikit-learn
    kind : {"ensemble", "forest", "logistic"}
    columns : ClassColumns
    classes : tuple of Label
        Classes with colours, in the order of the classifier.
    importance : ndarray, shape (f,)
        Share of each column in the decisions, with sum 1: the decrease of impurity in a forest, the
        mean magnitude of the coefficients of a regression, or the mean of the two shares.
        Correlated columns share their importance.
    smoothing : float
        Length over which probabilities are smoothed, in the unit of the columns.
    meshes : tuple of dict
        Name, content hash, unit, median edge length (in the unit of the columns; missing in files
        of earlier versions), and numbers of vertices and of labelled vertices of each training
        mesh.
    scores : ClassScores, optional
        Result of the cross-validation; without one, the sentence `unscored` is the reason.
    about : dict
        Additional JSON entries of the card in the file.

    Examples
    --------
    >>> model = mv.train_classes(pill, parts)
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
        """Raise `InputError` for a mesh without unit, unless it is a training mesh."""
        if mesh.unit or self.columns.unit or not self._trained_on(mesh):
            self.columns.check_unit(mesh)

    def _trained_on(self, mesh: Mesh) -> bool:
        return any(each.get("hash") == mesh.content_hash for each in self.meshes)

    def resolution_remark(self, mesh: Mesh) -> str:
        """Return a sentence on columns that depend on the size of the triangles; "" for none.

        At short times HKS and WKS depend on the triangles more than on the shape, so such columns
        are comparable only between meshes with triangles of similar size. A model without the
        edge lengths of its training meshes is assumed to be trained on finer meshes.
        """
        columns, edge = self.columns, self.columns.edge(mesh)
        trained = [each["median_edge"] for each in self.meshes if "median_edge" in each]
        low, high = min(trained, default=0.0), max(trained, default=0.0)
        if low / _SIMILAR <= edge <= high * _SIMILAR or self._trained_on(mesh):
            return ""
        names, unresolved = columns.names, columns.unresolved(max(edge, high))
        if not unresolved.any():
            return ""
        first, unit = names[int(unresolved.argmax())], columns.unit
        size = f"a median edge of {format_quantity(edge, unit)}"
        if trained:
            one = format_range(low, high, unit, word="to") if high > 1.05 * low else ""
            size += f", and the training meshes one of {one or format_quantity(high, unit)}"
        return (
            f"The mesh has {size}: {np.count_nonzero(unresolved)} of"
            f" {counted(len(names), 'column')} ({first}, …) depend on the triangles more than on"
            f" the shape, so the classes may be wrong. {'Decimate' if edge < low else 'Refine'} the"
            " mesh, or train a model with longer times (--t-min, t_min=)."
        )


@dataclass(frozen=True, eq=False)
class ClassPrediction:
    """Predicted classes of vertices.

    Parameters
    ----------
    labels : VertexMap
        Most probable class; no label at vertices without faces.
    probabilities : tuple of VertexMap
        Probability of each class, in the order of the model.
    uncertainty : VertexMap
        One minus the largest probability. Further labels help most where this is high.
    remarks : tuple of str
        Sentences on what makes the classes less reliable, see `ClassModel.resolution_remark`.

    Examples
    --------
    >>> found = mv.predict_classes(pill, mv.train_classes(pill, parts))
    >>> [each.name for each in found.maps]
    ['class', 'probability of cap', 'probability of side', 'uncertainty']
    """

    labels: VertexMap
    probabilities: tuple[VertexMap, ...]
    uncertainty: VertexMap
    remarks: tuple[str, ...] = ()

    @property
    def maps(self) -> tuple[VertexMap, ...]:
        """All maps, for `Mesh.with_maps`."""
        return (self.labels, *self.probabilities, self.uncertainty)


def train_classes(
    meshes: MeshLike | Sequence[MeshLike],
    labels: VertexMap | npt.ArrayLike | Sequence[VertexMap | npt.ArrayLike],
    columns: ClassColumns | str = "hks",
    classifier: Classifier = "ensemble",
    *,
    smoothing: float = 0.0,
    pairs: EigenpairsLike | Sequence[EigenpairsLike | None] | None = None,
    features: Features | Sequence[Features] | None = None,
    scored: bool = True,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> ClassModel:
    """Learn classes from the labels of some vertices of one or several meshes.

    Of more than 20,000 labelled vertices, an evenly drawn subset of 20,000 is used. A `MeshWarning`
    is given for columns that are constant at the labelled vertices.

    `InputError` is raised if scikit-learn is not installed, labels do not fit the mesh or are not
    whole numbers, there are fewer than two classes or fewer than five labelled vertices of a class,
    all columns are constant at the labelled vertices, or one of several meshes has no unit.

    Parameters
    ----------
    meshes : MeshLike or sequence of them
        Training meshes; if there are several, each needs a unit of length.
    labels : VertexMap or array_like, shape (n,), or sequence of them
        Labels of each mesh, see `regions`. Labels with the same name are one class; without names,
        labels with the same number, where 0 is no label.
    columns : ClassColumns or str
        Columns to learn from, or only their kinds, such as "hks" or "hks,curvature", for the times
        that `ClassColumns.chosen` selects for the first mesh.
    classifier : {"ensemble", "forest", "logistic"}
        100 extremely randomized trees [1]_, logistic regression of standardized columns, or by
        default the mean of their probabilities, which depends least on the choice of strokes.
    smoothing : float
        Length over which probabilities are smoothed by diffusion, in the unit of the columns.
    pairs : Eigenpairs or sequence, optional
        Known eigenpairs of each mesh.
    features : Features or sequence, optional
        Known results of `ClassColumns.compute` for each mesh, for training after each stroke.
    scored : bool
        Whether to cross-validate, which trains up to five more times. Whole meshes are left out
        if the others have all classes, else whole strokes (connected parts of a class). Single
        vertices would give useless scores, as neighbouring vertices are nearly equal.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    References
    ----------
    .. [1] Geurts, P., Ernst, D. and Wehenkel, L. (2006). "Extremely randomized trees." Machine
       Learning 63.

    Examples
    --------
    >>> model = mv.train_classes(pill, parts, "curvature")
    >>> model.names, len(model.importance)
    (('cap', 'side'), 48)
    """
    require("Learning classes needs", "learn", "sklearn")
    if classifier not in CLASSIFIERS:
        raise unknown("classifier", classifier, CLASSIFIERS)
    check_number(smoothing, "smoothing")
    several: list[Any] = [meshes, labels, pairs, features]
    first: Any = next(iter(labels), None) if isinstance(labels, Iterable) else None
    if not isinstance(first, VertexMap) and np.ndim(first) == 0:
        several = [[each] for each in several]
    given, sets = [as_mesh(each) for each in several[0]], list(several[1])
    known, done = (list(each or [None] * len(given)) for each in several[2:])
    if not len(given) == len(sets) == len(known) == len(done) > 0:
        said = f"{counted(len(given), 'mesh')} and {counted(len(sets), 'set')} of labels"
        raise InputError("unequal-lists", f"There are {said}", "give one for each mesh")
    of_meshes = zip(given, sets, strict=True)
    sets = [mesh.with_maps(label_map(each)).maps[-1] for mesh, each in of_meshes]
    classes, places = _classes_of(sets)
    if isinstance(columns, str):
        if known[0] is None:
            stiffness, mass = cotangent_laplacian(given[0], robust=True)
            known[0] = solve(stiffness, mass, _PAIRS, progress=progress, cancel=cancel)
        kinds = tuple(kind.strip() for kind in columns.split(","))
        columns = ClassColumns.chosen(given[0], known[0], kinds=kinds)
    if len(given) > 1:
        for mesh in given:
            columns.check_unit(mesh)
    for mesh, each in zip(given, places, strict=True):
        each[mesh.unreferenced] = -1
    _check_classes(np.concatenate(places), classes)
    callbacks: Any = {"progress": progress, "cancel": cancel}
    tables = [
        columns.compute(mesh, own, **callbacks) if found is None else found
        for mesh, own, found in zip(given, known, done, strict=True)
    ]
    names = tuple(each.name for each in classes)
    training = Training(given, places, tables, columns, names, classifier, smoothing, cancel)
    fitted = training.fitted(np.arange(len(training.places)), progress)
    scores = training.scores(progress) if scored else (None, "")
    importance, plain = importance_of(fitted, classifier), training.meshes_plain
    return ClassModel(fitted, classifier, columns, classes, importance, smoothing, plain, *scores)


def predict_classes(
    mesh: MeshLike,
    model: ClassModel,
    *,
    pairs: EigenpairsLike | None = None,
    features: Features | None = None,
    domains: npt.ArrayLike | None = None,
    warn: bool = True,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> ClassPrediction:
    """Predict the class of every vertex of a mesh.

    `InputError` is raised if the mesh or the model has no unit of length, a column of the model is
    missing in `features`, or `domains` does not have one value for each vertex. A `MeshWarning` is
    given if the triangles are much larger or smaller than those of the training meshes, and columns
    depend on their size.

    Parameters
    ----------
    mesh : MeshLike
        The mesh; its unit of length is converted. Only a training mesh may have no unit.
    model : ClassModel
    pairs : Eigenpairs, optional
        Known eigenpairs of the mesh; more are computed if needed.
    features : Features, optional
        Known result of ``model.columns.compute`` for the mesh, or other features with columns of
        the same names.
    domains : array_like of int, shape (n,), optional
        Domain of each vertex, -1 for none, such as `CondensedHKS.labels`. Area-weighted means over
        domains are classified, without smoothing.
    warn : bool
        Whether to warn of the remarks, which are also in `ClassPrediction.remarks`.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Examples
    --------
    >>> model = mv.train_classes(pill, parts, "curvature")
    >>> found = mv.predict_classes(pill, model)
    >>> bool((found.labels.values == parts.values).mean() > 0.95), len(found.maps)
    (True, 4)
    """
    if not isinstance(model, ClassModel):
        raise wrong_type("Models", type(model), "the result of train_classes or read_classes")
    if not (features is None or isinstance(features, Features)):
        raise wrong_type("Features", type(features), "the result of model.columns.compute")
    mesh = as_mesh(mesh)
    model.check_mesh(mesh)
    remark = model.resolution_remark(mesh)
    if remark and warn:
        warnings.warn(f"{of_mesh(mesh.name)}{remark}", MeshWarning, stacklevel=2)
    if features is None:
        features = model.columns.compute(mesh, pairs, progress=progress, cancel=cancel)
    given = _matching(features, model)
    if domains is None:
        values = predicted(
            model.classifier, mesh, given, model.columns, model.smoothing, progress, cancel
        )
    else:
        known = checked_labels(domains, mesh.n_vertices)
        means = domain_means(np.asarray(given, dtype=np.float64), known, mesh.vertex_areas)
        whole = np.isfinite(means).all(axis=1)  # not the first row, of no domain
        given = means[whole].astype(given.dtype)
        of_domains = np.full((len(means), len(model.classes)), np.nan)
        of_domains[whole] = probabilities(model.classifier, given, progress, cancel)
        values = of_domains[known + 1]
    keys = np.array([each.key for each in model.classes])
    best = np.nan_to_num(values, nan=-1.0).argmax(axis=1)
    labels = np.where(np.isfinite(values[:, 0]), keys[best], unused_number(model.classes))
    named = zip(model.names, values.T, strict=True)
    return ClassPrediction(
        VertexMap("class", labels, model.classes),
        tuple(VertexMap(f"probability of {name}", column) for name, column in named),
        VertexMap("uncertainty", 1.0 - values.max(axis=1)),
        (remark,) if remark else (),
    )


def _matching(features: Features, model: ClassModel) -> npt.NDArray[Any]:
    """Return those columns of features that a model uses, selected by name."""
    names = model.columns.names
    if features.columns == names:
        return features.values
    if missing := [name for name in names if name not in features.columns]:
        fault = f"The features have no column {missing[0]!r}, which the model was trained with"
        raise InputError("no-column", fault, "compute them with model.columns.compute")
    return features.values[:, [features.columns.index(name) for name in names]]


def _classes_of(sets: Sequence[VertexMap]) -> tuple[tuple[Label, ...], list[IntArray]]:
    """Return the classes in use, and the index of the class of each vertex, -1 for none.

    Labels with the same name are one class. A label whose name is its number belongs to the class
    with the same number in another set.
    """
    named = {
        each.key: each
        for known in reversed(sets)
        for each in reversed(known.labels)
        if each.name != str(each.key)
    }
    found: dict[str, Label] = {}
    places = []
    for known in sets:
        place = np.full(known.n_vertices, -1, dtype=np.int64)
        for each in labels_in_use(known.labels, known.values):
            label = named.get(each.key, each) if each.name == str(each.key) else each
            found.setdefault(label.name, label)
            place[known.values == each.key] = list(found).index(label.name)
        places.append(place)
    classes: list[Label] = []
    for each in found.values():
        taken = {other.key for other in classes}
        key = each.key if each.key not in taken else max(taken) + 1
        classes.append(replace(each, key=key, locked=False))
    return tuple(classes), places


def _check_classes(places: IntArray, classes: Sequence[Label]) -> None:
    if len(classes) < 2:
        only = "".join(f"All labelled vertices are {each.name!r}" for each in classes)
        fault = only or "No vertex is labelled"
        raise InputError("too-few-labels", fault, "label some of at least two classes")
    for place, each in enumerate(classes):
        if (count := int(np.count_nonzero(places == place))) < _LEAST:
            fault = f"Class {each.name!r} has {counted(count, 'vertex')} on the surface"
            raise InputError("too-few-labels", fault, f"label at least {_LEAST}")

"""Classification of vertices, trained on a label set; predictions are maps of the mesh."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary

import msgspec
import numpy as np
from psygnal import Signal

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.parameter import Name, NotNegative, Text, checked_entry
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.learn import Classifier, ColumnKind
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.history import History
from meshmash_viewer.model.jobs import Job, Queueing, Work, heard_warnings
from meshmash_viewer.model.labels import Labels
from meshmash_viewer.model.maps import Maps
from meshmash_viewer.model.notices import Notices, Severity
from meshmash_viewer.model.open_mesh import OpenMesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import Channel, JobResult

if TYPE_CHECKING:
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.learn.classes import ClassModel
    from meshmash_viewer.learn.columns import ClassColumns

#: Pattern of the names of a prediction's maps, except for the predicted labels.
_PROBABILITY = re.compile(r"(probability of .*|uncertainty( \d+)*)", re.DOTALL)
#: Kind of the job that trains and predicts.
_CLASSIFYING = "Classifying"
#: Largest number of classes whose probabilities become maps; more would fill the list of maps.
_MOST_PROBABILITIES = 8
_OUTDATED = " The labels or the options have changed since: press Classify."


@dataclass(frozen=True)
class ClassOptions:
    """Options of `train_classes`; `smoothing` is a length in the unit of the mesh."""

    kinds: tuple[ColumnKind, ...] = ("curvature",)
    classifier: Classifier = "ensemble"
    smoothing: NotNegative = 0.0


@dataclass(frozen=True)
class Learned:
    """Scores of a prediction."""

    #: The scores in one line, or the reason why there are none.
    said: Text = ""
    #: Name of the label set used for training.
    labels: Name = ""


@dataclass(frozen=True)
class SavedClasses(ClassOptions):
    """Options and scores in a session file."""

    live: bool = False
    #: `Classes.outdated`.
    outdated: bool = False
    learned: Learned | None = None


def read_saved_classes(content: object, path: Path) -> SavedClasses:
    """Return the validated classes of a session file; raise `InputError` for an invalid entry."""
    saved: SavedClasses = checked_entry(SavedClasses, content, path, "classes")
    return saved


def classify(
    mesh: Mesh,
    labels: VertexMap,
    pairs: Eigenpairs,
    options: ClassOptions,
    live: bool,
    channel: Channel,
) -> JobResult:
    """Train on a label set and predict all vertices.

    The content is the maps and their `Learned`, which without maps has the reason. `live` is True
    if a change of the labels is the reason, not a request of the user.
    """
    from meshmash_viewer.learn.classes import predict_classes, train_classes
    from meshmash_viewer.learn.columns import ClassColumns

    exact = pairs.exact
    exact = replace(exact, rows=exact.rows[: exact.n_components])  # without preview rows
    callbacks: Any = {"progress": channel.report, "cancel": channel.cancelled}
    # cross-validation with smoothing takes too long after each stroke
    scored = not (live and options.smoothing)
    try:
        with heard_warnings() as heard:
            columns = ClassColumns.chosen(
                mesh, exact, kinds=options.kinds, operator=exact.operator or OperatorOptions()
            )
            key = mesh.content_hash, columns
            if key not in _last:
                computed = columns.compute(mesh, exact, **callbacks)
                _last.clear()
                _last[key] = computed
            callbacks["features"] = _last[key]
            model = train_classes(
                mesh, labels, columns, options.classifier,
                smoothing=options.smoothing, scored=scored, **callbacks,
            )  # fmt: skip
            found = predict_classes(mesh, model, **callbacks)
    except InputError as fault:
        return JobResult(((), Learned(str(fault))))
    few = len(found.probabilities) <= _MOST_PROBABILITIES
    numbers = (*(found.probabilities if few else ()), found.uncertainty)
    smaller = (replace(each, values=each.values.astype(np.float32)) for each in numbers)
    said = _described(model) if scored else "Press Classify for scores."
    learned = Learned(" ".join([said, *heard]), labels.name)
    return JobResult(((found.labels, *smaller), learned))


#: Cache of the last computed columns, for repeated training after each brush stroke.
_last: dict[tuple[str, ClassColumns], Features] = {}


def _described(model: ClassModel) -> str:
    """Return the F1 score of each class in one line, or the reason why there is none."""
    scores = model.scores
    if scores is None:
        return model.unscored
    each = ", ".join(f"{name} {f1:.2f}" for name, f1 in zip(model.names, scores.f1, strict=True))
    return f"F1 on {scores.left_out} left out: {each}; by area {scores.weighted_f1:.2f}."


#: Label set and options of a training.
_Source: TypeAlias = tuple[VertexMap, ClassOptions]


class Classes:
    """Classification trained on the current label set, on request or after each change of the set.

    The maps of a prediction replace the maps of the previous prediction. A requested prediction is
    a step of the history; a live prediction is part of the step that changed the labels.
    """

    changed = Signal()

    def __init__(
        self,
        opened: OpenMesh,
        maps: Maps,
        labels: Labels,
        work: Work,
        notices: Notices,
        history: History,
    ) -> None:
        self._opened, self._maps, self._labels = opened, maps, labels
        self._work, self._notices = work, notices
        self._options, self._live = ClassOptions(), False
        self._history = history
        history.keep("classes", lambda: (self._options, self._live), self._put)
        history.started.connect(self.restore)
        #: By predicted set: its scores, and the source of its training; None if that is not known.
        self._known: WeakKeyDictionary[VertexMap, tuple[Learned, _Source | None]]
        self._known = WeakKeyDictionary()
        #: Scores read from a session before the predicted maps are restored, and whether they were
        #: out of date.
        self._awaiting: tuple[Learned, bool] | None = None
        #: Labels and options of the last request.
        self._requested: _Source | None = None
        #: Label set for which training failed, and the reason.
        self._refused: tuple[VertexMap, str] | None = None
        labels.source_of = self._source_of
        for signal in (opened.spectrum_changed, labels.changed):
            signal.connect(self._follow)

    @property
    def options(self) -> ClassOptions:
        """Options of the training."""
        return self._options

    @options.setter
    def options(self, options: ClassOptions) -> None:
        self._change("options of the classes", options, self._live)

    @property
    def live(self) -> bool:
        """Whether to train again after each change of the labels."""
        return self._live

    @live.setter
    def live(self, live: bool) -> None:
        if live:
            self._awaiting = None  # the user asks for a prediction from the current labels
        self._change("live classification", self._options, live)

    def _change(self, label: str, options: ClassOptions, live: bool) -> None:
        before = self._options, self._live
        if before != (options, live):
            self._history.record(label, before={"classes": before})
        self._put((options, live))

    def _put(self, state: tuple[ClassOptions, bool]) -> None:
        self._options, self._live = state
        self._follow()
        self.changed.emit()

    @property
    def _taught(self) -> VertexMap | None:
        """The set to learn from: the current set, or that from which it was predicted."""
        known = self._labels.current
        if known is None or not self._labels.is_predicted(known):
            return known
        others = (each for each in self._labels.sets if not self._labels.is_predicted(each))
        return self._source_of(known) or next(others, None)

    def _source_of(self, predicted: VertexMap) -> VertexMap | None:
        learned, _ = self._known.get(predicted, (None, None))
        return next(
            (each for each in self._labels.sets if learned and each.name == learned.labels), None
        )

    @property
    def missing(self) -> str:
        """Sentence on the missing input of a training on the current labels; "" for none."""
        known, spectrum = self._taught, self._opened.spectrum
        if known is None:
            return "There is no label set to learn from: press New set, and label some vertices."
        if spectrum is None or not spectrum.complete:
            return "Classes are learned from eigenpairs: compute them in the Mesh panel first."
        if not self._options.kinds:
            return "No features are chosen: choose HKS, WKS or curvature."
        return ""

    @property
    def said(self) -> str:
        """Scores of the prediction, or the reason why there is none, in one line."""
        if self._refused is not None and self._refused[0] is self._taught:
            return self._refused[1]
        if self.learned is None:
            return ""
        return self.learned.said + (_OUTDATED if self.outdated else "")

    @property
    def outdated(self) -> bool:
        """Whether the prediction was learned from other labels or options than the current ones."""
        known, predicted = self._taught, self._labels.predicted
        if predicted is None:
            return False
        return self._last[1] != (known, self._options)

    @property
    def learned(self) -> Learned | None:
        """Scores of the prediction; None without a prediction."""
        return self._last[0]

    @property
    def _last(self) -> tuple[Learned | None, _Source | None]:
        """Scores of the last prediction, and the source of its training; None if unknown."""
        predicted = self._labels.predicted
        return (None, None) if predicted is None else self._known.get(predicted, (None, None))

    @property
    def runs(self) -> bool:
        """Whether a prediction is being computed."""
        running = self._work.job
        return running is not None and running.doing == _CLASSIFYING

    def plain(self) -> dict[str, Any]:
        """Return options and scores as values for JSON."""
        saved = SavedClasses(**vars(self._options), live=self._live, outdated=self.outdated,
                             learned=self.learned)  # fmt: skip
        plain: dict[str, Any] = msgspec.to_builtins(saved)
        return plain

    def restore(self, saved: SavedClasses = SavedClasses()) -> None:
        """Restore a result of `read_saved_classes`."""
        self._options = ClassOptions(saved.kinds, saved.classifier, saved.smoothing)
        self._live, self._refused = saved.live, None
        self._awaiting = None if saved.learned is None else (saved.learned, saved.outdated)
        self.changed.emit()

    def classify(self) -> None:
        """Request a prediction from the current labels."""
        if self.missing:
            self._notices.say(self.missing, Severity.WARNING)
        else:
            self._request(live=False)

    def show_uncertainty(self) -> None:
        """Display the uncertainty of the prediction."""
        for name in self._own:
            if name.startswith("uncertainty"):
                self._maps.show(name)

    def _accept(
        self,
        labels: VertexMap,
        options: ClassOptions,
        live: bool,
        found: tuple[Sequence[VertexMap], Learned],
    ) -> None:
        """Add the maps of a result, unless it is live and the labels have changed since."""
        if live and labels is not self._taught:
            return
        maps, learned = found
        self._refused = self._awaiting = None
        if maps:
            own, displayed = self._own, self._maps.displayed
            self._maps.exchange("" if live else "classes", own, maps)
            predicted = self._labels.predicted
            assert predicted is not None
            self._known[predicted] = learned, (labels, options)
            if not live and displayed not in self._own:
                self._maps.show(predicted.name)
        else:
            self._refused = labels, learned.said
            if not live:
                self._notices.say(learned.said, Severity.WARNING)
        self.changed.emit()

    @property
    def _own(self) -> Sequence[str]:
        """Names of the maps of the last prediction, in the order of the mesh."""
        predicted, mesh = self._labels.predicted, self._opened.mesh
        if predicted is None or mesh is None:
            return []
        made = (each.name for each in mesh.maps if self._maps.is_made_here(each))
        return [name for name in made if name == predicted.name or _PROBABILITY.fullmatch(name)]

    def _follow(self) -> None:
        """Request a live prediction, once for each change of labels or options."""
        self._recall()
        known, predicted = self._taught, self._labels.predicted
        up_to_date = predicted is not None and not self.outdated
        if not self._live or known is None or self._awaiting is not None or up_to_date:
            return
        if self._requested != (known, self._options) and not self.missing:
            self._request(live=True)

    def _recall(self) -> None:
        """Assign the scores of a session to the prediction, once its maps are restored."""
        predicted = self._labels.predicted
        if self._awaiting is not None and predicted is not None:
            learned, outdated = self._awaiting
            sources = [(each, self._options) for each in self._labels.sets
                       if each.name == learned.labels]  # fmt: skip
            self._known[predicted] = learned, sources[0] if sources and not outdated else None
            self._awaiting = None if sources else self._awaiting
            self.changed.emit()

    def _request(self, *, live: bool) -> None:
        solved, labels, spectrum = self._opened.solved, self._taught, self._opened.spectrum
        assert solved is not None
        assert labels is not None
        assert spectrum is not None
        mesh = solved.mesh.with_only_maps()  # the worker needs no maps
        self._requested = labels, self._options
        self._work.request(
            Job(
                _CLASSIFYING,
                mesh.name,
                partial(classify, mesh, labels, spectrum, self._options, live),
                partial(self._accept, labels, self._options, live),
                queueing=Queueing.NEWEST,
                needed=partial(self._opened.is_solved, mesh),
            )
        )

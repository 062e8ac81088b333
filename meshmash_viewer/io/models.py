"""Files of class models: skops archives, without pickled objects, with a JSON description."""

from __future__ import annotations

import datetime
import json
import math
import zipfile
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError, printable, require, unknown_ending
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.read import check_file
from meshmash_viewer.learn import KINDS
from meshmash_viewer.learn.classes import ClassModel
from meshmash_viewer.learn.columns import ClassColumns
from meshmash_viewer.learn.training import ClassScores
from meshmash_viewer.vertex_map import Label

#: Ending of the files.
MODEL_ENDING = ".skops"
#: Name and format version of the card, a description of the model as JSON in the archive.
_CARD, _FORMAT = "meshmash-viewer.json", 1
#: Largest size of the unpacked archive, and of the card, in bytes.
_LARGEST, _LARGEST_CARD = 2_000_000_000, 50_000_000
#: Type that skops does not trust by default; indices in its trees are checked before use.
_CHECKED = "sklearn.tree._tree.Tree"
_VERSIONS = ("scikit-learn", "skops", "numpy")


def check_model_path(path: str | Path) -> None:
    """Raise `InputError` if a path is not a possible file of a model."""
    require("Files of models need", "learn", "skops", "sklearn")
    path = Path(path)
    if path.suffix.lower() != MODEL_ENDING:
        raise unknown_ending(path, [MODEL_ENDING])
    if not path.parent.is_dir():
        fault = f"There is no folder {path.parent}"
        raise InputError("folder-not-found", fault, "make it, or name another one")


def write_classes(path: str | Path, model: ClassModel) -> None:
    """Write a class model and its card into a skops file.

    The card, ``meshmash-viewer.json`` in the archive (`unzip -p model.skops
    meshmash-viewer.json`), describes columns with their unit, operator and transformation, classes
    with colours, training meshes by content hash, scores, and versions.

    `InputError` is raised if the ending of the path is not .skops, skops is not installed, or the
    file cannot be written.

    Examples
    --------
    >>> model = mv.train_classes(pill, parts)
    >>> mv.write_classes(folder / "parts.skops", model)
    >>> mv.read_classes(folder / "parts.skops").names
    ('cap', 'side')
    """
    check_model_path(path)
    from skops import io

    card = json.dumps(model_card(model), indent=1, ensure_ascii=False)
    with writing_errors(Path(path)), written_whole(Path(path)) as part:
        io.dump(model.classifier, part, compression=zipfile.ZIP_DEFLATED)
        with zipfile.ZipFile(part, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(_CARD, card)


def model_card(model: ClassModel) -> dict[str, Any]:
    """Return the description of a model as a dictionary for JSON."""
    columns = model.columns
    return {
        "format": _FORMAT,
        "program": f"meshmash-viewer {metadata.version('meshmash-viewer')}",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "classifier": model.kind,
        "columns": columns.plain(),
        "column_names": list(columns.names),
        "transformation": {kind: KINDS[kind] for kind in columns.kinds},
        "smoothing": model.smoothing,
        "classes": [
            {"key": each.key, "name": each.name, "color": each.color} for each in model.classes
        ],
        "importance": model.importance.tolist(),
        "meshes": list(model.meshes),
        "scores": None if model.scores is None else model.scores.plain(),
        "unscored": model.unscored,
        "about": model.about,
        "versions": {name: metadata.version(name) for name in _VERSIONS},
    }


def read_classes(path: str | Path) -> ClassModel:
    """Read a class model from a skops file, without running code from the file.

    `InputError` is raised if the file is no class model, has another version of the format or of
    scikit-learn, or contains a type that its classifier does not need; the message names the type.

    Examples
    --------
    >>> _ = (folder / "other.skops").write_text("no model")
    >>> try:
    ...     mv.read_classes(folder / "other.skops")
    ... except mv.InputError as error:
    ...     print(str(error).partition("other.skops ")[2])
    is no model of classes: choose one that `train` has written.
    """
    path = Path(path)
    require("Files of models need", "learn", "skops", "sklearn")
    check_file(path)
    card = _card(path)
    _check_versions(path, card)
    from skops import io

    try:
        unknown = sorted(set(io.get_untrusted_types(file=path)) - {_CHECKED})
        model = None if unknown else _model(path, card)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, OSError) as fault:
        what = f"{path} is a damaged model ({printable(fault)})"
        raise InputError("file-damaged", what, "copy it again, or train another one") from fault
    if model is None:
        raise InputError(
            "untrusted-content",
            f"{path} holds {printable(', '.join(unknown))}, which is no part of a model of classes,"
            " and is not loaded",
            "get it from a source that you trust, or train it again",
        )
    return model


def _card(path: Path) -> dict[str, Any]:
    """Return the card of a file, after a check of the unpacked size."""
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {each.filename: each.file_size for each in archive.infolist()}
            if sum(sizes.values()) > _LARGEST or sizes.get(_CARD, 0) > _LARGEST_CARD:
                what = f"{path} unpacks to more than a model can have"
                raise InputError("too-large", what, "train it again")
            card = json.loads(archive.read(_CARD))
    except InputError:
        raise
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, NotImplementedError) as fault:
        what = f"{path} is no model of classes"
        raise InputError("wrong-format", what, "choose one that `train` has written") from fault
    return card if isinstance(card, dict) else {}


def _check_versions(path: Path, card: dict[str, Any]) -> None:
    if card.get("format") != _FORMAT:
        raise InputError(
            "wrong-version",
            f"{path} has version {printable(card.get('format'), 20)} of the format of models, and"
            f" this program reads {_FORMAT}",
            "train it again, or use the program that wrote it",
        )
    versions = card.get("versions")
    written = str(versions.get("scikit-learn")) if isinstance(versions, dict) else "unknown"
    here = metadata.version("scikit-learn")
    if written.split(".")[:2] != here.split(".")[:2]:
        raise InputError(
            "wrong-version",
            f"{path} was trained with scikit-learn {printable(written, 20)}, and {here} is"
            " installed, which may give other results",
            "train it again, or install that version",
        )


def _model(path: Path, card: dict[str, Any]) -> ClassModel:
    columns = ClassColumns.from_plain(card["columns"])
    classes = tuple(Label(int(each["key"]), str(each["name"]), str(each["color"]))
                    for each in card["classes"])  # fmt: skip
    kind, names, scores = str(card["classifier"]), list(columns.names), card["scores"]
    importance = np.array(card["importance"], dtype=np.float64)
    if names != card["column_names"] or len(importance) != len(names):
        raise ValueError("its columns do not agree")
    classifier = _classifier(path, kind, len(names), len(classes))
    meshes = tuple(dict(each) for each in card["meshes"])
    if not all(0.0 < each.get("median_edge", 1.0) < math.inf for each in meshes):
        raise ValueError("its meshes have impossible edges")
    return ClassModel(
        classifier, kind, columns, classes, importance, float(card["smoothing"]), meshes,
        None if scores is None else ClassScores.from_plain(scores), str(card["unscored"]),
        dict(card["about"]),
    )  # fmt: skip


def _classifier(path: Path, kind: str, n_columns: int, n_classes: int) -> Any:
    """Load the classifier, and check its indices, which its compiled code does not check."""
    from skops import io

    loaded = io.load(path, trusted=[_CHECKED])
    if not _is_of_kind(loaded, kind, n_columns, n_classes):
        raise ValueError(f"not a classifier of kind {kind}")
    if loaded.predict_proba(np.zeros((1, n_columns))).shape != (1, n_classes):
        raise ValueError("other classes than the card has")
    if not np.array_equal(loaded.classes_, np.arange(n_classes)):
        raise ValueError("classes in another order than the card has")
    return loaded


def _is_of_kind(loaded: Any, kind: str, n_columns: int, n_classes: int) -> bool:
    from sklearn.ensemble import ExtraTreesClassifier, VotingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import Pipeline
    from sklearn.preprocessing import StandardScaler

    if kind == "ensemble" and type(loaded) is VotingClassifier and loaded.voting == "soft":
        parts = zip(loaded.estimators_, ("forest", "logistic"), strict=True)
        return all(_is_of_kind(*each, n_columns, n_classes) for each in parts)
    if kind == "forest":
        return type(loaded) is ExtraTreesClassifier and all(
            _is_sound(each.tree_, n_columns, n_classes) for each in loaded.estimators_
        )
    if kind == "logistic" and type(loaded) is Pipeline:
        return [type(each) for _, each in loaded.steps] == [StandardScaler, LogisticRegression]
    return False


def _is_sound(tree: Any, n_columns: int, n_classes: int) -> bool:
    """Whether indices in a tree are in range, and each child comes after its parent (no cycle)."""
    nodes = tree.__getstate__()["nodes"]
    places = np.arange(len(nodes))
    left, right = nodes["left_child"], nodes["right_child"]
    inner = (left != -1) | (right != -1)
    within = (left > places) & (right > places) & (left < len(nodes)) & (right < len(nodes))
    known = (nodes["feature"] >= 0) & (nodes["feature"] < n_columns)
    shapes = tree.n_features, tree.value.shape
    sound = (within & known)[inner].all() and shapes == (n_columns, (len(nodes), 1, n_classes))
    return bool(len(nodes) > 0 and sound)

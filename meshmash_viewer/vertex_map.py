"""Vertex maps: values of the user at every vertex, such as a thickness or a parcellation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from itertools import chain, count, cycle
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import exact_array
from meshmash_viewer.errors import InputError, printable, wrong_type
from meshmash_viewer.units import counted

#: Maximum number of labels of a map, the size of the colour table.
MOST_LABELS = 512
#: Default colours of labels.
LABEL_COLORS = ("#4477aa", "#ccbb44", "#228833", "#ee6677", "#66ccee", "#aa3377", "#ee7733",
                "#999933", "#88ccee", "#332288", "#ddcc77", "#117733")  # fmt: skip
COLOR = re.compile("#[0-9a-fA-F]{6}")
#: Largest range of label numbers for which a lookup table is used.
_TABLE = 2**16
#: Label numbers below this are stored as int32, since undo keeps a copy of them for each stroke.
_SMALL = 2**30
#: Integers up to this are float64 numbers.
_EXACT = 2**53
#: Maximum number of characters of a name.
_LONGEST = 100
#: Maximum number of labels that a message lists.
_NAMED = 12
#: Values below this share of the largest magnitude are ignored; values are signed if more than this
#: share of the others lies on each side of zero.
_WITHIN = 0.01


@dataclass(frozen=True)
class Label:
    """A label: its number in the values, its name, and its colour as "#rrggbb".

    The window does not change vertices of a `locked` label.

    Examples
    --------
    >>> lobes = (mv.Label(1, "frontal", "#4477aa"), mv.Label(2, "parietal", "#ee6677"))
    >>> mv.VertexMap("lobe", np.array([1.0, 1.0, 2.0]), labels=lobes).labels[1].name
    'parietal'
    """

    key: int
    name: str
    color: str
    locked: bool = False


@dataclass(frozen=True, eq=False)
class VertexMap:
    """An immutable map with a value at every vertex.

    `InputError` is raised if the values are text, complex, infinite, all NaN, or not of shape (n,);
    or if there are more than `MOST_LABELS` labels.

    Parameters
    ----------
    name : str
    values : array_like, shape (n,)
        Real numbers, NaN at vertices without a value; with `labels` whole numbers. Stored read-only
        as float32 or float64, with `labels` as int32, or int64 for large numbers.
    labels : tuple of Label
        Labels of the numbers. A vertex whose number has no label, such as 0, has no value. A label
        may have no vertex; of several labels with the same number the first is kept.
    unit : str
        Unit of the values; "" for none, or not stated.
    path : str
        File of the map; "" if it is part of the mesh file, or from a script.

    Examples
    --------
    >>> depth = mv.VertexMap("depth", np.array([-1.0, 0.5, np.nan]), unit="mm")
    >>> depth.signed, depth.range
    (True, (-1.0, 0.5))
    """

    name: str
    values: npt.NDArray[Any]
    labels: tuple[Label, ...] = ()
    unit: str = ""
    path: str = ""

    def __post_init__(self) -> None:
        name = printable(self.name, _LONGEST) or "map"
        object.__setattr__(self, "name", name)
        if wrong := [each for each in self.labels if not isinstance(each, Label)]:
            raise wrong_type(f"Labels of map {name!r}", type(wrong[0]), "a sequence of mv.Label")
        values = _checked(_numbers(self.values, name), name, self.labels)
        first: dict[int, Label] = {}
        for label in self.labels:
            first.setdefault(label.key, label)
        if len(first) > MOST_LABELS:
            fault = f"Map {name!r} has {len(first):,} labels, more than {MOST_LABELS} colours"
            raise InputError("too-many", fault, "join some of them")
        object.__setattr__(self, "labels", tuple(first.values()))
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @property
    def n_vertices(self) -> int:
        """Number of vertices of the mesh."""
        return len(self.values)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return float(np.nanmin(self.values)), float(np.nanmax(self.values))

    @cached_property
    def n_values(self) -> int:
        """Number of vertices that have a value, or a label."""
        return int(np.count_nonzero(~np.isnan(self.shown)))

    @cached_property
    def signed(self) -> bool:
        """Whether values lie on both sides of zero.

        A few negative values, such as those of an interpolated thickness, are ignored.
        """
        if self.labels:
            return False
        bound = _WITHIN * max(abs(each) for each in self.range)
        sides = np.count_nonzero(self.values < -bound), np.count_nonzero(self.values > bound)
        return bool(min(sides) > _WITHIN * sum(sides))

    @cached_property
    def shown(self) -> npt.NDArray[np.float32]:
        """Values for colouring, shape (n,): with labels the index of the label, NaN without one."""
        if not self.labels:
            return np.asarray(self.values, dtype=np.float32)
        keys = np.array([label.key for label in self.labels])
        low, n_keys = int(keys.min()), int(np.ptp(keys)) + 1
        if n_keys <= _TABLE:  # ten times faster; the first and last entry are for other numbers
            table = np.full(n_keys + 2, np.nan, dtype=np.float32)
            table[keys - low + 1] = np.arange(len(keys))
            places = np.clip(self.values, low - 1, low + n_keys) - (low - 1)
            return np.asarray(table[places], dtype=np.float32)
        order = np.argsort(keys)
        places = order[np.minimum(np.searchsorted(keys[order], self.values), len(keys) - 1)]
        known = keys[places] == self.values
        return np.where(known, places, np.nan).astype(np.float32)

    def mask(self, named: str = "") -> npt.NDArray[np.bool_]:
        """Return a mask of the vertices of some labels or, without labels, of nonzero values.

        `named` are names or numbers of labels, separated by commas; "-" before them selects all
        other vertices. It may be "" for a map with at most one label. `InputError` is raised if
        there is no such label, or `named` is "" for several labels.

        Examples
        --------
        >>> lobes = (mv.Label(1, "frontal", "#4477aa"), mv.Label(2, "parietal", "#ee6677"))
        >>> mv.VertexMap("lobe", np.array([1, 2, 0]), labels=lobes).mask("-frontal")
        array([False,  True,  True])
        """
        if not self.labels and not named:
            return np.asarray(np.nan_to_num(self.values) != 0.0)
        if not named and len(self.labels) == 1:
            named = str(self.labels[0].key)
        names = ", ".join(each.name or str(each.key) for each in self.labels[:_NAMED]) or "no label"
        more = ", …" if len(self.labels) > _NAMED else ""
        asked = [one for each in named.removeprefix("-").split(",") if (one := each.strip())]
        if not asked:
            fault = f"Map {self.name!r} has several labels"
            raise InputError("missing-argument", fault, f"name one of {names}{more}")
        keys: list[int] = []
        for one in asked:
            found = [each.key for each in self.labels if one in (each.name, str(each.key))]
            if not found:
                fault = f"Map {self.name!r} has no label {one!r}"
                raise InputError("unknown-name", fault, f"give one of {names}{more}")
            keys += found
        return np.isin(self.values, keys, invert=named.startswith("-"))

    @property
    def marked(self) -> npt.NDArray[np.bool_]:
        """Vertices with a label or, without labels, with a nonzero value, shape (n,)."""
        if not self.labels:
            return self.mask()
        return np.isin(self.values, [each.key for each in self.labels])

    @property
    def no_label(self) -> int:
        """Value of vertices without a label: 0 or, if 0 is a label, -1 and so on."""
        return unused_number(self.labels)

    def at(self, kept: npt.NDArray[Any]) -> VertexMap:
        """Return the map at some of the vertices, given by a mask or indices."""
        return VertexMap(self.name, self.values[kept], self.labels, self.unit, self.path)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes to pickle, without derived arrays."""
        return {name: self.__dict__[name] for name in ("name", "values", "labels", "unit", "path")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.values.flags.writeable = False


def named_apart(maps: Sequence[VertexMap], taken: Sequence[str] = ()) -> tuple[VertexMap, ...]:
    """Return the maps with unique names: a number is appended to names in use."""
    names, result = set(taken), []
    for each in maps:
        numbered = (f"{each.name} {number}" for number in count(2))
        name = next(name for name in chain([each.name], numbered) if name not in names)
        names.add(name)
        result.append(each if name == each.name else replace(each, name=name))
    return tuple(result)


def unused_number(labels: Sequence[Label]) -> int:
    """Return the first of 0, -1, -2, … that is not the number of a label."""
    keys = {label.key for label in labels}
    return next(number for number in count(0, -1) if number not in keys)


def numbered_labels(numbers: npt.NDArray[Any]) -> tuple[Label, ...]:
    """Return a label for each whole number but 0 among values of vertices, named by its number."""
    used = [int(number) for number in np.unique(numbers) if number != 0]
    colored = zip(used, cycle(LABEL_COLORS), strict=False)
    return tuple(Label(number, str(number), color) for number, color in colored)


def labels_in_use(labels: Sequence[Label], values: npt.NDArray[Any]) -> tuple[Label, ...]:
    """Return the labels that occur among values of vertices."""
    used = set(np.unique(values).tolist())
    return tuple(label for label in labels if label.key in used)


def _numbers(given: Any, name: str) -> npt.NDArray[Any]:
    """Convert values to an array, objects that are numbers or missing to float64."""
    values = exact_array(given)
    known = [each for each in values.flat if each is not None] if values.dtype == object else []
    if not known or not all(isinstance(each, (Real, Decimal)) for each in known):
        return values
    _check_exact([each for each in known if isinstance(each, int)], name)
    return values.astype(np.float64)


def _check_exact(integers: npt.ArrayLike, name: str) -> None:
    """Raise `InputError` if float64 would round an integer, such as an identifier."""
    found = np.asarray(integers)
    largest = max(int(found.max()), -int(found.min())) if found.size else 0
    if largest > _EXACT:
        fault = f"Map {name!r} has the whole number {largest}, which would be rounded"
        remedy = "give labels, or number them with np.unique(values, return_inverse=True)[1]"
        raise InputError("not-exact", fault, remedy)


def _checked(values: npt.NDArray[Any], name: str, labels: Sequence[Label]) -> npt.NDArray[Any]:
    """Return values in the type to be stored; raise `InputError` if they are invalid."""
    if values.dtype.kind not in "fiub":
        raise InputError("wrong-type", f"Map {name!r} has type {values.dtype}", "give real numbers")
    if values.ndim != 1 or not len(values):
        fault = f"Map {name!r} has shape {values.shape}"
        raise InputError("wrong-shape", fault, "give one number per vertex")
    if labels:
        if values.dtype.kind == "f" and not np.array_equal(values, np.rint(values)):
            raise InputError("not-labels", f"Map {name!r} has labels that are no whole numbers")
        # a read-only array, such as that of another map, is shared
        keys = [label.key for label in labels]
        largest = max(abs(int(each)) for each in (values.min(), values.max(), min(keys), max(keys)))
        kind = np.dtype(np.int32 if largest < _SMALL else np.int64)
        shared = values.dtype == kind and values.flags.owndata and not values.flags.writeable
        return values if shared else values.astype(kind)
    if values.dtype.kind in "iu":
        _check_exact(values, name)
    kept = values.astype(values.dtype if values.dtype.name == "float32" else np.float64)
    infinite = np.flatnonzero(np.isinf(kept))
    if len(infinite):
        count = counted(len(infinite), "infinite value")
        fault = f"Map {name!r} has {count}, the first at vertex {infinite[0]}"
        raise InputError("not-finite", fault, "put NaN where there is no value")
    if np.isnan(kept).all():
        raise InputError("no-values", f"Map {name!r} has no value at any vertex, all are NaN")
    return kept

"""Maps: a value at every vertex given by the user, such as a thickness or a parcellation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.units import counted

#: Most labels of a map, as the colour table of the surface has that many entries.
MOST_LABELS = 512
#: Colours of labels that have none of their own.
LABEL_COLORS = ("#4477aa", "#ccbb44", "#228833", "#ee6677", "#66ccee", "#aa3377", "#ee7733",
                "#999933", "#88ccee", "#332288", "#ddcc77", "#117733")  # fmt: skip
#: A colour of a label.
COLOR = re.compile("#[0-9a-fA-F]{6}")
#: Largest range of numbers of labels for which a table of all of them is made.
_TABLE = 2**16
#: Numbers of labels below this are kept with four bytes, as each stroke of a brush keeps them all.
_SMALL = 2**30
#: Characters of a name.
_LONGEST = 100
#: Labels that a message names.
_NAMED = 12
#: Share of the largest magnitude that signed values pass on both sides of zero, at this share of
#: the vertices where they pass it.
_WITHIN = 0.01


@dataclass(frozen=True)
class Label:
    """A part of a surface: its number in the values, its name, its colour as "#rrggbb".

    The window gives no vertex of a `locked` one to another label.

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
    """A value at every vertex; none of it is changed after construction.

    `InputError` is raised if the values are text, complex, infinite, none at all, or not one a
    vertex; or if there are more than `MOST_LABELS` labels.

    Parameters
    ----------
    name : str
        Name of the map.
    values : array_like, shape (n,)
        Real numbers, or with `labels` whole ones. NaN where a vertex has none. Kept as float32 or
        float64, with `labels` as int32, or int64 where a number needs that, and read-only.
    labels : tuple of Label
        Names of the numbers, if these are labels of parts of the surface. A vertex whose number
        has no label, such as 0, has no value. There may be labels without a vertex; repeated ones
        of a number are removed.
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
        values = _checked(np.asarray(self.values), name, self.labels)
        if self.labels:
            first: dict[int, Label] = {}
            for label in self.labels:
                first.setdefault(label.key, label)
            labels = tuple(first.values())
            if len(labels) > MOST_LABELS:
                raise InputError(
                    f"Map {name!r} has {len(labels):,} labels, and {MOST_LABELS} can be"
                    " distinguished by colour: join some of them."
                )
            object.__setattr__(self, "labels", labels)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @property
    def n_vertices(self) -> int:
        """Number of vertices that it is for."""
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
        """Whether zero is within the values rather than at their end.

        A few values below zero, such as those of an interpolated thickness, are at their end.
        """
        if self.labels:
            return False
        bound = _WITHIN * max(abs(each) for each in self.range)
        sides = np.count_nonzero(self.values < -bound), np.count_nonzero(self.values > bound)
        return bool(min(sides) > _WITHIN * sum(sides))

    @cached_property
    def shown(self) -> npt.NDArray[np.float32]:
        """Values to be coloured, shape (n,): of labels the place among them, NaN without one."""
        if not self.labels:
            return np.asarray(self.values, dtype=np.float32)
        keys = np.array([label.key for label in self.labels])
        low, n_keys = int(keys.min()), int(np.ptp(keys)) + 1
        if n_keys <= _TABLE:  # ten times faster, with a place for what is below and one for above
            table = np.full(n_keys + 2, np.nan, dtype=np.float32)
            table[keys - low + 1] = np.arange(len(keys))
            places = np.clip(self.values, low - 1, low + n_keys) - (low - 1)
            return np.asarray(table[places], dtype=np.float32)
        order = np.argsort(keys)
        places = order[np.minimum(np.searchsorted(keys[order], self.values), len(keys) - 1)]
        known = keys[places] == self.values
        return np.where(known, places, np.nan).astype(np.float32)

    def mask(self, named: str = "") -> npt.NDArray[np.bool_]:
        """Return which vertices have one of some labels, or without labels a value but zero.

        `InputError` is raised if there is no such label, or one has to be named.

        Parameters
        ----------
        named : str
            Names or numbers of labels, separated by commas; after "-" all other vertices. May be ""
            for a map of one label, and of values.

        Returns
        -------
        ndarray of bool, shape (n,)

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
        inside = np.zeros(self.n_vertices, dtype=np.bool_)
        asked = [one for each in named.removeprefix("-").split(",") if (one := each.strip())]
        for one in asked:
            keys = [each.key for each in self.labels if one in (each.name, str(each.key))]
            if not keys:
                raise InputError(f"Map {self.name!r} has no label {one!r}: it has {names}{more}.")
            inside |= np.isin(self.values, keys)
        if not asked:
            raise InputError(f"Map {self.name!r} has several labels, name one: {names}{more}.")
        return np.asarray(~inside if named.startswith("-") else inside)

    @property
    def no_label(self) -> int:
        """The number of vertices without a label: 0, or where that is a label, -1 and so on."""
        return unused_number(self.labels)

    def at(self, kept: npt.NDArray[Any]) -> VertexMap:
        """The same for some of the vertices, by a mask or indices."""
        return VertexMap(self.name, self.values[kept], self.labels, self.unit, self.path)

    def __getstate__(self) -> dict[str, Any]:
        """What goes to another process."""
        return {name: self.__dict__[name] for name in ("name", "values", "labels", "unit", "path")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.values.flags.writeable = False


def named_apart(maps: Sequence[VertexMap], taken: Sequence[str] = ()) -> tuple[VertexMap, ...]:
    """The maps, those whose name is taken with a number after it."""
    names, result = set(taken), []
    for each in maps:
        name, number = each.name, 2
        while name in names:
            name, number = f"{each.name} {number}", number + 1
        names.add(name)
        if name != each.name:
            each = VertexMap(name, each.values, each.labels, each.unit, each.path)
        result.append(each)
    return tuple(result)


def unused_number(labels: Sequence[Label]) -> int:
    """Return the first of 0, -1 and so on that no label has."""
    keys = {label.key for label in labels}
    return next(number for number in count(0, -1) if number not in keys)


def numbered_labels(numbers: npt.NDArray[Any]) -> tuple[Label, ...]:
    """Return labels for the whole numbers of vertices, named after these; 0 is no label."""
    used = [int(number) for number in np.unique(numbers) if number != 0]
    n_colors = len(LABEL_COLORS)
    return tuple(
        Label(number, str(number), LABEL_COLORS[at % n_colors]) for at, number in enumerate(used)
    )


def labels_in_use(labels: Sequence[Label], values: npt.NDArray[Any]) -> tuple[Label, ...]:
    """Return the labels that some vertex has, as tables of files have many others."""
    used = set(np.unique(values).tolist())
    return tuple(label for label in labels if label.key in used)


def _checked(values: npt.NDArray[Any], name: str, labels: Sequence[Label]) -> npt.NDArray[Any]:
    """The values in a type that is kept."""
    if values.dtype.kind == "c":
        raise InputError(
            f"Map {name!r} has complex numbers: give real ones, such as their absolute values."
        )
    if values.dtype.kind not in "fiub":
        raise InputError(f"Map {name!r} has text where numbers should be: leave it out.")
    if values.ndim != 1 or not len(values):
        raise InputError(f"Map {name!r} has shape {values.shape}: give one number a vertex.")
    if labels:
        if values.dtype.kind == "f" and not np.array_equal(values, np.rint(values)):
            raise InputError(f"Map {name!r} has labels that are no whole numbers: export it again.")
        # an array of another map, with other names, is shared
        keys = [label.key for label in labels]
        largest = max(abs(int(each)) for each in (values.min(), values.max(), min(keys), max(keys)))
        kind = np.dtype(np.int32 if largest < _SMALL else np.int64)
        shared = values.dtype == kind and values.flags.owndata and not values.flags.writeable
        return values if shared else values.astype(kind)
    kept = values.astype(values.dtype if values.dtype.name == "float32" else np.float64)
    infinite = np.flatnonzero(np.isinf(kept))
    if len(infinite):
        raise InputError(
            f"Map {name!r} has {counted(len(infinite), 'infinite value')}, the first at vertex"
            f" {infinite[0]}: put NaN where there is no value."
        )
    if np.isnan(kept).all():
        raise InputError(f"Map {name!r} has no value at any vertex, all are NaN: export it again.")
    return kept

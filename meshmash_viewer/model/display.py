"""Display state (displayed family, parameters of all families, colours) and its JSON format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from psygnal import SignalGroupDescriptor

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.parameter import (
    Choice,
    Flag,
    Listing,
    Number,
    Parameters,
    Record,
    Whole,
    checked_entry,
    in_order,
    parameter,
)
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)
from meshmash_viewer.surface.rays import Plane

Chosen = TypeVar("Chosen", bound=Family)
_T = TypeVar("_T")

#: Fewest pairs of a rebuilt shape: the constant, and three to span a volume.
FEWEST_PAIRS = 4
#: Largest amplitude, as a share of the diagonal of the mesh's bounding box.
MOST_AMPLITUDE = 0.2
_POLICIES: dict[str, type[Any]] = {
    policy.__name__: policy
    for policy in (SymmetricLimits, MinMaxLimits, PercentileLimits, LockedLimits)
}


@dataclass(frozen=True)
class Shape(Parameters):
    """Displacement of the displayed mesh: none, or rebuilt from its lowest eigenpairs."""

    #: Whether the vertices are rebuilt from eigenfunctions.
    shown: bool = parameter(False, Flag())
    #: Number of lowest pairs; at least `FEWEST_PAIRS`.
    pairs: int = parameter(50, Whole(FEWEST_PAIRS))
    #: Interpolation between the mesh (0) and the rebuilt shape (1).
    morph: float = parameter(1.0, Number(0.0, 1.0))
    #: Amplitude of the vibration as a share of the diagonal of the mesh's bounding box, from 0 to
    #: `MOST_AMPLITUDE`.
    amplitude: float = parameter(0.05, Number(0.0, MOST_AMPLITUDE))

    def within(self, n_pairs: int) -> int:
        """Return the number of pairs to use if `n_pairs` are available."""
        return min(max(self.pairs, FEWEST_PAIRS), n_pairs)


@dataclass(frozen=True)
class Cut(Parameters):
    """Clipping plane relative to the bounding box, and so independent of the unit."""

    #: Whether the mesh is cut at the plane.
    shown: bool = parameter(False, Flag())
    #: Unit vector towards the visible side; zero if there is no plane.
    normal: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), Listing(Number(-1.0, 1.0), 3, 3, tuple)
    )
    #: Distance of the plane from the centre of the bounding box along the normal, in units of half
    #: its diagonal.
    offset: float = parameter(0.0, Number(-1.0, 1.0))

    @property
    def placed(self) -> bool:
        """Whether there is a plane."""
        return any(self.normal)

    def plane(self, bounds: FloatArray) -> Plane | None:
        """Return the plane for a mesh with bounds of shape (2, 3); None if the mesh is not cut."""
        if not (self.shown and self.placed):
            return None
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        half = 0.5 * float(np.linalg.norm(np.ptp(bounds, axis=0)))
        return Plane(normal, float(normal @ bounds.mean(axis=0)) + self.offset * half)

    @classmethod
    def at(cls, plane: Plane, bounds: FloatArray) -> Cut:
        """Return the cut at a plane, the inverse of `Cut.plane`; `bounds` has shape (2, 3)."""
        half = 0.5 * float(np.linalg.norm(np.ptp(bounds, axis=0))) or 1.0
        offset = (plane.level - float(plane.normal @ bounds.mean(axis=0))) / half
        x, y, z = np.clip(plane.normal, -1.0, 1.0).tolist()
        return cls(True, (x, y, z), float(np.clip(offset, -1.0, 1.0)))


@dataclass
class Display:
    """Options of the render; every change of an attribute emits ``events.<name>``."""

    events: ClassVar[SignalGroupDescriptor] = SignalGroupDescriptor()

    #: Name of the displayed family.
    kind: str = next(iter(FAMILIES))
    #: The parameters of every family, by name; replaced as a whole, see `put`.
    fields: Mapping[str, Family] = field(
        default_factory=lambda: {name: family() for name, family in FAMILIES.items()}
    )
    #: Whether the position of the field advances automatically.
    playing: bool = False
    nodal_lines: bool = False
    #: Whether the borders between labels are drawn over every field.
    label_borders: bool = False
    #: Whether lines connect the regions of labels that touch.
    label_graph: bool = False
    #: Colour map names (matplotlib's) for signed and for non-negative fields.
    diverging_colormap: str = "RdBu_r"
    sequential_colormap: str = "viridis"
    #: Policies of the colour limits by `Family.limits_key`; the default is `automatic_limits`.
    policies: Mapping[str, LimitPolicy] = field(default_factory=dict)
    #: Whether colours follow the logarithm of the values, by `Family.limits_key`; the default is
    #: `limits.spans_decades`.
    log_scales: Mapping[str, bool] = field(default_factory=dict)
    #: Whether `Mesh.small_components` are hidden.
    hide_small: bool = False
    cut: Cut = field(default_factory=Cut)
    shape: Shape = field(default_factory=Shape)
    #: Whether vertices oscillate along their normals by the displayed field.
    vibrating: bool = False

    def __getitem__(self, family: type[Chosen]) -> Chosen:
        """Return the parameters of one family."""
        chosen = self.fields[family.name]
        assert isinstance(chosen, family)
        return chosen

    @property
    def family(self) -> Family:
        """The parameters of the displayed family."""
        return self.fields[self.kind]

    @property
    def profile_family(self) -> Family:
        """The family of the profiles: the displayed family, its `basis`, or the first family."""
        family = self.family
        if family.export and type(family).profile is not Family.profile:
            return family
        return self.fields[getattr(family, "basis", next(iter(self.fields)))]

    @property
    def response_family(self) -> Family | None:
        """The family whose response is plotted: the displayed family, `profile_family`, or None."""
        both = (self.family, self.profile_family)
        return next((each for each in both if type(each).response is not Family.response), None)

    def put(self, *families: Family) -> None:
        """Replace the parameters of some families."""
        self.fields = {**self.fields, **{family.name: family for family in families}}

    def change(self, family: type[Family], **parameters: Any) -> None:
        """Change some parameters of a family."""
        self.put(replace(self.fields[family.name], **parameters))

    def show(self, family: Family) -> None:
        """Replace the parameters of a family, and display it."""
        self.put(family)
        self.kind = family.name

    @property
    def limits(self) -> LimitPolicy | None:
        """Policy of the limits of the displayed family; None for `automatic_limits`."""
        return self.policies.get(self.family.limits_key)

    def set_limits(self, policy: LimitPolicy | None, key: str = "") -> None:
        """Set or remove (None) the policy of a limits key, by default of the displayed family."""
        self.policies = _with(self.policies, key or self.family.limits_key, policy)

    def set_log_scale(self, logarithmic: bool | None, key: str = "") -> None:
        """Set whether a limits key has a log scale; None if `spans_decades` decides."""
        self.log_scales = _with(self.log_scales, key or self.family.limits_key, logarithmic)


def _with(chosen: Mapping[str, _T], key: str, value: _T | None) -> Mapping[str, _T]:
    """Return a copy in which a key has another value, or is removed (None)."""
    others = {each: known for each, known in chosen.items() if each != key}
    return others if value is None else {**others, key: value}


# -- as JSON, for session files -----------------------------------------------------------------


def display_to_json(display: Display, index: Callable[[int], int] = int) -> dict[str, Any]:
    """Convert the display to JSON; `index` maps a vertex to the written index."""
    return {
        **{name: getattr(display, name) for name in _PLAIN},
        "fields": {
            name: family.at_vertices(index).plain() for name, family in display.fields.items()
        },
        "policies": {
            name: {"policy": type(policy).__name__, **vars(policy)}
            for name, policy in display.policies.items()
        },
        "cut": display.cut.plain(),
        "shape": display.shape.plain(),
    }


def read_display(content: object, path: Path) -> dict[str, Any]:
    """Check the display in a session file, and return its attributes.

    `InputError` is raised if a value has a wrong type, is out of bounds, or contradicts another.
    """
    taken: dict[str, Any] = checked_entry(_DISPLAY, content, path, "display")
    return taken


def display_from_json(
    display: Display, content: dict[str, Any], vertex: Callable[[int], int | None] = int
) -> list[tuple[str, int]]:
    """Set the attributes that `read_display` returned.

    `vertex` maps a written index to a vertex, or to None if the vertex was removed. Return the
    attribute paths and written indices of removed vertices; these attributes become None.
    """
    lost = []
    for name, chosen in content.get("fields", {}).items():
        read = replace(display.fields[name], **chosen)
        placed = read.at_vertices(vertex)
        display.put(placed)
        for each in (each for each, about in read.declared().items() if about.vertex):
            if getattr(placed, each) is None and getattr(read, each) is not None:
                lost.append((f"fields.{name}.{each}", getattr(read, each)))
    for name in ("shape", "cut"):
        if name in content:
            setattr(display, name, replace(getattr(display, name), **content[name]))
    for name in ("policies", *reversed(_PLAIN)):  # "kind" last: it depends on others
        if name in content:
            setattr(display, name, content[name])
    return lost


def _policy(value: object) -> LimitPolicy:
    name = Record({"policy": Choice(_POLICIES)}, required=True)(value)["policy"]
    ends = Record(_POLICIES[name].entries().kinds, required=True)(value)
    in_order(ends, "low", "high", value)
    return _POLICIES[name](**ends)  # type: ignore[no-any-return]


def _color_map(value: object) -> str:
    from matplotlib import colormaps

    return Choice(colormaps, "the name of a colour map of matplotlib")(value)


def _family(family: type[Family]) -> Callable[[object], dict[str, Any]]:
    def check(value: object) -> dict[str, Any]:
        taken = family.entries()(value)
        if family.ordered:
            in_order(taken, *family.ordered, value)
        return taken

    return check


def _by_key(kind: Callable[[object], Any]) -> Callable[[object], dict[str, Any]]:
    """Return a check of a mapping from `Family.limits_key` to values."""

    def check(value: object) -> dict[str, Any]:
        keys = value if isinstance(value, dict) else {}
        known = (key for key in keys if str(key).partition(":")[0] in FAMILIES)
        return Record(dict.fromkeys(known, kind))(value)

    return check


#: Checks of the attributes written to JSON without conversion; `playing` is not written.
_PLAIN: dict[str, Callable[[object], Any]] = {
    "kind": Choice(FAMILIES),
    "nodal_lines": Flag(),
    "label_borders": Flag(),
    "label_graph": Flag(),
    "diverging_colormap": _color_map,
    "sequential_colormap": _color_map,
    "log_scales": _by_key(Flag()),
    "hide_small": Flag(),
}
_DISPLAY = Record(
    {
        **_PLAIN,
        "fields": Record({name: _family(family) for name, family in FAMILIES.items()}),
        "policies": _by_key(_policy),
        "cut": Cut.entries(),
        "shape": Shape.entries(),
    }
)

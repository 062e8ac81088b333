"""Display state (displayed family, parameters of all families, colours) and its JSON format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from psygnal import SignalGroupDescriptor

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.parameter import (
    MOST_INDEX,
    Parameters,
    Share,
    checked_entry,
    invalid_entry,
    one_of,
    parameter,
    record,
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
#: Policies of limits in a session file, and a number between -1 and 1.
_Policy = SymmetricLimits | MinMaxLimits | PercentileLimits | LockedLimits
_Signed = Annotated[float, Meta(ge=-1.0, le=1.0)]


@dataclass(frozen=True)
class Shape(Parameters):
    """Displacement of the displayed mesh: none, or rebuilt from its lowest eigenpairs."""

    #: Whether the vertices are rebuilt from eigenfunctions.
    shown: bool = parameter(False, bool)
    #: Number of lowest pairs; at least `FEWEST_PAIRS`.
    pairs: int = parameter(50, Annotated[int, Meta(ge=FEWEST_PAIRS, le=MOST_INDEX)])
    #: Interpolation between the mesh (0) and the rebuilt shape (1).
    morph: float = parameter(1.0, Share)
    #: Amplitude of the vibration as a share of the diagonal of the mesh's bounding box, from 0 to
    #: `MOST_AMPLITUDE`.
    amplitude: float = parameter(0.05, Annotated[float, Meta(ge=0.0, le=MOST_AMPLITUDE)])

    def within(self, n_pairs: int) -> int:
        """Return the number of pairs to use if `n_pairs` are available."""
        return min(max(self.pairs, FEWEST_PAIRS), n_pairs)


@dataclass(frozen=True)
class Cut(Parameters):
    """Clipping plane relative to the bounding box, and so independent of the unit."""

    #: Whether the mesh is cut at the plane.
    shown: bool = parameter(False, bool)
    #: Unit vector towards the visible side; zero if there is no plane.
    normal: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), tuple[_Signed, _Signed, _Signed]
    )
    #: Distance of the plane from the centre of the bounding box along the normal, in units of half
    #: its diagonal.
    offset: float = parameter(0.0, _Signed)

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
    def look(self) -> tuple[Any, ...]:
        """The attributes that determine colours and caption of a field."""
        colormaps = self.diverging_colormap, self.sequential_colormap
        return self.policies, self.log_scales, *colormaps, self.nodal_lines

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

#: Attributes written to JSON without conversion; `playing` is not written.
_PLAIN = (
    "kind", "nodal_lines", "label_borders", "label_graph", "diverging_colormap",
    "sequential_colormap", "log_scales", "hide_small",
)  # fmt: skip


def display_to_json(display: Display, index: Callable[[int], int] = int) -> dict[str, Any]:
    """Convert the display to JSON; `index` maps a vertex to the written index."""
    return {
        **{name: getattr(display, name) for name in _PLAIN},
        "fields": {
            name: family.at_vertices(index).plain() for name, family in display.fields.items()
        },
        "policies": msgspec.to_builtins(display.policies),
        "cut": display.cut.plain(),
        "shape": display.shape.plain(),
    }


def read_display(content: object, path: Path) -> dict[str, Any]:
    """Check the display in a session file, and return its attributes.

    `InputError` is raised if a value has a wrong type, is out of bounds, or contradicts another.
    """
    from matplotlib import colormaps

    given = content if isinstance(content, dict) else {}
    colormap = one_of(colormaps)
    kinds = {
        **dict.fromkeys(_PLAIN, bool),
        "kind": one_of(FAMILIES),
        "diverging_colormap": colormap,
        "sequential_colormap": colormap,
        "log_scales": _by_key(bool, given.get("log_scales")),
        "policies": _by_key(_Policy, given.get("policies")),
        "fields": record({name: record(each.entries()) for name, each in FAMILIES.items()}),
        "cut": record(Cut.entries()),
        "shape": record(Shape.entries()),
    }
    taken: dict[str, Any] = checked_entry(record(kinds), content, path, "display")
    for name, chosen in taken.get("fields", {}).items():
        low, high = FAMILIES[name].ordered or ("", "")
        _check_order(chosen.get(low), chosen.get(high), path, f"fields.{name}.{low}")
        pairs = {key: tuple(each.items()) for key, each in chosen.items() if isinstance(each, dict)}
        chosen.update(pairs)
    for name, policy in taken.get("policies", {}).items():
        if isinstance(policy, PercentileLimits | LockedLimits):
            _check_order(policy.low, policy.high, path, f"policies.{name}.low")
    return taken


def _check_order(low: float | None, high: float | None, path: Path, entry: str) -> None:
    if low is not None and high is not None and not low < high:
        raise invalid_entry(path, f"display.{entry}", f"{low:g} is not below {high:g}")


def _by_key(kind: Any, value: object) -> Any:
    """Return the type of a mapping from `Family.limits_key`; keys of other programs are ignored."""
    keys = value if isinstance(value, dict) else {}
    return record({key: kind for key in keys if key.partition(":")[0] in FAMILIES})


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

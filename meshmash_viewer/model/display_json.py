"""Display state as plain JSON, for session files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import Field, asdict, fields, replace
from pathlib import Path
from typing import Any

from meshmash_viewer.fields import FAMILIES, FEATURES
from meshmash_viewer.fields.family import Family, is_vertex
from meshmash_viewer.fields.schema import (
    Check,
    Refused,
    choice,
    flag,
    number,
    record,
    understood,
)
from meshmash_viewer.model.display import Display, Shape
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

_POLICIES: dict[str, Any] = {
    policy.__name__: policy
    for policy in (SymmetricLimits, MinMaxLimits, PercentileLimits, LockedLimits)
}
#: Attributes written as they are; `playing` is not stored.
_PLAIN = ("kind", "nodal_lines", "diverging_colormap", "sequential_colormap")


def display_to_json(display: Display, index: Callable[[int], int] = int) -> dict[str, Any]:
    """Return the display as plain JSON; `index` maps a vertex to the index that is written."""
    families = {}
    for name, family in display.fields.items():
        found = family.at_vertices(index)
        families[name] = {each.name: _plain(getattr(found, each.name)) for each in _kept(family)}
    policies = {
        name: {"policy": type(policy).__name__, **vars(policy)}
        for name, policy in display.policies.items()
    }
    plain = {name: getattr(display, name) for name in _PLAIN}
    shape = asdict(display.shape)
    return {**plain, "fields": families, "policies": policies, "shape": shape}


def read_display(content: object, path: Path) -> dict[str, Any]:
    """Check the display in a session file, and return its attributes.

    Raises
    ------
    InputError
        If one has another type, is out of bounds, or does not go together with another.
    """
    taken: dict[str, Any] = understood(_DISPLAY, content, path, "display")
    return taken


def display_from_json(display: Display, content: dict[str, Any]) -> None:
    """Set the attributes that `read_display` returned, the kind last as it depends on the rest."""
    for name, value in sorted(content.items(), key=lambda item: item[0] == "kind"):
        if name == "fields":
            display.put(
                *(replace(display.fields[family], **chosen) for family, chosen in value.items())
            )
        elif name == "shape":
            display.shape = replace(display.shape, **value)
        else:
            setattr(display, name, value)


def place_vertices(
    content: dict[str, Any], vertex: Callable[[int], int | None]
) -> Iterator[tuple[str, int]]:
    """Replace each vertex index from `read_display` by what `vertex` returns for it.

    Indices for which that is None are removed; yields the path of each in the display, and the
    index.
    """
    for family, chosen in content.get("fields", {}).items():
        for each in _kept(FAMILIES[family]):
            index = chosen.get(each.name)
            if not is_vertex(each) or index is None:
                continue
            chosen[each.name] = vertex(index)
            if chosen[each.name] is None:
                del chosen[each.name]
                yield f"fields.{family}.{each.name}", index


def _kept(family: Family | type[Family | Shape]) -> list[Field[Any]]:
    """List the parameters that a session stores: those with a check of their values."""
    return [each for each in fields(family) if each.metadata]


def _plain(value: object) -> object:
    if isinstance(value, tuple):
        return dict(value)
    return sorted(value) if isinstance(value, frozenset) else value


def _policy(value: object) -> LimitPolicy:
    name = record({"policy": choice(_POLICIES)}, whole=True)(value)["policy"]
    policy = _POLICIES[name]
    if policy in (SymmetricLimits, MinMaxLimits):
        return policy()  # type: ignore[no-any-return]
    bounds = number(0.0, 100.0) if policy is PercentileLimits else number()
    ends = record({"low": bounds, "high": bounds}, whole=True)(value)
    _in_order(ends, "low", "high", value)
    return policy(**ends)  # type: ignore[no-any-return]


def _color_map(value: object) -> str:
    from matplotlib import colormaps

    return str(choice(colormaps, "the name of a colour map of matplotlib")(value))


def _in_order(taken: dict[str, Any], low: str, high: str, value: object) -> None:
    first, second = taken.get(low), taken.get(high)
    if first is not None and second is not None and not first < second:
        raise Refused(f"an object with {low} below {high}", value)


def _parameters(family: type[Family | Shape]) -> Check:
    return record({each.name: each.metadata["check"] or choice(FEATURES) for each in _kept(family)})


def _family(name: str) -> Check:
    family = FAMILIES[name]
    parameters = _parameters(family)

    def check(value: object) -> dict[str, Any]:
        taken: dict[str, Any] = parameters(value)
        if family.ordered:
            _in_order(taken, *family.ordered, value)
        return taken

    return check


_DISPLAY = record(
    {
        "kind": choice(FAMILIES),
        "nodal_lines": flag,
        "diverging_colormap": _color_map,
        "sequential_colormap": _color_map,
        "fields": record({name: _family(name) for name in FAMILIES}),
        "policies": record(dict.fromkeys(FAMILIES, _policy)),
        "shape": _parameters(Shape),
    }
)

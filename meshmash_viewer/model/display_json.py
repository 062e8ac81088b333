"""What is looked at, as plain JSON: the part of a session that is the display's."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from meshmash_viewer.io.schema import (
    Check,
    Refused,
    choice,
    flag,
    listing,
    none_or,
    number,
    record,
    understood,
    whole,
)
from meshmash_viewer.io.session import MOST_INDEX
from meshmash_viewer.model.display import (
    MOST_BANDS,
    MOST_SCALES,
    Display,
    FieldKind,
    SimilarityBasis,
)
from meshmash_viewer.model.limits import (
    LimitPolicy,
    LockedLimits,
    MinMaxLimits,
    PercentileLimits,
    SymmetricLimits,
)

__all__ = ["display_from_json", "display_to_json", "read_display"]

_POLICIES: dict[str, Any] = {
    policy.__name__: policy
    for policy in (SymmetricLimits, MinMaxLimits, PercentileLimits, LockedLimits)
}
#: What is not kept: a window never opens playing.
_LEFT_OUT = {"playing"}


def display_to_json(display: Display) -> dict[str, Any]:
    """The display as plain JSON."""
    content: dict[str, Any] = {}
    for name in (each.name for each in fields(display)):
        value = getattr(display, name)
        if name in _LEFT_OUT:
            continue
        if name == "limits":
            value = None if value is None else _policy_to_json(value)
        elif isinstance(value, frozenset):
            value = sorted(value)
        content[name] = value
    return content


def read_display(content: object, path: Path) -> dict[str, Any]:
    """The attributes of a display that the session of a file asks for.

    Raises
    ------
    InputError
        If one has another type, is out of bounds, or does not go together with another.
    """
    taken: dict[str, Any] = understood(_display, content, path, "display")
    return taken


def display_from_json(display: Display, content: dict[str, Any]) -> None:
    """Set what `read_display` has read, the kind last: it decides which of the others count."""
    for name, value in sorted(content.items(), key=lambda item: item[0] == "kind"):
        setattr(display, name, value)


def _policy_to_json(policy: LimitPolicy) -> dict[str, Any]:
    ends = {name: getattr(policy, name) for name in ("low", "high") if hasattr(policy, name)}
    return {"policy": type(policy).__name__, **ends}


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


_ABOVE_ZERO = number(1e-300)
_CHECKS: dict[str, Check] = {
    "kind": lambda value: FieldKind(choice(FieldKind)(value)),
    "index": whole(0, MOST_INDEX),
    "flipped": lambda value: frozenset(listing(whole(0, MOST_INDEX), 1_000_000)(value)),
    "time": none_or(_ABOVE_ZERO),
    "hks_automatic": flag,
    "hks_t_min": none_or(_ABOVE_ZERO),
    "hks_t_max": none_or(_ABOVE_ZERO),
    "hks_scales": whole(1, MOST_SCALES),
    "band": whole(0, MOST_BANDS - 1),
    "band_count": whole(1, MOST_BANDS),
    "band_automatic": flag,
    "band_min": none_or(number(0.0)),
    "band_max": none_or(number(0.0)),
    "similarity_vertex": none_or(whole(0, MOST_INDEX)),
    "similarity_basis": lambda value: SimilarityBasis(choice(SimilarityBasis)(value)),
    "nodal_lines": flag,
    "diverging_colormap": _color_map,
    "sequential_colormap": _color_map,
    "limits": none_or(_policy),
}


def _display(value: object) -> dict[str, Any]:
    taken: dict[str, Any] = record(_CHECKS)(value)
    _in_order(taken, "hks_t_min", "hks_t_max", value)
    _in_order(taken, "band_min", "band_max", value)
    return taken

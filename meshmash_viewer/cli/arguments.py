"""Types of command-line arguments, and objects created from options."""

from __future__ import annotations

import argparse
import re
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import mode
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.io.links import is_link
from meshmash_viewer.quantities import (
    Quantity,
    parse_number,
    parse_quantity,
    parse_whole,
)

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.fields.parameter import Parameter
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.spectral.weyl import Target

_T = TypeVar("_T")
#: Largest whole number of an option: indices and counts have 32 bits.
_MOST = 2**31 - 1
_NEGATIVE = re.compile(r"\A-(?=[.,]?[0-9][-0-9.,;:'_eE+×x*^⁻⁺⁰¹²³⁴-⁹ ]*\Z)")


def signed(arguments: list[str]) -> list[str]:
    """Replace the hyphen of negative numbers by "−": argparse takes "-1e-4" for an option."""
    return [_NEGATIVE.sub("\u2212", each) for each in arguments]


def option_type(parse: Callable[[str], _T]) -> Callable[[str], _T]:
    """Return a parser for argparse, which raises `ArgumentTypeError` in place of `InputError`."""

    def parsed(text: str) -> _T:
        try:
            return parse(text)
        except InputError as fault:
            raise ArgumentTypeError(fault.clause) from None

    return parsed


def whole(least: int = 0, most: int = _MOST) -> Callable[[str], int]:
    """Return a parser of whole numbers from a minimum to a maximum."""
    return option_type(lambda text: parse_whole(text, least, most, "the value"))


def number(unit: str = "", *, share: bool = False) -> Callable[[str], float]:
    """Return a parser of numbers, which may have a unit."""
    return option_type(lambda text: parse_number(text, unit, share=share))


def quantity(power: int) -> Callable[[str], Quantity]:
    """Return a parser of lengths to a power, by default in the unit of each mesh."""
    return option_type(lambda text: parse_quantity(text, power))


@dataclass(frozen=True)
class TargetQuantity:
    """A quantity that becomes a `Target` once the unit of its mesh is known."""

    kind: Literal["max_eigenvalue", "wavelength"]
    quantity: Quantity

    def in_unit(self, unit: str) -> Target:
        """Return the target in a unit of length."""
        from meshmash_viewer.spectral.weyl import Target

        return Target(self.kind, self.quantity.in_unit(unit))


def in_unit(options: Namespace, unit: str | None = None) -> Namespace:
    """Convert all quantities of the options to the unit of a mesh, and add it as `mesh_unit`.

    If `unit` is None, quantities with a unit become None, so that other options can be checked.
    """
    found = {name: _in_unit(value, unit) for name, value in vars(options).items()}
    return Namespace(**{**found, "mesh_unit": unit})


def _in_unit(value: Any, unit: str | None) -> Any:
    if isinstance(value, tuple):
        return tuple(_in_unit(each, unit) for each in value)
    if isinstance(value, Quantity):
        return None if unit is None and value.unit else value.in_unit(unit or "")
    if isinstance(value, TargetQuantity) and unit is not None:
        return value.in_unit(unit)
    return value


#: Exit status for faults that the user can correct.
FAULT = 2
#: Value of ``features --kind`` for maps without features.
MAPS = "maps"
#: Value of ``render --field`` for a mesh without a field.
NO_FIELD = "none"


def usual_count(family: type[Family], least: int = 1) -> int:
    """Return the default number of columns of a family; 32 if the default is below `least`."""
    count = getattr(family(), family.counted)
    return count if count >= least else 32


def usual_counts(table: Mapping[str, type[Family]], least: int = 1) -> str:
    """Describe default numbers of columns: the most frequent number, and kinds that differ."""
    counts = {kind: usual_count(each, least) for kind, each in table.items() if each.counted}
    usual = mode(counts.values())
    others = (f"; {count} for --kind {kind}" for kind, count in counts.items() if count != usual)
    return f"default {usual}{''.join(others)}"


def options_of(family: type[Family]) -> dict[str, Parameter]:
    """Return the parameters of a family that are options of the command line, by name."""
    return {name: each for name, each in family.declared().items() if each.option}


def mesh_argument(text: str) -> Path | str:
    """Return a path, or a link as text, since `Path` would merge its two slashes."""
    return text if is_link(text) else Path(text)


def chosen_operator(options: argparse.Namespace) -> OperatorOptions:
    """Return the requested options of the Laplacian."""
    from meshmash_viewer.laplacian import OperatorOptions

    return OperatorOptions(robust=not options.no_robust, mollify_factor=options.mollify_factor)


def made_with(options: argparse.Namespace, kind: str, target: Target, proof: str) -> dict[str, Any]:
    """Return the `export_options` of a result."""
    from meshmash_viewer.io.provenance import export_options

    return export_options(
        kind, chosen_operator(options), target, proof, options.repair,
        whole_mesh=getattr(options, "whole_mesh", False), mask=options.mask,
    )  # fmt: skip


def refuse_others(
    options: argparse.Namespace, table: Mapping[str, type[Family]], own: Collection[str]
) -> None:
    """Raise `InputError` for a given option of a family that is not in `own`."""
    for kind, family in table.items():
        for each in options_of(family).values():
            if each.option not in own and getattr(options, each.option) is not None:
                raise conflicting(f"{each.flag} is for --kind {kind}, not for {options.kind}")


def chosen_family(
    options: argparse.Namespace, table: Mapping[str, type[Family]], least: int = 1
) -> Family:
    """Create the requested family; raise `InputError` for options of other families."""
    chosen = table[options.kind]
    refuse_others(options, table, [each.option for each in options_of(chosen).values()])
    return family_of(options, chosen, least)


def family_of(options: argparse.Namespace, chosen: type[Family], least: int = 1) -> Family:
    """Create a family from options, as returned by `in_unit`, and check its parameters.

    For `least` see `usual_count`.
    """
    if getattr(options, "tail", None) is not None:
        from meshmash_viewer.features.truncation import check_tail

        check_tail(options.tail, chosen.export)
    given = {name: getattr(options, each.option) for name, each in options_of(chosen).items()}
    parameters = {name: value for name, value in given.items() if value is not None}
    count = options.n_components
    if count is None and chosen.counted:
        count = usual_count(chosen, least)
    return chosen.exported(count, options.mesh_unit, **parameters)

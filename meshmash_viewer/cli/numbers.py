"""Numbers on the command line, and quantities in the unit of a mesh that is still to be read."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import Quantity, parse_number, parse_quantity, parse_whole

if TYPE_CHECKING:
    from meshmash_viewer.spectral.weyl import Target

_T = TypeVar("_T")
#: Largest whole number of an option: indices and counts have 32 bits.
_MOST = 2**31 - 1
_NEGATIVE = re.compile(r"\A-(?=[.,]?[0-9][-0-9.,'_eE+×x*^⁻⁺⁰¹²³⁴-⁹ ]*\Z)")


def signed(arguments: list[str]) -> list[str]:
    """Replace the hyphen of negative numbers, as argparse takes "-1e-4" for an option."""
    return [_NEGATIVE.sub("\u2212", each) for each in arguments]


def option_type(parse: Callable[[str], _T]) -> Callable[[str], _T]:
    """Return a function that parses as another one, for argparse: it raises what that expects."""

    def taken(text: str) -> _T:
        try:
            return parse(text)
        except InputError as fault:
            raise ArgumentTypeError(str(fault).rstrip(".")) from None

    return taken


def whole(least: int = 0) -> Callable[[str], int]:
    """Return a parser of whole numbers from a minimum."""
    return option_type(lambda text: parse_whole(text, least, _MOST, "the value"))


def number(unit: str = "", *, share: bool = False) -> Callable[[str], float]:
    """Return a parser of numbers, which may have a unit."""
    return option_type(lambda text: parse_number(text, unit, share=share))


def quantity(power: int) -> Callable[[str], Quantity]:
    """Return a parser of powers of a length, in any unit or in that of each mesh."""
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


def target(
    kind: Literal["max_eigenvalue", "wavelength"], power: int
) -> Callable[[str], Target | TargetQuantity]:
    """Return a parser of targets, which checks those without a unit at once."""

    def taken(text: str) -> Target | TargetQuantity:
        found = TargetQuantity(kind, parse_quantity(text, power))
        return found if found.quantity.unit else found.in_unit("")

    return option_type(taken)


def in_unit(options: Namespace, unit: str | None = None) -> Namespace:
    """Convert all quantities of the options to the unit of a mesh, their `mesh_unit`.

    Without one those in a unit of their own are left out, to check the others.
    """
    found = {name: _in_unit(value, unit) for name, value in vars(options).items()}
    return Namespace(**{**found, "mesh_unit": unit})


def _in_unit(value: Any, unit: str | None) -> Any:
    if isinstance(value, Quantity):
        return None if unit is None and value.unit else value.in_unit(unit or "")
    if isinstance(value, TargetQuantity) and unit is not None:
        return value.in_unit(unit)
    return value

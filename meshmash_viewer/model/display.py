"""What is looked at: the parameters of every family of fields, which one is shown, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, TypeVar

from psygnal import SignalGroupDescriptor

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family, parameter
from meshmash_viewer.fields.schema import MOST_INDEX, flag, number, whole
from meshmash_viewer.model.limits import LimitPolicy

__all__ = ["FEWEST_PAIRS", "MOST_AMPLITUDE", "Display", "Shape"]

Chosen = TypeVar("Chosen", bound=Family)

#: Pairs of a shape: a constant and three of the first ones, what a shape with an inside takes.
FEWEST_PAIRS = 4
#: Share of the diagonal of a mesh's box, beyond which nothing of its shape is left.
MOST_AMPLITUDE = 0.2


@dataclass(frozen=True)
class Shape:
    """How the mesh on the render is moved: not at all, or to what its lowest pairs make of it.

    Parameters
    ----------
    shown : bool
        Whether the vertices are rebuilt from eigenfunctions.
    pairs : int
        From how many of the lowest; at least `FEWEST_PAIRS`.
    morph : float
        How far from the mesh itself (0) to what is rebuilt (1).
    amplitude : float
        Of the vibration, as a share of the diagonal of the mesh's box, from 0 to
        `MOST_AMPLITUDE`.
    """

    shown: bool = parameter(False, flag)
    pairs: int = parameter(50, whole(FEWEST_PAIRS, MOST_INDEX))
    morph: float = parameter(1.0, number(0.0, 1.0))
    amplitude: float = parameter(0.05, number(0.0, MOST_AMPLITUDE))

    def within(self, n_pairs: int) -> int:
        """How many pairs are taken where there are `n_pairs`."""
        return min(max(self.pairs, FEWEST_PAIRS), n_pairs)


@dataclass
class Display:
    """Evented choices of what is drawn; every change of an attribute emits ``events.<name>``.

    Parameters
    ----------
    kind : str
        Name of the family on the render.
    fields : mapping of str to Family
        The parameters of every family, by its name; replaced as a whole, see `put`.
    playing : bool
        Whether the field advances by itself.
    nodal_lines : bool
    diverging_colormap, sequential_colormap : str
        Colour map names (matplotlib's) for signed and for non-negative fields.
    policies : mapping of str to LimitPolicy
        How the limits of colours are chosen, by the family's name; where there is none, as suits
        the field.
    shape : Shape
        Where the vertices are drawn.
    vibrating : bool
        Whether they swing along the normals by the field on the render.
    """

    events: ClassVar[SignalGroupDescriptor] = SignalGroupDescriptor()

    kind: str = next(iter(FAMILIES))
    fields: Mapping[str, Family] = field(
        default_factory=lambda: {name: family() for name, family in FAMILIES.items()}
    )
    playing: bool = False
    nodal_lines: bool = False
    diverging_colormap: str = "RdBu_r"
    sequential_colormap: str = "viridis"
    policies: Mapping[str, LimitPolicy] = field(default_factory=dict)
    shape: Shape = field(default_factory=Shape)
    vibrating: bool = False

    def __getitem__(self, family: type[Chosen]) -> Chosen:
        """The parameters of one family."""
        chosen = self.fields[family.name]
        assert isinstance(chosen, family)
        return chosen

    @property
    def family(self) -> Family:
        """The parameters of the family on the render."""
        return self.fields[self.kind]

    def put(self, *families: Family) -> None:
        """Take other parameters of some families."""
        self.fields = {**self.fields, **{family.name: family for family in families}}

    def change(self, family: type[Family], **parameters: Any) -> None:
        """Change some parameters of a family."""
        self.put(replace(self.fields[family.name], **parameters))

    def show(self, family: Family) -> None:
        """Take other parameters of a family, and put it on the render."""
        self.put(family)
        self.kind = family.name

    @property
    def limits(self) -> LimitPolicy | None:
        """How the limits of the family on the render are chosen; None as suits the field."""
        return self.policies.get(self.kind)

    @limits.setter
    def limits(self, policy: LimitPolicy | None) -> None:
        others = {name: each for name, each in self.policies.items() if name != self.kind}
        self.policies = others if policy is None else {**others, self.kind: policy}

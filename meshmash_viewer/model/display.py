"""Display state: the parameters of every family, which family is displayed, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, TypeVar

from psygnal import SignalGroupDescriptor

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family, parameter
from meshmash_viewer.fields.schema import MOST_INDEX, flag, number, whole
from meshmash_viewer.model.limits import LimitPolicy

Chosen = TypeVar("Chosen", bound=Family)

#: Fewest pairs of a rebuilt shape: the constant and three more, below which it has no volume.
FEWEST_PAIRS = 4
#: Largest amplitude, as a share of the diagonal of the mesh's bounding box.
MOST_AMPLITUDE = 0.2


@dataclass(frozen=True)
class Shape:
    """Displacement of the displayed mesh: none, or rebuilt from its lowest eigenpairs.

    Parameters
    ----------
    shown : bool
        Whether the vertices are rebuilt from eigenfunctions.
    pairs : int
        Number of lowest pairs; at least `FEWEST_PAIRS`.
    morph : float
        Position between the mesh itself (0) and the rebuilt one (1).
    amplitude : float
        Amplitude of the vibration as a share of the diagonal of the mesh's bounding box, from 0
        to `MOST_AMPLITUDE`.
    """

    shown: bool = parameter(False, flag)
    pairs: int = parameter(50, whole(FEWEST_PAIRS, MOST_INDEX))
    morph: float = parameter(1.0, number(0.0, 1.0))
    amplitude: float = parameter(0.05, number(0.0, MOST_AMPLITUDE))

    def within(self, n_pairs: int) -> int:
        """Return the number of pairs used where `n_pairs` are available."""
        return min(max(self.pairs, FEWEST_PAIRS), n_pairs)


@dataclass
class Display:
    """Choices of what is drawn; every change of an attribute emits ``events.<name>``.

    Parameters
    ----------
    kind : str
        Name of the displayed family.
    fields : mapping of str to Family
        The parameters of every family, by name; replaced as a whole, see `put`.
    playing : bool
        Whether the field advances by itself.
    nodal_lines : bool
    diverging_colormap, sequential_colormap : str
        Colour map names (matplotlib's) for signed and for non-negative fields.
    policies : mapping of str to LimitPolicy
        How colour limits are chosen, by family name; `automatic_limits` for families not in it.
    shape : Shape
        Displacement of the vertices.
    vibrating : bool
        Whether vertices oscillate along their normals by the displayed field.
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
        """Return the parameters of one family."""
        chosen = self.fields[family.name]
        assert isinstance(chosen, family)
        return chosen

    @property
    def family(self) -> Family:
        """The parameters of the displayed family."""
        return self.fields[self.kind]

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
        """How the limits of the displayed family are chosen; None for `automatic_limits`."""
        return self.policies.get(self.kind)

    @limits.setter
    def limits(self, policy: LimitPolicy | None) -> None:
        others = {name: each for name, each in self.policies.items() if name != self.kind}
        self.policies = others if policy is None else {**others, self.kind: policy}

"""Which shape the mesh on the render has: its own, or that of its lowest eigenfunctions."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FEWEST_PAIRS", "MOST_AMPLITUDE", "MOST_PAIRS", "Shape"]

#: A constant and three of the first ones: what a shape with an inside takes.
FEWEST_PAIRS = 4
#: More than a mesh has vertices.
MOST_PAIRS = 2**31 - 1
#: Share of the diagonal of a mesh's box, beyond which nothing of its shape is left.
MOST_AMPLITUDE = 0.2


@dataclass(frozen=True)
class Shape:
    """How the mesh on the render is moved.

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

    shown: bool = False
    pairs: int = 50
    morph: float = 1.0
    amplitude: float = 0.05

    def within(self, n_pairs: int) -> int:
        """How many pairs are taken where there are `n_pairs`."""
        return min(max(self.pairs, FEWEST_PAIRS), n_pairs)

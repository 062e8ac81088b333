"""Family of single eigenfunctions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from msgspec import Meta

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.fields.family import Answer, Description, Family, Profile, Samples, Table
from meshmash_viewer.fields.parameter import Index, parameter
from meshmash_viewer.spectral.eigenpairs import (
    Eigenpairs,
    first_nonzero,
    format_eigenvalue,
)
from meshmash_viewer.units import (
    format_quantity,
    format_share,
    named_quantity,
    power_unit,
    subscript,
)

if TYPE_CHECKING:
    from meshmash_viewer.features.comparison import Correspondence


@dataclass(frozen=True)
class Eigenfunctions(Family):
    """One eigenfunction of the spectrum."""

    name = "eigenfunction"
    label = "Eigenfunctions"
    page = "eigenpairs"
    short = "Eigenfunctions"
    tip = "Eigenfunctions of the Laplacian"
    export = "eigenpairs"
    export_label = "Eigenpairs"
    icon = '<path d="M3 12c3-10 6-10 9 0s6 10 9 0"/>'
    position = ("index",)
    of_one_pair = True
    interval = 250

    #: Index of the eigenfunction, from 0.
    index: int = parameter(1, Index)
    #: Indices of the functions drawn with flipped sign.
    flipped: frozenset[int] = parameter(frozenset(), frozenset[Index])
    #: Rotation within a multiplet, empty for none: an index, another index of the multiplet, and
    #: the angle in degrees by which the first function is rotated towards the second.
    rotation: tuple[int, ...] = parameter((), Annotated[tuple[Index, ...], Meta(max_length=3)])

    @property
    def definition(self) -> str:
        return "L φ = λ M φ"

    @property
    def signed(self) -> bool:
        return True

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        index = self.within(spectrum).index
        known = replace(self, index=index, flipped=self.flipped & {index})
        return known if known.rotated(spectrum) else replace(known, rotation=())

    def space(self, spectrum: Eigenpairs) -> range | None:
        """Return the indices within which the function can be rotated, or None."""
        return None if self.index < first_nonzero(spectrum) else spectrum.multiplet(self.index)

    def rotated(self, spectrum: Eigenpairs) -> tuple[range, int, int] | None:
        """Return `space`, the other index and the angle in degrees; None if not rotated."""
        space = self.space(spectrum)
        if space is None or len(self.rotation) != 3:
            return None
        index, other, degrees = self.rotation
        within = index == self.index != other and other in space
        return (space, other, degrees) if within and degrees else None

    def for_other_mesh(self, n_components: int) -> Self:
        """Select the first function that is not constant on every component."""
        return replace(self, index=n_components, flipped=frozenset(), rotation=())

    def carried(self, to: Correspondence) -> Self:
        """Select the corresponding function and sign, or the same index without a match."""
        same, index = to.functions, self.index
        if same is None or index >= len(same.indices) or same.indices[index] < 0:
            return replace(self, rotation=())
        other = int(same.indices[index])
        flipped = (same.signs[index] < 0.0) != (index in self.flipped)
        signs = frozenset({other} if flipped else ())
        return replace(self, index=other, flipped=signs, rotation=())

    def correspondence_text(self, to: Correspondence) -> str:
        """Describe the corresponding eigenfunction of another shape."""
        same, index = to.functions, self.index
        if same is None or index >= len(same.indices) or same.indices[index] < 0:
            return f"{index} has no match"
        sign = ", flipped" if same.signs[index] < 0.0 else ""
        return (
            f"{index} is {same.indices[index]}{sign} (correlation {same.correlations[index]:.2f})"
        )

    def within(self, spectrum: Eigenpairs) -> Self:
        return replace(self, index=min(max(self.index, 0), max(len(spectrum) - 1, 0)))

    def sign_flipped(self) -> Self:
        """Flip the sign."""
        return replace(self, flipped=self.flipped ^ {self.index})

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        written = format_eigenvalue(spectrum.eigenvalues[self.index], spectrum, unit, 4)
        quantity = f"λ{subscript(self.index)} = {written}"
        if not spectrum.is_exact(self.index):
            quantity = (
                f"λ{subscript(self.index)} ≈ {written} · preview, within about"
                f" {format_share(spectrum.error, 2)}"
            )
        if rotated := self.rotated(spectrum):
            space, other, degrees = rotated
            size = len(space)
            towards = f" towards φ{subscript(other)}" if size > 2 else ""
            cut = space.stop == len(spectrum) and len(spectrum) < spectrum.n_vertices
            of = f"a space of at least {size}" if cut else f"the space of {size}"
            quantity += f" · rotated by {degrees}°{towards} in {of}"
        return Description(quantity, f"Eigenfunction {self.index}", power=-1)

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer:
        """Return the function in single precision, with the chosen rotation and sign."""
        values = np.array(spectrum.shown_rows[self.index], dtype=np.float32)
        if rotated := self.rotated(spectrum):
            _, other, degrees = rotated
            angle = np.radians(np.float32(degrees))
            values *= np.cos(angle)
            values += np.sin(angle) * np.asarray(spectrum.shown_rows[other], dtype=np.float32)
        if self.index in self.flipped:
            np.negative(values, out=values)
        return Answer(values, not spectrum.is_exact(self.index))

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile:
        """Return the profile: the values of all eigenfunctions at a vertex."""
        signs = np.ones(len(spectrum))
        signs[[index for index in self.flipped if index < len(signs)]] = -1.0
        both = Samples(np.arange(len(spectrum), dtype=np.float64), signs)
        return Profile(both, both, ("Index", named_quantity("φ", unit, -1)))

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        return np.arange(len(spectrum), dtype=np.float64)

    def place(self, spectrum: Eigenpairs) -> float:
        return float(self.within(spectrum).index)

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        return replace(self, index=round(place)).within(spectrum)

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        about = f"Eigenvalues up to {format_quantity(float(spectrum.eigenvalues[-1]), unit, -2)}"
        values = power_unit(unit, -1)
        names = tuple(f"eigenvector_{at}" for at in range(len(spectrum)))
        rotated = " as solved, without the rotation shown," if self.rotated(spectrum) else ""
        unit = f" in {values}" if values else ""
        return names, f"{about}, eigenvectors{rotated}{unit}, M-orthonormal."

    def script(self, spectrum: Eigenpairs) -> list[str]:
        rotated, alignment = self.rotated(spectrum), spectrum.alignment
        shown = [self.index] if rotated is None else [self.index, rotated[1]]
        signs = [1.0 if alignment is None else alignment.sign(each) for each in shown]
        flipped = self.index in self.flipped
        columns = [
            f"{'-' if flipped != (sign == -1.0) else ''}decomposition.eigenvectors[:, {each}]"
            for sign, each in zip(signs, shown, strict=True)
        ]
        values = columns[0]
        if rotated is not None:
            angle = f"np.radians({rotated[2]})"
            values = f"np.cos({angle}) * {columns[0]} + np.sin({angle}) * {columns[1]}"
        lines = [f"values = {values}"]
        if None in signs:
            lines.insert(0, "# one of a multiplet, within which the screen shows it rotated")
        return lines

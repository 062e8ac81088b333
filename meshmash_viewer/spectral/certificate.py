"""Certificates: evidence that eigenpairs are accurate and that none is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from meshmash_viewer.units import counted, format_number, format_quantity, format_range

#: How eigenvalues were counted: by the signs of a factorization (Sylvester's law of inertia), from
#: the dense matrix, as one zero for each connected component, or not at all.
Method = Literal["inertia", "dense", "null space", "none"]

#: Largest residual and orthonormality defect of proven pairs.
_TOLERANCES = {"float64": (1e-6, 1e-8), "float32": (1e-3, 1e-4)}


@dataclass(frozen=True, slots=True)
class Certificate:
    """Counts and errors of eigenpairs, with the verdict that follows from them."""

    #: How the number of eigenvalues was found, independently of the iteration.
    method: Method
    #: Number of eigenvalues of the matrix up to `bound` (from `low`).
    counted: int = 0
    #: Number of these that were found; the pairs of a decomposition are the lowest of them, or
    #: those nearest a shift.
    found: int = 0
    #: Upper end of the counted interval; None if it is unbounded.
    bound: float | None = None
    #: Lower end of the counted interval, for pairs around a shift; None for the lowest pairs.
    low: float | None = None
    #: The worst ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``; for zeros, relative to 4π / area.
    residual: float = 0.0
    #: Index of the pair with that residual.
    residual_index: int = 0
    #: Largest entry of ``|ΦᵀMΦ - I|``.
    orthonormality: float = 0.0
    #: Of the eigenvectors; it sets the tolerances of `residual` and `orthonormality`.
    precision: Literal["float64", "float32"] = "float64"
    #: Further information, such as that the threshold is an eigenvalue; without a full stop.
    remark: str = ""

    @property
    def lacks(self) -> tuple[str, ...]:
        """Reasons why the pairs are not proven; empty if they are."""
        residual, orthonormality = _TOLERANCES[self.precision]
        lacks = []
        if self.method == "none":
            lacks.append("no count")
        elif self.found != self.counted:
            lacks.append(f"{self.found} found of {self.counted} counted")
        # Written so that NaN, which is no proof, fails as well.
        if not self.residual <= residual:
            lacks.append(
                f"a residual of {_short(self.residual)} (pair {self.residual_index}) above "
                f"{_short(residual)}"
            )
        if not self.orthonormality <= orthonormality:
            lacks.append(
                f"an orthonormality of {_short(self.orthonormality)} above {_short(orthonormality)}"
            )
        return tuple(lacks)

    @property
    def complete(self) -> bool:
        """Whether as many pairs were found as counted, with errors within tolerance."""
        return not self.lacks

    def count_sentence(self, unit: str = "") -> str:
        """Describe how many eigenvalues were counted and how; lengths are in `unit`."""
        if self.method == "none":
            return "no count"
        if self.method == "dense":
            return f"all {counted(self.counted, 'eigenvalue')} computed"
        if self.method == "null space":
            return "one zero for each connected component"
        assert self.bound is not None  # a count by inertia has an upper end
        found = counted(self.counted, "eigenvalue")
        if self.low is not None:
            between = format_range(self.low, self.bound, unit, -2, word="to", digits=4)
            return f"{found} counted from {between}"
        return f"{found} counted below {format_quantity(self.bound, unit, -2, 4)}"

    def sentence(self, n_pairs: int, unit: str = "") -> str:
        """Describe in one line the number of pairs, their count and errors; lengths are in `unit`.

        "200 pairs · complete (201 eigenvalues counted below 11.35 µm⁻²) · worst residual 3×10⁻¹⁰
        · orthonormality 3×10⁻¹³".
        """
        state = "complete" if self.complete else f"not proven complete: {', '.join(self.lacks)}"
        how = f" ({self.count_sentence(unit)})" if self.method != "none" else ""
        parts = [
            counted(n_pairs, "pair"),
            state + how,
            f"worst residual {_short(self.residual)}",
            f"orthonormality {_short(self.orthonormality)}",
        ]
        return " · ".join([*parts, *([self.remark] if self.remark else [])])


def _short(error: float) -> str:
    return format_number(error, 1)

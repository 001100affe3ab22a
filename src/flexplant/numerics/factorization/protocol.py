"""What every factorisation backend offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True)
class Estimate:
    """What a factorisation will cost, known before it starts: entries of the factor, bytes held, bytes at the peak, flops."""

    fill: int
    factor_bytes: int
    peak_bytes: int
    flops: float

    def __str__(self) -> str:
        return f"{self.fill:.3g} entries, {self.factor_bytes / 1e9:.2f} GB held and {self.peak_bytes / 1e9:.2f} GB at the peak"


class Factor(Protocol):
    """A factored symmetric (real, or complex-symmetric) matrix."""

    @property
    def backend(self) -> str:
        """Name of the backend that made it."""
        ...

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues (Sylvester inertia), None where the backend cannot tell."""
        ...

    @property
    def fill(self) -> int:
        """Entries of the factor."""
        ...

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        ...


class Analysis(Protocol):
    """The symbolic part of a factorisation, reused for every matrix of the same pattern."""

    @property
    def estimate(self) -> Estimate | None:
        """Cost of a factorisation, None where the backend cannot tell before it starts."""
        ...

    def factorize(self, matrix: Any) -> Factor:
        """Factor a matrix; one of another pattern is analysed anew. SolverError where it is singular."""
        ...

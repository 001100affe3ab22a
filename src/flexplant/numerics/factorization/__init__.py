"""Sparse symmetric factorisations behind one interface: factor once, solve many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from flexplant.errors import InputError, nearest
from flexplant.numerics.factorization import rslab_backend, superlu_backend

__all__ = ["BACKENDS", "Factor", "factorize"]


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

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        ...


BACKENDS: dict[str, Callable[[Any], Factor]] = {"rslab": rslab_backend.factorize, "superlu": superlu_backend.factorize}


def factorize(matrix: Any, *, backend: str | None = None) -> Factor:
    """Factor a sparse symmetric matrix (n, n), real or complex-symmetric.

    backend: "rslab" (L D L^T; the default where it is installed) or "superlu" (LU in symmetric mode, always there).
    Raises SolverError where the matrix is singular; InputError for an unknown backend.
    """
    if backend is None:
        backend = "rslab" if rslab_backend.available() else "superlu"
    if backend not in BACKENDS:
        raise InputError(f"unknown factorization backend {backend!r}." + nearest(backend, BACKENDS))
    return BACKENDS[backend](matrix)

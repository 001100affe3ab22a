"""Supernodal L D L^T by rslab: real and complex-symmetric, with inertia."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import MissingExtraError, SolverError


def available() -> bool:
    """True where rslab is installed."""
    return importlib.util.find_spec("rslab") is not None


@dataclass(frozen=True, eq=False)
class RslabFactor:
    """See `Factor`."""

    handle: Any
    complex: bool
    backend: str = "rslab"

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a real matrix."""
        return None if self.complex else int(self.handle.inertia[1])

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=complex if self.complex else float)
        return self.handle.solve(np.ascontiguousarray(b)) if b.ndim == 1 else self.handle.solve_many(np.ascontiguousarray(b))


def factorize(matrix: Any) -> RslabFactor:
    """Factor a symmetric sparse matrix; SolverError where it is singular."""
    try:
        import rslab
    except ImportError:
        raise MissingExtraError("rslab", "fast") from None
    try:
        return RslabFactor(rslab.ldlt(sp.csc_matrix(matrix)), np.iscomplexobj(matrix.data))
    except RuntimeError as error:
        raise SolverError(f"the matrix {matrix.shape} is singular ({error}); shift it or remove mechanisms") from None

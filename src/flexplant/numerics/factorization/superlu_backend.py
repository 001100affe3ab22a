"""SuperLU (scipy) in symmetric mode: the fallback that is always there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexplant.errors import SolverError


@dataclass(frozen=True, eq=False)
class SuperluFactor:
    """See `Factor`."""

    handle: Any
    backend: str = "superlu"

    @cached_property
    def negative_pivots(self) -> int | None:
        """Negative entries of U's diagonal: with pivots on the diagonal, P A P^T = L U has U = D L^T, and D has A's inertia."""
        if self.handle.L.dtype != np.float64 or not np.array_equal(self.handle.perm_r, self.handle.perm_c):
            return None
        return int(np.count_nonzero(self.handle.U.diagonal() < 0))

    @property
    def fill(self) -> int:
        """Entries of L and U."""
        return int(self.handle.nnz)

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        dtype = self.handle.L.dtype
        return self.handle.solve(np.asarray(right_side, dtype=dtype))


@dataclass(frozen=True)
class SuperluAnalysis:
    """See `Analysis`; SuperLU orders and factors in one step, so nothing is known before."""

    estimate: None = None

    def factorize(self, matrix: Any) -> SuperluFactor:
        """Factor a matrix; SolverError where it is singular or memory runs out."""
        mode = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True}}
        try:
            return SuperluFactor(splu(sp.csc_matrix(matrix), **mode))
        except RuntimeError as error:
            raise SolverError(f"the matrix {matrix.shape} is singular ({error}); shift it or remove mechanisms") from None
        except MemoryError:
            raise SolverError(
                f"SuperLU ran out of memory on {matrix.shape}; pip install 'flexplant[fast]' needs far less"
            ) from None


def analyze(matrix: Any, *, threads: int | None = None) -> SuperluAnalysis:  # noqa: ARG001  one signature for all backends
    """Nothing to do in advance."""
    return SuperluAnalysis()

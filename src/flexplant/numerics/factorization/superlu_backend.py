"""SuperLU (scipy) in symmetric mode: the fallback that is always there."""

from __future__ import annotations

from dataclasses import dataclass
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
    negative_pivots: int | None = None

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        dtype = self.handle.L.dtype
        return self.handle.solve(np.asarray(right_side, dtype=dtype))


def factorize(matrix: Any) -> SuperluFactor:
    """Factor a symmetric sparse matrix; SolverError where it is singular."""
    try:
        handle = splu(sp.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise SolverError(f"the matrix {matrix.shape} is singular ({error}); shift it or remove mechanisms") from None
    return SuperluFactor(handle)

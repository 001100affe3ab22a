"""SuperLU (scipy) in symmetric mode: the fallback that is always there.

The matrix is scaled to a unit diagonal first: rows in other units (rotations beside translations) would make SuperLU pivot off
the diagonal, which doubles its fill on shells and hides the inertia. The order is SuperLU's own minimum degree, asked for by an
incomplete factorisation that keeps nothing, so that the fill is known before the numbers are worked out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu, splu

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.factorization.column_counts import cholesky_estimate, column_counts
from flexplant.numerics.factorization.protocol import Estimate

MODE = {"diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True}}
FAINT = 1e-9  # off-diagonal entries of the pattern that is ordered, beside a unit diagonal
PADDING = 1.08  # stored entries for one of L and U: small supernodes hold zeros
ENTRY_BYTES = 10  # measured, index included


@dataclass(frozen=True, eq=False)
class SuperluFactor:
    """See `Factor`: of D P A P^T D, order: P's rows, scale: D's diagonal in that order."""

    handle: Any
    order: IntArray
    scale: FloatArray
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
        b = np.asarray(right_side, dtype=self.handle.L.dtype)
        scale = self.scale if b.ndim == 1 else self.scale[:, None]
        x = np.empty_like(b)
        x[self.order] = scale * self.handle.solve(scale * b[self.order])
        return x


@dataclass(frozen=True, eq=False)
class SuperluAnalysis:
    """See `Analysis`."""

    order: IntArray
    counts: IntArray
    entry_bytes: int

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation whose pivots stay on the diagonal, as those of K - s M do."""
        return cholesky_estimate(self.counts, 2 * PADDING * int(self.counts.sum()), self.entry_bytes)

    def factorize(self, matrix: Any) -> SuperluFactor:
        """Factor a matrix, of another pattern too; SolverError where it is singular or memory runs out."""
        if matrix.shape[0] != self.order.size:
            return analyze(matrix).factorize(matrix)
        csr = sp.csr_array(matrix)[self.order][:, self.order]
        size = np.sqrt(abs(csr.diagonal()))
        scale = np.divide(1.0, size, out=np.ones_like(size), where=size > 0)
        scaled = sp.csc_matrix(sp.diags_array(scale) @ csr @ sp.diags_array(scale))
        try:
            return SuperluFactor(splu(scaled, permc_spec="NATURAL", **MODE), self.order, scale)
        except RuntimeError as error:
            raise SolverError(f"the matrix {matrix.shape} is singular ({error}); shift it or remove mechanisms") from None
        except MemoryError:
            raise SolverError(
                f"SuperLU ran out of memory on {matrix.shape}; pip install 'flexplant[fast]' needs far less"
            ) from None


def analyze(matrix: Any, *, threads: int | None = None) -> SuperluAnalysis:  # noqa: ARG001  one signature for all backends
    """Order by minimum degree of the symmetric pattern, and count the entries of the factor."""
    csr = sp.csr_array(matrix)
    n = csr.shape[0]
    faint = sp.csr_array((np.full(csr.nnz, FAINT), csr.indices, csr.indptr), shape=csr.shape) + sp.eye_array(n)
    ordered = spilu(sp.csc_matrix(faint), drop_tol=1.0, fill_factor=1, permc_spec="MMD_AT_PLUS_A", **MODE)
    order = np.argsort(ordered.perm_c).astype(np.int64)
    return SuperluAnalysis(order, column_counts(csr, order), ENTRY_BYTES + (8 if np.iscomplexobj(csr.data) else 0))
